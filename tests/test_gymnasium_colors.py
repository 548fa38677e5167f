# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors in Gymnasium observations and frames, single and in vectors, with channels first or last."""

from functools import partial

import mujoco
import numpy as np
import pytest

import warpvis as wv

gym = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium_environments import Cup, make_cup  # noqa: E402

from warpvis.mujoco.gymnasium import (  # noqa: E402
    DepthObservation,
    RenderFrames,
    VectorDepthObservation,
)

SIZE = {"width": 40, "height": 32}
ACTION = np.array([0.5], dtype=np.float32)


def observed(env=None, camera="front", **options):
    env = DepthObservation(env or Cup(), camera=camera, **(SIZE | options))
    return env, env.reset(seed=0)[0]


def picture(env, camera="front", *, sites=False, lighting="pixel"):
    """Return color and depth of the environment's current state by a separate renderer."""
    model, data = env.unwrapped.model, env.unwrapped.data
    option = mujoco.MjvOption()
    option.sitegroup[:] = option.sitegroup * sites
    with wv.mujoco.Renderer(model, **SIZE, lighting=lighting) as renderer:
        renderer.update_scene(data, camera, option)
        color = renderer.render()
        renderer.enable_depth_rendering()
        return color, renderer.render()


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("channels", ["last", "first"])
@pytest.mark.parametrize("camera", ["front", ["front", -1]])
def test_env_checker_and_shapes(channels, camera):
    outputs = ("rgb", "rgbd", "depth")
    env, observation = observed(camera=camera, channels=channels, outputs=outputs)
    check_env(env, skip_render_check=True)
    axes = () if camera == "front" else (2,)
    for name, count in (("rgb", 3), ("rgbd", 4)):
        shape = (*axes, 32, 40, count) if channels == "last" else (*axes, count, 32, 40)
        image, space = observation[name], env.observation_space[name]
        assert image.shape == space.shape == shape and image.dtype == space.dtype == np.uint8
        assert (space.low == 0).all() and (space.high == 255).all() and image.flags.c_contiguous
    assert observation["depth"].shape == (*axes, 32, 40)


def test_colors_equal_the_renderers():
    env, _ = observed(outputs=("rgb",))
    observation, *_ = env.step(ACTION)
    color, _ = picture(env)
    np.testing.assert_array_equal(observation["rgb"], color)
    assert color.std() > 10
    first, _ = observed(outputs=("rgb",), channels="first")
    np.testing.assert_array_equal(first.step(ACTION)[0]["rgb"], color.transpose(2, 0, 1))


def test_depth_channel_spans_the_range():
    env, observation = observed(outputs=("rgbd",), depth_range=(0.5, 3.0))
    color, depth = picture(env)
    np.testing.assert_array_equal(observation["rgbd"][..., :3], color)
    expected = np.clip(255 * (depth.astype(np.float64) - 0.5) / 2.5, 0, 255)
    assert np.abs(observation["rgbd"][..., 3] - expected).max() <= 0.501
    assert len(np.unique(observation["rgbd"][..., 3])) > 10
    env, observation = observed(outputs=("rgbd",))
    expected = np.clip(255 * depth.astype(np.float64) / (2 * env.unwrapped.model.stat.extent), 0, 255)
    assert np.abs(observation["rgbd"][..., 3] - expected).max() <= 0.501


def test_colors_follow_the_model():
    env, before = observed(outputs=("rgb", "segmentation"))
    model = env.unwrapped.model
    model.geom("ball").rgba[:] = 0, 0, 1, 1
    after = env.observation({})
    ball = before["segmentation"] == model.geom("ball").id
    assert ball.any() and (after["rgb"] != before["rgb"]).any(axis=-1)[ball].all()
    np.testing.assert_array_equal(after["rgb"], picture(env)[0])


def test_samples_and_shadows_are_those_of_the_batch():
    options = {"outputs": ("rgb",), "camera": "front", **SIZE}
    poses = None
    for given in ({}, {"samples": 4}, {"shadows": False}, {"samples": 4, "shadows": False}):
        single = DepthObservation(Cup(), **options, **given)
        envs = VectorDepthObservation(
            gym.vector.SyncVectorEnv([partial(make_cup, "PoseObservation")]), **options, **given
        )
        ours, theirs = single.reset(seed=4)[0]["rgb"], envs.reset(seed=[4])[0]["rgb"][0]
        model, data = single.unwrapped.model, single.unwrapped.data
        batch = wv.mujoco.BatchRenderer(model, outputs=("color",), **SIZE, **given)
        expected = batch.render(data, cameras="front").color.numpy()[0]
        for image in (ours, theirs):
            assert (np.abs(image.astype(int) - expected) > 1).mean() < 2e-3
        assert poses is None or (poses != ours).any()
        poses = ours
    frames = RenderFrames(Cup(), camera="front", samples=4, **SIZE)
    frames.reset(seed=4)
    renderer = wv.mujoco.Renderer(frames.unwrapped.model, SIZE["height"], SIZE["width"], samples=4)
    renderer.update_scene(frames.unwrapped.data, "front")
    np.testing.assert_array_equal(frames.render(), renderer.render())


@pytest.mark.parametrize("kind", ["sync", "fork"])
def test_vectors_equal_single_environments(kind):
    options = {"outputs": ("rgb", "rgbd", "depth"), "channels": "first", "camera": "front", **SIZE}
    makers = [partial(make_cup, "PoseObservation")] * 2
    envs = gym.vector.SyncVectorEnv(makers) if kind == "sync" else gym.vector.AsyncVectorEnv(makers, context=kind)
    envs = VectorDepthObservation(envs, **options)
    single = DepthObservation(Cup(), **options)
    ours, theirs = envs.reset(seed=[3, 4])[0], single.reset(seed=4)[0]
    for _ in range(3):
        assert envs.observation_space.contains(ours)
        for name in ("rgb", "rgbd"):
            difference = np.abs(ours[name][1].astype(int) - theirs[name])
            assert ours[name].shape == (2, *theirs[name].shape) and (difference > 1).mean() < 2e-3
        ours, theirs = envs.step(np.stack([ACTION] * 2))[0], single.step(ACTION)[0]
    envs.close()


def test_hidden_geoms_keep_other_colors():
    envs = VectorDepthObservation(
        gym.vector.SyncVectorEnv([partial(make_cup, "PoseObservation")] * 2), outputs=("rgb",)
    )
    before = envs.reset(seed=[0, 0])[0]["rgb"]
    hidden = envs.unwrapped.envs[1].unwrapped
    hidden.model.geom("ball").rgba[3] = 0
    after = envs.step(np.zeros((2, 1), dtype=np.float32))[0]["rgb"]
    single = DepthObservation(Cup(), outputs=("rgb",))
    single.reset(seed=0)
    single.unwrapped.model.geom("ball").rgba[3] = 0
    expected = single.step(np.zeros(1, dtype=np.float32))[0]["rgb"]
    assert (np.abs(after[1].astype(int) - expected) > 1).mean() < 5e-3
    assert (before[0] != after[1]).any()
    envs.close()


def test_depth_alone_does_not_follow_colors():
    env, _ = observed(outputs=("depth",))
    assert not env._renderer._follows_colors and env._renderer.scene.lights == ()


def test_frames_are_rendered_without_opengl(monkeypatch):
    monkeypatch.delattr(mujoco, "Renderer")
    env = RenderFrames(Cup(), camera="front", **SIZE)
    assert env.render_mode == "rgb_array"
    env.reset(seed=0)
    np.testing.assert_array_equal(env.render(), picture(env, sites=True, lighting="vertex")[0])
    before = env.render()
    env.step(ACTION)
    assert env.render().shape == (32, 40, 3) and (env.render() != before).any()
    pixels = gym.wrappers.AddRenderObservation(env, render_only=True)
    np.testing.assert_array_equal(pixels.reset(seed=0)[0], before)
    env.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"channels": "middle"}, 'channels must be "last" or "first", got .middle.'),
        ({"depth_range": (2, 1)}, r"depth_range must be two increasing depths of at least 0 m, got \(2, 1\)"),
        ({"depth_range": 3}, "depth_range must be"),
        ({"samples": 3}, "samples must be 1, 2, 4, 8, 16 per pixel, got 3"),
        ({"shadows": "soft"}, "shadows must be"),
        ({"depth_range": (0, np.inf)}, "depth_range must be a finite number"),
    ],
)
def test_invalid_options_are_rejected(options, message):
    with pytest.raises(wv.WarpvisError, match=message):
        DepthObservation(Cup(), outputs=("rgbd",), **options)


@pytest.mark.parametrize("channels", ["last", "first"])
@pytest.mark.parametrize("output", ["rgb", "rgbd"])
def test_networks_of_stable_baselines(channels, output):
    """NatureCNN is chosen for the images and learns from them."""
    sb3 = pytest.importorskip("stable_baselines3")

    def make():
        env = DepthObservation(Cup(), outputs=(output,), channels=channels, width=40, height=40)
        return gym.wrappers.FilterObservation(env, [output])

    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.torch_layers import NatureCNN

    policy = sb3.PPO(
        "MultiInputPolicy", make_vec_env(make, 2, seed=0), n_steps=8, batch_size=8, n_epochs=1, device="cpu"
    )
    assert isinstance(policy.policy.features_extractor.extractors[output], NatureCNN)
    assert policy.observation_space[output].shape == (3 if output == "rgb" else 4, 40, 40)
    before = [weights.detach().clone() for weights in policy.policy.parameters()]
    policy.learn(16)
    assert any((one != other).any() for one, other in zip(before, policy.policy.parameters(), strict=True))
