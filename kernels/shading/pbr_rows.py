# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of `pbr` on CPU cores, as `color_rows`."""

import warp as wp

from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.shading.color_rows import ColorCall, ColorImages

wp.set_module_options(pixel_options("shared/pbr.h", cpu=("cpu/pbr_rows.h",), fused=True))


@wp.func_native("warpvis::shade_pbr_rows(calls.data[0], images_out.data[0]);")
def shade_pbr_rows_of(calls: wp.array[ColorCall], images_out: wp.array[ColorImages]): ...


@wp.kernel
def shade_pbr_rows(
    # In:
    calls: wp.array[ColorCall],
    # Out:
    images_out: wp.array[ColorImages],
):
    """Write the colors of one lit call; each array contains one element. Every worker launches this kernel."""
    _ = wp.tid()
    shade_pbr_rows_of(calls, images_out)
