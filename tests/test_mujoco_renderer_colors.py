# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of `warpvis.mujoco.Renderer`, which follow the model, its data, options and flags, without OpenGL."""

import copy
import os
import pickle
import subprocess
import sys
import warnings

import mujoco
import numpy as np
import pytest
import reference_shading

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.mujoco import BatchRenderer, Renderer, camera_from_mujoco, camera_poses
from warpvis.scene.lights import Light
from warpvis.scene.materials import Material

from support.mujoco_renderer import away_from_silhouettes

HEIGHT, WIDTH = 60, 80
RND, VIS = mujoco.mjtRndFlag, mujoco.mjtVisFlag
EYE = '<camera name="eye" pos="0 -2.2 1.6" xyaxes="1 0 0 0 .6 .8" fovy="45"/>'

ROOM = f"""<mujoco><statistic extent="2"/><visual><map znear=".01"/><quality offsamples="0" shadowsize="4096"/>
  <headlight ambient=".2 .2 .2" diffuse=".3 .3 .3" specular="0 0 0"/></visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".3 .5 .7" rgb2="0 .1 .2" width="32" height="32"/>
    <texture name="check" type="2d" builtin="checker" rgb1=".9 .8 .1" rgb2=".1 .2 .8" width="64" height="64"/>
    <texture name="dots" type="2d" builtin="checker" rgb1=".1 .8 .1" rgb2=".8 .2 .1" width="64" height="64"/>
    <material name="check" texture="check" texrepeat="2 2" specular=".1"/>
    <material name="plain" rgba=".8 .3 .2 1" specular=".7" shininess=".3"/>
  </asset>
  <worldbody><geom name="floor" type="plane" size="1.2 1.2 .1" material="check"/>
    <light name="lamp" pos="-.8 -.8 2" dir=".4 .4 -1" diffuse=".5 .5 .5" type="directional"/>
    <body name="cart" pos=".3 .2 .3"><joint name="slide" type="slide" axis="1 0 0"/>
      <geom name="box" type="box" size=".2 .2 .2" material="plain"/>
      <light name="torch" pos="0 -.6 .5" dir="0 .5 -1" diffuse=".4 .4 .3" cutoff="60"/></body>
    <geom name="ball" size=".25" pos="-.5 .2 .25" rgba=".2 .7 .4 1"/>
    <site name="mark" type="box" size=".1 .1 .02" pos="-.4 -.5 .02" rgba="1 0 1 1"/>
    {EYE}</worldbody></mujoco>"""


def ready(text=ROOM, **options):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data, Renderer(model, HEIGHT, WIDTH, **options)


def picture(renderer, data, option=None):
    renderer.update_scene(data, "eye", option)
    image = renderer.render()
    assert image.shape == (renderer.height, renderer.width, 3) and image.dtype == np.uint8
    return image


def fresh(model, data, option=None):
    return picture(Renderer(model, HEIGHT, WIDTH), data, option)


WITHOUT_OPENGL = """
import builtins, re, sys
import numpy as np
real = builtins.__import__
def guarded(name, *given, **options):
    if re.match(r"(OpenGL|glfw|mujoco[.](egl|osmesa|glfw|gl_context))", name):
        raise ImportError(name + " must not be imported")
    return real(name, *given, **options)
builtins.__import__ = guarded
import mujoco
del mujoco.Renderer
from warpvis.mujoco import Renderer
model = mujoco.MjModel.from_xml_string(sys.argv[1])
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with Renderer(model, 60, 80) as renderer:
    renderer.update_scene(data, "eye")
    image = renderer.render()
assert image.shape == (60, 80, 3) and image.std() > 20, image.std()
maps = open("/proc/self/maps").read()
assert not re.search(r"lib(EGL|GL|GLX|OSMesa|OpenGL)[.-]", maps), "OpenGL is loaded"
print("rendered")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc/self/maps")
def test_no_opengl_is_imported_or_loaded():
    command, environment = [sys.executable, "-c", WITHOUT_OPENGL, ROOM], os.environ | {"MUJOCO_GL": "disable"}
    run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 0 and "rendered" in run.stdout, run.stderr


def test_colors_equal_those_of_a_batch():
    for lighting in ("pixel", "vertex"):
        model, data, renderer = ready(lighting=lighting)
        options = {"scene_option": mujoco.MjvOption(), "lighting": lighting}
        batch = BatchRenderer(model, height=HEIGHT, width=WIDTH, outputs=("color",), **options)
        expected = batch.render(data, cameras="eye").color.numpy()[0].astype(int)
        # Vertices are rounded in the frames of objects, which differ between the two scenes.
        np.testing.assert_allclose(picture(renderer, data), expected, rtol=0, atol=lighting == "vertex")
    out = np.zeros((HEIGHT, WIDTH, 3), dtype=np.float32)
    assert renderer.render(out=out) is out and (out == renderer.render()).all()
    with pytest.raises(wv.WarpvisError, match=r"out must have shape \(60, 80, 3\), got \(60, 80\)"):
        renderer.render(out=np.zeros((HEIGHT, WIDTH), dtype=np.uint8))


def test_lights_of_moving_bodies_move():
    """The floor under a lamp on a cart, compared with a double-precision reference."""
    model, data, renderer = ready(f"""<mujoco><visual><headlight active="0"/></visual>
      <worldbody><geom type="plane" size="3 3 .1" rgba=".8 .6 .4 1"/><body name="cart" pos="0 0 1"><joint type="slide"
      axis="1 0 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><light name="torch" dir="0 0 -1"
      diffuse=".9 .8 .7" ambient=".1 .1 .1" specular="0 0 0" attenuation="1 .2 .1" cutoff="180"/></body>{EYE}
      </worldbody></mujoco>""")
    camera, pictures = camera_from_mujoco(model, "eye", WIDTH, HEIGHT), []
    pose = camera_poses(data, model, [0])[0].astype(np.float64)
    for x in (-0.7, 0.6):
        data.qpos[0] = x
        mujoco.mj_forward(model, data)
        pictures.append(picture(renderer, data))
        torch = Light(
            "spot",
            position=(x, 0, 1),
            color=(0.9, 0.8, 0.7),
            ambient=(0.1,) * 3,
            specular=(0, 0, 0),
            attenuation=(1, 0.2, 0.1),
            outer_angle=np.pi,
        )
        rotation = poses_to_matrices(pose)[:3, :3]
        for v, u in ((20, 15), (35, 40), (50, 70)):
            ray = rotation @ [(u + 0.5 - camera.cx) / camera.fx, (v + 0.5 - camera.cy) / camera.fy, 1.0]
            point = pose[:3] - ray * pose[2] / ray[2]
            view = point, np.array([0, 0, 1.0]), pose[:3], rotation[:, 2]
            expected = 255 * reference_shading.lit_color([torch], Material(base_color=(0.8, 0.6, 0.4)), *view)
            assert np.abs(pictures[-1][v, u] - expected).max() <= 1
    assert np.abs(pictures[0].astype(int) - pictures[1]).max() > 20


def change(name, which, value):
    def edit(model):
        getattr(model, name)[which] = value

    return edit


EDITS = {
    "color": change("geom_rgba", 1, (0.1, 0.9, 0.9, 1)),
    "color of a material": change("mat_rgba", 1, (0.1, 0.9, 0.9, 1)),
    "highlight": change("mat_specular", 0, 1.0),
    "emission": change("mat_emission", 1, 0.5),
    "another material": change("geom_matid", 1, 0),
    "no material": change("geom_matid", 0, -1),
    "texture": change("mat_texid", (0, 1), 2),
    "repetitions": change("mat_texrepeat", 0, (5, 3)),
    "site": change("site_rgba", 0, (0, 1, 0, 1)),
    "light": change("light_diffuse", 0, (0.9, 0.1, 0.1)),
    "light off": change("light_active", 0, 0),
    "shadow": change("light_castshadow", 0, 0),
    "headlight": lambda model: model.vis.headlight.ambient.__setitem__(slice(None), (0.6, 0.1, 0.1)),
    "headlight off": lambda model: setattr(model.vis.headlight, "active", 0),
}


@pytest.mark.parametrize("name", EDITS)
def test_edits_of_the_model_are_followed(name):
    model, data, renderer = ready()
    before = picture(renderer, data)
    trees = renderer.scene.triangles()
    EDITS[name](model)
    after = picture(renderer, data)
    assert (after != before).any(axis=-1).sum() > 20
    np.testing.assert_array_equal(after, fresh(model, data))
    assert renderer.scene.triangles() is trees, "no tree is built again"


def test_edits_together_with_shapes_and_visibility():
    model, data, renderer = ready()
    picture(renderer, data)
    model.geom("ball").size[0] = 0.35
    model.geom("box").rgba[:] = 0.1, 0.2, 0.9, 1
    model.geom("floor").rgba[3] = 0.0
    mujoco.mj_forward(model, data)
    expected = fresh(model, data)
    assert (picture(renderer, data) == expected).all(axis=-1).mean() > 0.995  # the ball is now made of triangles
    model.geom("floor").rgba[3] = 1.0
    model.geom("ball").rgba[:3] = 0.9, 0.1, 0.1
    assert (picture(renderer, data) == fresh(model, data)).all(axis=-1).mean() > 0.995


def test_colors_show_the_last_update_in_every_mode():
    model, data, renderer = ready()
    renderer.enable_depth_rendering()
    model.geom("ball").rgba[:3] = 0.9, 0.1, 0.1
    data.qpos[0] = 0.3
    mujoco.mj_forward(model, data)
    renderer.update_scene(data, "eye")
    depth, expected = renderer.render(), fresh(model, data)
    renderer.disable_depth_rendering()
    data.qpos[0] = 0.0
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(renderer.render(), expected)
    renderer.enable_depth_rendering()
    np.testing.assert_array_equal(renderer.render(), depth)


def test_flags_of_the_scene():
    model, data, renderer = ready()
    pictures = {"default": picture(renderer, data)}
    for name in ("SHADOW", "SKYBOX", "REFLECTION"):
        renderer.scene.flags[int(getattr(RND, f"mjRND_{name}"))] = 0
        pictures[name] = renderer.render()
        renderer.scene.flags[int(getattr(RND, f"mjRND_{name}"))] = 1
    np.testing.assert_array_equal(renderer.render(), pictures["default"])
    model.light_castshadow[:] = 0
    np.testing.assert_array_equal(pictures["SHADOW"], fresh(model, data))
    assert (pictures["SHADOW"] != pictures["default"]).any()
    ids = BatchRenderer(model, height=HEIGHT, width=WIDTH, outputs=("segmentation",)).render(data, cameras="eye")
    sky = ids.segmentation.numpy()[0] < 0
    assert sky.any() and (pictures["SKYBOX"][sky] == 0).all() and pictures["default"][sky].max() > 40
    np.testing.assert_array_equal(pictures["SKYBOX"][~sky], pictures["default"][~sky])
    np.testing.assert_array_equal(pictures["REFLECTION"], pictures["default"])


def test_flags_without_an_effect_are_named_once():
    _, data, renderer = ready()
    before = picture(renderer, data)
    renderer.scene.flags[RND.mjRND_ADDITIVE] = renderer.scene.flags[RND.mjRND_FOG] = 1
    with pytest.warns(UserWarning, match="mjRND_ADDITIVE, mjRND_FOG have no effect"):
        np.testing.assert_array_equal(renderer.render(), before)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        renderer.render()


def test_lights_of_the_scene_can_be_replaced_until_the_next_update():
    _, data, renderer = ready()
    before = picture(renderer, data)
    renderer.scene.lights = Light("ambient", ambient=(0.5, 0.5, 0.5))
    renderer.scene.background = None
    changed = renderer.render()
    assert (changed != before).any(axis=-1).mean() > 0.5
    np.testing.assert_array_equal(picture(renderer, data), before)


def test_textures_can_be_disabled():
    model, data, renderer = ready()
    before = picture(renderer, data)
    option = mujoco.MjvOption()
    option.flags[VIS.mjVIS_TEXTURE] = 0
    plain = picture(renderer, data, option)
    np.testing.assert_array_equal(plain, fresh(model, data, option))
    assert (plain != before).any(axis=-1).mean() > 0.2
    assert renderer.scene["floor"].appearance.materials[0].texture is None
    np.testing.assert_array_equal(picture(renderer, data), before)


def test_moving_bodies_can_be_transparent():
    model, data, renderer = ready()
    option = mujoco.MjvOption()
    option.flags[VIS.mjVIS_TRANSPARENT] = 1
    for shown, expected in ((option, model.vis.map.alpha), (None, 1.0)):
        picture(renderer, data, shown)
        assert renderer.scene["box"].appearance.materials[0].base_color[3] == pytest.approx(expected)
        assert renderer.scene["ball"].appearance.materials[0].base_color[3] == 1
    model.geom("box").rgba[:] = 0.2, 0.3, 0.9, 0.5
    picture(renderer, data, option)
    assert renderer.scene["box"].appearance.materials[0].base_color[3] == pytest.approx(0.5 * model.vis.map.alpha)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda item: pickle.loads(pickle.dumps(item))])
def test_copies_render_the_same_colors(copied):
    _, data, renderer = ready(SOFT)
    expected = picture(renderer, data)
    again = copied(renderer)
    np.testing.assert_array_equal(again.render(), expected)
    again.model.geom("box").rgba[:] = 0, 0, 1, 1
    other = mujoco.MjData(again.model)
    mujoco.mj_forward(again.model, other)
    assert (picture(again, other) != expected).any()
    np.testing.assert_array_equal(picture(renderer, data), expected)


def skin_of_tube(around=24, along=20):
    """Return the vertices and faces of a tube, fine enough for light that is interpolated between vertices."""
    x, angle = np.meshgrid(np.linspace(-0.7, 0.0, along), np.arange(around) * 2 * np.pi / around, indexing="ij")
    vertices = np.stack([x, 0.15 * np.cos(angle) - 0.5, 0.15 * np.sin(angle) + 0.4], axis=-1).reshape(-1, 3)
    first = np.arange(along * around).reshape(along, around)
    beside = np.roll(first, -1, axis=1)
    a, b, c, d = first[:-1].ravel(), first[1:].ravel(), beside[1:].ravel(), beside[:-1].ravel()
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([a, d, c], axis=1)])
    return " ".join(f"{v:.4f}" for v in vertices.ravel()), " ".join(map(str, faces.ravel()))


def ids(first, last):
    return " ".join(map(str, range(first, last)))


SOFT = f"""<mujoco><statistic extent="2" meansize=".2"/><visual><map znear=".005"/>
  <quality offsamples="0" numslices="64" numstacks="32"/>
  <headlight ambient=".3 .3 .3" diffuse=".6 .6 .6" specular=".2 .2 .2"/></visual>
  <asset><texture name="check" type="2d" builtin="checker" rgb1=".9 .8 .1" rgb2=".1 .2 .8" width="64" height="64"/>
    <material name="cloth" texture="check" texrepeat="3 3"/></asset>
  <worldbody><geom name="floor" type="plane" size="1.2 1.2 .1" rgba=".5 .6 .7 1"/>
    <geom name="box" type="box" size=".1 .1 .1" pos=".7 .5 .1" rgba=".9 .2 .1 1"/>
    <site name="a" pos="-.9 0 .6"/><site name="b" pos=".9 0 .7"/>
    <body name="weight" pos="0 0 .4"><joint type="slide" axis="0 0 1"/><geom size=".06" rgba=".2 .8 .3 1"/>
      <site name="load"/></body>
    <body name="upper" pos="-.6 -.5 .4"><joint type="hinge" axis="0 1 0"/><geom size=".02"/></body>
    <body name="lower" pos="0 -.5 .4"><geom size=".02"/></body>
    <flexcomp name="cloth" type="grid" dim="2" count="5 5 1" spacing=".12 .12 .1" pos=".5 -.4 .4" radius=".005" mass="1"
      material="cloth"><edge equality="true"/></flexcomp>{EYE}</worldbody>
  <tendon><spatial name="rope" width=".07" rgba=".9 .5 .1 1"><site site="a"/><site site="load"/><site site="b"/>
  </spatial></tendon>
  <deformable><skin name="sleeve" rgba=".8 .3 .6 1" vertex="{skin_of_tube()[0]}" face="{skin_of_tube()[1]}">
     <bone body="upper" bindpos="-.6 -.5 .4" bindquat="1 0 0 0" vertid="{ids(0, 240)}" vertweight="{"1 " * 240}"/>
     <bone body="lower" bindpos="0 -.5 .4" bindquat="1 0 0 0" vertid="{ids(240, 480)}" vertweight="{"1 " * 240}"/>
  </skin></deformable></mujoco>"""


@pytest.mark.gl
@pytest.mark.parametrize("moved", [False, True])
def test_skins_tendons_and_flexes_have_mujocos_colors(moved):
    model, data, renderer = ready(SOFT)
    if moved:
        picture(renderer, data)
        data.qpos[:2] = -0.15, 0.4
        mujoco.mj_forward(model, data)
    option = mujoco.MjvOption()
    option.flags[VIS.mjVIS_INERTIA] = 1
    with mujoco.Renderer(model, HEIGHT, WIDTH) as theirs:
        for each in (renderer, theirs):
            each.update_scene(data, "eye", option if moved else None)
            each.scene.flags[RND.mjRND_SHADOW] = each.scene.flags[RND.mjRND_REFLECTION] = 0
        ours, expected = renderer.render().astype(int), theirs.render().astype(int)
        theirs.enable_segmentation_rendering()
        ids = theirs.render()
        theirs.disable_segmentation_rendering()
        theirs.enable_depth_rendering()
        inside = away_from_silhouettes(theirs.render(), reach=1)
    renderer.enable_segmentation_rendering()
    same = (renderer.render() == ids).all(axis=-1) & inside
    for kind in ("SKIN", "TENDON", "FLEX", "GEOM"):
        seen = same & (ids[..., 1] == int(getattr(mujoco.mjtObj, f"mjOBJ_{kind}")))
        error = np.abs(ours - expected)[seen]
        assert seen.sum() >= (3 if kind == "TENDON" else 20), kind
        assert error.mean() < (12 if kind == "TENDON" else 3), (kind, error.mean())


def test_colors_of_visual_elements_change():
    model, data, renderer = ready(SOFT)
    before = picture(renderer, data)
    for name in ("skin_rgba", "tendon_rgba"):
        getattr(model, name)[0] = 0.1, 0.3, 0.9, 1
    after = picture(renderer, data)
    np.testing.assert_array_equal(after, fresh(model, data))
    assert (after != before).any(axis=-1).sum() > 50


def test_columns_of_tables_stay_while_elements_move():
    _, data, renderer = ready(SOFT)
    picture(renderer, data)
    model, scene = renderer.model, renderer.scene
    planes = scene.device_materials(None).planes.ptr
    for height in (0.05, 0.1):
        data.qpos[0] = height
        mujoco.mj_forward(model, data)
        image = picture(renderer, data)
        renderer.enable_depth_rendering()
        renderer.update_scene(data, "eye")
        renderer.disable_depth_rendering()
        np.testing.assert_array_equal(renderer.render(), image)
    assert scene.device_materials(None).planes.ptr == planes


@pytest.mark.gl
def test_pictures_match_mujoco_away_from_silhouettes():
    """Without the spotlight, which MuJoCo interpolates between vertices."""
    model, data, renderer = ready()
    model.light_active[1] = 0
    with mujoco.Renderer(model, HEIGHT, WIDTH) as theirs:
        for each in (renderer, theirs):
            each.update_scene(data, "eye")
            each.scene.flags[RND.mjRND_SHADOW] = each.scene.flags[RND.mjRND_REFLECTION] = 0
        ours, expected = renderer.render().astype(int), theirs.render().astype(int)
        theirs.enable_depth_rendering()
        inside = away_from_silhouettes(theirs.render())
    error = np.abs(ours - expected)[inside]
    assert error.mean() < 3 and inside.mean() > 0.2


def test_models_without_surfaces_are_black():
    _, data, renderer = ready(f"<mujoco><worldbody>{EYE}</worldbody></mujoco>")
    assert not picture(renderer, data).any()
