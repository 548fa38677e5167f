# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Invalid values, and valid extreme values, in MuJoCo models and data."""

import math

import mujoco
import numpy as np
import pytest
import warp as wp

import warpvis as wv
from warpvis.mujoco import (
    BatchRenderer,
    Rangefinders,
    Renderer,
    WorldPoses,
    camera_from_mujoco,
    camera_poses,
    geom_poses,
    scene_from_mujoco,
)

TEXT = """<mujoco><asset><material name="paint" rgba="1 0 0 1"/></asset><worldbody>
  <light name="lamp" pos="0 0 3" cutoff="{cutoff}"/>
  <geom name="table" type="box" size="1 1 .1" material="paint"/>
  <body name="ball" pos="0 0 1"><freejoint/><geom name="ball" type="sphere" size=".1"/><site name="eye"/></body>
  <body pos="0 0 2"><site name="down" zaxis="0 0 -1"/></body>
  <camera name="side" pos="0 -3 1" xyaxes="1 0 0 0 0 1"/></worldbody>
  <sensor><rangefinder site="down"/></sensor></mujoco>"""


def model_of(cutoff=45):
    return mujoco.MjModel.from_xml_string(TEXT.format(cutoff=cutoff))


def computed(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


@pytest.mark.parametrize("cutoff", [180, 90, 45, 0])
def test_spotlights_of_any_cutoff_are_read(cutoff):
    """180 degrees in MuJoCo's single precision exceeds pi radians."""
    light = scene_from_mujoco(model_of(cutoff)).scene.lights[1]
    assert light.outer_angle == pytest.approx(math.radians(cutoff), abs=1e-9) and light.outer_angle <= math.pi
    assert BatchRenderer(model_of(cutoff), outputs=("color",), height=8, width=8).render(computed(model_of())).color


def test_light_angles_accept_single_precision():
    assert wv.scene.lights.Light("spot", outer_angle=np.float32(np.pi)).outer_angle == math.pi
    light = wv.scene.lights.Light("spot", inner_angle=np.float32(np.pi / 4), outer_angle=np.pi / 4)
    assert light.inner_angle == light.outer_angle == np.pi / 4


FRESH = {
    "geom_poses": lambda model, data: geom_poses(data, scene_from_mujoco(model)),
    "geom_poses of sites": lambda model, data: geom_poses(data, scene_from_mujoco(model, site_groups=(0,))),
    "camera_poses": lambda model, data: camera_poses(data, model, [0]),
    "WorldPoses": lambda model, data: WorldPoses.of([computed(model), data]),
    "Renderer": lambda model, data: Renderer(model, 8, 8).update_scene(data),
    "Renderer, camera": lambda model, data: Renderer(model, 8, 8).update_scene(data, "side"),
    "BatchRenderer": lambda model, data: BatchRenderer(model, height=8, width=8).render(data),
    "BatchRenderer, several": lambda model, data: BatchRenderer(model, height=8, width=8).render([data, data]),
    "Rangefinders": lambda model, data: Rangefinders(model).read(data),
    "arrays": lambda model, data: geom_poses(
        WorldPoses(np.zeros((3, 2, 3)), np.zeros((3, 2, 3, 3))), scene_from_mujoco(model)
    ),
    "Warp's arrays": lambda model, data: geom_poses(
        WorldPoses(wp.zeros((3, 2), dtype=wp.vec3, device="cpu"), wp.zeros((3, 2), dtype=wp.mat33, device="cpu")),
        scene_from_mujoco(model),
    ),
}


@pytest.mark.parametrize("name", FRESH)
@pytest.mark.parametrize("reset", [False, True])
def test_uncomputed_data_is_rejected(name, reset):
    model = model_of()
    data = mujoco.MjData(model)
    if reset:
        mujoco.mj_forward(model, data)
        mujoco.mj_resetData(model, data)
    said = r"poses must be computed, got geom_xmat of zeros.*; call mujoco.mj_forward\(model, data\) first"
    with pytest.raises(wv.WarpvisError, match=said.replace("geom_", r"(geom|cam)_")):
        FRESH[name](model, data)


def test_uncomputed_data_of_fully_moving_model_is_rejected():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
    )
    with pytest.raises(wv.WarpvisError, match="poses must be computed, got geom_xmat of zeros; call"):
        Renderer(model, 8, 8).update_scene(mujoco.MjData(model))


def test_cameras_need_more_than_kinematics():
    """`mj_kinematics` computes only geoms and sites."""
    model = model_of()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geom_poses(data, scene_from_mujoco(model))
    Rangefinders(model).read(data)
    for use in (FRESH["camera_poses"], FRESH["Renderer, camera"], FRESH["BatchRenderer"]):
        with pytest.raises(wv.WarpvisError, match="poses must be computed, got cam_xmat of zeros"):
            use(model, data)
    BatchRenderer(model, height=8, width=8).render(data, cameras=-1)


def test_only_rendered_worlds_must_be_computed():
    model = model_of()
    data, batch = computed(model), BatchRenderer(model, height=8, width=8)
    names = ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat")
    poses = WorldPoses(**{name: np.stack([getattr(data, name)] * 3) for name in names})
    poses.geom_xmat[1] = 0
    assert batch.render(poses, worlds=[0, 2]).worlds == 2
    with pytest.raises(wv.WarpvisError, match="got geom_xmat of zeros in world 1;"):
        batch.render(poses)


@pytest.mark.parametrize("kind", ["geom", "cam", "site"])
@pytest.mark.parametrize("part", ["xpos", "xmat"])
@pytest.mark.parametrize("value", [math.nan, -math.inf])
def test_non_finite_poses_are_rejected(kind, part, value):
    model = model_of()
    data, name = computed(model), f"{kind}_{part}"
    renderer = Renderer(model, 8, 8)
    getattr(data, name)[-1, -1] = value
    uses = {
        "geom": ("geom_poses", "Renderer", "BatchRenderer", "BatchRenderer, several", "Rangefinders"),
        "cam": ("camera_poses", "Renderer, camera", "BatchRenderer"),
        "site": ("geom_poses of sites", "Rangefinders"),
    }
    for use in uses[kind]:
        with pytest.raises(wv.WarpvisError, match=f"{name} must be finite, got .*{value}.* at index"):
            FRESH[use](model, data)
    if kind != "site":
        with pytest.raises(wv.WarpvisError, match=f"{name} must be finite, got"):
            renderer.update_scene(data, "side")
    batch, good = BatchRenderer(model, height=8, width=8), computed(model)
    poses = WorldPoses(
        **{field: np.stack([getattr(some, field) for some in (good, data)]) for field in vars(WorldPoses.of([good]))}
    )
    assert batch.render(poses, worlds=[0]).worlds == 1


FIELD = """<mujoco><asset><hfield name="hills" nrow="3" ncol="3" size="1 1 1 .1"/>
  <mesh name="rock" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset><worldbody><geom type="hfield" hfield="hills"/>
  <geom type="mesh" mesh="rock"/><body pos=".3 0 2"><site name="down" zaxis="0 0 -1"/></body></worldbody>
  <sensor><rangefinder site="down"/></sensor></mujoco>"""


@pytest.mark.parametrize(
    ("field", "said"),
    [("hfield_data", "heights of hfield 0 must be finite"), ("mesh_vert", "vertices of mesh 0 must be finite")],
)
def test_rangefinders_reject_non_finite_shapes(field, said):
    model = mujoco.MjModel.from_xml_string(FIELD)
    finders, data = Rangefinders(model), computed(model)
    finders.read(data)
    getattr(model, field)[0] = math.nan
    for use in (lambda: finders.read(data), lambda: Rangefinders(model)):
        with pytest.raises(wv.WarpvisError, match=said):
            use()


SHAPES = {
    "geom_size": "geom_size of geom 'table' must be finite, got",
    "geom_rgba": "geom_rgba of geom 'table' must be finite, got",
    "mat_rgba": "mat_rgba of material 'paint' must be finite, got",
    "mat_texrepeat": "mat_texrepeat of material 'paint' must be finite, got",
    "mat_shininess": "mat_shininess of material 'paint' must be finite, got",
    "site_rgba": "site_rgba of site 'eye' must be finite, got",
}


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("field", SHAPES)
def test_non_finite_shapes_and_colors_are_rejected(field, value):
    model = model_of()
    data = computed(model)
    renderer, finders = Renderer(model, 8, 8), Rangefinders(model)
    getattr(model, field)[0] = value
    makers = [scene_from_mujoco, BatchRenderer, Rangefinders, lambda model: Renderer(model, 8, 8)]
    for make in makers:
        with pytest.raises(wv.WarpvisError, match=SHAPES[field]):
            make(model)
    if field in ("geom_size", "geom_rgba", "mat_rgba", "site_rgba"):  # fields that affect depth
        with pytest.raises(wv.WarpvisError, match=SHAPES[field]):
            renderer.update_scene(data)
    if field in ("geom_size", "geom_rgba", "mat_rgba"):
        with pytest.raises(wv.WarpvisError, match=SHAPES[field]):
            finders.read(data)


@pytest.mark.parametrize("field", ["pos", "dir", "cutoff", "exponent", "attenuation", "ambient", "diffuse", "specular"])
def test_non_finite_lights_are_rejected(field):
    model = model_of()
    getattr(model, f"light_{field}")[0] = math.nan
    with pytest.raises(wv.WarpvisError, match=f"light_{field} of light 'lamp' must be finite, got"):
        scene_from_mujoco(model)
    model.light_active[0] = 0
    scene_from_mujoco(model)
    model.vis.headlight.diffuse[0] = math.nan
    with pytest.raises(wv.WarpvisError, match=r"vis.headlight.diffuse must be finite numbers, got \[nan"):
        scene_from_mujoco(model)


def test_non_finite_fields_of_view_are_rejected():
    model = model_of()
    data, renderer = computed(model), Renderer(model, 8, 8)
    model.cam_fovy[0] = math.nan
    for use in (
        lambda: camera_from_mujoco(model, "side", 8, 8),
        lambda: renderer.update_scene(data, "side"),
        lambda: BatchRenderer(model, height=8, width=8).render(data),
    ):
        with pytest.raises(wv.WarpvisError, match="cam_fovy of camera 'side' must be finite, got nan"):
            use()
    model.vis.global_.fovy = math.nan
    with pytest.raises(wv.WarpvisError, match="must have a near plane, a field of view and a sensor size above 0"):
        renderer.update_scene(data)


@pytest.mark.parametrize("field", ["geom_rgba", "mat_rgba"])
def test_non_finite_colors_of_worlds_are_rejected(field):
    model = model_of()
    batch, colors = BatchRenderer(model, height=8, width=8), getattr(model, field)[None].repeat(2, axis=0)
    colors[1, 0, 3] = math.nan
    for given in (colors, wp.array(colors, dtype=wp.vec4, device="cpu")):
        with pytest.raises(wv.WarpvisError, match=f"{field} must be finite, got .*nan.* at index 0 in world 1"):
            batch.render([computed(model)] * 2, model={field: given})
