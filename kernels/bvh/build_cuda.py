# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The BVH builder for CUDA: builds the binary tree level by level with one thread per item or range.

It splits ranges as ``native/cpu/bvh_split.h`` does. `warpvis.kernels.bvh.ranges_cuda` creates the root,
`warpvis.kernels.bvh.nodes_cuda` converts the binary tree to wide nodes, and `warpvis.scene.acceleration.bvh_cuda`
launches all kernels. Results do not depend on the order of threads.
"""

import warp as wp

from warpvis.kernels.bvh.ranges_cuda import (
    AXIS_BITS,
    BIN_WORDS,
    BINS,
    COUNT,
    FIRST,
    HALVED,
    LARGE,
    NEXT,
    NEXT_COUNT,
    NO_SPLIT,
    NOTHING,
    RANGES,
    SMALL,
    Binary,
    Items,
    Level,
    best_axis,
    best_bin,
    best_count,
    best_position,
    bin_child,
    bin_of,
    encode_split,
    first_bin,
    grow_box,
    half_area,
    half_of,
    is_split,
    level_info,
    must_halve,
    rank_of,
    set_child,
    split_cost,
)
from warpvis.kernels.constants import NOWHERE

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def mark_ranges(
    # In:
    binary: Binary,
    level: Level,
    # Out:
    flags_out: wp.array2d[wp.int32],
):
    """Write two rows of flags for a level's nodes: whether it is large, and whether it is small but is split."""
    index = wp.tid()
    count = int(0)
    if index < level.info[level.depth, NEXT_COUNT]:
        node = level.info[level.depth, NEXT] + index
        count = binary.end[node] - binary.begin[node]
    flags_out[0, index] = int(count > SMALL)
    flags_out[1, index] = int(is_split(count) and count <= SMALL)


@wp.kernel
def rank_ranges(
    # In:
    flags: wp.array2d[wp.int32],
    sums: wp.array2d[wp.int32],
    # Out:
    level_out: Level,
    binary_out: Binary,
):
    """List the nodes of a level that are split, by scans of their flags, and number their children.

    Thread (0, 0) writes the level's row of `info`, which follows the row of its parent level, which all threads read.
    """
    row, index = wp.tid()
    last = sums.shape[1] - 1
    first, count = level_out.info[level_out.depth, NEXT], level_out.info[level_out.depth, NEXT_COUNT]
    if row == 0 and index == 0:
        level_out.info[level_out.depth + 1, FIRST] = first
        level_out.info[level_out.depth + 1, COUNT] = count
        level_out.info[level_out.depth + 1, LARGE] = sums[0, last]
        level_out.info[level_out.depth + 1, RANGES] = sums[1, last]
        level_out.info[level_out.depth + 1, NEXT] = first + count
        level_out.info[level_out.depth + 1, NEXT_COUNT] = 2 * sums[1, last]
    if flags[row, index] == 1:
        rank, node = sums[row, index] - 1, first + index
        level_out.nodes[rank] = node
        binary_out.child[node] = first + count + 2 * rank
        level_out.best[rank] = wp.int64(NO_SPLIT)


@wp.kernel
def clear_bins(
    # Out:
    boxes_out: wp.array2d[wp.int32],
    counts_out: wp.array[wp.int32],
):
    """Reset bins to empty."""
    index = wp.tid()
    counts_out[index] = 0
    for word in range(BIN_WORDS):
        boxes_out[index, word] = NOTHING


@wp.kernel
def fill_bins(
    # In:
    items: Items,
    binary: Binary,
    level: Level,
    length: int,
    # Out:
    boxes_out: wp.array2d[wp.int32],
    counts_out: wp.array[wp.int32],
):
    """Sort the items of large ranges into bins along each axis.

    Each thread takes `length` items and one bin per axis, so that a range's items are merged in registers and few
    threads contend for memory.
    """
    part, cell = wp.tid()
    item = part * length
    end = wp.min(item + length, items.node.shape[0])
    while item < end:
        node = items.node[item]
        if node < 0:
            item += 1
        else:
            stop = wp.min(binary.end[node], end)
            rank = rank_of(binary, level, node)
            if rank < level_info(level, LARGE):
                grid_low, grid_high = binary.low[node], binary.high[node]
                lows, highs, counts = wp.mat33(NOWHERE), wp.mat33(-NOWHERE), wp.vec3i()
                for member in range(item, stop):
                    low, high = items.low[member], items.high[member]
                    for axis in range(3):
                        if bin_of(low[axis] + high[axis], grid_low[axis], grid_high[axis]) == cell:
                            lows[axis] = wp.min(lows[axis], low)
                            highs[axis] = wp.max(highs[axis], high)
                            counts[axis] += 1
                for axis in range(3):
                    if counts[axis] > 0:
                        index = first_bin(rank) + axis * BINS + cell
                        grow_box(boxes_out, index, lows[axis], highs[axis])
                        wp.atomic_add(counts_out, index, counts[axis])
            item = stop


@wp.kernel
def choose_bins(
    # In:
    boxes: wp.array2d[wp.int32],
    counts: wp.array[wp.int32],
    binary: Binary,
    level: Level,
    # Out:
    best_out: wp.array[wp.int64],
):
    """Find the bin of an axis before which it is cheapest to split a large range, and reduce over the axes."""
    axis, rank = wp.tid()
    if rank >= level_info(level, LARGE):
        return
    node = level.nodes[rank]
    total = binary.end[node] - binary.begin[node]
    if not must_halve(total, level.depth):
        wp.atomic_min(best_out, rank, best_bin(boxes, counts, first_bin(rank), axis, total))


@wp.kernel
def part_bins(
    # In:
    boxes: wp.array2d[wp.int32],
    counts: wp.array[wp.int32],
    # Out:
    level_out: Level,
    binary_out: Binary,
):
    """Write a child of a large range; the range is halved if all items are in one bin, or if it is too deep."""
    side, rank = wp.tid()
    if rank >= level_info(level_out, LARGE):
        return
    node = level_out.nodes[rank]
    begin, end, child = int(binary_out.begin[node]), int(binary_out.end[node]), binary_out.child[node] + side
    axis, right = int(HALVED), int(0)
    left_count = half_of(end - begin)
    first = first_bin(rank)
    best = level_out.best[rank]
    if best != wp.int64(NO_SPLIT):
        axis, right = best_position(best) // BINS, best_position(best) % BINS
        first += axis * BINS
        left_count = int(0)
        for index in range(first, first + right):
            left_count += counts[index]
    middle = begin + left_count
    if side == 0:
        level_out.axis[rank] = axis
        level_out.bin[rank] = right
        level_out.left_count[rank] = left_count
        end = middle
    else:
        begin = middle
    if axis == HALVED:
        low, high, area = binary_out.low[node], binary_out.high[node], binary_out.area[node]
        set_child(binary_out, child, begin, end, low, high, area)
    elif side == 0:
        bin_child(binary_out, boxes, node, child, first, right, begin, end)
    else:
        bin_child(binary_out, boxes, node, child, first + right, BINS - right, begin, end)


@wp.kernel
def sort_small(
    # In:
    items: Items,
    binary: Binary,
    level: Level,
    # Out:
    order_out: wp.array2d[wp.int32],
):
    """Find the position of each item of a small range in the order of each axis."""
    item = wp.tid()
    node = items.node[item]
    if node < 0:
        return
    if rank_of(binary, level, node) < level_info(level, LARGE):
        return
    begin = binary.begin[node]
    center = items.low[item] + items.high[item]
    positions = wp.vec3i(begin, begin, begin)
    for other in range(begin, binary.end[node]):
        other_center = items.low[other] + items.high[other]
        for axis in range(3):
            # Items with equal centers keep their order.
            positions[axis] += int(
                other_center[axis] < center[axis] or (other_center[axis] == center[axis] and other < item)
            )
    for axis in range(3):
        order_out[axis, positions[axis]] = item


@wp.kernel
def choose_places(
    # In:
    items: Items,
    binary: Binary,
    level: Level,
    order: wp.array2d[wp.int32],
    # Out:
    areas_out: wp.array2d[float],
    best_out: wp.array[wp.int64],
):
    """Find the item of an axis after which it is cheapest to split a small range, and reduce over the axes.

    `areas_out` receives the area of the box around an item and all items after it, in the order of each axis.
    """
    axis, rank = wp.tid()
    if rank >= level_info(level, RANGES) - level_info(level, LARGE):
        return
    node = level.nodes[level_info(level, LARGE) + rank]
    begin, end = binary.begin[node], binary.end[node]
    best = wp.int64(half_of(end - begin) << AXIS_BITS) | wp.int64(HALVED)
    if not must_halve(end - begin, level.depth):
        low, high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
        for step in range(1, end - begin):
            position = end - step
            item = order[axis, position]
            low, high = wp.min(low, items.low[item]), wp.max(high, items.high[item])
            areas_out[axis, position] = half_area(low, high)
        low, high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
        best = wp.int64(NO_SPLIT)
        for position in range(begin + 1, end):
            item = order[axis, position - 1]
            low, high = wp.min(low, items.low[item]), wp.max(high, items.high[item])
            cost = split_cost(half_area(low, high), position - begin, areas_out[axis, position], end - position)
            best = wp.min(best, encode_split(cost, position - begin, axis))
    wp.atomic_min(best_out, level_info(level, LARGE) + rank, best)


@wp.kernel
def find_sides(
    # In:
    items: Items,
    binary: Binary,
    level: Level,
    # Out:
    left_out: wp.array[wp.int32],
):
    """Write 1 for items of large ranges that go to the left child, and 0 for all others."""
    item = wp.tid()
    node = items.node[item]
    left_out[item] = 0
    if node < 0:
        return
    rank = rank_of(binary, level, node)
    if rank >= level_info(level, LARGE):
        return
    axis = level.axis[rank]
    if axis == HALVED:
        left_out[item] = int(item - binary.begin[node] < level.left_count[rank])
        return
    center = items.low[item][axis] + items.high[item][axis]
    cell = bin_of(center, binary.low[node][axis], binary.high[node][axis])
    left_out[item] = int(cell < level.bin[rank])


@wp.kernel
def move_items(
    # In:
    items: Items,
    binary: Binary,
    level: Level,
    lefts: wp.array[wp.int32],
    before: wp.array[wp.int32],
    order: wp.array2d[wp.int32],
    # Out:
    items_out: Items,
):
    """Move the items of large ranges to their children, left ones first, and those of small ranges into split order.

    `before` is the exclusive scan of `lefts`.
    """
    item = wp.tid()
    node = items.node[item]
    source, target, child = int(item), int(item), int(-1)
    if node >= 0:
        rank = rank_of(binary, level, node)
        begin, end = binary.begin[node], binary.end[node]
        count = int(0)
        if rank < level_info(level, LARGE):
            count = level.left_count[rank]
            rank_left = before[item] - before[begin]
            target = wp.where(lefts[item] == 1, begin + rank_left, item + count - rank_left)
        else:
            best = level.best[rank]
            count = best_count(best)
            if best_axis(best) != HALVED:
                source = order[best_axis(best), item]
        child = binary.child[node] + int(target - begin >= count)
        if not is_split(wp.where(target - begin < count, count, end - begin - count)):
            child = -1
    items_out.low[target] = items.low[source]
    items_out.high[target] = items.high[source]
    items_out.triangle[target] = items.triangle[source]
    items_out.node[target] = child


@wp.kernel
def part_small(
    # In:
    items: Items,
    level: Level,
    # Out:
    binary_out: Binary,
):
    """Write the children of a small range, whose items have been moved."""
    rank = wp.tid()
    if rank >= level_info(level, RANGES) - level_info(level, LARGE):
        return
    node = level.nodes[level_info(level, LARGE) + rank]
    begin, end = binary_out.begin[node], binary_out.end[node]
    middle = begin + best_count(level.best[level_info(level, LARGE) + rank])
    for side in range(2):
        low, high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
        first, last = wp.where(side == 0, begin, middle), wp.where(side == 0, middle, end)
        for item in range(first, last):
            low, high = wp.min(low, items.low[item]), wp.max(high, items.high[item])
        set_child(binary_out, binary_out.child[node] + side, first, last, low, high, half_area(low, high))
