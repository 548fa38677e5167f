# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Random numbers of pixels on CPU cores, as in `warpvis.kernels.sensors.random_numbers`, for 64 pixels at a time."""

import warp as wp

from warpvis.kernels.constants import CPU_LANES
from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import Window

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

PIXELS_AT_ONCE = 4 * CPU_LANES
"""Four words of random numbers per lane."""

LANE_HEADERS = (
    "shared/constants.h",
    "cpu/lanes.h",
    "cpu/number_lanes.h",
    "shared/random.h",
    "cpu/random_lanes.h",
)


@wp.func_native(
    read_native(*LANE_HEADERS)
    + """
const int width = normals_out.shape[2];
float* row = normals_out.data + ((long long)view * normals_out.shape[1] + y) * width;
const PixelWords words = PixelWords::draw(RandomKey{seed, draw[0], draw[1]}, stream, y, x);
for (int k = 0; k < PixelWords::WORDS && x < width; ++k, x += LANES)
    Numbers::store(row + x, Random::normal(words.block[k]), width - x);
"""
)
def draw_normals_from(
    draw: wp.vec2ui,
    seed: wp.uint32,
    stream: wp.uint32,
    view: int,
    y: int,
    x: int,
    normals_out: wp.array3d[float],
): ...


@wp.kernel
def draw_normal_rows(
    window: Window,
    # In:
    draws: wp.array[wp.vec2ui],
    seed: wp.uint32,
    stream: wp.uint32,
    # Out:
    normals_out: wp.array3d[float],
):
    """Write a standard normal number for every pixel; each thread of the kernel takes `PIXELS_AT_ONCE` of a row."""
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row
    draw_normals_from(draws[view], seed, stream, view, y, x * PIXELS_AT_ONCE, normals_out)
