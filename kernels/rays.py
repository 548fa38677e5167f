# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``rays`` caster: one thread a pixel, one ``wp.mesh_query_ray`` a thread; the reference on both devices.

The tree only finds the triangle. Its depth comes from the triangle's plane in double precision, because single
precision loses up to a millimetre where a large triangle is seen at a grazing angle.
"""

import warp as wp

from warpvis.kernels.pinhole import (
    PinholeCamera,
    Window,
    forward_axis,
    image_ray,
    pixel_ray,
    pose_origin,
    pose_rotation,
)

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

# Spilling some of what is computed after a hit is faster than fewer threads on a multiprocessor: by 15 to 21 % (H200).
CUDA_REGISTERS = 64


@wp.struct
class TriangleScene:
    """All triangles of a scene in the world frame, and what each belongs to."""

    mesh: wp.uint64
    triangle_object: wp.array[wp.int32]
    object_label: wp.array[wp.uint8]


@wp.func
def corner(mesh: wp.uint64, triangle: int, k: int) -> wp.vec3d:
    return wp.vec3d(wp.mesh_get_point(mesh, triangle * 3 + k))


@wp.func
def plane_depth(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, direction: wp.vec3d, forward: wp.vec3d) -> wp.float64:
    """Depth at which a ray from the origin meets a triangle that it is known to hit.

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


@wp.func
def first_front_face(mesh: wp.uint64, origin: wp.vec3, direction: wp.vec3, nearest: wp.MeshQueryRay) -> wp.MeshQueryRay:
    """The first hit whose triangle faces the camera: past every back face the ray goes on from just behind it."""
    hit = nearest
    passed = float(0.0)
    while hit.result and wp.dot(wp.mesh_eval_face_normal(mesh, hit.face), direction) >= 0.0:
        passed += wp.max(hit.t, 0.0) + 1.0e-6 * wp.max(1.0, passed)
        hit = wp.mesh_query_ray(mesh, origin + passed * direction, direction, 3.0e38)
    return hit


@wp.struct
class Seen:
    """What a ray meets: depth, and the triangle where it lies between near and far, -1 elsewhere."""

    depth: float
    face: int
    direction: wp.vec3d


@wp.func
def nothing() -> Seen:
    seen = Seen()
    seen.depth = wp.inf
    seen.face = -1
    return seen


@wp.func
def look(scene: TriangleScene, camera: PinholeCamera, pose: wp.transform, ray: wp.vec3d, cull_backfaces: bool) -> Seen:
    """What a camera at a pose sees along a ray, given in the camera's frame with z = 1."""
    rotation = pose_rotation(pose)
    seen = nothing()
    seen.direction = wp.quat_rotate(rotation, ray)
    origin, direction = wp.transform_get_translation(pose), wp.vec3(seen.direction)

    # A whole-range query: what lies beyond `far` is sorted out below, by the exact depth.
    hit = wp.mesh_query_ray(scene.mesh, origin, direction, 3.0e38)
    if cull_backfaces:
        hit = first_front_face(scene.mesh, origin, direction, hit)
    if hit.result:
        exact_origin = pose_origin(pose)
        a = corner(scene.mesh, hit.face, 0) - exact_origin
        b = corner(scene.mesh, hit.face, 1) - exact_origin
        c = corner(scene.mesh, hit.face, 2) - exact_origin
        seen.depth = float(plane_depth(a, b, c, seen.direction, forward_axis(rotation)))
        if seen.depth < camera.near:
            seen.depth = -wp.inf
        elif seen.depth > camera.far:
            seen.depth = wp.inf
        else:
            seen.face = hit.face
    return seen


@wp.func
def normal_of(mesh: wp.uint64, face: int, direction: wp.vec3d) -> wp.vec3:
    """Unit normal of a triangle, against the direction from which it is seen."""
    a = corner(mesh, face, 0)
    facing = wp.cross(corner(mesh, face, 1) - a, corner(mesh, face, 2) - a)
    if wp.dot(facing, direction) > wp.float64(0.0):
        facing = -facing
    return wp.vec3(wp.normalize(facing))


@wp.func
def write(
    scene: TriangleScene,
    pose: wp.transform,
    seen: Seen,
    view: int,
    y: int,
    x: int,
    depth_out: wp.array3d[float],
    points_out: wp.array3d[wp.vec3],
    normals_out: wp.array3d[wp.vec3],
    labels_out: wp.array3d[wp.uint8],
    objects_out: wp.array3d[wp.int32],
):
    """Write to the images that were asked for; the others are None."""
    if depth_out:
        depth_out[view, y, x] = seen.depth
    if points_out:
        point = wp.vec3(wp.nan, wp.nan, wp.nan)
        if seen.face >= 0:
            point = wp.vec3(pose_origin(pose) + wp.float64(seen.depth) * seen.direction)
        points_out[view, y, x] = point
    if normals_out:
        normal = wp.vec3(wp.nan, wp.nan, wp.nan)
        if seen.face >= 0:
            normal = normal_of(scene.mesh, seen.face, seen.direction)
        normals_out[view, y, x] = normal
    if labels_out or objects_out:
        index = int(-1)
        label = wp.uint8(0)
        if seen.face >= 0:
            index = scene.triangle_object[seen.face]
            label = scene.object_label[index]
        if labels_out:
            labels_out[view, y, x] = label
        if objects_out:
            objects_out[view, y, x] = index


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_rays(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    cull_backfaces: bool,
    # Out:
    depth_out: wp.array3d[float],
    points_out: wp.array3d[wp.vec3],
    normals_out: wp.array3d[wp.vec3],
    labels_out: wp.array3d[wp.uint8],
    objects_out: wp.array3d[wp.int32],
):
    """Write the asked-for images (an output that is None is skipped) of every view."""
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row

    pose = camera_to_world[view]
    seen = look(scene, camera, pose, pixel_ray(camera, y, x), cull_backfaces)
    write(scene, pose, seen, view, y, x, depth_out, points_out, normals_out, labels_out, objects_out)


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_rays_at(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    pixels_in: wp.array3d[wp.vec2],
    cull_backfaces: bool,
    # Out:
    depth_out: wp.array3d[float],
    points_out: wp.array3d[wp.vec3],
    normals_out: wp.array3d[wp.vec3],
    labels_out: wp.array3d[wp.uint8],
    objects_out: wp.array3d[wp.int32],
):
    """The same through any points of the image; all arrays are (view, 1, point). Outside the image nothing is seen."""
    view, row, point = wp.tid()
    view += window.first_view
    row += window.first_row

    at = pixels_in[view, row, point]
    pose = camera_to_world[view]
    seen = nothing()
    if at[0] >= 0.0 and at[0] < camera.width and at[1] >= 0.0 and at[1] < camera.height:
        seen = look(scene, camera, pose, image_ray(camera, at), cull_backfaces)
    write(scene, pose, seen, view, row, point, depth_out, points_out, normals_out, labels_out, objects_out)
