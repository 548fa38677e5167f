# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Masks of pixels next to silhouettes, from images of a finished render.

Let pixel a see the point ``p_a`` with the camera-frame normal ``n_a`` at depth ``z_a``, and let its neighbor b have the
ray ``o_b + z d_b``. The tangent plane of a has on b's ray the depth ``z_a' = n_a . (p_a - o_b) / (n_a . d_b)``, and the
plane of b has ``z_b'`` on a's ray. If both surfaces meet at a crease between the pixels, depth changes from ``z_a``
along the first plane up to the crease, and from there along the second plane to ``z_b``. Depth is monotonic along both,
so that ``|z_b - z_a| <= |z_a' - z_a| + |z_b' - z_b|``. Neighbors for which this does not hold see surfaces that are not
connected.
"""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.gradients.depth_gradients import RayTable
from warpvis.kernels.pinhole import Frame, Window, frame_of, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

SLOPE_TOLERANCE = wp.constant(wp.float64(1.0e-3))
"""Relative error of depth differences on tangent planes, which are computed from single-precision normals."""

DEPTH_TOLERANCE = wp.constant(wp.float64(1.0e-5))
"""Relative error of depth differences of connected surfaces that single-precision images may have."""


@wp.func
def ray_origin(table: RayTable, y: int, x: int) -> wp.vec3d:
    """Return the origin of a pixel's ray in the camera frame [m]."""
    if not table.origins:
        return wp.vec3d()
    return table.origins[y, x]


@wp.func
def plane_depth(table: RayTable, point: wp.vec3d, normal: wp.vec3d, y: int, x: int) -> wp.float64:
    """Return the depth of a plane in the camera frame on a pixel's ray; not positive or not finite if it misses."""
    return wp.dot(normal, point - ray_origin(table, y, x)) / wp.dot(normal, table.rays[y, x])


@wp.func
def are_connected(
    table: RayTable, pose: Frame, images: Images, view: int, y: int, x: int, other_y: int, other_x: int
) -> bool:
    """Return whether the surfaces that two pixels see can be one surface with a crease between the pixels."""
    z, other_z = images.depth[view, y, x], images.depth[view, other_y, other_x]
    if not (wp.isfinite(z) and wp.isfinite(other_z)):
        return wp.isfinite(z) == wp.isfinite(other_z)
    if images.segmentation[view, y, x] != images.segmentation[view, other_y, other_x]:
        return False
    depth, other_depth = wp.float64(z), wp.float64(other_z)
    point = ray_origin(table, y, x) + depth * table.rays[y, x]
    other_point = ray_origin(table, other_y, other_x) + other_depth * table.rays[other_y, other_x]
    normal = wp.quat_rotate_inv(pose.rotation, wp.vec3d(images.normals[view, y, x]))
    other_normal = wp.quat_rotate_inv(pose.rotation, wp.vec3d(images.normals[view, other_y, other_x]))
    there = plane_depth(table, point, normal, other_y, other_x)
    here = plane_depth(table, other_point, other_normal, y, x)
    zero, one = wp.float64(0.0), wp.float64(1.0)
    # A plane that a neighboring ray misses does not bound depth; NaN fails every comparison.
    if not (there > zero and here > zero):
        return False
    bound = (wp.abs(there - depth) + wp.abs(here - other_depth)) * (one + SLOPE_TOLERANCE)
    return wp.abs(other_depth - depth) <= bound + DEPTH_TOLERANCE * depth


@wp.kernel
def mark_silhouettes(
    # Cameras:
    table: RayTable,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    images_in: Images,
    # Out:
    mask_out: wp.array3d[wp.uint8],
):
    """Write 1 for pixels with a neighbor, of eight, that sees another object or a surface that is not connected."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    pose = frame_of(camera_to_world[view])
    height, width = images_in.depth.shape[1], images_in.depth.shape[2]
    is_marked = bool(False)
    for other_y in range(wp.max(y - 1, 0), wp.min(y + 2, height)):
        for other_x in range(wp.max(x - 1, 0), wp.min(x + 2, width)):
            # The same arguments in the same order for both pixels of a pair: both are marked, or none.
            if other_y > y or (other_y == y and other_x > x):
                is_marked = is_marked or not are_connected(table, pose, images_in, view, y, x, other_y, other_x)
            elif other_y != y or other_x != x:
                is_marked = is_marked or not are_connected(table, pose, images_in, view, other_y, other_x, y, x)
    mask_out[view, y, x] = wp.where(is_marked, wp.uint8(1), wp.uint8(0))
