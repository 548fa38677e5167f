# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes with many objects of one mesh: shared arrays, lazy objects, and cost per call."""

import gc
import pickle
import sys

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.scene import solids

from support.many_objects import calls_of

CAMERA = wv.Camera.from_fov(64, 48, hfov=1.0)
POSE = wv.look_at((0, -4, 2), (0, 0, 0)).astype(np.float32)[None]
HALF = np.sqrt(0.5)
MANY_OBJECTS = 256


def grid(count):
    """Return poses on a square grid, slightly rotated."""
    side = int(np.ceil(np.sqrt(count)))
    x, y = np.indices((side, side)).reshape(2, -1)[:, :count] - side / 2
    turned = np.tile([0, 0, HALF, HALF], (count, 1))
    return np.concatenate([np.stack([x, y, 0 * x], -1), turned], axis=1)


@pytest.mark.parametrize("kind", ["trimesh", "arrays"])
def test_objects_of_one_mesh_share_its_arrays(kind):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.3)
    mesh = ball if kind == "trimesh" else (np.array(ball.vertices), np.array(ball.faces))
    scene = wv.Scene()
    assert calls_of("check_mesh", lambda: [scene.add(mesh, pose=pose, movable=True) for pose in grid(20)]) == 1
    first = scene.objects[0]
    assert all(item.faces is first.faces and item.mesh_vertices is first.mesh_vertices for item in scene)
    scene.add(mesh)
    scene.add(mesh, attach_to="object_3")
    assert all(item.faces is first.faces for item in scene)


@pytest.mark.parametrize("kind", ["trimesh", "arrays", "views"])
def test_modified_meshes_are_not_shared(kind):
    """Meshes modified in place between two additions, and scaled meshes, are copies."""
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.3)
    mesh = ball if kind == "trimesh" else (np.array(ball.vertices), np.array(ball.faces))
    if kind == "views":
        mesh = (mesh[0][:], mesh[1][:])
    scene = wv.Scene()
    scene.add(mesh, movable=True)
    vertices = mesh.vertices if kind == "trimesh" else mesh[0]
    before = np.array(vertices)
    vertices[:] *= 2
    scene.add(mesh, movable=True)
    faces = mesh.faces if kind == "trimesh" else mesh[1]
    faces[0] = faces[0, [1, 0, 2]]
    scene.add(mesh, movable=True)
    scene.add(mesh, movable=True, scale=(1, 2, 3))
    one, two, three, four = scene.objects
    np.testing.assert_array_equal(one.mesh_vertices, before.astype(np.float32))
    np.testing.assert_array_equal(two.mesh_vertices, (2 * before).astype(np.float32))
    assert (three.faces[0] == two.faces[0, [1, 0, 2]]).all()
    np.testing.assert_array_equal(four.mesh_vertices, (2 * before * [1, 2, 3]).astype(np.float32))


def test_meshes_with_reused_ids_are_distinguished():
    """Python reuses the ids of freed arrays."""
    scene = wv.Scene()
    for size in range(1, 30):
        box = trimesh.creation.box((size, size, size))
        scene.add((np.array(box.vertices), np.array(box.faces)), movable=True)
    np.testing.assert_allclose([item.bounds[1, 0] for item in scene], np.arange(1, 30) / 2)


def test_world_vertices_are_computed_lazily():
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.3)
    scene = wv.Scene()
    scene.add(ball, pose=(1, 2, 3, 0, 0, HALF, HALF), movable=True, name="ball")
    assert "vertices" not in vars(scene["ball"])
    other = pickle.loads(pickle.dumps(scene))
    turned = np.stack([-ball.vertices[:, 1], ball.vertices[:, 0], ball.vertices[:, 2]], -1) + [1, 2, 3]
    for item in (scene["ball"], other["ball"]):
        np.testing.assert_allclose(item.vertices, turned, atol=1e-6)
        assert item.vertices is item.vertices
    with pytest.raises(AttributeError, match="no attribute 'vertex'"):
        _ = scene["ball"].vertex


@pytest.mark.parametrize("mesh", [trimesh.creation.icosphere(subdivisions=1), solids.sphere(0.5)])
def test_movable_objects_too_far_away_are_rejected(mesh):
    scene = wv.Scene()
    with pytest.raises(wv.errors.SceneError, match="within 1e18 m"):
        scene.add(mesh, pose=(1e19, 0, 0, 0, 0, 0, 1), movable=True)
    assert len(scene) == 0


@pytest.mark.parametrize("counts", [(30, MANY_OBJECTS - 1), (MANY_OBJECTS, 3 * MANY_OBJECTS)])
def test_cost_of_call_does_not_grow_with_objects(counts, device):
    """The number of executed Python lines does not grow with the number of objects.

    From `MANY_OBJECTS` on, a GPU culls objects before rendering: some 50 lines more, for any number of objects.
    """
    few, many = (lines_of_a_call(device, count) for count in counts)
    assert 0 < many < few + 30


def lines_of_a_call(device, count):
    """Return the number of lines of warpvis executed in a call, without those of garbage collection."""
    scene, ball = wv.Scene(device=device), trimesh.creation.icosphere(subdivisions=1, radius=0.3)
    for pose in grid(count):
        scene.add(ball, pose=pose, movable=True)
    renderer = wv.Renderer(scene, CAMERA, outputs=("depth",))
    views = renderer.render(POSE)
    lines = 0

    def look(frame, event, _):
        nonlocal lines
        ours = "warpvis" in frame.f_globals.get("__name__", "")
        lines += event == "line" and ours
        return look if ours else None

    sys.settrace(look)
    try:
        renderer.render(POSE, out=views)
    finally:
        sys.settrace(None)
    return lines


def test_object_poses_default_to_initial_poses(device):
    scene, ball = wv.Scene(device=device), trimesh.creation.icosphere(subdivisions=1, radius=0.3)
    rows = grid(50).astype(np.float32)
    for pose in rows:
        scene.add(ball, pose=pose, movable=True)
    told = wv.render(scene, CAMERA, POSE, object_poses=rows, outputs=("depth",)).depth.numpy()
    np.testing.assert_array_equal(wv.render(scene, CAMERA, POSE, outputs=("depth",)).depth.numpy(), told)
    scene.add(ball, pose=(0, -2, 1, 0, 0, 0, 1), movable=True)  # and objects added later
    assert (wv.render(scene, CAMERA, POSE, outputs=("depth",)).depth.numpy() < told).any()


def test_mesh_cache_releases_freed_arrays():
    scene = wv.Scene()
    for _ in range(5):
        box = trimesh.creation.box()
        scene.add(box, movable=True)
        scene.add((np.array(box.vertices), np.array(box.faces)), movable=True)
    gc.collect()  # trimesh's meshes are in reference cycles
    assert len(scene._meshes._known) == 1  # the mesh of the last box, which is alive


@pytest.mark.parametrize("mesh", [trimesh.creation.icosphere(subdivisions=1, radius=0.3), solids.sphere(0.3)])
def test_add_instances_matches_repeated_add(mesh, device):
    many, one_by_one = wv.Scene(device=device), wv.Scene(device=device)
    for scene in (many, one_by_one):
        scene.add(trimesh.creation.box((9, 9, 0.1)), name="floor")
    rows = grid(20)
    assert many.add_instances(mesh, rows, names="ball", label="object", scale=1.5) == range(1, 21)
    for number, row in enumerate(rows):
        one_by_one.add(mesh, pose=row, name=f"ball_{number}", label="object", scale=1.5, movable=True)
    assert [item.name for item in many] == [item.name for item in one_by_one]
    assert many.movable == one_by_one.movable == tuple(range(1, 21))
    outputs = ("depth", "labels", "segmentation")
    views, others = (wv.render(scene, CAMERA, POSE, outputs=outputs) for scene in (many, one_by_one))
    for name in outputs:
        np.testing.assert_array_equal(getattr(views, name).numpy(), getattr(others, name).numpy())
    assert many["ball_3"].faces is many["ball_4"].faces
    assert many.add_instances(mesh, np.zeros((0, 7))) == range(21, 21)
    assert many.add_instances(mesh, rows[:2, [0, 1, 2, 6, 3, 4, 5]], quaternion="wxyz") == range(21, 23)
    np.testing.assert_array_equal(many["object_22"].pose, many["ball_1"].pose)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["a", "b"], "names must be one for each of 3 poses, got 2"),
        (["a", "b", "a"], "names must be different, got 'a' 2 times"),
        (["a", "b", "floor"], "already has an object named 'floor'"),
        (7, "names must be a list, got 7"),
    ],
)
def test_invalid_instances_are_rejected(names, message):
    scene, box = wv.Scene(), trimesh.creation.box()
    scene.add(box, name="floor")
    with pytest.raises(wv.errors.SceneError, match=message):
        scene.add_instances(box, grid(3), names=names)
    with pytest.raises(wv.errors.PoseError, match="poses must be finite"):
        scene.add_instances(box, np.full((3, 7), np.nan))
    with pytest.raises(wv.errors.SceneError, match="within 1e18 m"):
        scene.add_instances(box, np.array([[0, 0, 1e19, 0, 0, 0, 1]]))
    assert len(scene) == 1


def test_instance_objects_are_created_lazily():
    scene, ball = wv.Scene(), trimesh.creation.icosphere(subdivisions=0)
    rows = grid(1000)
    assert calls_of("make", lambda: scene.add_instances(ball, rows, names="ball")) == 0
    assert calls_of("make", lambda: scene["ball_7"]) == 1
    np.testing.assert_allclose(scene["ball_7"].pose, rows[7], atol=1e-6)
    assert scene["ball_7"] is scene.objects[7] is list(scene)[7]
    assert calls_of("make", lambda: scene.objects) == 0  # all objects exist by now
    copy = pickle.loads(pickle.dumps(scene))
    for other in (copy, scene.to("cpu")):
        assert other["ball_999"].name == "ball_999"
        np.testing.assert_array_equal(other["ball_999"].vertices, scene["ball_999"].vertices)
        assert other.movable == scene.movable


@pytest.mark.parametrize("made", [False, True])
def test_bounds_do_not_compute_instance_vertices(made):
    """Bounds of 20,000 objects of 5,120 triangles once took 5 s; this scene has objects of every kind."""
    scene, ball = wv.Scene(), trimesh.creation.icosphere(subdivisions=1, radius=0.3)
    ball.vertices *= (1, 2, 3)
    rows = grid(100)
    rows[:, 3:] = np.random.default_rng(0).normal(size=(100, 4))
    rows[:, 3:] /= np.linalg.norm(rows[:, 3:], axis=1)[:, None]
    scene.add_instances(ball, rows, names="still", movable=False)
    scene.add_instances(ball, rows + [0, 0, 9, 0, 0, 0, 0], names="moving")
    scene.add_instances(solids.sphere(0.3), rows - [0, 0, 9, 0, 0, 0, 0], names="round")
    if made:
        assert len(scene.objects) == 300
    assert calls_of("placed_at", lambda: scene.bounds) == 0
    parts = [scene.bounds]
    for name, row in (("floor", rows[0] - 20), ("late", rows[1])):
        scene.add(ball, name=name, pose=np.concatenate([row[:3], rows[0, 3:]]), movable=name == "late")
    scene.add(ball, name="load", pose=(30, 0, 0, 0, 0, 0, 1), attach_to="late")
    parts.append(scene.bounds)
    for bounds, count in zip(parts, (300, 303), strict=True):
        corners = np.concatenate([item.vertices for item in scene.objects[:count]])
        np.testing.assert_allclose(bounds, [corners.min(axis=0), corners.max(axis=0)], rtol=1e-6)
        assert bounds.dtype == np.float32


def test_movable_and_static_crowds_render_alike(device):
    moving, static = (wv.scenes.PRESETS[name] for name in ("crowd_1k", "crowd_1k_static"))
    scenes = [preset.build(device) for preset in (moving, static)]
    assert [len(scene) for scene in scenes] == [1000, 1000]
    assert [len(scene.movable) for scene in scenes] == [1000, 0]
    np.testing.assert_array_equal(moving.poses(3), static.poses(3))
    views, others = (
        wv.render(scene, moving.camera, moving.poses(2), outputs=("depth", "segmentation")) for scene in scenes
    )
    depth, other = views.depth.numpy(), others.depth.numpy()
    assert np.isfinite(depth).mean() > 0.05
    same = np.isclose(depth, other, rtol=1e-5, atol=1e-5) | (depth == other)
    assert same.mean() > 0.999
    assert (views.segmentation.numpy() == others.segmentation.numpy()).mean() > 0.999
