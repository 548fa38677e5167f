# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The BVH: leaves of 16 or 32 triangles and nodes of as many children, for casters that test all at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import aligned_empty
from warpvis.core.kernel_cache import load_module
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

# Ranges of fewer triangles are not worth a launch of their own.
_MIN_RANGE = 16384
# Ranges a thread gets on average, so that they end at about the same time. The tree does not depend on it.
_RANGES_PER_THREAD = 8
MAX_PLACES = (2**31 - 1) // LEAF_ROWS
"""Places for triangles in leaves: Warp's arrays have fewer than 2^31 numbers, and a triangle is nine."""
# No limit to the number of splits.
_ALL = -1


@dataclass(frozen=True)
class Bvh:
    """Triangles in clusters, and the tree above them, where it was built. Node 0 is the root.

    Arrays are flat, start at a multiple of 64 bytes on a CPU, and hold `lanes` lanes a row.
    """

    leaves: wp.array = field(repr=False)
    """float32, 9 rows a leaf: ax ay az bx by bz cx cy cz. Lanes without a triangle repeat lane 0's first corner."""
    triangles: wp.array = field(repr=False)
    """int32, one row a leaf: the lane's triangle among the faces, -1 for none."""
    owners: wp.array = field(repr=False)
    """int32, one row a leaf: the object that the lane's triangle belongs to; lane 0's for none."""
    nodes: wp.array = field(repr=False)
    """float32, 10 rows a node: the children's min x y z, max x y z, and their normal cones' axis x y z and cutoff.

    All triangles below a child face away from a camera if ``dot(m - camera, axis) >= cutoff * |m - camera| + r``, where
    m and r are the middle and the half diagonal of the child's box. The cutoff is 2 where the cone says nothing, or a
    triangle's object is not closed. Without a child, min is 3e38 and max is -3e38.
    """
    children: wp.array = field(repr=False)
    """int32, one row a node: a node, or a leaf as its one's complement (negative); 0 for none."""
    lanes: int
    """Triangles of a leaf and children of a node, at most: 16 or 32."""
    depth: int
    """Levels of nodes."""
    leaf_count: int
    """Leaves."""
    node_count: int
    """Nodes."""
    triangle_count: int
    """Triangles."""

    @property
    def bytes_per_triangle(self) -> float:
        """Memory of all arrays together, for each triangle."""
        arrays = (self.leaves, self.triangles, self.owners, self.nodes, self.children)
        return sum(array.size * 4 for array in arrays) / self.triangle_count


class _Nodes(NamedTuple):
    children: wp.array
    leaf_ranges: wp.array
    """int32, a row of two a leaf: the first of its items, and the first after them."""
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
    most_levels: int | None = None,
    threads: int | None = None,
) -> Bvh:
    """Build the tree by the surface area heuristic, with a leaf's cost the same however few triangles it has.

    Args:
        vertices: Corners, shape ``(n, 3)``.
        faces: Corner indices of the triangles, shape ``(m, 3)``, m from 1 up.
        owner: The triangles' objects, shape ``(m,)``.
        closed: Whether an object's back faces can be left out when it is seen from outside, shape ``(objects,)``.
        lanes: Triangles of a leaf and children of a node, at most: 16 or 32.
        most_levels: What the tree's depth does not exceed, whatever the triangles. Where the heuristic would make a
            deeper tree, triangles are halved in number instead. No limit by default.
        threads: CPU threads, all cores by default. The tree is the same for any number.

    Raises:
        ArrayError: `lanes` is not 16 or 32.
        SceneError: No tree of at most `most_levels` levels holds so many triangles.
    """
    from warpvis.kernels import bvh

    count = len(faces)
    check_size(count, lanes, most_levels)
    threads = check_threads(threads) if count > 2 * _MIN_RANGE else 1
    load_module(bvh.load_items)
    scene = [
        _wrap(np.ascontiguousarray(vertices, dtype=np.float32).ravel()),
        _wrap(np.ascontiguousarray(faces, dtype=np.int32).ravel()),
        _wrap(np.ascontiguousarray(owner, dtype=np.int32)),
        _wrap(np.ascontiguousarray(closed, dtype=np.uint8)),
    ]

    items = aligned_empty((count * ITEM_WORDS,), wp.float32)
    _launch_parts(bvh.load_items, count, lambda first: [*scene[:2], first, items], threads)
    children, leaf_ranges, node_count, leaf_count, depth = _arrange(items, lanes, most_levels, threads)
    check_leaves(leaf_count, lanes)

    leaves = aligned_empty((leaf_count * LEAF_ROWS * lanes,), wp.float32)
    triangles, owners = (aligned_empty((leaf_count * lanes,), wp.int32) for _ in range(2))
    bounds = aligned_empty((leaf_count * NODE_ROWS,), wp.float32)
    _launch_parts(
        bvh.fill_leaves,
        leaf_count,
        lambda first: [*scene, lanes, items, leaf_ranges, first, leaves, triangles, owners, bounds],
        threads,
    )
    nodes = aligned_empty((node_count * NODE_ROWS * lanes,), wp.float32)
    _launch(bvh.fit_nodes, [lanes, children, bounds, node_count, nodes])
    return Bvh(leaves, triangles, owners, nodes, children, lanes, depth, leaf_count, node_count, count)


def check_size(count: int, lanes: int, most_levels: int | None) -> None:
    """Raise an error unless there can be a tree of so many triangles, lanes and levels."""
    if lanes not in (CPU_LANES, CUDA_LANES):
        raise ArrayError(f"lanes must be {CPU_LANES} or {CUDA_LANES}, got {lanes!r}")
    if count > MAX_PLACES:
        raise SceneError(f"a scene has at most {MAX_PLACES} triangles, got {count}")
    if most_levels is None:
        return
    most = lanes ** (most_levels + 1) if most_levels > 0 else 0
    if count > most:
        raise SceneError(
            f"a tree of {lanes} lanes and at most {most_levels} levels holds {most} triangles, got {count}"
        )


def check_leaves(leaf_count: int, lanes: int) -> None:
    """Raise a `SceneError` unless casters can have so many leaves, of all trees together."""
    most = MAX_PLACES // lanes
    if leaf_count > most:
        raise SceneError(
            f"a scene has at most {most} leaves of {lanes} triangles, some of which have fewer, got {leaf_count}; "
            "let objects share meshes, or make meshes coarser"
        )


def _arrange(items: wp.array, lanes: int, most_levels: int | None, threads: int) -> _Nodes:
    """Sort the items into leaves, and make the nodes above them."""
    from warpvis.kernels import bvh

    count = items.size // ITEM_WORDS
    splits = aligned_empty((count * SPLIT_WORDS,), wp.int32)
    _split(bvh.split_range, items, splits, lanes, 0, threads)
    nodes = _collapse(bvh.collapse_tree, splits, lanes, evenly=False)
    if most_levels is not None and nodes.depth > most_levels:
        _split(bvh.split_range, items, splits, lanes, _shallow_root(count, lanes, most_levels), threads)
        nodes = _collapse(bvh.collapse_tree, splits, lanes, evenly=True)
    return nodes


def _shallow_root(count: int, lanes: int, most_levels: int) -> int:
    """Compute the depth to begin at, for ranges to be halved so early that the tree has at most `most_levels` levels.

    Such nodes as `_collapse` makes evenly hold log2(lanes) levels of the binary tree each. Of all these, halving takes
    ceil(log2(n)) for n leaves. The heuristic is left the rest.
    """
    leaves = -(-count // lanes)
    left = most_levels * (lanes.bit_length() - 1) - (leaves - 1).bit_length()
    return max(0, HALVING_DEPTH - left)


class _Range(NamedTuple):
    """Items to split."""

    begin: int
    end: int
    link: int
    """Where its split is found: twice its parent's, and 1 more on the right."""
    depth: int
    boxes: wp.array
    """Holds a box around the items' centres,"""
    slot: int
    """here; -1 where it has to be looked for."""


def _split(kernel: wp.Kernel, items: wp.array, splits: wp.array, lanes: int, root_depth: int, threads: int) -> None:
    """Split the items into a binary tree: large ranges once at a time until there are enough, then all to leaves."""
    links = splits.numpy().reshape(-1, SPLIT_WORDS)[:, :2]
    count = len(links)
    large = max(_MIN_RANGE, count // (threads * _RANGES_PER_THREAD)) if threads > 1 else count
    nowhere = aligned_empty((0,), wp.float32)

    def split(work: tuple[_Range, int, int, wp.array]) -> None:
        part, most_splits, first, boxes = work
        _launch(kernel, [lanes, *part[:4], most_splits, part.boxes, part.slot, first, items, splits, boxes])

    pending, ready = [_Range(0, count, 0, root_depth, nowhere, -1)], list[_Range]()
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
    run_each(split, [(part, _ALL, 0, nowhere) for part in ready], threads)


def _collapse(kernel: wp.Kernel, splits: wp.array, lanes: int, *, evenly: bool) -> _Nodes:
    """Make nodes of the binary tree's: of the least area, or, `evenly`, of log2(lanes) of its levels or more each."""
    count = splits.size // SPLIT_WORDS
    # As large as for leaves of one triangle: what is not written takes no memory.
    # In rows, since no axis of an array may be of 2^31 numbers and more.
    shapes = ((count, BINARY_WORDS + lanes), (count, lanes), (count, 2), (3,))
    binaries, children, leaf_ranges, counts = (aligned_empty(shape, wp.int32) for shape in shapes)
    _launch(kernel, [lanes, splits, count, int(evenly), binaries, children, leaf_ranges, counts])
    nodes = int(counts.numpy()[0])
    kept = aligned_empty((nodes * lanes,), wp.int32)
    kept.numpy()[:] = children.numpy()[:nodes].ravel()
    return _Nodes(kept, leaf_ranges, *counts.numpy().tolist())


def _launch_parts(kernel: wp.Kernel, count: int, arguments: Callable[[int], KernelArguments], threads: int) -> None:
    """Launch a kernel over `count` thread indices in parts; `arguments` takes the first of a part."""
    step = max(1024, -(-count // (4 * threads)))
    run_each(lambda first: _launch(kernel, arguments(first), min(step, count - first)), range(0, count, step), threads)


def _launch(kernel: wp.Kernel, arguments: KernelArguments, count: int = 1) -> None:
    wp.launch(kernel, dim=count, inputs=arguments, device="cpu")


def _wrap(array: np.ndarray) -> wp.array:
    return wp.array(array, copy=False, device="cpu")
