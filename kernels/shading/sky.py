# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The sky: colors of pixels without a surface, by the directions of their rays, and haze at the horizon of the ground.

Images of a sky are filtered between texels and between mip levels, by the footprint of the pixel, as in OpenGL (OpenGL
4.6 core specification, 8.14), and across the edges of cube maps (8.13.1).
"""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import PinholeCamera, Window, locate
from warpvis.kernels.shading.base_colors import Footprint
from warpvis.kernels.shading.textures import DeviceTexture

wp.set_module_options(pixel_options("shared/sky.h", fused=True))  # colors are rounded to 8 bits


@wp.struct
class Haze:
    """Haze between the ground and the sky; see `warpvis.scene.lights.Haze`."""

    color: wp.vec3
    radius: float  # horizontal distance of the sky from the camera [m]; 0 without haze
    width: float
    peak: float  # height of the densest haze, from the ground (0) to the horizon (1)
    position: wp.vec3
    normal: wp.vec3
    sky_normal: wp.vec3  # the normal in the frame of the sky


@wp.struct
class Sky:
    """A sky at infinity; see `warpvis.scene.lights.Background`."""

    rotation: wp.mat33  # from the world to the frame of the sky
    is_absent: bool  # whether nothing is painted
    is_cube: bool  # whether it has the six images of a cube map, or else a panorama
    is_gradient: bool
    is_linear: bool  # whether its values are linear light
    is_light: bool  # whether its texels are linear light in half precision, or else RGBA bytes
    texture: DeviceTexture
    """The layout of its images, which are one below the other."""
    texels: wp.array[wp.uint32]
    """Texels of all mip levels, as `warpvis.scene._mip_levels.pack_texels` returns them; None for a gradient."""
    level_first: wp.array[wp.int32]
    """(level): index of its first texel."""
    colors: wp.array[wp.vec3]
    """Colors of a gradient, at equal steps from straight up to straight down."""
    haze: Haze


@wp.func_native(
    """
const auto& sky = warpvis::sky_of(skies, world_sky, worlds, view);
if (sky.is_absent) return;
const auto images = warpvis::surface_images(points_in, segmentation_in, segmentation_in, &points_in, view, y);
warpvis::sky_row(sky, camera, footprint, camera_to_world, rays_in, pixels_in, images, y)
    .paint(x, (unsigned char*)color_out.data);
"""
)
def paint_pixel(
    skies: wp.array[Sky],
    world_sky: wp.array[wp.int32],
    worlds: Worlds,
    camera: PinholeCamera,
    footprint: Footprint,
    camera_to_world: wp.array[wp.transform],
    rays_in: wp.array3d[wp.vec3d],
    pixels_in: wp.array3d[wp.vec2],
    segmentation_in: wp.array3d[wp.int32],
    points_in: wp.array3d[wp.vec3],
    view: int,
    y: int,
    x: int,
    color_out: wp.array3d[wp.vec3ub],
): ...


@wp.kernel
def paint_sky(
    # Scene:
    skies: wp.array[Sky],
    world_sky: wp.array[wp.int32],
    worlds: Worlds,
    # Cameras:
    camera: PinholeCamera,
    footprint: Footprint,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    rays_in: wp.array3d[wp.vec3d],
    pixels_in: wp.array3d[wp.vec2],
    segmentation_in: wp.array3d[wp.int32],
    points_in: wp.array3d[wp.vec3],
    # Out:
    color_out: wp.array3d[wp.vec3ub],
):
    """Paint the sky on a GPU where no surface is visible, and haze in front of distant ground; see `sky_rows`.

    The first sky is that of the scene. `world_sky` is each world's sky among the following ones, (1 or world), -1 for
    that of the scene; or None if all have that of the scene.
    `rays_in` are rays of the camera frame, (view or 1, y, x), or None for a pinhole and for parallel rays; `pixels_in`
    are image points of a pinhole [px], or None for pixel centers. Pixels without a ray and those of the object -2 are
    left as they are.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    paint_pixel(
        skies,
        world_sky,
        worlds,
        camera,
        footprint,
        camera_to_world,
        rays_in,
        pixels_in,
        segmentation_in,
        points_in,
        view,
        y,
        x,
        color_out,
    )
