# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Integration of depth images into the blocks of an occupancy map.

One image after the other is integrated, in four steps:

1. `bound_surface` of `occupancy_images` turns depth into an interval that contains the surface, and `bound_tiles`
   bounds tiles of pixels.
2. `judge_blocks` finds the blocks that are entirely free or entirely hidden; those without a slot it updates at once.
3. `list_blocks` and `fill_blocks` of `occupancy_blocks` list the other blocks and give slots to them, `mark_points`
   marks the voxels that contain the point of a pixel.
4. `update_voxels` updates the voxels of the listed blocks, and `release_blocks` takes the slots of uniform ones.

Nothing of this waits for the host, so that a GPU works on many images in succession.
"""

import warp as wp

from warpvis.kernels.maps.occupancy_blocks import (
    ENTIRELY_FREE,
    ENTIRELY_HIDDEN,
    LISTED,
    MAX_VALUE,
    MIN_VALUE,
    MIXED,
    NEVER_SEEN,
    NOT_MEASURED,
    SIDE,
    SKIPPED,
    BlockBox,
    BlockList,
    Blocks,
    is_inside,
    is_stopped,
    offset_in_block,
    voxel_of,
)
from warpvis.kernels.maps.occupancy_images import TILE, DepthView, SurfaceLimits, Tiles, merge_limits
from warpvis.kernels.maps.voxels import FREE, HIDDEN, SURFACE, UNKNOWN
from warpvis.kernels.pinhole import PinholeCamera, Window, locate, pixel_ray, shown_between

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

# Half the diagonal of a voxel, in voxels: the maximum distance of a surface from the center of a voxel that it hits.
_HALF_DIAGONAL = wp.constant(0.8661)


@wp.func
def add_log_odds(view: DepthView, value: wp.int16, change: int) -> wp.int16:
    """Return a voxel's value after a hit or a miss."""
    old = int(value)
    if value <= NOT_MEASURED:
        old = 0
    return wp.int16(wp.clamp(old + change, view.minimum, view.maximum))


@wp.func
def hide(value: wp.int16) -> wp.int16:
    """Return a voxel's value after it was hidden."""
    return wp.where(value == NEVER_SEEN, NOT_MEASURED, value)


@wp.func
def block_corner(view: DepthView, blocks: Blocks, block: wp.vec3i) -> wp.vec3d:
    """Return the vector from the camera to the lower corner of a block, along the world's axes [m]."""
    place = blocks.first + block
    side = wp.float64(SIDE) * blocks.cell
    return side * wp.vec3d(wp.float64(place[0]), wp.float64(place[1]), wp.float64(place[2])) - view.origin


@wp.func
def project_interval(middle: float, extent: float, near_z: float, far_z: float) -> wp.vec2:
    """Return bounds of x / z for x in ``middle +- extent`` and z in a positive interval."""
    low, high = middle - extent, middle + extent
    return wp.vec2(low / wp.where(low < 0.0, near_z, far_z), high / wp.where(high > 0.0, near_z, far_z))


@wp.struct
class Footprint:
    """Bounds of a block in the camera frame."""

    near_z: float
    far_z: float
    low: wp.vec2  # image coordinates [px]
    high: wp.vec2
    is_seen: bool  # a part may be in the image and in range
    is_whole: bool  # every voxel is


@wp.func
def is_beside(camera: PinholeCamera, center: wp.vec3, extent: wp.vec3, far_z: float) -> bool:
    """Return whether a box is at the side of the image, with a margin of a pixel. This rejects most blocks."""
    right, left = center[0] - extent[0], center[0] + extent[0]
    below, above = center[1] - extent[1], center[1] + extent[1]
    center_x, center_y = float(camera.cx) + 1.0, float(camera.cy) + 1.0
    return (
        float(camera.fx) * right > (camera.width + 2.0 - center_x) * far_z
        or float(camera.fx) * left < -center_x * far_z
        or float(camera.fy) * below > (camera.height + 2.0 - center_y) * far_z
        or float(camera.fy) * above < -center_y * far_z
    )


@wp.func
def footprint_of(view: DepthView, center: wp.vec3, extent: wp.vec3) -> Footprint:
    """Return the bounds of a block from its center and half its bounding box in the camera frame [m]."""
    result = Footprint()
    camera = view.camera
    result.near_z = center[2] - extent[2]
    result.far_z = center[2] + extent[2]
    if result.far_z <= 0.0 or result.near_z > view.reach:
        return result
    if is_beside(camera, center, extent, result.far_z):
        return result
    near_z = wp.max(result.near_z, 1.0e-6 * result.far_z)  # points at z = 0 have no image
    across = project_interval(center[0], extent[0], near_z, result.far_z)
    down = project_interval(center[1], extent[1], near_z, result.far_z)
    focal_length = wp.vec2(float(camera.fx), float(camera.fy))
    principal_point = wp.vec2(float(camera.cx), float(camera.cy))
    one_pixel = wp.vec2(1.0, 1.0)  # more than the rounding error
    result.low = wp.cw_mul(focal_length, wp.vec2(across[0], down[0])) + principal_point - one_pixel
    result.high = wp.cw_mul(focal_length, wp.vec2(across[1], down[1])) + principal_point + one_pixel
    size = wp.vec2(camera.width, camera.height)
    result.is_seen = (
        result.high[0] >= 0.0 and result.high[1] >= 0.0 and result.low[0] < size[0] and result.low[1] < size[1]
    )
    in_image = result.low[0] >= 0.0 and result.low[1] >= 0.0 and result.high[0] < size[0] and result.high[1] < size[1]
    result.is_whole = in_image and result.near_z > 0.0 and result.far_z <= view.reach
    return result


@wp.func
def limits_of(view: DepthView, seen: Footprint, tiles: Tiles, margin: float) -> SurfaceLimits:
    """Return what the tiles of a footprint show, or some of them if these may contain a surface in the block."""
    first = wp.vec2i(int(wp.max(seen.low[0], 0.0)) / TILE, int(wp.max(seen.low[1], 0.0)) / TILE)
    last = wp.vec2i(
        int(wp.min(seen.high[0], view.camera.width - 1.0)) / TILE,
        int(wp.min(seen.high[1], view.camera.height - 1.0)) / TILE,
    )
    near_z, far_z = seen.near_z - margin, seen.far_z + margin
    if last[0] - first[0] < TILE and last[1] - first[1] < TILE:
        return merge_limits(tiles.small, first, last, near_z, far_z)
    return merge_limits(tiles.large, first / TILE, last / TILE, near_z, far_z)


@wp.func
def judge_block(view: DepthView, blocks: Blocks, block: wp.vec3i, seen: Footprint, tiles: Tiles) -> wp.uint8:
    """Return which update a block needs; MIXED if in doubt."""
    value = blocks.uniform[block[0], block[1], block[2]]
    is_uniform = blocks.slot[block[0], block[1], block[2]] < 0
    margin = _HALF_DIAGONAL * float(blocks.cell)
    limits = limits_of(view, seen, tiles, margin)
    if limits.high == 0.0:  # no pixel has a measurement
        return SKIPPED
    is_whole = seen.is_whole and not limits.has_gaps
    if limits.low > seen.far_z + margin:
        if is_uniform and int(value) == view.minimum:
            return SKIPPED
        return wp.where(is_whole, ENTIRELY_FREE, MIXED)
    if limits.high < seen.near_z - margin:
        if value != NEVER_SEEN:
            return SKIPPED
        return wp.where(is_whole, ENTIRELY_HIDDEN, MIXED)
    return MIXED


@wp.kernel
def judge_blocks(
    # Cameras:
    window: Window,
    image: int,
    views: wp.array[DepthView],
    # In:
    boxes: wp.array[BlockBox],
    span: int,
    tiles: Tiles,
    listed: BlockList,
    # Out:
    blocks_out: Blocks,
    updates_out: wp.array3d[wp.uint8],
):
    """Update uniform blocks that are entirely free or hidden, and write which others need an update.

    The launch covers the image's box of blocks. A thread judges `span` blocks.
    """
    i, j, part = wp.tid()
    i, j = locate(window, i, j)
    if is_stopped(listed, image):
        return

    view, box = views[image], boxes[image]
    row_center = box.first_center + float(i) * box.step[0] + float(j) * box.step[1]
    for k in range(part * span, wp.min(part * span + span, box.size[2])):
        update = SKIPPED
        seen = footprint_of(view, row_center + float(k) * box.step[2], box.extent)
        if seen.is_seen:
            block = box.lower - blocks_out.first + wp.vec3i(i, j, k)
            update = judge_block(view, blocks_out, block, seen, tiles)
            if update != MIXED and blocks_out.slot[block[0], block[1], block[2]] < 0:
                value = blocks_out.uniform[block[0], block[1], block[2]]
                if update == ENTIRELY_FREE:
                    blocks_out.uniform[block[0], block[1], block[2]] = add_log_odds(view, value, view.miss)
                elif update == ENTIRELY_HIDDEN:
                    blocks_out.uniform[block[0], block[1], block[2]] = hide(value)
                update = SKIPPED
        updates_out[i, j, k] = update


@wp.kernel
def mark_points(
    # Cameras:
    window: Window,
    image: int,
    views: wp.array[DepthView],
    # In:
    listed: BlockList,
    blocks: Blocks,
    depth_in: wp.array3d[float],
    # Out:
    marks_out: wp.array2d[wp.uint8],
):
    """Mark the voxels that contain the point of a pixel, in blocks with a slot."""
    index, y, x = wp.tid()
    index, y = locate(window, index, y)
    if is_stopped(listed, image + 1):
        return

    view = views[image]
    depth = shown_between(view.camera.near, view.reach, depth_in[image, y, x])
    if not wp.isfinite(depth):
        return
    direction = wp.transpose(view.rotation) * pixel_ray(view.camera, y, x)
    voxel = voxel_of(blocks, view.origin + wp.float64(depth) * direction)
    if is_inside(blocks, voxel):
        slot = blocks.slot[voxel[0] / SIDE, voxel[1] / SIDE, voxel[2] / SIDE]
        if slot >= 0:
            marks_out[slot, offset_in_block(voxel)] = wp.uint8(1)


@wp.func
def judge_voxel(
    view: DepthView,
    bounds: wp.array3d[wp.vec2],
    position: wp.vec3,
    sight: wp.vec3,
    half_cell: float,
    contains_point: bool,
) -> wp.uint8:
    """Return the state of a voxel in a depth image, UNKNOWN if it contains no information.

    Args:
        view: The image's camera.
        bounds: Intervals that contain the surface, see `bound_surface`.
        position: Center of the voxel in the camera frame [m].
        sight: The same vector along the world's axes [m].
        half_cell: Half the side of a voxel [m].
        contains_point: Whether the voxel contains the point of a pixel.
    """
    z = position[2]
    if z > view.reach or z <= 0.0:
        return UNKNOWN
    x = float(view.camera.fx) * position[0] / z + float(view.camera.cx)
    y = float(view.camera.fy) * position[1] / z + float(view.camera.cy)
    if not (x >= 0.0 and x < view.camera.width and y >= 0.0 and y < view.camera.height):
        return UNKNOWN
    if contains_point:
        return SURFACE
    limits = bounds[0, int(y), int(x)]
    # Where the ray through the center is in the voxel, along the world axis of its largest component.
    reach = half_cell * z / wp.max(wp.abs(sight))
    if z < limits[0] - reach:
        return FREE
    if z > limits[1] + reach:
        return HIDDEN
    return wp.where(limits[0] > 0.0, SURFACE, UNKNOWN)


@wp.func
def update_row(
    view: DepthView,
    bounds: wp.array3d[wp.vec2],
    block_update: wp.vec4i,
    i: int,
    j: int,
    blocks: Blocks,
    marks: wp.array2d[wp.uint8],
) -> wp.vec2i:
    """Update a row of voxels along z, clear their marks, and return the minimum and maximum value."""
    block, update = wp.vec3i(block_update[0], block_update[1], block_update[2]), wp.uint8(block_update[3] % 4)
    slot = blocks.slot[block[0], block[1], block[2]]
    cell, half = blocks.cell, wp.float64(0.5)
    center = wp.vec3d(wp.float64(i) + half, wp.float64(j) + half, half)
    sight_d = block_corner(view, blocks, block) + cell * center
    sight = wp.vec3(sight_d)
    position = wp.vec3(view.rotation * sight_d)
    step = wp.vec3(cell * view.rotation * wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0)))
    half_cell = 0.5 * float(cell)
    low, high = int(MAX_VALUE), int(MIN_VALUE)
    for k in range(SIDE):
        offset = (i * SIDE + j) * SIDE + k
        value = blocks.voxels[slot, offset]
        state = wp.where(update == ENTIRELY_FREE, FREE, HIDDEN)
        if update == MIXED:
            along = float(k)
            place = sight + wp.vec3(0.0, 0.0, along * float(cell))
            is_marked = marks[slot, offset] != wp.uint8(0)
            state = judge_voxel(view, bounds, position + along * step, place, half_cell, is_marked)
            if is_marked:
                marks[slot, offset] = wp.uint8(0)
        if state == SURFACE:
            value = add_log_odds(view, value, view.hit)
        elif state == FREE:
            value = add_log_odds(view, value, view.miss)
        elif state == HIDDEN:
            value = hide(value)
        blocks.voxels[slot, offset] = value
        low, high = wp.min(low, int(value)), wp.max(high, int(value))
    return wp.vec2i(low, high)


@wp.kernel
def update_voxels(
    # Cameras:
    window: Window,
    image: int,
    views: wp.array[DepthView],
    # In:
    rows: int,
    bounds_in: wp.array3d[wp.vec2],
    # Out:
    listed_out: BlockList,
    blocks_out: Blocks,
    marks_out: wp.array2d[wp.uint8],
):
    """Update the voxels of listed blocks, and write the ranges of their values.

    The launch has the shape ``(rows, SIDE, SIDE)``; a thread updates a row of voxels in every `rows`-th block.
    """
    first, i, j = wp.tid()
    first, i = locate(window, first, i)
    if is_stopped(listed_out, image + 1):
        return

    view = views[image]
    for row in range(first, listed_out.counts[image, LISTED], rows):
        values = update_row(view, bounds_in, listed_out.blocks[row], i, j, blocks_out, marks_out)
        wp.atomic_min(listed_out.ranges, row, 0, values[0])
        wp.atomic_max(listed_out.ranges, row, 1, values[1])
