# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compatibility with `mujoco.Renderer`: flags and cameras of the scene, colors, options, and copies."""

import copy
import pickle
import warnings

import mujoco
import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import mujoco as ours
from warpvis.mujoco import Renderer

from support.mujoco_drop_in import HEIGHT, WIDTH
from support.mujoco_following import task
from support.mujoco_renderer import assert_same_images, images


def ready(camera="front", **options):
    model, data = task()
    mujoco.mj_forward(model, data)
    renderer = Renderer(model, HEIGHT, WIDTH, **options)
    renderer.enable_depth_rendering()
    renderer.update_scene(data, camera)
    return renderer, model, data


def test_flags_match_mujoco():
    renderer, model, data = ready()
    flags = renderer.scene.flags
    assert np.array_equal(flags, mujoco.MjvScene(model, 1).flags)
    before = renderer.render()
    flags[mujoco.mjtRndFlag.mjRND_SHADOW] = flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
    assert np.array_equal(renderer.render(), before)
    assert not renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW]
    option = mujoco.MjvOption()
    option.geomgroup[4] = 1
    renderer.update_scene(data, "front", option)  # the scene is replaced, with the same flags
    assert not renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW]


@pytest.mark.gl
def test_back_face_culling_flag_matches_mujoco():
    model, data = task()
    model.body("hand").pos[:] = 0, 0, 0
    data.qpos[:3] = 0, -1.62, 1.31  # the camera is inside the palm
    mujoco.mj_forward(model, data)
    expected = []
    with mujoco.Renderer(model, HEIGHT, WIDTH) as theirs:
        renderer = Renderer(model, HEIGHT, WIDTH)
        for flag in (True, False, True):
            for each in (renderer, theirs):
                each.scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = flag
            expected.append(images(theirs, data, "front"))
            assert_same_images(images(renderer, data, "front"), expected[-1], 1e-3)
    assert not np.array_equal(expected[0][0], expected[1][0])


def test_wireframe_flag_warns_once():
    renderer, _, _ = ready()
    before = renderer.render()
    renderer.scene.flags[mujoco.mjtRndFlag.mjRND_WIREFRAME] = True
    with pytest.warns(UserWarning, match="mjRND_WIREFRAME has no effect: surfaces are rendered"):
        assert np.array_equal(renderer.render(), before)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        renderer.render()


@pytest.mark.gl
def test_scene_cameras_match_mujoco():
    """MuJoCo's scene has two eyes; both of ours are at their center."""
    model, data = task()
    mujoco.mj_forward(model, data)
    renderer = Renderer(model, HEIGHT, WIDTH)
    with mujoco.Renderer(model, HEIGHT, WIDTH) as theirs:
        for name in ("front", "wrist", -1):
            for each in (renderer, theirs):
                each.update_scene(data, name)
            middle, expected = (mujoco.mjv_averageCamera(*each.scene.camera) for each in (renderer, theirs))
            for field in ("pos", "forward", "up"):
                assert getattr(middle, field) == pytest.approx(getattr(expected, field), abs=1e-6)
            for side in ("bottom", "top", "center", "width", "near", "far"):
                side = f"frustum_{side}"
                assert getattr(middle, side) == pytest.approx(getattr(expected, side), rel=1e-6)


@pytest.mark.gl
def test_edits_of_scene_cameras_are_rendered():
    model, data = task()
    mujoco.mj_forward(model, data)
    renderer = Renderer(model, HEIGHT, WIDTH)
    with mujoco.Renderer(model, HEIGHT, WIDTH) as theirs:
        pairs = []
        for each in (renderer, theirs):
            each.update_scene(data, "front")
            for camera in each.scene.camera:
                camera.pos[:] += (0.2, 0.1, 0.1)
                camera.frustum_top *= 1.3
                camera.frustum_center = 0.002
                camera.frustum_width = 0.012
            each.enable_depth_rendering()
            depth = each.render()
            each.disable_depth_rendering()
            each.enable_segmentation_rendering()
            pairs.append((depth, each.render()))
        assert_same_images(*pairs, 1e-3)
    renderer.update_scene(data, "front")  # edits end with the next update
    assert not np.array_equal(renderer.render(), pairs[0][1])


@pytest.mark.parametrize("name", ["geoms", "ngeom", "maxgeom"])
def test_missing_scene_attributes_raise(name):
    renderer, _, _ = ready()
    with pytest.raises(wv.WarpvisError, match=f"renderer.scene is a warpvis.Scene and has no {name}; add shapes to it"):
        getattr(renderer.scene, name)
    assert not hasattr(renderer.scene, name)


def test_options_without_effect_on_depth_do_not_warn():
    renderer, _, data = ready()
    before = renderer.render()
    option = mujoco.MjvOption()
    for flag in ("TRANSPARENT", "TEXTURE", "ISLAND", "ACTIVATION"):
        option.flags[int(getattr(mujoco.mjtVisFlag, f"mjVIS_{flag}"))] ^= 1
    option.label = mujoco.mjtLabel.mjLABEL_GEOM
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        renderer.update_scene(data, "front", option)
    assert np.array_equal(renderer.render(), before)


def mujoco_copy(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def test_closed_renderer_rejects_updates():
    renderer, _, data = ready()
    renderer.close()
    with pytest.raises(wv.WarpvisError, match="update_scene cannot be called after close"):
        renderer.update_scene(data)


def used_renderer():
    renderer, model, data = ready()
    renderer.scene.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="mine", pose=(-0.4, -0.4, 0.5, 0, 0, 0, 1))
    renderer.scene.add(
        trimesh.creation.box((0.1, 0.1, 0.1)), name="worn", pose=(0, -0.2, 0.8, 0, 0, 0, 1), attach_to="palm"
    )
    renderer.scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = False
    model.body("drawer").pos[0] -= 0.3
    model.geom("palm").rgba[3] = 0
    mujoco.mj_forward(model, data)
    renderer.update_scene(data, "front")
    return renderer


BATCH = ours.BatchRenderer(task()[0], height=HEIGHT, width=WIDTH, outputs=("depth", "points", "segmentation"))
QPOS = np.stack([task()[1].qpos] * 2)
VIEWS = BATCH.render(QPOS)


def geoms_of(scene):
    data = mujoco_copy(task()[0])
    return ours.geom_poses(data, scene)


RANGED = """
<mujoco>
  <worldbody>
    <geom type="plane" size="2 2 .1"/>
    <body pos="0 0 1"><joint type="slide" axis="0 0 1"/><geom size=".1"/><site name="down" zaxis="0 .2 -1"/></body>
  </worldbody>
  <sensor><rangefinder site="down"/></sensor>
</mujoco>
"""


# An object of each public class, and a function whose arrays must be equal for a copy.
OBJECTS = {
    "BatchRenderer": (BATCH, lambda batch: batch.render(QPOS).depth.numpy()),
    "BatchViews": (VIEWS, lambda views: views.by_world().points.numpy()),
    "Kinematics": (BATCH.kinematics, lambda kinematics: kinematics.from_qpos(QPOS).geom_xpos),
    "MujocoScene": (ours.scene_from_mujoco(task()[0]), geoms_of),
    "Rangefinders": (
        ours.Rangefinders(mujoco.MjModel.from_xml_string(RANGED)),
        lambda sensors: sensors.read(np.array([[0.0], [0.5]])).numpy(),
    ),
    "Renderer": (used_renderer(), lambda renderer: renderer.render()),
    "VisibilityChecker": (
        ours.VisibilityChecker(task()[0], mujoco_copy(task()[0]), width=32, height=24),
        lambda checker: np.array([checker.check_visibility(0, 1)]),
    ),
    "WorldPoses": (BATCH.kinematics.from_qpos(QPOS), lambda poses: BATCH.render(poses).depth.numpy()),
}


def test_all_public_classes_are_covered():
    classes = {name for name in ours.__all__ if isinstance(getattr(ours, name), type)}
    assert classes == {*OBJECTS, "BodyVisibility"}  # a result on a device, which is not copied


@pytest.mark.parametrize(
    "copied", [copy.deepcopy, lambda item: pickle.loads(pickle.dumps(item))], ids=["copy", "pickle"]
)
@pytest.mark.parametrize("name", OBJECTS)
def test_copies_behave_alike(name, copied):
    item, use = OBJECTS[name]
    expected = use(item)
    again = copied(item)
    assert type(again) is type(item) and again is not item
    # Geoms moved by a renderer are static again in its copy, and intersected in another frame.
    assert np.isclose(use(again), expected, atol=1e-5, equal_nan=True).mean() > 0.999 and np.isfinite(expected).any()
    assert np.array_equal(use(item), expected, equal_nan=True)


def test_copied_renderer_is_independent():
    renderer = used_renderer()
    before, again = renderer.render(), copy.deepcopy(renderer)
    assert {item.name for item in again.scene} == {item.name for item in renderer.scene}
    assert again.scene.objects[again.scene["worn"].parent].name == "palm"
    assert not again.scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE]
    again.model.body("drawer").pos[0] += 0.3
    again.update_scene(mujoco_copy(again.model), "front")
    assert not np.array_equal(again.render(), before) and np.array_equal(renderer.render(), before)
    # A pickled scene alone has no flags.
    assert type(pickle.loads(pickle.dumps(renderer.scene))) is wv.Scene


def test_views_can_be_copied():
    views = wv.render(BATCH.scene, wv.Camera.from_fov(8, 6, hfov=1.0), (0, -2, 1, 0.7, 0, 0, 0.714))
    for again in (copy.deepcopy(views), pickle.loads(pickle.dumps(views))):
        assert type(again) is wv.Views and again.normals is None
        for name in ("depth", "points", "labels", "segmentation"):
            image = getattr(views, name)
            assert getattr(again, name).dtype == image.dtype and getattr(again, name).ptr != image.ptr
            assert np.array_equal(getattr(again, name).numpy(), image.numpy(), equal_nan=name == "points")
