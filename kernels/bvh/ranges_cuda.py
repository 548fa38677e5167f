# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The first stage of the BVH builder for CUDA: checks of triangles, their items, and the root.

Functions of ranges of items, and of the cost of their splits, are shared with `warpvis.kernels.bvh.build_cuda`.
"""

import warp as wp

from warpvis.kernels.constants import CUDA_LANES, NOWHERE

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

BINS = 16
"""Number of bins per axis."""
SMALL = 4 * CUDA_LANES
"""Ranges of at most this many items are split at the cheapest of all positions."""
BIN_WORDS = 6
"""Words of a box while it grows: its corners in `ordered` representation, the upper one negated."""
MAX_DEPTH = 40
"""Maximum levels of the binary tree: eight levels of wide nodes, each covering five levels."""
NOTHING = 2137108966
"""The initial word of an empty box: `NOWHERE` in `ordered` representation."""
NO_SPLIT = 9223372036854775807
"""The initial value of `Level.best`."""

HALVED = 3
"""Axis value of a range that is halved in the order of its items instead of being split along an axis."""
AXIS_BITS = 2
COST_BITS = 32

# Columns of `Level.info`: a level's first node and number of nodes,
FIRST, COUNT = 0, 1
# the number of large nodes and of all nodes that are split,
LARGE, RANGES = 2, 3
# and the first node and number of nodes of the next level.
NEXT, NEXT_COUNT = 4, 5
INFO_WORDS = 6


@wp.struct
class Items:
    """Bounding boxes of triangles, in the order of ranges."""

    low: wp.array[wp.vec3]
    high: wp.array[wp.vec3]
    triangle: wp.array[wp.int32]
    node: wp.array[wp.int32]  # of the binary tree, in the current level; -1 if it is a leaf


@wp.struct
class Binary:
    """The binary tree, level by level. A node is a range of items."""

    begin: wp.array[wp.int32]
    end: wp.array[wp.int32]
    child: wp.array[wp.int32]  # left child, followed by the right one; -1 for a leaf
    area: wp.array[float]  # half the surface area of its box
    low: wp.array[wp.vec3]  # bounds of its items' doubled centers
    high: wp.array[wp.vec3]


@wp.struct
class Level:
    """Splits of the nodes of a level, by rank: large nodes first."""

    depth: int
    info: wp.array2d[wp.int32]  # one row per level, after a row for the parent of the root; see `FIRST`
    nodes: wp.array[wp.int32]
    axis: wp.array[wp.int32]  # along which it is split, or `HALVED`
    bin: wp.array[wp.int32]  # of large nodes: the first bin of the right child
    left_count: wp.array[wp.int32]  # of large nodes: items of the left child
    best: wp.array[wp.int64]  # the least cost, and its position


@wp.func
def ordered(value: float) -> int:
    """Map a float to an integer of the same order."""
    bits = wp.cast(value, wp.int32)
    if bits < 0:
        bits = bits ^ 2147483647
    return bits


@wp.func
def from_ordered(bits: int) -> float:
    ordered_bits = bits
    if ordered_bits < 0:
        ordered_bits = ordered_bits ^ 2147483647
    return wp.cast(ordered_bits, wp.float32)


@wp.func
def half_area(low: wp.vec3, high: wp.vec3) -> float:
    size = high - low
    return size[0] * size[1] + size[1] * size[2] + size[2] * size[0]


@wp.func
def leaves_of(count: int) -> int:
    return (count + CUDA_LANES - 1) // CUDA_LANES


@wp.func
def split_cost(left_area: float, left_count: int, right_area: float, right_count: int) -> float:
    """Return the surface area heuristic for whole leaves; without area, it minimizes the number of leaves."""
    per_item = 1.0 / float(left_count + right_count)
    return (left_area + 1.0e-30) * (float(leaves_of(left_count)) * per_item) + (right_area + 1.0e-30) * (
        float(leaves_of(right_count)) * per_item
    )


@wp.func
def half_of(count: int) -> int:
    """Return the number of items in the first half of a range, rounded up to whole leaves."""
    return leaves_of(count // 2) * CUDA_LANES


@wp.func
def must_halve(count: int, depth: int) -> bool:
    """Return whether a range must be halved from this depth on, to keep the tree within `MAX_DEPTH`."""
    leaves = leaves_of(count)
    levels = int(0)
    while (1 << levels) < leaves:
        levels += 1
    return depth + levels >= MAX_DEPTH


@wp.func
def is_split(count: int) -> bool:
    return count > CUDA_LANES


@wp.func
def bin_of(center: float, low: float, high: float) -> int:
    size = high - low
    scale = float(0.0)
    if size > 1.0e-30:
        scale = float(BINS) / size
    return wp.min(wp.max(int((center - low) * scale), 0), BINS - 1)


@wp.func
def grow_box(words: wp.array2d[wp.int32], index: int, low: wp.vec3, high: wp.vec3):
    for axis in range(3):
        wp.atomic_min(words, index, axis, ordered(low[axis]))
        wp.atomic_min(words, index, 3 + axis, ordered(-high[axis]))


@wp.func
def box_low(words: wp.array2d[wp.int32], index: int) -> wp.vec3:
    return wp.vec3(from_ordered(words[index, 0]), from_ordered(words[index, 1]), from_ordered(words[index, 2]))


@wp.func
def box_high(words: wp.array2d[wp.int32], index: int) -> wp.vec3:
    return -wp.vec3(from_ordered(words[index, 3]), from_ordered(words[index, 4]), from_ordered(words[index, 5]))


@wp.func
def level_info(level: Level, word: int) -> int:
    """Return a word of `Level.info` for the current level, after its ranges have been ranked."""
    return level.info[level.depth + 1, word]


@wp.func
def rank_of(binary: Binary, level: Level, node: int) -> int:
    return (binary.child[node] - level_info(level, NEXT)) // 2


@wp.func
def first_bin(rank: int) -> int:
    return rank * (3 * BINS)


@wp.func
def encode_split(cost: float, left_count: int, axis: int) -> wp.int64:
    """Encode a split after `left_count` items in the order of an axis as a value of `Level.best`."""
    return (wp.int64(wp.cast(cost, wp.int32)) << wp.int64(COST_BITS)) | wp.int64((left_count << AXIS_BITS) | axis)


@wp.func
def best_position(best: wp.int64) -> int:
    """Return the low word of `Level.best`: for large ranges, the bin, over all axes, before which they are split."""
    return int(best & wp.int64((1 << (COST_BITS - AXIS_BITS)) - 1))


@wp.func
def best_count(best: wp.int64) -> int:
    """Return the number of left items of a small range's split."""
    return best_position(best) >> AXIS_BITS


@wp.func
def best_axis(best: wp.int64) -> int:
    return int(best & wp.int64((1 << AXIS_BITS) - 1))


@wp.func
def set_child(binary: Binary, node: int, begin: int, end: int, low: wp.vec3, high: wp.vec3, area: float):
    binary.begin[node] = begin
    binary.end[node] = end
    binary.child[node] = -1
    binary.area[node] = area
    binary.low[node] = low
    binary.high[node] = high


@wp.func
def best_bin(
    boxes: wp.array2d[wp.int32], counts: wp.array[wp.int32], first_bin_index: int, axis: int, total: int
) -> wp.int64:
    """Return the least cost of a split before a bin of an axis, encoded with the bin; `NO_SPLIT` without a split."""
    right_areas = wp.vector(length=BINS, dtype=float)
    best = wp.int64(NO_SPLIT)
    best_cost = float(NOWHERE)
    first = first_bin_index + axis * BINS
    low, high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
    for step in range(1, BINS):
        index = BINS - step
        low = wp.min(low, box_low(boxes, first + index))
        high = wp.max(high, box_high(boxes, first + index))
        right_areas[index] = half_area(low, high)
    low, high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
    left_count = int(0)
    for right in range(1, BINS):
        low = wp.min(low, box_low(boxes, first + right - 1))
        high = wp.max(high, box_high(boxes, first + right - 1))
        left_count += counts[first + right - 1]
        if left_count > 0 and left_count < total:
            cost = split_cost(half_area(low, high), left_count, right_areas[right], total - left_count)
            if cost < best_cost:
                best_cost = cost
                best = (wp.int64(wp.cast(cost, wp.int32)) << wp.int64(COST_BITS)) | wp.int64(axis * BINS + right)
    return best


@wp.func
def bin_child(
    binary: Binary, boxes: wp.array2d[wp.int32], node: int, child: int, first: int, bins: int, begin: int, end: int
):
    """Write a child that contains all items of a range of bins."""
    low, high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
    for index in range(first, first + bins):
        low, high = wp.min(low, box_low(boxes, index)), wp.max(high, box_high(boxes, index))
    # Doubled centers lie in the parent's bounds of doubled centers and in the doubled box of the items.
    center_low, center_high = wp.max(binary.low[node], 2.0 * low), wp.min(binary.high[node], 2.0 * high)
    set_child(binary, child, begin, end, center_low, center_high, half_area(low, high))


@wp.kernel
def check_mesh(
    # Scene:
    vertices: wp.array[wp.vec3],
    faces: wp.array2d[wp.int32],
    # In:
    farthest: float,
    # Out:
    found_out: wp.array[wp.int32],
):
    """Count invalid corners (NaN or beyond `farthest`), find the first one, and the least and greatest vertex index."""
    index = wp.tid()
    if index < vertices.shape[0]:
        vertex = vertices[index]
        reach = wp.max(wp.max(wp.abs(vertex[0]), wp.abs(vertex[1])), wp.abs(vertex[2]))
        is_valid = reach <= farthest and vertex[0] == vertex[0] and vertex[1] == vertex[1] and vertex[2] == vertex[2]
        if not is_valid:
            wp.atomic_add(found_out, 0, 1)
            wp.atomic_min(found_out, 1, index)
    if index < faces.shape[0]:
        for corner in range(3):
            wp.atomic_min(found_out, 2, faces[index, corner])
            wp.atomic_max(found_out, 3, faces[index, corner])


@wp.kernel
def load_items(
    # Scene:
    vertices: wp.array[wp.vec3],
    faces: wp.array2d[wp.int32],
    # Out:
    items_out: Items,
):
    """Write the item of each triangle; all items belong to node 0."""
    triangle = wp.tid()
    a, b, c = vertices[faces[triangle, 0]], vertices[faces[triangle, 1]], vertices[faces[triangle, 2]]
    items_out.low[triangle] = wp.min(a, wp.min(b, c))
    items_out.high[triangle] = wp.max(a, wp.max(b, c))
    items_out.triangle[triangle] = triangle
    items_out.node[triangle] = wp.where(is_split(faces.shape[0]), 0, -1)


@wp.kernel
def bound_centers(
    # In:
    items: Items,
    threads: int,
    # Out:
    words_out: wp.array2d[wp.int32],
):
    """Grow a box around the items' doubled centers; each thread reads every `threads`-th item."""
    item = wp.tid()
    low, high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
    while item < items.low.shape[0]:
        center = items.low[item] + items.high[item]
        low, high = wp.min(low, center), wp.max(high, center)
        item += threads
    grow_box(words_out, 0, low, high)


@wp.kernel
def begin_tree(
    # In:
    words: wp.array2d[wp.int32],
    item_count: int,
    # Out:
    info_out: wp.array2d[wp.int32],
    binary_out: Binary,
):
    """Write the root, which contains all items, as the next level in row 0 of `info`; one thread."""
    node = wp.tid()
    info_out[0, NEXT] = 0
    info_out[0, NEXT_COUNT] = 1
    set_child(binary_out, node, 0, item_count, box_low(words, 0), box_high(words, 0), 0.0)
