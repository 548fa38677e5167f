# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of objects that move during a measurement: every ray hits objects at their poses at the time of the ray."""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.motions import Motion, MovingObjects, TimedRays, eye_of, time_of
from warpvis.kernels.casting.rays import (
    CUDA_REGISTERS,
    FARTHEST,
    RayRange,
    measure,
    meet_object,
    no_hit,
    object_frame,
    trace_ray,
    write_images,
)
from warpvis.kernels.casting.triangle_scene import TriangleScene, seen_from
from warpvis.kernels.casting.worlds import Worlds, world_of
from warpvis.kernels.pinhole import Window, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.func
def cast_ray_at_objects(
    scene: TriangleScene,
    camera: RayRange,
    sensor: Motion,
    rays: TimedRays,
    worlds: Worlds,
    objects: Motion,
    view: int,
    y: int,
    x: int,
    cull_backfaces: bool,
    images_out: Images,
):
    """Write the images of a ray for moving objects."""
    moving = MovingObjects()
    moving.motion = objects
    moving.time = time_of(sensor, rays.times, view, y, x)
    eye = eye_of(sensor, rays, view, y, x, moving.time)
    ray = rays.directions[y, x]
    hit = no_hit()
    if ray[2] == ray[2]:
        hit = trace_ray(scene, camera, eye, worlds, moving, view, ray, cull_backfaces)
    write_images(scene, eye.origin, worlds, moving, view, hit, view, y, x, images_out)


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_at_moving_objects(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: RayRange,
    sensor: Motion,
    window: Window,
    # In:
    worlds: Worlds,
    objects: Motion,
    rays: TimedRays,
    cull_backfaces: bool,
    # Out:
    images_out: Images,
):
    """Write images as `kernels.casting.moving_rays.cast_moving_rays` does, for moving objects on the same clock.

    `worlds` contains the world of each view and the rest, except that its poses are only those of the first instant.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    cast_ray_at_objects(scene, camera, sensor, rays, worlds, objects, view, y, x, cull_backfaces, images_out)


@wp.kernel
def cast_touched_rays(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: RayRange,
    sensor: Motion,
    window: Window,
    # In:
    worlds: Worlds,
    objects: Motion,
    rays: TimedRays,
    touched_in: wp.array3d[wp.int32],
    cull_backfaces: bool,
    # Out:
    images_out: Images,
):
    """Add movable objects to images of static geometry: the rest of `cast_at_moving_objects`.

    `touched_in` has the bits of the objects that a ray may hit, by their index modulo 32. The depth of `images_out` is
    read, too.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    touched = touched_in[view, y, x]
    behind = images_out.depth[view, y, x]
    if touched == 0 or behind == -wp.inf:
        return
    moving = MovingObjects()
    moving.motion = objects
    moving.time = time_of(sensor, rays.times, view, y, x)
    eye = eye_of(sensor, rays, view, y, x, moving.time)
    ray, world = rays.directions[y, x], world_of(worlds, view)
    hit = no_hit()
    hit.direction = wp.quat_rotate(eye.rotation, ray)
    hit.depth = wp.where(wp.isfinite(behind), behind, float(FARTHEST))
    for movable in range(scene.movable_count):
        if (touched >> (movable % 32)) & 1 != 0:
            frame = seen_from(eye, object_frame(scene, moving, world, movable))
            hit = meet_object(scene, worlds, world, view, movable, frame, ray, camera.clip, cull_backfaces, hit)
    if hit.face >= 0:
        frame = seen_from(eye, object_frame(scene, moving, world, hit.movable))
        hit = measure(scene, worlds, world, frame, camera, ray, hit)
        write_images(scene, eye.origin, worlds, moving, view, hit, view, y, x, images_out)
