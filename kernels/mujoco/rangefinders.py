# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's rangefinder sensors: the hits of a model's sensor rays in every world, as computed by `mj_ray`.

Surfaces are two-sided, except planes, which are hit only from above; a ray that starts inside a shape hits it from
inside. A ray is inside a convex shape along one interval: round shapes are intersections of the unit ball or the tube
of radius 1 in their shape frame (`kernels.casting.solids`), and boxes are intersections of three slabs. A mesh query
finds the triangle of a mesh or a height field; the point of intersection is computed in double precision, as is
everything else. The rules for which geoms and surfaces count, and the output of each ray, follow
src/engine/engine_ray.c and engine_sensor.c of MuJoCo.
"""

import warp as wp

from warpvis.kernels.casting.solids import to_shape
from warpvis.kernels.casting.triangle_scene import corner, plane_depth
from warpvis.kernels.pinhole import Window

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

# Values of mujoco.mjtGeom.
PLANE, SPHERE, CAPSULE, ELLIPSOID = wp.constant(0), wp.constant(2), wp.constant(3), wp.constant(4)
CYLINDER, BOX = wp.constant(5), wp.constant(6)
# Bits of the data fields, by mujoco.mjtRayDataField.
DISTANCE, DIRECTION, ORIGIN = wp.constant(1), wp.constant(2), wp.constant(4)
POINT, NORMAL, DEPTH = wp.constant(8), wp.constant(16), wp.constant(32)

FLAT = wp.constant(wp.float64(1.0e-15))
"""Directions with a smaller component along a surface's normal are parallel to it (`mjMINVAL`)."""
FARTHEST = wp.constant(wp.float64(1.0e30))
"""Distance beyond all geometry [m]."""


@wp.struct
class RayGeoms:
    """The geoms that rays can hit."""

    geom: wp.array[wp.int32]
    body: wp.array[wp.int32]
    kind: wp.array[wp.int32]  # a mujoco.mjtGeom
    size: wp.array[
        wp.vec4
    ]  # half sizes of planes and boxes [m]; for round shapes as in `warpvis.kernels.casting.solids`
    mesh: wp.array[wp.uint64]  # 0 except for meshes and height fields
    bound: wp.array[wp.float64]  # radius of the geom's bounding sphere [m]; 0 if it is unbounded


@wp.struct
class SensorRays:
    """The rays of a model's sensors, and the layout of their output."""

    site: wp.array[wp.int32]  # -1 for rays of a camera
    camera: wp.array[wp.int32]
    body: wp.array[wp.int32]  # whose geoms the ray ignores
    origin: wp.array[wp.vec3d]  # in the frame of the site or camera
    direction: wp.array[wp.vec3d]
    fields: wp.array[wp.int32]  # bits of the fields to write
    column: wp.array[wp.int32]  # of the ray's first number
    low: wp.array[wp.float64]  # numbers are clamped to [low, high]
    high: wp.array[wp.float64]


@wp.struct
class Frame:
    """The pose of a geom, a site or a camera."""

    position: wp.vec3d
    rotation: wp.mat33  # to the world


@wp.struct
class Ray:
    """A ray with a direction of unit length."""

    origin: wp.vec3d
    direction: wp.vec3d


@wp.struct
class RayHit:
    """The hit of a ray: the distance, -1 for a miss, and the unit normal."""

    distance: wp.float64
    normal: wp.vec3d


@wp.struct
class Span:
    """The interval of a ray inside a convex shape; empty if `enter` is greater than `leave`."""

    enter: wp.float64
    leave: wp.float64
    enter_normal: wp.vec3d
    leave_normal: wp.vec3d


@wp.func
def rotate(rotation: wp.mat33, v: wp.vec3d) -> wp.vec3d:
    return wp.vec3d(
        wp.dot(wp.vec3d(rotation[0]), v), wp.dot(wp.vec3d(rotation[1]), v), wp.dot(wp.vec3d(rotation[2]), v)
    )


@wp.func
def rotate_inverse(rotation: wp.mat33, v: wp.vec3d) -> wp.vec3d:
    return wp.vec3d(rotation[0]) * v[0] + wp.vec3d(rotation[1]) * v[1] + wp.vec3d(rotation[2]) * v[2]


@wp.func
def no_span() -> Span:
    span = Span()
    span.enter = FARTHEST
    span.leave = -FARTHEST
    return span


@wp.func
def whole_span() -> Span:
    span = Span()
    span.enter = -FARTHEST
    span.leave = FARTHEST
    return span


@wp.func
def span_of_square(a: wp.float64, b: wp.float64, c: wp.float64) -> Span:
    """Return the interval where a t^2 + 2 b t + c <= 0."""
    discriminant = b * b - a * c
    if discriminant < wp.float64(0.0) or a < FLAT:
        return no_span()
    span = Span()
    span.enter = (-b - wp.sqrt(discriminant)) / a
    span.leave = (-b + wp.sqrt(discriminant)) / a
    return span


@wp.func
def span_of_ball(o: wp.vec3d, d: wp.vec3d) -> Span:
    """Return the interval inside the unit ball."""
    span = span_of_square(wp.dot(d, d), wp.dot(o, d), wp.dot(o, o) - wp.float64(1.0))
    span.enter_normal = o + span.enter * d
    span.leave_normal = o + span.leave * d
    return span


@wp.func
def span_of_tube(o: wp.vec3d, d: wp.vec3d) -> Span:
    """Return the interval inside the infinite tube of radius 1 about z."""
    across, along = wp.vec3d(o[0], o[1], wp.float64(0.0)), wp.vec3d(d[0], d[1], wp.float64(0.0))
    a, c = wp.dot(along, along), wp.dot(across, across) - wp.float64(1.0)
    if a < FLAT and c <= wp.float64(0.0):
        return whole_span()
    span = span_of_square(a, wp.dot(across, along), c)
    span.enter_normal = across + span.enter * along
    span.leave_normal = across + span.leave * along
    return span


@wp.func
def span_of_slab(o: wp.vec3d, d: wp.vec3d, axis: int, half: wp.float64) -> Span:
    """Return the interval inside a slab, which extends by `half` to both sides of the origin along an axis."""
    if wp.abs(d[axis]) <= FLAT:
        if wp.abs(o[axis]) <= half:
            return whole_span()
        return no_span()
    side = wp.sign(d[axis])
    span = Span()
    span.enter = (-side * half - o[axis]) / d[axis]
    span.leave = (side * half - o[axis]) / d[axis]
    outward = wp.vec3d()
    outward[axis] = side
    span.enter_normal = -outward
    span.leave_normal = outward
    return span


@wp.func
def overlap(a: Span, b: Span) -> Span:
    """Return the intersection of two intervals."""
    span = a
    if b.enter > a.enter:
        span.enter = b.enter
        span.enter_normal = b.enter_normal
    if b.leave < a.leave:
        span.leave = b.leave
        span.leave_normal = b.leave_normal
    return span


@wp.func
def united(a: Span, b: Span) -> Span:
    """Return the union of the intervals of two shapes whose union is convex."""
    if a.enter > a.leave:
        return b
    span = a
    if b.enter <= b.leave and b.enter < a.enter:
        span.enter = b.enter
        span.enter_normal = b.enter_normal
    if b.enter <= b.leave and b.leave > a.leave:
        span.leave = b.leave
        span.leave_normal = b.leave_normal
    return span


@wp.func
def span_of_box(o: wp.vec3d, d: wp.vec3d, size: wp.vec3d) -> Span:
    span = overlap(span_of_slab(o, d, 0, size[0]), span_of_slab(o, d, 1, size[1]))
    return overlap(span, span_of_slab(o, d, 2, size[2]))


@wp.func
def span_of_round(kind: int, o: wp.vec3d, d: wp.vec3d, half: wp.float64) -> Span:
    """Return the interval inside a round shape, in its shape frame."""
    if kind != CYLINDER and kind != CAPSULE:
        return span_of_ball(o, d)
    span = overlap(span_of_tube(o, d), span_of_slab(o, d, 2, half))
    if kind == CAPSULE:
        end = wp.vec3d(wp.float64(0.0), wp.float64(0.0), half)
        span = united(span, united(span_of_ball(o - end, d), span_of_ball(o + end, d)))
    return span


@wp.func
def no_hit() -> RayHit:
    hit = RayHit()
    hit.distance = wp.float64(-1.0)
    return hit


@wp.func
def surface_of(span: Span) -> RayHit:
    """Return the first boundary of an interval that is not behind the ray's origin."""
    hit = no_hit()
    if span.enter <= span.leave and span.leave >= wp.float64(0.0):
        hit.distance = span.leave
        hit.normal = span.leave_normal
        if span.enter >= wp.float64(0.0):
            hit.distance = span.enter
            hit.normal = span.enter_normal
    return hit


@wp.func
def meet_plane(o: wp.vec3d, d: wp.vec3d, size: wp.vec3d) -> RayHit:
    """Intersect a ray with a rectangle, seen from above, that is infinite along axes whose half size is 0."""
    hit = no_hit()
    if d[2] > -FLAT or o[2] < wp.float64(0.0):
        return hit
    point = o - o[2] / d[2] * d
    if size[0] > wp.float64(0.0) and wp.abs(point[0]) > size[0]:
        return hit
    if size[1] > wp.float64(0.0) and wp.abs(point[1]) > size[1]:
        return hit
    hit.distance = -o[2] / d[2]
    hit.normal = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    return hit


@wp.func
def meet_mesh(mesh: wp.uint64, o: wp.vec3d, d: wp.vec3d, farthest: wp.float64) -> RayHit:
    hit = no_hit()
    query = wp.mesh_query_ray(mesh, wp.vec3(o), wp.vec3(d), float(farthest))
    if query.result:
        a, b, c = corner(mesh, query.face, 0) - o, corner(mesh, query.face, 1) - o, corner(mesh, query.face, 2) - o
        hit.distance = wp.max(plane_depth(a, b, c, d, d), wp.float64(0.0))
        hit.normal = wp.normalize(wp.cross(b - a, c - a))
    return hit


@wp.func
def meet_geom(kind: int, size: wp.vec4, mesh: wp.uint64, ray: Ray, farthest: wp.float64) -> RayHit:
    """Intersect a ray of the geom's frame with the geom; mesh queries end at `farthest`."""
    half = wp.vec3d(wp.float64(size[0]), wp.float64(size[1]), wp.float64(size[2]))
    if mesh != wp.uint64(0):
        return meet_mesh(mesh, ray.origin, ray.direction, farthest)
    if kind == PLANE:
        return meet_plane(ray.origin, ray.direction, half)
    if kind == BOX:
        return surface_of(span_of_box(ray.origin, ray.direction, half))
    o, d = to_shape(ray.origin, size), to_shape(ray.direction, size)
    hit = surface_of(span_of_round(kind, o, d, wp.float64(size[3])))
    hit.normal = wp.normalize(to_shape(hit.normal, size))
    return hit


@wp.func
def may_meet(bound: wp.float64, toward: wp.vec3d, direction: wp.vec3d, nearest: wp.float64) -> bool:
    """Return whether a ray reaches a bounding sphere, centered at `toward` from its origin, before `nearest`."""
    if bound == wp.float64(0.0):
        return True
    along = wp.dot(toward, direction)
    if along + bound < wp.float64(0.0) or along - bound > nearest:
        return False
    return wp.dot(toward, toward) - along * along <= bound * bound


@wp.func
def nearer_hit(
    geoms: RayGeoms,
    geom_xpos: wp.array2d[wp.vec3],
    geom_xmat: wp.array2d[wp.mat33],
    world: int,
    index: int,
    ray: Ray,
    nearest: RayHit,
) -> RayHit:
    """Return the hit of a ray and a geom if it is nearer than `nearest`, else `nearest`."""
    geom = geoms.geom[index]
    toward = wp.vec3d(geom_xpos[world, geom]) - ray.origin
    result = nearest
    if may_meet(geoms.bound[index], toward, ray.direction, nearest.distance):
        rotation = geom_xmat[world, geom]
        local_ray = Ray()
        local_ray.origin = rotate_inverse(rotation, -toward)
        local_ray.direction = rotate_inverse(rotation, ray.direction)
        hit = meet_geom(geoms.kind[index], geoms.size[index], geoms.mesh[index], local_ray, nearest.distance)
        if hit.distance >= wp.float64(0.0) and hit.distance < nearest.distance:
            result.distance = hit.distance
            result.normal = rotate(rotation, hit.normal)
    return result


@wp.func
def farthest_hit() -> RayHit:
    hit = RayHit()
    hit.distance = FARTHEST
    return hit


@wp.func
def nearest_geom(
    geoms: RayGeoms, geom_xpos: wp.array2d[wp.vec3], geom_xmat: wp.array2d[wp.mat33], world: int, body: int, ray: Ray
) -> RayHit:
    """Return the first hit of a ray of the world among the geoms of other bodies."""
    nearest = farthest_hit()
    for index in range(geoms.geom.shape[0]):
        if geoms.body[index] != body:
            nearest = nearer_hit(geoms, geom_xpos, geom_xmat, world, index, ray, nearest)
    return nearest


@wp.func
def sensor_frame(
    rays: SensorRays,
    index: int,
    site_xpos: wp.array2d[wp.vec3],
    site_xmat: wp.array2d[wp.mat33],
    cam_xpos: wp.array2d[wp.vec3],
    cam_xmat: wp.array2d[wp.mat33],
    world: int,
) -> Frame:
    """Return the pose of a ray's site or camera."""
    frame = Frame()
    site, camera = rays.site[index], rays.camera[index]
    if site >= 0:
        frame.position = wp.vec3d(site_xpos[world, site])
        frame.rotation = site_xmat[world, site]
    else:
        frame.position = wp.vec3d(cam_xpos[world, camera])
        frame.rotation = cam_xmat[world, camera]
    return frame


@wp.func
def sensor_ray(rays: SensorRays, index: int, frame: Frame) -> Ray:
    """Return a ray in the world."""
    ray = Ray()
    ray.origin = frame.position + rotate(frame.rotation, rays.origin[index])
    ray.direction = rotate(frame.rotation, rays.direction[index])
    return ray


@wp.func
def depth_of(frame: Frame, ray: Ray, distance: wp.float64) -> wp.float64:
    """Return the depth of a hit in front of a camera, along -z; -1 for a miss."""
    if distance < wp.float64(0.0):
        return wp.float64(-1.0)
    return -rotate_inverse(frame.rotation, ray.origin + distance * ray.direction - frame.position)[2]


@wp.func_native("readings.data[index] = value;")
def store_reading(readings: wp.array[wp.float32], index: wp.int64, value: wp.float32): ...


@wp.func
def write_reading(
    rays: SensorRays,
    index: int,
    frame: Frame,
    ray: Ray,
    nearest: RayHit,
    readings: wp.array[wp.float32],
    first: wp.int64,
):
    """Write the fields of a ray to the readings of its world, which begin at `first` in a contiguous array."""
    hit = nearest
    if nearest.distance == FARTHEST:
        hit = no_hit()
    is_hit = wp.where(hit.distance >= wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))
    fields, column = rays.fields[index], first + wp.int64(rays.column[index])
    low, high = rays.low[index], rays.high[index]
    if fields & DISTANCE:
        store_reading(readings, column, float(wp.clamp(hit.distance, low, high)))
        column += wp.int64(1)
    for field in range(1, 5):
        if fields & (1 << field):
            value = hit.normal
            if (1 << field) == DIRECTION:
                value = ray.direction * is_hit
            elif (1 << field) == ORIGIN:
                value = ray.origin
            elif (1 << field) == POINT:
                value = (ray.origin + hit.distance * ray.direction) * is_hit
            for axis in range(3):
                store_reading(readings, column + wp.int64(axis), float(wp.clamp(value[axis], low, high)))
            column += wp.int64(3)
    if fields & DEPTH:
        depth = hit.distance
        if rays.site[index] < 0:
            depth = depth_of(frame, ray, hit.distance)
        store_reading(readings, column, float(wp.clamp(depth, low, high)))


@wp.kernel
def read_rangefinders(
    # Scene:
    geoms: RayGeoms,
    geom_xpos: wp.array2d[wp.vec3],
    geom_xmat: wp.array2d[wp.mat33],
    # Cameras:
    rays: SensorRays,
    site_xpos: wp.array2d[wp.vec3],
    site_xmat: wp.array2d[wp.mat33],
    cam_xpos: wp.array2d[wp.vec3],
    cam_xmat: wp.array2d[wp.mat33],
    window: Window,
    # Out:
    readings_out: wp.array2d[wp.float32],
):
    """Write the fields of every ray in every world. On a miss, distance and depth are -1, and the other fields 0.

    For GPUs; `rangefinder_rows.read_rangefinder_rows` does the same on CPU cores.
    """
    world, _row, index = wp.tid()
    world += window.first_view
    frame = sensor_frame(rays, index, site_xpos, site_xmat, cam_xpos, cam_xmat, world)
    ray = sensor_ray(rays, index, frame)
    nearest = nearest_geom(geoms, geom_xpos, geom_xmat, world, rays.body[index], ray)
    write_reading(rays, index, frame, ray, nearest, readings_out[world], wp.int64(0))
