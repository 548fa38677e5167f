# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Model changes between calls of `update_scene` appear in images as in MuJoCo."""

import mujoco
import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.mujoco import Renderer

from support.mujoco_following import task
from support.mujoco_renderer import assert_same_images, images


def geom(name, field, value):
    def change(model):
        getattr(model.geom(name), field)[:] = value

    return change


def body(name, field, value):
    def change(model):
        getattr(model.body(name), field)[:] = value

    return change


def hide_material(model):
    model.mat_rgba[:, 3] = 0


def swap_mesh(model):
    model.geom("lid").dataid = model.mesh("tetra").id


def raise_hills(model):
    model.hfield_data[:] = np.random.default_rng(5).random(len(model.hfield_data)) ** 3


def stretch_meshes(model):
    model.mesh_vert[:] *= 1.5


def lower_hills(model):
    model.hfield_size[0, 2] = 0.05


def widen(model):
    model.cam_fovy[model.camera("front").id] = 70


CHANGES = {
    "fixed body moved": body("drawer", "pos", (-0.2, 0.3, 0.35)),
    "fixed body turned": body("drawer", "quat", (0.8, 0, 0.36, 0.48)),
    "body in a fixed body": body("lid", "pos", (0.1, 0, 0.2)),
    "geom of a fixed body": geom("handle", "pos", (0.1, -0.2, 0.05)),
    "geom of the world": geom("table", "pos", (0.1, 0.04, 0.27)),
    "geom of the world turned": geom("pole", "quat", (0.96, 0.28, 0, 0)),
    "geom of a moving body": geom("finger", "pos", (0.1, 0, 0.05)),
    "first geom of a moving body": geom("palm", "quat", (0.8, 0.48, 0, 0.36)),
    "size of a fixed box": geom("case", "size", (0.1, 0.2, 0.1)),
    "size of a moving box": geom("finger", "size", (0.05, 0.02, 0.1)),
    "size of the first box of a moving body": geom("palm", "size", (0.1, 0.05, 0.05)),
    "size of a sphere": geom("knob", "size", (0.06, 0, 0)),
    "size of a cylinder": geom("pole", "size", (0.06, 0.2, 0)),
    "hidden": geom("case", "rgba", (1, 0, 0, 0)),
    "hidden and moving": geom("palm", "rgba", (1, 0, 0, 0)),
    "hidden with its material": hide_material,
    "another group": geom("table", "group", 4),
    "a group that shows": geom("spare", "group", 0),
    "another mesh": swap_mesh,
    "another shape": geom("case", "type", int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)),
    "lower field": lower_hills,
    "field of view": widen,
}
# Changes that MuJoCo's renderer shows only after an upload.
UPLOADED = {"heights": raise_hills, "vertices": stretch_meshes}


def shown(renderer, model, data, camera="front"):
    mujoco.mj_forward(model, data)
    return images(renderer, data, camera)


def assert_as_new(renderer, model, data, camera="front"):
    """Compare the renderer's images with those of a new renderer of the changed model."""
    ours, new = shown(renderer, model, data, camera), shown(Renderer(model, 90, 120), model, data, camera)
    assert (ours[1] == new[1]).all(axis=-1).mean() > 0.999  # static triangles are intersected in another frame
    same = (ours[1] == new[1]).all(axis=-1)
    assert np.abs(ours[0] - new[0])[same].max() < 1e-4
    return ours


@pytest.mark.smoke(
    "*-fixed body moved",
    "*-geom of a moving body",
    "*-another mesh",
    "*-another shape",
    "*-field of view",
    "*-hidden",
    "*-size of a *",
)
@pytest.mark.gl
@pytest.mark.parametrize("name", CHANGES)
def test_changed_model_matches_mujoco(name, device):
    model, data = task()
    renderer = Renderer(model, 150, 200, mesh_tolerance=2e-4, device=device)
    before = shown(renderer, model, data)
    CHANGES[name](model)
    ours = shown(renderer, model, data)
    assert (ours[0] != before[0]).mean() > 1e-3  # the change is visible
    with mujoco.Renderer(model, 150, 200) as theirs:
        assert_same_images(ours, images(theirs, data, "front"), 2e-4)


@pytest.mark.smoke("*-another shape", "*-vertices", "*-hidden", "*-field of view", "*-size of a *")
@pytest.mark.parametrize("name", CHANGES | UPLOADED)
def test_changed_model_matches_new_renderer(name, device):
    model, data = task()
    renderer = Renderer(model, 90, 120, device=device)
    before = shown(renderer, model, data)
    (CHANGES | UPLOADED)[name](model)
    after = assert_as_new(renderer, model, data)
    assert (after[0] != before[0]).any()


@pytest.mark.slow
def test_repeated_changes_match_new_renderer(device):
    """Apply all changes in random order, seen from a moving camera."""
    model, data = task()
    renderer, rng = Renderer(model, 90, 120, device=device), np.random.default_rng(3)
    changes = list((CHANGES | UPLOADED).values())
    for step in rng.permutation(len(changes)).tolist() * 2:
        data.qpos[:3] = rng.uniform((-0.3, -0.3, 0.5), (0.3, 0.1, 0.8))
        changes[step](model)
        model.body("drawer").pos[:] = rng.uniform((-0.3, -0.2, 0.3), (0.3, 0.2, 0.5))
        model.geom("finger").size[:] = rng.uniform(0.02, 0.1, 3)
        model.geom("knob").size[0] = rng.uniform(0.02, 0.1)
        model.hfield_data[:] = rng.random(len(model.hfield_data))
        assert_as_new(renderer, model, data, "front" if step % 2 else "wrist")


def test_hidden_geoms_reappear():
    model, data = task()
    renderer = Renderer(model, 90, 120)
    before = shown(renderer, model, data)
    for name in ("case", "palm", "knob"):
        model.geom(name).rgba[3] = 0
    hidden = shown(renderer, model, data)
    assert not np.isin(hidden[1][..., 0], [model.geom(name).id for name in ("case", "palm", "knob")]).any()
    model.geom("case").size[:] *= 2  # while hidden
    model.mesh_vert[:] *= 1.2
    shown(renderer, model, data)
    model.geom("case").size[:] /= 2
    model.mesh_vert[:] /= 1.2
    for name in ("case", "palm", "knob"):
        model.geom(name).rgba[3] = 1
    after = shown(renderer, model, data)
    assert (after[1] == before[1]).all(axis=-1).mean() > 0.999
    model.geom("case").rgba[3] = 0
    shown(renderer, model, data)
    model.geom("case").size[:] *= 2
    model.geom("case").rgba[3] = 1
    assert_as_new(renderer, model, data)


def test_repeated_moves_rebuild_nothing():
    model, data = task()
    renderer = Renderer(model, 90, 120)
    shown(renderer, model, data)
    model.body("drawer").pos[:] = 0.1, 0.1, 0.4
    model.geom("table").size[:] *= 1.1
    model.hfield_data[:] *= 0.5
    first = shown(renderer, model, data)
    trees = renderer.scene.bvh()
    model.body("drawer").pos[:] = -0.1, 0.1, 0.4
    model.geom("table").size[:] *= 1.1
    model.hfield_data[:] *= 0.5
    second = assert_as_new(renderer, model, data)
    assert renderer.scene.bvh() is trees
    assert not np.array_equal(first[0], second[0])
    # Geoms of a moved body continue to share a pose.
    case, handle = (renderer.scene[name] for name in ("case", "handle"))
    assert handle.parent is not None and renderer.scene.objects[handle.parent] is case


def test_only_changed_trees_are_rebuilt(monkeypatch):
    from warpvis.scene.acceleration import tree_cache

    model, data = task()
    renderer = Renderer(model, 90, 120)
    shown(renderer, model, data)
    model.geom("knob").size[0] = 0.04
    shown(renderer, model, data)
    built = []
    build = tree_cache.build_bvh
    monkeypatch.setattr(tree_cache, "build_bvh", lambda *a, **k: built.append(len(a[1])) or build(*a, **k))
    model.geom("knob").size[0] = 0.05
    assert_as_new(renderer, model, data)
    ball = len(renderer.scene["knob"].faces)
    assert built[0] == ball  # the other builds belong to the new renderer
    assert built.count(ball) == 2


def test_unchanged_model_keeps_its_scene():
    model, data = task()
    renderer = Renderer(model, 90, 120)
    shown(renderer, model, data)
    trees, objects = renderer.scene.bvh(), renderer.scene.objects
    data.qpos[:3] += 0.1
    shown(renderer, model, data)
    assert renderer.scene.bvh() is trees and renderer.scene.objects == objects
    assert not renderer.scene["table"].movable and not renderer.scene["handle"].movable


def test_added_objects_survive_model_changes(device):
    """Static, movable and attached objects, added between geoms that change."""
    model, data = task()
    renderer = Renderer(model, 90, 120, device=device)
    box = trimesh.creation.box((0.08, 0.08, 0.08))
    mujoco.mj_forward(model, data)
    renderer.update_scene(data, "front")
    scene = renderer.scene
    scene.add(box, name="still", pose=(-0.3, -0.3, 0.6, 0, 0, 0, 1))
    scene.add(box, name="loose", pose=(0.3, -0.3, 0.6, 0, 0, 0, 1), movable=True)
    scene.add(box, name="worn", pose=(0, -0.2, 0.75, 0, 0, 0, 1), attach_to="palm")
    for name, change in CHANGES.items():
        change(model)
        data.qpos[0] += 0.01
        mujoco.mj_forward(model, data)
        renderer.update_scene(data, "front")
        assert renderer.scene is scene
        views = wv.render(
            scene,
            wv.Camera.from_fov(160, 120, hfov=1.0),
            front_pose(model, data),
            object_poses=renderer._stage.object_poses(),
            convention="opengl",
        )
        seen = views.segmentation.numpy()
        for item in ("still", "loose", "worn"):
            assert (seen == scene.index(item)).sum() > 20, (name, item)


def test_uncomputed_data_is_rejected():
    model, data = task()
    renderer = Renderer(model, 90, 120)
    with pytest.raises(wv.WarpvisError, match=r"poses must be computed, .*; call mujoco.mj_forward\(model, data\)"):
        renderer.update_scene(data, "front")
    assert_as_new(renderer, model, data)


def test_name_conflict_with_visible_geom_is_rejected():
    model, data = task()
    renderer = Renderer(model, 90, 120)
    shown(renderer, model, data)
    renderer.scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="spare")
    model.geom("spare").group = 0
    with pytest.raises(wv.WarpvisError, match="must not have names of visible geoms, got 'spare'"):
        renderer.update_scene(data, "front")
    model.geom("spare").group = 4
    shown(renderer, model, data)


def front_pose(model, data):
    camera = model.camera("front").id
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = data.cam_xmat[camera].reshape(3, 3), data.cam_xpos[camera]
    return pose
