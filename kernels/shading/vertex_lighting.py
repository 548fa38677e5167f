# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of visible surfaces with light at vertices, interpolated between them, as in the fixed-function pipeline."""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.shading.base_colors import DeviceMaterials, Footprint
from warpvis.kernels.shading.lighting import Lights

wp.set_module_options(pixel_options("shared/vertex_lighting.h", fused=True))  # colors are rounded to 8 bits


@wp.func_native(
    """
const auto images = warpvis::surface_images(points_in, segmentation_in, faces_in, &normals_in, view, y);
auto row = warpvis::color_row(appearance, worlds, images, footprint, camera_to_world, color_out);
warpvis::vertex_lit_colors<warpvis::PixelNumbers>(row, x, lights, shadows_in);
"""
)
def shade_vertex_lit_color_row(
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


@wp.kernel(cuda_max_registers=96)  # more would leave room for fewer blocks on a multiprocessor
def shade_vertex_lit_colors(
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
    """Write lit colors on a GPU, as `lighting.shade_lit_colors`; see `vertex_color_rows` for CPU cores."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    shade_vertex_lit_color_row(
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
