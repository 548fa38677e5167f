# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth by triangulation on CPU cores: the model of `warpvis.kernels.stereo`, sixteen pixels at a time."""

import warp as wp

from warpvis.kernels.constants import CPU_LANES
from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import Window
from warpvis.kernels.stereo import MEASURE, STEREO_HEADERS, OtherEye, StereoModel, StereoViews

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

_HEADERS = (
    "shared/constants.h",
    "cpu/lanes.h",
    "cpu/number_lanes.h",
    "shared/random.h",
    "cpu/random_lanes.h",
)
PIXELS_AT_ONCE = 4 * CPU_LANES
"""Four words of random numbers, for each lane."""


@wp.func_native(read_native(*_HEADERS, *STEREO_HEADERS) + MEASURE)
def measure_pixels(
    model: StereoModel,
    given: StereoViews,
    eye: OtherEye,
    draw: wp.vec2ui,
    view: int,
    y: int,
    x: int,
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
): ...


@wp.kernel
def measure_stereo_rows(
    # Cameras:
    eyes: wp.array[OtherEye],
    window: Window,
    # In:
    model: StereoModel,
    given: StereoViews,
    # Out:
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
):
    """Write the same on CPU cores, `PIXELS_AT_ONCE` pixels of a row a thread of the kernel."""
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row
    measure_pixels(model, given, eyes[view], given.draws[view], view, y, x * PIXELS_AT_ONCE, depth_out, reasons_out)
