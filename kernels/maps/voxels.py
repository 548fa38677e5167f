# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The 3D visibility map: voxels that contain a visible surface, free voxels, and hidden voxels."""

import warp as wp

from warpvis.kernels.constants import LABEL_OBSTACLE
from warpvis.kernels.maps.labels import GroundLabels, label_of, precedence
from warpvis.kernels.pinhole import PinholeCamera, Window, locate, pixel_ray, shown_depth

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

UNKNOWN = wp.constant(wp.uint8(0))
HIDDEN = wp.constant(wp.uint8(1))
FREE = wp.constant(wp.uint8(2))
SURFACE = wp.constant(wp.uint8(3))
"""Voxel states, as in `warpvis.maps.Voxel`."""

OBSTACLE = wp.constant(wp.uint8(LABEL_OBSTACLE))


@wp.struct
class VoxelGrid:
    """Cubes of side `cell` [m] along the world's axes, from the corner of minimal coordinates."""

    origin: wp.vec3d
    cell: wp.float64
    size: wp.vec3i
    ground: GroundLabels


@wp.func
def flat_index(grid: VoxelGrid, i: int, j: int, k: int) -> int:
    return (i * grid.size[1] + j) * grid.size[2] + k


@wp.func
def voxel_at(grid: VoxelGrid, point: wp.vec3d) -> int:
    """Return the flat index of the voxel that contains a point; -1 outside of the grid."""
    cell_coordinates = (point - grid.origin) / grid.cell
    for axis in range(3):
        if not (cell_coordinates[axis] >= wp.float64(0.0) and cell_coordinates[axis] < wp.float64(grid.size[axis])):
            return -1
    return flat_index(grid, int(cell_coordinates[0]), int(cell_coordinates[1]), int(cell_coordinates[2]))


@wp.func
def pixel_order(ground: GroundLabels, labels: wp.array3d[wp.uint8], view: int, y: int, x: int) -> int:
    """Return the precedence of a pixel's label."""
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
    """Raise the mark of the voxel of each pixel's point to 1 + the precedence of the pixel's label; 0 is unmarked."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

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
    """Raise every voxel's state and label by its mark and by the images of all views at its center."""
    i, j, k = wp.tid()
    i, j = locate(window, i, j)

    state = wp.uint8(states_out[i, j, k])
    order = precedence(grid.ground, labels_out[i, j, k])
    mark = marks_in[flat_index(grid, i, j, k)]
    if mark > 0:
        state = SURFACE
        order = wp.max(order, mark - 1)

    half, zero = wp.float64(0.5), wp.float64(0.0)
    width, height = wp.float64(camera.width), wp.float64(camera.height)
    steps = wp.vec3d(wp.float64(i) + half, wp.float64(j) + half, wp.float64(k) + half)
    center = grid.origin + grid.cell * steps
    for view in range(depth_in.shape[0]):
        sight = center - camera_origin[view]
        p = rotation[view] * sight
        if p[2] <= zero:
            continue
        w = wp.float64(1.0) / p[2]
        x, y = camera.fx * p[0] * w + camera.cx, camera.fy * p[1] * w + camera.cy
        if not (x >= zero and x < width and y >= zero and y < height):
            continue
        shown = shown_depth(camera, depth_in[view, int(y), int(x)])
        if wp.isnan(shown):
            continue
        # Distance from the center to the visible surface along the ray, along the world axis of its largest component.
        distance = wp.abs(wp.float64(shown) * w - wp.float64(1.0)) * wp.max(wp.abs(sight))
        z = float(p[2])
        if distance <= half * grid.cell:
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
    """Merge the states and labels of one map into another."""
    i, j, k = wp.tid()
    i, j = locate(window, i, j)
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
    """Write the label of highest precedence above every floor cell; axes are y, x, or x, z if y is up."""
    view, row, column = wp.tid()
    view, row = locate(window, view, row)

    order = int(0)
    for level in range(labels_in.shape[up_axis]):
        if up_axis == 2:
            order = wp.max(order, precedence(ground, labels_in[column, row, level]))
        else:
            order = wp.max(order, precedence(ground, labels_in[row, level, column]))
    floor_out[view, row, column] = label_of(order)
