# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Consistent visibility of coinciding surfaces: the last object is shown, as if objects were painted in order.

Casters show whichever object is nearer by rounding. This pass corrects their output: it tests whether the visible point
is on the surface of objects that are known to coincide with the visible object somewhere.
"""

import warp as wp

from warpvis.kernels.casting.solids import to_shape
from warpvis.kernels.casting.triangle_scene import stretched_corner
from warpvis.kernels.casting.worlds import Worlds, is_excluded, world_of
from warpvis.kernels.constants import SOLID_BALL, SOLID_CYLINDER
from warpvis.kernels.pinhole import PinholeCamera, pixel_ray, pose_origin, pose_rotation

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

CLOSENESS = wp.constant(wp.float64(4.0e-6))
"""Tolerance for a visible point on a surface, relative to its distances from the camera and the world's origin.

The relative rounding error of single precision is 6e-8: depth, positions and vertices have that error, quaternions
several times it, and a caster's 1 / z up to 1e-6. All resulting errors grow with those two distances.
"""


# How to test for a pair's later object where its earlier one is visible.
ALWAYS = wp.constant(0)  # identical shapes that move together: no test
WHERE_TOGETHER = wp.constant(1)  # identical shapes: compare their poses
ON_MESH = wp.constant(2)
ON_SOLID = wp.constant(3)


@wp.struct
class Coinciding:
    """Pairs of an earlier and a later object whose surfaces coincide somewhere, and the later objects' shapes."""

    first_pair: wp.array[wp.int32]
    """(object + 1): offsets of the pairs in which the object is the earlier one."""
    later: wp.array[wp.int32]
    """(pair): the later object, in ascending order for each earlier object."""
    mode: wp.array[wp.int32]
    """(pair): the test for the later object."""
    low: wp.array[wp.vec3]
    """(pair): lower corner of the box in which both coincide, in the later object's frame [m]."""
    high: wp.array[wp.vec3]
    surface: wp.array[wp.uint64]
    """(object): mesh of the triangles that coincide with any earlier object, in its frame; 0 for none."""
    first_face: wp.array[wp.int32]
    """(object): offset of the triangles of `surface` in `face`."""
    face: wp.array[wp.int32]
    """Indices of triangles in the complete mesh of their object."""
    column: wp.array[wp.int32]
    """(object): index of the movable object that it is or moves with; -1 for static objects."""
    solid: wp.array[wp.int32]
    """(object): a `warpvis.scene.solids.SolidKind`."""
    size: wp.array[wp.vec4]
    """(object): for a solid, factors along x, y and z [m], and half length before scaling."""
    label: wp.array[wp.uint8]
    """(object): its label."""


@wp.func
def pose_of(coinciding: Coinciding, worlds: Worlds, world: int, index: int) -> wp.transform:
    """Return the transform from an object to the world."""
    if coinciding.column[index] < 0:
        return wp.transform_identity()
    return worlds.object_poses[world, coinciding.column[index]]


@wp.func
def size_in(coinciding: Coinciding, worlds: Worlds, world: int, index: int) -> wp.vec4:
    """Return an object's size in a world; for a mesh, scale factors along its axes."""
    if worlds.object_sizes and coinciding.column[index] >= 0:
        return worlds.object_sizes[world, coinciding.column[index]]
    return coinciding.size[index]


@wp.func
def are_together(a: wp.transform, b: wp.transform, reach: wp.float64) -> bool:
    """Return whether two poses of the same shape are equal within tolerance."""
    if wp.length(pose_origin(a) - pose_origin(b)) > reach:
        return False
    p, q = pose_rotation(a), pose_rotation(b)
    return wp.float64(1.0) - wp.abs(wp.dot(p, q)) < CLOSENESS * CLOSENESS


@wp.func
def beyond_solid(kind: int, half: wp.float64, p: wp.vec3d) -> wp.float64:
    """Return the signed distance of a point from a solid's surface in its shape frame; negative inside."""
    zero, one = wp.float64(0.0), wp.float64(1.0)
    across = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    along = wp.abs(p[2]) - half
    if kind == SOLID_CYLINDER:
        return wp.max(across - one, along)
    along = wp.max(along, zero)
    return wp.sqrt(across * across + along * along) - one


@wp.func
def slope_of_solid(kind: int, half: wp.float64, p: wp.vec3d) -> wp.vec3d:
    """Return the gradient direction of `beyond_solid`, a unit vector of the shape frame."""
    zero, one = wp.float64(0.0), wp.float64(1.0)
    along = wp.sign(p[2]) * wp.max(wp.abs(p[2]) - half, zero)
    if kind == SOLID_BALL:
        along = p[2]
    if kind == SOLID_CYLINDER:
        along = zero
        if wp.abs(p[2]) - half > wp.sqrt(p[0] * p[0] + p[1] * p[1]) - one:
            return wp.vec3d(zero, zero, wp.sign(p[2]))
    return wp.normalize(wp.vec3d(p[0], p[1], along))


@wp.func
def is_on_solid(kind: int, size: wp.vec4, p: wp.vec3d, direction: wp.vec3d, reach: wp.float64, cull: bool) -> bool:
    """Return whether a point of an object's frame is on a solid's surface, on the side that faces the ray."""
    half = wp.float64(size[3])
    shape_point = to_shape(p, size)
    outwards = to_shape(slope_of_solid(kind, half, shape_point), size)
    if cull and wp.dot(outwards, direction) >= wp.float64(0.0):
        return False
    return wp.abs(beyond_solid(kind, half, shape_point)) <= reach * wp.length(outwards)


@wp.func
def is_on_triangle(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, direction: wp.vec3d, reach: wp.float64, cull: bool) -> bool:
    """Return whether a triangle, with corners relative to a point, contains the point on the side facing the ray."""
    normal = wp.cross(b - a, c - a)
    if cull and wp.dot(normal, direction) >= wp.float64(0.0):
        return False
    max_volume = reach * wp.length(normal)
    if wp.abs(wp.dot(normal, a)) > max_volume:
        return False
    within_ab = wp.dot(normal, wp.cross(a, b)) >= -max_volume * wp.length(b - a)
    within_bc = wp.dot(normal, wp.cross(b, c)) >= -max_volume * wp.length(c - b)
    within_ca = wp.dot(normal, wp.cross(c, a)) >= -max_volume * wp.length(a - c)
    return within_ab and within_bc and within_ca


@wp.func
def face_of_mesh(
    mesh: wp.uint64, factors: wp.vec3d, p: wp.vec3d, direction: wp.vec3d, reach: wp.float64, cull: bool
) -> int:
    """Return the triangle of a scaled mesh that contains a point, or -1."""
    side = reach + CLOSENESS * wp.length(p)  # the box is rounded to single precision
    sides = wp.vec3d(side, side, side)
    low, high = wp.cw_div(p - sides, factors), wp.cw_div(p + sides, factors)
    query = wp.mesh_query_aabb(mesh, wp.vec3(low), wp.vec3(high))
    face = int(0)
    while wp.mesh_query_next(query, face):
        a = stretched_corner(mesh, face, 0, factors) - p
        b = stretched_corner(mesh, face, 1, factors) - p
        c = stretched_corner(mesh, face, 2, factors) - p
        if is_on_triangle(a, b, c, direction, reach, cull):
            return face
    return -1


@wp.func
def is_in_box(p: wp.vec3d, low: wp.vec3, high: wp.vec3, reach: wp.float64) -> bool:
    for axis in range(3):
        if p[axis] < wp.float64(low[axis]) - reach or p[axis] > wp.float64(high[axis]) + reach:
            return False
    return True


@wp.func
def last_coinciding(
    coinciding: Coinciding,
    worlds: Worlds,
    view: int,
    seen: wp.vec2i,
    origin: wp.vec3d,
    ray: wp.vec3d,
    depth: wp.float64,
    cull: bool,
) -> wp.vec2i:
    """Return the last object whose surface contains the visible point of a ray of the world, and its triangle.

    `seen` contains the visible object and its triangle, which is -1 for solids or if faces are not rendered.
    """
    world = int(0)
    if worlds.object_poses:
        world = world_of(worlds, view)
    path = depth * ray
    point = origin + path
    reach = CLOSENESS * (wp.length(path) + wp.length(point))
    last, first = coinciding.first_pair[seen[0] + 1], coinciding.first_pair[seen[0]]
    for k in range(last - first):
        pair = last - 1 - k
        later, mode = coinciding.later[pair], coinciding.mode[pair]
        if is_excluded(worlds, view, later):
            continue
        if mode == ALWAYS:
            return wp.vec2i(later, seen[1])
        pose = pose_of(coinciding, worlds, world, later)
        if mode == WHERE_TOGETHER:
            if are_together(pose_of(coinciding, worlds, world, seen[0]), pose, reach):
                return wp.vec2i(later, seen[1])
            continue
        p = wp.quat_rotate_inv(pose_rotation(pose), point - pose_origin(pose))
        if not is_in_box(p, coinciding.low[pair], coinciding.high[pair], reach):
            continue
        direction = wp.quat_rotate_inv(pose_rotation(pose), ray)
        size = size_in(coinciding, worlds, world, later)
        if mode == ON_SOLID:
            if is_on_solid(coinciding.solid[later], size, p, direction, reach, cull):
                return wp.vec2i(later, -1)
        else:
            factors = wp.vec3d(wp.float64(size[0]), wp.float64(size[1]), wp.float64(size[2]))
            face = face_of_mesh(coinciding.surface[later], factors, p, direction, reach, cull)
            if face >= 0:
                return wp.vec2i(later, coinciding.face[coinciding.first_face[later] + face])
    return seen


@wp.func
def seen_in(segmentation: wp.array3d[wp.int32], faces: wp.array3d[wp.int32], view: int, y: int, x: int) -> wp.vec2i:
    """Return the object and the triangle of a pixel; the triangle is -1 if faces are not rendered."""
    face = int(-1)
    if faces:
        face = faces[view, y, x]
    return wp.vec2i(segmentation[view, y, x], face)


@wp.func
def show_last(
    coinciding: Coinciding,
    camera: PinholeCamera,
    pose: wp.transform,
    worlds: Worlds,
    view: int,
    y: int,
    x: int,
    depth: wp.array3d[float],
    cull_backfaces: bool,
    segmentation_out: wp.array3d[wp.int32],
    labels_out: wp.array3d[wp.uint8],
    faces_out: wp.array3d[wp.int32],
):
    """Replace the visible object of a pixel by the last object whose surface coincides there."""
    seen = seen_in(segmentation_out, faces_out, view, y, x)
    if seen[0] < 0 or coinciding.first_pair[seen[0] + 1] <= coinciding.first_pair[seen[0]]:
        return
    last = coinciding.first_pair[seen[0] + 1] - 1
    shown = wp.vec2i(coinciding.later[last], seen[1])
    if coinciding.mode[last] != ALWAYS or is_excluded(worlds, view, shown[0]):
        origin, ray = pose_origin(pose), wp.quat_rotate(pose_rotation(pose), pixel_ray(camera, y, x))
        seen_depth = wp.float64(depth[view, y, x])
        shown = last_coinciding(coinciding, worlds, view, seen, origin, ray, seen_depth, cull_backfaces)
    if shown[0] != seen[0]:
        segmentation_out[view, y, x] = shown[0]
        if labels_out:
            labels_out[view, y, x] = coinciding.label[shown[0]]
        if faces_out:
            faces_out[view, y, x] = shown[1]


@wp.kernel(cuda_max_registers=64)  # most threads need none of what would take more
def show_later(
    # Scene:
    coinciding: Coinciding,
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    # In:
    worlds: Worlds,
    depth: wp.array3d[float],
    cull_backfaces: bool,
    # Out:
    segmentation_out: wp.array3d[wp.int32],
    labels_out: wp.array3d[wp.uint8],
    faces_out: wp.array3d[wp.int32],
):
    """Replace each visible object by the last object whose surface coincides there and that the view does not exclude.

    For GPUs; `coinciding_rows.show_later_rows` does the same on CPU cores.
    """
    view, y, x = wp.tid()
    show_last(
        coinciding,
        camera,
        camera_to_world[view],
        worlds,
        view,
        y,
        x,
        depth,
        cull_backfaces,
        segmentation_out,
        labels_out,
        faces_out,
    )
