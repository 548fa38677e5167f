# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of objects that move during a measurement: every ray hits objects at their poses at the time of the ray.

Like `kernels.casting.rays`, whose objects are fixed during an image; each ray is transformed into every object's frame.
"""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.motions import Frame, Motion, frame_at, frame_of, sensor_at, time_of
from warpvis.kernels.casting.rays import (
    CUDA_REGISTERS,
    FARTHEST,
    RayHit,
    RayRange,
    measure,
    meet_instances,
    meet_object,
    no_hit,
)
from warpvis.kernels.casting.solids import normal_of_solid, to_shape
from warpvis.kernels.casting.triangle_scene import (
    CameraFrame,
    TriangleScene,
    face_of,
    factors_of,
    normal_of,
    object_of,
    size_of,
    steps_of,
)
from warpvis.kernels.casting.worlds import Worlds, world_of
from warpvis.kernels.pinhole import Window, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.func
def object_frame(scene: TriangleScene, objects: Motion, world: int, movable: int, time: wp.float64) -> Frame:
    """Return the pose of a movable object or an instance at a time; instances are fixed."""
    if movable >= scene.movable_count:
        return frame_of(steps_of(scene)[movable - scene.movable_count].pose)
    return frame_at(objects, world, movable, time)


@wp.func
def seen_from_frame(camera: CameraFrame, object_frame: Frame) -> CameraFrame:
    """Transform a camera into the frame of an object."""
    inverse = wp.quat_inverse(object_frame.rotation)
    frame = CameraFrame()
    frame.origin = wp.quat_rotate(inverse, camera.origin - object_frame.origin)
    frame.rotation = inverse * camera.rotation
    return frame


@wp.func
def trace_ray_at(
    scene: TriangleScene,
    camera: RayRange,
    in_world: CameraFrame,
    worlds: Worlds,
    objects: Motion,
    view: int,
    time: wp.float64,
    ray: wp.vec3d,
    cull_backfaces: bool,
) -> RayHit:
    """Cast a ray of the sensor frame at a time; otherwise like `warpvis.kernels.casting.rays.trace_ray`."""
    hit = no_hit()
    hit.direction = wp.quat_rotate(in_world.rotation, ray)

    world = world_of(worlds, view)
    if world < 0:
        return hit
    hit.depth = float(FARTHEST)
    for movable in range(-1, scene.movable_count):  # -1: static geometry
        frame = in_world
        if movable >= 0:
            frame = seen_from_frame(in_world, frame_at(objects, world, movable, time))
        hit = meet_object(scene, worlds, world, view, movable, frame, ray, camera.clip, cull_backfaces, hit)
    hit = meet_instances(scene, worlds, view, in_world, ray, camera.clip, cull_backfaces, hit)
    hit_frame = in_world
    if hit.face >= 0 and hit.movable >= 0:
        hit_frame = seen_from_frame(in_world, object_frame(scene, objects, world, hit.movable, time))
    return measure(scene, worlds, world, hit_frame, camera, ray, hit)


@wp.func
def normal_of_hit(
    scene: TriangleScene, origin: wp.vec3d, worlds: Worlds, objects: Motion, view: int, time: wp.float64, hit: RayHit
) -> wp.vec3:
    """Return the unit normal in the world frame at the hit of a ray from `origin`."""
    world = world_of(worlds, view)
    factors = factors_of(scene, worlds, world, hit.movable)
    if hit.movable < 0:
        return wp.vec3(normal_of(scene.mesh, hit.face, factors, hit.direction))
    frame = object_frame(scene, objects, world, hit.movable, time)
    normal = wp.vec3d()
    if hit.round:
        kind, size = scene.movable_solid[hit.movable], size_of(scene, worlds, world, hit.movable)
        point = origin + wp.float64(hit.depth) * hit.direction - frame.origin
        shape_point = to_shape(wp.quat_rotate_inv(frame.rotation, point), size)
        normal = normal_of_solid(kind, size, hit.face, shape_point)
    else:
        direction = wp.quat_rotate_inv(frame.rotation, hit.direction)
        normal = normal_of(scene.movable_mesh[hit.movable], hit.face, factors, direction)
    return wp.vec3(wp.quat_rotate(frame.rotation, normal))


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
    rays_in: wp.array2d[wp.vec3d],
    origins_in: wp.array2d[wp.vec3d],
    times_in: wp.array2d[wp.float64],
    cull_backfaces: bool,
    # Out:
    images_out: Images,
):
    """Write images as `kernels.casting.moving_rays.cast_moving_rays` does, for moving objects on the same clock.

    `worlds` contains the world of each view and the rest, except that its poses are only those of the first instant.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    time = time_of(sensor, times_in, view, y, x)
    frame = sensor_at(sensor, view, y, x, time)
    eye = CameraFrame()
    eye.origin = frame.origin
    eye.rotation = frame.rotation
    if origins_in:
        eye.origin += wp.quat_rotate(eye.rotation, origins_in[y, x])
    ray = rays_in[y, x]
    hit = no_hit()
    if ray[2] == ray[2]:
        hit = trace_ray_at(scene, camera, eye, worlds, objects, view, time, ray, cull_backfaces)

    point = wp.vec3(wp.nan, wp.nan, wp.nan)
    normal = wp.vec3(wp.nan, wp.nan, wp.nan)
    index = int(-1)
    label = wp.uint8(0)
    if hit.face >= 0:
        point = wp.vec3(eye.origin + wp.float64(hit.depth) * hit.direction)
        index = object_of(scene, hit.movable, hit.face)
        label = scene.object_label[index]
        if images_out.normals:
            normal = normal_of_hit(scene, eye.origin, worlds, objects, view, time, hit)
    if images_out.depth:
        images_out.depth[view, y, x] = hit.depth
    if images_out.points:
        images_out.points[view, y, x] = point
    if images_out.normals:
        images_out.normals[view, y, x] = normal
    if images_out.labels:
        images_out.labels[view, y, x] = label
    if images_out.segmentation:
        images_out.segmentation[view, y, x] = index
    if images_out.faces:
        images_out.faces[view, y, x] = face_of(scene, hit.movable, hit.face)
