# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The BVH that a GPU builds: what holds of the host's tree holds of it, and every kernel does what its twin does.

Warp runs the same kernels on a CPU.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import test_bvh
import warp as wp

from warpvis.errors import SceneError
from warpvis.kernels import bvh_cuda_ranges
from warpvis.kernels.bvh_cuda_nodes import join_children
from warpvis.scene import _bvh_cuda, _joined_trees
from warpvis.scene._bvh import Bvh

import reference

CASES = test_bvh.CASES
MOST_LEVELS = 8


def build(given, device="cpu", most_levels=MOST_LEVELS) -> Bvh:
    arrays = given.vertices, given.faces, given.owner, given.closed
    return _bvh_cuda.build_device_bvh(_bvh_cuda.DeviceMesh.of(*arrays, wp.get_device(device)), most_levels=most_levels)


def areas(tree: Bvh) -> tuple[float, float]:
    """Of the boxes of all leaves, and of all nodes but the root, together."""
    nodes = tree.nodes.numpy().reshape(-1, 10, tree.lanes).astype(np.float64).swapaxes(1, 2)
    children = tree.children.numpy().reshape(-1, tree.lanes)
    area = reference.half_area(nodes[..., :3], nodes[..., 3:6])
    return area[children < 0].sum(), area[children > 0].sum()


@pytest.mark.parametrize("name", CASES)
def test_the_tree_holds_all_triangles_and_its_bounds_hold_what_is_below(name, device):
    given = CASES[name]()
    tree = build(given, device)
    test_bvh.test_every_triangle_is_there_once_and_unchanged((given, tree))
    test_bvh.test_boxes_and_cones_hold_what_is_below((given, tree))
    assert tree.depth <= MOST_LEVELS
    if len(given.faces) >= 1000:
        assert len(given.faces) / tree.leaf_count >= 0.65 * tree.lanes
        assert tree.bytes_per_triangle < 100


@pytest.mark.parametrize("name", ["soup", "room", "blobs_77k", "slivers", "row", "huge"])
def test_the_tree_is_as_good_as_the_hosts(name, device):
    """What a random ray visits, which is in proportion to area, is at most 3 % more."""
    given = CASES[name]()
    for ours, theirs in zip(areas(build(given, device)), areas(given.build(lanes=32)), strict=True):
        assert ours <= 1.03 * theirs


def test_the_tree_is_the_same_in_every_run(device):
    given = CASES["blobs_77k"]()
    first, other = build(given, device), build(given, device)
    for name in test_bvh.ARRAYS:
        assert getattr(first, name).numpy().tobytes() == getattr(other, name).numpy().tobytes()


def test_a_tree_that_would_be_too_deep_is_parted_evenly(monkeypatch):
    parted = []
    collapse = _bvh_cuda._collapse
    monkeypatch.setattr(_bvh_cuda, "_collapse", lambda *a, **k: parted.append(k) or collapse(*a, **k))
    assert build(CASES["doubling"]()).depth <= MOST_LEVELS
    assert parted == [{"evenly": False}, {"evenly": True}]


def test_the_binary_tree_has_room_for_leaves_that_are_all_but_empty(monkeypatch):
    """It grows, whatever its size was at first."""
    given = CASES["soup"]()
    expected = build(given)
    room = _bvh_cuda._Splitter._new_binary
    small = [5]
    monkeypatch.setattr(
        _bvh_cuda._Splitter, "_new_binary", lambda self, nodes: room(self, small.pop() if small else nodes)
    )
    test_bvh.assert_equal(build(given), expected)


def test_the_host_asks_for_levels_only_where_they_may_be_the_last(monkeypatch):
    """Each time it waits for the GPU: of 16 levels of ranges and of four levels of nodes, for few."""
    given, asked = CASES["blobs_77k"](), []
    numpy = wp.array.numpy
    monkeypatch.setattr(wp.array, "numpy", lambda self: asked.append(self.shape[0]) or numpy(self))
    tree = build(given)
    assert tree.depth == 4
    assert len(asked) <= 6
    assert max(asked) <= bvh_cuda_ranges.MOST_DEPTH + 2


def test_more_triangles_than_a_tree_holds_are_refused():
    mesh = _bvh_cuda.DeviceMesh(*(SimpleNamespace(device=None, __len__=None) for _ in range(4)))
    with pytest.raises(SceneError, match=r"at most 1 levels holds 1024 triangles, got 3000$"):
        arrays = CASES["soup"]()
        mesh = _bvh_cuda.DeviceMesh.of(arrays.vertices, arrays.faces, arrays.owner, arrays.closed, wp.get_device("cpu"))
        _bvh_cuda.build_device_bvh(mesh, most_levels=1)


def snapshot(value):
    """What an argument of a launch holds now."""
    if isinstance(value, wp.array):
        return np.array(value.numpy()) if value.size else np.zeros(value.shape, dtype=wp.dtype_to_numpy(value.dtype))
    if hasattr(value, "_cls"):
        kind = Level if value._cls.key == "Level" else SimpleNamespace
        return kind(**{name: snapshot(getattr(value, name)) for name in value._cls.vars})
    return value


class Recorded:
    """A launch that is made when it is asked for."""

    def __init__(self, run, dim, inputs):
        self._run, self._dim, self._inputs = run, dim, list(inputs)

    def set_dim(self, dim):
        self._dim = dim

    def set_param_at_index(self, index, value):
        self._inputs[index] = value

    def launch(self):
        self._run(self._dim, self._inputs)


class Level(SimpleNamespace):
    """A level, with names for what is known of it."""

    row = property(lambda self: self.info[self.depth + 1])
    first = property(lambda self: self.row[bvh_cuda_ranges.FIRST])
    count = property(lambda self: self.row[bvh_cuda_ranges.COUNT])
    large_count = property(lambda self: self.row[bvh_cuda_ranges.LARGE])
    ranges = property(lambda self: self.row[bvh_cuda_ranges.RANGES])
    next = property(lambda self: self.row[bvh_cuda_ranges.NEXT])


class Checks:
    """Compares what every launch of a build did with the kernel's twin."""

    def __init__(self):
        self.seen, self.halved = set(), 0

    def __call__(self, launch):
        def checked(kernel, dim, inputs, device, *, record_cmd=False):
            recorded = Recorded(lambda dim, inputs: self._run(launch, kernel, dim, inputs, device), dim, inputs)
            return recorded if record_cmd else recorded.launch()

        return checked

    def _run(self, launch, kernel, dim, inputs, device):
        names = list(kernel.adj.arg_types)
        given = SimpleNamespace(**dict(zip(names, map(snapshot, inputs), strict=True)))
        launch(kernel, dim, inputs, device)
        made = SimpleNamespace(**dict(zip(names, map(snapshot, inputs), strict=True)))
        check = getattr(self, kernel.key, None)
        if check:
            self.seen.add(kernel.key)
            check(dim, given, made)

    def load_items(self, dim, given, made):
        boxes = reference.load_items(given.vertices, given.faces)
        np.testing.assert_array_equal(np.hstack([made.items_out.low, made.items_out.high]), boxes)
        np.testing.assert_array_equal(made.items_out.triangle, np.arange(dim))
        assert (made.items_out.node == (0 if dim > 32 else -1)).all()

    def bound_centres(self, dim, given, made):
        self.box = reference.bound_centres(given.items.low, given.items.high)

    def begin_tree(self, dim, given, made):
        tree = made.binary_out
        assert (tree.begin[0], tree.end[0], tree.child[0]) == reference.begin_tree(given.item_count)
        np.testing.assert_allclose(np.concatenate([tree.low[0], tree.high[0]]), self.box, rtol=1e-6)
        np.testing.assert_array_equal(made.info_out[0, [bvh_cuda_ranges.NEXT, bvh_cuda_ranges.NEXT_COUNT]], [0, 1])

    def mark_ranges(self, dim, given, made):
        *_, first, count = given.level.info[given.level.depth]
        counts = np.zeros(dim, dtype=int)
        counts[:count] = (given.binary.end - given.binary.begin)[first : first + count]
        np.testing.assert_array_equal(made.flags_out, reference.mark_ranges(counts))

    def rank_ranges(self, dim, given, made):
        tree, level = made.binary_out, made.level_out
        np.testing.assert_array_equal(level.row, reference.count_ranges(level.info[level.depth], given.sums[:, -1]))
        here = slice(level.first, level.first + level.count)
        order = level.first + reference.rank_ranges((tree.end - tree.begin)[here])
        np.testing.assert_array_equal(level.nodes[: level.ranges], order)
        np.testing.assert_array_equal(tree.child[order], level.next + 2 * np.arange(len(order)))
        assert (level.best[: level.ranges - level.large_count] == 2**63 - 1).all()
        self.nodes = order

    def clear_bins(self, dim, given, made):
        boxes, counts = reference.clear_bins(dim)
        np.testing.assert_array_equal(self._boxes(made.boxes_out[:dim]), boxes)
        np.testing.assert_array_equal(made.counts_out[:dim], counts)

    def _large(self, given):
        """The items and the grid of each large range."""
        tree = given.binary
        for rank, node in enumerate(self.nodes[: given.level.large_count]):
            inside = slice(tree.begin[node], tree.end[node])
            yield rank, node, given.items.low[inside], given.items.high[inside], (tree.low[node], tree.high[node])

    @staticmethod
    def _boxes(words):
        ordered = np.where(words < 0, words ^ 0x7FFFFFFF, words).astype(np.int32).view(np.float32).astype(np.float64)
        ordered = np.where(ordered == np.float32(3e38), np.inf, ordered)
        return np.concatenate([ordered[..., :3], -ordered[..., 3:]], axis=-1)

    def _bins(self, boxes, counts, level):
        shape = (level.large_count, 3, reference.BINS)
        used = np.prod(shape)
        return self._boxes(boxes[:used]).reshape(*shape, 6), counts[:used].reshape(shape)

    def fill_bins(self, dim, given, made):
        boxes, counts = self._bins(made.boxes_out, made.counts_out, given.level)
        for rank, _, low, high, grid in self._large(given):
            for one, other in zip(reference.fill_bins(low, high, grid), (boxes[rank], counts[rank]), strict=True):
                np.testing.assert_array_equal(one, other)

    def choose_bins(self, dim, given, made):
        tree, level = made.binary_out, made.level_out
        boxes, numbers = self._bins(given.boxes, given.counts, level)
        for rank, (box, counts) in enumerate(zip(boxes, numbers, strict=True)):
            node = level.nodes[rank]
            begin, end, child = tree.begin[node], tree.end[node], tree.child[node]
            middle = begin + level.left_count[rank]
            costs = reference.choose_bins(box, counts)
            assert (tree.child[child : child + 2] == -1).all()
            assert [*tree.begin[child : child + 2], *tree.end[child : child + 2]] == [begin, middle, middle, end]
            if reference.must_halve(end - begin, level.depth) or not np.isfinite(costs).any():
                assert (level.axis[rank], middle - begin) == (3, reference.half_of(end - begin))
                self.halved += 1
                continue
            axis, cell = level.axis[rank], level.bin[rank]
            assert costs[axis, cell] <= costs.min() * (1 + 1e-5)
            assert middle - begin == counts[axis, :cell].sum()
            for side, bins in enumerate((box[axis, :cell], box[axis, cell:])):
                low, high = bins[:, :3].min(axis=0), bins[:, 3:].max(axis=0)
                assert tree.area[child + side] == pytest.approx(reference.half_area(low, high), rel=1e-5)
                np.testing.assert_array_equal(tree.low[child + side], np.maximum(tree.low[node], 2 * low))
                np.testing.assert_array_equal(tree.high[child + side], np.minimum(tree.high[node], 2 * high))

    def _small(self, given):
        tree, level = given.binary, given.level
        for rank, node in enumerate(self.nodes[level.large_count :]):
            yield rank, slice(tree.begin[node], tree.end[node])

    def sort_small(self, dim, given, made):
        for _, inside in self._small(given):
            for axis in range(3):
                places = reference.sort_small(given.items.low[inside], given.items.high[inside], axis)
                np.testing.assert_array_equal(made.order_out[axis, inside][places], np.arange(dim)[inside])

    def choose_places(self, dim, given, made):
        for rank, inside in self._small(given):
            best = int(made.best_out[rank])
            axis, left, count = best & 3, (best & 0xFFFFFFFF) >> 2, inside.stop - inside.start
            if reference.must_halve(count, given.level.depth):
                assert (axis, left) == (3, reference.half_of(count))
                self.halved += 1
                continue
            costs = reference.choose_places(given.items.low[inside], given.items.high[inside])
            assert costs[axis, left - 1] <= costs.min() * (1 + 1e-5) + 1e-30
            assert np.int32(best >> 32).view(np.float32) == pytest.approx(costs.min(), rel=1e-5, abs=1e-29)

    def find_sides(self, dim, given, made):
        level, rest = given.level, np.ones(dim, dtype=bool)
        for rank, node, low, high, grid in self._large(given):
            inside = slice(given.binary.begin[node], given.binary.end[node])
            if level.axis[rank] == 3:
                expected = np.arange(len(low)) < level.left_count[rank]
            else:
                expected = reference.find_sides(low, high, grid, level.axis[rank], level.bin[rank])
            np.testing.assert_array_equal(made.left_out[inside], expected)
            rest[inside] = False
        assert (made.left_out[rest] == 0).all()

    def move_items(self, dim, given, made):
        order = np.arange(dim)
        for _, node, *_ in self._large(given):
            inside = slice(given.binary.begin[node], given.binary.end[node])
            order[inside] = inside.start + reference.move_items(given.lefts[inside])
        for rank, inside in self._small(given):
            if (axis := int(given.level.best[rank]) & 3) < 3:
                order[inside] = given.order[axis, inside]
        for name in ("low", "high", "triangle"):
            np.testing.assert_array_equal(getattr(made.items_out, name), getattr(given.items, name)[order])

    def part_small(self, dim, given, made):
        tree, level = made.binary_out, given.level
        for rank in range(level.ranges - level.large_count):
            node = level.nodes[level.large_count + rank]
            left, inside = (int(level.best[rank]) & 0xFFFFFFFF) >> 2, slice(tree.begin[node], tree.end[node])
            child = tree.child[node]
            assert tree.end[child] == tree.begin[child + 1] == inside.start + left
            assert (tree.begin[child], tree.end[child + 1]) == (inside.start, inside.stop)
            boxes = reference.part_small(given.items.low[inside], given.items.high[inside], left)
            for side, box in enumerate(boxes):
                assert tree.area[child + side] == pytest.approx(reference.half_area(box[:3], box[3:]), rel=1e-5)

    def find_costs(self, dim, given, made):
        if given.evenly:
            inner = given.first + np.flatnonzero(given.binary.child[given.first : given.first + dim[0]] >= 0)
            np.testing.assert_allclose(made.costs_out[inner], np.tile(1 / np.arange(1, 33), (len(inner), 1)), rtol=1e-6)
            return
        nodes = len(made.costs_out)
        expected = reference.find_costs(given.binary.child[:nodes], given.binary.area[:nodes], given.first)
        here = given.first + np.flatnonzero(given.binary.child[given.first : given.first + dim[0]] >= 0)
        np.testing.assert_allclose(made.costs_out[here], expected[here], rtol=1e-5, atol=1e-27)

    def open_nodes(self, dim, given, made):
        child, opened = given.binary.child, made.opened_out
        size, both = opened.info[opened.depth, 1], opened.counts[: 2 * dim].reshape(2, dim)
        assert opened.most == dim >= size
        assert (both[:, size:] == 0).all()
        nodes = opened.nodes[opened.depth % 2, :size]
        for node, parts, counts in zip(nodes, opened.parts[:size], both.T[:size], strict=True):
            used = parts[parts >= 0]
            np.testing.assert_array_equal(parts[len(used) :], -1)
            inner = child[used] >= 0
            np.testing.assert_array_equal(counts, [inner.sum(), (~inner).sum()])
            places = [given.binary.begin[used], given.binary.end[used]]
            np.testing.assert_array_equal(places[0][1:], places[1][:-1])
            assert (places[0][0], places[1][-1]) == (given.binary.begin[node], given.binary.end[node])
            if child[node] >= 0:
                costs = np.where((child[: len(given.costs)] >= 0)[:, None], given.costs, 0)
                total = costs[used[inner], 0].sum(dtype=np.float64)
                assert total <= reference.open_nodes(child, costs, node) * (1 + 1e-4) + 1e-25 or costs[node, 1] == 0.5

    def name_children(self, dim, given, made):
        opened = given.opened_out
        first, size, first_leaf = opened.info[opened.depth]
        parts = opened.parts[:size]
        is_leaf = given.binary.child[np.maximum(parts, 0)] < 0
        expected = reference.name_children(parts, is_leaf, first + size, first_leaf)
        np.testing.assert_array_equal(made.children_out[first : first + size], expected)
        leaves, inner = (parts[(parts >= 0) & kind] for kind in (is_leaf, ~is_leaf))
        ranges = made.leaf_ranges_out[first_leaf : first_leaf + len(leaves)]
        np.testing.assert_array_equal(ranges.T, [given.binary.begin[leaves], given.binary.end[leaves]])
        np.testing.assert_array_equal(made.opened_out.nodes[1 - opened.depth % 2, : len(inner)], inner)
        below = [first + size, len(inner), first_leaf + len(leaves)]
        np.testing.assert_array_equal(made.opened_out.info[opened.depth + 1], below)

    def fit_leaves(self, dim, given, made):
        corners = given.leaves.swapaxes(1, 2).reshape(-1, 32, 3, 3)
        for node, lane in np.argwhere(given.children < 0):
            leaf = ~given.children[node, lane]
            row = made.nodes_out[node, :, lane].astype(np.float64)
            places = corners[leaf].reshape(-1, 3)
            np.testing.assert_array_equal(row[:6], np.concatenate([places.min(axis=0), places.max(axis=0)]))
            _, normals = reference.fit_nodes(places, np.arange(96).reshape(-1, 3))
            if row[9] < 2:
                assert row[9] >= reference.fit_leaves(normals, row[6:9])


def exponents():
    """Triangles of all sizes that single precision has: their binary tree would be deeper than any may be."""
    return test_bvh.soup(
        2.0 ** np.linspace(-60, 59, 3000)[:, None, None] * [[1, -0.1, -0.1], [1, 0.1, -0.1], [1, 0, 0.1]]
    )


@pytest.mark.parametrize(
    ("make", "halves"),
    [
        (CASES["16"], False),
        (CASES["soup"], False),
        (lambda: test_bvh.soup(np.repeat(test_bvh.random_triangles(1), 700, axis=0)), True),
        (exponents, True),
    ],
    ids=["one leaf", "soup", "identical", "exponents"],
)
def test_every_kernel_does_what_its_twin_does(monkeypatch, make, halves):
    given, checks = make(), Checks()
    monkeypatch.setattr(_bvh_cuda, "launch", checks(_bvh_cuda.launch))
    build(given)
    assert (checks.halved > 0) == halves
    if len(given.faces) > 32:
        assert {name for name in vars(Checks) if not name.startswith("_")} == checks.seen


@pytest.mark.parametrize("share", [False, True])
@pytest.mark.parametrize("names", [["room"], ["soup", "room", "one", "slivers"]], ids=str)
def test_trees_are_joined_on_a_device_as_on_the_host(names, share, device):
    """And by their twins; those that may not give their arrays keep what they hold."""
    inputs = [CASES[name]() for name in names]
    closed = [np.arange(given.owner.max() + 1) % 2 == 0 for given in inputs]
    trees = [build(given, device) for given in inputs]
    before = [tree.owners.numpy().copy() for tree in trees]
    joined = SimpleNamespace()
    _joined_trees._join_on_device(joined, trees, closed, wp.get_device(device), share=share)
    nodes, leaves = (first(trees) for first in (_joined_trees.first_nodes, _joined_trees.first_leaves))
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


def test_children_are_moved_as_by_the_twin(device):
    children = build(CASES["room"]()).children.numpy()
    for made in (wp.array(children, device=device), wp.array(children, device="cpu")):
        if made.device.is_cpu:
            wp.launch(join_children, dim=len(made), inputs=[70, 9, made], device="cpu")
            again = wp.array(children, device="cpu")
            _joined_trees.move_children(again, 70, 9)
            np.testing.assert_array_equal(again.numpy(), made.numpy())
        else:
            _joined_trees.move_children(made, 70, 9)
        np.testing.assert_array_equal(made.numpy(), reference.join_children(children, 70, 9))
