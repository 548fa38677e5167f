# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors on CPU cores: the images of `base_colors` and `lighting` by one launch that is packed once."""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.rows import RowJob
from warpvis.kernels.shading.base_colors import DeviceMaterials, Footprint
from warpvis.kernels.shading.lighting import Lights

wp.set_module_options(pixel_options(cpu=("cpu/color_rows.h",), fused=True))


@wp.struct
class ColorCall:
    """The arguments of a launch, as of `lighting.shade_lit_colors`, in one struct that is modified between launches."""

    appearance: DeviceMaterials
    lights: Lights
    is_lit: int  # whether to write lit colors, or else base colors
    footprint: Footprint
    camera_to_world: wp.array[wp.transform]
    worlds: Worlds
    points: wp.array3d[wp.vec3]
    segmentation: wp.array3d[wp.int32]
    faces: wp.array3d[wp.int32]
    normals: wp.array3d[wp.vec3]
    shadows: wp.array4d[wp.uint8]
    job: RowJob


@wp.struct
class ColorImages:
    """The images of a launch."""

    color: wp.array3d[wp.vec3ub]


@wp.func_native("warpvis::shade_rows(calls.data[0], images_out.data[0]);")
def shade_rows_of(calls: wp.array[ColorCall], images_out: wp.array[ColorImages]): ...


@wp.kernel
def shade_color_rows(
    # In:
    calls: wp.array[ColorCall],
    # Out:
    images_out: wp.array[ColorImages],
):
    """Write the colors of one call; each array contains one element. Every worker launches this kernel."""
    _ = wp.tid()
    shade_rows_of(calls, images_out)
