# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The BVH built on a GPU has the properties of the host's tree, and every kernel matches its reference.

Warp runs the same kernels on a CPU.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from build_checks import Checks

from warpvis.errors import SceneError
from warpvis.kernels.bvh import ranges_cuda
from warpvis.kernels.bvh.nodes_cuda import join_children
from warpvis.scene.acceleration import bvh_cuda, geometry

import reference
from support import bvh as bvh_checks

CASES = bvh_checks.CASES
MAX_LEVELS = 8


def build(given, device="cpu", max_levels=MAX_LEVELS):
    arrays = given.vertices, given.faces, given.owner, given.closed
    return bvh_cuda.build_device_bvh(*arrays, wp.get_device(device), max_levels=max_levels)


def areas(tree) -> tuple[float, float]:
    """Return the total areas of the boxes of all leaves and of all nodes but the root."""
    nodes = tree.nodes.numpy().reshape(-1, 10, tree.lanes).astype(np.float64).swapaxes(1, 2)
    children = tree.children.numpy().reshape(-1, tree.lanes)
    area = reference.half_area(nodes[..., :3], nodes[..., 3:6])
    return area[children < 0].sum(), area[children > 0].sum()


@pytest.mark.smoke("*-doubling", "*-slivers", "*-powers", "*-soup", "*-tiny", "*-lines", "*-huge", "*-33")
@pytest.mark.parametrize("name", CASES)
def test_tree_contains_all_triangles_and_bounds_them(name, device):
    given = CASES[name]()
    tree = build(given, device)
    bvh_checks.assert_every_triangle_is_there_once(given, tree)
    bvh_checks.assert_boxes_and_cones_hold(given, tree)
    assert tree.depth <= MAX_LEVELS
    if len(given.faces) >= 1000:
        assert len(given.faces) / tree.leaf_count >= 0.65 * tree.lanes
        assert tree.bytes_per_triangle < 100


@pytest.mark.parametrize("name", ["soup", "room", "blobs_77k", "slivers", "row", "huge"])
def test_tree_is_as_good_as_the_hosts_tree(name, device):
    """The expected number of visited boxes, proportional to their area, is at most 3 % higher."""
    given = CASES[name]()
    for ours, theirs in zip(areas(build(given, device)), areas(given.build(lanes=32)), strict=True):
        assert ours <= 1.03 * theirs


def test_tree_is_reproducible(device):
    given = CASES["blobs_77k"]()
    first, other = build(given, device), build(given, device)
    for name in bvh_checks.ARRAYS:
        assert getattr(first, name).numpy().tobytes() == getattr(other, name).numpy().tobytes()


def test_too_deep_tree_is_split_evenly(monkeypatch):
    parted = []
    collapse = bvh_cuda._collapse
    monkeypatch.setattr(bvh_cuda, "_collapse", lambda *a, **k: parted.append(k) or collapse(*a, **k))
    assert build(CASES["doubling"]()).depth <= MAX_LEVELS
    assert parted == [{"evenly": False}, {"evenly": True}]


def test_binary_tree_storage_grows(monkeypatch):
    """The binary tree grows from any initial size."""
    given = CASES["soup"]()
    expected = build(given)
    room = bvh_cuda._Splitter._new_binary
    small = [5]
    monkeypatch.setattr(
        bvh_cuda._Splitter, "_new_binary", lambda self, nodes: room(self, small.pop() if small else nodes)
    )
    bvh_checks.assert_equal(build(given), expected)


def test_host_reads_level_counts_rarely(monkeypatch):
    """Each query waits for the GPU: at most one per 16 levels of ranges and four levels of nodes."""
    given, asked = CASES["blobs_77k"](), []
    numpy = wp.array.numpy
    monkeypatch.setattr(wp.array, "numpy", lambda self: asked.append(self.shape[0]) or numpy(self))
    tree = build(given)
    assert tree.depth == 4
    assert len(asked) <= 6
    assert max(asked) <= ranges_cuda.MAX_DEPTH + 2


def test_too_many_triangles_raise():
    with pytest.raises(SceneError, match=r"at most 1 levels holds 1024 triangles, got 3000$"):
        arrays = CASES["soup"]()
        given = arrays.vertices, arrays.faces, arrays.owner, arrays.closed
        bvh_cuda.build_device_bvh(*given, wp.get_device("cpu"), max_levels=1)


def exponents():
    """Return triangles of all magnitudes of single precision, whose binary tree would exceed the maximum depth."""
    return bvh_checks.soup(
        2.0 ** np.linspace(-60, 59, 3000)[:, None, None] * [[1, -0.1, -0.1], [1, 0.1, -0.1], [1, 0, 0.1]]
    )


@pytest.mark.smoke("soup", "identical", "one leaf")
@pytest.mark.parametrize(
    ("make", "halves"),
    [
        (CASES["16"], False),
        (CASES["soup"], False),
        (lambda: bvh_checks.soup(np.repeat(bvh_checks.random_triangles(1), 700, axis=0)), True),
        (exponents, True),
    ],
    ids=["one leaf", "soup", "identical", "exponents"],
)
def test_every_kernel_matches_its_reference(monkeypatch, make, halves):
    given, checks = make(), Checks()
    monkeypatch.setattr(bvh_cuda, "launch", checks(bvh_cuda.launch))
    build(given)
    assert (checks.halved > 0) == halves
    if len(given.faces) > 32:
        assert {name for name in vars(Checks) if not name.startswith("_")} == checks.seen


@pytest.mark.parametrize("share", [False, True])
@pytest.mark.parametrize("names", [["room"], ["soup", "room", "one", "slivers"]], ids=str)
def test_trees_are_joined_equally_on_device_and_host(names, share, device):
    """The result matches the reference; trees that must not share their arrays are unchanged."""
    inputs = [CASES[name]() for name in names]
    closed = [np.arange(given.owner.max() + 1) % 2 == 0 for given in inputs]
    trees = [build(given, device) for given in inputs]
    before = [tree.owners.numpy().copy() for tree in trees]
    joined = SimpleNamespace()
    geometry._join_on_device(joined, trees, closed, wp.get_device(device), share=share)
    nodes, leaves = geometry.first_places(trees)
    for name in ("leaves", "nodes"):
        whole = np.concatenate([getattr(tree, name).numpy() for tree in trees])
        np.testing.assert_array_equal(getattr(joined, name).numpy(), whole)
    owners = [reference.mark_owners(part, flags) for part, flags in zip(before, closed, strict=True)]
    np.testing.assert_array_equal(joined.owners.numpy(), np.concatenate(owners))
    kept = [tree.children.numpy() for tree in trees]
    children = [reference.join_children(*part) for part in zip(kept, nodes, leaves, strict=True)]
    np.testing.assert_array_equal(joined.children.numpy(), np.concatenate(children))
    if len(trees) > 1 or not share:
        assert all((tree.owners.numpy() == part).all() for tree, part in zip(trees, before, strict=True))


def test_moved_children_match_the_reference(device):
    children = build(CASES["room"]()).children.numpy()
    for made in (wp.array(children, device=device), wp.array(children, device="cpu")):
        if made.device.is_cpu:
            wp.launch(join_children, dim=len(made), inputs=[70, 9, made], device="cpu")
            again = wp.array(children, device="cpu")
            geometry.move_children(again, 70, 9)
            np.testing.assert_array_equal(again.numpy(), made.numpy())
        else:
            geometry.move_children(made, 70, 9)
        np.testing.assert_array_equal(made.numpy(), reference.join_children(children, 70, 9))
