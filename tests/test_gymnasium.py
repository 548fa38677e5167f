# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Observations of Gymnasium environments: single, in vectors, in workers, and across resets."""

import importlib
import pickle
import sys
from functools import partial
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

import warpvis as wv

gym = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium_environments import Cup, make_cup  # noqa: E402

from warpvis.mujoco.gymnasium import DepthObservation, PoseObservation, VectorDepthObservation  # noqa: E402

SIZE = {"width": 40, "height": 32}
ALL = {"outputs": ("depth", "segmentation"), "objects": ("cup", "bulb"), "segmentation": "body", **SIZE}
ACTION = np.array([0.5], dtype=np.float32)


def observed(camera="front", env=None, seed=0, **options):
    env = DepthObservation(env or Cup(), camera=camera, **(SIZE | options))
    return env, env.reset(seed=seed)[0]


def vector(kind, wrapper, count=3, mode="NextStep", length=1000, **options):
    makers = [partial(make_cup, wrapper, length=length, **options)] * count
    if kind == "sync":
        return gym.vector.SyncVectorEnv(makers, autoreset_mode=mode)
    return gym.vector.AsyncVectorEnv(makers, context=kind, autoreset_mode=mode)


def assert_same(one, other):
    assert set(one) == set(other)
    for name, value in one.items():
        assert (value.dtype, value.shape) == (other[name].dtype, other[name].shape), name
        if name == "visible_fraction":
            np.testing.assert_allclose(value, other[name], atol=0.02)
        elif name in ("depth", "segmentation"):
            different = np.abs(value - other[name]) > (1e-4 if name == "depth" else 0)
            assert different.mean() < 2e-3, name
        else:
            np.testing.assert_array_equal(value, other[name])


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("dictionary", [False, True])
@pytest.mark.parametrize("camera", ["front", ["front", -1]])
def test_gymnasium_env_checker(camera, dictionary):
    env, observation = observed(camera, Cup(dictionary=dictionary), **ALL)
    check_env(env, skip_render_check=True)
    assert set(observation) == {"joints" if dictionary else "state", "depth", "segmentation", "visible_fraction"}
    assert observation["depth"].shape == (32, 40) if camera == "front" else (2, 32, 40)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_registered_gymnasium_environment():
    pytest.importorskip("imageio")
    env = DepthObservation(gym.make("Reacher-v5"), objects=["target"], **SIZE)
    check_env(env, skip_render_check=True)
    again = env.spec.make()
    assert again.observation_space == env.observation_space
    assert_same(env.reset(seed=1)[0], again.reset(seed=1)[0])


def test_depth_equals_the_renderers():
    env, _ = observed("chase")
    observation, *_ = env.step(ACTION)
    simulation = env.unwrapped
    with wv.mujoco.Renderer(simulation.model, **SIZE) as renderer:
        renderer.enable_depth_rendering()
        option = mujoco.MjvOption()
        option.sitegroup[:] = 0
        renderer.update_scene(simulation.data, "chase", option)
        wanted = renderer.render()
    near = wanted < 19.9
    np.testing.assert_array_equal(observation["depth"][near], wanted[near])
    assert not near.all() and (observation["depth"][~near] == 20).all(), "MuJoCo's far plane where nothing is"


def test_observations_follow_model_changes():
    env, before = observed(**ALL)
    simulation = env.unwrapped
    simulation.set_model("body_pos", simulation.model.body("shelf").id, [0, 1, 0.6])
    simulation.set_model("geom_size", simulation.model.geom("ball").id, [0.3, 0, 0])
    after = env.observation({})
    fresh = DepthObservation(env.env, camera="front", **ALL).observation({})
    assert_same(after, fresh)
    shelf = simulation.model.body("shelf").id
    assert (before["segmentation"] == shelf).any(axis=1).argmax() > (after["segmentation"] == shelf).any(
        axis=1
    ).argmax()


def test_images_are_owned_by_the_caller():
    env, first = observed(["front", "chase"], **ALL)
    kept = {name: value.copy() for name, value in first.items()}
    second, *_ = env.step(ACTION)
    for name in ("depth", "segmentation", "visible_fraction"):
        assert not np.shares_memory(first[name], second[name]) and second[name].flags.c_contiguous
        np.testing.assert_array_equal(first[name], kept[name])
        second[name][:] = 0
    assert env.observation({})["depth"].min() > 0


@pytest.mark.parametrize(
    ("fill", "empty", "bounds"), [("far", 20, (0, 20)), (-1.0, -1, (-1, 20)), ("inf", np.inf, (0, np.inf))]
)
def test_fill_of_empty_pixels(fill, empty, bounds):
    env, observation = observed(fill=fill, outputs=("depth", "segmentation"))
    space = env.observation_space["depth"]
    assert (space.low.min(), space.high.max()) == bounds and space.contains(observation["depth"])
    nothing = observation["segmentation"] < 0
    assert nothing.any() and (observation["depth"][nothing] == np.float32(empty)).all()


@pytest.mark.parametrize("segmentation", ["geom", "body", {"*": 0, "cup": 3, "handle": 7}])
def test_segmentation_values(segmentation):
    env, observation = observed(segmentation=segmentation, outputs=["segmentation"])
    model = env.unwrapped.model
    geoms = observed(outputs=["segmentation"])[1]["segmentation"]
    numbers = {"geom": np.arange(model.ngeom), "body": model.geom_bodyid}
    wanted = numbers.get(segmentation) if isinstance(segmentation, str) else np.zeros(model.ngeom, dtype=int)
    if not isinstance(segmentation, str):
        wanted[model.geom("ball").id], wanted[model.geom("handle").id] = 3, 7
    np.testing.assert_array_equal(observation["segmentation"], np.append(wanted, -1)[geoms])
    assert env.observation_space["segmentation"].high.max() == max(wanted)
    assert "depth" not in observation


def test_fractions_need_no_segmentation():
    names, vectors = ("depth",), []
    single = observed(**ALL)[1]["visible_fraction"]
    for outputs in (ALL["outputs"], names):
        options = ALL | {"outputs": outputs}
        wrapped = VectorDepthObservation(vector("sync", "PoseObservation"), camera="front", **options)
        vectors.append(wrapped.reset(seed=0)[0]["visible_fraction"])
    assert wrapped._outputs.images == names
    np.testing.assert_array_equal(*vectors)
    np.testing.assert_array_equal(observed(**ALL | {"outputs": names})[1]["visible_fraction"], single)


def test_visible_fraction_of_whole_bodies():
    """For one geom it equals `object_visibility`; for two, it uses their joint silhouette."""
    env, observation = observed(
        objects=["ball", "handle", "cup", "foot"], outputs=["segmentation"], width=80, height=64
    )
    simulation = env.unwrapped

    def measure(model, names):
        geoms = wv.mujoco.scene_from_mujoco(model)
        camera = wv.mujoco.camera_from_mujoco(model, "front", 80, 64)
        eye = wv.mujoco.camera_poses(simulation.data, model, [model.camera("front").id])[0]
        poses = wv.mujoco.geom_poses(simulation.data, geoms)
        return wv.object_visibility(geoms.scene, camera, eye, objects=names, object_poses=poses)

    report = measure(simulation.model, ["ball", "handle", "foot"])
    ball, handle, cup, foot = observation["visible_fraction"].tolist()
    np.testing.assert_allclose([ball, handle, foot], report.fraction.numpy()[0], atol=0.01)
    shown = report.visible_pixels.numpy()[0, :2].sum()
    assert (
        0 < handle < 1 and cup == pytest.approx(1, abs=0.02) and shown < report.silhouette_pixels.numpy()[0, :2].sum()
    )
    simulation.data.qpos[0] = 1.0  # behind the wall
    mujoco.mj_forward(simulation.model, simulation.data)
    assert env.observation({})["visible_fraction"][2] < 0.35


def test_pickled_copies_return_the_same():
    env, _ = observed(**ALL)
    again = pickle.loads(pickle.dumps(env))
    assert_same(env.reset(seed=5)[0], again.reset(seed=5)[0])
    env.close()
    env.close()


def test_models_of_other_environment_classes():
    cup = Cup()
    cup.reset(seed=0)
    sim = SimpleNamespace(model=SimpleNamespace(_model=cup.model), data=SimpleNamespace(_data=cup.data))
    physics = SimpleNamespace(model=SimpleNamespace(ptr=cup.model), data=SimpleNamespace(ptr=cup.data))

    class Other(gym.Env):
        observation_space = gym.spaces.Discrete(2)
        action_space = gym.spaces.Discrete(2)

        def __init__(self, **home):
            self.__dict__.update(home)

    for home in ({"sim": sim}, {"_env": SimpleNamespace(physics=physics)}):
        image = DepthObservation(Other(**home), camera="front", **SIZE).observation(1)
        assert image["state"] == 1 and image["depth"].min() < 3


@pytest.mark.smoke("camera1-SameStep", "front-NextStep")
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("camera", ["front", ["chase", -1]])
def test_vector_matches_single_environments(mode, camera):
    compare_vectors("sync", mode, camera)


@pytest.mark.smoke("fork-*")
@pytest.mark.parametrize(("kind", "count"), [("fork", 2), ("spawn", 1)])
def test_worker_processes(kind, count):
    compare_vectors(kind, "SameStep", "front", count)


def compare_vectors(kind, mode, camera, count=3):
    one = vector("sync" if kind == "spawn" else kind, "DepthObservation", count, mode, 3, camera=camera, **ALL)
    all_ = VectorDepthObservation(vector(kind, "PoseObservation", count, mode, 3), camera=camera, **ALL)
    assert one.observation_space == all_.observation_space
    assert one.single_observation_space == all_.single_observation_space
    assert_same(one.reset(seed=7)[0], all_.reset(seed=7)[0])
    ended = 0
    for step in range(5):
        actions = np.full((count, 1), (-1) ** step, dtype=np.float32)
        (wanted, *_, expected), (got, *_, infos) = one.step(actions), all_.step(actions)
        assert_same(wanted, got)
        assert got in all_.observation_space and "poses" not in got
        for last, other in zip(expected.get("final_obs", ()), infos.get("final_obs", ()), strict=True):
            assert_same(last, other)
            ended += 1
    assert ended == (count if mode == "SameStep" else 0)
    one.close()
    all_.close()


def test_sites_are_rendered_on_request():
    every = mujoco.MjvOption()
    look = {"camera": "front", "objects": ["mark"], "outputs": ["segmentation"], **SIZE}
    look["segmentation"] = {"*": 0, "mark": 5}
    for option, shown in ((None, False), (every, True)):
        alone = DepthObservation(Cup(), scene_option=option, **look).reset(seed=0)[0]
        makers = [partial(make_cup, "PoseObservation")] * 2
        together = VectorDepthObservation(gym.vector.SyncVectorEnv(makers), scene_option=option, **look)
        observations = together.reset(seed=0)[0]
        assert_same(alone, {name: value[0] for name, value in observations.items()})
        assert (alone["segmentation"] == 5).any() == shown == (alone["visible_fraction"][0] > 0.9)
    assert (observed(outputs=["segmentation"], scene_option=every)[1]["segmentation"] == -1).any()


def test_vector_without_autoreset():
    envs = VectorDepthObservation(vector("sync", "PoseObservation", 2, "Disabled", 2), camera="front", **SIZE)
    first, _ = envs.reset(seed=0)
    for _ in range(2):
        observations, _, ended, *_ = envs.step(np.ones((2, 1), dtype=np.float32))
    assert ended.all()
    after, _ = envs.reset(seed=[0, 1], options={"reset_mask": np.array([True, False])})
    np.testing.assert_array_equal(after["depth"][0], first["depth"][0])
    np.testing.assert_array_equal(after["depth"][1], observations["depth"][1])


def test_vector_shows_differences_between_models():
    envs = vector("sync", "PoseObservation")
    images = VectorDepthObservation(envs, camera="front", movable=["shelf"], **ALL)
    alone = [DepthObservation(env.unwrapped, camera="front", **ALL) for env in envs.envs]
    images.reset(seed=0)
    first, second, third = (env.unwrapped for env in envs.envs)
    first.set_model("geom_rgba", first.model.geom("ball").id, [1, 1, 1, 0])
    second.set_model("cam_fovy", second.model.camera("front").id, 30)
    third.set_model("body_pos", third.model.body("shelf").id, [0, 0.5, 0.5])
    for _ in range(2):
        seen, *_ = images.step(np.zeros((3, 1), dtype=np.float32))
        for index, env in enumerate(alone):
            assert_same(env.observation(seen["state"][index]), {name: part[index] for name, part in seen.items()})


def test_unsupported_model_differences_raise():
    def stepped(change, **options):
        envs = vector("sync", "PoseObservation", 2)
        images = VectorDepthObservation(envs, camera="front", **SIZE, **options)
        images.reset(seed=0)
        change(envs.envs[1].unwrapped)
        images.step(np.zeros((2, 1), dtype=np.float32))

    with pytest.raises(wv.errors.SceneError, match=r"shapes of an environment's model .* must not change"):
        stepped(lambda env: env.set_model("geom_size", 1, [0.4, 0.4, 0.4]))
    with pytest.raises(
        wv.errors.ArrayError, match=r"'board' is static .* got another in world 1.* movable=\['board'\]"
    ):
        stepped(lambda env: env.set_model("body_pos", 1, [0, 1, 1]))
    with pytest.raises(wv.errors.SceneError, match=r"every environment must be wrapped in .*PoseObservation"):
        VectorDepthObservation(vector("sync", None))
    makers = [partial(make_cup, "PoseObservation", size=size) for size in (0.15, 0.15, 0.2)]
    with pytest.raises(wv.errors.SceneError, match="equal models and shapes, got a difference between 2 and 0"):
        VectorDepthObservation(gym.vector.SyncVectorEnv(makers))
    makers = [lambda: PoseObservation(faint)] * 2
    faint = Cup()
    faint.set_model("geom_rgba", 1, [1, 1, 1, 0])
    images = VectorDepthObservation(gym.vector.SyncVectorEnv(makers), camera="front", **SIZE)
    faint.set_model("geom_rgba", 1, [1, 1, 1, 1])
    with pytest.raises(
        wv.errors.SceneError,
        match=r"geom 1 \('wall'\) must be visible when .* created, got one that becomes visible later in environment 0",
    ):
        images.reset(seed=0)


def test_invalid_environments_and_arguments_raise():
    class NoModel(gym.Env):
        observation_space = action_space = gym.spaces.Discrete(2)

    for wrapper in (DepthObservation, PoseObservation):
        with pytest.raises(wv.errors.SceneError, match="env must be an environment on MuJoCo"):
            wrapper(NoModel())
        with pytest.raises(wv.errors.SceneError, match=r"observations have '(depth|poses)' already"):
            wrapper(wrapper(Cup()))
    with pytest.raises(wv.errors.ArrayError, match="outputs must be one or more of rgb, depth, rgbd, segmentation"):
        DepthObservation(Cup(), outputs=())
    with pytest.raises(wv.errors.SceneError, match="'fork' in objects must match a geom"):
        DepthObservation(Cup(), objects=["fork"])
    with pytest.raises(wv.errors.SceneError, match="'fork' in segmentation must match a geom"):
        DepthObservation(Cup(), segmentation={"fork": 1})
    with pytest.raises(wv.errors.CameraError, match="camera 'rear' is not in the model"):
        DepthObservation(Cup(), camera="rear")


def test_missing_gymnasium_raises_on_import(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("warpvis.mujoco.gymnasium")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(ImportError, match=r"needs Gymnasium, which is missing: pip install 'warpvis\[gymnasium\]'"):
        importlib.import_module("warpvis.mujoco.gymnasium")


# A ball behind a thick tendon and a card of a flex, which hang from a body that slides sideways.
HIDDEN = """
<mujoco>
  <visual><map znear="0.05" zfar="8"/></visual><statistic extent="1"/>
  <worldbody>
    <body name="cup" pos="0 0 .5"><geom name="ball" type="sphere" size=".15"/></body>
    <body name="bar" pos="0 -1 .5"><joint name="slide" type="slide" axis="1 0 0"/>
      <geom type="sphere" size=".01" mass="1"/><site name="low" pos="0 0 -.5"/><site name="high" pos="0 0 .5"/>
    </body>
    <body name="card" pos="0 -.8 .5"><joint name="shift" type="slide" axis="1 0 0"/>
      <geom type="sphere" size=".01" mass="1" pos=".6 0 0"/></body>
    <camera name="front" pos="0 -3 .5" xyaxes="1 0 0 0 0 1" fovy="20"/>
  </worldbody>
  <deformable><flex name="cloth" dim="2" body="card card card" vertex="-.2 0 -.3 .2 0 -.3 0 0 .3" element="0 1 2"/>
  </deformable>
  <tendon><spatial name="rope" width=".05"><site site="low"/><site site="high"/></spatial></tendon>
</mujoco>
"""


class Hidden(Cup):
    def __init__(self):
        super().__init__()
        self.model = mujoco.MjModel.from_xml_string(HIDDEN)
        self.data = mujoco.MjData(self.model)

    def reset(self, *, seed=None, options=None):
        gym.Env.reset(self, seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self.np_random.uniform(-0.3, 0.3, 2)
        mujoco.mj_forward(self.model, self.data)
        return self.now(), {}


def test_vector_fractions_behind_tendons_and_flexes():
    look = {"camera": "front", "objects": ["ball"], **SIZE}
    envs = gym.vector.SyncVectorEnv([lambda: PoseObservation(Hidden())] * 4)
    found = VectorDepthObservation(envs, **look).reset(seed=0)[0]["visible_fraction"]
    alone = [DepthObservation(Hidden(), **look).reset(seed=seed)[0]["visible_fraction"] for seed in range(4)]
    assert np.ptp(alone) > 0.2
    np.testing.assert_allclose(found, alone, atol=0.01)
