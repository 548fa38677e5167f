# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The blocks of an occupancy map: log-odds of voxels, and their states.

Log-odds of occupancy are 16-bit integers in units of 1/1024. Two values below all log-odds stand for voxels that were
not measured. A block without a slot has the same value in all its voxels.
"""

import warp as wp

from warpvis.kernels.constants import (
    LABEL_EMPTY,
    LABEL_GROUND,
    VOXEL_BLOCK_SIDE,
    VOXEL_BLOCK_SIZE,
    VOXEL_HIDDEN,
    VOXEL_NEVER_SEEN,
)
from warpvis.kernels.maps.voxels import FREE, HIDDEN, OBSTACLE, SURFACE, UNKNOWN
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.visibility.points import locate_point

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

SIDE = VOXEL_BLOCK_SIDE
"""Voxels along an edge of a block."""

VOXELS = VOXEL_BLOCK_SIZE

LOG_ODDS_UNIT = 1.0 / 1024.0
"""Step of stored log-odds."""

NEVER_SEEN = wp.constant(wp.int16(VOXEL_NEVER_SEEN))
NOT_MEASURED = wp.constant(wp.int16(VOXEL_HIDDEN))
"""Stored values of voxels in state UNKNOWN and HIDDEN, which are less than all log-odds."""

MIN_VALUE, MAX_VALUE = VOXEL_NEVER_SEEN, 32767
"""Bounds of stored values."""

EMPTY, GROUND = wp.constant(wp.uint8(LABEL_EMPTY)), wp.constant(wp.uint8(LABEL_GROUND))

SKIPPED, ENTIRELY_FREE, ENTIRELY_HIDDEN, MIXED = (wp.constant(wp.uint8(value)) for value in range(4))
"""What `occupancy.judge_blocks` finds for a block: nothing to update, one state of all its voxels, or several."""


@wp.struct
class Blocks:
    """A grid of blocks, ``[x, y, z]``; block 0 begins at `first` blocks from the world's origin."""

    first: wp.vec3i
    cell: wp.float64  # side of a voxel [m]
    slot: wp.array3d[wp.int32]  # row of `voxels`, -1 if all voxels of the block have the value `uniform`
    uniform: wp.array3d[wp.int16]  # with a slot, NEVER_SEEN if a voxel may have this value
    voxels: wp.array2d[wp.int16]  # (slots, VOXELS)


@wp.func
def voxel_of(blocks: Blocks, point: wp.vec3d) -> wp.vec3i:
    """Return the indices of the voxel that contains a point, counted from the first block."""
    result = wp.vec3i()
    for axis in range(3):
        result[axis] = int(wp.floor(point[axis] / blocks.cell)) - SIDE * blocks.first[axis]
    return result


@wp.func
def is_inside(blocks: Blocks, voxel: wp.vec3i) -> bool:
    """Return whether the grid contains a voxel."""
    return (
        voxel[0] >= 0
        and voxel[1] >= 0
        and voxel[2] >= 0
        and voxel[0] < SIDE * blocks.slot.shape[0]
        and voxel[1] < SIDE * blocks.slot.shape[1]
        and voxel[2] < SIDE * blocks.slot.shape[2]
    )


@wp.func
def offset_in_block(voxel: wp.vec3i) -> int:
    return (voxel[0] % SIDE * SIDE + voxel[1] % SIDE) * SIDE + voxel[2] % SIDE


@wp.struct
class BlockBox:
    """Blocks that an image may show."""

    lower: wp.vec3i  # first block, counted from the world's origin
    size: wp.vec3i
    first_center: wp.vec3  # center of the first block in the camera frame [m]
    step: wp.mat33  # in its rows the offsets to the next blocks along x, y and z [m]
    extent: wp.vec3  # half the size of a block's bounding box along the camera's axes [m]


FREE_SLOTS, LISTED, NEW = (wp.constant(index) for index in range(3))
"""Columns of `BlockList.counts`."""


@wp.struct
class BlockList:
    """The blocks that an image changes, and slots for those without one.

    Each image has a row of `counts`: the number of free slots before it, of listed blocks, and of those without a slot.
    Free slots are -1 if slots or the list did not suffice for an earlier image; then nothing happens until the host
    adds some.
    """

    blocks: wp.array[wp.vec4i]  # x, y, z, and the update plus 4 times the number among the new ones, from 1 on
    counts: wp.array2d[wp.int32]  # [image, column]
    free_slots: wp.array[wp.int32]
    ranges: wp.array2d[wp.int32]  # minimum and maximum value of each listed block


@wp.func
def is_stopped(listed: BlockList, image: int) -> bool:
    """Return whether an earlier image waits for slots."""
    return listed.counts[image, FREE_SLOTS] < 0


@wp.kernel
def list_blocks(
    # In:
    image: int,
    boxes: wp.array[BlockBox],
    blocks: Blocks,
    updates_in: wp.array3d[wp.uint8],
    # Out:
    listed_out: BlockList,
):
    """List the blocks that need an update, and count them and those without a slot."""
    i, j, k = wp.tid()
    if is_stopped(listed_out, image) or updates_in[i, j, k] == SKIPPED:
        return
    block = boxes[image].lower - blocks.first + wp.vec3i(i, j, k)
    number = int(0)
    if blocks.slot[block[0], block[1], block[2]] < 0:
        number = wp.atomic_add(listed_out.counts, image, NEW, 1) + 1
    row = wp.atomic_add(listed_out.counts, image, LISTED, 1)
    if row < listed_out.blocks.shape[0]:
        listed_out.blocks[row] = wp.vec4i(block[0], block[1], block[2], int(updates_in[i, j, k]) + 4 * number)


@wp.kernel
def fill_blocks(
    # In:
    image: int,
    rows: int,
    parts: int,
    # Out:
    listed_out: BlockList,
    blocks_out: Blocks,
):
    """Give slots to the listed blocks without one.

    The launch has the shape ``(rows, parts)``; a thread writes every `parts`-th line of every `rows`-th block. If
    there are too few slots, or too many blocks for the list, the next image's number of free slots remains -1.
    """
    first, part = wp.tid()
    free, new = listed_out.counts[image, FREE_SLOTS], listed_out.counts[image, NEW]
    count = listed_out.counts[image, LISTED]
    if free < new or listed_out.blocks.shape[0] < count:
        return
    if first == 0 and part == 0:
        listed_out.counts[image + 1, FREE_SLOTS] = free - new
    for row in range(first, count, rows):
        block = listed_out.blocks[row]
        if part == 0:
            listed_out.ranges[row, 0] = MAX_VALUE
            listed_out.ranges[row, 1] = MIN_VALUE
        number = block[3] / 4
        if number > 0:
            slot = listed_out.free_slots[free - number]
            value = blocks_out.uniform[block[0], block[1], block[2]]
            for line in range(part, VOXELS / SIDE, parts):
                for k in range(SIDE):
                    blocks_out.voxels[slot, line * SIDE + k] = value
            if part == 0:
                blocks_out.slot[block[0], block[1], block[2]] = slot


@wp.kernel
def release_blocks(
    # In:
    image: int,
    rows: int,
    # Out:
    listed_out: BlockList,
    blocks_out: Blocks,
):
    """Take the slots of listed blocks whose voxels all have one value; note which others have a voxel never seen."""
    first = wp.tid()
    if is_stopped(listed_out, image + 1):
        return
    for row in range(first, listed_out.counts[image, LISTED], rows):
        x, y, z = listed_out.blocks[row][0], listed_out.blocks[row][1], listed_out.blocks[row][2]
        low, high = wp.int16(listed_out.ranges[row, 0]), wp.int16(listed_out.ranges[row, 1])
        if low == high:
            blocks_out.uniform[x, y, z] = low
            place = wp.atomic_add(listed_out.counts, image + 1, FREE_SLOTS, 1)
            listed_out.free_slots[place] = blocks_out.slot[x, y, z]
            blocks_out.slot[x, y, z] = -1
        else:
            blocks_out.uniform[x, y, z] = wp.where(low == NEVER_SEEN, NEVER_SEEN, NOT_MEASURED)


@wp.kernel
def fade(
    # Cameras:
    window: Window,
    # In:
    factor: float,
    # Out:
    values_out: wp.array3d[wp.int16],
):
    """Multiply log-odds by a factor, rounding toward 0."""
    i, j, k = wp.tid()
    i, j = locate(window, i, j)

    value = values_out[i, j, k]
    if value > NOT_MEASURED:
        values_out[i, j, k] = wp.int16(float(value) * factor)


@wp.func
def value_at(blocks: Blocks, voxel: wp.vec3i) -> wp.int16:
    """Return the value of a voxel."""
    if not is_inside(blocks, voxel):
        return NEVER_SEEN
    x, y, z = voxel[0] / SIDE, voxel[1] / SIDE, voxel[2] / SIDE
    slot = blocks.slot[x, y, z]
    if slot < 0:
        return blocks.uniform[x, y, z]
    return blocks.voxels[slot, offset_in_block(voxel)]


@wp.func
def state_of(value: wp.int16) -> wp.uint8:
    """Return the state of a voxel."""
    if value == NEVER_SEEN:
        return UNKNOWN
    if value == NOT_MEASURED:
        return HIDDEN
    return wp.where(value >= wp.int16(0), SURFACE, FREE)


@wp.kernel
def write_states(
    # Cameras:
    window: Window,
    # In:
    blocks: Blocks,
    lower: wp.vec3i,
    up_axis: int,
    ground_levels: int,
    # Out:
    states_out: wp.array3d[wp.uint8],
    labels_out: wp.array3d[wp.uint8],
):
    """Write states and labels of a box of voxels; surfaces in its lowest `ground_levels` levels are ground.

    The box begins at the voxel `lower`, counted from the world's origin.
    """
    i, j, k = wp.tid()
    i, j = locate(window, i, j)

    voxel = wp.vec3i(i, j, k)
    state = state_of(value_at(blocks, lower + voxel - SIDE * blocks.first))
    states_out[i, j, k] = state
    label = EMPTY
    if state == SURFACE:
        label = wp.where(voxel[up_axis] < ground_levels, GROUND, OBSTACLE)
    labels_out[i, j, k] = label


@wp.kernel
def write_states_at(
    # Cameras:
    window: Window,
    # In:
    blocks: Blocks,
    points: wp.array[wp.vec3],
    # Out:
    states_out: wp.array[wp.uint8],
    probabilities_out: wp.array[float],
):
    """Write the state of the voxel of each point, and the probability that it is occupied, NaN if not measured."""
    view, row, column = wp.tid()
    view, index = locate_point(window, view, row, column)
    if index >= points.shape[0]:
        return
    value = value_at(blocks, voxel_of(blocks, wp.vec3d(points[index])))
    if states_out:
        states_out[index] = state_of(value)
    if probabilities_out:
        probability = float(wp.nan)
        if value > NOT_MEASURED:
            probability = 1.0 / (1.0 + wp.exp(-LOG_ODDS_UNIT * float(value)))
        probabilities_out[index] = probability
