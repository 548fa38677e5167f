# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``rays`` caster: one thread per pixel and one ``wp.mesh_query_ray`` per thread; the reference on both devices.

The mesh query only finds the triangle. Depth is computed from the triangle's plane in double precision, because single
precision is off by up to 1 mm where a large triangle is seen at a grazing angle.
"""

import warp as wp

from warpvis.kernels.images import Images
from warpvis.kernels.instance_steps import inverses_of, next_instance
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
from warpvis.kernels.solids import SolidHit, normal_of_solid, to_shape
from warpvis.kernels.triangle_scene import (
    CameraFrame,
    TriangleScene,
    camera_frame,
    face_of,
    factors_of,
    first_hit,
    mesh_of,
    normal_of,
    object_of,
    plane_depth,
    pose_in,
    seen_from,
    shows_solid,
    size_of,
    solid_hit,
    steps_of,
    stretched_corner,
)
from warpvis.kernels.worlds import Worlds, is_excluded, world_of

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

# Spilling registers after a hit is 15 to 21 % faster than lower occupancy (H200).
CUDA_REGISTERS = 64

FARTHEST = wp.constant(3.0e38)
"""Upper limit of ray queries [m], beyond all geometry."""


@wp.struct
class RayRange:
    """How depth is measured along rays, and its limits [m]."""

    near: float
    far: float
    clip: float  # surfaces nearer than this are invisible; 0 if near surfaces occlude what is behind them
    is_planar: bool  # rays have z = 1 and depth is planar; otherwise rays have unit length and depth is the range


@wp.struct
class Seen:
    """The hit of a ray: depth, and the triangle if depth is between near and far, -1 otherwise."""

    depth: float
    face: int  # for the true surface of a solid, its part
    movable: int  # index of the movable object; -1 for static geometry
    round: bool  # whether the hit is on the true surface of a solid
    direction: wp.vec3d  # of the ray, in the world frame


@wp.func
def pinhole_range(camera: PinholeCamera) -> RayRange:
    """Return the range of planar depth of a pinhole camera."""
    measured = RayRange()
    measured.near = camera.near
    measured.far = camera.far
    measured.clip = clip_depth(camera)
    measured.is_planar = True
    return measured


@wp.func
def no_hit() -> Seen:
    seen = Seen()
    seen.depth = wp.inf
    seen.face = -1
    seen.movable = -1
    return seen


@wp.func
def nearest_instance(
    scene: TriangleScene,
    worlds: Worlds,
    view: int,
    in_world: CameraFrame,
    ray: wp.vec3d,
    clip: float,
    max_t: float,
    cull: bool,
) -> Seen:
    """Return the nearest hit among static objects with a shared mesh, up to `max_t` along the ray."""
    seen = no_hit()
    nearest = float(max_t)
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
def meet_object(
    scene: TriangleScene,
    worlds: Worlds,
    world: int,
    view: int,
    movable: int,
    frame: CameraFrame,
    ray: wp.vec3d,
    clip: float,
    cull: bool,
    seen: Seen,
) -> Seen:
    """Return the hit of a movable object, or of static geometry (-1), if it is nearer than `seen`; else `seen`.

    `frame` is the camera in the object's frame. Depth is the ray parameter as returned by the mesh query.
    """
    shown = scene.mesh != wp.uint64(0)
    is_round = bool(False)
    size = wp.vec4()
    if movable >= 0:
        index = scene.movable_object[movable]
        shown = index < 0 or not is_excluded(worlds, view, index)
        size = size_of(scene, worlds, world, movable)
        is_round = shown and shows_solid(scene.movable_solid[movable], size, frame.origin)
    met = SolidHit()
    if is_round:
        met = solid_hit(scene.movable_solid[movable], size, frame, ray)
        # A solid that the near plane cuts is represented by its triangles, as it is for a camera inside.
        is_round = not met.w * wp.float64(clip) > wp.float64(1.0)
    if is_round:
        if met.w * wp.float64(seen.depth) > wp.float64(1.0):
            seen.face = met.part
            seen.movable = movable
            seen.round = True
            seen.depth = float(wp.float64(1.0) / met.w)
    elif shown:
        along = wp.quat_rotate(frame.rotation, ray)
        direction = wp.vec3(along)
        eye = wp.vec3(frame.origin)
        if worlds.object_sizes and movable >= 0:  # dividing by the factors leads to the frame of unscaled triangles
            factors = factors_of(scene, worlds, world, movable)
            direction, eye = wp.vec3(wp.cw_div(along, factors)), wp.vec3(wp.cw_div(frame.origin, factors))
        hit = first_hit(scene, worlds, view, movable, eye, direction, clip, seen.depth, cull)
        if hit.result and hit.t < seen.depth:
            seen.face = hit.face
            seen.movable = movable
            seen.round = False
            seen.depth = hit.t
    return seen


@wp.func
def meet_instances(
    scene: TriangleScene,
    worlds: Worlds,
    view: int,
    in_world: CameraFrame,
    ray: wp.vec3d,
    clip: float,
    cull: bool,
    seen: Seen,
) -> Seen:
    """Return the nearest hit of static objects with a shared mesh if it is nearer than `seen`; else `seen`."""
    if scene.instance_count > 0:
        met = nearest_instance(scene, worlds, view, in_world, ray, clip, seen.depth, cull)
        if met.face >= 0:
            seen.face = met.face
            seen.movable = met.movable
            seen.round = False
            seen.depth = met.depth
    return seen


@wp.func
def measure(
    scene: TriangleScene,
    worlds: Worlds,
    world: int,
    frame: CameraFrame,
    camera: RayRange,
    ray: wp.vec3d,
    seen: Seen,
) -> Seen:
    """Return a hit with exact depth; hits outside of the camera's range become misses.

    `frame` is the camera in the frame of the hit object.
    """
    if seen.face < 0:
        seen.depth = wp.inf
        return seen
    if not seen.round:
        mesh = mesh_of(scene, seen.movable)
        factors = factors_of(scene, worlds, world, seen.movable)
        a = stretched_corner(mesh, seen.face, 0, factors) - frame.origin
        b = stretched_corner(mesh, seen.face, 1, factors) - frame.origin
        c = stretched_corner(mesh, seen.face, 2, factors) - frame.origin
        local_direction = wp.quat_rotate(frame.rotation, ray)
        forward = wp.where(camera.is_planar, forward_axis(frame.rotation), local_direction)
        seen.depth = wp.max(float(plane_depth(a, b, c, local_direction, forward)), camera.clip)
    if seen.depth < camera.near:
        seen.depth = -wp.inf
        seen.face = -1
    elif seen.depth > camera.far:
        seen.depth = wp.inf
        seen.face = -1
    return seen


@wp.func
def trace_ray(
    scene: TriangleScene,
    camera: RayRange,
    in_world: CameraFrame,
    worlds: Worlds,
    view: int,
    ray: wp.vec3d,
    cull_backfaces: bool,
) -> Seen:
    """Cast one ray of the camera frame: with z = 1 for planar depth, of unit length for range."""
    seen = no_hit()
    seen.direction = wp.quat_rotate(in_world.rotation, ray)

    world = int(0)
    if scene.movable_count > 0:
        world = world_of(worlds, view)
        if world < 0:
            return seen
    # Query the whole range: hits beyond `far` are removed below, by exact depth.
    seen.depth = float(FARTHEST)
    for movable in range(-1, scene.movable_count):  # -1: static geometry
        frame = in_world
        if movable >= 0:
            frame = seen_from(in_world, worlds.object_poses[world, movable])
        seen = meet_object(scene, worlds, world, view, movable, frame, ray, camera.clip, cull_backfaces, seen)
    seen = meet_instances(scene, worlds, view, in_world, ray, camera.clip, cull_backfaces, seen)
    hit_frame = in_world
    if seen.face >= 0 and seen.movable >= 0:
        hit_frame = seen_from(in_world, pose_in(scene, worlds, world, seen.movable))
    return measure(scene, worlds, world, hit_frame, camera, ray, seen)


@wp.func
def solid_normal(scene: TriangleScene, origin: wp.vec3d, worlds: Worlds, view: int, seen: Seen) -> wp.vec3:
    """Return the unit normal, in the world frame, of the true surface at a hit."""
    world = world_of(worlds, view)
    pose = worlds.object_poses[world, seen.movable]
    kind, size = scene.movable_solid[seen.movable], size_of(scene, worlds, world, seen.movable)
    point = origin + wp.float64(seen.depth) * seen.direction - pose_origin(pose)
    shape_point = to_shape(wp.quat_rotate_inv(pose_rotation(pose), point), size)
    return wp.vec3(wp.quat_rotate(pose_rotation(pose), normal_of_solid(kind, size, seen.face, shape_point)))


@wp.func
def normal_in_world(scene: TriangleScene, origin: wp.vec3d, worlds: Worlds, view: int, seen: Seen) -> wp.vec3:
    if seen.face < 0:
        return wp.vec3(wp.nan, wp.nan, wp.nan)
    if seen.movable < 0:
        factors = factors_of(scene, worlds, 0, seen.movable)
        return wp.vec3(normal_of(scene.mesh, seen.face, factors, seen.direction))
    if seen.round:
        return solid_normal(scene, origin, worlds, view, seen)
    world = world_of(worlds, view)
    rotation = pose_rotation(pose_in(scene, worlds, world, seen.movable))
    direction = wp.quat_rotate_inv(rotation, seen.direction)
    factors = factors_of(scene, worlds, world, seen.movable)
    normal = normal_of(scene.movable_mesh[seen.movable], seen.face, factors, direction)
    return wp.vec3(wp.quat_rotate(rotation, normal))


@wp.func
def write_images(
    scene: TriangleScene,
    origin: wp.vec3d,
    worlds: Worlds,
    world_view: int,
    seen: Seen,
    view: int,
    y: int,
    x: int,
    images_out: Images,
):
    """Write the requested images; images that were not requested are None.

    `origin` is the ray's origin, and `world_view` the view index that `trace_ray` used to find the world.
    """
    if images_out.depth:
        images_out.depth[view, y, x] = seen.depth
    if images_out.points:
        point = wp.vec3(wp.nan, wp.nan, wp.nan)
        if seen.face >= 0:
            point = wp.vec3(origin + wp.float64(seen.depth) * seen.direction)
        images_out.points[view, y, x] = point
    if images_out.normals:
        images_out.normals[view, y, x] = normal_in_world(scene, origin, worlds, world_view, seen)
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
    if images_out.faces:
        images_out.faces[view, y, x] = face_of(scene, seen.movable, seen.face)


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
    """Write the requested images (None is skipped) of every view."""
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row

    eye = camera_frame(camera_to_world[view])
    seen = trace_ray(scene, pinhole_range(camera), eye, worlds, view, pixel_ray(camera, y, x), cull_backfaces)
    write_images(scene, eye.origin, worlds, view, seen, view, y, x, images_out)


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
    """Cast rays through any image points; all arrays are (view, 1, point). Points outside the image hit nothing."""
    view, row, point = wp.tid()
    view += window.first_view
    row += window.first_row

    pixel = pixels_in[view, row, point]
    eye = camera_frame(camera_to_world[view])
    seen = no_hit()
    if pixel[0] >= 0.0 and pixel[0] < camera.width and pixel[1] >= 0.0 and pixel[1] < camera.height:
        seen = trace_ray(scene, pinhole_range(camera), eye, worlds, view, image_ray(camera, pixel), cull_backfaces)
    write_images(scene, eye.origin, worlds, view, seen, view, row, point, images_out)
