# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The BVH's builder, for CUDA: the binary tree, a level at a time, by one thread an item or a range.

It splits as ``native/cpu/bvh_split.h`` does, but for two things: where the centres of a range's items are is known from
its own box and its parent's, and ranges that many bins are filled of have copies of them. Nodes are made of it in
`warpvis.kernels.bvh_cuda_nodes`; `warpvis.scene._bvh_cuda` launches all. Nothing here depends on the order of threads.
"""

import warp as wp

from warpvis.kernels.constants import CUDA_LANES, NOWHERE

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

BINS = 16
"""Of one axis."""
SMALL = 4 * CUDA_LANES
"""Ranges of at most this many items are split where it is cheapest of all places."""
BIN_WORDS = 6
"""Of a box while it grows: its corners as `ordered` has them, the greatest negated."""
MOST_DEPTH = 40
"""Levels of the binary tree: eight levels of nodes, five of these each."""
NOTHING = 2147483647
"""What a box has in each word before anything is in it, and a range's best place before any was found."""

HALVED = 3
"""In place of the axis along which a range is split: it is halved, as its items lie."""
_AXIS_BITS = 2
_COST_BITS = 32
_LANES = wp.constant(CUDA_LANES)
_SMALL = wp.constant(SMALL)


@wp.struct
class Items:
    """The triangles' boxes, in the order of ranges."""

    low: wp.array[wp.vec3]
    high: wp.array[wp.vec3]
    triangle: wp.array[wp.int32]
    node: wp.array[wp.int32]  # of the binary tree, of the level that is split now; -1 where that is a leaf


@wp.struct
class Binary:
    """The binary tree, a level after the other. A node is a range of items."""

    begin: wp.array[wp.int32]
    end: wp.array[wp.int32]
    child: wp.array[wp.int32]  # the left one, before the right one; -1 for a leaf
    area: wp.array[float]  # half the surface area of its box
    low: wp.array[wp.vec3]  # a box around twice the centres of its items
    high: wp.array[wp.vec3]


@wp.struct
class Level:
    """How the nodes of a level are split: by their ranks, the large ones first."""

    depth: int
    next: int  # the first node of the level below
    large_count: int
    count: int
    nodes: wp.array[wp.int32]
    axis: wp.array[wp.int32]  # along which it is split; `HALVED` if as the items lie
    bin: wp.array[wp.int32]  # of large ones, the first on the right
    left_count: wp.array[wp.int32]  # items on the left, of large ones
    best: wp.array[wp.int64]  # of small ones, by rank - large_count: the least cost, and the place of that


@wp.func
def ordered(value: float) -> int:
    """A whole number that is the greater, the greater the value."""
    bits = wp.cast(value, wp.int32)
    if bits < 0:
        bits = bits ^ 2147483647
    return bits


@wp.func
def from_ordered(bits: int) -> float:
    whole = bits
    if whole < 0:
        whole = whole ^ 2147483647
    return wp.cast(whole, wp.float32)


@wp.func
def half_area(low: wp.vec3, high: wp.vec3) -> float:
    size = high - low
    return size[0] * size[1] + size[1] * size[2] + size[2] * size[0]


@wp.func
def leaves_of(count: int) -> int:
    return (count + _LANES - 1) // _LANES


@wp.func
def split_cost(left: float, left_count: int, right: float, right_count: int) -> float:
    """The surface area heuristic, with leaves counted whole; the fewest of them where boxes have no area."""
    per_item = 1.0 / float(left_count + right_count)
    return (left + 1.0e-30) * (float(leaves_of(left_count)) * per_item) + (right + 1.0e-30) * (
        float(leaves_of(right_count)) * per_item
    )


@wp.func
def half_of(count: int) -> int:
    """The middle of a range, after a whole number of leaves."""
    return leaves_of(count // 2) * _LANES


@wp.func
def must_halve(count: int, depth: int) -> bool:
    """Whether a range that is split so deep down has to be halved from here on, for the tree to be no deeper."""
    leaves = leaves_of(count)
    levels = int(0)
    while (1 << levels) < leaves:
        levels += 1
    return depth + levels >= MOST_DEPTH


@wp.func
def is_split(count: int) -> bool:
    return count > _LANES


@wp.func
def bin_of(centre: float, low: float, high: float) -> int:
    size = high - low
    scale = float(0.0)
    if size > 1.0e-30:
        scale = float(BINS) / size
    return wp.min(wp.max(int((centre - low) * scale), 0), BINS - 1)


@wp.func
def grow_box(words: wp.array2d[wp.int32], at: int, low: wp.vec3, high: wp.vec3):
    for axis in range(3):
        wp.atomic_min(words, at, axis, ordered(low[axis]))
        wp.atomic_min(words, at, 3 + axis, ordered(-high[axis]))


@wp.func
def box_low(words: wp.array2d[wp.int32], at: int) -> wp.vec3:
    return wp.vec3(from_ordered(words[at, 0]), from_ordered(words[at, 1]), from_ordered(words[at, 2]))


@wp.func
def box_high(words: wp.array2d[wp.int32], at: int) -> wp.vec3:
    return -wp.vec3(from_ordered(words[at, 3]), from_ordered(words[at, 4]), from_ordered(words[at, 5]))


@wp.func
def rank_of(binary: Binary, level: Level, node: int) -> int:
    return (binary.child[node] - level.next) // 2


@wp.func
def first_bin(rank: int, copy: int, copies: int) -> int:
    return (rank * copies + copy) * (3 * BINS)


@wp.func
def not_right_of(items: Items, other: int, item: int, axis: int) -> bool:
    """Whether an item is another one, or comes before it along an axis; where centres coincide, the order they have."""
    theirs = items.low[other][axis] + items.high[other][axis]
    own = items.low[item][axis] + items.high[item][axis]
    return theirs < own or (theirs == own and other <= item)


@wp.func
def place_after(items: Items, begin: int, end: int, item: int, axis: int) -> wp.int64:
    """What `Level.best` has of a split after an item, in the order of an axis; -1 after the last one."""
    left_low, left_high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
    right_low, right_high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
    left = int(0)
    for other in range(begin, end):
        if not_right_of(items, other, item, axis):
            left += 1
            left_low, left_high = wp.min(left_low, items.low[other]), wp.max(left_high, items.high[other])
        else:
            right_low, right_high = wp.min(right_low, items.low[other]), wp.max(right_high, items.high[other])
    right = end - begin - left
    if right == 0:
        return wp.int64(-1)
    cost = split_cost(half_area(left_low, left_high), left, half_area(right_low, right_high), right)
    return (wp.int64(wp.cast(cost, wp.int32)) << wp.int64(_COST_BITS)) | wp.int64((left << _AXIS_BITS) | axis)


@wp.func
def best_count(best: wp.int64) -> int:
    """Items on the left where a small range is split."""
    return int(best & wp.int64((1 << (_COST_BITS - _AXIS_BITS)) - 1)) >> _AXIS_BITS


@wp.func
def best_axis(best: wp.int64) -> int:
    return int(best & wp.int64((1 << _AXIS_BITS) - 1))


@wp.func
def set_child(binary: Binary, node: int, begin: int, end: int, low: wp.vec3, high: wp.vec3, area: float):
    binary.begin[node] = begin
    binary.end[node] = end
    binary.child[node] = -1
    binary.area[node] = area
    binary.low[node] = low
    binary.high[node] = high


@wp.kernel
def load_items(
    # Scene:
    vertices: wp.array[wp.vec3],
    faces: wp.array2d[wp.int32],
    # Out:
    items_out: Items,
):
    """Make an item of each triangle, all of them of node 0."""
    triangle = wp.tid()
    a, b, c = vertices[faces[triangle, 0]], vertices[faces[triangle, 1]], vertices[faces[triangle, 2]]
    items_out.low[triangle] = wp.min(a, wp.min(b, c))
    items_out.high[triangle] = wp.max(a, wp.max(b, c))
    items_out.triangle[triangle] = triangle
    items_out.node[triangle] = wp.where(is_split(faces.shape[0]), 0, -1)


@wp.kernel
def bound_centres(
    # In:
    items: Items,
    threads: int,
    # Out:
    words_out: wp.array2d[wp.int32],
):
    """Grow a box around twice the items' centres; a thread takes one item, and every `threads` items another one."""
    item = wp.tid()
    low, high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
    while item < items.low.shape[0]:
        centre = items.low[item] + items.high[item]
        low, high = wp.min(low, centre), wp.max(high, centre)
        item += threads
    grow_box(words_out, 0, low, high)


@wp.kernel
def begin_tree(
    # In:
    words: wp.array2d[wp.int32],
    item_count: int,
    # Out:
    binary_out: Binary,
):
    """One thread: the root, which holds all items."""
    node = wp.tid()
    set_child(binary_out, node, 0, item_count, box_low(words, 0), box_high(words, 0), 0.0)


@wp.kernel
def mark_ranges(
    # In:
    binary: Binary,
    first: int,
    # Out:
    flags_out: wp.array2d[wp.int32],
):
    """Of each node of a level, in two rows: whether it is large, and whether it is split though it is small."""
    index = wp.tid()
    count = binary.end[first + index] - binary.begin[first + index]
    flags_out[0, index] = int(count > _SMALL)
    flags_out[1, index] = int(is_split(count) and count <= _SMALL)


@wp.kernel
def rank_ranges(
    # In:
    flags: wp.array2d[wp.int32],
    sums: wp.array2d[wp.int32],
    first: int,
    # Out:
    level_out: Level,
    binary_out: Binary,
):
    """List the nodes of a level that are split, by sums of their flags, and give them their children's numbers."""
    row, index = wp.tid()
    if flags[row, index] == 1:
        rank = sums[row, index] - 1
        level_out.nodes[rank] = first + index
        binary_out.child[first + index] = level_out.next + 2 * rank


@wp.kernel
def fill_bins(
    # In:
    items: Items,
    binary: Binary,
    level: Level,
    copies: int,
    # Out:
    boxes_out: wp.array2d[wp.int32],
    counts_out: wp.array[wp.int32],
):
    """Sort the items of large ranges into bins along each axis."""
    item = wp.tid()
    node = items.node[item]
    if node < 0:
        return
    rank = rank_of(binary, level, node)
    if rank >= level.large_count:
        return
    low, high = items.low[item], items.high[item]
    grid_low, grid_high = binary.low[node], binary.high[node]
    for axis in range(3):
        cell = bin_of(low[axis] + high[axis], grid_low[axis], grid_high[axis])
        at = first_bin(rank, (item // _LANES) % copies, copies) + axis * BINS + cell
        grow_box(boxes_out, at, low, high)
        wp.atomic_add(counts_out, at, 1)


@wp.kernel
def merge_bins(
    # In:
    boxes: wp.array2d[wp.int32],
    counts: wp.array[wp.int32],
    copies: int,
    # Out:
    boxes_out: wp.array2d[wp.int32],
    counts_out: wp.array[wp.int32],
):
    """Unite the copies of a bin."""
    rank, place = wp.tid()
    to = first_bin(rank, 0, 1) + place
    count = int(0)
    for copy in range(copies):
        at = first_bin(rank, copy, copies) + place
        count += counts[at]
        for word in range(BIN_WORDS):
            boxes_out[to, word] = wp.min(boxes_out[to, word], boxes[at, word])
    counts_out[to] = count


@wp.func
def best_bin(boxes: wp.array2d[wp.int32], counts: wp.array[wp.int32], rank: int, total: int) -> wp.vec2i:
    """Of all bins but the first of each axis, the one before which a split is cheapest, and the items left of it."""
    right_areas = wp.vector(length=BINS, dtype=float)
    best = wp.vec2i(-1, 0)
    least = float(NOWHERE)
    for line in range(3):
        first = first_bin(rank, 0, 1) + line * BINS
        low, high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
        for step in range(1, BINS):
            at = BINS - step
            low = wp.min(low, box_low(boxes, first + at))
            high = wp.max(high, box_high(boxes, first + at))
            right_areas[at] = half_area(low, high)
        low, high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
        left = int(0)
        for right in range(1, BINS):
            low = wp.min(low, box_low(boxes, first + right - 1))
            high = wp.max(high, box_high(boxes, first + right - 1))
            left += counts[first + right - 1]
            if left > 0 and left < total:
                cost = split_cost(half_area(low, high), left, right_areas[right], total - left)
                if cost < least:
                    least = cost
                    best = wp.vec2i(line * BINS + right, left)
    return best


@wp.func
def bin_child(
    binary: Binary, boxes: wp.array2d[wp.int32], node: int, child: int, first: int, bins: int, begin: int, end: int
):
    """Make a child of all items in some bins."""
    low, high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
    for at in range(first, first + bins):
        low, high = wp.min(low, box_low(boxes, at)), wp.max(high, box_high(boxes, at))
    # Twice a centre lies in the parent's bounds, between bins, and in twice the box.
    centre_low, centre_high = wp.max(binary.low[node], 2.0 * low), wp.min(binary.high[node], 2.0 * high)
    set_child(binary, child, begin, end, centre_low, centre_high, half_area(low, high))


@wp.kernel
def choose_bins(
    # In:
    boxes: wp.array2d[wp.int32],
    counts: wp.array[wp.int32],
    # Out:
    level_out: Level,
    binary_out: Binary,
):
    """Split a large range where it is cheapest between bins; halve it if all items are in one, or it is too deep."""
    rank = wp.tid()
    node = level_out.nodes[rank]
    begin, end, child = binary_out.begin[node], binary_out.end[node], binary_out.child[node]
    best = wp.vec2i(-1, 0)
    if not must_halve(end - begin, level_out.depth):
        best = best_bin(boxes, counts, rank, end - begin)
    if best[0] < 0:
        middle = begin + half_of(end - begin)
        low, high, area = binary_out.low[node], binary_out.high[node], binary_out.area[node]
        level_out.axis[rank] = HALVED
        level_out.left_count[rank] = middle - begin
        set_child(binary_out, child, begin, middle, low, high, area)
        set_child(binary_out, child + 1, middle, end, low, high, area)
        return
    axis, right = best[0] // BINS, best[0] % BINS
    level_out.axis[rank] = axis
    level_out.bin[rank] = right
    level_out.left_count[rank] = best[1]
    middle = begin + best[1]
    first = first_bin(rank, 0, 1) + axis * BINS
    bin_child(binary_out, boxes, node, child, first, right, begin, middle)
    bin_child(binary_out, boxes, node, child + 1, first + right, BINS - right, middle, end)


@wp.kernel
def choose_places(
    # In:
    items: Items,
    binary: Binary,
    level: Level,
    # Out:
    best_out: wp.array[wp.int64],
):
    """Find what it costs to split a small range after an item, in the order of each axis, and keep the least."""
    item = wp.tid()
    node = items.node[item]
    if node < 0:
        return
    rank = rank_of(binary, level, node) - level.large_count
    if rank < 0:
        return
    begin, end = binary.begin[node], binary.end[node]
    if must_halve(end - begin, level.depth):
        best_out[rank] = wp.int64(half_of(end - begin) << _AXIS_BITS) | wp.int64(HALVED)
        return
    for axis in range(3):
        place = place_after(items, begin, end, item, axis)
        if place >= wp.int64(0):
            wp.atomic_min(best_out, rank, place)


@wp.kernel
def find_sides(
    # In:
    items: Items,
    binary: Binary,
    level: Level,
    # Out:
    left_out: wp.array[wp.int32],
    place_out: wp.array[wp.int32],
):
    """Find whether an item of a large range goes left, 1 or 0, and where one of a small range goes."""
    item = wp.tid()
    node = items.node[item]
    left_out[item] = 0
    place_out[item] = item
    if node < 0:
        return
    rank = rank_of(binary, level, node)
    begin = binary.begin[node]
    if rank < level.large_count:
        axis = level.axis[rank]
        if axis == HALVED:
            left_out[item] = int(item - begin < level.left_count[rank])
        else:
            centre = items.low[item][axis] + items.high[item][axis]
            cell = bin_of(centre, binary.low[node][axis], binary.high[node][axis])
            left_out[item] = int(cell < level.bin[rank])
        return
    axis = best_axis(level.best[rank - level.large_count])
    if axis != HALVED:
        place = begin - 1
        for other in range(begin, binary.end[node]):
            place += int(not_right_of(items, other, item, axis))
        place_out[item] = place


@wp.kernel
def move_items(
    # In:
    items: Items,
    binary: Binary,
    level: Level,
    lefts: wp.array[wp.int32],
    before: wp.array[wp.int32],
    places: wp.array[wp.int32],
    # Out:
    items_out: Items,
):
    """Put each item where it goes, those on the left first; `before` counts those of `lefts` that come before it."""
    item = wp.tid()
    node = items.node[item]
    place, child = int(places[item]), int(-1)
    if node >= 0:
        rank = rank_of(binary, level, node)
        begin, end = binary.begin[node], binary.end[node]
        count = int(0)
        if rank < level.large_count:
            count = level.left_count[rank]
            left = before[item] - before[begin]
            place = wp.where(lefts[item] == 1, begin + left, item + count - left)
        else:
            count = best_count(level.best[rank - level.large_count])
        child = binary.child[node] + int(place - begin >= count)
        if not is_split(wp.where(place - begin < count, count, end - begin - count)):
            child = -1
    items_out.low[place] = items.low[item]
    items_out.high[place] = items.high[item]
    items_out.triangle[place] = items.triangle[item]
    items_out.node[place] = child


@wp.kernel
def part_small(
    # In:
    items: Items,
    level: Level,
    # Out:
    binary_out: Binary,
):
    """Make the children of a small range, whose items have been put where they go."""
    rank = wp.tid()
    node = level.nodes[level.large_count + rank]
    begin, end = binary_out.begin[node], binary_out.end[node]
    middle = begin + best_count(level.best[rank])
    for side in range(2):
        low, high = wp.vec3(NOWHERE), wp.vec3(-NOWHERE)
        first, last = wp.where(side == 0, begin, middle), wp.where(side == 0, middle, end)
        for item in range(first, last):
            low, high = wp.min(low, items.low[item]), wp.max(high, items.high[item])
        set_child(binary_out, binary_out.child[node] + side, first, last, low, high, half_area(low, high))
