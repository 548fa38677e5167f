# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Triangle inputs of tree builds, and checks of the trees."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from warpvis.scene.acceleration.bvh import build_bvh
from warpvis.scenes import PRESETS

import reference

ARRAYS = ("leaves", "triangles", "owners", "nodes", "children")


@dataclass
class Input:
    vertices: np.ndarray
    faces: np.ndarray
    owner: np.ndarray
    closed: np.ndarray

    def build(self, **options):
        return build_bvh(self.vertices, self.faces, self.owner, self.closed, **options)


def soup(corners, closed=True) -> Input:
    corners = np.asarray(corners, dtype=np.float32)
    faces = np.arange(len(corners) * 3, dtype=np.int32).reshape(-1, 3)
    return Input(corners.reshape(-1, 3), faces, np.zeros(len(faces), np.int32), np.array([closed]))


@cache
def preset(name) -> Input:
    objects = PRESETS[name].build().objects
    first = np.cumsum([0] + [len(item.vertices) for item in objects])
    faces = np.concatenate([item.faces + start for item, start in zip(objects, first, strict=False)])
    owner = np.repeat(np.arange(len(objects), dtype=np.int32), [len(item.faces) for item in objects])
    closed = np.arange(len(objects)) % 5 != 3
    return Input(np.concatenate([item.vertices for item in objects]), faces.astype(np.int32), owner, closed)


def random_triangles(count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, (count, 1, 3)) + rng.normal(0, 0.1, (count, 3, 3))


def powers(count):
    """Return triangles at ever smaller distances: each split by bins removes only a few of them."""
    return random_triangles(count)[:, :, :] * 0.7 ** (np.arange(count) % 200)[:, None, None]


def doubling(count):
    """Return triangles whose size and distance double repeatedly: the heuristic builds a deep tree."""
    return 2.0 ** np.linspace(-30, 30, count)[:, None, None] * [[1, -0.1, -0.1], [1, 0.1, -0.1], [1, 0, 0.1]]


def slivers(count):
    """Return triangles of almost zero area, in all directions."""
    corners = random_triangles(count)
    corners[:, 2] = corners[:, 1] + np.random.default_rng(1).normal(0, 1e-6, (count, 3))
    return corners


CASES = {
    "one": lambda: soup(random_triangles(1)),
    "16": lambda: soup(random_triangles(16)),
    "17": lambda: soup(random_triangles(17)),
    "33": lambda: soup(random_triangles(33)),
    "64": lambda: soup(random_triangles(64)),
    "65": lambda: soup(random_triangles(65)),
    "129": lambda: soup(random_triangles(129)),
    "soup": lambda: soup(random_triangles(3000)),
    "identical": lambda: soup(np.repeat(random_triangles(1), 100_000, axis=0)),
    "points": lambda: soup(np.zeros((1000, 3, 3))),
    "lines": lambda: soup(random_triangles(1000)[:, [0, 1, 1]]),
    "tiny": lambda: soup(random_triangles(1000) * 1e-22),
    "huge": lambda: soup(random_triangles(1000) * 3e17),
    "far": lambda: soup(random_triangles(1000) + 1e5),
    "powers": lambda: soup(powers(5000)),
    "doubling": lambda: soup(doubling(20_000)),
    "slivers": lambda: soup(slivers(20_000)),
    "row": lambda: soup(random_triangles(1)[0] + np.arange(2000)[:, None, None] * [1.0, 0.0, 0.0]),
    "room": lambda: preset("room"),
    "blobs_77k": lambda: preset("blobs_77k"),
}


def assert_equal(first, other):
    for array in ARRAYS:
        assert getattr(first, array).numpy().tobytes() == getattr(other, array).numpy().tobytes()


def subtrees(tree):
    """Return ``(node, lane, triangles below, level)`` of every child, descendants first."""
    children = tree.children.numpy().reshape(-1, tree.lanes)
    triangles = tree.triangles.numpy().reshape(-1, tree.lanes)
    found = []
    below = [None] * tree.node_count
    levels = [0] * tree.node_count
    for node in reversed(range(tree.node_count)):
        parts = []
        for lane in np.flatnonzero(children[node]):
            child = children[node, lane]
            assert child > node or child < 0
            part = triangles[~child][triangles[~child] >= 0] if child < 0 else below[child]
            levels[node] = max(levels[node], 1 if child < 0 else 1 + levels[child])
            found.append((node, lane, part))
            parts.append(part)
        below[node] = np.concatenate(parts)
    assert levels[0] == tree.depth
    return found, below[0]


def assert_every_triangle_is_there_once(given, tree):
    triangles = tree.triangles.numpy().reshape(-1, tree.lanes)
    assert tree.leaf_count == len(triangles)
    np.testing.assert_array_equal(np.sort(triangles[triangles >= 0]), np.arange(len(given.faces)))
    assert (triangles[:, 0] >= 0).all()
    _, below_root = subtrees(tree)
    np.testing.assert_array_equal(np.sort(below_root), np.arange(len(given.faces)))
    expected = reference.fill_leaves(given.vertices, given.faces, triangles)
    leaves = tree.leaves.numpy().reshape(-1, 9, tree.lanes)
    np.testing.assert_array_equal(leaves.view(np.uint32), np.ascontiguousarray(expected).view(np.uint32))
    owners = given.owner[np.where(triangles >= 0, triangles, triangles[:, :1])]
    np.testing.assert_array_equal(tree.owners.numpy().reshape(-1, tree.lanes), owners)


def assert_boxes_and_cones_hold(given, tree):
    nodes = tree.nodes.numpy().reshape(-1, 10, tree.lanes)
    unused = tree.children.numpy().reshape(-1, tree.lanes) == 0
    assert (nodes.swapaxes(1, 2)[unused][:, :3] == np.float32(3e38)).all()
    assert (nodes.swapaxes(1, 2)[unused][:, 3:6] == np.float32(-3e38)).all()
    assert (nodes[:, 9][unused] == 2).all()
    corners, normals = reference.fit_nodes(given.vertices, given.faces)
    lows, highs = corners.min(axis=1), corners.max(axis=1)
    for node, lane, triangles in subtrees(tree)[0]:
        low, high, axis, cutoff = np.split(nodes[node, :, lane].astype(np.float64), [3, 6, 9])
        assert (lows[triangles].min(axis=0) == low).all()
        assert (highs[triangles].max(axis=0) == high).all()
        if not given.closed[given.owner[triangles]].all():
            assert cutoff == 2
        if cutoff < 2:
            assert cutoff < 1
            assert abs(np.linalg.norm(axis) - 1) < 1e-6
            assert not (normals[triangles] @ axis < np.sqrt(1 - (cutoff - 5e-4) ** 2)).any()  # NaN is ignored
