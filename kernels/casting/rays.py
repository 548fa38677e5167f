# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``rays`` caster: one thread per pixel and one ``wp.mesh_query_ray`` per thread; the reference on both devices.

The mesh query only finds the triangle. Depth is computed from the triangle's plane in double precision, because single
precision is off by up to 1 mm where a large triangle is seen at a grazing angle.
"""

from typing import Any

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.motions import MovingObjects, frame_at
from warpvis.kernels.casting.solids import SolidHit, normal_of_solid, to_shape
from warpvis.kernels.casting.triangle_scene import (
    TriangleScene,
    face_of,
    factors_of,
    first_hit,
    inverses_of,
    mesh_of,
    next_instance,
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
from warpvis.kernels.casting.worlds import Worlds, is_excluded, world_of
from warpvis.kernels.pinhole import (
    Frame,
    PinholeCamera,
    Window,
    clip_depth,
    forward_axis,
    frame_of,
    image_ray,
    locate,
    pixel_center,
)

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
class RayHit:
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
def no_hit() -> RayHit:
    hit = RayHit()
    hit.depth = wp.inf
    hit.face = -1
    hit.movable = -1
    return hit


@wp.func
def nearest_instance(
    scene: TriangleScene,
    worlds: Worlds,
    view: int,
    in_world: Frame,
    ray: wp.vec3d,
    clip: float,
    max_t: float,
    cull: bool,
) -> RayHit:
    """Return the nearest hit among static objects with a shared mesh, up to `max_t` along the ray."""
    hit = no_hit()
    nearest = float(max_t)
    toward = wp.quat_rotate(in_world.rotation, ray)
    inverse, origin = inverses_of(toward), wp.vec3(in_world.origin)
    steps = steps_of(scene)
    step = next_instance(steps, 0, origin, inverse, nearest)
    while step >= 0:
        instance = steps[step].instance
        movable = scene.movable_count + instance
        if not is_excluded(worlds, view, scene.movable_object[movable]):
            frame = seen_from(in_world, frame_of(steps[instance].pose))
            direction, eye = wp.vec3(wp.quat_rotate(frame.rotation, ray)), wp.vec3(frame.origin)
            mesh_hit = first_hit(scene, worlds, view, movable, eye, direction, clip, nearest, cull)
            if mesh_hit.result and mesh_hit.t < nearest:
                hit.face = mesh_hit.face
                hit.movable = movable
                nearest = mesh_hit.t
        step = next_instance(steps, step + 1, origin, inverse, nearest)
    hit.depth = nearest
    return hit


@wp.func
def meet_object(
    scene: TriangleScene,
    worlds: Worlds,
    world: int,
    view: int,
    movable: int,
    frame: Frame,
    ray: wp.vec3d,
    clip: float,
    cull: bool,
    nearest: RayHit,
) -> RayHit:
    """Return the hit of a movable object, or of static geometry (-1), if it is nearer than `nearest`; else `nearest`.

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
    solid = SolidHit()
    if is_round:
        solid = solid_hit(scene.movable_solid[movable], size, frame, ray)
        # A solid that the near plane cuts is represented by its triangles, as it is for a camera inside.
        is_round = not solid.w * wp.float64(clip) > wp.float64(1.0)
    if is_round:
        if solid.w * wp.float64(nearest.depth) > wp.float64(1.0):
            nearest.face = solid.part
            nearest.movable = movable
            nearest.round = True
            nearest.depth = float(wp.float64(1.0) / solid.w)
    elif shown:
        along = wp.quat_rotate(frame.rotation, ray)
        direction = wp.vec3(along)
        eye = wp.vec3(frame.origin)
        if worlds.object_sizes and movable >= 0:  # dividing by the factors leads to the frame of unscaled triangles
            factors = factors_of(scene, worlds, world, movable)
            direction, eye = wp.vec3(wp.cw_div(along, factors)), wp.vec3(wp.cw_div(frame.origin, factors))
        mesh_hit = first_hit(scene, worlds, view, movable, eye, direction, clip, nearest.depth, cull)
        if mesh_hit.result and mesh_hit.t < nearest.depth:
            nearest.face = mesh_hit.face
            nearest.movable = movable
            nearest.round = False
            nearest.depth = mesh_hit.t
    return nearest


@wp.func
def meet_instances(
    scene: TriangleScene,
    worlds: Worlds,
    view: int,
    in_world: Frame,
    ray: wp.vec3d,
    clip: float,
    cull: bool,
    nearest: RayHit,
) -> RayHit:
    """Return the nearest hit of static objects with a shared mesh if it is nearer than `nearest`; else `nearest`."""
    if scene.instance_count > 0:
        candidate = nearest_instance(scene, worlds, view, in_world, ray, clip, nearest.depth, cull)
        if candidate.face >= 0:
            nearest.face = candidate.face
            nearest.movable = candidate.movable
            nearest.round = False
            nearest.depth = candidate.depth
    return nearest


@wp.func
def measure(
    scene: TriangleScene,
    worlds: Worlds,
    world: int,
    frame: Frame,
    camera: RayRange,
    ray: wp.vec3d,
    hit: RayHit,
) -> RayHit:
    """Return a hit with exact depth; hits outside of the camera's range become misses.

    `frame` is the camera in the frame of the hit object.
    """
    if hit.face < 0:
        hit.depth = wp.inf
        return hit
    if not hit.round:
        mesh = mesh_of(scene, hit.movable)
        factors = factors_of(scene, worlds, world, hit.movable)
        a = stretched_corner(mesh, hit.face, 0, factors) - frame.origin
        b = stretched_corner(mesh, hit.face, 1, factors) - frame.origin
        c = stretched_corner(mesh, hit.face, 2, factors) - frame.origin
        local_direction = wp.quat_rotate(frame.rotation, ray)
        forward = wp.where(camera.is_planar, forward_axis(frame.rotation), local_direction)
        hit.depth = wp.max(float(plane_depth(a, b, c, local_direction, forward)), camera.clip)
    if hit.depth < camera.near:
        hit.depth = -wp.inf
        hit.face = -1
    elif hit.depth > camera.far:
        hit.depth = wp.inf
        hit.face = -1
    return hit


@wp.func
def object_frame(scene: TriangleScene, objects: Worlds, world: int, movable: int) -> Frame:
    """Return the pose of a movable object or an instance in a world."""
    return frame_of(pose_in(scene, objects, world, movable))


@wp.func
def object_frame(scene: TriangleScene, objects: MovingObjects, world: int, movable: int) -> Frame:
    """Return the pose of a movable object at a time; instances are fixed."""
    if movable >= scene.movable_count:
        return frame_of(steps_of(scene)[movable - scene.movable_count].pose)
    return frame_at(objects.motion, world, movable, objects.time)


@wp.func
def trace_ray(
    scene: TriangleScene,
    camera: RayRange,
    in_world: Frame,
    worlds: Worlds,
    objects: Any,
    view: int,
    ray: wp.vec3d,
    cull_backfaces: bool,
) -> RayHit:
    """Cast one ray of the camera frame: with z = 1 for planar depth, of unit length for range.

    `objects` has the poses of objects: `worlds`, or `MovingObjects`, for which only the rest of `worlds` is read.
    """
    hit = no_hit()
    hit.direction = wp.quat_rotate(in_world.rotation, ray)

    world = int(0)
    if scene.movable_count > 0:
        world = world_of(worlds, view)
        if world < 0:
            return hit
    # Query the whole range: hits beyond `far` are removed below, by exact depth.
    hit.depth = float(FARTHEST)
    for movable in range(-1, scene.movable_count):  # -1: static geometry
        frame = in_world
        if movable >= 0:
            frame = seen_from(in_world, object_frame(scene, objects, world, movable))
        hit = meet_object(scene, worlds, world, view, movable, frame, ray, camera.clip, cull_backfaces, hit)
    hit = meet_instances(scene, worlds, view, in_world, ray, camera.clip, cull_backfaces, hit)
    hit_frame = in_world
    if hit.face >= 0 and hit.movable >= 0:
        hit_frame = seen_from(in_world, object_frame(scene, objects, world, hit.movable))
    return measure(scene, worlds, world, hit_frame, camera, ray, hit)


@wp.func
def solid_normal(kind: int, size: wp.vec4, frame: Frame, origin: wp.vec3d, hit: RayHit) -> wp.vec3:
    """Return the unit normal, in the world frame, of the true surface at a hit; `frame` is the solid's."""
    point = origin + wp.float64(hit.depth) * hit.direction - frame.origin
    shape_point = to_shape(wp.quat_rotate_inv(frame.rotation, point), size)
    return wp.vec3(wp.quat_rotate(frame.rotation, normal_of_solid(kind, size, hit.face, shape_point)))


@wp.func
def normal_in_world(
    scene: TriangleScene, origin: wp.vec3d, worlds: Worlds, objects: Any, view: int, hit: RayHit
) -> wp.vec3:
    """Return the unit normal in the world frame at the hit of a ray from `origin`; NaN for a miss."""
    if hit.face < 0:
        return wp.vec3(wp.nan, wp.nan, wp.nan)
    if hit.movable < 0:
        factors = factors_of(scene, worlds, 0, hit.movable)
        return wp.vec3(normal_of(scene.mesh, hit.face, factors, hit.direction))
    world = world_of(worlds, view)
    frame = object_frame(scene, objects, world, hit.movable)
    if hit.round:
        size = size_of(scene, worlds, world, hit.movable)
        return solid_normal(scene.movable_solid[hit.movable], size, frame, origin, hit)
    direction = wp.quat_rotate_inv(frame.rotation, hit.direction)
    factors = factors_of(scene, worlds, world, hit.movable)
    normal = normal_of(scene.movable_mesh[hit.movable], hit.face, factors, direction)
    return wp.vec3(wp.quat_rotate(frame.rotation, normal))


@wp.func
def write_images(
    scene: TriangleScene,
    origin: wp.vec3d,
    worlds: Worlds,
    objects: Any,
    world_view: int,
    hit: RayHit,
    view: int,
    y: int,
    x: int,
    images_out: Images,
):
    """Write the requested images; images that were not requested are None.

    `origin` is the ray's origin, and `world_view` the view index that `trace_ray` used to find the world; `objects` are
    those of `trace_ray`.
    """
    if images_out.depth:
        images_out.depth[view, y, x] = hit.depth
    if images_out.points:
        point = wp.vec3(wp.nan, wp.nan, wp.nan)
        if hit.face >= 0:
            point = wp.vec3(origin + wp.float64(hit.depth) * hit.direction)
        images_out.points[view, y, x] = point
    if images_out.normals:
        images_out.normals[view, y, x] = normal_in_world(scene, origin, worlds, objects, world_view, hit)
    if images_out.labels or images_out.segmentation:
        index = int(-1)
        label = wp.uint8(0)
        if hit.face >= 0:
            index = object_of(scene, hit.movable, hit.face)
            label = scene.object_label[index]
        if images_out.labels:
            images_out.labels[view, y, x] = label
        if images_out.segmentation:
            images_out.segmentation[view, y, x] = index
    if images_out.faces:
        images_out.faces[view, y, x] = face_of(scene, hit.movable, hit.face)


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
    pixels_in: wp.array3d[wp.vec2],
    cull_backfaces: bool,
    # Out:
    images_out: Images,
):
    """Write the requested images (None is skipped) of every view.

    `pixels_in` are image points [px], (view, 1, point), in which case images have that shape too; None for pixel
    centers. Points outside the image hit nothing.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    pixel = pixel_center(y, x)
    if pixels_in:
        pixel = pixels_in[view, y, x]
    eye = frame_of(camera_to_world[view])
    hit = no_hit()
    if pixel[0] >= 0.0 and pixel[0] < camera.width and pixel[1] >= 0.0 and pixel[1] < camera.height:
        ray = image_ray(camera, pixel)
        hit = trace_ray(scene, pinhole_range(camera), eye, worlds, worlds, view, ray, cull_backfaces)
    write_images(scene, eye.origin, worlds, worlds, view, hit, view, y, x, images_out)
