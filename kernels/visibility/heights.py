# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The height by which a point must be raised to be visible from another one: an exact search over shadows.

All lines of sight of a pair are in one vertical plane. A triangle intersects that plane in a segment, whose shadow on
the raised point's vertical line, as cast from the fixed point, is an interval of heights. The search goes from the end
of one shadow to the end of the next until it reaches a height outside all shadows.

The third axis is up here, regardless of the scene's vertical axis. Coordinates in the plane are the position along it
(0 at the fixed point, 1 at the raised one) and the height above the fixed point [m]; a point occludes the height
height / along.
"""

import warp as wp

from warpvis.kernels.pinhole import Window
from warpvis.kernels.visibility.points import locate_point

# Without fused multiply-add, both triangles of an edge compute the same intersection point: there are no gaps.
wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

GAP = wp.constant(wp.float64(1.0e-6))
"""Gaps between shadows that are smaller than this are ignored [m]."""

_MIN_OFFSET = wp.constant(wp.float64(1.0e-6))  # horizontal offset for points on one vertical line [m]
_NO_COMPONENT = wp.constant(1.0e-20)


@wp.struct
class Blockers:
    """Triangles with the third axis up, their BVH, and their bounding box with a margin for rounding."""

    tree: wp.uint64
    corners: wp.array2d[wp.vec3]
    low: wp.vec3d
    high: wp.vec3d
    up: int  # the scene's vertical axis


@wp.struct
class Sight:
    """The vertical plane through a fixed point and a point to raise."""

    fixed: wp.vec3d
    raised: wp.vec3d
    x: wp.float64  # from the fixed point to the raised one, along the first horizontal axis [m]
    y: wp.float64  # along the second horizontal axis [m]
    rise: wp.float64  # along the vertical axis [m]
    scale: wp.float64  # 1 / (x^2 + y^2)
    share: wp.float64  # fraction of the line of sight at either end that nothing blocks


@wp.func
def to_z_up(point: wp.vec3, up: int) -> wp.vec3d:
    """Permute a point's coordinates so that the third axis is up."""
    return wp.vec3d(wp.vec3(point[(up + 1) % 3], point[(up + 2) % 3], point[up]))


@wp.func
def sight_between(fixed: wp.vec3d, raised: wp.vec3d, end_tolerance: wp.float64) -> Sight:
    sight = Sight()
    sight.fixed = fixed
    sight.raised = raised
    sight.x = raised[0] - fixed[0]
    sight.y = raised[1] - fixed[1]
    if sight.x == wp.float64(0.0) and sight.y == wp.float64(0.0):
        sight.x = _MIN_OFFSET
    sight.scale = wp.float64(1.0) / (sight.x * sight.x + sight.y * sight.y)
    sight.rise = raised[2] - fixed[2]
    sight.share = end_tolerance / wp.length(raised - fixed)
    return sight


@wp.func
def side_of(sight: Sight, corner: wp.vec3d) -> wp.float64:
    """Return the signed distance of a corner from the plane, in an arbitrary scale."""
    return sight.x * (corner[1] - sight.fixed[1]) - sight.y * (corner[0] - sight.fixed[0])


@wp.func
def in_plane(sight: Sight, corner: wp.vec3d) -> wp.vec2d:
    """Return a corner's position along the plane, and its height."""
    offset = corner - sight.fixed
    return wp.vec2d((offset[0] * sight.x + offset[1] * sight.y) * sight.scale, offset[2])


@wp.func
def cut(p: wp.vec2d, p_side: wp.float64, q: wp.vec2d, q_side: wp.float64) -> wp.vec2d:
    """Return the intersection of an edge with the plane, bitwise the same for both orders of its ends."""
    if p_side < wp.float64(0.0):
        return q + q_side / (q_side - p_side) * (p - q)
    return p + p_side / (p_side - q_side) * (q - p)


@wp.func
def between(a: wp.vec2d, b: wp.vec2d, along: wp.float64) -> wp.vec2d:
    """Return the point of a segment at a position strictly between its ends."""
    return wp.vec2d(along, a[1] + (along - a[0]) / (b[0] - a[0]) * (b[1] - a[1]))


@wp.func
def shadow(sight: Sight, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> wp.vec2d:
    """Return the interval of heights of the raised point [m] at which a triangle occludes it; NaN without one.

    A corner in the plane counts as on its positive side, so a triangle in the plane has no shadow.
    """
    no_shadow = wp.vec2d(wp.float64(wp.nan), wp.float64(wp.nan))
    zero = wp.float64(0.0)
    a_side, b_side, c_side = side_of(sight, a), side_of(sight, b), side_of(sight, c)
    a_left, b_left, c_left = a_side < zero, b_side < zero, c_side < zero
    if a_left == b_left and b_left == c_left:
        return no_shadow
    d, e, f = in_plane(sight, a), in_plane(sight, b), in_plane(sight, c)
    if b_left == c_left:
        p, q = cut(d, a_side, e, b_side), cut(d, a_side, f, c_side)
    elif a_left == c_left:
        p, q = cut(e, b_side, f, c_side), cut(e, b_side, d, a_side)
    else:
        p, q = cut(f, c_side, d, a_side), cut(f, c_side, e, b_side)
    if p[0] > q[0]:
        p, q = q, p
    first, last = sight.share, wp.float64(1.0) - sight.share
    if q[0] < first or p[0] > last:
        return no_shadow
    near, far = p, q
    if p[0] < first:
        near = between(p, q, first)
    if q[0] > last:
        far = between(p, q, last)
    near_height, far_height = near[1] / near[0] - sight.rise, far[1] / far[0] - sight.rise
    return wp.vec2d(wp.min(near_height, far_height), wp.max(near_height, far_height))


@wp.func
def clip_to_box(start: wp.vec3d, path: wp.vec3d, low: wp.vec3d, high: wp.vec3d) -> wp.vec2d:
    """Return the interval of the path's parameter inside a box; empty if the first value is greater."""
    enter, leave = wp.float64(0.0), wp.float64(1.0)
    for axis in range(3):
        if path[axis] == wp.float64(0.0):
            if start[axis] < low[axis] or start[axis] > high[axis]:
                leave = wp.float64(-1.0)
        else:
            first, second = (low[axis] - start[axis]) / path[axis], (high[axis] - start[axis]) / path[axis]
            enter = wp.max(enter, wp.min(first, second))
            leave = wp.min(leave, wp.max(first, second))
    return wp.vec2d(enter, leave)


@wp.func
def tree_direction(path: wp.vec3d) -> wp.vec3:
    """Return the direction in single precision, with nonzero components for BVH queries."""
    direction = wp.vec3(path)
    for axis in range(3):
        if wp.abs(direction[axis]) < _NO_COMPONENT:
            direction[axis] = _NO_COMPONENT
    return direction


@wp.func
def end_of_shadows(blockers: Blockers, sight: Sight, height: wp.float64) -> wp.float64:
    """Return the greatest end of all shadows that contain a height [m]; the height itself if none does."""
    top = sight.raised
    top[2] += height
    path = top - sight.fixed
    part = clip_to_box(sight.fixed, path, blockers.low, blockers.high)
    if part[0] > part[1]:
        return height

    end = height
    start = wp.vec3(sight.fixed + part[0] * path)
    query = wp.bvh_query_ray(blockers.tree, start, tree_direction((part[1] - part[0]) * path))
    triangle = int(0)
    while wp.bvh_query_next(query, triangle, 1.001):
        a = wp.vec3d(blockers.corners[triangle, 0])
        b = wp.vec3d(blockers.corners[triangle, 1])
        c = wp.vec3d(blockers.corners[triangle, 2])
        heights = shadow(sight, a, b, c)
        if heights[0] - GAP <= end and end < heights[1]:
            end = heights[1]
    return end


@wp.func
def min_height(
    blockers: Blockers, fixed: wp.vec3d, raised: wp.vec3d, max_height: wp.float64, end_tolerance: wp.float64
) -> float:
    distance = wp.length(raised - fixed)
    if not wp.isfinite(distance):
        return wp.nan
    if distance <= wp.float64(2.0) * end_tolerance:
        return 0.0
    sight = sight_between(fixed, raised, end_tolerance)
    height = wp.float64(0.0)
    end = end_of_shadows(blockers, sight, height)
    while end > height and end <= max_height:  # terminates: every iteration leaves a shadow for good
        height = end
        end = end_of_shadows(blockers, sight, height)
    if end > max_height:
        return wp.inf
    return float(end)


@wp.kernel
def climb(
    # Scene:
    blockers: Blockers,
    # Cameras:
    window: Window,
    # In:
    eyes: wp.array[wp.vec3],
    targets: wp.array[wp.vec3],
    raise_eyes: bool,
    max_height: wp.float64,
    end_tolerance: wp.float64,
    # Out:
    heights_out: wp.array2d[float],
):
    """Write how far every target must be raised to be visible from every eye, or vice versa [m]; +inf if farther than
    `max_height`.
    """
    eye, row, column = wp.tid()
    eye, index = locate_point(window, eye, row, column)
    if index >= targets.shape[0]:
        return

    fixed, raised = to_z_up(eyes[eye], blockers.up), to_z_up(targets[index], blockers.up)
    if raise_eyes:
        fixed, raised = raised, fixed
    heights_out[eye, index] = min_height(blockers, fixed, raised, max_height, end_tolerance)
