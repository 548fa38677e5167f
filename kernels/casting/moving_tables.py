# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of packets whose sensor moves during a measurement, for CUDA: images, eyes and rays of packets in each view.

A packet keeps the rays, the image and the eye that `warpvis.rendering.casters.sorted_rays_cuda` prepares for a sensor
at rest. The image is placed at the sensor's pose in the middle of the packet's time, and its rays are moved by the
small rotation and translation since then, both in coordinates (u z, v z, z) of the image. For a rotation vector w, a
share s of a leg since its base, x = s^2 w^2, and cross product matrix W of w, the rotation is

    1 + s S(x) W + s^2 C(x) W^2,    S(x) = sin(r) / r,  C(x) = (1 - cos(r)) / r^2,  D(x) = (r - sin(r)) / r^3

with r = sqrt(x), as in ``native/cpu/legs.h``. Matrices of packets are computed in double precision. Single precision
then suffices for rays, since only differences from rays at rest are computed.
"""

import warp as wp

from warpvis.kernels.casting.motions import Leg, Motion, compose_rotation, frame_at, leg_at
from warpvis.kernels.casting.packets_cuda import RayPackets
from warpvis.kernels.casting.worlds import Worlds, world_of
from warpvis.kernels.constants import CUDA_LANES
from warpvis.kernels.pinhole import Frame

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

MARGIN = wp.constant(1.0e-3)
"""Added to the distance of rays from pixel centers [px]."""
ROUNDED = wp.constant(1.0 + 1.0e-5)
"""Factor of bounds for rounding to single precision."""
FLOAT_STEP = wp.constant(2.4e-7)
"""Relative error of two roundings to single precision."""
MIN_DEPTH = wp.constant(0.5)
MAX_SPREAD = wp.constant(2.0)
MAX_EYE_OFFSET = wp.constant(12.0)
MAX_REACH = wp.constant(0.2)
MAX_ANGLE = wp.constant(0.5)
"""Rays of a packet are cast one by one if rotation divides the z of one by more than two, if one is further from its
pixel's center [px], passes the eye further away [px m], or begins further from it [m], or if the sensor rotates more in
the packet's time [rad]."""
MIN_STRETCH = wp.constant(wp.float64(0.2))
"""Images that rotation would compress more, or stretch by more than the inverse, are not fitted to their rays."""


@wp.struct
class LegTerms:
    """A leg of the sensor's motion relative to a packet, for shares of the leg since its base."""

    still: wp.mat33  # the rotation minus 1 is still + s S turn + s^2 C twice
    turn: wp.mat33
    twice: wp.mat33
    begin: wp.vec3  # the translation is begin + s path + s^2 C across + s^3 D along [m, in px for the first two]
    path: wp.vec3
    across: wp.vec3
    along: wp.vec3
    square: float  # w^2
    offset: float  # s = (time since the packet's middle + offset) * rate
    rate: float
    since: float  # time since the packet's middle from which on the leg applies [s]


@wp.struct
class PacketTerms:
    """Terms that all rays of a packet share in a view."""

    fit: wp.mat22  # minus 1: from the image at rest to the fitted one
    first: wp.vec2  # center of the first pixel of the fitted image
    center: wp.vec3  # the eye at rest, from the sensor
    shift: float  # of the eye back along the middle ray [m of z]
    middle: wp.vec2  # that ray's place in the image at rest
    is_cast: bool  # whether its rays may be cast together


@wp.struct
class MovingTerms:
    """Terms of packets in views, in rows of views times packets."""

    legs: wp.array2d[LegTerms]
    packets: wp.array[PacketTerms]
    remaining: wp.array[wp.int32]  # rows of packets whose rays are cast one by one, in any order
    count: wp.array[wp.int32]  # (1): their number


@wp.struct
class PacketRays:
    """Rays of packets, packet by packet: arrays of a `RayPackets`."""

    points: wp.array[wp.vec2]
    rests: wp.array[wp.vec2]
    scale: wp.array[float]
    asides: wp.array[wp.vec2]  # None if all rays start at the camera, and so is the next
    begins: wp.array[float]


@wp.func
def leg_of(terms: MovingTerms, row: int, leg: int) -> LegTerms:
    return terms.legs[row, leg]


@wp.func
def vector_in(words: wp.array2d[wp.float64], row: int, first: int) -> wp.vec3d:
    return wp.vec3d(words[row, first], words[row, first + 1], words[row, first + 2])


@wp.func
def set_vector(row: int, first: int, value: wp.vec3d, words_out: wp.array2d[wp.float64]):
    for k in range(3):
        words_out[row, first + k] = value[k]


@wp.func
def crossing(w: wp.vec3) -> wp.mat33:
    """Return the cross product matrix of a vector."""
    return wp.mat33(0.0, -w[2], w[1], w[2], 0.0, -w[0], -w[1], w[0], 0.0)


@wp.func
def relative_leg(
    leg: Leg, share: wp.float64, is_screw: bool, is_base: bool, middle: Frame, image: wp.mat33, inverse: wp.mat33
) -> LegTerms:
    """Return the terms of a leg whose base is at a share of it, which is the pose in the middle if `is_base`."""
    terms, turn = LegTerms(), image * crossing(wp.vec3(leg.rotation_vector)) * inverse
    terms.turn = turn
    if is_screw:
        terms.path = image * wp.vec3(leg.path)
        terms.across = turn * terms.path
        terms.along = turn * terms.across
    else:
        terms.path = image * wp.vec3(wp.quat_rotate_inv(middle.rotation, leg.path))
        if not is_base:
            rotation = compose_rotation(leg.rotation, share * leg.rotation_vector)
            q = wp.quat_inverse(middle.rotation) * rotation
            across = crossing(wp.vec3(float(q[0]), float(q[1]), float(q[2])))
            terms.still = image * (2.0 * float(q[3]) * across + 2.0 * across * across) * inverse
            terms.turn = turn + terms.still * turn
            origin = leg.origin + share * leg.path - middle.origin
            terms.begin = image * wp.vec3(wp.quat_rotate_inv(middle.rotation, origin))
    terms.twice = terms.turn * turn
    w = wp.vec3(leg.rotation_vector)
    terms.square = wp.dot(w, w)
    return terms


@wp.func
def lowest_z(terms: LegTerms, begin: float, end: float) -> float:
    """Return a lower bound of the translation along the image's axis between two times since the packet's middle."""
    first, last = (begin + terms.offset) * terms.rate, (end + terms.offset) * terms.rate
    most = wp.max(wp.abs(first), wp.abs(last))
    curved = most * most * (0.5 * wp.abs(terms.across[2]) + most * wp.abs(terms.along[2]) / 6.0)
    return terms.begin[2] + wp.min(first * terms.path[2], last * terms.path[2]) - curved


@wp.kernel
def place_moving_packets(
    # Cameras:
    sensor: Motion,
    # In:
    worlds: Worlds,
    in_worlds: bool,
    packets: RayPackets,
    spans_in: wp.array2d[wp.float64],
    paces_in: wp.array[wp.vec3d],
    # Out:
    terms_out: MovingTerms,
    packets_out: RayPackets,
):
    """Write the terms of each packet in each view, its image but for `spread` and `longest`, and its eye.

    `packets` are those of the sensor at rest. `spans_in` are the first and the last time of a packet, after the start
    of the frame [s]. `paces_in` approximate times since their middle by x * column + y * row + z [s]. If `in_worlds`,
    no packet is cast in a view whose world does not exist.
    """
    view, packet = wp.tid()
    row = view * packets.place.shape[0] + packet
    if row == 0:
        terms_out.count[0] = 0
    half, zero, one = wp.float64(0.5), wp.float64(0.0), wp.float64(1.0)
    column, start = wp.min(view, sensor.legs.shape[1] - 1), wp.float64(0.0)
    if sensor.starts:
        start = sensor.starts[view]
    begin, end = start + spans_in[packet, 0], start + spans_in[packet, 1]
    moment = half * (begin + end)
    middle = frame_at(sensor, column, 0, moment)
    right, down = vector_in(packets.frame, packet, 0), vector_in(packets.frame, packet, 3)
    forward, corner = vector_in(packets.frame, packet, 6), vector_in(packets.frame, packet, 18)
    a, b = vector_in(packets.frame, packet, 9), vector_in(packets.frame, packet, 12)
    c = vector_in(packets.frame, packet, 15)
    image = wp.matrix_from_rows(wp.vec3(right), wp.vec3(down), wp.vec3(forward))
    inverse = wp.matrix_from_cols(wp.vec3(a), wp.vec3(b), wp.vec3(c))
    eye, reach = wp.vec3d(), float(0.0)
    if packets.eyes:
        eye = vector_in(packets.eyes, packet, 0)
        reach = float(packets.eyes[packet, 6])

    first, last = int(0), int(0)
    if sensor.times:
        first, last = leg_at(sensor.times, begin), leg_at(sensor.times, end)
    legs = terms_out.legs.shape[1]
    way, angle, lowest = float(0.0), float(0.0), float(0.0)
    velocity = wp.vec2()  # of points at the image's center [px/s]
    middle_pixel = half * (wp.sqrt(wp.float64(packets.place.shape[1])) - one)
    center = wp.vec2(float(corner[0] + middle_pixel), float(corner[1] + middle_pixel))
    for k in range(legs):
        instant = wp.min(first + k, last)
        leg, rate, base, share = sensor.legs[instant, column, 0], wp.float64(0.0), moment, wp.float64(0.0)
        low, high = begin, end
        if sensor.is_screw:
            rate = one
        elif sensor.times:
            since = sensor.times[instant]
            if instant > first:
                low = since
            if instant + 1 < sensor.times.shape[0]:
                until = sensor.times[instant + 1]
                high = wp.min(high, until)
                base = wp.min(base, until)
                rate = one / (until - since)
            base = wp.max(base, since)
            share = (base - since) * rate
        terms = relative_leg(leg, share, sensor.is_screw, base == moment, middle, image, inverse)
        terms.offset = float(moment - base)
        terms.rate = float(rate)
        terms.since = float(low - moment)
        if first + k > last:
            terms.since = wp.inf
        terms_out.legs[row, k] = terms
        if first + k <= last:
            passed = float(wp.max(high - low, zero) * rate)
            way += passed * wp.length(wp.vec3(leg.path))
            angle += passed * wp.sqrt(terms.square)
            lowest = wp.min(lowest, lowest_z(terms, float(low - moment), float(high - moment)))
            if low <= moment and moment <= high:
                turned = terms.turn * wp.vec3(center[0], center[1], 1.0)
                velocity = terms.rate * (wp.vec2(turned[0], turned[1]) - turned[2] * center)

    # Pixels move by the velocity times their time, which is nearly linear in columns and rows.
    pace = paces_in[packet]
    moved, pace_u, pace_v = wp.vec2d(velocity), pace[0], pace[1]
    stretch = one + pace_u * moved[0] + pace_v * moved[1]
    if not (stretch > MIN_STRETCH and stretch * MIN_STRETCH < one):
        moved = wp.vec2d()
        stretch = one
    fit = -wp.outer(moved, wp.vec2d(pace_u, pace_v)) / stretch
    shown = wp.vec2d(corner[0], corner[1]) + pace[2] * moved
    shown += fit * shown
    origins = angle * (reach + wp.length(wp.vec3(eye)))
    shift = lowest - origins
    back = wp.float64(shift) * (wp.float64(center[0]) * a + wp.float64(center[1]) * b + c)
    common = PacketTerms()
    common.fit = wp.mat22(fit)
    common.first = wp.vec2(shown)
    common.center = image * wp.vec3(eye)
    common.shift = shift
    common.middle = center
    reach += way + origins + wp.length(wp.vec3(back))
    # False for numbers that are not finite.
    common.is_cast = last - first < legs and angle <= MAX_ANGLE and reach <= MAX_REACH
    if in_worlds and world_of(worlds, view) < 0:
        common.is_cast = False
    terms_out.packets[row] = common

    rotation = wp.quat_to_matrix(middle.rotation)
    fitted_right, fitted_down = (
        right + fit[0, 0] * right + fit[0, 1] * down,
        down + fit[1, 0] * right + fit[1, 1] * down,
    )
    set_vector(row, 0, rotation * fitted_right, packets_out.frame)
    set_vector(row, 3, rotation * fitted_down, packets_out.frame)
    set_vector(row, 6, rotation * forward, packets_out.frame)
    # The inverse of the fit is 1 + moved pace^T.
    across = moved[0] * a + moved[1] * b
    set_vector(row, 9, rotation * (a + pace_u * across), packets_out.frame)
    set_vector(row, 12, rotation * (b + pace_v * across), packets_out.frame)
    set_vector(row, 15, rotation * c, packets_out.frame)
    packets_out.frame[row, 18] = shown[0]
    packets_out.frame[row, 19] = shown[1]
    packets_out.frame[row, 22] = wp.length(fitted_right)
    packets_out.frame[row, 23] = wp.length(fitted_down)
    packets_out.frame[row, 25] = packets.frame[packet, 25]
    set_vector(row, 0, middle.origin + rotation * (eye + back), packets_out.eyes)
    packets_out.eyes[row, 6] = wp.float64(reach * ROUNDED)


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    for (int other = {CUDA_LANES // 2}; other; other >>= 1) {{
        const float theirs = __shfl_xor_sync(0xffffffffu, value, other);
        value = theirs > value ? theirs : value;
    }}
#endif
    return value;
""")
def max_of_lanes(value: float) -> float: ...


@wp.kernel
def move_packet_rays(
    # In:
    rays: PacketRays,
    times_in: wp.array2d[float],
    cells_in: wp.array[wp.vec2],
    lanes: int,
    # Out:
    terms_out: MovingTerms,
    packets_out: RayPackets,
    rays_out: PacketRays,
):
    """Write the rays of packets in each view, and the bounds of a packet's rays; append those not cast to `remaining`.

    `rays` are those of the sensor at rest, `times_in` (packet, slot) are times since the middle of a packet's times
    [s], and `cells_in` the column and the row of a slot. A packet is processed by a warp on CUDA, and by one thread on
    the CPU: `lanes` is the number of threads.
    """
    view, packet, lane = wp.tid()
    row, legs, slots = view * times_in.shape[0] + packet, terms_out.legs.shape[1], times_in.shape[1]
    common = terms_out.packets[row]
    terms, current = leg_of(terms_out, row, 0), int(0)

    spread_u, spread_v, least, last = float(0.0), float(0.0), float(wp.inf), float(0.0)
    max_p, max_q, max_moment, nearest = float(0.0), float(0.0), float(0.0), float(1.0)
    for slot in range(lane, slots, lanes):
        source, target = packet * slots + slot, row * slots + slot
        scale, cell = float(rays.scale[source]), common.first + cells_in[slot]
        point, rest, aside, z = cell, wp.vec2(), wp.vec2(), float(0.0)
        if scale > 0.0:
            time = times_in[packet, slot]
            leg = int(0)
            for k in range(1, legs):
                if time >= terms_out.legs[row, k].since:
                    leg = k
            if leg != current:
                terms = leg_of(terms_out, row, leg)
                current = leg
            share = (time + terms.offset) * terms.rate
            x = share * share * terms.square
            once = share * (1.0 - x * (1.0 / 6.0 - x * (1.0 / 120.0 - x / 5040.0)))
            twice = share * share * (0.5 - x * (1.0 / 24.0 - x * (1.0 / 720.0 - x / 40320.0)))
            thrice = share * share * share * (1.0 / 6.0 - x * (1.0 / 120.0 - x / 5040.0))
            turn = terms.still + once * terms.turn + twice * terms.twice

            still = rays.points[source]
            moved = turn * wp.vec3(still[0], still[1], 1.0)
            depth = 1.0 + moved[2]
            nearest = wp.min(nearest, depth)
            per_depth = 1.0 / depth
            step = per_depth * (wp.vec2(moved[0], moved[1]) - moved[2] * still)
            step += common.fit * (still + step)
            rest = rays.rests[source] + step
            point = still + rest
            rest -= point - still
            scale = scale * per_depth

            origin = wp.vec3()
            if rays.asides:
                z = float(rays.begins[source])
                start = rays.asides[source] + z * still
                origin = wp.vec3(start[0], start[1], z)
            origin += turn * (origin + common.center)
            origin += terms.begin + share * terms.path + twice * terms.across + thrice * terms.along
            z = origin[2] - common.shift
            across = wp.vec2(origin[0], origin[1]) - common.shift * common.middle
            aside = across + common.fit * across - z * point

            error = point - cell
            spread_u = wp.max(spread_u, wp.abs(error[0]))
            spread_v = wp.max(spread_v, wp.abs(error[1]))
            least = wp.min(least, scale)
            last = wp.max(last, z)
            max_p = wp.max(max_p, wp.abs(aside[0]))
            max_q = wp.max(max_q, wp.abs(aside[1]))
            one, other = point[0] * aside[1], point[1] * aside[0]
            max_moment = wp.max(max_moment, wp.abs(one - other) + FLOAT_STEP * (wp.abs(one) + wp.abs(other)))
        rays_out.points[target] = point
        rays_out.rests[target] = rest
        rays_out.scale[target] = scale
        rays_out.asides[target] = aside
        rays_out.begins[target] = z
    spread_u = max_of_lanes(spread_u) + MARGIN
    spread_v = max_of_lanes(spread_v) + MARGIN
    longest = ROUNDED / -max_of_lanes(-least)
    last = max_of_lanes(last) * ROUNDED
    max_p = max_of_lanes(max_p) * ROUNDED
    max_q = max_of_lanes(max_q) * ROUNDED
    max_moment = max_of_lanes(max_moment) * ROUNDED
    nearest = -max_of_lanes(-nearest)
    if lane > 0:
        return
    fits = nearest >= MIN_DEPTH and wp.max(spread_u, spread_v) <= MAX_SPREAD
    if not (common.is_cast and fits and wp.max(max_p, max_q) <= MAX_EYE_OFFSET):
        longest = 0.0
    if longest <= 0.0:
        terms_out.remaining[wp.atomic_add(terms_out.count, 0, 1)] = row
    packets_out.frame[row, 20] = wp.float64(spread_u)
    packets_out.frame[row, 21] = wp.float64(spread_v)
    packets_out.frame[row, 24] = wp.float64(longest)
    packets_out.eyes[row, 3] = wp.float64(max_p)
    packets_out.eyes[row, 4] = wp.float64(max_q)
    packets_out.eyes[row, 5] = wp.float64(max_moment)
    packets_out.eyes[row, 7] = wp.float64(last)
