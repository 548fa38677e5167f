# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define device code of gpu.py: minimal kernels for depth and for occlusion, and the rays for OptiX."""

import warp as wp

# Compiled with the same options as warpvis's kernels.
wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.func
def pixel_direction(pose: wp.transform, intrinsics: wp.vec4, y: int, x: int) -> wp.vec3:
    """Return a pixel's ray in the world frame, of length 1 along the optical axis: its parameter at a hit is depth."""
    u = (float(x) + 0.5 - intrinsics[2]) / intrinsics[0]
    v = (float(y) + 0.5 - intrinsics[3]) / intrinsics[1]
    return wp.transform_vector(pose, wp.vec3(u, v, 1.0))


@wp.kernel
def query_depth(
    # Scene:
    mesh: wp.uint64,
    # Cameras:
    intrinsics: wp.vec4,  # fx, fy, cx, cy
    far: float,
    camera_to_world: wp.array[wp.transform],
    # Out:
    depth_out: wp.array3d[float],
):
    """Cast one ray per thread with one mesh query."""
    view, y, x = wp.tid()
    pose = camera_to_world[view]
    hit = wp.mesh_query_ray(mesh, wp.transform_get_translation(pose), pixel_direction(pose, intrinsics, y, x), far)
    depth = float(wp.inf)
    if hit.result:
        depth = hit.t
    depth_out[view, y, x] = depth


@wp.kernel
def query_occlusion(
    # Scene:
    mesh: wp.uint64,
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    # In:
    points: wp.array[wp.vec3],
    # Out:
    hidden_out: wp.array2d[bool],
):
    """Test one point of a view per thread for a hit between the camera and the point."""
    view, i = wp.tid()
    eye = wp.transform_get_translation(camera_to_world[view])
    hidden_out[view, i] = wp.mesh_query_ray_anyhit(mesh, eye, points[i] - eye, 1.0)


@wp.kernel
def make_rays(
    # Cameras:
    intrinsics: wp.vec4,
    camera_to_world: wp.array[wp.transform],
    # In:
    pixels: wp.array[wp.vec2i],  # (x, y) in the order of the rays
    # Out:
    rays_out: wp.array2d[float],  # six rows: origins x, y, z and directions x, y, z of all rays
):
    """Write rays as a structure of arrays."""
    view, i = wp.tid()
    pose = camera_to_world[view]
    pixel = pixels[i]
    origin = wp.transform_get_translation(pose)
    direction = pixel_direction(pose, intrinsics, pixel[1], pixel[0])
    ray = view * pixels.shape[0] + i
    for k in range(3):
        rays_out[k, ray] = origin[k]
        rays_out[3 + k, ray] = direction[k]
