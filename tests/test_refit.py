# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of deforming meshes: both casters match a scene built from the new vertices."""

import numpy as np
import pytest
import trimesh
import warp as wp
from pose_samples import unit

import warpvis as wv
from warpvis.core.threads import core_count
from warpvis.scene.acceleration.bvh import build_bvh, leaf_vertices
from warpvis.scene.closed import provably_closed

import reference
from compare import assert_matches_reference
from support.refit import ALL, BALL, SMALL, assert_seen, eyes

VERTICES = np.asarray(BALL.vertices, dtype=np.float32)
BOX = trimesh.creation.box((0.4, 0.3, 0.5))
POSE = unit((0.2, -0.3, 0.6, 0.3, 0.1, 0.2, 0.9))
OTHER = unit((-0.7, 0.5, 0.5, 0.0, 0.3, 0.1, 0.8))
THIRD = unit((0.4, 0.9, 0.7, 0.1, 0.2, 0.0, 1.0))


def wobble(seed, amount=0.15):
    """Return the ball's vertices, smoothly displaced."""
    rng = np.random.default_rng(seed)
    waves = np.sin(VERTICES @ rng.normal(0, 6, (3, 4)) + rng.uniform(0, 6, 4))
    return (VERTICES + amount * waves @ rng.normal(0, 0.5, (4, 3))).astype(np.float32)


DEFORMATIONS = {
    "smooth": lambda: wobble(0),
    "smoother": lambda: wobble(1, 0.05),
    "folded over itself": lambda: wobble(2, 0.8),
    "turned inside out": lambda: -VERTICES,
    "flattened": lambda: VERTICES * np.float32([1, 1, 0]),
    "a point": lambda: np.zeros_like(VERTICES),
    "torn apart": lambda: np.random.default_rng(3).uniform(-0.6, 0.6, VERTICES.shape).astype(np.float32),
    "huge": lambda: VERTICES * np.float32(50),
    "far from its frame's origin": lambda: VERTICES + np.float32([0.3, 1.0, -0.2]),
}


def build(device, *balls, poses=(POSE, OTHER, THIRD), movable=True):
    """Return a scene with a floor, balls with these vertices, and a box."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((6, 6, 0.02)), name="floor", label="ground")
    for index, vertices in enumerate(balls):
        mesh = (vertices, BALL.faces)
        scene.add(mesh, name=f"ball_{index}", label="object", pose=poses[index], movable=movable)
    scene.add(BOX, name="box", pose=unit((-0.9, -0.6, 0.3, 0, 0, 0.2, 1)), movable=movable)
    return scene


def assert_refitted(scene, name):
    """Assert that the leaves, child boxes and whole box of the object's tree match its vertices."""
    index = scene.index(name)
    struct, position = scene.bvh().struct, scene.movable.index(index)
    item = scene[name]
    lanes = 16 if scene.device.is_cpu else 32
    root, first_leaf = (int(getattr(struct, f"movable_{of}").numpy()[position]) for of in ("root", "leaf"))
    children = struct.children.numpy().reshape(-1, lanes)
    nodes = struct.nodes.numpy().reshape(-1, 10, lanes)
    leaves = struct.leaves.numpy().reshape(-1, 9, lanes)
    below, found = [root], []
    while below:
        node = below.pop()
        for lane in np.flatnonzero(children[node]):
            child = children[node, lane]
            if child > 0:
                low, high = nodes[child, :3].min(axis=1), nodes[child, 3:6].max(axis=1)
                below.append(child)
            else:
                corners = leaves[~child].reshape(3, 3, lanes)
                low, high = corners.min(axis=(0, 2)), corners.max(axis=(0, 2))
                assert ~child >= first_leaf
                found.append(corners.transpose(2, 0, 1))
            np.testing.assert_array_equal(nodes[node, :6, lane], [*low, *high])
            assert nodes[node, 9, lane] == 2
    expected = reference.rotate_corners(item.mesh_vertices[item.faces]).reshape(-1, 9)
    corners = np.concatenate(found).reshape(-1, 9)
    corners = corners[(corners[:, :3] != corners[:, 3:6]).any(axis=1)]  # lanes without a triangle repeat a corner
    if (expected[:, :3] != expected[:, 3:6]).any(axis=1).all():
        np.testing.assert_array_equal(corners[np.lexsort(corners.T)], expected[np.lexsort(expected.T)])
    box = struct.movable_boxes.numpy().reshape(-1, 6)[position]
    np.testing.assert_array_equal(box, [*item.mesh_vertices.min(axis=0), *item.mesh_vertices.max(axis=0)])
    assert struct.movable_closed.numpy()[position] == 0


@pytest.mark.smoke("*-packets-*")
@pytest.mark.parametrize("deformation", DEFORMATIONS)
def test_deformed_meshes_match_rebuilt_scene(deformation, device, caster):
    vertices = DEFORMATIONS[deformation]()
    scene = build(device, VERTICES)
    scene.update_vertices("ball_0", VERTICES)
    scene.bvh(), scene.triangles()
    scene.update_vertices("ball_0", vertices)
    assert_seen(scene, build("cpu", vertices, movable=False), caster)
    assert_refitted(scene, "ball_0")


@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_update_before_first_render(cull_backfaces, device, caster):
    scene = build(device, VERTICES)
    scene.update_vertices("ball_0", wobble(0))
    twin = build("cpu", wobble(0), movable=False)
    assert_seen(scene, twin, caster, cull_backfaces=cull_backfaces)
    scene.update_vertices("ball_0", -VERTICES)
    assert_seen(scene, build("cpu", -VERTICES, movable=False), caster, cull_backfaces=cull_backfaces)


def test_updates_between_renderings_and_casters(device):
    scene = build(device, VERTICES)
    for seed, casters in enumerate([("rays",), ("rays", "packets"), (), ("packets",), ("rays",), ("packets", "rays")]):
        scene.update_vertices("ball_0", wobble(seed))
        for caster in casters:
            assert_seen(scene, build("cpu", wobble(seed), movable=False), caster)


def test_later_updates_build_nothing(device, caster):
    scene = build(device, VERTICES, VERTICES)
    renderer = wv.Renderer(scene, SMALL, caster=caster)
    renderer.render(eyes(1))
    scene.update_vertices("ball_1", wobble(0))
    first = renderer.render(eyes(1))
    built = scene.bvh(), scene.triangles()
    before = first.depth.numpy().copy()
    scene.update_vertices("ball_1", wobble(1))
    assert (renderer.render(eyes(1)).depth.numpy() != before).any()
    scene.update_vertices("ball_1", wobble(0))
    np.testing.assert_array_equal(renderer.render(eyes(1)).depth.numpy(), before)
    assert (scene.bvh(), scene.triangles()) == built


def test_objects_sharing_the_mesh_are_unchanged(device, caster):
    scene = build(device, VERTICES, VERTICES, VERTICES)
    wv.render(scene, SMALL, eyes(1), caster=caster)
    assert len(scene.triangles().meshes) == 3  # the floor, the balls and the box
    for vertices in (wobble(0), wobble(5)):
        scene.update_vertices("ball_1", vertices)
        assert_seen(scene, build("cpu", VERTICES, vertices, VERTICES, movable=False), caster)
    assert len(scene.triangles().meshes) == 4
    assert scene.bvh().struct.movable_closed.numpy().tolist() == [1, 0, 1, 1]
    np.testing.assert_array_equal(scene["ball_0"].mesh_vertices, VERTICES)


def test_several_objects_deform(device, caster):
    """Also to equal vertices."""
    scene = build(device, VERTICES, VERTICES, VERTICES)
    shapes = {"ball_2": wobble(0), "ball_0": wobble(0)}
    for name, vertices in shapes.items():
        scene.update_vertices(name, vertices)
    assert_seen(scene, build("cpu", wobble(0), VERTICES, wobble(0), movable=False), caster)
    scene.update_vertices("ball_2", wobble(1))
    assert_seen(scene, build("cpu", wobble(0), VERTICES, wobble(1), movable=False), caster)
    for name in shapes:
        assert_refitted(scene, name)


def test_deformed_objects_move(device, caster):
    scene = build(device, VERTICES, VERTICES)
    scene.update_vertices("ball_0", wobble(1))
    wv.render(scene, SMALL, eyes(1), caster=caster)
    scene.update_vertices("ball_0", wobble(2))
    box = scene["box"].pose
    poses = np.array([[THIRD, POSE, box], [OTHER, THIRD, box]], dtype=np.float32)
    views = wv.render(scene, SMALL, eyes(2), outputs=ALL, caster=caster, object_poses=poses)
    for world, rows in enumerate(poses):
        twin = build("cpu", wobble(2), VERTICES, poses=rows, movable=False)
        images = {name: getattr(views, name)[world : world + 1] for name in ALL}
        assert_matches_reference(wv.Views(**images), twin, SMALL, eyes(2)[world : world + 1])


def test_deformed_mesh_from_inside(device, caster):
    """A deformed mesh is not treated as closed, so its back faces are rendered."""
    scene = build(device, VERTICES)
    scene.update_vertices("ball_0", wobble(1) * np.float32(10))
    assert_seen(scene, build("cpu", wobble(1) * np.float32(10), movable=False), caster)


def test_scene_of_one_deforming_object(device, caster):
    scene, twin = wv.Scene(device=device), wv.Scene()
    scene.add(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), name="sheet", movable=True)
    corners = np.array([[0, 0, 0], [1, 0, 1], [0, 1, 0.5]])
    twin.add((corners, [[0, 1, 2]]))
    for factor in (2, 1):
        scene.update_vertices("sheet", corners * factor)
    assert_seen(scene, twin, caster)


def test_rebuild_after_add_uses_newest_vertices(device, caster):
    scene = build(device, VERTICES)
    for seed in range(2):
        scene.update_vertices("ball_0", wobble(seed))
        wv.render(scene, SMALL, eyes(1), caster=caster)
    twin = build("cpu", wobble(1), movable=False)
    for changed in (scene, twin):
        changed.add(BOX, name="late", pose=OTHER)
    assert_seen(scene, twin, caster)
    scene.update_vertices("ball_0", wobble(2))
    assert_refitted(scene, "ball_0")


def test_host_vertices_are_the_newest(device, tmp_path):
    scene = build(device, VERTICES)
    held = scene["ball_0"]
    expected = build("cpu", wobble(1), movable=False)
    for seed in range(2):
        given = wp.array(wobble(seed), dtype=wp.vec3, device=device)
        scene.update_vertices("ball_0", given if device != "cpu" else wobble(seed))
    np.testing.assert_array_equal(held.mesh_vertices, VERTICES)
    np.testing.assert_array_equal(scene["ball_0"].mesh_vertices, wobble(1))
    np.testing.assert_allclose(scene["ball_0"].vertices, expected["ball_0"].vertices, atol=1e-6)
    np.testing.assert_allclose(scene.bounds, expected.bounds, atol=1e-6)
    scene.export(tmp_path / "scene.glb")
    loaded = wv.Scene.load(tmp_path / "scene.glb")
    np.testing.assert_allclose(loaded["ball_0"].bounds, expected["ball_0"].bounds, atol=1e-5)
    assert scene["ball_0"].movable and repr(scene["ball_0"]).startswith("SceneObject(name='ball_0'")


def test_copy_on_other_device_keeps_its_vertices(device):
    scene = build(device, VERTICES)
    scene.update_vertices("ball_0", wobble(0))
    other = scene.to("cpu")
    scene.update_vertices("ball_0", wobble(1))
    np.testing.assert_array_equal(other["ball_0"].mesh_vertices, wobble(0))
    assert_seen(other, build("cpu", wobble(0), movable=False), "packets")


def test_update_copies_the_given_vertices(device, caster):
    scene = build(device, VERTICES)
    given = wobble(0)
    scene.update_vertices("ball_0", given)
    given[:] = 7
    assert_seen(scene, build("cpu", wobble(0), movable=False), caster)


@pytest.mark.parametrize("form", ["list", "double", "vec3", "floats", "torch"])
def test_vertices_accept_several_forms(form, device):
    expected = wobble(0)
    forms = {
        "list": expected.tolist,
        "double": lambda: expected.astype(np.float64),
        "vec3": lambda: wp.array(expected, dtype=wp.vec3, device=device),
        "floats": lambda: wp.array(expected, dtype=wp.float32, device=device),
        "torch": lambda: pytest.importorskip("torch").tensor(expected, device=device),
    }
    scene = build(device, VERTICES)
    scene.update_vertices("ball_0", forms[form]())
    np.testing.assert_array_equal(scene["ball_0"].mesh_vertices, expected)


def corrupted(value, *rows):
    vertices = VERTICES.copy()
    vertices[list(rows), 1] = value
    return vertices


BAD = {
    "an object that stays": ("floor", np.zeros((8, 3)), "object 'floor' is not movable.*movable=True"),
    "no object": ("cat", VERTICES, "no object 'cat'"),
    "too few": ("ball_0", VERTICES[1:], "must have 162 rows, as before, got 161"),
    "flat": ("ball_0", VERTICES.ravel(), r"shape \(162, 3\), got \(486,\)"),
    "text": ("ball_0", "ball", "must be an array of numbers"),
    "NaN": ("ball_0", corrupted(np.nan, 3, 5), "must be finite: 2 are not, at 3, 5$"),
    "infinities": ("ball_0", corrupted(-np.inf, 1, 2, 3, 4), r"4 are not, at 1, 2, 3, \.\.\.$"),
    "far away": ("ball_0", corrupted(2e18, 1), "within 1e18 m"),
    "too large for single precision": ("ball_0", VERTICES.astype(np.float64) * 1e300, "within 1e18 m"),
}


@pytest.mark.parametrize("case", BAD)
def test_invalid_vertices_change_nothing(case):
    name, vertices, message = BAD[case]
    scene = build("cpu", VERTICES)
    clusters = scene.bvh()
    with pytest.raises(wv.errors.SceneError, match=message):
        scene.update_vertices(name, vertices)
    assert scene.bvh() is clusters


def test_invalid_gpu_vertices_raise(cuda):
    cases = {
        "must have 162 rows, as before, got 161": (wp.vec3, VERTICES[1:]),
        "dtype wp.vec3, got float64": (wp.float64, VERTICES),
    }
    for message, (dtype, values) in cases.items():
        with pytest.raises(wv.errors.SceneError, match=message):
            build(cuda, VERTICES).update_vertices("ball_0", wp.array(values, dtype=dtype, device=cuda))
    with pytest.raises(wv.errors.SceneError, match="on device cpu, got cuda:0"):
        build("cpu", VERTICES).update_vertices("ball_0", wp.array(VERTICES, dtype=wp.vec3, device=cuda))
    scene = build(cuda, VERTICES)
    scene.update_vertices("ball_0", wp.array(corrupted(np.nan, 3), dtype=wp.vec3, device=cuda))
    with pytest.raises(wv.errors.SceneError, match="must be finite: 1 are not, at 3"):
        wv.render(scene, SMALL, eyes(1))


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("lanes", [16, 32])
def test_kernels_match_references(lanes, parts):
    """Also with leaves in parts, one thread each; trees for CUDA have 32 lanes."""
    from warpvis.kernels.bvh.refit import refit_leaves, refit_nodes
    from warpvis.scene.acceleration.bvh import _slots

    faces, vertices = BALL.faces.astype(np.int32), wobble(4)
    owner = np.zeros(len(faces), dtype=np.int32)
    tree = build_bvh(VERTICES, faces, owner, np.array([False]), lanes=lanes)
    corners = leaf_vertices(tree, faces)
    np.testing.assert_array_equal(
        reference.refit_leaves(VERTICES, corners)[0], tree.leaves.numpy().reshape(-1, 9, lanes)
    )
    children = tree.children.numpy().reshape(-1, lanes)
    leaf_slots, node_slots, levels = _slots(children, tree.leaf_count)
    assert len(levels) == tree.depth
    leaves, nodes = tree.leaves.reshape((-1, 9, lanes)), tree.nodes.reshape((-1, 10, lanes))
    box = wp.zeros(6, dtype=float, device="cpu")
    points = wp.array(vertices, dtype=wp.vec3, device="cpu")
    leaf_inputs = [wp.array(array, dtype=wp.int32, device="cpu") for array in (corners, leaf_slots)]
    node_inputs = [wp.array(array, dtype=wp.int32, device="cpu") for array in (np.concatenate(levels), node_slots)]
    for first in range(0, tree.leaf_count, -(-tree.leaf_count // parts)):
        count = min(-(-tree.leaf_count // parts), tree.leaf_count - first)
        wp.launch(refit_leaves, (count, 1), [points, *leaf_inputs, first, 1, leaves, nodes], device="cpu")
    first = 0
    for level in levels:
        wp.launch(refit_nodes, (len(level), 1), [*node_inputs, first, 1, nodes, box], device="cpu")
        first += len(level)
    rows, boxes = reference.refit_leaves(vertices, corners)
    np.testing.assert_array_equal(leaves.numpy(), rows)
    rows, whole = reference.refit_nodes(boxes, children)
    np.testing.assert_array_equal(nodes.numpy()[:, :6], rows)
    np.testing.assert_array_equal(box.numpy(), whole)


@pytest.mark.slow
def test_large_meshes_are_refitted_by_several_threads(device):
    mesh = trimesh.creation.icosphere(subdivisions=6)
    scene = wv.Scene(device=device)
    scene.add(BOX, movable=True)
    scene.add(mesh, name="ball", movable=True)
    for factor in (1, 2, 3):
        scene.update_vertices("ball", mesh.vertices * factor)
        assert_refitted(scene, "ball")
    refit = scene.bvh().refits[1]
    assert device != "cpu" or core_count() == 1 or len(refit._leaf_launches) > 2


def test_deformed_ball_is_not_marked_closed(device):
    """A proof that a mesh is closed holds for one shape only."""
    scene = build(device, VERTICES)
    scene.update_vertices("ball_0", wobble(1, 0.01))
    assert provably_closed(wobble(1, 0.01), BALL.faces)
    assert_refitted(scene, "ball_0")


def test_update_move_and_render_record_into_a_cuda_graph(caster, cuda):
    scene = build(cuda, VERTICES, VERTICES)
    renderer = wv.Renderer(scene, SMALL, outputs=ALL, caster=caster)
    rows = np.array([[POSE, OTHER, scene["box"].pose]], dtype=np.float32)
    vertices = wp.array(wobble(0), dtype=wp.vec3, device=cuda)
    poses = wp.array(rows, dtype=wp.transform, shape=(1, 3), device=cuda)
    cameras = wp.array(eyes(2), dtype=wp.transform, device=cuda)
    scene.update_vertices("ball_0", vertices)
    views = renderer.render(cameras, object_poses=poses)
    with wp.ScopedCapture(cuda) as capture:
        scene.update_vertices("ball_0", vertices)
        renderer.render(cameras, object_poses=poses, out=views)
    for seed in (1, 2):
        rows[0, :2] = rows[0, 1::-1]
        vertices.assign(wobble(seed))
        poses.assign(rows)
        wp.capture_launch(capture.graph)
        twin = build("cpu", wobble(seed), VERTICES, poses=rows[0], movable=False)
        assert_matches_reference(views, twin, SMALL, eyes(2))
        np.testing.assert_array_equal(scene["ball_0"].mesh_vertices, wobble(seed))
