# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Silhouette edges between the pixels of an image, by walks over meshes.

As in the analytic antialiasing of Laine et al., "Modular Primitives for High-Performance Differentiable Rendering"
(ACM Transactions on Graphics 39, 2020), pairs of neighboring pixels of which one sees an object have a silhouette edge
between their centers. It crosses the segment from the center inside, a, to the one outside, b, at ``alpha`` from 0 to
1, and the area changes by ``alpha - 1/2`` pixels. Steep edges count in pairs of a row, flat ones in pairs of a column.

The edge is found by a walk over the mesh along the segment, from the triangles that a and b see: it belongs to the
object if that is in front, else to what hides it. For an edge through the point p with the direction e, a ray
``o + z d`` passes the edge on the side of the sign of ``g = (o - p) . (e x d)``. Between a and b, g is interpolated
linearly, so that ``alpha = g_a / (g_a - g_b)``. If the point of the edge at the crossing moves by ``dp``, alpha changes
by ``dp . (e x d) / (g_b - g_a)``. For pinholes and orthographic cameras, g is linear and this is exact.
"""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.worlds import Worlds, world_of
from warpvis.kernels.gradients.depth_gradients import RayTable
from warpvis.kernels.gradients.silhouette_masks import ray_origin
from warpvis.kernels.pinhole import Frame, frame_of

MAX_TRIANGLES = wp.constant(64)
"""Longest walk from a pixel center to a silhouette edge, in triangles; longer ones find none."""


@wp.struct
class Surfaces:
    """Triangles of all objects of a scene."""

    vertices: wp.array[wp.vec3]  # in the frame of the object, its parent, or the world for static objects [m]
    faces: wp.array2d[wp.int32]  # (triangle, corner)
    neighbors: wp.array2d[wp.int32]  # (triangle, k): triangle at the edge from corner k to the next; -1 for none
    first_face: wp.array[wp.int32]  # (object)
    columns: wp.array[wp.int32]  # (object): column in the object poses, -1 for static objects


@wp.struct
class Segment:
    """The rays of two neighboring pixels, and of a neighbor of the first one along the other axis of the image."""

    ray: wp.vec3d
    origin: wp.vec3d
    end_ray: wp.vec3d
    end_origin: wp.vec3d
    side_ray: wp.vec3d
    side_origin: wp.vec3d


@wp.struct
class Boundary:
    """A silhouette edge between the centers of two pixels."""

    is_found: bool
    alpha: wp.float64  # crossing of the segment, from 0 at its start
    depth: wp.float64  # depth of the crossing
    point: wp.vec3d  # its point of the edge, in the camera frame [m]
    force: wp.vec3d  # derivative of alpha with respect to the point, in the camera frame
    index: int  # the edge's object
    start: int  # vertices of the edge
    end: int
    weight: wp.float64  # of the end vertex at the crossing


@wp.func
def object_frame(surfaces: Surfaces, worlds: Worlds, view: int, index: int) -> Frame:
    """Return the pose of the frame of an object's vertices."""
    column = surfaces.columns[index]
    if column < 0:
        frame = Frame()
        frame.rotation = wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
        return frame
    return frame_of(worlds.object_poses[wp.max(world_of(worlds, view), 0), column])


@wp.func
def seen_vertex(surfaces: Surfaces, frame: Frame, camera: Frame, vertex: int) -> wp.vec3d:
    """Return a vertex in the camera frame."""
    world = frame.origin + wp.quat_rotate(frame.rotation, wp.vec3d(surfaces.vertices[vertex]))
    return wp.quat_rotate_inv(camera.rotation, world - camera.origin)


@wp.func
def seen_corner(surfaces: Surfaces, frame: Frame, camera: Frame, triangle: int, corner: int) -> wp.vec3d:
    """Return a corner of a triangle in the camera frame."""
    return seen_vertex(surfaces, frame, camera, surfaces.faces[triangle, corner])


@wp.func
def side_of(point: wp.vec3d, edge: wp.vec3d, ray: wp.vec3d, origin: wp.vec3d) -> wp.float64:
    """Return on which side a ray passes an edge, by its sign."""
    return wp.dot(origin - point, wp.cross(edge, ray))


@wp.func
def crossing(segment: Segment, point: wp.vec3d, edge: wp.vec3d, alpha: wp.float64) -> Boundary:
    """Return the boundary at an edge through a point, which crosses a segment at `alpha`."""
    result = Boundary()
    result.alpha = alpha
    ray = segment.ray + alpha * (segment.end_ray - segment.ray)
    origin = segment.origin + alpha * (segment.end_origin - segment.origin)
    across = wp.cross(edge, ray)
    length = wp.dot(across, across)
    if length > wp.float64(0.0):
        weight = wp.dot(wp.cross(origin - point, ray), across) / length
        result.weight = wp.clamp(weight, wp.float64(0.0), wp.float64(1.0))
    result.point = point + result.weight * edge
    result.depth = wp.dot(result.point - origin, ray) / wp.dot(ray, ray)
    start = side_of(point, edge, segment.ray, segment.origin)
    end = side_of(point, edge, segment.end_ray, segment.end_origin)
    result.force = across / (end - start)
    return result


@wp.func
def find_edge(
    surfaces: Surfaces, worlds: Worlds, camera: Frame, segment: Segment, view: int, index: int, face: int
) -> Boundary:
    """Walk from a seen triangle along a segment to the first silhouette edge, if there is one before its end."""
    frame = object_frame(surfaces, worlds, view, index)
    triangle = int(surfaces.first_face[index] + face)
    alpha = wp.float64(0.0)
    zero = wp.float64(0.0)
    for step in range(MAX_TRIANGLES):
        ray = segment.ray + alpha * (segment.end_ray - segment.ray)
        exit_edge = int(-1)
        exit_alpha = wp.float64(2.0)
        for k in range(3):
            point = seen_corner(surfaces, frame, camera, triangle, k)
            edge = seen_corner(surfaces, frame, camera, triangle, (k + 1) % 3) - point
            opposite = seen_corner(surfaces, frame, camera, triangle, (k + 2) % 3) - point
            inside = wp.dot(opposite, wp.cross(edge, ray))
            start = side_of(point, edge, segment.ray, segment.origin)
            end = side_of(point, edge, segment.end_ray, segment.end_origin)
            # The first center is in the first triangle up to the rounding of the caster.
            if end * inside < zero and (start * inside > zero or step == 0):
                reached = wp.max(start / (start - end), zero)
                if reached < exit_alpha:
                    exit_alpha, exit_edge = reached, k
        if exit_edge < 0 or exit_alpha > wp.float64(1.0):
            return Boundary()
        alpha = exit_alpha
        corner = seen_corner(surfaces, frame, camera, triangle, exit_edge)
        side = seen_corner(surfaces, frame, camera, triangle, (exit_edge + 1) % 3) - corner
        across = wp.cross(side, segment.ray + alpha * (segment.end_ray - segment.ray))
        own = seen_corner(surfaces, frame, camera, triangle, (exit_edge + 2) % 3) - corner
        neighbor = int(surfaces.neighbors[triangle, exit_edge])
        is_silhouette = bool(neighbor < 0)
        if neighbor >= 0:
            # The farthest of its corners from the edge is the one opposite to it.
            farthest = wp.float64(0.0)
            for k in range(3):
                other = seen_corner(surfaces, frame, camera, neighbor, k) - corner
                distance = wp.length_sq(wp.cross(other, side))
                if distance > farthest:
                    farthest = distance
                    is_silhouette = wp.dot(other, across) * wp.dot(own, across) > zero
        if is_silhouette:
            result = crossing(segment, corner, side, alpha)
            result.is_found = True
            result.index = index
            result.start = surfaces.faces[triangle, exit_edge]
            result.end = surfaces.faces[triangle, (exit_edge + 1) % 3]
            return result
        triangle = neighbor
    return Boundary()


@wp.func
def is_across(segment: Segment, boundary: Boundary, edge: wp.vec3d, is_row: bool) -> bool:
    """Return whether an edge changes sides more along a segment than along the other axis; rows win ties."""
    start = side_of(boundary.point, edge, segment.ray, segment.origin)
    along = wp.abs(side_of(boundary.point, edge, segment.end_ray, segment.end_origin) - start)
    sideways = wp.abs(side_of(boundary.point, edge, segment.side_ray, segment.side_origin) - start)
    if is_row:
        return along >= sideways
    return along > sideways


@wp.func
def is_target(targets: wp.array[wp.uint8], images: Images, view: int, y: int, x: int) -> bool:
    """Return whether a pixel sees a chosen object."""
    index = images.segmentation[view, y, x]
    return index >= 0 and targets[wp.max(index, 0)] != wp.uint8(0)


@wp.func
def has_boundary(targets: wp.array[wp.uint8], images: Images, view: int, y: int, x: int, is_row: bool) -> bool:
    """Return whether either a pixel or the next one of its row or column sees a chosen object."""
    end_y, end_x = wp.where(is_row, y, y + 1), wp.where(is_row, x + 1, x)
    if end_y >= images.segmentation.shape[1] or end_x >= images.segmentation.shape[2]:
        return False
    # Neighbors mostly see the same object.
    if images.segmentation[view, y, x] == images.segmentation[view, end_y, end_x]:
        return False
    return is_target(targets, images, view, y, x) != is_target(targets, images, view, end_y, end_x)


@wp.func
def segment_between(table: RayTable, y: int, x: int, end_y: int, end_x: int) -> Segment:
    """Return the segment from a pixel to a neighbor."""
    result = Segment()
    result.ray = table.rays[y, x]
    result.origin = ray_origin(table, y, x)
    result.end_ray = table.rays[end_y, end_x]
    result.end_origin = ray_origin(table, end_y, end_x)
    side_y, side_x = int(y), int(x)
    if y == end_y:
        side_y = wp.where(y + 1 < table.rays.shape[0], y + 1, wp.max(y - 1, 0))
    else:
        side_x = wp.where(x + 1 < table.rays.shape[1], x + 1, wp.max(x - 1, 0))
    result.side_ray = table.rays[side_y, side_x]
    result.side_origin = ray_origin(table, side_y, side_x)
    return result


@wp.func
def boundary_from(
    surfaces: Surfaces,
    worlds: Worlds,
    table: RayTable,
    camera: Frame,
    images: Images,
    view: int,
    y: int,
    x: int,
    end_y: int,
    end_x: int,
) -> Boundary:
    """Return the silhouette edge of the surface that a pixel sees, towards a neighbor."""
    index, face = images.segmentation[view, y, x], images.faces[view, y, x]
    end_ray = table.rays[end_y, end_x]
    if index < 0 or face < 0 or not wp.isfinite(end_ray[0] + end_ray[1] + end_ray[2]):
        return Boundary()
    segment = segment_between(table, y, x, end_y, end_x)
    result = find_edge(surfaces, worlds, camera, segment, view, index, face)
    if result.is_found:
        frame = object_frame(surfaces, worlds, view, index)
        start = seen_vertex(surfaces, frame, camera, result.start)
        edge = seen_vertex(surfaces, frame, camera, result.end) - start
        result.is_found = is_across(segment, result, edge, y == end_y)
    return result


@wp.func
def boundary_between(
    surfaces: Surfaces,
    worlds: Worlds,
    targets: wp.array[wp.uint8],
    table: RayTable,
    camera: Frame,
    images: Images,
    view: int,
    y: int,
    x: int,
    is_row: bool,
) -> Boundary:
    """Return the edge between a pixel and the next one of its row or column, if only one of them sees a chosen object.

    Its `alpha` is measured from the center of that pixel.
    """
    end_y, end_x = wp.where(is_row, y, y + 1), wp.where(is_row, x + 1, x)
    is_inside = is_target(targets, images, view, y, x)
    result = boundary_from(surfaces, worlds, table, camera, images, view, y, x, end_y, end_x)
    other = boundary_from(surfaces, worlds, table, camera, images, view, end_y, end_x, y, x)
    if other.is_found and (not result.is_found or other.depth < result.depth):
        result = other
        result.alpha = wp.float64(1.0) - other.alpha
        result.force = -other.force
    if result.is_found and not is_inside:
        result.alpha = wp.float64(1.0) - result.alpha
        result.force = -result.force
    return result
