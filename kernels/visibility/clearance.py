# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Distances to surfaces, and collision tests of an upright robot. Mesh queries find triangles; distances are computed
in double precision.
"""

import warp as wp

from warpvis.kernels.casting.triangle_scene import corner
from warpvis.kernels.pinhole import Window
from warpvis.kernels.visibility.points import locate_point

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

_ROUNDING_MARGIN = wp.constant(1.0e-6)
_HIGHEST = wp.constant(3.0e38)


@wp.kernel
def nearest_surface(
    # Scene:
    mesh: wp.uint64,
    # Cameras:
    window: Window,
    # In:
    points: wp.array[wp.vec3],
    max_distance: float,
    # Out:
    distance_out: wp.array[float],
):
    """Write the distance of every point to the nearest triangle [m]; +inf if none is within `max_distance`."""
    view, row, column = wp.tid()
    view, index = locate_point(window, view, row, column)
    if index >= points.shape[0]:
        return

    point = points[index]
    distance = float(wp.nan)
    if wp.isfinite(point):
        distance = wp.inf
        query = wp.mesh_query_point_no_sign(mesh, point, max_distance)
        if query.result:
            a, b, c = corner(mesh, query.face, 0), corner(mesh, query.face, 1), corner(mesh, query.face, 2)
            u, v = wp.float64(query.u), wp.float64(query.v)
            nearest = u * a + v * b + (wp.float64(1.0) - u - v) * c
            distance = float(wp.length(wp.vec3d(point) - nearest))
    distance_out[index] = distance


@wp.struct
class Cylinder:
    """An upright cylinder from above the floor to a camera. Floor coordinates are relative to its axis [m]."""

    x: wp.float64
    y: wp.float64
    low: wp.float64
    high: wp.float64
    radius: wp.float64


@wp.func
def floor_corner(mesh: wp.uint64, triangle: int, k: int, cylinder: Cylinder, up: int) -> wp.vec3d:
    """Return a corner's two floor coordinates and its height."""
    p = corner(mesh, triangle, k)
    return wp.vec3d(p[(up + 1) % 3] - cylinder.x, p[(up + 2) % 3] - cylinder.y, p[up])


@wp.func
def distance_of_segment(p: wp.vec3d, q: wp.vec3d) -> wp.float64:
    """Return the distance of a segment from the axis, projected to the floor [m]."""
    a, b = wp.vec2d(p[0], p[1]), wp.vec2d(q[0], q[1])
    direction = b - a
    squared_length = wp.dot(direction, direction)
    t = wp.float64(0.0)
    if squared_length > wp.float64(0.0):
        t = wp.clamp(-wp.dot(a, direction) / squared_length, wp.float64(0.0), wp.float64(1.0))
    return wp.length(a + t * direction)


@wp.func
def point_at_height(p: wp.vec3d, q: wp.vec3d, height: wp.float64) -> wp.vec3d:
    """Return the point of an edge at a height between its ends."""
    return p + (height - p[2]) / (q[2] - p[2]) * (q - p)


@wp.func
def distance_of_edge(p: wp.vec3d, q: wp.vec3d, cylinder: Cylinder) -> wp.float64:
    """Return the distance from the axis of the part of an edge between the cylinder's heights [m]."""
    lower, upper = p, q
    if p[2] > q[2]:
        lower, upper = q, p
    if upper[2] < cylinder.low or lower[2] > cylinder.high:
        return wp.float64(wp.inf)
    first, last = lower, upper
    if lower[2] < cylinder.low:
        first = point_at_height(lower, upper, cylinder.low)
    if upper[2] > cylinder.high:
        last = point_at_height(lower, upper, cylinder.high)
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
    return distance_of_segment(point_at_height(p, q, height), point_at_height(p, r, height))


@wp.func
def crosses_half_line(p: wp.vec3d, q: wp.vec3d) -> int:
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
    return crosses_half_line(a, b) + crosses_half_line(b, c) + crosses_half_line(c, a)


@wp.func
def height_on_axis(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> wp.float64:
    """Return the height at which the axis hits a triangle [m], clamped to its corners for triangles seen edge-on."""
    normal = wp.cross(b - a, c - a)
    low, high = wp.min(a[2], wp.min(b[2], c[2])), wp.max(a[2], wp.max(b[2], c[2]))
    if normal[2] == wp.float64(0.0):
        return low
    return wp.clamp(a[2] + (normal[0] * a[0] + normal[1] * a[1]) / normal[2], low, high)


@wp.func
def intersects(cylinder: Cylinder, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> bool:
    """Return whether a triangle intersects the cylinder. Its part between the heights is a polygon; seen from above,
    the polygon is nearer than the radius if the axis hits it or if one of its sides is nearer.
    """
    if wp.max(a[2], wp.max(b[2], c[2])) <= cylinder.low or wp.min(a[2], wp.min(b[2], c[2])) >= cylinder.high:
        return False
    if facing(a, b, c) != 0:
        height = height_on_axis(a, b, c)
        if height > cylinder.low and height < cylinder.high:
            return True
    distance = wp.min(distance_of_edge(a, b, cylinder), distance_of_edge(b, c, cylinder))
    distance = wp.min(distance, distance_of_edge(c, a, cylinder))
    distance = wp.min(distance, distance_of_level(a, b, c, cylinder.low))
    distance = wp.min(distance, distance_of_level(a, b, c, cylinder.high))
    return distance < cylinder.radius


@wp.func
def floor_box(x: float, y: float, height: float, up: int) -> wp.vec3:
    corner_of_box = wp.vec3()
    corner_of_box[(up + 1) % 3] = x
    corner_of_box[(up + 2) % 3] = y
    corner_of_box[up] = height
    return corner_of_box


@wp.func
def is_blocked(mesh: wp.uint64, cylinder: Cylinder, up: int) -> bool:
    """Return whether any triangle intersects the cylinder."""
    x, y = float(cylinder.x), float(cylinder.y)
    reach = float(cylinder.radius) + _ROUNDING_MARGIN * (float(cylinder.radius) + wp.abs(x) + wp.abs(y))
    query = wp.mesh_query_aabb(
        mesh,
        floor_box(x - reach, y - reach, float(cylinder.low) - _ROUNDING_MARGIN * wp.abs(float(cylinder.low)), up),
        floor_box(x + reach, y + reach, float(cylinder.high), up),
    )
    triangle = int(0)
    while wp.mesh_query_aabb_next(query, triangle):
        a = floor_corner(mesh, triangle, 0, cylinder, up)
        b = floor_corner(mesh, triangle, 1, cylinder, up)
        c = floor_corner(mesh, triangle, 2, cylinder, up)
        if intersects(cylinder, a, b, c):
            return True
    return False


@wp.func
def is_inside(mesh: wp.uint64, solid: wp.array[wp.uint8], cylinder: Cylinder, up: int) -> bool:
    """Return whether the point just below the camera is in a closed object: more upper than lower sides are above."""
    x, y, height = float(cylinder.x), float(cylinder.y), float(cylinder.high)
    query = wp.mesh_query_aabb(mesh, floor_box(x, y, height, up), floor_box(x, y, _HIGHEST, up))
    sides = int(0)
    triangle = int(0)
    while wp.mesh_query_aabb_next(query, triangle):
        if solid[triangle] != wp.uint8(0):
            a = floor_corner(mesh, triangle, 0, cylinder, up)
            b = floor_corner(mesh, triangle, 1, cylinder, up)
            c = floor_corner(mesh, triangle, 2, cylinder, up)
            side = facing(a, b, c)
            if side != 0 and height_on_axis(a, b, c) >= cylinder.high:
                sides += side
    return sides > 0


@wp.kernel
def find_free_poses(
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
    free_out: wp.array[wp.uint8],
):
    """Write whether a robot's cylinder, from height `low` up to its camera, is free at every pose."""
    view, row, column = wp.tid()
    view, index = locate_point(window, view, row, column)
    if index >= camera_to_world.shape[0]:
        return

    camera = wp.transform_get_translation(camera_to_world[index])
    cylinder = Cylinder()
    cylinder.x = wp.float64(camera[(up + 1) % 3])
    cylinder.y = wp.float64(camera[(up + 2) % 3])
    cylinder.low = low
    cylinder.high = wp.float64(camera[up])
    cylinder.radius = radius
    is_free = cylinder.high > low
    if is_free and mesh != wp.uint64(0):
        is_free = not is_blocked(mesh, cylinder, up) and not is_inside(mesh, solid, cylinder, up)
    free_out[index] = wp.uint8(is_free)


@wp.kernel
def find_inside(
    # Scene:
    mesh: wp.uint64,
    solid: wp.array[wp.uint8],
    up: int,
    # Cameras:
    window: Window,
    # In:
    points: wp.array[wp.vec3],
    # Out:
    inside_out: wp.array[wp.uint8],
):
    """Write whether each point is inside the triangles of closed objects, whose normals face outward."""
    view, row, column = wp.tid()
    view, index = locate_point(window, view, row, column)
    if index >= points.shape[0]:
        return

    point = points[index]
    cylinder = Cylinder()
    cylinder.x = wp.float64(point[(up + 1) % 3])
    cylinder.y = wp.float64(point[(up + 2) % 3])
    cylinder.high = wp.float64(point[up])
    inside_out[index] = wp.uint8(is_inside(mesh, solid, cylinder, up))
