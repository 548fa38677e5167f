# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``rays`` caster: one thread a pixel, one ``wp.mesh_query_ray`` a thread; the reference on both devices.

The tree only finds the triangle. Its depth comes from the triangle's plane in double precision, because single
precision loses up to a millimetre where a large triangle is seen at a grazing angle.
"""

import warp as wp

from warpvis.kernels.images import Images
from warpvis.kernels.pinhole import (
    PinholeCamera,
    Window,
    clip_depth,
    forward_axis,
    image_ray,
    pixel_ray,
    pose_origin,
    pose_rotation,
)
from warpvis.kernels.solids import SolidHit, is_outside, meet_solid, normal_of_solid, stretch_of, to_shape
from warpvis.kernels.worlds import Worlds, is_excluded, world_of

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

# Spilling some of what is computed after a hit is faster than fewer threads on a multiprocessor: by 15 to 21 % (H200).
CUDA_REGISTERS = 64

CLOSE = wp.constant(1.0e-3)
"""Hits nearer than this may be of a triangle in whose plane the camera is [m]."""


@wp.struct
class InstanceStep:
    """A step of a walk through a tree of instances' boxes; see `warpvis.scene._instance_tree`."""

    low: wp.vec3  # of the box, in the world
    high: wp.vec3
    after: int  # the step to go on at if the box is missed
    instance: int  # which one the box is of, -1 for that of several
    pose: wp.transform  # object to world, of the instance that has this step's number


@wp.struct
class TriangleScene:
    """Triangles in the world frame and what each belongs to, the meshes of movable objects, and all labels."""

    mesh: wp.uint64  # 0 if nothing stays
    triangle_object: wp.array[wp.int32]  # of what stays, then of each mesh that is of several objects
    movable_mesh: wp.array[wp.uint64]
    movable_object: wp.array[wp.int32]  # -1 where it is of several
    movable_first_face: wp.array[wp.int32]  # where its triangles' objects begin, if it is of several
    movable_count: int
    movable_solid: wp.array[wp.int32]  # a `warpvis.scene.solids.SolidKind`
    movable_size: wp.array[wp.vec4]  # of a solid: factors along x, y and z [m], and half length before them
    object_label: wp.array[wp.uint8]
    instance_count: int  # of steps through what stays and shares a mesh: those come behind the movable
    instances: wp.uint64  # address of the first `InstanceStep`: an array would be copied for each ray


@wp.func
def corner(mesh: wp.uint64, triangle: int, k: int) -> wp.vec3d:
    return wp.vec3d(wp.mesh_get_point(mesh, triangle * 3 + k))


@wp.func
def stretched_corner(mesh: wp.uint64, triangle: int, k: int, factors: wp.vec3d) -> wp.vec3d:
    """A corner of an object that is stretched along its axes."""
    return wp.cw_mul(corner(mesh, triangle, k), factors)


@wp.func
def plane_depth(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, direction: wp.vec3d, forward: wp.vec3d) -> wp.float64:
    """Depth at which a ray from the origin, of depth 1 along `forward`, meets a triangle that it is known to hit.

    A point of a triangle is nowhere nearer than its nearest corner or farther than its farthest: the bound keeps the
    quotient sane where the triangle is seen edge-on.
    """
    normal = wp.cross(b - a, c - a)
    za, zb, zc = wp.dot(a, forward), wp.dot(b, forward), wp.dot(c, forward)
    nearest = wp.min(za, wp.min(zb, zc))
    farthest = wp.max(za, wp.max(zb, zc))
    steepness = wp.dot(normal, direction)
    if steepness == wp.float64(0.0):
        return nearest
    return wp.clamp(wp.dot(normal, a) / steepness, nearest, farthest)


@wp.struct
class CameraFrame:
    """A camera in the frame of a mesh: the world's, or that of an object that moves."""

    origin: wp.vec3d
    rotation: wp.quatd


@wp.func
def camera_frame(pose: wp.transform) -> CameraFrame:
    frame = CameraFrame()
    frame.origin = pose_origin(pose)
    frame.rotation = pose_rotation(pose)
    return frame


@wp.func
def seen_from(camera: CameraFrame, place: wp.transform) -> CameraFrame:
    """The same camera in the frame of an object at a place."""
    turned_back = wp.quat_inverse(pose_rotation(place))
    frame = CameraFrame()
    frame.origin = wp.quat_rotate(turned_back, camera.origin - pose_origin(place))
    frame.rotation = turned_back * camera.rotation
    return frame


@wp.func
def steps_of(scene: TriangleScene) -> wp.array[InstanceStep]:
    return wp.array(ptr=scene.instances, shape=(scene.instance_count,), dtype=InstanceStep)


@wp.func
def place_in(scene: TriangleScene, worlds: Worlds, world: int, movable: int) -> wp.transform:
    """Where an object with a frame of its own is in a world: what stays has one place."""
    if movable >= scene.movable_count:
        return steps_of(scene)[movable - scene.movable_count].pose
    return worlds.object_poses[world, movable]


@wp.func
def inverse_of(direction: float) -> float:
    """1 / a ray's direction along an axis; a large number where it has none, of which 0 times is 0."""
    return 1.0 / wp.where(wp.abs(direction) < 1.0e-18, 1.0e-18, direction)


@wp.func
def inverses_of(direction: wp.vec3d) -> wp.vec3:
    return wp.vec3(inverse_of(float(direction[0])), inverse_of(float(direction[1])), inverse_of(float(direction[2])))


@wp.func
def meets_box(low: wp.vec3, high: wp.vec3, eye: wp.vec3, inverse: wp.vec3, most_t: float) -> bool:
    """Whether a ray may meet a box that is a little wider than what is in it, before it has gone so far."""
    a, b = wp.cw_mul(low - eye, inverse), wp.cw_mul(high - eye, inverse)
    least, most = wp.min(a, b), wp.max(a, b)
    begin = wp.max(least[0], wp.max(least[1], least[2]))
    end = wp.min(most[0], wp.min(most[1], most[2]))
    reach = 1.0e-5 * wp.abs(end)
    return end >= 0.0 and begin <= end + reach and begin <= most_t + 1.0e-5 * wp.abs(most_t)


@wp.func
def next_instance(steps: wp.array[InstanceStep], step: int, eye: wp.vec3, inverse: wp.vec3, most_t: float) -> int:
    """The next step, from one on, at which a ray meets the box of an instance; -1 if there is none."""
    at = int(step)
    found = int(-1)
    while found < 0 and at < steps.shape[0]:
        if meets_box(steps[at].low, steps[at].high, eye, inverse, most_t):
            if steps[at].instance >= 0:
                found = at
            at += 1
        else:
            at = steps[at].after
    return found


@wp.func
def size_of(scene: TriangleScene, worlds: Worlds, world: int, movable: int) -> wp.vec4:
    """A movable object's size in a world: of a solid its own, of a mesh factors."""
    if worlds.object_sizes:
        return worlds.object_sizes[world, movable]
    return scene.movable_size[movable]


@wp.func
def factors_of(scene: TriangleScene, worlds: Worlds, world: int, movable: int) -> wp.vec3d:
    """Factors by which an object's triangles are stretched along its axes; ones for what stays (-1)."""
    one = wp.float64(1.0)
    if movable < 0 or movable >= scene.movable_count or not worlds.object_sizes:
        return wp.vec3d(one, one, one)
    made, now = scene.movable_size[movable], worlds.object_sizes[world, movable]
    return stretch_of(scene.movable_solid[movable], made, now)


@wp.func
def mesh_of(scene: TriangleScene, movable: int) -> wp.uint64:
    """A movable object's mesh, or that of what stays (-1)."""
    if movable < 0:
        return scene.mesh
    return scene.movable_mesh[movable]


@wp.func
def object_of(scene: TriangleScene, movable: int, face: int) -> int:
    """Whose a triangle is: of a movable object's mesh, or of what stays (-1)."""
    if movable < 0:
        return scene.triangle_object[face]
    if scene.movable_object[movable] >= 0:
        return scene.movable_object[movable]
    return scene.triangle_object[scene.movable_first_face[movable] + face]


@wp.func
def is_edge_on(mesh: wp.uint64, face: int, eye: wp.vec3) -> bool:
    """Whether a place is in the plane of a triangle: from there it covers nothing."""
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
    """Whether a ray goes on through a triangle: one in whose plane the camera is, a culled back face, or part of what
    the view must not see.
    """
    if t < CLOSE and is_edge_on(mesh_of(scene, movable), face, eye):
        return True
    if cull and wp.dot(wp.mesh_eval_face_normal(mesh_of(scene, movable), face), direction) >= 0.0:
        return True
    return is_excluded(worlds, view, object_of(scene, movable, face))


@wp.func
def first_hit(
    scene: TriangleScene,
    worlds: Worlds,
    view: int,
    movable: int,
    origin: wp.vec3,
    direction: wp.vec3,
    least_t: float,
    most_t: float,
    cull: bool,
) -> wp.MeshQueryRay:
    """The first hit that counts: past every other the ray goes on from just behind it. Its t is the depth."""
    mesh = mesh_of(scene, movable)
    passed = float(least_t)
    hit = wp.mesh_query_ray(mesh, origin + passed * direction, direction, most_t - passed)
    if cull or worlds.excluded or hit.t < CLOSE:
        while hit.result and passes(scene, worlds, view, movable, origin, hit.t + passed, hit.face, direction, cull):
            passed += wp.max(hit.t, 0.0) + 1.0e-6 * wp.max(1.0, passed)
            hit = wp.mesh_query_ray(mesh, origin + passed * direction, direction, most_t - passed)
    hit.t += passed
    return hit


@wp.struct
class Seen:
    """What a ray meets: depth, and the triangle where it lies between near and far, -1 elsewhere."""

    depth: float
    face: int  # of a solid's true surface, which part of it
    movable: int  # which movable object it belongs to; -1 for what stays
    round: bool  # whether it is a solid's true surface
    direction: wp.vec3d  # of the ray, in the world


@wp.func
def nothing() -> Seen:
    seen = Seen()
    seen.depth = wp.inf
    seen.face = -1
    seen.movable = -1
    return seen


@wp.func
def shows_solid(kind: int, size: wp.vec4, origin: wp.vec3d) -> bool:
    """Whether a camera at a place of an object's frame sees its true surface: a solid, from outside."""
    return kind != 0 and is_outside(kind, wp.float64(size[3]), to_shape(origin, size))


@wp.func
def solid_hit(kind: int, size: wp.vec4, frame: CameraFrame, ray: wp.vec3d) -> SolidHit:
    """Where a ray meets a solid's surface."""
    direction = to_shape(wp.quat_rotate(frame.rotation, ray), size)
    return meet_solid(kind, wp.float64(size[3]), to_shape(frame.origin, size), direction)


@wp.func
def nearest_instance(
    scene: TriangleScene,
    worlds: Worlds,
    view: int,
    in_world: CameraFrame,
    ray: wp.vec3d,
    clip: float,
    most_t: float,
    cull: bool,
) -> Seen:
    """What a ray meets first of objects that stay and share a mesh, nearer than anything else is."""
    seen = nothing()
    nearest = float(most_t)
    towards = wp.quat_rotate(in_world.rotation, ray)
    inverse, origin = inverses_of(towards), wp.vec3(in_world.origin)
    steps = steps_of(scene)
    step = next_instance(steps, 0, origin, inverse, nearest)
    while step >= 0:
        instance = steps[step].instance
        movable = scene.movable_count + instance
        if not is_excluded(worlds, view, scene.movable_object[movable]):
            frame = seen_from(in_world, steps[instance].pose)
            direction, eye = wp.vec3(wp.quat_rotate(frame.rotation, ray)), wp.vec3(frame.origin)
            hit = first_hit(scene, worlds, view, movable, eye, direction, clip, nearest, cull)
            if hit.result and hit.t < nearest:
                seen.face = hit.face
                seen.movable = movable
                nearest = hit.t
        step = next_instance(steps, step + 1, origin, inverse, nearest)
    seen.depth = nearest
    return seen


@wp.func
def look(
    scene: TriangleScene,
    near: float,
    far: float,
    pose: wp.transform,
    worlds: Worlds,
    view: int,
    ray: wp.vec3d,
    is_planar: bool,
    clip: float,
    cull_backfaces: bool,
) -> Seen:
    """What a camera at a pose sees along a ray of its frame: of z = 1 for planar depth, of length 1 for a length.

    What is nearer than `clip` is not there; what is nearer than `near` hides what is behind it.
    """
    in_world = camera_frame(pose)
    seen = nothing()
    seen.direction = wp.quat_rotate(in_world.rotation, ray)

    # Whole-range queries: what lies beyond `far` is sorted out below, by the exact depth.
    nearest = float(3.0e38)
    world = int(0)
    if scene.movable_count > 0:
        world = world_of(worlds, view)
        if world < 0:
            return seen
    for movable in range(-1, scene.movable_count):  # -1: what stays
        shown = scene.mesh != wp.uint64(0)
        frame = in_world
        is_round = bool(False)
        size = wp.vec4()
        if movable >= 0:
            index = scene.movable_object[movable]
            shown = index < 0 or not is_excluded(worlds, view, index)
            frame = seen_from(in_world, worlds.object_poses[world, movable])
            size = size_of(scene, worlds, world, movable)
            is_round = shown and shows_solid(scene.movable_solid[movable], size, frame.origin)
        met = SolidHit()
        if is_round:
            met = solid_hit(scene.movable_solid[movable], size, frame, ray)
            # Where it is cut open, its triangles stand for it, as from inside.
            is_round = not met.w * wp.float64(clip) > wp.float64(1.0)
        if is_round:
            if met.w * wp.float64(nearest) > wp.float64(1.0):
                seen.face = met.part
                seen.movable = movable
                seen.round = True
                nearest = float(wp.float64(1.0) / met.w)
        elif shown:
            along = wp.quat_rotate(frame.rotation, ray)
            direction = wp.vec3(along)
            eye = wp.vec3(frame.origin)
            if worlds.object_sizes and movable >= 0:  # triangles are as they were in the frame divided by these
                factors = factors_of(scene, worlds, world, movable)
                direction, eye = wp.vec3(wp.cw_div(along, factors)), wp.vec3(wp.cw_div(frame.origin, factors))
            hit = first_hit(scene, worlds, view, movable, eye, direction, clip, nearest, cull_backfaces)
            if hit.result and hit.t < nearest:
                seen.face = hit.face
                seen.movable = movable
                seen.round = False
                nearest = hit.t
    if scene.instance_count > 0:
        met_instance = nearest_instance(scene, worlds, view, in_world, ray, clip, nearest, cull_backfaces)
        if met_instance.face >= 0:
            seen.face = met_instance.face
            seen.movable = met_instance.movable
            seen.round = False
            nearest = met_instance.depth

    if seen.face >= 0:
        seen.depth = nearest
    if seen.face >= 0 and not seen.round:
        frame = in_world
        mesh = mesh_of(scene, seen.movable)
        if seen.movable >= 0:
            frame = seen_from(in_world, place_in(scene, worlds, world, seen.movable))
        factors = factors_of(scene, worlds, world, seen.movable)
        a = stretched_corner(mesh, seen.face, 0, factors) - frame.origin
        b = stretched_corner(mesh, seen.face, 1, factors) - frame.origin
        c = stretched_corner(mesh, seen.face, 2, factors) - frame.origin
        direction_there = wp.quat_rotate(frame.rotation, ray)
        forward = wp.where(is_planar, forward_axis(frame.rotation), direction_there)
        seen.depth = wp.max(float(plane_depth(a, b, c, direction_there, forward)), clip)
    if seen.face >= 0 and seen.depth < near:
        seen.depth = -wp.inf
        seen.face = -1
    elif seen.face >= 0 and seen.depth > far:
        seen.depth = wp.inf
        seen.face = -1
    return seen


@wp.func
def normal_of(mesh: wp.uint64, face: int, factors: wp.vec3d, direction: wp.vec3d) -> wp.vec3d:
    """Unit normal of a triangle of what is stretched, against the direction from which it is seen."""
    a = stretched_corner(mesh, face, 0, factors)
    facing = wp.cross(stretched_corner(mesh, face, 1, factors) - a, stretched_corner(mesh, face, 2, factors) - a)
    if wp.dot(facing, direction) > wp.float64(0.0):
        facing = -facing
    return wp.normalize(facing)


@wp.func
def solid_normal(scene: TriangleScene, pose: wp.transform, worlds: Worlds, view: int, seen: Seen) -> wp.vec3:
    """Unit normal in the world of the true surface that a ray meets."""
    world = world_of(worlds, view)
    place = worlds.object_poses[world, seen.movable]
    kind, size = scene.movable_solid[seen.movable], size_of(scene, worlds, world, seen.movable)
    point = pose_origin(pose) + wp.float64(seen.depth) * seen.direction - pose_origin(place)
    there = to_shape(wp.quat_rotate_inv(pose_rotation(place), point), size)
    return wp.vec3(wp.quat_rotate(pose_rotation(place), normal_of_solid(kind, size, seen.face, there)))


@wp.func
def normal_in_world(scene: TriangleScene, pose: wp.transform, worlds: Worlds, view: int, seen: Seen) -> wp.vec3:
    if seen.face < 0:
        return wp.vec3(wp.nan, wp.nan, wp.nan)
    if seen.movable < 0:
        factors = factors_of(scene, worlds, 0, seen.movable)
        return wp.vec3(normal_of(scene.mesh, seen.face, factors, seen.direction))
    if seen.round:
        return solid_normal(scene, pose, worlds, view, seen)
    world = world_of(worlds, view)
    rotation = pose_rotation(place_in(scene, worlds, world, seen.movable))
    direction = wp.quat_rotate_inv(rotation, seen.direction)
    factors = factors_of(scene, worlds, world, seen.movable)
    normal = normal_of(scene.movable_mesh[seen.movable], seen.face, factors, direction)
    return wp.vec3(wp.quat_rotate(rotation, normal))


@wp.func
def write(
    scene: TriangleScene,
    pose: wp.transform,
    worlds: Worlds,
    seen: Seen,
    view: int,
    y: int,
    x: int,
    images_out: Images,
):
    """Write to the images that were asked for; the others are None."""
    if images_out.depth:
        images_out.depth[view, y, x] = seen.depth
    if images_out.points:
        point = wp.vec3(wp.nan, wp.nan, wp.nan)
        if seen.face >= 0:
            point = wp.vec3(pose_origin(pose) + wp.float64(seen.depth) * seen.direction)
        images_out.points[view, y, x] = point
    if images_out.normals:
        images_out.normals[view, y, x] = normal_in_world(scene, pose, worlds, view, seen)
    if images_out.labels or images_out.segmentation:
        index = int(-1)
        label = wp.uint8(0)
        if seen.face >= 0:
            index = object_of(scene, seen.movable, seen.face)
            label = scene.object_label[index]
        if images_out.labels:
            images_out.labels[view, y, x] = label
        if images_out.segmentation:
            images_out.segmentation[view, y, x] = index


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_rays(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    cull_backfaces: bool,
    # Out:
    images_out: Images,
):
    """Write the asked-for images (one that is None is skipped) of every view."""
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row

    pose = camera_to_world[view]
    ray, clip = pixel_ray(camera, y, x), clip_depth(camera)
    seen = look(scene, camera.near, camera.far, pose, worlds, view, ray, True, clip, cull_backfaces)
    write(scene, pose, worlds, seen, view, y, x, images_out)


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_rays_at(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    pixels_in: wp.array3d[wp.vec2],
    cull_backfaces: bool,
    # Out:
    images_out: Images,
):
    """The same through any points of the image; all arrays are (view, 1, point). Outside the image nothing is seen."""
    view, row, point = wp.tid()
    view += window.first_view
    row += window.first_row

    at = pixels_in[view, row, point]
    pose = camera_to_world[view]
    seen = nothing()
    if at[0] >= 0.0 and at[0] < camera.width and at[1] >= 0.0 and at[1] < camera.height:
        ray, clip = image_ray(camera, at), clip_depth(camera)
        seen = look(scene, camera.near, camera.far, pose, worlds, view, ray, True, clip, cull_backfaces)
    write(scene, pose, worlds, seen, view, row, point, images_out)
