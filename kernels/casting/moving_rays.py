# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of sensors that move during a measurement: every ray is cast from the sensor's pose at the time of the ray."""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.motions import Motion, TimedRays, eye_of, sensor_at, time_of
from warpvis.kernels.casting.rays import CUDA_REGISTERS, RayRange, no_hit, trace_ray, write_images
from warpvis.kernels.casting.triangle_scene import TriangleScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.pinhole import Window, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.func
def cast_moving_ray(
    scene: TriangleScene,
    camera: RayRange,
    sensor: Motion,
    rays: TimedRays,
    worlds: Worlds,
    view: int,
    y: int,
    x: int,
    cull_backfaces: bool,
    images_out: Images,
):
    """Write the images of a ray; objects are fixed."""
    eye = eye_of(sensor, rays, view, y, x, time_of(sensor, rays.times, view, y, x))
    ray = rays.directions[y, x]
    hit = no_hit()
    if ray[2] == ray[2]:
        hit = trace_ray(scene, camera, eye, worlds, worlds, view, ray, cull_backfaces)
    write_images(scene, eye.origin, worlds, worlds, view, hit, view, y, x, images_out)


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
    rays: TimedRays,
    cull_backfaces: bool,
    # Out:
    images_out: Images,
):
    """Write the requested images (None is skipped) of every view; objects are fixed."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    cast_moving_ray(scene, camera, sensor, rays, worlds, view, y, x, cull_backfaces, images_out)


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
    rays: TimedRays,
    depth_in: wp.array3d[float],
    # Out:
    points_out: wp.array3d[wp.vec3],
):
    """Write the world point at a depth along every ray; NaN without depth."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    point = wp.vec3(wp.nan, wp.nan, wp.nan)
    depth = depth_in[view, y, x]
    if wp.isfinite(depth):
        eye = eye_of(sensor, rays, view, y, x, time_of(sensor, rays.times, view, y, x))
        point = wp.vec3(eye.origin + wp.quat_rotate(eye.rotation, wp.float64(depth) * rays.directions[y, x]))
    points_out[view, y, x] = point
