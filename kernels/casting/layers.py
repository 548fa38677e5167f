# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The next surface behind a visible one, along the same ray."""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.rays import (
    CUDA_REGISTERS,
    RayHit,
    RayRange,
    object_frame,
    trace_ray,
    write_images,
)
from warpvis.kernels.casting.triangle_scene import (
    TriangleScene,
    face_of,
    factors_of,
    mesh_of,
    object_of,
    stretched_corner,
)
from warpvis.kernels.casting.worlds import Worlds, world_of
from warpvis.kernels.pinhole import Frame, Window, frame_of, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

GAP = wp.constant(wp.float64(2.0e-5))
"""Minimum distance between two surfaces along a ray, times depth if that is above 1 m [m]."""
STEEP_GAP = wp.constant(wp.float64(2.0e-3))
"""The same if a ray meets the same triangle again: the depth of triangles seen edge-on is less exact in a query."""

RETRIES = wp.constant(3)


@wp.struct
class FrontSurfaces:
    """The surfaces in front of those to find."""

    points: wp.array3d[wp.vec3]
    segmentation: wp.array3d[wp.int32]
    faces: wp.array3d[wp.int32]
    clear: wp.array3d[wp.vec2]
    """0 where nothing behind them is visible."""


@wp.func
def is_seen_from_behind(scene: TriangleScene, worlds: Worlds, view: int, hit: RayHit) -> bool:
    """Return whether a hit is on the back of a triangle."""
    if hit.face < 0 or hit.round:
        return False
    world = int(0)
    direction = wp.float64(1.0) * hit.direction
    if hit.movable >= 0:
        world = world_of(worlds, view)
        direction = wp.quat_rotate_inv(object_frame(scene, worlds, world, hit.movable).rotation, hit.direction)
    mesh, factors = mesh_of(scene, hit.movable), factors_of(scene, worlds, world, hit.movable)
    a = stretched_corner(mesh, hit.face, 0, factors)
    b, c = stretched_corner(mesh, hit.face, 1, factors), stretched_corner(mesh, hit.face, 2, factors)
    return wp.dot(wp.cross(b - a, c - a), direction) > wp.float64(0.0)


@wp.func
def gap_behind_same(scene: TriangleScene, worlds: Worlds, view: int, hit: RayHit, index: int, face: int) -> wp.float64:
    """Return the gap after which a ray goes on if it meets the surface in front again; 0 if it meets another one.

    Behind the true surface of a solid are the front faces of its triangles, which represent its inside.
    """
    if hit.face < 0 or object_of(scene, hit.movable, hit.face) != index:
        return wp.float64(0.0)
    if face_of(scene, hit.movable, hit.face) != face:
        return wp.float64(0.0)
    if face >= 0:
        return STEEP_GAP
    if is_seen_from_behind(scene, worlds, view, hit):
        return wp.float64(0.0)
    return GAP


@wp.func
def cast_behind(
    scene: TriangleScene,
    camera: RayRange,
    eye: Frame,
    local: wp.vec3d,
    worlds: Worlds,
    view: int,
    cull_backfaces: bool,
    index: int,
    face: int,
) -> RayHit:
    """Cast a ray of a camera on, behind a point `local` of the camera frame on a face of an object."""
    depth = wp.length(local)
    if camera.is_planar:
        depth = local[2]
    ray = local / wp.max(depth, wp.float64(1.0e-30))
    behind = camera
    behind.near = float(0.0)
    behind.clip = float(depth + GAP * wp.max(depth, wp.float64(1.0)))
    hit = trace_ray(scene, behind, eye, worlds, worlds, view, ray, cull_backfaces)
    for _ in range(RETRIES):
        gap = gap_behind_same(scene, worlds, view, hit, index, face)
        if gap > wp.float64(0.0):
            depth = wp.max(depth, wp.float64(hit.depth))
            behind.clip = float(depth + gap * wp.max(depth, wp.float64(1.0)))
            hit = trace_ray(scene, behind, eye, worlds, worlds, view, ray, cull_backfaces)
    return hit


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_layer(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: RayRange,
    is_parallel: bool,
    origins_in: wp.array2d[wp.vec3d],
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    cull_backfaces: bool,
    front: FrontSurfaces,
    # Out:
    images_out: Images,
    is_back_out: wp.array3d[wp.uint8],
):
    """Write the surfaces behind those of `front`, and whether they are seen from behind; the object -2 if not needed.

    Rays are the camera's: parallel to its axis, from origins of the camera frame, (y, x), or else from its center.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    if front.clear[view, y, x][0] == 0.0:
        images_out.segmentation[view, y, x] = -2
        return
    eye = frame_of(camera_to_world[view])
    local = wp.quat_rotate_inv(eye.rotation, wp.vec3d(front.points[view, y, x]) - eye.origin)
    if is_parallel:
        aside = wp.vec3d(local[0], local[1], wp.float64(0.0))
        eye.origin = eye.origin + wp.quat_rotate(eye.rotation, aside)
        local = local - aside
    elif origins_in:
        local = local - origins_in[y, x]
        eye.origin = eye.origin + wp.quat_rotate(eye.rotation, origins_in[y, x])
    index, face = front.segmentation[view, y, x], front.faces[view, y, x]
    hit = cast_behind(scene, camera, eye, local, worlds, view, cull_backfaces, index, face)
    write_images(scene, eye.origin, worlds, worlds, view, hit, view, y, x, images_out)
    is_back_out[view, y, x] = wp.uint8(wp.where(is_seen_from_behind(scene, worlds, view, hit), 1, 0))
