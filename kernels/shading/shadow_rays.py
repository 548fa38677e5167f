# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shadows, ray by ray: whether surfaces block a light at the visible point of each pixel; the reference."""

import warp as wp

from warpvis.kernels.casting.solids import to_shape
from warpvis.kernels.casting.triangle_scene import (
    TriangleScene,
    factors_of,
    first_hit,
    inverses_of,
    next_instance,
    pose_in,
    size_of,
    steps_of,
)
from warpvis.kernels.casting.worlds import Worlds, is_excluded, row_of, world_of
from warpvis.kernels.constants import SOLID_BALL, SOLID_CYLINDER
from warpvis.kernels.pinhole import Window, frame_of, locate
from warpvis.kernels.shading.lighting import DeviceLight, Lights

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

LIGHT_DIRECTIONAL, LIGHT_SPOT, FALLOFF_OPENGL = wp.constant(1), wp.constant(3), wp.constant(0)
PI = wp.constant(3.14159265)
FARTHEST = wp.constant(3.0e38)
ROUNDING_STEPS = wp.constant(6.0e-7)
"""Error of a point, relative to its distance from the origin and from the camera: see `lifted`."""


@wp.func
def lifted(point: wp.vec3, normal: wp.vec3, camera: wp.vec3) -> wp.vec3d:
    """Return the point from which a ray to a light starts: just outside of the surface.

    The rounding of the three coordinates moves a point by at most ``2**-24 |p|_1`` from its plane, and the rounding of
    depth, a few steps of ``2**-24``, by that multiple of the distance from the camera. Ten steps cover both; the sum is
    computed in double precision, so that nothing is rounded again.
    """
    size = wp.abs(point[0]) + wp.abs(point[1]) + wp.abs(point[2])
    height = ROUNDING_STEPS * (size + wp.length(point - camera))
    return wp.vec3d(point) + wp.vec3d(normal) * wp.float64(height)


@wp.func
def can_light(lights: Lights, light: DeviceLight, point: wp.vec3, normal: wp.vec3) -> bool:
    """Return whether a surface faces a light and is within its reach and cone, unless light comes from vertices."""
    if light.kind == LIGHT_DIRECTIONAL:
        return wp.dot(normal, light.direction) < 0.0
    offset = light.position - point
    distance = wp.length(offset)
    if wp.dot(normal, offset) <= 0.0:
        return False
    if lights.is_at_vertices:
        return True
    if distance > light.reach:
        return False
    if light.kind != LIGHT_SPOT or (light.falloff == FALLOFF_OPENGL and light.outer_angle >= PI):
        return True
    return -wp.dot(offset, light.direction) >= light.cos_outer * distance


@wp.func
def crosses_ball(o: wp.vec3d, d: wp.vec3d, limit: wp.float64) -> bool:
    """Return whether a ray ``o + t d`` crosses the surface of the unit ball with t from 0 to `limit`."""
    zero = wp.float64(0.0)
    e = wp.cross(o, d)
    a, b, c = wp.dot(d, d), wp.dot(o, d), wp.dot(o, o) - wp.float64(1.0)
    square = a - wp.dot(e, e)
    if square < zero or a == zero:
        return False
    root = wp.sqrt(square)
    return (c > zero and b < zero and -b - root <= limit * a) or (c <= zero and root - b <= limit * a)


@wp.func
def crosses_side(half: wp.float64, o: wp.vec3d, d: wp.vec3d, limit: wp.float64) -> bool:
    """Return whether a ray crosses the side of the unit cylinder about z, between -half and half."""
    zero = wp.float64(0.0)
    e = o[0] * d[1] - o[1] * d[0]
    a, b = d[0] * d[0] + d[1] * d[1], o[0] * d[0] + o[1] * d[1]
    c = o[0] * o[0] + o[1] * o[1] - wp.float64(1.0)
    square = a - e * e
    if square < zero or a == zero:
        return False
    root = wp.sqrt(square)
    enter, leave = (-b - root) / a, (root - b) / a
    if c > zero and enter >= zero and enter <= limit and wp.abs(o[2] + enter * d[2]) <= half:
        return True
    return leave >= zero and leave <= limit and wp.abs(o[2] + leave * d[2]) <= half


@wp.func
def crosses_end(height: wp.float64, o: wp.vec3d, d: wp.vec3d, limit: wp.float64) -> bool:
    """Return whether a ray crosses the flat end of the unit cylinder at a height."""
    if d[2] == wp.float64(0.0):
        return False
    t = (height - o[2]) / d[2]
    x, y = o[0] + t * d[0], o[1] + t * d[1]
    return t >= wp.float64(0.0) and t <= limit and x * x + y * y <= wp.float64(1.0)


@wp.func
def crosses_solid(kind: int, half: wp.float64, o: wp.vec3d, d: wp.vec3d, limit: wp.float64) -> bool:
    """Return whether a ray of the shape frame crosses the surface of a solid, from either side."""
    if kind == SOLID_BALL:
        return crosses_ball(o, d, limit)
    zero = wp.float64(0.0)
    if crosses_side(half, o, d, limit):
        return True
    if kind == SOLID_CYLINDER:
        return crosses_end(half, o, d, limit) or crosses_end(-half, o, d, limit)
    return crosses_ball(o - wp.vec3d(zero, zero, half), d, limit) or crosses_ball(
        o + wp.vec3d(zero, zero, half), d, limit
    )


@wp.func
def blocks(
    scene: TriangleScene,
    worlds: Worlds,
    world: int,
    view: int,
    movable: int,
    origin: wp.vec3d,
    direction: wp.vec3d,
    limit: float,
) -> bool:
    """Return whether a movable object, an instance or static geometry (-1) blocks a ray of the world up to `limit`."""
    start, along = origin, direction
    if movable >= 0:
        index = scene.movable_object[movable]
        if index >= 0 and is_excluded(worlds, view, index):
            return False
        frame = frame_of(pose_in(scene, worlds, world, movable))
        start = wp.quat_rotate_inv(frame.rotation, origin - frame.origin)
        along = wp.quat_rotate_inv(frame.rotation, direction)
        if movable < scene.movable_count:
            kind = scene.movable_solid[movable]
            if kind != 0:
                size = size_of(scene, worlds, world, movable)
                return crosses_solid(
                    kind, wp.float64(size[3]), to_shape(start, size), to_shape(along, size), wp.float64(limit)
                )
            factors = factors_of(scene, worlds, world, movable)
            start, along = wp.cw_div(start, factors), wp.cw_div(along, factors)
    elif scene.mesh == wp.uint64(0):
        return False
    return first_hit(scene, worlds, view, movable, wp.vec3(start), wp.vec3(along), 0.0, limit, False).result


@wp.func
def is_blocked_up_to(
    scene: TriangleScene, worlds: Worlds, view: int, start: wp.vec3d, direction: wp.vec3d, limit: float
) -> bool:
    """Return whether a surface blocks a ray of the world up to the parameter `limit`."""
    world = int(0)
    if scene.movable_count > 0:
        world = world_of(worlds, view)
        if world < 0:
            return False
    for movable in range(-1, scene.movable_count):
        if blocks(scene, worlds, world, view, movable, start, direction, limit):
            return True
    if scene.instance_count == 0:
        return False
    steps, inverse, origin = steps_of(scene), inverses_of(direction), wp.vec3(start)
    step = next_instance(steps, 0, origin, inverse, limit)
    while step >= 0:
        if blocks(scene, worlds, world, view, scene.movable_count + steps[step].instance, start, direction, limit):
            return True
        step = next_instance(steps, step + 1, origin, inverse, limit)
    return False


@wp.func
def is_blocked(
    scene: TriangleScene, worlds: Worlds, view: int, light: DeviceLight, point: wp.vec3, start: wp.vec3d
) -> bool:
    """Return whether a surface is between a point and a light."""
    direction, limit = wp.vec3d(-light.direction), float(FARTHEST)
    if light.shadow_plane:
        limit = float(wp.dot(wp.vec3d(light.position) - start, direction))
        if limit <= 0.0:
            return False
    if light.kind != LIGHT_DIRECTIONAL:
        direction, limit = wp.vec3d(light.position) - start, float(1.0)
    return is_blocked_up_to(scene, worlds, view, start, direction, limit)


@wp.kernel
def cast_shadow_rays(
    # Scene:
    scene: TriangleScene,
    lights: Lights,
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    normals_in: wp.array3d[wp.vec3],
    # Out:
    shadows_out: wp.array4d[wp.uint8],
):
    """Write 255 where a light with shadows shines on the surface of a pixel, and 0 elsewhere: (light, view, y, x)."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    point, normal = points_in[view, y, x], normals_in[view, y, x]
    is_seen = segmentation_in[view, y, x] >= 0
    start = lifted(point, normal, wp.transform_get_translation(camera_to_world[view]))
    row = row_of(worlds, view, lights.all.shape[0])
    for number in range(lights.all.shape[1]):
        light = lights.all[row, number]
        if light.shadow >= 0 and light.sample_count == 0:
            shine = wp.uint8(0)
            if is_seen:
                if can_light(lights, light, point, normal):
                    if not is_blocked(scene, worlds, view, light, point, start):
                        shine = wp.uint8(255)
            shadows_out[light.shadow, view, y, x] = shine
