# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Intersection of rays with round solids: balls, cylinders and capsules, scaled along their axes.

In a solid's *shape frame*, the object's frame with x, y and z divided by the solid's sizes, a ball is the unit ball and
a cylinder or capsule has radius 1 about z. A ray ``o + z d`` keeps its parameter there: z is the camera's planar depth.
With ``w = 1 / z``, a ray intersects a ball where ``C w^2 - 2 B w + A = 0``, with ``A = d.d``, ``B = -o.d``,
``C = o.o - 1``; the nearest intersection is ``w = (B + sqrt(D)) / C``. The discriminant ``D = B^2 - A C`` suffers from
cancellation at a silhouette; the equivalent ``A - |o x d|^2`` does not (Haines et al., "Precision Improvements for
Ray/Sphere Intersection", Ray Tracing Gems 2019, chapter 7, has the geometry).
"""

import warp as wp

from warpvis.kernels.constants import (
    PART_LOWER,
    PART_SIDE,
    PART_UPPER,
    SOLID_BALL,
    SOLID_CAPSULE,
    SOLID_CYLINDER,
    SOLID_NONE,
)

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.func
def to_shape(v: wp.vec3d, size: wp.vec4) -> wp.vec3d:
    """Transform a point or a direction from the object's frame to the shape frame."""
    return wp.vec3d(v[0] / wp.float64(size[0]), v[1] / wp.float64(size[1]), v[2] / wp.float64(size[2]))


@wp.func
def stretch_of(kind: int, original: wp.vec4, current: wp.vec4) -> wp.vec3d:
    """Return the scale factors of an object's triangles: `Stretch` of ``native/shared/stretch.h``."""
    factors = wp.vec3d(wp.float64(current[0]), wp.float64(current[1]), wp.float64(current[2]))
    if kind == SOLID_NONE:
        return factors
    longer, end = wp.float64(1.0), wp.float64(0.0)
    if kind == SOLID_CAPSULE:
        end = wp.float64(1.0)
    if kind != SOLID_BALL:
        longer = (wp.float64(current[3]) + end) / (wp.float64(original[3]) + end)
    factors = to_shape(factors, original)
    return wp.vec3d(factors[0], factors[1], factors[2] * longer)


@wp.func
def is_outside(kind: int, half: wp.float64, o: wp.vec3d) -> bool:
    """Return whether a point is outside a solid; its true surface is visible only from outside."""
    one = wp.float64(1.0)
    beyond = wp.max(wp.abs(o[2]) - half, wp.float64(0.0))
    across = o[0] * o[0] + o[1] * o[1]
    if kind == SOLID_CYLINDER:
        return across > one or beyond > wp.float64(0.0)
    return across + beyond * beyond > one


@wp.func
def meet_ball(o: wp.vec3d, d: wp.vec3d) -> wp.float64:
    """Return w = 1 / z of a ray's first intersection with the unit ball from outside; 0 for a miss."""
    e = wp.cross(o, d)
    b = -wp.dot(o, d)
    square = wp.dot(d, d) - wp.dot(e, e)
    if square < wp.float64(0.0) or b <= wp.float64(0.0):
        return wp.float64(0.0)
    return (b + wp.sqrt(square)) / (wp.dot(o, o) - wp.float64(1.0))


@wp.func
def meet_side(half: wp.float64, o: wp.vec3d, d: wp.vec3d) -> wp.float64:
    """Return w of the intersection with a cylinder's side; 0 for a miss."""
    zero = wp.float64(0.0)
    c = o[0] * o[0] + o[1] * o[1] - wp.float64(1.0)
    e = o[0] * d[1] - o[1] * d[0]
    b = -(o[0] * d[0] + o[1] * d[1])
    square = d[0] * d[0] + d[1] * d[1] - e * e
    if c <= zero or square < zero or b <= zero:
        return zero
    w = (b + wp.sqrt(square)) / c
    if wp.abs(o[2] * w + d[2]) > half * w:
        return zero
    return w


@wp.func
def meet_end(half: wp.float64, o: wp.vec3d, d: wp.vec3d) -> wp.float64:
    """Return w of the intersection with a cylinder's flat end that faces the ray's origin; 0 for a miss."""
    zero = wp.float64(0.0)
    if wp.abs(o[2]) <= half:
        return zero
    w = d[2] / (wp.sign(o[2]) * half - o[2])
    x, y = o[0] * w + d[0], o[1] * w + d[1]
    if w <= zero or x * x + y * y > w * w:
        return zero
    return w


@wp.struct
class SolidHit:
    """The hit of a ray on a solid: 1 / z, 0 for a miss, and the part of the surface."""

    w: wp.float64
    part: int


@wp.func
def meet_solid(kind: int, half: wp.float64, o: wp.vec3d, d: wp.vec3d) -> SolidHit:
    """Return the nearest hit of a solid by a ray of the shape frame that starts outside."""
    hit = SolidHit()
    hit.part = PART_SIDE
    if kind == SOLID_BALL:
        hit.w = meet_ball(o, d)
        return hit
    hit.w = meet_side(half, o, d)
    end = wp.float64(0.0)
    if kind == SOLID_CYLINDER:
        end = meet_end(half, o, d)
    else:
        end = meet_ball(o - wp.vec3d(end, end, half), d)
    if end > hit.w:
        hit.w = end
        hit.part = PART_UPPER
    if kind == SOLID_CAPSULE:
        end = meet_ball(o + wp.vec3d(wp.float64(0.0), wp.float64(0.0), half), d)
        if end > hit.w:
            hit.w = end
            hit.part = PART_LOWER
    return hit


@wp.func
def normal_of_solid(kind: int, size: wp.vec4, part: int, p: wp.vec3d) -> wp.vec3d:
    """Return the outward unit normal in the object's frame at a surface point, which is in the shape frame."""
    zero, half = wp.float64(0.0), wp.float64(size[3])
    slope = p
    if kind != SOLID_BALL and part == PART_SIDE:
        slope = wp.vec3d(p[0], p[1], zero)
    elif kind == SOLID_CYLINDER:
        slope = wp.vec3d(zero, zero, p[2])
    elif part == PART_UPPER:
        slope = p - wp.vec3d(zero, zero, half)
    elif part == PART_LOWER:
        slope = p + wp.vec3d(zero, zero, half)
    return wp.normalize(to_shape(slope, size))
