# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The visibility map in 3D: which voxels hold a seen surface, which are seen through, which are hidden."""

import warp as wp

from warpvis.kernels.constants import LABEL_OBSTACLE
from warpvis.kernels.labels import GroundLabels, label_of, precedence
from warpvis.kernels.pinhole import PinholeCamera, Window, pixel_ray, shown_depth

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

OUTSIDE = wp.constant(wp.uint8(0))
HIDDEN = wp.constant(wp.uint8(1))
FREE = wp.constant(wp.uint8(2))
SURFACE = wp.constant(wp.uint8(3))
"""As in `warpvis.maps.Voxel`."""

OBSTACLE = wp.constant(wp.uint8(LABEL_OBSTACLE))


@wp.struct
class VoxelGrid:
    """Cubes of side `cell` [m] along the world's axes, from the corner of least coordinates."""

    origin: wp.vec3d
    cell: wp.float64
    size: wp.vec3i
    ground: GroundLabels


@wp.func
def flat_index(grid: VoxelGrid, i: int, j: int, k: int) -> int:
    return (i * grid.size[1] + j) * grid.size[2] + k


@wp.func
def voxel_at(grid: VoxelGrid, point: wp.vec3d) -> int:
    """Flat index of the voxel that a point is in; -1 outside of the grid."""
    at = (point - grid.origin) / grid.cell
    for axis in range(3):
        if not (at[axis] >= wp.float64(0.0) and at[axis] < wp.float64(grid.size[axis])):
            return -1
    return flat_index(grid, int(at[0]), int(at[1]), int(at[2]))


@wp.func
def pixel_order(ground: GroundLabels, labels: wp.array3d[wp.uint8], view: int, y: int, x: int) -> int:
    """Precedence of a pixel's label."""
    label = OBSTACLE
    if labels:
        label = labels[view, y, x]
    return precedence(ground, label)


@wp.kernel
def mark_surface_points(
    # Cameras:
    camera: PinholeCamera,
    camera_origin: wp.array[wp.vec3d],
    rotation: wp.array[wp.mat33d],
    window: Window,
    # In:
    grid: VoxelGrid,
    depth_in: wp.array3d[float],
    labels_in: wp.array3d[wp.uint8],
    # Out:
    marks_out: wp.array[wp.int32],
):
    """Raise the mark of the voxel of a pixel's point to the precedence of the pixel's label + 1; 0 is no point."""
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row

    depth = shown_depth(camera, depth_in[view, y, x])
    if not wp.isfinite(depth):
        return
    direction = wp.transpose(rotation[view]) * pixel_ray(camera, y, x)
    index = voxel_at(grid, camera_origin[view] + wp.float64(depth) * direction)
    if index >= 0:
        wp.atomic_max(marks_out, index, pixel_order(grid.ground, labels_in, view, y, x) + 1)


@wp.kernel
def judge_voxels(
    # Cameras:
    camera: PinholeCamera,
    camera_origin: wp.array[wp.vec3d],
    rotation: wp.array[wp.mat33d],
    window: Window,
    # In:
    grid: VoxelGrid,
    depth_in: wp.array3d[float],
    labels_in: wp.array3d[wp.uint8],
    marks_in: wp.array[wp.int32],
    # Out:
    states_out: wp.array3d[wp.uint8],
    labels_out: wp.array3d[wp.uint8],
):
    """Raise every voxel's state and label by what was marked in it and by what all views show at its centre."""
    i, j, k = wp.tid()
    i += window.first_view
    j += window.first_row

    state = wp.uint8(states_out[i, j, k])
    order = precedence(grid.ground, labels_out[i, j, k])
    mark = marks_in[flat_index(grid, i, j, k)]
    if mark > 0:
        state = SURFACE
        order = wp.max(order, mark - 1)

    half, none = wp.float64(0.5), wp.float64(0.0)
    width, height = wp.float64(camera.width), wp.float64(camera.height)
    steps = wp.vec3d(wp.float64(i) + half, wp.float64(j) + half, wp.float64(k) + half)
    center = grid.origin + grid.cell * steps
    for view in range(depth_in.shape[0]):
        sight = center - camera_origin[view]
        p = rotation[view] * sight
        if p[2] <= none:
            continue
        w = wp.float64(1.0) / p[2]
        x, y = camera.fx * p[0] * w + camera.cx, camera.fy * p[1] * w + camera.cy
        if not (x >= none and x < width and y >= none and y < height):
            continue
        shown = shown_depth(camera, depth_in[view, int(y), int(x)])
        if wp.isnan(shown):
            continue
        # From the centre to the seen surface along the ray, the longest way along an axis of the world.
        way = wp.abs(wp.float64(shown) * w - wp.float64(1.0)) * wp.max(wp.abs(sight))
        z = float(p[2])
        if way <= half * grid.cell:
            state = SURFACE
            order = wp.max(order, pixel_order(grid.ground, labels_in, view, int(y), int(x)))
        elif z >= camera.near and z <= camera.far:
            if z < shown:
                state = wp.max(state, FREE)
            else:
                state = wp.max(state, HIDDEN)
    states_out[i, j, k] = state
    labels_out[i, j, k] = label_of(order)


@wp.kernel
def merge_voxels(
    # Cameras:
    window: Window,
    # In:
    ground: GroundLabels,
    states_in: wp.array3d[wp.uint8],
    labels_in: wp.array3d[wp.uint8],
    # Out:
    states_out: wp.array3d[wp.uint8],
    labels_out: wp.array3d[wp.uint8],
):
    """Raise the states and labels of one map to those of another."""
    i, j, k = wp.tid()
    i += window.first_view
    j += window.first_row
    states_out[i, j, k] = wp.max(states_out[i, j, k], states_in[i, j, k])
    order = precedence(ground, labels_out[i, j, k])
    labels_out[i, j, k] = label_of(wp.max(order, precedence(ground, labels_in[i, j, k])))


@wp.kernel
def highest_labels(
    # Cameras:
    window: Window,
    # In:
    ground: GroundLabels,
    labels_in: wp.array3d[wp.uint8],
    up_axis: int,
    # Out:
    floor_out: wp.array3d[wp.uint8],
):
    """The highest label over every cell of the floor, whose axes are as in a floor map: y, x; or x, z where y is up."""
    view, row, column = wp.tid()
    view += window.first_view
    row += window.first_row

    order = int(0)
    for level in range(labels_in.shape[up_axis]):
        if up_axis == 2:
            order = wp.max(order, precedence(ground, labels_in[column, row, level]))
        else:
            order = wp.max(order, precedence(ground, labels_in[row, level, column]))
    floor_out[view, row, column] = label_of(order)
