# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The scene of ray casters: Warp meshes, the objects of their triangles, and hits of one mesh or solid.

Meshes of movable objects and instances are in their own frame, and the camera is transformed into it. Corners are
converted to double precision, because single precision is off by up to 1 mm where a large triangle is seen at a
grazing angle.
"""

import warp as wp

from warpvis.kernels.casting.solids import SolidHit, is_outside, meet_solid, stretch_of, to_shape
from warpvis.kernels.casting.worlds import Worlds, is_excluded
from warpvis.kernels.pinhole import Frame

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

CLOSE = wp.constant(1.0e-3)
"""Hits nearer than this are tested for triangles that are edge-on to the camera [m]."""

PASSING = wp.constant(1.0e-6)
"""Step past a skipped hit, as a fraction of its depth or of 1 m, whichever is greater."""

FLOAT_STEPS = wp.constant(2.4e-7)
"""Relative error of four roundings to single precision."""


@wp.struct
class InstanceStep:
    """A node of a BVH of instance boxes in depth-first order; see `instance_steps` of the scene."""

    low: wp.vec3  # of the box, in the world
    high: wp.vec3
    after: int  # next step if the box is missed
    instance: int  # the box's instance, -1 for an inner node
    pose: wp.transform  # object to world, of the instance with this step's index


@wp.struct
class TriangleScene:
    """Triangles in the world frame and their objects, the meshes of movable objects, and the labels of all objects."""

    mesh: wp.uint64  # 0 without static geometry
    triangle_object: wp.array[wp.int32]  # of static triangles, then of each mesh that contains several objects
    triangle_face: wp.array[wp.int32]  # like triangle_object: face index in the object's mesh; None until needed
    movable_mesh: wp.array[wp.uint64]
    movable_object: wp.array[wp.int32]  # -1 if the mesh contains several objects
    movable_first_face: wp.array[wp.int32]  # offset in triangle_object if the mesh contains several objects
    movable_count: int
    movable_solid: wp.array[wp.int32]  # a `warpvis.scene.solids.SolidKind`
    movable_size: wp.array[wp.vec4]  # of a solid: factors along x, y and z [m], and half length before scaling
    object_label: wp.array[wp.uint8]
    instance_count: int  # of static instances; their meshes come after those of movable objects
    instances: wp.uint64  # address of the first `InstanceStep`: an array would be copied for each ray


@wp.struct
class Hit:
    """The hit of a ray on a mesh."""

    result: bool
    t: float  # distance along the ray in units of the length of its direction
    face: int


@wp.func
def steps_of(scene: TriangleScene) -> wp.array[InstanceStep]:
    return wp.array(ptr=scene.instances, shape=(scene.instance_count,), dtype=InstanceStep)


@wp.func
def pose_in(scene: TriangleScene, worlds: Worlds, world: int, movable: int) -> wp.transform:
    """Return the pose of a movable object or an instance in a world; instances have one pose in all worlds."""
    if movable >= scene.movable_count:
        return steps_of(scene)[movable - scene.movable_count].pose
    return worlds.object_poses[world, movable]


@wp.func
def size_of(scene: TriangleScene, worlds: Worlds, world: int, movable: int) -> wp.vec4:
    """Return a movable object's size in a world: for a solid its dimensions, for a mesh its scale factors."""
    if worlds.object_sizes:
        return worlds.object_sizes[world, movable]
    return scene.movable_size[movable]


@wp.func
def factors_of(scene: TriangleScene, worlds: Worlds, world: int, movable: int) -> wp.vec3d:
    """Return the scale factors of an object's triangles along its axes; ones for static geometry (-1)."""
    one = wp.float64(1.0)
    if movable < 0 or movable >= scene.movable_count or not worlds.object_sizes:
        return wp.vec3d(one, one, one)
    original, current = scene.movable_size[movable], worlds.object_sizes[world, movable]
    return stretch_of(scene.movable_solid[movable], original, current)


@wp.func
def mesh_of(scene: TriangleScene, movable: int) -> wp.uint64:
    """Return a movable object's mesh, or the mesh of static geometry (-1)."""
    if movable < 0:
        return scene.mesh
    return scene.movable_mesh[movable]


@wp.func
def object_of(scene: TriangleScene, movable: int, face: int) -> int:
    """Return the object of a triangle of a movable object's mesh, or of static geometry (-1)."""
    if movable < 0:
        return scene.triangle_object[face]
    if scene.movable_object[movable] >= 0:
        return scene.movable_object[movable]
    return scene.triangle_object[scene.movable_first_face[movable] + face]


@wp.func
def face_of(scene: TriangleScene, movable: int, face: int) -> int:
    """Return a triangle's index in the mesh of its object, given its index in a movable or the static (-1) mesh.

    The result is -1 for solids and for face -1.
    """
    if face < 0:
        return -1
    if movable < 0:
        return scene.triangle_face[face]
    if scene.movable_solid[movable] != 0:
        return -1
    if scene.movable_object[movable] >= 0:
        return face
    return scene.triangle_face[scene.movable_first_face[movable] + face]


@wp.func
def corner(mesh: wp.uint64, triangle: int, k: int) -> wp.vec3d:
    return wp.vec3d(wp.mesh_get_point(mesh, triangle * 3 + k))


@wp.func
def stretched_corner(mesh: wp.uint64, triangle: int, k: int, factors: wp.vec3d) -> wp.vec3d:
    """Return a corner of an object that is scaled along its axes."""
    return wp.cw_mul(corner(mesh, triangle, k), factors)


@wp.func
def plane_depth(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, direction: wp.vec3d, forward: wp.vec3d) -> wp.float64:
    """Return the depth along `forward` where a ray from the origin, of depth 1, hits a triangle's plane.

    The ray is known to hit the triangle, so depth is clamped to the range of the corners' depths, which bounds the
    quotient for triangles seen edge-on.
    """
    normal = wp.cross(b - a, c - a)
    za, zb, zc = wp.dot(a, forward), wp.dot(b, forward), wp.dot(c, forward)
    nearest = wp.min(za, wp.min(zb, zc))
    farthest = wp.max(za, wp.max(zb, zc))
    steepness = wp.dot(normal, direction)
    if steepness == wp.float64(0.0):
        return nearest
    return wp.clamp(wp.dot(normal, a) / steepness, nearest, farthest)


@wp.func
def normal_of(mesh: wp.uint64, face: int, factors: wp.vec3d, direction: wp.vec3d) -> wp.vec3d:
    """Return the unit normal of a scaled triangle, opposed to the viewing direction."""
    a = stretched_corner(mesh, face, 0, factors)
    facing = wp.cross(stretched_corner(mesh, face, 1, factors) - a, stretched_corner(mesh, face, 2, factors) - a)
    if wp.dot(facing, direction) > wp.float64(0.0):
        facing = -facing
    return wp.normalize(facing)


@wp.func
def seen_from(camera: Frame, viewer: Frame) -> Frame:
    """Transform a camera into the frame of an object."""
    inverse = wp.quat_inverse(viewer.rotation)
    frame = Frame()
    frame.origin = wp.quat_rotate(inverse, camera.origin - viewer.origin)
    frame.rotation = inverse * camera.rotation
    return frame


@wp.func
def is_edge_on(mesh: wp.uint64, face: int, eye: wp.vec3) -> bool:
    """Return whether a point is in the plane of a triangle, which covers nothing when seen from there."""
    a = corner(mesh, face, 0) - wp.vec3d(eye)
    b = corner(mesh, face, 1) - wp.vec3d(eye)
    c = corner(mesh, face, 2) - wp.vec3d(eye)
    return wp.dot(wp.cross(b - a, c - a), a) == wp.float64(0.0)


@wp.func
def passes(
    scene: TriangleScene,
    worlds: Worlds,
    view: int,
    movable: int,
    eye: wp.vec3,
    t: float,
    face: int,
    direction: wp.vec3,
    cull: bool,
) -> bool:
    """Return whether a ray ignores a hit: the camera is in the triangle's plane, the triangle is a culled back face,
    or its object is excluded in the view.
    """
    if t < CLOSE and is_edge_on(mesh_of(scene, movable), face, eye):
        return True
    if cull and wp.dot(wp.mesh_eval_face_normal(mesh_of(scene, movable), face), direction) >= 0.0:
        return True
    return is_excluded(worlds, view, object_of(scene, movable, face))


@wp.func
def meets(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, direction: wp.vec3d) -> bool:
    """Return whether a ray from the origin hits a triangle from either side, edges included (watertight).

    Triangles that share an edge compute the same edge function for it, except for its sign.
    """
    zero = wp.float64(0.0)
    u, v, w = wp.dot(direction, wp.cross(b, c)), wp.dot(direction, wp.cross(c, a)), wp.dot(direction, wp.cross(a, b))
    within = (u >= zero and v >= zero and w >= zero) or (u <= zero and v <= zero and w <= zero)
    return within and u + v + w != zero


@wp.func
def coincident_hit(
    scene: TriangleScene,
    worlds: Worlds,
    view: int,
    movable: int,
    origin: wp.vec3,
    direction: wp.vec3,
    min_t: float,
    max_t: float,
    cull: bool,
) -> Hit:
    """Return the first valid hit in the narrow range around a skipped one, among triangles that coincide with it."""
    mesh = mesh_of(scene, movable)
    found = Hit()
    found.t = max_t
    center = origin + 0.5 * (min_t + max_t) * direction
    reach = 0.5 * (max_t - min_t) * wp.length(direction) + FLOAT_STEPS * (wp.length(origin) + wp.length(center))
    side = wp.vec3(reach, reach, reach)
    query = wp.mesh_query_aabb(mesh, center - side, center + side)
    eye, ray = wp.vec3d(origin), wp.vec3d(direction)
    face = int(0)
    while wp.mesh_query_aabb_next(query, face):
        a, b, c = corner(mesh, face, 0) - eye, corner(mesh, face, 1) - eye, corner(mesh, face, 2) - eye
        if meets(a, b, c, ray):
            normal = wp.cross(b - a, c - a)
            t = float(wp.dot(normal, a) / wp.dot(normal, ray))
            if t >= min_t and t <= found.t:
                if not passes(scene, worlds, view, movable, origin, t, face, direction, cull):
                    found.result = True
                    found.t = t
                    found.face = face
    return found


@wp.func
def first_hit(
    scene: TriangleScene,
    worlds: Worlds,
    view: int,
    movable: int,
    origin: wp.vec3,
    direction: wp.vec3,
    min_t: float,
    max_t: float,
    cull: bool,
) -> Hit:
    """Return the first valid hit; its t is the depth. The ray continues just behind every hit that it ignores.

    That step would also skip triangles that coincide with an ignored one, so they are tested separately.
    """
    mesh = mesh_of(scene, movable)
    passed = float(min_t)
    hit = wp.mesh_query_ray(mesh, origin + passed * direction, direction, max_t - passed)
    if cull or worlds.excluded or hit.t < CLOSE:
        while hit.result and passes(scene, worlds, view, movable, origin, hit.t + passed, hit.face, direction, cull):
            t = passed + wp.max(hit.t, 0.0)
            step = PASSING * wp.max(1.0, t)
            coincident = coincident_hit(
                scene,
                worlds,
                view,
                movable,
                origin,
                direction,
                wp.max(t - step, min_t),
                wp.min(t + step, max_t),
                cull,
            )
            if coincident.result:
                return coincident
            passed = t + step
            hit = wp.mesh_query_ray(mesh, origin + passed * direction, direction, max_t - passed)
    found = Hit()
    found.result = hit.result
    found.t = hit.t + passed
    found.face = hit.face
    return found


@wp.func
def shows_solid(kind: int, size: wp.vec4, origin: wp.vec3d) -> bool:
    """Return whether a camera sees an object's true surface, which it does for solids from outside."""
    return kind != 0 and is_outside(kind, wp.float64(size[3]), to_shape(origin, size))


@wp.func
def solid_hit(kind: int, size: wp.vec4, frame: Frame, ray: wp.vec3d) -> SolidHit:
    """Intersect a ray with a solid's surface."""
    direction = to_shape(wp.quat_rotate(frame.rotation, ray), size)
    return meet_solid(kind, wp.float64(size[3]), to_shape(frame.origin, size), direction)


@wp.func
def inverse_of(direction: float) -> float:
    """Return 1 / a direction's component; for a zero component a large finite number, so that 0 times it is 0."""
    return 1.0 / wp.where(wp.abs(direction) < 1.0e-18, 1.0e-18, direction)


@wp.func
def inverses_of(direction: wp.vec3d) -> wp.vec3:
    return wp.vec3(inverse_of(float(direction[0])), inverse_of(float(direction[1])), inverse_of(float(direction[2])))


@wp.func
def meets_box(low: wp.vec3, high: wp.vec3, eye: wp.vec3, inverse: wp.vec3, max_t: float) -> bool:
    """Return whether a ray may hit a box, enlarged by a tolerance, before `max_t`."""
    a, b = wp.cw_mul(low - eye, inverse), wp.cw_mul(high - eye, inverse)
    enter, leave = wp.min(a, b), wp.max(a, b)
    begin = wp.max(enter[0], wp.max(enter[1], enter[2]))
    end = wp.min(leave[0], wp.min(leave[1], leave[2]))
    reach = 1.0e-5 * wp.abs(end)
    return end >= 0.0 and begin <= end + reach and begin <= max_t + 1.0e-5 * wp.abs(max_t)


@wp.func
def next_instance(steps: wp.array[InstanceStep], step: int, eye: wp.vec3, inverse: wp.vec3, max_t: float) -> int:
    """Return the next step, from `step` on, at which a ray hits the box of an instance; -1 at the end."""
    current = int(step)
    found = int(-1)
    while found < 0 and current < steps.shape[0]:
        if meets_box(steps[current].low, steps[current].high, eye, inverse, max_t):
            if steps[current].instance >= 0:
                found = current
            current += 1
        else:
            current = steps[current].after
    return found
