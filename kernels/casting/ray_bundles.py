# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images with an arbitrary ray per pixel, from a ray bundle: one thread per pixel, as in `kernels.casting.rays`."""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.rays import CUDA_REGISTERS, RayRange, no_hit, trace_ray, write_images
from warpvis.kernels.casting.triangle_scene import TriangleScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.pinhole import Window, frame_of, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_ray_table(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: RayRange,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    rays_in: wp.array3d[wp.vec3d],
    origins_in: wp.array2d[wp.vec3d],
    cull_backfaces: bool,
    # Out:
    images_out: Images,
):
    """Write the requested images (None is skipped) of every view.

    `rays_in` are directions in the camera frame, (view, y, x), or (1, y, x) for all views; NaN rays hit nothing.
    `origins_in` are their origins in that frame, (y, x); None for the frame's origin.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    eye = frame_of(camera_to_world[view])
    if origins_in:
        eye.origin += wp.quat_rotate(eye.rotation, origins_in[y, x])
    ray = rays_in[wp.min(view, rays_in.shape[0] - 1), y, x]
    hit = no_hit()
    if ray[2] == ray[2]:
        hit = trace_ray(scene, camera, eye, worlds, worlds, view, ray, cull_backfaces)
    write_images(scene, eye.origin, worlds, worlds, view, hit, view, y, x, images_out)
