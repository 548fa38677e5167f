# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Gradients of depth, points and normals with respect to the vertices of a movable object.

If a triangle's corner i moves by ``dv_i``, the surface at the hit with barycentric weights ``w_i`` moves by
``sum w_i dv_i``. The normal is ``+-m / |m|`` with ``m = e1 x e2`` of the edges ``e1 = b - a`` and ``e2 = c - a``,
so that ``dm = de1 x e2 + e1 x de2``.
"""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.worlds import Worlds, world_of
from warpvis.kernels.gradients.depth_gradients import ImageGradients, RayTable, pixel_gradient
from warpvis.kernels.pinhole import Window, frame_of, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class DeformingObject:
    """A movable object whose vertices may change."""

    index: int  # in the scene's objects
    column: int  # in the object poses
    vertices: wp.array[wp.vec3]
    faces: wp.array2d[wp.int32]  # (triangle, corner)


@wp.func
def barycentric_weights(point: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> wp.vec3d:
    """Return the barycentric weights of a point of the plane of a triangle, by signed areas."""
    normal = wp.cross(b - a, c - a)
    area = wp.dot(normal, normal)
    if area == wp.float64(0.0):
        return wp.vec3d()
    of_b = wp.dot(wp.cross(point - a, c - a), normal) / area
    of_c = wp.dot(wp.cross(b - a, point - a), normal) / area
    return wp.vec3d(wp.float64(1.0) - of_b - of_c, of_b, of_c)


@wp.kernel
def sum_vertex_gradients(
    # Scene:
    worlds: Worlds,
    deforming: DeformingObject,
    # Cameras:
    table: RayTable,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    images_in: Images,
    gradients_in: ImageGradients,
    # Out:
    vertices_out: wp.array[wp.vec3d],
):
    """Add gradients with respect to the vertices of an object, in its frame, over all pixels that see it."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    if images_in.segmentation[view, y, x] != deforming.index:
        return
    pixel = pixel_gradient(table, frame_of(camera_to_world[view]), images_in, gradients_in, view, y, x)
    face = images_in.faces[view, y, x]
    if not pixel.is_hit or face < 0:
        return
    pose = frame_of(worlds.object_poses[wp.max(world_of(worlds, view), 0), deforming.column])
    i, j, k = deforming.faces[face, 0], deforming.faces[face, 1], deforming.faces[face, 2]
    a, b, c = wp.vec3d(deforming.vertices[i]), wp.vec3d(deforming.vertices[j]), wp.vec3d(deforming.vertices[k])
    point = wp.quat_rotate_inv(pose.rotation, pixel.world_point - pose.origin)
    weights = barycentric_weights(point, a, b, c)
    surface = wp.quat_rotate_inv(pose.rotation, pixel.surface)
    normal = wp.quat_rotate_inv(pose.rotation, pixel.normal)
    of_normal = wp.quat_rotate_inv(pose.rotation, pixel.of_normal)
    m = wp.cross(b - a, c - a)
    of_m = (of_normal - wp.dot(of_normal, normal) * normal) / wp.max(wp.length(m), wp.float64(1.0e-300))
    if wp.dot(m, normal) < wp.float64(0.0):
        of_m = -of_m
    of_e1, of_e2 = wp.cross(c - a, of_m), wp.cross(of_m, b - a)
    wp.atomic_add(vertices_out, i, weights[0] * surface - of_e1 - of_e2)
    wp.atomic_add(vertices_out, j, weights[1] * surface + of_e1)
    wp.atomic_add(vertices_out, k, weights[2] * surface + of_e2)
