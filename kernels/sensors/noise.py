# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""C++ and functions shared by noise models of depth: the row of an image that a thread measures, and range limits."""

import warp as wp

from warpvis.kernels.native_source import read_native
from warpvis.kernels.sensors.random_numbers import PIXEL_NUMBERS, RANDOM_HEADERS

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

NOISE = PIXEL_NUMBERS + read_native("shared/noise.h")


def noise_row(true_depth: str = "true_depth", sensor_range: str = "camera") -> str:
    """Return C++ that defines the row ``y`` of a view, from the names of its true depth and of the sensor's range."""
    return f"""
const int height = depth_out.shape[1], width = depth_out.shape[2];
const long long view_place = (long long)view * height * width, first = view_place + (long long)y * width;
const SensorRange range = {{{sensor_range}.near, {sensor_range}.far}};
const NoiseRow row = {{width, y, {{model.seed, draw[0], draw[1]}},
                      {true_depth}.data ? {true_depth}.data + first : nullptr, depth_out.data + first,
                      reasons_out.data ? reasons_out.data + first : nullptr}};
"""


_RANGE = read_native("shared/constants.h", *RANDOM_HEADERS, "shared/random_pixel.h", "shared/noise.h")


@wp.func_native(_RANGE + "return SensorRange{near, far}.report(depth);")
def limit_depth(near: float, far: float, depth: float) -> float: ...


@wp.func_native(_RANGE + "return SensorRange::reason(depth);")
def range_reason(depth: float) -> int: ...
