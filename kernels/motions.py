# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses that change within a frame: where a sensor, or an object, is at the time of a ray, in double precision.

Between instants a place moves along a straight line, and a rotation about one axis, both at a constant rate, which is
what slerp does (Shoemake, "Animating Rotation with Quaternion Curves", SIGGRAPH 1985). A twist, velocities along and
about the moving thing's own axes, moves it along a screw: its pose times the exponential of the twist (Lynch and Park,
"Modern Robotics", 2017, equation 3.88).
"""

import warp as wp

from warpvis.kernels.pinhole import pose_origin, pose_rotation

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class Leg:
    """From one instant to the next: where something begins, how far it goes, and how far it turns about its own axes.

    Behind the last instant it stays. Of a twist it is the pose at 0 s, and path and turn are velocities.
    """

    origin: wp.vec3d
    rotation: wp.quatd
    path: wp.vec3d
    turn: wp.vec3d


@wp.struct
class Motion:
    """Where sensors or objects are, as it changes with time."""

    legs: wp.array3d[Leg]
    """(instant, view, 0) of sensors, or (instant, 0, 0) of all views; (instant, world, object) of movable objects."""
    times: wp.array[wp.float64]
    """(instant): when each leg begins [s]; None if there is one."""
    is_screw: bool
    """Whether there is a twist."""
    starts: wp.array[wp.float64]
    """(view): when its frame starts, from which rays' times count [s]; None for 0."""
    poses: wp.array3d[wp.transform]
    """In place of legs, (view, y, x): what each ray has of its own; y and x may be 0 for all. None mostly."""


@wp.struct
class Frame:
    """Where something is in the world."""

    origin: wp.vec3d
    rotation: wp.quatd


@wp.func
def frame_of(pose: wp.transform) -> Frame:
    frame = Frame()
    frame.origin = pose_origin(pose)
    frame.rotation = pose_rotation(pose)
    return frame


@wp.func
def is_same(a: wp.transform, b: wp.transform) -> bool:
    for k in range(7):
        if a[k] != b[k]:
            return False
    return True


@wp.func
def turn_between(a: wp.quatd, b: wp.quatd) -> wp.vec3d:
    """The rotation, about the axes of the first, that makes the second of it on the shorter way: axis times angle."""
    way = wp.quat_inverse(a) * b
    axis, w = wp.vec3d(way[0], way[1], way[2]), way[3]
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
    """Find the way from each instant's pose to the next one's; of a twist, `linear_in` and `angular_in` are it."""
    instant, row, column = wp.tid()
    first = frame_of(poses_in[instant, row, column])
    leg = Leg()
    leg.origin = first.origin
    leg.rotation = first.rotation
    if linear_in:
        leg.path = linear_in[row, column]
        leg.turn = angular_in[row, column]
    elif instant + 1 < poses_in.shape[0] and not is_same(
        poses_in[instant, row, column], poses_in[instant + 1, row, column]
    ):
        second = frame_of(poses_in[instant + 1, row, column])
        leg.path = second.origin - first.origin
        leg.turn = turn_between(first.rotation, second.rotation)
    legs_out[instant, row, column] = leg


@wp.func
def turned(rotation: wp.quatd, turn: wp.vec3d) -> wp.quatd:
    """A rotation, and then one about its own axes."""
    half, angle = wp.float64(0.5), wp.length(turn)
    if angle == wp.float64(0.0):
        return rotation
    axis = wp.sin(half * angle) / angle * turn
    return rotation * wp.quatd(axis[0], axis[1], axis[2], wp.cos(half * angle))


@wp.func
def along_screw(leg: Leg, time: wp.float64) -> Frame:
    """Where something is that has kept its velocities along and about its own axes."""
    one, two, turn, along = wp.float64(1.0), wp.float64(2.0), time * leg.turn, time * leg.path
    square = wp.dot(turn, turn)
    angle = wp.sqrt(square)
    sine, cosine = wp.sin(angle / two), wp.cos(angle / two)
    # sin(a / 2) / a and (a - sin a) / a^3, which near 0 is a difference of what is nearly the same.
    first = one / two
    if angle > wp.float64(0.0):
        first = sine / angle
    third = (one - square / wp.float64(20.0)) / wp.float64(6.0)
    if angle > wp.float64(1.0e-2):
        third = (angle - two * sine * cosine) / (square * angle)
    across = wp.cross(turn, along)
    moved = along + two * first * first * across + third * wp.cross(turn, across)
    frame = Frame()
    frame.origin = leg.origin + wp.quat_rotate(leg.rotation, moved)
    frame.rotation = leg.rotation * wp.quatd(first * turn[0], first * turn[1], first * turn[2], cosine)
    return frame


@wp.func
def leg_at(times: wp.array[wp.float64], time: wp.float64) -> int:
    """The last leg that has begun at a time, and before all of them the first."""
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
    """Where what has this place among the legs is at a time; at an instant exactly there."""
    if motion.is_screw:
        return along_screw(motion.legs[0, row, column], time)
    at = int(0)
    share = wp.float64(0.0)
    if motion.times:
        at = leg_at(motion.times, time)
        if at + 1 < motion.times.shape[0]:
            begin = motion.times[at]
            share = wp.max((time - begin) / (motion.times[at + 1] - begin), wp.float64(0.0))
    leg = motion.legs[at, row, column]
    frame = Frame()
    frame.origin = leg.origin + share * leg.path
    frame.rotation = turned(leg.rotation, share * leg.turn)
    return frame


@wp.func
def time_of(motion: Motion, times: wp.array2d[wp.float64], view: int, y: int, x: int) -> wp.float64:
    """When a ray is cast, on the clock of the poses; 0 where nobody says when."""
    time = wp.float64(0.0)
    if times:
        time = times[y, x]
    if motion.starts:
        time += motion.starts[view]
    return time


@wp.func
def sensor_at(motion: Motion, view: int, y: int, x: int, time: wp.float64) -> Frame:
    """Where a sensor is when a ray is cast."""
    if motion.poses:
        at = wp.min(view, motion.poses.shape[0] - 1)
        row, column = wp.min(y, motion.poses.shape[1] - 1), wp.min(x, motion.poses.shape[2] - 1)
        return frame_of(motion.poses[at, row, column])
    return frame_at(motion, wp.min(view, motion.legs.shape[1] - 1), 0, time)
