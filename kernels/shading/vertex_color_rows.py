# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors on CPU cores with light at vertices: the images of `vertex_lighting`."""

import warp as wp

from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.shading.color_rows import ColorCall, ColorImages

wp.set_module_options(pixel_options(cpu=("cpu/vertex_color_rows.h",), fused=True))


@wp.func_native("warpvis::shade_vertex_rows(calls.data[0], images_out.data[0]);")
def shade_vertex_rows_of(calls: wp.array[ColorCall], images_out: wp.array[ColorImages]): ...


@wp.kernel
def shade_vertex_color_rows(
    # In:
    calls: wp.array[ColorCall],
    # Out:
    images_out: wp.array[ColorImages],
):
    """Write the lit colors of one call; each array contains one element. Every worker launches this kernel."""
    _ = wp.tid()
    shade_vertex_rows_of(calls, images_out)
