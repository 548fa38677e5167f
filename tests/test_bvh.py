# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The BVH contains every triangle once, its bounds enclose their subtrees, and it does not depend on threads.

Its depth never exceeds the limit, for any triangles.
"""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.core.arrays import aligned_empty
from warpvis.errors import ArrayError, SceneError
from warpvis.scene.acceleration import bvh as builder
from warpvis.scene.closed import provably_closed
from warpvis.scenes import shapes

import reference
from support.bvh import (
    ARRAYS,
    CASES,
    Input,
    assert_boxes_and_cones_hold,
    assert_equal,
    assert_every_triangle_is_there_once,
    preset,
    random_triangles,
    soup,
    subtrees,
)

LANES = (16, 32)


def min_levels(count, lanes):
    """Return the number of levels of a full tree of `count` triangles."""
    return next(levels for levels in range(1, 32) if count <= lanes ** (levels + 1))


PAIRS = [(name, lanes) for name in CASES for lanes in LANES]


@pytest.fixture(scope="module", params=PAIRS, ids=lambda pair: f"{pair[0]}-{pair[1]}")
def case(request):
    name, lanes = request.param
    given = CASES[name]()
    return given, given.build(lanes=lanes)


def test_tree_contains_every_triangle_once(case):
    assert_every_triangle_is_there_once(*case)


@pytest.mark.smoke("doubling-*", "blobs_77k-32", "slivers-*", "room-*", "soup-*", "powers-*")
def test_boxes_and_cones_bound_their_subtrees(case):
    assert_boxes_and_cones_hold(*case)


@pytest.mark.smoke("32")
@pytest.mark.parametrize("lanes", LANES)
def test_culled_children_face_away(lanes):
    given = preset("blobs_77k")
    tree = given.build(lanes=lanes)
    nodes = tree.nodes.numpy().reshape(-1, 10, lanes).astype(np.float64)
    culled = 0
    for camera in np.random.default_rng(3).uniform(-4, 4, (3, 3)):
        for node, lane, triangles in subtrees(tree)[0]:
            low, high, axis, cutoff = np.split(nodes[node, :, lane], [3, 6, 9])
            offset, radius = (low + high) / 2 - camera, np.linalg.norm(high - low) / 2
            if offset @ axis >= cutoff * np.linalg.norm(offset) + radius:
                culled += len(triangles)
                a, b, c = given.vertices[given.faces[triangles]].astype(np.float64).swapaxes(0, 1)
                assert (((a - camera) * np.cross(b - a, c - a)).sum(axis=1) > 0).all()
    # Wider cones of more triangles cull less often.
    assert culled > len(given.faces) / {16: 2, 32: 3}[lanes]


@pytest.mark.parametrize("lanes", LANES)
def test_cones_of_flat_leaves_are_narrow(lanes):
    rng = np.random.default_rng(0)
    corners = rng.uniform(0, 1, (40, 3, 3)) * [1, 1, 0]
    turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] < 0
    corners[turned] = corners[turned][:, ::-1]
    nodes = soup(corners).build(lanes=lanes).nodes.numpy().reshape(-1, 10, lanes)
    np.testing.assert_allclose(nodes[0, 6:, :2].T, [[0, 0, 1, 1e-3]] * 2, atol=1e-6)


def test_leaves_are_filled_and_the_tree_is_small(case):
    given, tree = case
    assert tree.depth <= 40
    if len(given.faces) >= 1000:
        assert len(given.faces) / tree.leaf_count >= 0.65 * tree.lanes
        assert tree.bytes_per_triangle < 100
    assert all(getattr(tree, name).ptr % 64 == 0 for name in ARRAYS)


@pytest.mark.parametrize("options", [{"lanes": 16}, {"lanes": 32}, {"lanes": 32, "max_levels": 3}], ids=str)
@pytest.mark.parametrize("name", ["blobs_77k", "identical", "soup"])
def test_tree_does_not_depend_on_threads(name, options):
    given = CASES[name]()
    first = given.build(threads=1, **options)
    for threads in (2, 5):
        assert_equal(first, given.build(threads=threads, **options))


@pytest.mark.smoke("*-32", "room-16", "soup-16")
def test_tree_depth_does_not_exceed_max_levels(case):
    given, unlimited = case
    for max_levels in range(min_levels(len(given.faces), unlimited.lanes), unlimited.depth):
        tree = given.build(lanes=unlimited.lanes, max_levels=max_levels)
        assert tree.depth <= max_levels
        assert_every_triangle_is_there_once(given, tree)
    assert_equal(unlimited, given.build(lanes=unlimited.lanes, max_levels=unlimited.depth))


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize("name", ["room", "doubling"])
def test_bounds_of_shallow_trees_enclose_their_subtrees(name, lanes):
    given = CASES[name]()
    tree = given.build(lanes=lanes, max_levels=min_levels(len(given.faces), lanes))
    assert tree.depth < given.build(lanes=lanes).depth
    assert_boxes_and_cones_hold(given, tree)


def test_doubling_triangles_build_a_deep_tree():
    assert CASES["doubling"]().build(lanes=32).depth > 12


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize("levels", [1, 2])
def test_full_tree_is_the_maximum_for_its_levels(lanes, levels):
    count = lanes ** (levels + 1)
    tree = soup(random_triangles(count)).build(lanes=lanes, max_levels=levels)
    assert (tree.depth, tree.leaf_count) == (levels, count // lanes)
    with pytest.raises(
        SceneError, match=rf"{lanes} lanes and at most {levels} levels holds {count} .* got {count + 1}$"
    ):
        soup(random_triangles(count + 1)).build(lanes=lanes, max_levels=levels)


def test_invalid_levels_and_lanes_raise():
    with pytest.raises(SceneError, match=r"at most 0 levels holds 0 triangles, got 1$"):
        soup(random_triangles(1)).build(max_levels=0)
    with pytest.raises(ArrayError, match=r"^lanes must be 16 or 32, got 8$"):
        soup(random_triangles(1)).build(lanes=8)


def test_tree_of_100_million_triangles_can_be_collapsed():
    """Scratch arrays exceed the maximum length of an array axis; memory that is not written is never committed."""
    from warpvis.kernels.bvh import build
    from warpvis.kernels.constants import SPLIT_WORDS

    splits = np.zeros(100_000_000 * SPLIT_WORDS, dtype=np.int32)  # zeros: all items form one leaf
    made = builder._collapse(build.collapse_tree, wp.array(splits, device="cpu", copy=False), 32, evenly=False)
    assert made[2:] == (1, 1, 1)
    np.testing.assert_array_equal(made.leaf_ranges.numpy()[0], [0, 100_000_000])


def test_too_many_triangles_raise(monkeypatch):
    """Before a tree is built, if there are too many leaves, and for all trees together."""
    with pytest.raises(SceneError, match="at most 238609294 triangles, got 238609295"):
        builder.check_size(238_609_295, 16, None)
    builder.check_size(238_609_294, 16, None)
    monkeypatch.setattr(builder, "MAX_PLACES", 3000)
    message = r"at most 187 leaves of up to 16 triangles, got \d+; share meshes between objects"
    with pytest.raises(SceneError, match=message):
        CASES["soup"]().build()
    monkeypatch.setattr(builder, "MAX_PLACES", 11 * 16)
    scene = wv.Scene()
    for size in (1, 2):
        scene.add((random_triangles(65 * size).reshape(-1, 3), np.arange(195 * size).reshape(-1, 3)), movable=True)
    with pytest.raises(SceneError, match="at most 11 leaves of up to 16 triangles"):
        scene.bvh()


def split_natively(given: Input, max_splits: int, lanes: int):
    """Return the items before splitting, their boxes in the new order, and the splits."""
    from warpvis.kernels.bvh import build
    from warpvis.kernels.constants import ITEM_WORDS, SPLIT_WORDS

    count = len(given.faces)
    vertices, faces = wp.array(given.vertices.ravel(), device="cpu"), wp.array(given.faces.ravel(), device="cpu")
    # build.py requires alignment to 32 bytes.
    memory = np.zeros(count * ITEM_WORDS + 16, dtype=np.float32)
    start = -memory.ctypes.data % 64 // 4
    items = wp.array(memory[start : start + count * ITEM_WORDS], copy=False, device="cpu")
    splits = wp.zeros(count * SPLIT_WORDS, dtype=wp.int32, device="cpu")
    wp.launch(build.load_items, dim=count, inputs=[vertices, faces, 0, items], device="cpu")
    loaded = items.numpy().reshape(-1, ITEM_WORDS).copy()
    nowhere = wp.zeros(0, device="cpu")
    parts = aligned_empty((16,), wp.float32)
    inputs = [lanes, 0, count, 0, 0, max_splits, nowhere, -1, 0, items, splits, parts]
    wp.launch(build.split_range, dim=1, inputs=inputs, device="cpu")
    rows = items.numpy().reshape(-1, ITEM_WORDS)
    return loaded, np.concatenate([rows[:, :3], -rows[:, 4:7]], axis=1), splits.numpy().reshape(-1, SPLIT_WORDS)


def test_items_are_boxes_and_indices():
    given = soup(random_triangles(70_000))
    rows, _, _ = split_natively(given, 0, 16)
    boxes = np.concatenate([rows[:, :3], -rows[:, 4:7]], axis=1)
    np.testing.assert_array_equal(boxes, reference.load_items(given.vertices, given.faces))
    np.testing.assert_array_equal(rows[:, 7] * 65536 + rows[:, 3], np.arange(70_000))


@pytest.mark.parametrize(("lanes", "count"), [(16, 17), (16, 40), (16, 64), (32, 33), (32, 80), (32, 128)])
def test_small_ranges_are_split_optimally(lanes, count):
    given = soup(random_triangles(count, seed=count))
    _, boxes, splits = split_natively(given, 1, lanes)
    at = splits[0, 0]
    best = reference.split_range(reference.load_items(given.vertices, given.faces), lanes)
    assert reference.split_cost(boxes[:at], boxes[at:], lanes) == pytest.approx(best, rel=1e-5)


@pytest.mark.parametrize("lanes", LANES)
def test_large_ranges_are_split_near_the_optimum(lanes):
    """16 bins per axis come within 10 % of the best split."""
    given = soup(random_triangles(500))
    _, boxes, splits = split_natively(given, 1, lanes)
    best = reference.split_range(reference.load_items(given.vertices, given.faces), lanes)
    assert reference.split_cost(boxes[: splits[0, 0]], boxes[splits[0, 0] :], lanes) < 1.1 * best


@pytest.mark.parametrize("lanes", LANES)
def test_nodes_have_the_smallest_total_area(lanes):
    given = soup(random_triangles(1500))
    _, _, splits = split_natively(given, -1, lanes)
    areas = splits[:, 2:].view(np.float32)
    binary = {split: (*splits[split, :2].tolist(), *areas[split].tolist()) for split in range(1, 1500)}
    tree = given.build(lanes=lanes)
    nodes = tree.nodes.numpy().reshape(-1, 10, lanes).astype(np.float64)
    inner = tree.children.numpy().reshape(-1, lanes) > 0
    boxes = nodes[:, :6].swapaxes(1, 2)[inner]
    total = sum(reference.box_area(box[None]) for box in boxes)
    assert total == pytest.approx(reference.collapse_tree(binary, int(splits[0, 0]), lanes), rel=1e-4)


def dented_ball(depth=0.02):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.3)
    ball.vertices += depth * np.sin(20 * ball.vertices[:, [1, 2, 0]])
    ball.vertices += [1.0, 2.0, 3.0]
    return ball


def unmerged(mesh):
    return trimesh.Trimesh(mesh.triangles.reshape(-1, 3), np.arange(len(mesh.faces) * 3).reshape(-1, 3), process=False)


def with_flat_triangles(mesh):
    flat = mesh.faces[:5][:, [0, 1, 1]]
    return trimesh.Trimesh(mesh.vertices, np.concatenate([mesh.faces, flat]), process=False)


def inverted(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False)


def without(mesh, *faces):
    return trimesh.Trimesh(mesh.vertices, np.delete(mesh.faces, faces, axis=0), process=False)


def flipped(mesh, face):
    faces = mesh.faces.copy()
    faces[face] = faces[face][::-1]
    return trimesh.Trimesh(mesh.vertices, faces, process=False)


def moved(mesh, offset):
    return trimesh.Trimesh(mesh.vertices + offset, mesh.faces, process=False)


BOX, BALL = trimesh.creation.box((0.2, 0.6, 0.5)), trimesh.creation.icosphere(subdivisions=3, radius=0.1)

MESHES = {
    "box": (BOX, True),
    "floor": (shapes.floor(8, 8), True),
    "ball": (BALL, True),
    "capsule": (trimesh.creation.capsule(height=1.4, radius=0.2), True),
    "cylinder": (trimesh.creation.cylinder(radius=0.2, height=0.3), True),
    "dented ball": (dented_ball(), True),
    "unmerged box": (unmerged(BOX), True),
    "unmerged dented ball": (unmerged(dented_ball()), True),
    "with flat triangles": (with_flat_triangles(BALL), True),
    "far away": (moved(BALL, [1e3, -1e3, 10.0]), True),
    "deeply dented ball": (dented_ball(0.2), False),
    "open box": (without(BOX, 3), False),
    "box without a side": (without(BOX, 0, 1), False),
    "inverted box": (inverted(BOX), False),
    "one face inverted": (flipped(BALL, 7), False),
    "two faces inverted": (flipped(flipped(BALL, 7), 500), False),
    "the same ball twice": (trimesh.util.concatenate([BALL, BALL]), False),
    "ball in a ball": (trimesh.util.concatenate([BALL, trimesh.creation.icosphere(radius=0.2)]), False),
    "ball in an inverted ball": (trimesh.util.concatenate([BALL, inverted(trimesh.creation.icosphere())]), False),
    "overlapping balls": (trimesh.util.concatenate([BALL, moved(BALL, [0.05, 0.0, 0.0])]), False),
    "torus": (trimesh.creation.torus(0.5, 0.1), False),
    "one triangle": (trimesh.Trimesh(np.eye(3), [[0, 1, 2]]), False),
    "two-sided triangle": (trimesh.Trimesh(np.eye(3), [[0, 1, 2], [2, 1, 0]], process=False), False),
    "all flat": (trimesh.Trimesh(np.eye(3), [[0, 1, 1]], process=False), False),
}


@pytest.mark.parametrize("name", MESHES)
def test_closed_star_shaped_meshes_are_found(name):
    mesh, expected = MESHES[name]
    assert provably_closed(mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32)) is expected


@pytest.mark.parametrize("name", MESHES)
def test_closed_meshes_are_found_in_chunks_of_faces(name, monkeypatch):
    monkeypatch.setattr("warpvis.scene.closed._FACES_AT_A_TIME", 7)
    test_closed_star_shaped_meshes_are_found(name)


def test_negative_zero_equals_zero():
    vertices = unmerged(BOX).vertices.astype(np.float32) + np.float32([0.1, 0.3, 0.25])
    vertices[np.abs(vertices) < 1e-6] = 0.0
    zeros = np.argwhere(vertices == 0)
    vertices[tuple(zeros[::2].T)] = -0.0
    assert len(zeros) > 4
    assert provably_closed(vertices, np.arange(36, dtype=np.int32).reshape(-1, 3))
