# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Gradients of depth, points and normals with respect to poses and rays, from images of a finished render.

Let a ray start at ``o`` and have the direction ``d`` in the camera frame, let ``R``, ``t`` be the camera's pose, ``n``
the world normal of the seen surface, and ``q = n . R d``. The seen point is ``p = t + R c`` with ``c = o + z d``. It
stays on the surface's tangent plane, ``n . (p - s) = 0`` for a point ``s`` of the surface, which gives the derivative
of depth:

    dz = (n . ds - n . (dt + dR c)) / q - z n . R dd / q

A point of an object with the pose ``A``, ``b`` is ``s = b + A l``, so ``ds = db + dA l`` with ``l = A^T (p - b)``. The
derivative of the seen point is ``dp = dt + dR c + R d dz + z R dd``, and a triangle's normal turns with its object.
This holds where the same surface is seen before and after the change: silhouettes do not contribute.
"""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.worlds import Worlds, world_of
from warpvis.kernels.pinhole import Frame, Window, frame_of, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

mat34d = wp.types.matrix(shape=(3, 4), dtype=wp.float64)


@wp.struct
class ImageGradients:
    """Gradients of a loss with respect to images, ``[view, y, x]``; None for images without one."""

    depth: wp.array3d[float]
    points: wp.array3d[wp.vec3]
    normals: wp.array3d[wp.vec3]


@wp.struct
class RayTable:
    """Rays of depth 1 of a camera's pixels, and their origins in the camera frame [m]; None if all are zero."""

    rays: wp.array2d[wp.vec3d]
    origins: wp.array2d[wp.vec3d]


@wp.struct
class PixelGradient:
    """Gradients of a loss through one pixel."""

    is_hit: bool
    point: wp.vec3d  # seen point in the camera frame [m]
    world_point: wp.vec3d
    surface: wp.vec3d  # gradient with respect to a displacement of the surface, in the world frame
    camera: wp.vec3d  # gradient with respect to a displacement of the ray's origin, in the world frame
    normal: wp.vec3d  # unit normal in the world frame
    of_normal: wp.vec3d  # gradient with respect to the normal, in the world frame


@wp.func
def pixel_gradient(
    table: RayTable, pose: Frame, images: Images, gradients: ImageGradients, view: int, y: int, x: int
) -> PixelGradient:
    """Return the gradients through a pixel; pixels without finite depth have none."""
    result = PixelGradient()
    depth = images.depth[view, y, x]
    result.is_hit = wp.isfinite(depth)
    if not result.is_hit:
        return result
    ray, z = table.rays[y, x], wp.float64(depth)
    result.point = z * ray
    if table.origins:
        result.point += table.origins[y, x]
    along = wp.quat_rotate(pose.rotation, ray)
    result.world_point = pose.origin + wp.quat_rotate(pose.rotation, result.point)
    result.normal = wp.vec3d(images.normals[view, y, x])
    of_depth = wp.float64(0.0)
    if gradients.depth:
        of_depth = wp.float64(gradients.depth[view, y, x])
    of_point = wp.vec3d()
    if gradients.points:
        of_point = wp.vec3d(gradients.points[view, y, x])
        of_depth += wp.dot(of_point, along)
    if gradients.normals:
        result.of_normal = wp.vec3d(gradients.normals[view, y, x])
    slope = wp.dot(result.normal, along)
    # Edge-on surfaces, whose normal is perpendicular to the ray in single precision, have no derivative.
    if slope != wp.float64(0.0):
        result.surface = of_depth / slope * result.normal
    result.camera = of_point - result.surface
    return result


@wp.func
def moment(force: wp.vec3d, point: wp.vec3d) -> mat34d:
    """Return the outer product of a vector with ``[point, 1]``: the gradient of ``force . (A point + b)``."""
    result = mat34d()
    for i in range(3):
        for k in range(3):
            result[i, k] = force[i] * point[k]
        result[i, 3] = force[i]
    return result


@wp.func
def turned(of_normal: wp.vec3d, normal: wp.vec3d, pose: Frame) -> mat34d:
    """Return the gradient of ``of_normal . A normal`` with respect to an object's pose ``A``, ``b``."""
    local = wp.quat_rotate_inv(pose.rotation, normal)
    result = mat34d()
    for i in range(3):
        for k in range(3):
            result[i, k] = of_normal[i] * local[k]
    return result


@wp.func
def object_column(columns: wp.array[wp.int32], images: Images, view: int, y: int, x: int) -> int:
    """Return the column in the object poses of the object that a pixel sees, -1 for a static object."""
    if not columns:
        return -1
    index = images.segmentation[view, y, x]
    if index < 0:
        return -1
    return columns[index]


@wp.func
def add_moment(sums_out: wp.array3d[mat34d], view: int, strip: int, column: int, sum: mat34d):
    """Add a moment to the sum of a strip; on the CPU, one thread has the whole strip."""
    wp.atomic_add(sums_out, view, strip, column, sum)


@wp.kernel
def sum_moments(
    # Scene:
    worlds: Worlds,
    columns: wp.array[wp.int32],
    # Cameras:
    table: RayTable,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    images_in: Images,
    gradients_in: ImageGradients,
    strip_rows: int,
    span: int,
    # Out:
    sums_out: wp.array3d[mat34d],
):
    """Add gradients with respect to the matrices ``[R t]`` of poses over strips of rows.

    Column 0 of `sums_out` is the camera, and column ``k + 1`` the movable object of column k. A thread has `span`
    pixels of each row of a strip. Neighboring pixels mostly see the same object, so that a thread adds its sum to
    memory only where the object changes.
    """
    view, strip, x = wp.tid()
    view, strip = locate(window, view, strip)
    pose = frame_of(camera_to_world[view])
    height, width = images_in.depth.shape[1], images_in.depth.shape[2]
    world = int(0)
    if columns:
        world = wp.max(world_of(worlds, view), 0)
    camera_sum, object_sum = mat34d(), mat34d()
    current = int(-1)
    object_pose = Frame()
    for y in range(strip * strip_rows, wp.min((strip + 1) * strip_rows, height)):
        for column in range(x * span, wp.min((x + 1) * span, width)):
            pixel = pixel_gradient(table, pose, images_in, gradients_in, view, y, column)
            if pixel.is_hit:
                camera_sum += moment(pixel.camera, pixel.point)
                seen = object_column(columns, images_in, view, y, column)
                if seen != current:
                    if current >= 0:
                        add_moment(sums_out, view, strip, current + 1, object_sum)
                    current, object_sum = seen, mat34d()
                    if seen >= 0:
                        object_pose = frame_of(worlds.object_poses[world, seen])
                if seen >= 0:
                    local = wp.quat_rotate_inv(object_pose.rotation, pixel.world_point - object_pose.origin)
                    object_sum += moment(pixel.surface, local)
                    object_sum += turned(pixel.of_normal, pixel.normal, object_pose)
    if current >= 0:
        add_moment(sums_out, view, strip, current + 1, object_sum)
    add_moment(sums_out, view, strip, 0, camera_sum)


@wp.func
def quaternion_gradient(sum: mat34d, q: wp.quatd) -> wp.quatd:
    """Return the gradient with respect to a quaternion of any length whose direction is the unit quaternion `q`.

    `sum` is the gradient with respect to the rotation matrix of the unit quaternion ``x y z w``. Its entries are
    quadratic, such as ``R01 = 2 (x y - w z)``; changes of the length have no effect.
    """
    two = wp.float64(2.0)
    x, y, z, w = q[0], q[1], q[2], q[3]
    s01, s02, s12 = sum[0, 1] + sum[1, 0], sum[0, 2] + sum[2, 0], sum[1, 2] + sum[2, 1]
    a01, a20, a12 = sum[1, 0] - sum[0, 1], sum[0, 2] - sum[2, 0], sum[2, 1] - sum[1, 2]
    gx = two * (y * s01 + z * s02 - two * x * (sum[1, 1] + sum[2, 2]) + w * a12)
    gy = two * (x * s01 + z * s12 - two * y * (sum[0, 0] + sum[2, 2]) + w * a20)
    gz = two * (x * s02 + y * s12 - two * z * (sum[0, 0] + sum[1, 1]) + w * a01)
    gw = two * (x * a12 + y * a20 + z * a01)
    radial = gx * x + gy * y + gz * z + gw * w
    return wp.quatd(gx - radial * x, gy - radial * y, gz - radial * z, gw - radial * w)


@wp.func
def row_gradient(sum: mat34d, pose: wp.transform) -> wp.transform:
    """Return the gradient with respect to a pose row ``x y z qx qy qz qw``, given that of its matrix."""
    rotation = wp.transform_get_rotation(pose)
    unit = wp.normalize(
        wp.quatd(wp.float64(rotation[0]), wp.float64(rotation[1]), wp.float64(rotation[2]), wp.float64(rotation[3]))
    )
    g = quaternion_gradient(sum, unit)
    length = wp.float64(wp.length(rotation))
    return wp.transform(
        wp.vec3(float(sum[0, 3]), float(sum[1, 3]), float(sum[2, 3])),
        wp.quat(float(g[0] / length), float(g[1] / length), float(g[2] / length), float(g[3] / length)),
    )


@wp.kernel
def sum_pose_strips(
    # Scene:
    worlds: Worlds,
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    # In:
    sums_in: wp.array3d[mat34d],
    # Out:
    gradients_out: wp.array2d[wp.transform],
):
    """Add the strips of each view, and convert the sums to gradients with respect to pose rows.

    Column 0 is the camera, and column ``k + 1`` the movable object of column k, in the world of the view.
    """
    view, column = wp.tid()
    total = mat34d()
    for strip in range(sums_in.shape[1]):
        total += sums_in[view, strip, column]
    pose = camera_to_world[view]
    if column > 0:
        pose = worlds.object_poses[wp.max(world_of(worlds, view), 0), column - 1]
    gradients_out[view, column] = row_gradient(total, pose)


@wp.kernel
def write_ray_gradients(
    # Cameras:
    table: RayTable,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    images_in: Images,
    gradients_in: ImageGradients,
    # Out:
    rays_out: wp.array3d[wp.vec3],
    origins_out: wp.array3d[wp.vec3],
):
    """Write gradients with respect to each pixel's ray and its origin, in the camera frame; 0 where nothing is hit."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    pose = frame_of(camera_to_world[view])
    pixel = pixel_gradient(table, pose, images_in, gradients_in, view, y, x)
    of_origin = wp.quat_rotate_inv(pose.rotation, pixel.camera)
    if origins_out:
        origins_out[view, y, x] = wp.vec3(of_origin)
    rays_out[view, y, x] = wp.vec3()
    if pixel.is_hit:
        rays_out[view, y, x] = wp.vec3(wp.float64(images_in.depth[view, y, x]) * of_origin)
