# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of sight through an occupancy map: whether a surface is on them, and how much of them was never measured.

A line visits the voxels that it crosses one after the other, and uniform blocks as a whole (Amanatides and Woo, "A Fast
Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987).
"""

import warp as wp

from warpvis.kernels.maps.occupancy_blocks import NOT_MEASURED, SIDE, Blocks, is_inside, offset_in_block
from warpvis.kernels.pinhole import PinholeCamera, Window, locate, pixel_ray, pose_origin, pose_rotation
from warpvis.kernels.visibility.points import OCCLUDED, UNKNOWN, VISIBLE, locate_point

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

MAX_HALF_THICKNESS = wp.constant(1.5)
"""Half of the largest thickness of a surface in the map, in voxels."""

NO_OBJECT = wp.constant(-1)
"""Segmentation of pixels whose line of sight is blocked by the map."""


@wp.struct
class LineLimits:
    """Which part of a line of sight is examined."""

    eye_clearance: float  # length at the eye that is not [m]
    margin: float  # length at the other end that is not [m]
    max_unknown: float  # length of space that was not measured through which a point counts as visible [m]


@wp.struct
class Line:
    """Surfaces and unknown space on a line of sight."""

    surface: float  # distance of the first surface that blocks it from the eye [m], inf without one
    first_surface: float  # distance of the first surface, which may be that of the target [m]; see `surface_in_run`
    nearest: float  # distances between which that surface is [m]
    farthest: float
    first_unknown: float  # distance of the first space that was not measured [m]
    unknown: float  # length that was not measured, up to the surface [m]
    unknown_share: float  # of the examined length


@wp.struct
class Cell:
    """A voxel or a uniform block, in voxels from the first block."""

    low: wp.vec3i
    side: int
    value: wp.int16


@wp.func
def cell_at(blocks: Blocks, voxel: wp.vec3i) -> Cell:
    """Return the largest uniform cell that contains a voxel of the grid."""
    cell = Cell()
    x, y, z = voxel[0] / SIDE, voxel[1] / SIDE, voxel[2] / SIDE
    slot = blocks.slot[x, y, z]
    if slot < 0:
        cell.low = wp.vec3i(SIDE * x, SIDE * y, SIDE * z)
        cell.side = SIDE
        cell.value = blocks.uniform[x, y, z]
    else:
        cell.low = voxel
        cell.side = 1
        cell.value = blocks.voxels[slot, offset_in_block(voxel)]
    return cell


@wp.func
def clip_to_grid(
    blocks: Blocks, origin: wp.vec3d, direction: wp.vec3d, first: wp.float64, last: wp.float64
) -> wp.vec2d:
    """Return the part of a line in the grid as an interval, empty if its end is not above its beginning."""
    for axis in range(3):
        end = wp.float64(SIDE * blocks.slot.shape[axis])
        if direction[axis] == wp.float64(0.0):
            if origin[axis] < wp.float64(0.0) or origin[axis] >= end:
                return wp.vec2d(last, last)
        else:
            a, b = -origin[axis] / direction[axis], (end - origin[axis]) / direction[axis]
            first, last = wp.max(first, wp.min(a, b)), wp.min(last, wp.max(a, b))
    return wp.vec2d(first, last)


@wp.struct
class Exit:
    """Where a line leaves a cell."""

    distance: wp.float64
    axis: int  # that of the face, -1 if the line ends in the cell


@wp.func
def leave_cell(cell: Cell, origin: wp.vec3d, direction: wp.vec3d, end: wp.float64) -> Exit:
    result = Exit()
    result.distance = end
    result.axis = -1
    for axis in range(3):
        if direction[axis] != wp.float64(0.0):
            face = cell.low[axis]
            if direction[axis] > wp.float64(0.0):
                face += cell.side
            distance = (wp.float64(face) - origin[axis]) / direction[axis]
            if distance < result.distance:
                result.distance = distance
                result.axis = axis
    return result


@wp.func
def voxel_on_line(blocks: Blocks, place: wp.vec3d) -> wp.vec3i:
    """Return the voxel of the grid that is closest to a place on a line."""
    voxel = wp.vec3i()
    for axis in range(3):
        voxel[axis] = wp.clamp(int(wp.floor(place[axis])), 0, SIDE * blocks.slot.shape[axis] - 1)
    return voxel


@wp.func
def next_voxel(cell: Cell, leaves: Exit, origin: wp.vec3d, direction: wp.vec3d) -> wp.vec3i:
    """Return the voxel behind the face through which a line leaves a cell."""
    place = origin + leaves.distance * direction
    voxel = wp.vec3i()
    for axis in range(3):
        # Rounding must not lead past the cell's edges.
        voxel[axis] = wp.clamp(int(wp.floor(place[axis])), cell.low[axis], cell.low[axis] + cell.side - 1)
    if direction[leaves.axis] > wp.float64(0.0):
        voxel[leaves.axis] = cell.low[leaves.axis] + cell.side
    else:
        voxel[leaves.axis] = cell.low[leaves.axis] - 1
    return voxel


@wp.func
def surface_in_run(blocks: Blocks, first: wp.float64, last: wp.float64) -> wp.float64:
    """Return where the surface is in a run of surface cells: the middle, since noise makes it thick on both sides.

    At most `MAX_HALF_THICKNESS` voxels behind the beginning, for solid objects.
    """
    half = wp.float64(0.5) * (last - first)
    return first + wp.min(half, wp.float64(MAX_HALF_THICKNESS) * blocks.cell)


@wp.func
def trace_line(blocks: Blocks, eye: wp.vec3d, target: wp.vec3d, limits: LineLimits) -> Line:
    """Return the surface and the unknown space on the line of sight from an eye to a target.

    Surface cells that are followed by others block the line. A run of surface cells up to the end of the examined part
    is the target's own surface, which is long on a floor at a grazing angle.
    """
    line = Line()
    line.surface = wp.inf
    line.first_surface = wp.inf
    line.first_unknown = wp.inf
    length = wp.length(target - eye)
    first, last = wp.float64(limits.eye_clearance), length - wp.float64(limits.margin)
    if not last > first:
        return line
    # In voxels from the first block; the parameter of the line remains its length in meters.
    origin = eye / blocks.cell
    for axis in range(3):
        origin[axis] -= wp.float64(SIDE * blocks.first[axis])
    direction = (target - eye) / (length * blocks.cell)
    inside = clip_to_grid(blocks, origin, direction, first, last)
    if not inside[1] > inside[0]:
        line.unknown = float(last - first)
        line.unknown_share = 1.0
        line.first_unknown = float(first)
        return line
    unknown = inside[0] - first  # up to the current cell, and at first outside of the grid
    if unknown > wp.float64(0.0):
        line.first_unknown = float(first)
    # Distance at which the current run of surface cells begins, and the unknown length before it.
    run, unknown_before = wp.float64(wp.inf), wp.float64(0.0)
    voxel = voxel_on_line(blocks, origin + inside[0] * direction)
    reached = inside[0]
    while reached < inside[1]:
        cell = cell_at(blocks, voxel)
        leaves = leave_cell(cell, origin, direction, inside[1])
        if cell.value >= wp.int16(0):
            if not wp.isfinite(run):
                run, unknown_before = reached, unknown
        else:
            if wp.isfinite(run):
                break
            if cell.value <= NOT_MEASURED:
                line.first_unknown = wp.min(line.first_unknown, float(reached))
                unknown += leaves.distance - reached
        reached = leaves.distance
        if leaves.axis < 0:
            break
        voxel = next_voxel(cell, leaves, origin, direction)
        if not is_inside(blocks, voxel):
            break
    if wp.isfinite(run) and reached < last:  # a run that reaches the end is the target's own surface
        line.surface = float(run)
        unknown = unknown_before
    elif last > inside[1]:
        line.first_unknown = wp.min(line.first_unknown, float(inside[1]))
        unknown += last - inside[1]
    if wp.isfinite(run):
        line.first_surface = float(surface_in_run(blocks, run, reached))
        line.nearest = float(run)
        line.farthest = float(reached)
    line.unknown = float(unknown)
    line.unknown_share = float(unknown / (last - first))
    return line


@wp.kernel
def judge_lines(
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    blocks: Blocks,
    limits: LineLimits,
    points: wp.array[wp.vec3],
    # Out:
    status_out: wp.array2d[wp.uint8],
    unknown_out: wp.array2d[float],
):
    """Change the status of visible points that the map occludes, or that are behind space that was not measured.

    `unknown_out` is the fraction of each line of sight that was not measured, NaN for points that are not visible
    without the map.
    """
    view, row, column = wp.tid()
    view, index = locate_point(window, view, row, column)
    if index >= points.shape[0]:
        return
    share = float(wp.nan)
    if status_out[view, index] == VISIBLE:
        line = trace_line(blocks, pose_origin(camera_to_world[view]), wp.vec3d(points[index]), limits)
        share = line.unknown_share
        if wp.isfinite(line.surface):
            status_out[view, index] = OCCLUDED
        elif line.unknown > limits.max_unknown:
            status_out[view, index] = UNKNOWN
    if unknown_out:
        unknown_out[view, index] = share


@wp.kernel
def hide_pixels(
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    blocks: Blocks,
    limits: LineLimits,
    column_of_object: wp.array[wp.int32],
    # Out:
    depth_out: wp.array3d[float],
    segmentation_out: wp.array3d[wp.int32],
    unknown_pixels_out: wp.array2d[wp.int32],
):
    """Remove pixels of objects from images whose line of sight the map blocks, or that was not measured.

    Their depth becomes that of the map's surface, or 0. The latter are counted for each object that has a column.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    seen = segmentation_out[view, y, x]
    if seen < 0 or column_of_object[seen] < 0:
        return
    ray = pixel_ray(camera, y, x)
    eye = pose_origin(camera_to_world[view])
    direction = wp.quat_rotate(pose_rotation(camera_to_world[view]), ray)
    line = trace_line(blocks, eye, eye + wp.float64(depth_out[view, y, x]) * direction, limits)
    if wp.isfinite(line.surface):
        segmentation_out[view, y, x] = NO_OBJECT
        depth_out[view, y, x] = line.surface / float(wp.length(ray))
    elif line.unknown > limits.max_unknown:
        segmentation_out[view, y, x] = NO_OBJECT
        depth_out[view, y, x] = 0.0
        wp.atomic_add(unknown_pixels_out, view, column_of_object[seen], 1)


@wp.kernel
def render_map(
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    blocks: Blocks,
    # Out:
    depth_out: wp.array3d[float],
    nearest_out: wp.array3d[float],
    farthest_out: wp.array3d[float],
):
    """Write the depth of the first surface of the map; NaN if space that was not measured is in front of it.

    The surface is between `nearest_out` and `farthest_out`, unless they are None.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    ray = pixel_ray(camera, y, x)
    per_depth = float(wp.length(ray))
    eye = pose_origin(camera_to_world[view])
    direction = wp.quat_rotate(pose_rotation(camera_to_world[view]), ray)
    limits = LineLimits()
    limits.eye_clearance = camera.near * per_depth
    line = trace_line(blocks, eye, eye + wp.float64(camera.far) * direction, limits)
    depth = wp.vec3(wp.inf, wp.inf, wp.inf)
    if line.first_unknown < line.first_surface:
        depth = wp.vec3(wp.nan, wp.nan, wp.nan)
    elif wp.isfinite(line.first_surface):
        depth = wp.vec3(line.first_surface, line.nearest, line.farthest) / per_depth
    depth_out[view, y, x] = depth[0]
    if nearest_out:
        nearest_out[view, y, x] = depth[1]
    if farthest_out:
        farthest_out[view, y, x] = depth[2]


@wp.kernel
def judge_unknown(
    # In:
    image_pixels: wp.array2d[wp.int32],
    visible_pixels: wp.array2d[wp.int32],
    unknown_pixels: wp.array2d[wp.int32],
    # Out:
    status_out: wp.array2d[wp.uint8],
):
    """Change the status of occluded objects to UNKNOWN where that is the reason for most of their hidden pixels."""
    view, index = wp.tid()
    hidden = image_pixels[view, index] - visible_pixels[view, index]
    if status_out[view, index] == OCCLUDED and 2 * unknown_pixels[view, index] > hidden:
        status_out[view, index] = UNKNOWN
