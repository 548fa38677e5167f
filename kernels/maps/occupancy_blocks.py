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


@wp.kernel
def list_blocks(
    # In:
    blocks: Blocks,
    lower: wp.vec3i,
    updates_in: wp.array3d[wp.uint8],
    # Out:
    listed_out: wp.array[wp.vec4i],
    counts_out: wp.array[wp.int32],
):
    """List the blocks that need an update as x, y, z and update; count them and those without a slot."""
    i, j, k = wp.tid()
    update = updates_in[i, j, k]
    if update == SKIPPED:
        return
    block = lower + wp.vec3i(i, j, k)
    row = wp.atomic_add(counts_out, 0, 1)
    if row < listed_out.shape[0]:
        listed_out[row] = wp.vec4i(block[0], block[1], block[2], int(update))
    if blocks.slot[block[0], block[1], block[2]] < 0:
        wp.atomic_add(counts_out, 1, 1)


@wp.kernel
def fill_blocks(
    # In:
    listed_in: wp.array[wp.vec4i],
    free_slots: wp.array[wp.int32],
    # Out:
    blocks_out: Blocks,
    taken_out: wp.array[wp.int32],
):
    """Give slots from a list to the listed blocks without one; `taken_out` counts them."""
    row = wp.tid()
    block = listed_in[row]
    if blocks_out.slot[block[0], block[1], block[2]] >= 0:
        return
    slot = free_slots[wp.atomic_add(taken_out, 0, 1)]
    value = blocks_out.uniform[block[0], block[1], block[2]]
    for index in range(VOXELS):
        blocks_out.voxels[slot, index] = value
    blocks_out.uniform[block[0], block[1], block[2]] = NEVER_SEEN
    blocks_out.slot[block[0], block[1], block[2]] = slot


@wp.kernel
def summarize_blocks(
    # In:
    blocks: Blocks,
    listed_in: wp.array[wp.vec4i],
    # Out:
    summaries_out: wp.array[wp.int32],
):
    """Write for listed blocks 1 if their voxels all have one value, plus 2 if a voxel has never been seen."""
    row = wp.tid()
    slot = blocks.slot[listed_in[row][0], listed_in[row][1], listed_in[row][2]]
    first = blocks.voxels[slot, 0]
    is_uniform, has_unseen = int(1), int(0)
    for index in range(VOXELS):
        value = blocks.voxels[slot, index]
        if value != first:
            is_uniform = 0
        if value == NEVER_SEEN:
            has_unseen = 1
        if is_uniform == 0 and has_unseen == 1:
            break
    summaries_out[row] = is_uniform + 2 * has_unseen


@wp.kernel
def release_blocks(
    # In:
    listed_in: wp.array[wp.vec4i],
    summaries_in: wp.array[wp.int32],
    # Out:
    blocks_out: Blocks,
    free_slots_out: wp.array[wp.int32],
    count_out: wp.array[wp.int32],
):
    """Take the slots of listed blocks whose voxels all have one value; note which others have a voxel never seen."""
    row = wp.tid()
    x, y, z = listed_in[row][0], listed_in[row][1], listed_in[row][2]
    if summaries_in[row] % 2 == 0:
        blocks_out.uniform[x, y, z] = wp.where(summaries_in[row] == 0, NOT_MEASURED, NEVER_SEEN)
        return
    slot = blocks_out.slot[x, y, z]
    blocks_out.uniform[x, y, z] = blocks_out.voxels[slot, 0]
    blocks_out.slot[x, y, z] = -1
    free_slots_out[wp.atomic_add(count_out, 0, 1)] = slot


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
