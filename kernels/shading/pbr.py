# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of visible surfaces, some of which have metallic and roughness: `lighting` with appendix B of glTF 2.0."""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.shading.base_colors import DeviceMaterials, Footprint
from warpvis.kernels.shading.lighting import Lights

wp.set_module_options(pixel_options("shared/pbr.h", fused=True))


@wp.func_native(
    """
const auto images = warpvis::surface_images(points_in, segmentation_in, faces_in, &normals_in, view, y);
auto row = warpvis::pbr_row(appearance, worlds, images, footprint, camera_to_world, color_out);
row.lit_colors(x, lights, shadows_in);
"""
)
def shade_pbr_color_row(
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


@wp.kernel
def shade_pbr_colors(
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
    """Write lit colors on a GPU, as `lighting.shade_lit_colors`, of materials with a `PbrMaterial`."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    shade_pbr_color_row(
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
