# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""World points and labels of depth images with an arbitrary ray per pixel."""

import warp as wp

from warpvis.kernels.casting.rays import RayRange
from warpvis.kernels.maps.classify import Ground, Spheres, case_of, has_depth, no_point
from warpvis.kernels.pinhole import Window, locate, pose_origin, pose_rotation

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.func
def point_along(pose: wp.transform, ray: wp.vec3d, depth: float) -> wp.vec3:
    """Return the world point at a depth along a ray of the camera frame, whose depth is 1; NaN for NaN rays."""
    return wp.vec3(pose_origin(pose) + wp.float64(depth) * wp.quat_rotate(pose_rotation(pose), ray))


@wp.kernel
def back_project_rays(
    # Cameras:
    camera: RayRange,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    rays_in: wp.array2d[wp.vec3d],
    depth_in: wp.array3d[float],
    # Out:
    points_out: wp.array3d[wp.vec3],
):
    """Write world points of depth images; NaN without depth in range or without a ray."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    depth = depth_in[view, y, x]
    point = wp.vec3(wp.nan, wp.nan, wp.nan)
    if has_depth(depth, camera.near, camera.far):
        point = point_along(camera_to_world[view], rays_in[y, x], depth)
    points_out[view, y, x] = point


@wp.kernel
def classify_rays(
    # Cameras:
    camera: RayRange,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    rays_in: wp.array2d[wp.vec3d],
    depth_in: wp.array3d[float],
    max_range: float,
    ground: Ground,
    spheres: Spheres,
    # Out:
    labels_out: wp.array3d[wp.uint8],
    spheres_out: wp.array3d[wp.int32],
):
    """Write the cases of `kernels.maps.classify.classify_depth` for every pixel; pixels without a ray are empty."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    depth = depth_in[view, y, x]
    ray = rays_in[y, x]
    case = no_point()
    if has_depth(depth, camera.near, max_range) and ray[2] == ray[2]:
        case = case_of(point_along(camera_to_world[view], ray, depth), ground, spheres)

    labels_out[view, y, x] = case.label
    if spheres_out:
        spheres_out[view, y, x] = case.sphere
