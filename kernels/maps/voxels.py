# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The 3D visibility map: voxels that contain a visible surface, free voxels, and hidden voxels.

Depth images are of pinholes, or have an arbitrary ray per pixel.
"""

import warp as wp

from warpvis.kernels.casting.rays import RayRange
from warpvis.kernels.constants import LABEL_OBSTACLE
from warpvis.kernels.maps.classify import has_depth
from warpvis.kernels.maps.labels import GroundLabels, label_of, precedence
from warpvis.kernels.pinhole import PinholeCamera, Window, locate, pixel_ray, shown_between, shown_depth

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

OUTSIDE = wp.constant(wp.uint8(0))
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
def ray_of_pixel(camera: PinholeCamera, rays: wp.array2d[wp.vec3d], y: int, x: int) -> wp.vec3d:
    """Return a pixel's ray of depth 1 in the camera frame, from `rays` unless it is None; NaN without a ray."""
    if rays:
        return rays[y, x]
    return pixel_ray(camera, y, x)


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
    rays_in: wp.array2d[wp.vec3d],
    depth_in: wp.array3d[float],
    labels_in: wp.array3d[wp.uint8],
    # Out:
    marks_out: wp.array[wp.int32],
):
    """Raise the mark of the voxel of each pixel's point to 1 + the precedence of the pixel's label; 0 is unmarked.

    A camera with rays is a `PinholeCamera` of which only the depth range is read.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    depth = depth_in[view, y, x]
    ray = ray_of_pixel(camera, rays_in, y, x)
    if not has_depth(depth, camera.near, camera.far) or not ray[2] == ray[2]:
        return
    index = voxel_at(grid, camera_origin[view] + wp.float64(depth) * (wp.transpose(rotation[view]) * ray))
    if index >= 0:
        wp.atomic_max(marks_out, index, pixel_order(grid.ground, labels_in, view, y, x) + 1)


@wp.struct
class Judged:
    """The state of a voxel, and the precedence of its label."""

    state: wp.uint8
    order: int


@wp.func
def judged_by_mark(grid: VoxelGrid, state: wp.uint8, label: wp.uint8, mark: int) -> Judged:
    """Return a voxel's previous state and label, raised by its mark."""
    judged = Judged()
    judged.state = state
    judged.order = precedence(grid.ground, label)
    if mark > 0:
        judged.state = SURFACE
        judged.order = wp.max(judged.order, mark - 1)
    return judged


@wp.func
def center_of(grid: VoxelGrid, i: int, j: int, k: int) -> wp.vec3d:
    half = wp.float64(0.5)
    return grid.origin + grid.cell * wp.vec3d(wp.float64(i) + half, wp.float64(j) + half, wp.float64(k) + half)


@wp.func
def state_at(
    grid: VoxelGrid, sight: wp.vec3d, depth: float, near: float, far: float, shown: float, share: wp.float64
) -> wp.uint8:
    """Return a voxel's state in a pixel that shows depth `shown`; `OUTSIDE` without information.

    `sight` leads from the camera to the voxel's center, which has depth `depth`; `share` is shown / depth.
    """
    # Distance from the center to the visible surface along the ray, along the world axis of its largest component.
    distance = wp.abs(share - wp.float64(1.0)) * wp.max(wp.abs(sight))
    if distance <= wp.float64(0.5) * grid.cell:
        return SURFACE
    if wp.isnan(shown) or depth < near or depth > far:
        return OUTSIDE
    return wp.where(depth < shown, FREE, HIDDEN)


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

    judged = judged_by_mark(grid, states_out[i, j, k], labels_out[i, j, k], marks_in[flat_index(grid, i, j, k)])
    zero, width, height = wp.float64(0.0), wp.float64(camera.width), wp.float64(camera.height)
    center = center_of(grid, i, j, k)
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
        state = state_at(grid, sight, float(p[2]), camera.near, camera.far, shown, wp.float64(shown) * w)
        judged.state = wp.max(judged.state, state)
        if state == SURFACE:
            judged.order = wp.max(judged.order, pixel_order(grid.ground, labels_in, view, int(y), int(x)))
    states_out[i, j, k] = judged.state
    labels_out[i, j, k] = label_of(judged.order)


@wp.kernel
def judge_voxels_at(
    # Cameras:
    camera: RayRange,
    camera_to_world: wp.transformd,
    window: Window,
    # In:
    first: wp.vec2i,
    grid: VoxelGrid,
    pixels_in: wp.array3d[wp.int32],
    depth_in: wp.array3d[float],
    labels_in: wp.array3d[wp.uint8],
    marks_in: wp.array[wp.int32],
    # Out:
    states_out: wp.array3d[wp.uint8],
    labels_out: wp.array3d[wp.uint8],
):
    """Raise states and labels of a slab of voxels from their marks and from the image of one view.

    `first` is the view and the slab's first layer. `pixels_in` contains the pixel of each voxel center as row times
    width plus column, or -1.
    """
    layer, j, k = wp.tid()
    layer, j = locate(window, layer, j)
    view, i = first[0], first[1] + layer

    judged = judged_by_mark(grid, states_out[i, j, k], labels_out[i, j, k], marks_in[flat_index(grid, i, j, k)])
    pixel = pixels_in[layer, j, k]
    if pixel >= 0:
        y, x = pixel / depth_in.shape[2], pixel % depth_in.shape[2]
        sight = center_of(grid, i, j, k) - wp.transform_get_translation(camera_to_world)
        depth = wp.length(sight)
        if camera.is_planar:
            depth = wp.quat_rotate_inv(wp.transform_get_rotation(camera_to_world), sight)[2]
        shown = shown_between(camera.near, camera.far, depth_in[view, y, x])
        state = state_at(grid, sight, float(depth), camera.near, camera.far, shown, wp.float64(shown) / depth)
        judged.state = wp.max(judged.state, state)
        if state == SURFACE:
            judged.order = wp.max(judged.order, pixel_order(grid.ground, labels_in, view, y, x))
    states_out[i, j, k] = judged.state
    labels_out[i, j, k] = label_of(judged.order)


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
