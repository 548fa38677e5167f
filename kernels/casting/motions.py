# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses that change within a frame: the pose of a sensor or an object at the time of a ray, in double precision.

Between instants, positions are interpolated linearly and rotations by slerp (Shoemake, "Animating Rotation with
Quaternion Curves", SIGGRAPH 1985). A twist, a linear and an angular velocity in the body frame, causes a screw motion:
the pose times the exponential of the twist (Lynch and Park, "Modern Robotics", 2017, equation 3.88).
"""

import warp as wp

from warpvis.kernels.pinhole import Frame, frame_of

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class Leg:
    """The motion from one instant to the next: the initial pose, the translation, and the rotation vector (body frame).

    After the last instant the pose is constant. For a twist, it is the pose at 0 s, and the path and the rotation
    vector are velocities.
    """

    origin: wp.vec3d
    rotation: wp.quatd
    path: wp.vec3d
    rotation_vector: wp.vec3d


@wp.struct
class Motion:
    """Poses of sensors or objects as functions of time."""

    legs: wp.array3d[Leg]
    """(instant, view, 0) for sensors, (instant, 0, 0) for all views; (instant, world, object) for movable objects."""
    times: wp.array[wp.float64]
    """(instant): start of each leg [s]; None if there is only one."""
    is_screw: bool
    """Whether the motion is a twist."""
    starts: wp.array[wp.float64]
    """(view): start of its frame, to which times of rays are relative [s]; None for 0."""
    poses: wp.array3d[wp.transform]
    """(view, y, x): poses of individual rays, instead of legs; any dimension may be 1 to share poses. Usually None."""


@wp.struct
class TimedRays:
    """Rays of a sensor, (y, x): directions in its frame, of depth 1; NaN for a pixel without a ray."""

    directions: wp.array2d[wp.vec3d]
    origins: wp.array2d[wp.vec3d]
    """In that frame; None for the frame's origin."""
    times: wp.array2d[wp.float64]
    """After the start of the frame [s]; None if every ray has an individual pose."""


@wp.func
def is_same(a: wp.transform, b: wp.transform) -> bool:
    for k in range(7):
        if a[k] != b[k]:
            return False
    return True


@wp.func
def rotation_vector_between(a: wp.quatd, b: wp.quatd) -> wp.vec3d:
    """Return the shortest rotation from `a` to `b` as a rotation vector (axis times angle) in the frame of `a`."""
    relative = wp.quat_inverse(a) * b
    axis, w = wp.vec3d(relative[0], relative[1], relative[2]), relative[3]
    if w < wp.float64(0.0):
        axis = -axis
        w = -w
    sine = wp.length(axis)
    if sine == wp.float64(0.0):
        return axis
    return wp.float64(2.0) * wp.atan2(sine, w) / sine * axis


@wp.kernel
def begin_legs(
    # In:
    poses_in: wp.array3d[wp.transform],
    linear_in: wp.array2d[wp.vec3d],
    angular_in: wp.array2d[wp.vec3d],
    # Out:
    legs_out: wp.array3d[Leg],
):
    """Write the leg from each instant's pose to the next one's, or the twist in `linear_in` and `angular_in`."""
    instant, row, column = wp.tid()
    first = frame_of(poses_in[instant, row, column])
    leg = Leg()
    leg.origin = first.origin
    leg.rotation = first.rotation
    if linear_in:
        leg.path = linear_in[row, column]
        leg.rotation_vector = angular_in[row, column]
    elif instant + 1 < poses_in.shape[0] and not is_same(
        poses_in[instant, row, column], poses_in[instant + 1, row, column]
    ):
        second = frame_of(poses_in[instant + 1, row, column])
        leg.path = second.origin - first.origin
        leg.rotation_vector = rotation_vector_between(first.rotation, second.rotation)
    legs_out[instant, row, column] = leg


@wp.func
def compose_rotation(rotation: wp.quatd, rotation_vector: wp.vec3d) -> wp.quatd:
    """Compose a rotation with a rotation vector in its frame."""
    half, angle = wp.float64(0.5), wp.length(rotation_vector)
    if angle == wp.float64(0.0):
        return rotation
    axis = wp.sin(half * angle) / angle * rotation_vector
    return rotation * wp.quatd(axis[0], axis[1], axis[2], wp.cos(half * angle))


@wp.func
def along_screw(leg: Leg, time: wp.float64) -> Frame:
    """Return the pose at a time of a body that moves with constant velocities in its own frame."""
    one, two, rotation_vector, along = wp.float64(1.0), wp.float64(2.0), time * leg.rotation_vector, time * leg.path
    square = wp.dot(rotation_vector, rotation_vector)
    angle = wp.sqrt(square)
    sine, cosine = wp.sin(angle / two), wp.cos(angle / two)
    # sin(a / 2) / a and (a - sin a) / a^3; the latter by its series near 0, where it suffers from cancellation.
    first = one / two
    if angle > wp.float64(0.0):
        first = sine / angle
    third = (one - square / wp.float64(20.0)) / wp.float64(6.0)
    if angle > wp.float64(1.0e-2):
        third = (angle - two * sine * cosine) / (square * angle)
    across = wp.cross(rotation_vector, along)
    moved = along + two * first * first * across + third * wp.cross(rotation_vector, across)
    frame = Frame()
    frame.origin = leg.origin + wp.quat_rotate(leg.rotation, moved)
    frame.rotation = leg.rotation * wp.quatd(
        first * rotation_vector[0], first * rotation_vector[1], first * rotation_vector[2], cosine
    )
    return frame


@wp.func
def leg_at(times: wp.array[wp.float64], time: wp.float64) -> int:
    """Return the last leg that has begun at a time, or the first leg before that."""
    low = int(0)
    high = int(times.shape[0])
    while high - low > 1:
        middle = (low + high) // 2
        if times[middle] <= time:
            low = middle
        else:
            high = middle
    return low


@wp.func
def frame_at(motion: Motion, row: int, column: int, time: wp.float64) -> Frame:
    """Return the pose of a row and column of legs at a time; exact at instants."""
    if motion.is_screw:
        return along_screw(motion.legs[0, row, column], time)
    instant = int(0)
    share = wp.float64(0.0)
    if motion.times:
        instant = leg_at(motion.times, time)
        if instant + 1 < motion.times.shape[0]:
            begin = motion.times[instant]
            share = wp.max((time - begin) / (motion.times[instant + 1] - begin), wp.float64(0.0))
    leg = motion.legs[instant, row, column]
    frame = Frame()
    frame.origin = leg.origin + share * leg.path
    frame.rotation = compose_rotation(leg.rotation, share * leg.rotation_vector)
    return frame


@wp.func
def time_of(motion: Motion, times: wp.array2d[wp.float64], view: int, y: int, x: int) -> wp.float64:
    """Return the time of a ray on the clock of the poses; 0 without times."""
    time = wp.float64(0.0)
    if times:
        time = times[y, x]
    if motion.starts:
        time += motion.starts[view]
    return time


@wp.func
def sensor_at(motion: Motion, view: int, y: int, x: int, time: wp.float64) -> Frame:
    """Return the pose of a sensor when a ray is cast."""
    if motion.poses:
        i = wp.min(view, motion.poses.shape[0] - 1)
        j, k = wp.min(y, motion.poses.shape[1] - 1), wp.min(x, motion.poses.shape[2] - 1)
        return frame_of(motion.poses[i, j, k])
    return frame_at(motion, wp.min(view, motion.legs.shape[1] - 1), 0, time)


@wp.func
def eye_of(motion: Motion, rays: TimedRays, view: int, y: int, x: int, time: wp.float64) -> Frame:
    """Return the pose of a sensor when a ray is cast, moved to the ray's origin."""
    eye = sensor_at(motion, view, y, x, time)
    if rays.origins:
        eye.origin += wp.quat_rotate(eye.rotation, rays.origins[y, x])
    return eye


@wp.struct
class MovingObjects:
    """Movable objects at the time of a ray: legs of their motion, (instant, world, object)."""

    motion: Motion
    time: wp.float64
