# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Integration of depth images into the blocks of an occupancy map.

One image after the other is integrated, in four steps:

1. `bound_surface` turns depth into an interval that contains the surface, and `bound_tiles` bounds tiles of pixels.
2. `judge_blocks` finds the blocks that are entirely free or entirely hidden; those without a slot it updates at once.
3. `list_blocks` and `fill_blocks` of `occupancy_blocks` list the other blocks and give slots to them, `mark_points`
   marks the voxels that contain the point of a pixel.
4. `update_voxels` updates the voxels of the listed blocks.
"""

import warp as wp

from warpvis.kernels.maps.occupancy_blocks import (
    ENTIRELY_FREE,
    ENTIRELY_HIDDEN,
    MIXED,
    NEVER_SEEN,
    NOT_MEASURED,
    SIDE,
    SKIPPED,
    Blocks,
    is_inside,
    offset_in_block,
    voxel_of,
)
from warpvis.kernels.maps.voxels import FREE, HIDDEN, SURFACE, UNKNOWN
from warpvis.kernels.pinhole import PinholeCamera, Window, locate, pixel_ray, shown_between

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

TILE = 8
"""Pixels along an edge of a tile."""

MAX_SAME_SURFACE_STEP = 0.03
"""Largest relative difference in depth of neighboring pixels of one surface.

A plane that the line of sight meets at an angle of 4 degrees has this difference with a focal length of 525 pixels.
"""

# Half the diagonal of a voxel, in voxels: the maximum distance of a surface from the center of a voxel that it hits.
_HALF_DIAGONAL = wp.constant(0.8661)


@wp.struct
class DepthView:
    """Camera, pose and noise of one depth image, and the changes of log-odds."""

    camera: PinholeCamera
    origin: wp.vec3d
    rotation: wp.mat33d  # world to camera
    block_extent: wp.vec3  # half the size of a block's bounding box along the camera's axes [m]
    reach: float  # depth to which the image is used [m]
    sigma: wp.vec3  # standard deviation of depth [m]: coefficients of 1, z and z^2
    hit: wp.int32
    miss: wp.int32  # negative
    minimum: wp.int32
    maximum: wp.int32


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
def depth_sigma(view: DepthView, z: float) -> float:
    """Return the standard deviation of depth [m]."""
    return wp.max(view.sigma[0] + z * (view.sigma[1] + z * view.sigma[2]), 0.0)


@wp.func
def widen(bounds: wp.vec2, depth: float, neighbor: float, max_step: float) -> wp.vec2:
    """Extend an interval to the border with a neighbor pixel, if that is on the same surface."""
    if not wp.abs(neighbor - depth) <= max_step:
        return bounds
    border = 0.5 * (depth + neighbor)
    return wp.vec2(wp.min(bounds[0], border), wp.max(bounds[1], border))


@wp.kernel
def bound_surface(
    # Cameras:
    window: Window,
    view: DepthView,
    # In:
    depth_in: wp.array3d[float],
    # Out:
    bounds_out: wp.array3d[wp.vec2],
):
    """Write the interval of depth that contains the surface of each pixel.

    In front of the interval the pixel is free, behind it hidden. On a surface that continues in the neighbor pixels the
    interval extends to the pixel's borders, and by one standard deviation on both sides. It is (0, inf) without a
    measurement, and (inf, inf) without a surface within the range.
    """
    index, y, x = wp.tid()
    index, y = locate(window, index, y)

    depth = shown_between(view.camera.near, view.reach, depth_in[index, y, x])
    if wp.isnan(depth):
        bounds_out[index, y, x] = wp.vec2(0.0, wp.inf)
        return
    if not wp.isfinite(depth):
        bounds_out[index, y, x] = wp.where(depth > 0.0, wp.vec2(wp.inf, wp.inf), wp.vec2(0.0, view.camera.near))
        return
    sigma = depth_sigma(view, depth)
    max_step = 3.0 * sigma + MAX_SAME_SURFACE_STEP * depth
    bounds = wp.vec2(depth, depth)
    if x > 0:
        bounds = widen(bounds, depth, depth_in[index, y, x - 1], max_step)
    if x + 1 < depth_in.shape[2]:
        bounds = widen(bounds, depth, depth_in[index, y, x + 1], max_step)
    if y > 0:
        bounds = widen(bounds, depth, depth_in[index, y - 1, x], max_step)
    if y + 1 < depth_in.shape[1]:
        bounds = widen(bounds, depth, depth_in[index, y + 1, x], max_step)
    bounds_out[index, y, x] = wp.vec2(bounds[0] - sigma, bounds[1] + sigma)


@wp.struct
class SurfaceLimits:
    """What the pixels of a region show."""

    low: float  # minimum of the intervals that contain the surface, inf without a measurement
    high: float  # their maximum, 0 without a measurement
    has_gaps: bool  # whether pixels without a measurement are among them


@wp.func
def include(limits: SurfaceLimits, tile: wp.vec3) -> SurfaceLimits:
    limits.low = wp.min(limits.low, tile[0])
    limits.high = wp.max(limits.high, tile[1])
    limits.has_gaps = limits.has_gaps or tile[2] > 0.0
    return limits


@wp.kernel
def bound_tiles(
    # Cameras:
    window: Window,
    # In:
    bounds_in: wp.array3d[wp.vec2],
    # Out:
    tiles_out: wp.array3d[wp.vec3],
):
    """Write the `SurfaceLimits` of tiles."""
    index, row, column = wp.tid()
    index, row = locate(window, index, row)

    low, high, gaps = float(wp.inf), float(0.0), float(0.0)
    for y in range(row * TILE, wp.min(row * TILE + TILE, bounds_in.shape[1])):
        for x in range(column * TILE, wp.min(column * TILE + TILE, bounds_in.shape[2])):
            bounds = bounds_in[index, y, x]
            if bounds[0] == 0.0 and bounds[1] == wp.inf:
                gaps = 1.0
            else:
                low, high = wp.min(low, bounds[0]), wp.max(high, bounds[1])
    tiles_out[index, row, column] = wp.vec3(low, high, gaps)


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
def footprint_of(view: DepthView, center: wp.vec3) -> Footprint:
    """Return the bounds of a block from its center in the camera frame [m]."""
    result = Footprint()
    camera, extent = view.camera, view.block_extent
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
def limits_of(view: DepthView, seen: Footprint, tiles: wp.array3d[wp.vec3], margin: float) -> SurfaceLimits:
    """Return what the tiles of a footprint show, or of its first rows if these may contain a surface in the block."""
    limits = SurfaceLimits()
    limits.low = wp.inf
    limits.high = 0.0
    first_row, first_column = int(wp.max(seen.low[1], 0.0)) / TILE, int(wp.max(seen.low[0], 0.0)) / TILE
    last_row = int(wp.min(seen.high[1], view.camera.height - 1.0)) / TILE
    last_column = int(wp.min(seen.high[0], view.camera.width - 1.0)) / TILE
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            limits = include(limits, tiles[0, row, column])
        if limits.low <= seen.far_z + margin and limits.high >= seen.near_z - margin:
            return limits
    return limits


@wp.func
def judge_block(
    view: DepthView, blocks: Blocks, block: wp.vec3i, seen: Footprint, tiles: wp.array3d[wp.vec3]
) -> wp.uint8:
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
    view: DepthView,
    # In:
    lower: wp.vec3i,
    first_center: wp.vec3,
    step: wp.mat33,
    span: int,
    tiles_in: wp.array3d[wp.vec3],
    # Out:
    blocks_out: Blocks,
    updates_out: wp.array3d[wp.uint8],
):
    """Update uniform blocks that are entirely free or hidden, and write which others need an update.

    The launch covers the blocks from `lower` on. `first_center` is the center of the first one in the camera frame [m],
    and `step` contains in its rows the offsets to the next blocks along x, y and z. A thread judges `span` blocks.
    """
    i, j, part = wp.tid()
    i, j = locate(window, i, j)

    row_center = first_center + float(i) * step[0] + float(j) * step[1]
    for k in range(part * span, wp.min(part * span + span, updates_out.shape[2])):
        update = SKIPPED
        seen = footprint_of(view, row_center + float(k) * step[2])
        if seen.is_seen:
            block = lower + wp.vec3i(i, j, k)
            update = judge_block(view, blocks_out, block, seen, tiles_in)
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
    view: DepthView,
    # In:
    blocks: Blocks,
    depth_in: wp.array3d[float],
    # Out:
    marks_out: wp.array2d[wp.uint8],
):
    """Mark the voxels that contain the point of a pixel, in blocks with a slot."""
    index, y, x = wp.tid()
    index, y = locate(window, index, y)

    depth = shown_between(view.camera.near, view.reach, depth_in[index, y, x])
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


@wp.kernel
def update_voxels(
    # Cameras:
    window: Window,
    view: DepthView,
    # In:
    listed_in: wp.array[wp.vec4i],
    bounds_in: wp.array3d[wp.vec2],
    # Out:
    blocks_out: Blocks,
    marks_out: wp.array2d[wp.uint8],
):
    """Update the voxels of listed blocks, a row along z per thread, and clear their marks."""
    row, i, j = wp.tid()
    row, i = locate(window, row, i)

    block = wp.vec3i(listed_in[row][0], listed_in[row][1], listed_in[row][2])
    update = wp.uint8(listed_in[row][3])
    slot = blocks_out.slot[block[0], block[1], block[2]]
    cell, half = blocks_out.cell, wp.float64(0.5)
    center = wp.vec3d(wp.float64(i) + half, wp.float64(j) + half, half)
    sight_d = block_corner(view, blocks_out, block) + cell * center
    sight = wp.vec3(sight_d)
    position = wp.vec3(view.rotation * sight_d)
    step = wp.vec3(cell * view.rotation * wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0)))
    half_cell = 0.5 * float(cell)
    for k in range(SIDE):
        offset = (i * SIDE + j) * SIDE + k
        value = blocks_out.voxels[slot, offset]
        state = wp.where(update == ENTIRELY_FREE, FREE, HIDDEN)
        if update == MIXED:
            along = float(k)
            place = sight + wp.vec3(0.0, 0.0, along * float(cell))
            is_marked = marks_out[slot, offset] != wp.uint8(0)
            state = judge_voxel(view, bounds_in, position + along * step, place, half_cell, is_marked)
            if is_marked:
                marks_out[slot, offset] = wp.uint8(0)
        if state == SURFACE:
            value = add_log_odds(view, value, view.hit)
        elif state == FREE:
            value = add_log_odds(view, value, view.miss)
        elif state == HIDDEN:
            value = hide(value)
        blocks_out.voxels[slot, offset] = value
