# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shaped values of the visibility of bodies: with a slope where the visible fraction is 0 or 1."""

import warp as wp

from warpvis.kernels.pinhole import PinholeCamera, frame_of
from warpvis.kernels.visibility.points import OCCLUDED

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def exclude_others(
    # In:
    members: wp.array[wp.uint8],
    hidden: wp.array2d[wp.uint8],
    # Out:
    excluded_out: wp.array2d[wp.uint8],
):
    """Write 1 for every object of a view that is not part of a body, or that is hidden if `hidden` is not None."""
    view, index = wp.tid()
    excluded = wp.uint8(1) - members[index]
    if hidden:
        if hidden[view, index] != wp.uint8(0):
            excluded = wp.uint8(1)
    excluded_out[view, index] = excluded


@wp.func
def is_free(depth: wp.array3d[float], view: int, y: int, x: int, z: float) -> bool:
    """Return whether a pixel of the image exists and shows nothing nearer than a depth."""
    if x < 0 or y < 0 or x >= depth.shape[2] or y >= depth.shape[1]:
        return False
    return depth[view, y, x] >= z


@wp.kernel
def distance_to_free(
    # In:
    depth: wp.array3d[float],
    isolated: wp.array3d[float],
    slot: int,
    # Out:
    squared_out: wp.array2d[wp.int32],
):
    """Lower the squared distance [px^2] from a body's pixels in a row of the image to the nearest free pixel.

    A pixel of the image is free for a point of the body if it shows nothing nearer than that point. Distances in
    `squared_out`, ``(view, slot)``, start at a bound.
    """
    view, y = wp.tid()
    best = squared_out[view, slot]
    for x in range(depth.shape[2]):
        z = isolated[view, y, x]
        if wp.isfinite(z):
            dy = int(0)
            while dy * dy < best:
                dx = int(0)
                while dx * dx + dy * dy < best:
                    if (
                        is_free(depth, view, y - dy, x - dx, z)
                        or is_free(depth, view, y - dy, x + dx, z)
                        or is_free(depth, view, y + dy, x - dx, z)
                        or is_free(depth, view, y + dy, x + dx, z)
                    ):
                        best = dx * dx + dy * dy
                    dx += 1
                dy += 1
    if best < squared_out[view, slot]:
        wp.atomic_min(squared_out, view, slot, best)


@wp.func
def corner_ray(camera: PinholeCamera, k: int) -> wp.vec3d:
    """Return the unit direction of a corner of the image, the corners in clockwise order."""
    x, y = wp.float64(0.0), wp.float64(0.0)
    if k == 1 or k == 2:
        x = wp.float64(camera.width)
    if k == 2 or k == 3:
        y = wp.float64(camera.height)
    return wp.normalize(wp.vec3d((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, wp.float64(1.0)))


@wp.func
def angle_between(a: wp.vec3d, b: wp.vec3d) -> wp.float64:
    return wp.atan2(wp.length(wp.cross(a, b)), wp.dot(a, b))


@wp.func
def angle_to_image(camera: PinholeCamera, direction: wp.vec3d) -> wp.float64:
    """Return the angle between a camera-frame direction and the nearest direction in the image [rad]; 0 inside."""
    zero = wp.float64(0.0)
    is_inside = bool(True)
    best = wp.float64(wp.PI)
    for k in range(4):
        a, b = corner_ray(camera, k), corner_ray(camera, (k + 1) % 4)
        inward = wp.normalize(wp.cross(a, b))
        outside = -wp.dot(inward, direction)
        if outside > zero:
            is_inside = False
        # The nearest direction is on a side of the image if its projection is between the side's corners.
        foot = direction + inward * outside
        if wp.dot(wp.cross(a, foot), inward) >= zero and wp.dot(wp.cross(foot, b), inward) >= zero:
            best = wp.min(best, angle_between(direction, foot))
        best = wp.min(best, angle_between(direction, a))
    if is_inside:
        return zero
    return best


@wp.kernel
def shape_values(
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    # In:
    centers: wp.array2d[wp.vec3],
    fraction: wp.array2d[float],
    status: wp.array2d[wp.uint8],
    visible_box: wp.array2d[wp.vec4i],
    squared: wp.array2d[wp.int32],
    # Out:
    shaped_out: wp.array2d[float],
):
    """Write the shaped value of every body in every view, from the centers of the bodies in the world [m]."""
    view, slot = wp.tid()
    diagonal = wp.sqrt(camera.width * camera.width + camera.height * camera.height)
    value = fraction[view, slot]
    if value == 1.0:
        box = visible_box[view, slot]  # all of the silhouette
        right, bottom = int(camera.width) - box[0] - box[2], int(camera.height) - box[1] - box[3]
        margin = wp.min(wp.min(box[0], box[1]), wp.min(right, bottom))
        value = 1.0 + float(wp.max(margin, 0)) / diagonal
    elif value == 0.0:
        if status[view, slot] == OCCLUDED:
            value = -0.5 * wp.min(wp.sqrt(float(squared[view, slot])) / diagonal, 1.0)
        else:
            frame = frame_of(camera_to_world[view])
            offset = wp.vec3d(centers[view, slot]) - frame.origin
            direction = wp.quat_rotate_inv(frame.rotation, offset)
            value = -0.5
            if wp.length(direction) > wp.float64(0.0):
                value -= 0.5 * float(angle_to_image(camera, wp.normalize(direction))) / wp.PI
    shaped_out[view, slot] = value


@wp.kernel
def body_centers(
    # In:
    local: wp.array[wp.vec3],
    columns: wp.array[wp.int32],
    object_poses: wp.array2d[wp.transform],
    world_of_view: wp.array[wp.int32],
    members: wp.array2d[wp.uint8],
    # Out:
    centers_out: wp.array2d[wp.vec3],
):
    """Write the mean of the centers of each body's objects, in the world [m], ``(view, body)``.

    `local` are centers in the frames of `columns`: columns of `object_poses`, or -1 for the world.
    """
    view, slot = wp.tid()
    total = wp.vec3(0.0, 0.0, 0.0)
    count = float(0.0)
    for index in range(local.shape[0]):
        if members[slot, index] != wp.uint8(0):
            center = local[index]
            if columns[index] >= 0:
                center = wp.transform_point(object_poses[world_of_view[view], columns[index]], center)
            total += center
            count += 1.0
    centers_out[view, slot] = total / wp.max(count, 1.0)
