# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The sky on CPU cores: the pixels of `sky`, 16 at a time, by one launch that is packed once."""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import PinholeCamera
from warpvis.kernels.rows import RowJob
from warpvis.kernels.shading.base_colors import Footprint
from warpvis.kernels.shading.color_rows import ColorImages
from warpvis.kernels.shading.sky import Sky

wp.set_module_options(pixel_options(cpu=("cpu/sky_rows.h",), fused=True))


@wp.struct
class SkyCall:
    """The arguments of a launch, as of `sky.paint_sky`, in one struct that is modified between launches."""

    skies: wp.array[Sky]
    world_sky: wp.array[wp.int32]
    worlds: Worlds
    camera: PinholeCamera
    footprint: Footprint
    camera_to_world: wp.array[wp.transform]
    rays: wp.array3d[wp.vec3d]
    pixels: wp.array3d[wp.vec2]
    segmentation: wp.array3d[wp.int32]
    points: wp.array3d[wp.vec3]
    job: RowJob


@wp.func_native("warpvis::paint_sky_rows(calls.data[0], images_out.data[0]);")
def paint_rows_of(calls: wp.array[SkyCall], images_out: wp.array[ColorImages]): ...


@wp.kernel
def paint_sky_rows(
    # In:
    calls: wp.array[SkyCall],
    # Out:
    images_out: wp.array[ColorImages],
):
    """Paint the sky of one call; each array contains one element. Every worker launches this kernel."""
    _ = wp.tid()
    paint_rows_of(calls, images_out)
