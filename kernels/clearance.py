# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Distances to surfaces, and collision tests of an upright robot. Mesh queries find triangles; distances are computed
in double precision.
"""

import warp as wp

from warpvis.kernels.pinhole import Window
from warpvis.kernels.points import point_index
from warpvis.kernels.triangle_scene import corner

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

_ROOM_FOR_ROUNDING = wp.constant(1.0e-6)
_HIGHEST = wp.constant(3.0e38)


@wp.kernel
def nearest_surface(
    # Scene:
    mesh: wp.uint64,
    # Cameras:
    window: Window,
    # In:
    points: wp.array[wp.vec3],
    most: float,
    # Out:
    distance_out: wp.array[float],
):
    """Write the distance of every point to the nearest triangle [m]; +inf if none is within `most`."""
    _one, row, column = wp.tid()
    index = point_index(window, row, column)
    if index >= points.shape[0]:
        return

    point = points[index]
    distance = float(wp.nan)
    if wp.isfinite(point):
        distance = wp.inf
        query = wp.mesh_query_point_no_sign(mesh, point, most)
        if query.result:
            a, b, c = corner(mesh, query.face, 0), corner(mesh, query.face, 1), corner(mesh, query.face, 2)
            u, v = wp.float64(query.u), wp.float64(query.v)
            nearest = u * a + v * b + (wp.float64(1.0) - u - v) * c
            distance = float(wp.length(wp.vec3d(point) - nearest))
    distance_out[index] = distance


@wp.struct
class Stand:
    """An upright cylinder from above the floor to a camera. Floor coordinates are relative to its axis [m]."""

    x: wp.float64
    y: wp.float64
    low: wp.float64
    high: wp.float64
    radius: wp.float64


@wp.func
def floor_corner(mesh: wp.uint64, triangle: int, k: int, stand: Stand, up: int) -> wp.vec3d:
    """Return a corner's two floor coordinates and its height."""
    p = corner(mesh, triangle, k)
    return wp.vec3d(p[(up + 1) % 3] - stand.x, p[(up + 2) % 3] - stand.y, p[up])


@wp.func
def distance_of_segment(p: wp.vec3d, q: wp.vec3d) -> wp.float64:
    """Return the distance of a segment from the axis, projected to the floor [m]."""
    a, b = wp.vec2d(p[0], p[1]), wp.vec2d(q[0], q[1])
    way = b - a
    square = wp.dot(way, way)
    t = wp.float64(0.0)
    if square > wp.float64(0.0):
        t = wp.clamp(-wp.dot(a, way) / square, wp.float64(0.0), wp.float64(1.0))
    return wp.length(a + t * way)


@wp.func
def at_height(p: wp.vec3d, q: wp.vec3d, height: wp.float64) -> wp.vec3d:
    """Return the point of an edge at a height between its ends."""
    return p + (height - p[2]) / (q[2] - p[2]) * (q - p)


@wp.func
def distance_of_edge(p: wp.vec3d, q: wp.vec3d, stand: Stand) -> wp.float64:
    """Return the distance from the axis of the part of an edge between the cylinder's heights [m]."""
    lower, upper = p, q
    if p[2] > q[2]:
        lower, upper = q, p
    if upper[2] < stand.low or lower[2] > stand.high:
        return wp.float64(wp.inf)
    first, last = lower, upper
    if lower[2] < stand.low:
        first = at_height(lower, upper, stand.low)
    if upper[2] > stand.high:
        last = at_height(lower, upper, stand.high)
    return distance_of_segment(first, last)


@wp.func
def distance_of_level(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, height: wp.float64) -> wp.float64:
    """Return the distance from the axis of a triangle's section at a height [m]."""
    p, q, r = a, b, c  # p is on one side, q and r are on the other
    if (a[2] < height) == (b[2] < height):
        p, q, r = c, a, b
    elif (a[2] < height) == (c[2] < height):
        p, q, r = b, c, a
    if (p[2] < height) == (q[2] < height):
        return wp.float64(wp.inf)
    return distance_of_segment(at_height(p, q, height), at_height(p, r, height))


@wp.func
def passes(p: wp.vec3d, q: wp.vec3d) -> int:
    """Return 1 or -1, by direction along y, if an edge crosses the axis's positive x half-line, else 0."""
    zero = wp.float64(0.0)
    if (p[1] > zero) == (q[1] > zero):
        return 0
    lower, upper, sign = p, q, int(1)
    if p[1] > zero:
        lower, upper, sign = q, p, int(-1)
    if lower[0] - lower[1] / (upper[1] - lower[1]) * (upper[0] - lower[0]) > zero:
        return sign
    return 0


@wp.func
def facing(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> int:
    """Return 1 or -1 if the axis hits a triangle's upper or lower side, else 0; adjacent triangles do not both hit."""
    return passes(a, b) + passes(b, c) + passes(c, a)


@wp.func
def height_on_axis(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> wp.float64:
    """Return the height at which the axis hits a triangle [m], clamped to its corners for triangles seen edge-on."""
    normal = wp.cross(b - a, c - a)
    low, high = wp.min(a[2], wp.min(b[2], c[2])), wp.max(a[2], wp.max(b[2], c[2]))
    if normal[2] == wp.float64(0.0):
        return low
    return wp.clamp(a[2] + (normal[0] * a[0] + normal[1] * a[1]) / normal[2], low, high)


@wp.func
def reaches(stand: Stand, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> bool:
    """Return whether a triangle intersects the cylinder. Its part between the heights is a polygon; seen from above,
    the polygon is nearer than the radius if the axis hits it or if one of its sides is nearer.
    """
    if wp.max(a[2], wp.max(b[2], c[2])) <= stand.low or wp.min(a[2], wp.min(b[2], c[2])) >= stand.high:
        return False
    if facing(a, b, c) != 0:
        height = height_on_axis(a, b, c)
        if height > stand.low and height < stand.high:
            return True
    distance = wp.min(distance_of_edge(a, b, stand), distance_of_edge(b, c, stand))
    distance = wp.min(distance, distance_of_edge(c, a, stand))
    distance = wp.min(distance, distance_of_level(a, b, c, stand.low))
    distance = wp.min(distance, distance_of_level(a, b, c, stand.high))
    return distance < stand.radius


@wp.func
def floor_box(x: float, y: float, height: float, up: int) -> wp.vec3:
    corner_of_box = wp.vec3()
    corner_of_box[(up + 1) % 3] = x
    corner_of_box[(up + 2) % 3] = y
    corner_of_box[up] = height
    return corner_of_box


@wp.func
def is_hindered(mesh: wp.uint64, stand: Stand, up: int) -> bool:
    """Return whether any triangle intersects the cylinder."""
    x, y = float(stand.x), float(stand.y)
    reach = float(stand.radius) + _ROOM_FOR_ROUNDING * (float(stand.radius) + wp.abs(x) + wp.abs(y))
    query = wp.mesh_query_aabb(
        mesh,
        floor_box(x - reach, y - reach, float(stand.low) - _ROOM_FOR_ROUNDING * wp.abs(float(stand.low)), up),
        floor_box(x + reach, y + reach, float(stand.high), up),
    )
    triangle = int(0)
    while wp.mesh_query_aabb_next(query, triangle):
        a = floor_corner(mesh, triangle, 0, stand, up)
        b = floor_corner(mesh, triangle, 1, stand, up)
        c = floor_corner(mesh, triangle, 2, stand, up)
        if reaches(stand, a, b, c):
            return True
    return False


@wp.func
def is_inside(mesh: wp.uint64, solid: wp.array[wp.uint8], stand: Stand, up: int) -> bool:
    """Return whether the point just below the camera is in a closed object: more upper than lower sides are above."""
    x, y, height = float(stand.x), float(stand.y), float(stand.high)
    query = wp.mesh_query_aabb(mesh, floor_box(x, y, height, up), floor_box(x, y, _HIGHEST, up))
    sides = int(0)
    triangle = int(0)
    while wp.mesh_query_aabb_next(query, triangle):
        if solid[triangle] != wp.uint8(0):
            a = floor_corner(mesh, triangle, 0, stand, up)
            b = floor_corner(mesh, triangle, 1, stand, up)
            c = floor_corner(mesh, triangle, 2, stand, up)
            side = facing(a, b, c)
            if side != 0 and height_on_axis(a, b, c) >= stand.high:
                sides += side
    return sides > 0


@wp.kernel
def find_room(
    # Scene:
    mesh: wp.uint64,
    solid: wp.array[wp.uint8],
    up: int,
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    low: wp.float64,
    radius: wp.float64,
    # Out:
    room_out: wp.array[wp.uint8],
):
    """Write whether a robot's cylinder, from height `low` up to its camera, is free at every pose."""
    _one, row, column = wp.tid()
    index = point_index(window, row, column)
    if index >= camera_to_world.shape[0]:
        return

    camera = wp.transform_get_translation(camera_to_world[index])
    stand = Stand()
    stand.x = wp.float64(camera[(up + 1) % 3])
    stand.y = wp.float64(camera[(up + 2) % 3])
    stand.low = low
    stand.high = wp.float64(camera[up])
    stand.radius = radius
    room = stand.high > low
    if room and mesh != wp.uint64(0):
        room = not is_hindered(mesh, stand, up) and not is_inside(mesh, solid, stand, up)
    room_out[index] = wp.uint8(room)
