# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images wider than a pinhole's: one thread a pixel, one ray of unit length a thread, so that depth is its length.

With u and v the place of a pixel's centre from the image's middle, from -1/2 to 1/2 across and down it:

* cylindrical: azimuth ``u hfov`` to the right, elevation ``v hfov height / width`` downwards: equal angles;
* spherical: an equidistant fisheye. The angle from the axis is ``hfov sqrt(u^2 + v^2)``.
"""

import warp as wp

from warpvis.kernels.images import Images
from warpvis.kernels.pinhole import Window
from warpvis.kernels.rays import CUDA_REGISTERS, look, write
from warpvis.kernels.triangle_scene import TriangleScene, camera_frame
from warpvis.kernels.worlds import Worlds

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class WideCamera:
    """Image size [px], horizontal field of view [rad], projection, and range of lengths [m]."""

    width: int
    height: int
    hfov: wp.float64
    is_spherical: bool
    near: float
    far: float


@wp.func
def wide_ray(camera: WideCamera, y: int, x: int) -> wp.vec3d:
    """Unit vector of the camera's frame through a pixel's centre."""
    half, width, height = wp.float64(0.5), wp.float64(camera.width), wp.float64(camera.height)
    u = (wp.float64(x) + half) / width - half
    v = (wp.float64(y) + half) / height - half
    if camera.is_spherical:
        radius = wp.sqrt(u * u + v * v)
        if radius == wp.float64(0.0):
            return wp.vec3d(radius, radius, wp.float64(1.0))
        scale = wp.sin(radius * camera.hfov) / radius
        return wp.vec3d(scale * u, scale * v, wp.cos(radius * camera.hfov))
    azimuth = u * camera.hfov
    down = v * camera.hfov * height / width
    return wp.vec3d(wp.cos(down) * wp.sin(azimuth), wp.sin(down), wp.cos(down) * wp.cos(azimuth))


@wp.kernel(cuda_max_registers=CUDA_REGISTERS)
def cast_wide_rays(
    # Scene:
    scene: TriangleScene,
    # Cameras:
    camera: WideCamera,
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

    eye = camera_frame(camera_to_world[view])
    ray = wide_ray(camera, y, x)
    seen = look(scene, camera.near, camera.far, eye, worlds, view, ray, False, 0.0, cull_backfaces)
    write(scene, eye.origin, worlds, view, seen, view, y, x, images_out)
