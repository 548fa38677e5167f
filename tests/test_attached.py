# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Attached objects share a pose, but are rendered, named and excluded individually."""

import numpy as np
import pytest
import trimesh
from pose_samples import unit

import warpvis as wv

from compare import assert_matches_reference
from support.attached import build
from support.worlds import ALL, SMALL, assert_bits_equal, eyes, random_poses, view_of

NAMES = "'floor', 'table', 'lamp', 'tray', 'ball', 'egg', 'rag'"


def render(scene, cameras, caster, **options):
    return wv.render(scene, SMALL, cameras, outputs=ALL, caster=caster, **options)


def test_attached_object_has_no_pose():
    scene = build("cpu", *random_poses(np.random.default_rng(0), 2))
    assert scene.movable == (1, 4)
    lamp = scene["lamp"]
    assert lamp.movable and lamp.pose is None and lamp.parent == 1
    twin = build("cpu", *random_poses(np.random.default_rng(0), 2), attached=False)["lamp"]
    np.testing.assert_allclose(lamp.vertices, twin.vertices, atol=1e-6)


@pytest.mark.smoke("*-packets-False")
@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_attached_objects_move_with_their_parent(device, caster, cull_backfaces):
    rng = np.random.default_rng(1)
    first, poses, cameras = random_poses(rng, 2), random_poses(rng, 3, 2), eyes(5)
    world = np.array([1, 0, 2, 2, 0])
    scene = build(device, *first)
    renderer = wv.Renderer(scene, SMALL, outputs=ALL, caster=caster, cull_backfaces=cull_backfaces)
    views = renderer.render(cameras, object_poses=poses, world_index=world)
    for view in range(len(cameras)):
        twin = build(device, *poses[world[view]], attached=False)
        one = slice(view, view + 1)
        assert_matches_reference(view_of(views, view), twin, SMALL, cameras[one], cull_backfaces=cull_backfaces)


def test_camera_between_attached_objects(device, caster):
    table = unit([0, 0, 1, 0, 0, 0.3, 0.9])
    scene, twin = (build(device, table, (0, 3, 1, 0, 0, 0, 1), attached=flag) for flag in (True, False))
    cameras = np.array([wv.look_at((0.05, 0.02, 1.1), (0.3, 0.4, 1.2)), wv.look_at((-0.1, 0, 1.15), (-0.2, 0.1, 1.2))])
    assert_matches_reference(render(scene, cameras, caster), twin, SMALL, cameras)


@pytest.mark.parametrize("gone", ["table", "lamp", "ball"])
def test_attached_objects_are_excluded_individually(device, caster, gone):
    rng = np.random.default_rng(2)
    poses, cameras = random_poses(rng, 2), eyes(4)
    scene = build(device, *poses)
    hidden = np.zeros((4, len(scene)), dtype=np.uint8)
    hidden[:2, scene.index(gone)] = 1
    views = render(scene, cameras, caster, exclude=hidden)
    everything = render(scene, cameras, caster)
    assert (views.segmentation.numpy()[:2] != scene.index(gone)).all()
    twin = build(device, *poses, attached=False)
    without = render(twin, cameras, caster, exclude=hidden)
    same = np.isclose(views.depth.numpy(), without.depth.numpy(), rtol=0, atol=1e-4) | (
        views.depth.numpy() == without.depth.numpy()
    )
    assert same.mean() > 0.999
    assert (views.segmentation.numpy() == without.segmentation.numpy()).mean() > 0.999
    assert_bits_equal(*(wv.Views(**{n: getattr(v, n)[2:] for n in ALL}) for v in (views, everything)))


def test_other_devices_and_files_keep_attached_objects(tmp_path):
    scene = build("cpu", *random_poses(np.random.default_rng(3), 2))
    assert scene.to("cpu")["tray"].parent == 1
    scene.export(tmp_path / "scene.glb")
    assert len(wv.Scene.load(tmp_path / "scene.glb")) == len(scene)


@pytest.mark.parametrize(
    ("name", "attach_to", "said"),
    [
        ("a box", "floor", "'a box' cannot be attached to 'floor', which is static; add it with movable=True"),
        ("a box", "lamp", "'a box' cannot be attached to 'lamp', which is itself attached to another object"),
        ("a box", "chair", "the scene has no object 'chair'; it has " + NAMES),
        (
            "a box",
            "egg",
            "'a box' cannot be attached to 'egg': 'egg' is a solid, and only rigid meshes can be attached",
        ),
        (
            "a solid",
            "table",
            "'a solid' cannot be attached to 'table': 'a solid' is a solid, and only rigid meshes can be attached",
        ),
        (
            "a box",
            "rag",
            "'a box' cannot be attached to 'rag': 'rag' is deforming, and only rigid meshes can be attached",
        ),
    ],
)
def test_invalid_attachment_raises(name, attach_to, said):
    scene = build("cpu", *random_poses(np.random.default_rng(4), 2))
    scene.add(wv.scene.solids.sphere(0.1), name="egg", movable=True)
    scene.add(trimesh.creation.box((1, 1, 1)), name="rag", movable=True)
    scene.update_vertices("rag", scene["rag"].mesh_vertices)
    mesh = wv.scene.solids.sphere(0.2) if name == "a solid" else trimesh.creation.box((1, 1, 1))
    with pytest.raises(wv.errors.SceneError) as error:
        scene.add(mesh, name=name, attach_to=attach_to)
    assert str(error.value) == said
    assert name not in scene


@pytest.mark.parametrize(("name", "others"), [("table", "'lamp', 'tray'"), ("lamp", "'table'")])
def test_attached_objects_and_parents_cannot_deform(name, others):
    scene = build("cpu", *random_poses(np.random.default_rng(5), 2))
    with pytest.raises(wv.errors.SceneError) as error:
        scene.update_vertices(name, scene[name].mesh_vertices)
    said = f"object {name!r} is rigidly attached to {others}, so its vertices cannot be updated; do not attach them"
    assert str(error.value) == said
