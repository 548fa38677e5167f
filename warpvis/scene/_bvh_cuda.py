# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The BVH of CUDA, built there: a level at a time, of which the host is told how many ranges there are to split."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import aligned_empty
from warpvis.core.kernel_cache import launch
from warpvis.kernels.constants import CUDA_LANES, LEAF_ROWS, NODE_ROWS
from warpvis.scene._bvh import Bvh, check_size

# Threads that find the box around all items, and copies of bins that a level has in all, so that few wait for others.
_BOUNDING_THREADS = 1 << 16
_COPIED_BINS = 1024
# Fewer triangles are built into a tree by the CPU before a GPU has begun with all levels.
_LEAST_TRIANGLES = 30_000


def builds_on(device: wp.Device, triangles: int) -> bool:
    """Tell whether a device builds a tree of so many triangles itself."""
    return not device.is_cpu and triangles >= _LEAST_TRIANGLES


class DeviceMesh(NamedTuple):
    """Triangles on a device."""

    vertices: wp.array
    """Corners, vec3."""
    faces: wp.array
    """Corner indices, int32 of shape ``(m, 3)``."""
    owner: wp.array
    """The triangles' objects, int32 of shape ``(m,)``."""
    closed: wp.array
    """Whether an object's back faces can be left out, uint8 of shape ``(objects,)``."""

    @classmethod
    def of(
        cls,
        vertices: NDArray[np.float32],
        faces: NDArray[np.int32],
        owner: NDArray[np.int32],
        closed: NDArray[np.bool_],
        device: wp.Device,
    ) -> DeviceMesh:
        """Copy arrays of the host, as `warpvis.scene._bvh.build_bvh` takes them."""
        return cls(
            wp.array(vertices, dtype=wp.vec3, device=device),
            wp.array(faces, dtype=wp.int32, device=device),
            wp.array(owner, dtype=wp.int32, device=device),
            wp.array(closed, dtype=wp.uint8, device=device),
        )


def build_device_bvh(mesh: DeviceMesh, *, most_levels: int) -> Bvh:
    """Build a tree of 32 lanes where the mesh is, as `warpvis.scene._bvh.build_bvh` does it on the CPU.

    Nothing is copied to the host but how many ranges and nodes there are in each level.

    Args:
        mesh: The triangles, 1 or more.
        most_levels: What the tree's depth does not exceed, from 8 up, whatever the triangles.

    Raises:
        SceneError: There are more triangles than a tree holds.
    """
    check_size(len(mesh.faces), CUDA_LANES, most_levels)
    items, binary, levels = _Splitter(mesh).split()
    nodes = _collapse(binary, levels, evenly=False)
    if nodes.depth > most_levels:
        nodes = _collapse(binary, levels, evenly=True)
    return _fill(mesh, items, nodes)


class _Nodes(NamedTuple):
    children: wp.array
    leaf_ranges: wp.array
    levels: list[tuple[int, int]]
    """The first node of each level, and how many there are."""
    leaf_count: int

    @property
    def depth(self) -> int:
        return len(self.levels)

    @property
    def node_count(self) -> int:
        return sum(self.levels[-1])


class _Splitter:
    """Splits the triangles of a mesh into a binary tree, whose leaves are ranges of 32 of them at most."""

    def __init__(self, mesh: DeviceMesh) -> None:
        """Make the items, and the root."""
        from warpvis.kernels import bvh_cuda, bvh_cuda_ranges

        self._kernels, self._ranges, self._device = bvh_cuda, bvh_cuda_ranges, mesh.vertices.device
        self._count = len(mesh.faces)
        self._launch = partial(launch, device=self._device)
        self._items, self._moved = self._new_items(), self._new_items()
        self._lefts, self._before, self._places = (self._integers(self._count) for _ in range(3))
        # Leaves are filled by three quarters and more; where they are not, there is more room later.
        self._binary = self._new_binary(self._count // 8 + 64)
        words = self._filled((1, bvh_cuda_ranges.BIN_WORDS))
        threads = min(self._count, _BOUNDING_THREADS)
        self._launch(bvh_cuda.load_items, self._count, [mesh.vertices, mesh.faces, self._items])
        self._launch(bvh_cuda.bound_centres, threads, [self._items, threads, words])
        self._launch(bvh_cuda.begin_tree, 1, [words, self._count, self._binary])

    def split(self) -> tuple[Any, Any, list[tuple[int, int]]]:
        """Return the items in the leaves' order, the binary tree, and the first node and the number of each level."""
        levels = [(0, 1)]
        while ranges := self._split_level(*levels[-1], len(levels) - 1):
            levels.append((sum(levels[-1]), 2 * ranges))
        return self._items, self._binary, levels

    def _split_level(self, first: int, count: int, depth: int) -> int:
        """Split a level's nodes; return how many of them were."""
        kernels, device = self._kernels, self._device
        flags, sums = (self._integers((2, count)) for _ in range(2))
        self._launch(kernels.mark_ranges, count, [self._binary, first, flags])
        wp.utils.array_scan(flags.flatten(), sums.flatten())
        large, ranges = sums[:, count - 1].numpy().tolist()
        if ranges == 0:
            return 0
        self._grow(first + count + 2 * ranges)
        level = self._ranges.Level()
        level.depth, level.next, level.large_count, level.count = depth, first + count, large, ranges
        level.nodes, level.axis, level.bin, level.left_count = (self._integers(ranges) for _ in range(4))
        level.best = wp.empty(ranges - large, dtype=wp.int64, device=device)
        level.best.fill_(2**63 - 1)
        self._launch(kernels.rank_ranges, (2, count), [flags, sums, first, level, self._binary])
        if large:
            self._launch(kernels.choose_bins, large, [*self._fill_bins(level), level, self._binary])
        arguments = [self._items, self._binary, level]
        if ranges > large:
            self._launch(kernels.choose_places, self._count, [*arguments, level.best])
        self._launch(kernels.find_sides, self._count, [*arguments, self._lefts, self._places])
        wp.utils.array_scan(self._lefts, self._before, inclusive=False)
        moving = [self._lefts, self._before, self._places, self._moved]
        self._launch(kernels.move_items, self._count, [*arguments, *moving])
        self._items, self._moved = self._moved, self._items
        if ranges > large:
            self._launch(kernels.part_small, ranges - large, [self._items, level, self._binary])
        return ranges

    def _fill_bins(self, level: Any) -> tuple[wp.array, wp.array]:
        """Fill the bins of large ranges; where these are few, of copies that different threads fill."""
        bins = 3 * self._ranges.BINS * level.large_count
        copies = _copies(self._device, level.large_count)
        boxes, counts = self._new_bins(bins * copies)
        self._launch(self._kernels.fill_bins, self._count, [self._items, self._binary, level, copies, boxes, counts])
        if copies == 1:
            return boxes, counts
        merged = self._new_bins(bins)
        shape = (level.large_count, 3 * self._ranges.BINS)
        self._launch(self._kernels.merge_bins, shape, [boxes, counts, copies, *merged])
        return merged

    def _grow(self, nodes: int) -> None:
        """Make room for so many nodes of the binary tree."""
        old = self._binary
        if nodes <= len(old.begin):
            return
        self._binary = self._new_binary(max(nodes, 2 * len(old.begin)))
        for name in ("begin", "end", "child", "area", "low", "high"):
            wp.copy(getattr(self._binary, name), getattr(old, name), count=len(old.begin))

    def _integers(self, shape: int | tuple[int, ...]) -> wp.array:
        return wp.empty(shape, dtype=wp.int32, device=self._device)

    def _filled(self, shape: tuple[int, ...]) -> wp.array:
        array = self._integers(shape)
        array.fill_(self._ranges.NOTHING)
        return array

    def _new_bins(self, count: int) -> tuple[wp.array, wp.array]:
        boxes = self._filled((count, self._ranges.BIN_WORDS))
        return boxes, wp.zeros(count, dtype=wp.int32, device=self._device)

    def _new_items(self) -> Any:
        items = self._ranges.Items()
        items.low, items.high = (wp.empty(self._count, dtype=wp.vec3, device=self._device) for _ in range(2))
        items.triangle, items.node = (self._integers(self._count) for _ in range(2))
        return items

    def _new_binary(self, nodes: int) -> Any:
        binary = self._ranges.Binary()
        binary.begin, binary.end, binary.child = (self._integers(nodes) for _ in range(3))
        binary.area = wp.empty(nodes, dtype=wp.float32, device=self._device)
        binary.low, binary.high = (wp.empty(nodes, dtype=wp.vec3, device=self._device) for _ in range(2))
        return binary


def _copies(device: wp.Device, ranges: int) -> int:
    """How many copies of a range's bins are filled by different threads; one by the one thread of a CPU."""
    return 1 if device.is_cpu else max(1, _COPIED_BINS // ranges)


def _collapse(binary: Any, levels: list[tuple[int, int]], *, evenly: bool) -> _Nodes:
    """Make nodes of the binary tree's: of the least area, or, `evenly`, of five of its levels or more each."""
    from warpvis.kernels import bvh_cuda_nodes as kernels

    device = binary.begin.device
    count = sum(levels[-1])
    integers = partial(wp.empty, dtype=wp.int32, device=device)
    costs = wp.empty((count, CUDA_LANES), dtype=wp.float32, device=device)
    for first, size in reversed(levels):
        launch(kernels.find_costs, size, [binary, first, int(evenly), costs], device)
    # Of a binary tree's nodes, half and one are leaves; each node has two children or more, but the root of a leaf.
    children, leaf_ranges = integers((count // 2 + 1, CUDA_LANES)), integers((count // 2 + 1, 2))
    nodes = wp.zeros(1, dtype=wp.int32, device=device)
    done, leaves = list[tuple[int, int]](), 0
    while size := len(nodes):
        first = sum(done[-1]) if done else 0
        parts, counts, sums = integers((size, CUDA_LANES)), integers((2, size)), integers((2, size))
        launch(kernels.open_nodes, size, [binary, costs, nodes, parts, counts], device)
        wp.utils.array_scan(counts.flatten(), sums.flatten())
        inner, both = sums[:, size - 1].numpy().tolist()
        below = integers(inner)
        names = [first, first + size, leaves, children, leaf_ranges, below]
        launch(kernels.name_children, size, [binary, parts, counts, sums, *names], device)
        done.append((first, size))
        leaves, nodes = leaves + both - inner, below
    used = first + size if (size := done[-1][1]) else 0
    return _Nodes(_shrunk(children, used), leaf_ranges, done, leaves)


def _shrunk(rows: wp.array, count: int) -> wp.array:
    """Copy the first rows, so that the others' memory is free again."""
    result = wp.empty((count, *rows.shape[1:]), dtype=rows.dtype, device=rows.device)
    wp.copy(result, rows[:count])
    return result


def _fill(mesh: DeviceMesh, items: Any, made: _Nodes) -> Bvh:
    """Write the leaves, and the bounds of all nodes' children, from the deepest up."""
    from warpvis.kernels import bvh_cuda_nodes as kernels

    device, lanes = mesh.vertices.device, CUDA_LANES
    make = aligned_empty if device.is_cpu else partial(wp.empty, device=device)
    leaves = make((made.leaf_count, LEAF_ROWS, lanes), wp.float32)
    triangles, owners = (make((made.leaf_count, lanes), wp.int32) for _ in range(2))
    nodes = make((made.node_count, NODE_ROWS, lanes), wp.float32)
    inputs = [mesh.vertices, mesh.faces, mesh.owner, items.triangle, made.leaf_ranges]
    launch(kernels.fill_leaves, owners.shape, [*inputs, leaves, triangles, owners], device)
    launch(kernels.fit_leaves, made.children.shape, [made.children, leaves, owners, mesh.closed, nodes], device)
    for first, count in reversed(made.levels[:-1]):
        launch(kernels.fit_nodes, (count, lanes), [made.children, first, nodes], device)
    return Bvh(
        leaves.flatten(),
        triangles.flatten(),
        owners.flatten(),
        nodes.flatten(),
        made.children.flatten(),
        lanes=lanes,
        depth=made.depth,
        leaf_count=made.leaf_count,
        node_count=made.node_count,
        triangle_count=len(mesh.faces),
    )
