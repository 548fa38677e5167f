# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Single rays of a bundle on a GPU, of scenes without movable objects and instances.

The threads of a block cast rays of similar directions. Results are those of `cast_ray_table`, to the last bit, but the
kernel keeps nothing in registers during the query, and leaves rays with a hit closer than `CLOSE`, which may have to
ignore it, to a second launch: the code for those takes shared memory that caches the tree otherwise.
"""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.rays import CUDA_REGISTERS, FARTHEST, RayRange, measure, no_hit, trace_ray, write_images
from warpvis.kernels.casting.triangle_scene import CLOSE, TriangleScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.pinhole import Frame, frame_of

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class SortedRays:
    """A ray bundle, sorted by direction."""

    place: wp.array[wp.int32]  # index in the table of the camera
    rays: wp.array[wp.vec3d]  # in the camera frame; NaN rays hit nothing
    origins: wp.array[wp.vec3d]  # in that frame; None for the frame's origin
    width: int  # of the table


@wp.struct
class CloseRays:
    """Rays with a hit closer than `CLOSE`."""

    count: wp.array[wp.int32]  # number of rays, which may exceed the length of the list
    rays: wp.array[wp.int32]  # view times the number of sorted rays, plus index of the sorted ray


@wp.func_native('asm volatile("" ::: "memory");')
def forget_memory():
    """Make the compiler load values again instead of keeping them in registers."""
    ...


@wp.func
def eye_of(camera_to_world: wp.array[wp.transform], view: int, rays: SortedRays, ray: int) -> Frame:
    """Return the pose of a view with the origin of a ray."""
    eye = frame_of(camera_to_world[view])
    if rays.origins:
        eye.origin += wp.quat_rotate(eye.rotation, rays.origins[ray])
    return eye


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_sorted_rays(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: RayRange,
    camera_to_world: wp.array[wp.transform],
    # In:
    worlds: Worlds,
    rays_in: SortedRays,
    # Out:
    close_out: CloseRays,
    images_out: Images,
):
    """Write the requested images (None is skipped) of every view, except for close rays, which are listed.

    `close_out.count` must be 0 before.
    """
    view, i = wp.tid()

    ray = rays_in.rays[i]
    origin, direction = wp.vec3(), wp.vec3()
    max_t = float(0.0)
    if ray[2] == ray[2]:
        eye = eye_of(camera_to_world, view, rays_in, i)
        origin, direction = wp.vec3(eye.origin), wp.vec3(wp.quat_rotate(eye.rotation, ray))
        max_t = float(FARTHEST)
    found = wp.mesh_query_ray(scene.mesh, origin, direction, max_t)
    if found.result and found.t < CLOSE:
        k = wp.atomic_add(close_out.count, 0, 1)
        if k < close_out.rays.shape[0]:
            close_out.rays[k] = view * rays_in.rays.shape[0] + i
        return

    forget_memory()
    hit = no_hit()
    eye = eye_of(camera_to_world, view, rays_in, i)
    if found.result:
        ray = rays_in.rays[i]
        hit.face = found.face
        hit.direction = wp.quat_rotate(eye.rotation, ray)
        hit = measure(scene, worlds, 0, eye, camera, ray, hit)
    place = rays_in.place[i]
    y = place / rays_in.width
    write_images(scene, eye.origin, worlds, worlds, view, hit, view, y, place - y * rays_in.width, images_out)


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_close_rays(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: RayRange,
    camera_to_world: wp.array[wp.transform],
    # In:
    worlds: Worlds,
    rays_in: SortedRays,
    close_in: CloseRays,
    threads: int,
    # Out:
    images_out: Images,
):
    """Write the images of close rays, or of all rays if more are close than are listed, by a number of threads."""
    k = wp.tid()
    rays = rays_in.rays.shape[0]
    is_listed = close_in.count[0] <= close_in.rays.shape[0]
    count = wp.where(is_listed, close_in.count[0], camera_to_world.shape[0] * rays)
    while k < count:
        index = k
        if is_listed:
            index = close_in.rays[k]
        view = index / rays
        i = index - view * rays
        eye = eye_of(camera_to_world, view, rays_in, i)
        hit = no_hit()
        if rays_in.rays[i][2] == rays_in.rays[i][2]:
            hit = trace_ray(scene, camera, eye, worlds, worlds, view, rays_in.rays[i], False)
        place = rays_in.place[i]
        y = place / rays_in.width
        write_images(scene, eye.origin, worlds, worlds, view, hit, view, y, place - y * rays_in.width, images_out)
        k += threads
