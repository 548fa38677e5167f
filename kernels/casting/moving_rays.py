# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of sensors that move during a measurement: every ray is cast from the sensor's pose at the time of the ray."""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.motions import Motion, sensor_at, time_of
from warpvis.kernels.casting.rays import CUDA_REGISTERS, RayRange, no_hit, trace_ray, write_images
from warpvis.kernels.casting.triangle_scene import TriangleScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.pinhole import Window, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_moving_rays(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: RayRange,
    sensor: Motion,
    window: Window,
    # In:
    worlds: Worlds,
    rays_in: wp.array2d[wp.vec3d],
    origins_in: wp.array2d[wp.vec3d],
    times_in: wp.array2d[wp.float64],
    cull_backfaces: bool,
    # Out:
    images_out: Images,
):
    """Write the requested images (None is skipped) of every view; objects are fixed.

    `rays_in` are directions in the sensor frame, (y, x); NaN rays hit nothing. `origins_in` are their origins in that
    frame; None for the frame's origin. `times_in` are their times after the start of the frame [s]; None if every ray
    has an individual pose.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    eye = sensor_at(sensor, view, y, x, time_of(sensor, times_in, view, y, x))
    if origins_in:
        eye.origin += wp.quat_rotate(eye.rotation, origins_in[y, x])
    ray = rays_in[y, x]
    hit = no_hit()
    if ray[2] == ray[2]:
        hit = trace_ray(scene, camera, eye, worlds, worlds, view, ray, cull_backfaces)
    write_images(scene, eye.origin, worlds, worlds, view, hit, view, y, x, images_out)


@wp.kernel
def measure_moving_incidence(
    # Cameras:
    sensor: Motion,
    window: Window,
    # In:
    directions_in: wp.array2d[wp.vec3d],
    times_in: wp.array2d[wp.float64],
    normals_in: wp.array3d[wp.vec3],
    # Out:
    incidence_out: wp.array3d[float],
):
    """Write the absolute cosine between every ray and the surface normal at its hit; NaN for a miss."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    frame = sensor_at(sensor, view, y, x, time_of(sensor, times_in, view, y, x))
    along = wp.quat_rotate(frame.rotation, directions_in[y, x])
    incidence_out[view, y, x] = float(wp.abs(wp.dot(along, wp.vec3d(normals_in[view, y, x]))))


@wp.kernel
def back_project_moving(
    # Cameras:
    sensor: Motion,
    window: Window,
    # In:
    rays_in: wp.array2d[wp.vec3d],
    origins_in: wp.array2d[wp.vec3d],
    times_in: wp.array2d[wp.float64],
    depth_in: wp.array3d[float],
    # Out:
    points_out: wp.array3d[wp.vec3],
):
    """Write the world point at a depth along every ray; NaN without depth. See `cast_moving_rays` for inputs."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    point = wp.vec3(wp.nan, wp.nan, wp.nan)
    depth = depth_in[view, y, x]
    if wp.isfinite(depth):
        frame = sensor_at(sensor, view, y, x, time_of(sensor, times_in, view, y, x))
        offset = wp.float64(depth) * rays_in[y, x]
        if origins_in:
            offset += origins_in[y, x]
        point = wp.vec3(frame.origin + wp.quat_rotate(frame.rotation, offset))
    points_out[view, y, x] = point
