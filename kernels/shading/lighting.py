# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of visible surfaces under the lights of a scene: ambient light, Lambert's law, and specular highlights.

Formulas are those of `warpvis.scene.lights.Light`, summed over the lights.
"""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.shading.base_colors import DeviceMaterials, Footprint

wp.set_module_options(pixel_options("shared/lighting.h", fused=True))  # colors are rounded to 8 bits


@wp.struct
class DeviceLight:
    """A light in the world frame; colors include its intensity and are in the space in which light is summed."""

    kind: int
    position: wp.vec3
    direction: wp.vec3
    color: wp.vec3
    ambient: wp.vec3
    specular: wp.vec3
    intensity: float
    falloff: int
    attenuation: wp.vec3
    reach: float
    inner_angle: float
    outer_angle: float
    cos_inner: float
    cos_outer: float
    exponent: float
    shadow: int  # its image in `shadows_in` of `shade_lit_colors`; -1 if nothing blocks it
    radius: float  # of its sphere [m]; of a directional light, the tangent of its angular radius
    first_sample: int  # of its points in `Lights.samples`
    sample_count: int  # number of points for each class of pixels; 0 for a hard shadow
    shadow_plane: bool  # whether it is directional and comes from the plane through its position


@wp.struct
class Lights:
    """All lights of a scene."""

    all: wp.array2d[DeviceLight]
    """(1 or world, light); (view, light) with `is_of_views`."""
    is_linear: bool  # whether light is summed in linear space, or else in display color space
    shadow_count: int  # number of lights that surfaces may block
    is_of_views: bool  # whether views have their own rows, instead of worlds, and colors are multiplied by `dimming`
    dimming: float  # factor of base colors and emission, but not of highlights
    samples: wp.array[wp.vec3]
    """Points of lights with a radius, of all classes of pixels: see `warpvis.scene.light_samples`."""
    occlusion: wp.array3d[wp.uint8]
    """Fraction of ambient light that reaches a pixel, (view, y, x), 255 for 1; None if all of it does."""
    is_at_vertices: bool
    """Whether light between vertices may come from lights out of whose reach or cone a point is; only for shadows."""


@wp.func_native(
    """
const auto images = warpvis::surface_images(points_in, segmentation_in, faces_in, &normals_in, view, y);
auto row = warpvis::color_row(appearance, worlds, images, footprint, camera_to_world, color_out);
row.lit_colors(x, lights, shadows_in);
"""
)
def shade_lit_color_row(
    appearance: DeviceMaterials,
    lights: Lights,
    footprint: Footprint,
    camera_to_world: wp.array[wp.transform],
    worlds: Worlds,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    faces_in: wp.array3d[wp.int32],
    normals_in: wp.array3d[wp.vec3],
    shadows_in: wp.array4d[wp.uint8],
    view: int,
    y: int,
    x: int,
    color_out: wp.array3d[wp.vec3ub],
): ...


@wp.kernel(cuda_max_registers=80)  # three blocks of 256 threads on a multiprocessor
def shade_lit_colors(
    # Scene:
    appearance: DeviceMaterials,
    lights: Lights,
    # Cameras:
    footprint: Footprint,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    faces_in: wp.array3d[wp.int32],
    normals_in: wp.array3d[wp.vec3],
    shadows_in: wp.array4d[wp.uint8],
    # Out:
    color_out: wp.array3d[wp.vec3ub],
):
    """Write lit colors of visible surfaces on a GPU, and the background elsewhere; see `color_rows` for CPU cores.

    `shadows_in` is the fraction of a light that reaches a pixel, (light, view, y, x), 255 for 1; None without shadows.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    shade_lit_color_row(
        appearance,
        lights,
        footprint,
        camera_to_world,
        worlds,
        points_in,
        segmentation_in,
        faces_in,
        normals_in,
        shadows_in,
        view,
        y,
        x,
        color_out,
    )
