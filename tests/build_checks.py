# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison of every kernel launch of a CUDA tree build with the kernel's reference."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from warpvis.kernels.bvh import ranges_cuda

import reference


def snapshot(value):
    """Return a copy of a launch argument's current value."""
    if isinstance(value, wp.array):
        return np.array(value.numpy()) if value.size else np.zeros(value.shape, dtype=wp.dtype_to_numpy(value.dtype))
    if hasattr(value, "_cls"):
        kind = Level if value._cls.key == "Level" else SimpleNamespace
        return kind(**{name: snapshot(getattr(value, name)) for name in value._cls.vars})
    return value


class Recorded:
    """Stand-in for a recorded launch command."""

    def __init__(self, run, dim, inputs):
        self._run, self._dim, self._inputs = run, dim, list(inputs)

    def set_dim(self, dim):
        self._dim = dim

    def set_param_at_index(self, index, value):
        self._inputs[index] = value

    def launch(self):
        self._run(self._dim, self._inputs)


class Level(SimpleNamespace):
    """A level of the tree, with named fields of its row of information."""

    row = property(lambda self: self.info[self.depth + 1])
    first = property(lambda self: self.row[ranges_cuda.FIRST])
    count = property(lambda self: self.row[ranges_cuda.COUNT])
    large_count = property(lambda self: self.row[ranges_cuda.LARGE])
    ranges = property(lambda self: self.row[ranges_cuda.RANGES])
    next = property(lambda self: self.row[ranges_cuda.NEXT])


class Checks:
    """Compares the result of every launch of a build with the kernel's reference."""

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

    def bound_centers(self, dim, given, made):
        self.box = reference.bound_centers(given.items.low, given.items.high)

    def begin_tree(self, dim, given, made):
        tree = made.binary_out
        assert (tree.begin[0], tree.end[0], tree.child[0]) == reference.begin_tree(given.item_count)
        np.testing.assert_allclose(np.concatenate([tree.low[0], tree.high[0]]), self.box, rtol=1e-6)
        np.testing.assert_array_equal(made.info_out[0, [ranges_cuda.NEXT, ranges_cuda.NEXT_COUNT]], [0, 1])

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
        assert (level.best[: level.ranges] == 2**63 - 1).all()
        self.nodes = order

    def clear_bins(self, dim, given, made):
        boxes, counts = reference.clear_bins(dim)
        np.testing.assert_array_equal(self._boxes(made.boxes_out[:dim]), boxes)
        np.testing.assert_array_equal(made.counts_out[:dim], counts)

    def _large(self, given):
        """Return the items and the grid of each large range."""
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
        boxes, numbers = self._bins(given.boxes, given.counts, given.level)
        for rank, (box, counts) in enumerate(zip(boxes, numbers, strict=True)):
            costs, best = reference.choose_bins(box, counts), int(made.best_out[rank])
            if reference.must_halve(counts[0].sum(), given.level.depth) or not np.isfinite(costs).any():
                assert best == 2**63 - 1
                continue
            assert costs.ravel()[best & 0xFFFFFFFF] <= costs.min() * (1 + 1e-5)
            assert np.int32(best >> 32).view(np.float32) == pytest.approx(costs.min(), rel=1e-5, abs=1e-29)

    def part_bins(self, dim, given, made):
        tree, level = made.binary_out, made.level_out
        boxes, numbers = self._bins(given.boxes, given.counts, level)
        for rank, (box, counts) in enumerate(zip(boxes, numbers, strict=True)):
            node, best = level.nodes[rank], int(level.best[rank])
            begin, end, child = tree.begin[node], tree.end[node], tree.child[node]
            middle = begin + level.left_count[rank]
            assert (tree.child[child : child + 2] == -1).all()
            assert [*tree.begin[child : child + 2], *tree.end[child : child + 2]] == [begin, middle, middle, end]
            if best == 2**63 - 1:
                assert (level.axis[rank], middle - begin) == (3, reference.half_of(end - begin))
                assert (tree.area[child : child + 2] == tree.area[node]).all()
                self.halved += 1
                continue
            axis, cell = level.axis[rank], level.bin[rank]
            assert axis * reference.BINS + cell == best & 0xFFFFFFFF
            assert middle - begin == counts[axis, :cell].sum()
            for side, ends in enumerate(reference.part_bins(box[axis], cell)):
                low, high = ends[:3], ends[3:]
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
            best = int(made.best_out[given.level.large_count + rank])
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
            if (axis := int(given.level.best[given.level.large_count + rank]) & 3) < 3:
                order[inside] = given.order[axis, inside]
        for name in ("low", "high", "triangle"):
            np.testing.assert_array_equal(getattr(made.items_out, name), getattr(given.items, name)[order])

    def part_small(self, dim, given, made):
        tree, level = made.binary_out, given.level
        for rank in range(level.ranges - level.large_count):
            node = level.nodes[level.large_count + rank]
            left, inside = (
                (int(level.best[level.large_count + rank]) & 0xFFFFFFFF) >> 2,
                slice(tree.begin[node], tree.end[node]),
            )
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
        assert opened.max_nodes == dim >= size
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
