# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Options of colors have the same names and effects wherever colors are rendered."""

import json
from functools import partial

import mujoco
import numpy as np
import pytest
from command_line import run_inside

import warpvis as wv
from warpvis.batch import FrameRenderer
from warpvis.cameras.rays import WideCamera
from warpvis.rendering import render_wide
from warpvis.scene.lights import AmbientOcclusion, Light

# A polished floor, a ball near a wall, and bright ambient light.
MJCF = """
<mujoco>
  <visual><headlight ambient=".5 .5 .5"/><map znear="0.01" zfar="20"/></visual>
  <statistic extent="1"/>
  <asset><material name="polished" rgba=".3 .4 .5 1" reflectance=".5"/></asset>
  <worldbody>
    <light pos="-1 -2 3" dir=".3 .6 -1"/>
    <geom name="floor" type="plane" size="2 2 .1" material="polished"/>
    <geom name="wall" type="box" size=".8 .05 .4" pos="0 .6 .4" rgba=".8 .3 .2 1"/>
    <geom name="ball" type="sphere" size=".25" pos="0 .2 .3" rgba=".2 .7 .3 1"/>
    <camera name="front" pos="0 -2 .9" xyaxes="1 0 0 0 .4 1" fovy="50"/>
  </worldbody>
</mujoco>
"""
MODEL = mujoco.MjModel.from_xml_string(MJCF)
SIZE = {"width": 40, "height": 32}
POSE = np.array(wv.look_at((0, -2, 0.9), (0, 0, 0.3)))
CAMERA = wv.Camera.from_fov(**SIZE, hfov=0.9)
OPTIONS = {
    "shadows": {"shadows": False},
    "reflections": {"reflections": False},
    "ambient_occlusion": {"ambient_occlusion": AmbientOcclusion(0.5, samples=16)},
    "samples": {"samples": 4},
}
each_option = pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)


def room():
    return wv.mujoco.scene_from_mujoco(MODEL).scene


def color(views):
    return views.color.numpy()[0]


def forward():
    data = mujoco.MjData(MODEL)
    mujoco.mj_forward(MODEL, data)
    return data


def expected(options):
    """Return the image of `warpvis.render`, which differs from that without the options."""
    image, plain = (color(wv.render(room(), CAMERA, POSE, outputs=("color",), **given)) for given in (options, {}))
    assert (image != plain).any()
    return image


@each_option
def test_data_sets(tmp_path, options):
    image = expected(options)
    batch = FrameRenderer(room(), CAMERA, outputs=("color",), **options)({"camera_to_world": POSE[None]})
    np.testing.assert_array_equal(batch["color"][0], image)
    job = room(), CAMERA, POSE, tmp_path / "out"
    wv.render_batch(*job, outputs=("color",), threads=1, **options)
    np.testing.assert_array_equal(wv.open_dataset(tmp_path / "out")[0]["color"], image)
    manifest = json.loads((tmp_path / "out/manifest.json").read_text())
    defaults = {"shadows": True, "reflections": True, "ambient_occlusion": None, "samples": 1}
    recorded = {"ambient_occlusion": {"distance": 0.5, "samples": 16}} if "ambient_occlusion" in options else options
    assert {name: manifest[name] for name in defaults} == defaults | recorded
    with pytest.raises(wv.WarpvisError, match=f"the manifest's {next(iter(options))} was|{next(iter(options))} was"):
        wv.render_batch(*job, outputs=("color",), threads=1, resume=True)
    assert wv.render_batch(*job, outputs=("color",), threads=1, resume=True, **options).rendered_frames == 0


@each_option
def test_mujoco_renderers(options):
    data, images = forward(), []
    for given in (options, {}):
        batch = wv.mujoco.BatchRenderer(MODEL, **SIZE, outputs=("color",), **given)
        with wv.mujoco.Renderer(MODEL, **SIZE, lighting="pixel", **given) as renderer:
            renderer.update_scene(data, "front")
            images.append(renderer.render())
        np.testing.assert_array_equal(images[-1], color(batch.render(data, cameras="front")))
    assert (images[0] != images[1]).any()


def test_flags_of_mujoco_turn_off_the_same():
    for name in ("shadows", "reflections"):
        images = []
        for options in ({}, OPTIONS[name]):
            with wv.mujoco.Renderer(MODEL, **SIZE, **options) as renderer:
                renderer.update_scene(forward(), "front")
                renderer.scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{name[:-1].upper()}")] = bool(options)
                images.append(renderer.render())
        np.testing.assert_array_equal(*images)


@each_option
def test_gymnasium_wrappers(options):
    gym = pytest.importorskip("gymnasium")
    from warpvis.mujoco import gymnasium as wrappers

    class Still(gym.Env):
        observation_space = action_space = gym.spaces.Box(-1, 1, (1,))

        def __init__(self):
            self.model, self.data = MODEL, forward()

        def reset(self, *, seed=None, options=None):
            return np.zeros(1, dtype=np.float32), {}

    def make(wrapper, **given):
        return getattr(wrappers, wrapper)(Still(), **given)

    look = {**SIZE, "camera": "front"}
    with wv.mujoco.Renderer(MODEL, **SIZE, **options) as renderer:
        renderer.update_scene(forward(), "front")
        frames = make("RenderFrames", **look, **options)
        np.testing.assert_array_equal(frames.render(), renderer.render())
    batch = wv.mujoco.BatchRenderer(MODEL, **SIZE, outputs=("color",), **options)
    image = color(batch.render(forward(), cameras="front"))
    single = make("DepthObservation", outputs=("rgb",), **look, **options)
    vector = gym.vector.SyncVectorEnv([partial(make, "PoseObservation")])
    vector = wrappers.VectorDepthObservation(vector, outputs=("rgb",), **look, **options)
    for found in (single.reset()[0]["rgb"], vector.reset()[0]["rgb"][0]):
        assert (np.abs(found.astype(int) - image) > 1).mean() < 2e-3
    for wrapper in (single, frames):  # a specification makes an equal environment
        assert wrapper._saved_kwargs.items() >= options.items()


def test_wide_images():
    scene, camera = room(), WideCamera(40, 20, 2.0)
    for options in (OPTIONS["reflections"], OPTIONS["ambient_occlusion"]):
        image = color(render_wide(scene, 40, 20, 2.0, POSE, outputs=("color",), **options))
        np.testing.assert_array_equal(image, color(wv.render(scene, camera, POSE, outputs=("color",), **options)))
        assert (image != color(render_wide(scene, 40, 20, 2.0, POSE, outputs=("color",)))).any()


@pytest.mark.parametrize("projection", ["planar", "cylindrical"])
def test_cameras_of_webots(tmp_path, projection):
    fields = f'name "eye" width 40 height 30 projection "{projection}" fieldOfView 1.2'
    box = "Solid {{ translation {} children Shape {{ appearance {} geometry Box {{ size {} }} }} }}"
    matt = "PBRAppearance { roughness 1 metalness 0 }"
    solids = box.format("2 0 -0.5", matt, "4 4 0.1") + box.format("2 0 -0.2", matt, "0.4 0.4 0.5")
    light = "DirectionalLight { ambientIntensity 1 direction -0.5 0.5 -1 castShadows TRUE }"
    robot = f"Robot {{ children Camera {{ {fields} }} }}"
    (tmp_path / "lab.wbt").write_text(f"#VRML_SIM R2023b utf8\nBackground {{ }}\n{light}\n{robot}\n{solids}")
    world = wv.webots.load_webots(tmp_path / "lab.wbt")
    world.scene.lights += (Light("ambient", ambient=(0.4, 0.4, 0.4)),)
    plain = wv.webots.render_color(world, "eye")
    for options in (OPTIONS["shadows"], OPTIONS["ambient_occlusion"]):
        image = wv.webots.render_color(world, "eye", **options)
        assert image.shape == plain.shape and (image != plain).any()
        darker = "ambient_occlusion" in options
        assert (image <= plain).all() if darker else (image >= plain).all()


def test_command_line(tmp_path):
    (tmp_path / "room.xml").write_text(MJCF)
    (tmp_path / "poses.txt").write_text("0 " + " ".join(map(repr, POSE.tolist())) + "\n")
    (tmp_path / "camera.json").write_text(json.dumps({**SIZE, "hfov": 0.9}))
    files = ("room.xml", "--poses", "poses.txt", "--camera", "camera.json", "--outputs", "color", "--format", "npz")
    options = ("--no-reflections", "--ambient-occlusion", "0.5", "--samples", "4", "--no-shadows")
    for command, folder in (("render", "one/npz"), ("batch", "two")):
        out = folder.split("/")[0]
        result = run_inside(command, *files, "--out", out, *options, cwd=tmp_path)
        assert (result.returncode, result.stderr) == (0, "")
        given = {"reflections": False, "shadows": False, "samples": 4, "ambient_occlusion": AmbientOcclusion(0.5)}
        scene = wv.Scene.load(tmp_path / "room.xml")
        dataset = wv.open_dataset(tmp_path / folder)
        views = wv.render(scene, dataset.camera, dataset[0]["camera_to_world"], outputs=("color",), **given)
        np.testing.assert_array_equal(dataset[0]["color"], color(views))
    result = run_inside("render", *files, "--out", "three", "--ambient-occlusion", "0", cwd=tmp_path)
    assert result.returncode == 2 and "distance of ambient occlusion must be greater than 0" in result.stderr


@pytest.mark.parametrize(
    "make",
    [
        lambda **given: wv.render_batch(room(), CAMERA, POSE, "unused", **given),
        lambda **given: wv.mujoco.Renderer(MODEL, **given),
        lambda **given: wv.mujoco.BatchRenderer(MODEL, **given),
    ],
    ids=["render_batch", "Renderer", "BatchRenderer"],
)
def test_invalid_options_are_refused(make, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(wv.WarpvisError, match="reflections must be True or False"):
        make(reflections="some")
    with pytest.raises(wv.WarpvisError, match="ambient_occlusion must be an AmbientOcclusion or None, got float"):
        make(ambient_occlusion=0.5)
    with pytest.raises(TypeError, match="unexpected keyword argument 'shadow'"):
        make(shadow=False)
    assert not list(tmp_path.iterdir())
