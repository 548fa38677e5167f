# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The wide BVH built on CUDA, level by level; the host reads only the number of ranges to split."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import aligned_empty
from warpvis.core.kernel_cache import launch
from warpvis.kernels.bvh import (
    build_cuda,
    nodes_cuda as node_kernels,
    ranges_cuda,
)
from warpvis.kernels.constants import CUDA_LANES, LEAF_ROWS, NODE_ROWS
from warpvis.scene.acceleration.bvh import Bvh, check_leaves, check_size

_BINS = 3 * ranges_cuda.BINS  # of a range
# Threads that reduce the box around all items: few contend for it. Minimum number of items per thread that fills bins,
# and maximum number of parts: enough threads to occupy a GPU, few atomic collisions.
_BOUNDING_THREADS = 1 << 14
_MIN_PART, _MAX_PARTS = 64, 1 << 15
# Below this number of triangles, the CPU builds a tree faster than a GPU.
_MIN_TRIANGLES = 30_000


def builds_on(device: wp.Device, triangles: int) -> bool:
    """Return whether a device builds a tree of this number of triangles itself."""
    return not device.is_cpu and triangles >= _MIN_TRIANGLES


class _Mesh(NamedTuple):
    """Triangles on a device."""

    vertices: wp.array
    """Corners, vec3."""
    faces: wp.array
    """Corner indices, int32 of shape ``(m, 3)``."""
    owner: wp.array
    """Object indices of the triangles, int32 of shape ``(m,)``."""
    closed: wp.array
    """Whether an object's back faces can be culled, uint8 of shape ``(objects,)``."""


def build_device_bvh(
    vertices: NDArray[np.float32] | wp.array,
    faces: NDArray[np.int32] | wp.array,
    owner: NDArray[np.int32] | wp.array,
    closed: NDArray[np.bool_] | wp.array,
    device: wp.Device,
    *,
    max_levels: int,
) -> Bvh:
    """Build a tree of 32 lanes and at most `max_levels` levels (8 or more) on a device; see `build_bvh` for the arrays.

    They are all on the host or all on the device. Only the number of ranges and nodes per level is copied to the host.
    """
    check_size(len(faces), CUDA_LANES, max_levels)

    def load(array: np.ndarray | wp.array, dtype: Any) -> wp.array:
        return array if isinstance(array, wp.array) else wp.array(array, dtype=dtype, device=device)

    mesh = _Mesh(load(vertices, wp.vec3), load(faces, wp.int32), load(owner, wp.int32), load(closed, wp.uint8))
    items, binary, levels = _Splitter(mesh).split()
    nodes = _collapse(binary, levels, evenly=False)
    if nodes.depth > max_levels:
        nodes = _collapse(binary, levels, evenly=True)
    return _fill(mesh, items, nodes)


class _Nodes(NamedTuple):
    children: wp.array
    leaf_ranges: wp.array
    levels: list[tuple[int, int]]
    """The first node and the number of nodes of each level."""
    leaf_count: int

    @property
    def depth(self) -> int:
        return len(self.levels)

    @property
    def node_count(self) -> int:
        return sum(self.levels[-1])


class _Splitter:
    """Splits the triangles of a mesh into a binary tree, whose leaves are ranges of at most 32 triangles.

    Launches are recorded once for each direction between the two item arrays: packing the arguments of a launch takes
    longer than many launches run.
    """

    def __init__(self, mesh: _Mesh) -> None:
        """Create the items and the root."""
        self._device, self._count = mesh.vertices.device, len(mesh.faces)
        self._items = [self._new_items()]
        box = self._load(mesh)
        # The remaining buffers are allocated while the GPU is busy.
        self._items.append(self._new_items())
        self._lefts, self._before = (self._integers(self._count) for _ in range(2))
        self._order = self._integers((3, self._count))
        # Leaves are usually at least three quarters full; otherwise the buffer grows later.
        self._binary = self._new_binary(self._count // 8 + 64)
        # The maximum number of ranges that are not leaves, and of those that are large.
        ranges, large = (self._count // (leaf_size + 1) + 1 for leaf_size in (CUDA_LANES, ranges_cuda.SMALL))
        self._flags, self._sums = (self._integers((2, 2 * ranges)) for _ in range(2))
        self._flat = self._flags.flatten(), self._sums.flatten()
        self._level = self._new_level(ranges)
        self._max_ranges = large, ranges
        bins = _BINS * large
        self._bins = self._integers((bins, ranges_cuda.BIN_WORDS)), self._integers(bins)
        self._rows: list[list[int]] = []
        launch(ranges_cuda.begin_tree, 1, [box, self._count, self._level.info, self._binary], self._device)
        self._record()

    def split(self) -> tuple[Any, Any, list[tuple[int, int]]]:
        """Return the items in the order of the leaves, the binary tree, and each level's first node and node count."""
        depth = 0
        while any(counts := self._next_level(depth)):
            self._split_level(depth % 2, *counts)
            depth += 1
        return self._items[depth % 2], self._binary, [(first, count) for first, count, *_ in self._rows]

    def _load(self, mesh: _Mesh) -> wp.array:
        """Fill the first item array, and return the box around the items' centers."""
        words = self._integers((1, ranges_cuda.BIN_WORDS))
        words.fill_(ranges_cuda.NOTHING)
        threads = min(self._count, _BOUNDING_THREADS)
        launch(ranges_cuda.load_items, self._count, [mesh.vertices, mesh.faces, self._items[0]], self._device)
        launch(ranges_cuda.bound_centers, threads, [self._items[0], threads, words], self._device)
        return words

    def _record(self) -> None:
        """Record the launches of a level with threads for the maximum number of ranges; most levels have fewer.

        They read `Level.depth` when launched. Setting the number of threads takes as long as a launch.
        """
        kernels, level, binary, bins = build_cuda, self._level, self._binary, self._bins

        def record(kernel: wp.Kernel, dim: int | tuple[int, int], *inputs: Any) -> Any:
            return launch(kernel, dim, list(inputs), self._device, record_cmd=True)

        (large, ranges), flags = self._max_ranges, self._flags.shape
        self._mark = record(kernels.mark_ranges, flags[1], binary, level, self._flags)
        self._rank = record(kernels.rank_ranges, flags, self._flags, self._sums, level, binary)
        self._clear = record(kernels.clear_bins, 1, *bins)
        self._choose = record(kernels.choose_bins, (3, large), *bins, binary, level, level.best)
        self._part_large = record(kernels.part_bins, (2, large), *bins, level, binary)
        self._fill, self._sort, self._place, self._side, self._move, self._part = ([] for _ in range(6))
        length = max(_MIN_PART, -(-self._count // _MAX_PARTS))
        parts = -(-self._count // length), ranges_cuda.BINS
        moving = self._lefts, self._before, self._order
        for items, moved in (self._items, self._items[::-1]):
            state = items, binary, level
            self._fill.append(record(kernels.fill_bins, parts, *state, length, *bins))
            self._sort.append(record(kernels.sort_small, self._count, *state, self._order))
            # The destination of the items is still unused and serves as scratch for areas.
            areas = wp.array(ptr=moved.low.ptr, dtype=wp.float32, shape=(3, self._count), device=self._device)
            placing = self._order, areas, level.best
            self._place.append(record(kernels.choose_places, (3, ranges), *state, *placing))
            self._side.append(record(kernels.find_sides, self._count, *state, self._lefts))
            self._move.append(record(kernels.move_items, self._count, *state, *moving, moved))
            self._part.append(record(kernels.part_small, ranges, moved, level, binary))

    def _next_level(self, depth: int) -> tuple[int, int]:
        """Find the ranges of a level that are split, and return the maximum numbers of large and of small ones."""
        self._level.depth = depth
        self._mark.launch()
        wp.utils.array_scan(*self._flat)
        self._rank.launch()
        nodes = 1 << depth
        if nodes * CUDA_LANES < self._count and 4 * nodes <= len(self._binary.begin):
            # These leaves cannot hold all items, and the buffer suffices for any split: no need to read counts.
            return min(nodes, self._max_ranges[0]), min(nodes, self._max_ranges[1])
        # Read the counts of all levels so far, which follow the entry above the root; this synchronizes.
        self._rows = self._level.info.numpy()[1 : depth + 2].tolist()
        first, count, large, ranges, *_ = self._rows[-1]
        self._grow(first + count + 2 * ranges)
        return large, ranges - large

    def _split_level(self, way: int, large: int, small: int) -> None:
        """Split at most this number of large and small ranges, and move the items."""
        if large:
            self._clear.set_dim(large * _BINS)
            self._clear.launch()
            self._fill[way].launch()
            self._choose.launch()
            self._part_large.launch()
        if small:
            self._sort[way].launch()
            self._place[way].launch()
        if large:
            self._side[way].launch()
            wp.utils.array_scan(self._lefts, self._before, inclusive=False)
        self._move[way].launch()
        if small:
            self._part[way].launch()

    def _grow(self, nodes: int) -> None:
        """Resize the binary tree to at least this number of nodes."""
        old = self._binary
        if nodes <= len(old.begin):
            return
        self._binary = self._new_binary(max(nodes, 2 * len(old.begin)))
        for name in ("begin", "end", "child", "area", "low", "high"):
            wp.copy(getattr(self._binary, name), getattr(old, name), count=len(old.begin))
        self._record()

    def _integers(self, shape: int | tuple[int, ...]) -> wp.array:
        return wp.empty(shape, dtype=wp.int32, device=self._device)

    def _new_level(self, ranges: int) -> Any:
        level = ranges_cuda.Level()
        level.info = self._integers((ranges_cuda.MAX_DEPTH + 2, ranges_cuda.INFO_WORDS))
        level.nodes, level.axis, level.bin, level.left_count = (self._integers(ranges) for _ in range(4))
        level.best = wp.empty(ranges, dtype=wp.int64, device=self._device)
        return level

    def _new_items(self) -> Any:
        items = ranges_cuda.Items()
        items.low, items.high = (wp.empty(self._count, dtype=wp.vec3, device=self._device) for _ in range(2))
        items.triangle, items.node = (self._integers(self._count) for _ in range(2))
        return items

    def _new_binary(self, nodes: int) -> Any:
        binary = ranges_cuda.Binary()
        binary.begin, binary.end, binary.child = (self._integers(nodes) for _ in range(3))
        binary.area = wp.empty(nodes, dtype=wp.float32, device=self._device)
        binary.low, binary.high = (wp.empty(nodes, dtype=wp.vec3, device=self._device) for _ in range(2))
        return binary


def _collapse(binary: Any, levels: list[tuple[int, int]], *, evenly: bool) -> _Nodes:
    """Collapse the binary tree to wide nodes: of minimal area, or, if `evenly`, of at least five of its levels each.

    The host reads the number of nodes only once a level may be the last.
    """
    device = binary.begin.device
    # Half of a binary tree's nodes plus one are leaves; each wide node has two or more children, except a root leaf.
    leaves = sum(levels[-1]) // 2 + 1
    children, leaf_ranges = (wp.empty((leaves, n), dtype=wp.int32, device=device) for n in (CUDA_LANES, 2))
    costs, opened = _find_costs(binary, levels, evenly=evenly), _new_opened(leaves, device)
    find = launch(node_kernels.open_nodes, 1, [binary, costs, opened], device, record_cmd=True)
    name = launch(node_kernels.name_children, 1, [binary, opened, children, leaf_ranges], device, record_cmd=True)
    rows, depth, max_nodes = list[list[int]](), 0, 1
    while max_nodes:
        opened.depth, opened.max_nodes = depth, max_nodes
        find.set_dim(max_nodes)
        find.launch()
        wp.utils.array_scan(opened.counts[: 2 * max_nodes], opened.sums[: 2 * max_nodes])
        name.set_dim(max_nodes)
        name.launch()
        depth += 1
        max_nodes = min(CUDA_LANES**depth, leaves)
        if max_nodes == leaves:
            rows = opened.info.numpy()[: depth + 1].tolist()
            max_nodes = rows[depth][node_kernels.NODES]
    used, _, leaf_count = rows[depth]
    return _Nodes(_shrunk(children, used), leaf_ranges, [(first, size) for first, size, _ in rows[:depth]], leaf_count)


def _find_costs(binary: Any, levels: list[tuple[int, int]], *, evenly: bool) -> wp.array:
    """Compute the costs of splitting each subtree into 1 to 32 parts, from the deepest level up."""
    device = binary.begin.device
    costs = wp.empty((sum(levels[-1]), CUDA_LANES), dtype=wp.float32, device=device)
    inputs = [binary, 0, int(evenly), costs]
    recorded = launch(node_kernels.find_costs, (1, CUDA_LANES), inputs, device, record_cmd=True)
    for first, size in reversed(levels):
        recorded.set_param_at_index(1, first)
        recorded.set_dim((size, CUDA_LANES))
        recorded.launch()
    return costs


def _new_opened(max_nodes: int, device: wp.Device) -> Any:
    """Allocate buffers for levels of at most `max_nodes` nodes; the first level is the root."""
    opened = node_kernels.Opened()
    info = np.zeros((ranges_cuda.MAX_DEPTH + 2, node_kernels.OPENED_WORDS), dtype=np.int32)
    info[0, node_kernels.NODES] = 1
    opened.info = wp.array(info, dtype=wp.int32, device=device)
    opened.nodes = wp.zeros((2, max_nodes), dtype=wp.int32, device=device)
    opened.parts = wp.empty((max_nodes, CUDA_LANES), dtype=wp.int32, device=device)
    opened.counts, opened.sums = (wp.empty(2 * max_nodes, dtype=wp.int32, device=device) for _ in range(2))
    return opened


def _shrunk(rows: wp.array, count: int) -> wp.array:
    """Copy the first rows, so that the memory of the others can be freed."""
    result = wp.empty((count, *rows.shape[1:]), dtype=rows.dtype, device=rows.device)
    wp.copy(result, rows[:count])
    return result


def _fill(mesh: _Mesh, items: Any, tree: _Nodes) -> Bvh:
    """Write the leaves, and the child bounds of all nodes, from the deepest level up."""
    device, lanes = mesh.vertices.device, CUDA_LANES
    check_leaves(tree.leaf_count, lanes)
    make = aligned_empty if device.is_cpu else partial(wp.empty, device=device)
    leaves = make((tree.leaf_count, LEAF_ROWS, lanes), wp.float32)
    triangles, owners = (make((tree.leaf_count, lanes), wp.int32) for _ in range(2))
    nodes = make((tree.node_count, NODE_ROWS, lanes), wp.float32)
    inputs = [mesh.vertices, mesh.faces, mesh.owner, items.triangle, tree.leaf_ranges]
    launch(node_kernels.fill_leaves, owners.shape, [*inputs, leaves, triangles, owners], device)
    launch(node_kernels.fit_leaves, tree.children.shape, [tree.children, leaves, owners, mesh.closed, nodes], device)
    for first, count in reversed(tree.levels[:-1]):
        launch(node_kernels.fit_nodes, (count, lanes), [tree.children, first, nodes], device)
    return Bvh(
        leaves.flatten(),
        triangles.flatten(),
        owners.flatten(),
        nodes.flatten(),
        tree.children.flatten(),
        lanes=lanes,
        depth=tree.depth,
        leaf_count=tree.leaf_count,
        node_count=tree.node_count,
        triangle_count=len(mesh.faces),
    )
