# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The wide BVH: leaves of 16 or 32 triangles and nodes of 16 or 32 children, one per lane; and its refit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import aligned_empty
from warpvis.core.kernel_cache import launch, load_module
from warpvis.core.threads import check_threads, run_each
from warpvis.core.types import KernelArguments
from warpvis.errors import ArrayError, SceneError
from warpvis.kernels.constants import (
    BINARY_WORDS,
    CPU_LANES,
    CUDA_LANES,
    HALVING_DEPTH,
    ITEM_WORDS,
    LEAF_ROWS,
    NODE_ROWS,
    SPLIT_WORDS,
)

# Smaller ranges are not worth a separate launch.
_MIN_RANGE = 16384
# Average number of ranges per thread, for load balancing. The tree does not depend on it.
_RANGES_PER_THREAD = 8
MAX_PLACES = (2**31 - 1) // LEAF_ROWS
"""Maximum number of leaf slots: a Warp array has fewer than 2^31 elements, and a triangle takes nine."""
# No limit on the number of splits.
_ALL = -1

# Fewer leaves are not worth a separate launch or another thread.
_MIN_LEAVES = 512
_PARTS_PER_THREAD = 4


@dataclass(frozen=True)
class Bvh:
    """Triangles in leaves, and the tree above them, on the device where it was built. Node 0 is the root.

    Arrays are flat; on a CPU they are aligned to 64 bytes. Each row has `lanes` elements.
    """

    leaves: wp.array = field(repr=False)
    """float32, 9 rows a leaf: ax ay az bx by bz cx cy cz. Unused lanes repeat the first corner of lane 0."""
    triangles: wp.array = field(repr=False)
    """int32, one row a leaf: the face index of the lane's triangle, -1 for unused lanes."""
    owners: wp.array = field(repr=False)
    """int32, one row a leaf: the object of the lane's triangle; unused lanes repeat lane 0's."""
    nodes: wp.array = field(repr=False)
    """float32, 10 rows a node: the children's min x y z, max x y z, and their normal cones' axis x y z and cutoff.

    All triangles below a child face away from a camera if ``dot(m - camera, axis) >= cutoff * |m - camera| + r``, where
    m and r are the center and the half diagonal of the child's box. The cutoff is 2, which never culls, if the cone is
    too wide or an object below the child is not closed. Unused lanes have min 3e38 and max -3e38.
    """
    children: wp.array = field(repr=False)
    """int32, one row a node: a node index, or the bitwise complement of a leaf index (negative); 0 for unused lanes."""
    lanes: int
    """Maximum number of triangles per leaf and of children per node: 16 or 32."""
    depth: int
    """Number of node levels."""
    leaf_count: int
    """Number of leaves."""
    node_count: int
    """Number of nodes."""
    triangle_count: int
    """Number of triangles."""

    @property
    def bytes_per_triangle(self) -> float:
        """Memory of all arrays divided by the number of triangles."""
        arrays = (self.leaves, self.triangles, self.owners, self.nodes, self.children)
        return sum(array.size * 4 for array in arrays) / self.triangle_count


class _Nodes(NamedTuple):
    children: wp.array
    leaf_ranges: wp.array
    """int32, two a leaf: its first item, and the end of its items (exclusive)."""
    node_count: int
    leaf_count: int
    depth: int


def build_bvh(
    vertices: NDArray[np.float32],
    faces: NDArray[np.int32],
    owner: NDArray[np.int32],
    closed: NDArray[np.bool_],
    *,
    lanes: int = 16,
    max_levels: int | None = None,
    threads: int | None = None,
) -> Bvh:
    """Build the tree by the surface area heuristic; a leaf's cost does not depend on how many triangles it holds.

    For triangles `faces`, ``(m, 3)``, m at least 1, of objects `owner`, ``(m,)``; back faces of `closed` objects can be
    culled. Where the heuristic would exceed `max_levels` levels of nodes, ranges are split into halves of equal count.
    The tree does not depend on the number of threads.
    """
    from warpvis.kernels.bvh import build

    count = len(faces)
    check_size(count, lanes, max_levels)
    threads = check_threads(threads) if count > 2 * _MIN_RANGE else 1
    load_module(build.load_items)
    scene = [
        _wrap(np.ascontiguousarray(vertices, dtype=np.float32).ravel()),
        _wrap(np.ascontiguousarray(faces, dtype=np.int32).ravel()),
        _wrap(np.ascontiguousarray(owner, dtype=np.int32)),
        _wrap(np.ascontiguousarray(closed, dtype=np.uint8)),
    ]

    items = aligned_empty((count * ITEM_WORDS,), wp.float32)
    _launch_parts(build.load_items, count, lambda first: [*scene[:2], first, items], threads)
    children, leaf_ranges, node_count, leaf_count, depth = _arrange(items, lanes, max_levels, threads)
    check_leaves(leaf_count, lanes)

    leaves = aligned_empty((leaf_count * LEAF_ROWS * lanes,), wp.float32)
    triangles, owners = (aligned_empty((leaf_count * lanes,), wp.int32) for _ in range(2))
    bounds = aligned_empty((leaf_count * NODE_ROWS,), wp.float32)
    _launch_parts(
        build.fill_leaves,
        leaf_count,
        lambda first: [*scene, lanes, items, leaf_ranges, first, leaves, triangles, owners, bounds],
        threads,
    )
    nodes = aligned_empty((node_count * NODE_ROWS * lanes,), wp.float32)
    _launch(build.fit_nodes, [lanes, children, bounds, node_count, nodes])
    return Bvh(leaves, triangles, owners, nodes, children, lanes, depth, leaf_count, node_count, count)


def check_size(count: int, lanes: int, max_levels: int | None) -> None:
    """Raise an error if no tree can have this number of triangles, lanes and levels."""
    if lanes not in (CPU_LANES, CUDA_LANES):
        raise ArrayError(f"lanes must be {CPU_LANES} or {CUDA_LANES}, got {lanes!r}")
    if count > MAX_PLACES:
        raise SceneError(f"a scene has at most {MAX_PLACES} triangles, got {count}")
    if max_levels is None:
        return
    max_triangles = lanes ** (max_levels + 1) if max_levels > 0 else 0
    if count > max_triangles:
        raise SceneError(
            f"a tree of {lanes} lanes and at most {max_levels} levels holds {max_triangles} triangles, got {count}"
        )


def check_leaves(leaf_count: int, lanes: int) -> None:
    """Raise a `SceneError` if all trees together have more leaves than the kernels can index."""
    max_leaves = MAX_PLACES // lanes
    if leaf_count > max_leaves:
        raise SceneError(
            f"a scene has at most {max_leaves} leaves of up to {lanes} triangles, got {leaf_count}; share meshes "
            "between objects, or simplify them"
        )


def check_slots(count: int) -> None:
    """Raise a `SceneError` if the triangles of all objects, counting unused leaf slots, cannot be numbered."""
    if count >= 2**31:
        raise SceneError(
            f"all objects together must have fewer than 2^31 triangles, counting unused leaf slots, got {count}"
        )


def _arrange(items: wp.array, lanes: int, max_levels: int | None, threads: int) -> _Nodes:
    """Sort the items into leaves, and build the nodes above them."""
    from warpvis.kernels.bvh import build

    count = items.size // ITEM_WORDS
    splits = aligned_empty((count * SPLIT_WORDS,), wp.int32)
    _split(build.split_range, items, splits, lanes, 0, threads)
    nodes = _collapse(build.collapse_tree, splits, lanes, evenly=False)
    if max_levels is not None and nodes.depth > max_levels:
        _split(build.split_range, items, splits, lanes, _shallow_root(count, lanes, max_levels), threads)
        nodes = _collapse(build.collapse_tree, splits, lanes, evenly=True)
    return nodes


def _shallow_root(count: int, lanes: int, max_levels: int) -> int:
    """Return the initial depth at which ranges are halved early enough for at most `max_levels` levels of nodes.

    Each node that `_collapse` builds with `evenly` spans log2(lanes) levels of the binary tree. Halving n leaves takes
    ceil(log2(n)) of these levels; the remaining ones are split by the heuristic.
    """
    leaves = -(-count // lanes)
    free_levels = max_levels * (lanes.bit_length() - 1) - (leaves - 1).bit_length()
    return max(0, HALVING_DEPTH - free_levels)


class _Range(NamedTuple):
    """A range of items to split."""

    begin: int
    end: int
    link: int
    """Where its split is stored: twice the parent's index, plus 1 for the right child."""
    depth: int
    boxes: wp.array
    """Contains the bounding box of the items' centers,"""
    slot: int
    """at this index; -1 if the box has to be computed."""


def _split(kernel: wp.Kernel, items: wp.array, splits: wp.array, lanes: int, root_depth: int, threads: int) -> None:
    """Split the items into a binary tree: large ranges level by level, then each remaining range down to its leaves."""
    links = splits.numpy().reshape(-1, SPLIT_WORDS)[:, :2]
    count = len(links)
    large = max(_MIN_RANGE, count // (threads * _RANGES_PER_THREAD)) if threads > 1 else count
    no_box = aligned_empty((0,), wp.float32)

    def split(work: tuple[_Range, int, int, wp.array]) -> None:
        part, max_splits, first, boxes = work
        _launch(kernel, [lanes, *part[:4], max_splits, part.boxes, part.slot, first, items, splits, boxes])

    pending, ready = [_Range(0, count, 0, root_depth, no_box, -1)], list[_Range]()
    while pending:
        boxes = aligned_empty((len(pending) * 2 * ITEM_WORDS,), wp.float32)
        run_each(split, [(part, 1, 2 * index, boxes) for index, part in enumerate(pending)], threads)
        parts = []
        for index, part in enumerate(pending):
            middle = int(links[part.link // 2, part.link % 2])
            if middle:
                parts.append(_Range(part.begin, middle, 2 * middle, part.depth + 1, boxes, 2 * index))
                parts.append(_Range(middle, part.end, 2 * middle + 1, part.depth + 1, boxes, 2 * index + 1))
        pending = [part for part in parts if part.end - part.begin > large]
        ready += [part for part in parts if part.end - part.begin <= large]
    ready.sort(key=lambda part: part.begin - part.end)
    run_each(split, [(part, _ALL, 0, no_box) for part in ready], threads)


def _collapse(kernel: wp.Kernel, splits: wp.array, lanes: int, *, evenly: bool) -> _Nodes:
    """Collapse the binary tree to wide nodes: of minimal area, or, if `evenly`, of at least log2(lanes) levels each."""
    count = splits.size // SPLIT_WORDS
    # Sized for leaves of one triangle: untouched pages take no memory.
    # Two-dimensional, since no axis of a Warp array may have 2^31 elements.
    shapes = ((count, BINARY_WORDS + lanes), (count, lanes), (count, 2), (3,))
    binaries, children, leaf_ranges, counts = (aligned_empty(shape, wp.int32) for shape in shapes)
    _launch(kernel, [lanes, splits, count, int(evenly), binaries, children, leaf_ranges, counts])
    nodes = int(counts.numpy()[0])
    used_children = aligned_empty((nodes * lanes,), wp.int32)
    used_children.numpy()[:] = children.numpy()[:nodes].ravel()
    return _Nodes(used_children, leaf_ranges, *counts.numpy().tolist())


def _launch_parts(kernel: wp.Kernel, count: int, arguments: Callable[[int], KernelArguments], threads: int) -> None:
    """Launch a kernel over `count` thread indices in parts; `arguments` is called with the first index of a part."""
    step = max(1024, -(-count // (4 * threads)))
    run_each(lambda first: _launch(kernel, arguments(first), min(step, count - first)), range(0, count, step), threads)


def _launch(kernel: wp.Kernel, arguments: KernelArguments, count: int = 1) -> None:
    wp.launch(kernel, dim=count, inputs=arguments, device="cpu")


def _wrap(array: np.ndarray) -> wp.array:
    return wp.array(array, copy=False, device="cpu")


class BvhRefit:
    """Refits one BVH. The constructor allocates all memory: on CUDA, a refit neither allocates nor synchronizes.

    It reads the vertices `points`, and writes `leaves` and `nodes`, the tree's ranges of the joined arrays, and its
    bounding `box`, six numbers.
    """

    def __init__(
        self,
        tree: Bvh,
        faces: NDArray[np.int32],
        points: wp.array,
        leaves: wp.array,
        nodes: wp.array,
        box: wp.array,
    ) -> None:
        """Record the launches of a refit."""
        from warpvis.kernels.bvh import refit

        device, lanes = points.device, tree.lanes
        leaf_slots, node_slots, levels = _slots(tree.children.numpy().reshape(-1, lanes), tree.leaf_count)
        parts = 1 if device.is_cpu else lanes
        numbers = [leaf_vertices(tree, faces), leaf_slots, node_slots, np.concatenate(levels)]
        corners, leaf_slots, node_slots, order = (wp.array(array, dtype=wp.int32, device=device) for array in numbers)
        leaves = leaves.reshape((-1, LEAF_ROWS, lanes))
        nodes = nodes.reshape((-1, NODE_ROWS, lanes))
        # Recorded launches do not hold references to their arguments.
        self._references = [corners, leaf_slots, node_slots, order, leaves, nodes, box, points]

        def record(kernel: wp.Kernel, count: int, arguments: KernelArguments) -> wp.Launch:
            return launch(kernel, (count, parts), arguments, device, record_cmd=True)

        self._threads = check_threads(None) if device.is_cpu and tree.leaf_count > 2 * _MIN_LEAVES else 1
        step = max(_MIN_LEAVES, -(-tree.leaf_count // (_PARTS_PER_THREAD * self._threads)))
        step = step if device.is_cpu else tree.leaf_count
        self._leaf_launches = [
            record(
                refit.refit_leaves,
                min(step, tree.leaf_count - first),
                [points, corners, leaf_slots, first, parts, leaves, nodes],
            )
            for first in range(0, tree.leaf_count, step)
        ]
        firsts = np.cumsum([0] + [len(level) for level in levels]).tolist()
        self._node_launches = [
            record(refit.refit_nodes, len(level), [order, node_slots, first, parts, nodes, box])
            for level, first in zip(levels, firsts, strict=False)
        ]

    def refit(self) -> None:
        """Update the tree to the current vertices."""
        run_each(lambda recorded: recorded.launch(), self._leaf_launches, self._threads)
        for recorded in self._node_launches:
            recorded.launch()


def leaf_vertices(tree: Bvh, faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the triangles' corner indices, shape ``(leaves, 3, lanes)``, in the layout of `Bvh.leaves`."""
    triangles = tree.triangles.numpy().reshape(-1, tree.lanes)
    unused = triangles < 0
    used = np.where(unused, triangles[:, :1], triangles)
    first = faces[used, 0]
    return np.stack([first] + [np.where(unused, first, faces[used, corner]) for corner in (1, 2)], axis=1)


def _slots(
    children: NDArray[np.int32], leaf_count: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], list[NDArray[np.int32]]]:
    """Return each leaf's and each node's slot among the children (-1 for the root), and the levels, deepest first."""
    leaf_slots = np.empty(leaf_count, dtype=np.int32)
    node_slots = np.full(len(children), -1, dtype=np.int32)
    flat = children.ravel()
    leaf, node = np.flatnonzero(flat < 0), np.flatnonzero(flat > 0)
    leaf_slots[~flat[leaf]], node_slots[flat[node]] = leaf, node
    levels: list[NDArray[np.int32]] = []
    level = np.zeros(1, dtype=np.int32)
    while len(level):
        levels.insert(0, level)
        below = children[level]
        level = below[below > 0]
    return leaf_slots, node_slots, levels
