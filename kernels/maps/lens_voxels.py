# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The 3D visibility map for depth images with an arbitrary ray per pixel."""

import warp as wp

from warpvis.kernels.casting.rays import RayRange
from warpvis.kernels.maps.labels import label_of, precedence
from warpvis.kernels.maps.voxels import FREE, HIDDEN, SURFACE, VoxelGrid, flat_index, pixel_order, voxel_at
from warpvis.kernels.pinhole import Window, locate, shown_between

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def mark_surface_rays(
    # Cameras:
    camera: RayRange,
    camera_origin: wp.array[wp.vec3d],
    rotation: wp.array[wp.mat33d],
    window: Window,
    # In:
    rays_in: wp.array2d[wp.vec3d],
    grid: VoxelGrid,
    depth_in: wp.array3d[float],
    labels_in: wp.array3d[wp.uint8],
    # Out:
    marks_out: wp.array[wp.int32],
):
    """Raise marks as in `warpvis.kernels.maps.voxels.mark_surface_points`; pixels without a ray are skipped."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    depth, ray = shown_between(camera.near, camera.far, depth_in[view, y, x]), rays_in[y, x]
    if not wp.isfinite(depth) or not ray[2] == ray[2]:
        return
    index = voxel_at(grid, camera_origin[view] + wp.float64(depth) * (wp.transpose(rotation[view]) * ray))
    if index >= 0:
        wp.atomic_max(marks_out, index, pixel_order(grid.ground, labels_in, view, y, x) + 1)


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

    state = wp.uint8(states_out[i, j, k])
    order = precedence(grid.ground, labels_out[i, j, k])
    mark = marks_in[flat_index(grid, i, j, k)]
    if mark > 0:
        state = SURFACE
        order = wp.max(order, mark - 1)
    pixel = pixels_in[layer, j, k]
    if pixel >= 0:
        y, x = pixel / depth_in.shape[2], pixel % depth_in.shape[2]
        half = wp.float64(0.5)
        steps = wp.vec3d(wp.float64(i) + half, wp.float64(j) + half, wp.float64(k) + half)
        sight = grid.origin + grid.cell * steps - wp.transform_get_translation(camera_to_world)
        depth = wp.length(sight)
        if camera.is_planar:
            depth = wp.quat_rotate_inv(wp.transform_get_rotation(camera_to_world), sight)[2]
        shown = shown_between(camera.near, camera.far, depth_in[view, y, x])
        # Distance from the center to the visible surface along the ray, along the world axis of its largest component.
        distance = wp.abs(wp.float64(shown) / depth - wp.float64(1.0)) * wp.max(wp.abs(sight))
        z = float(depth)
        if distance <= half * grid.cell:
            state = SURFACE
            order = wp.max(order, pixel_order(grid.ground, labels_in, view, y, x))
        elif not wp.isnan(shown) and z >= camera.near and z <= camera.far:
            if z < shown:
                state = wp.max(state, FREE)
            else:
                state = wp.max(state, HIDDEN)
    states_out[i, j, k] = state
    labels_out[i, j, k] = label_of(order)
