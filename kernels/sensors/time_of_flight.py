# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Time-of-flight depth from the phase of modulated light: the return of each pixel, and the measured range.

Phases are in cycles, computed in double precision by polynomials, so that all devices agree.
"""

import warp as wp

from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.sensors.noise import MeasuredImages, SensorInputs
from warpvis.kernels.sensors.sub_rays import SUB_RAYS, TILE_PIXELS

wp.set_module_options(pixel_options("shared/sub_rays.h"))


@wp.struct
class FlightModel:
    """Parameters of a sensor. The unit of light is the return of a white surface at 1 m at normal incidence."""

    frequencies: int  # number of modulation frequencies
    turns: wp.vec3d  # phase cycles per meter of range, in descending order; 0 for unused frequencies
    unambiguous: wp.float64  # range at which all phases repeat [m]
    laps: int  # cycles of the first frequency in the unambiguous range
    noise_scale: float  # standard deviation of the range if light and amplitude are 1, without background [m]
    background: float
    min_signal: float
    max_signal: float
    min_coherence: float
    offset: wp.float64  # [m]
    wiggle: wp.float64  # [m]
    wiggle_turns: wp.float64  # phase of the wiggling error at range 0 [cycles]
    slots: wp.array3d[wp.int32]  # number of an edge pixel with sub-rays, -1 for other pixels; None without sub-rays
    mixes: wp.array2d[wp.vec4]  # the output of `mix_sub_rays`


@wp.func_native(
    """
const auto map = warpvis::SubRayMap::of(depth, normals, segmentation, view, tile);
const int* numbers = &pixels.data[(long long)view * pixels.shape[1] + number];
const int count = counts.data ? counts.data[view] - number : warpvis::SUB_RAYS;
warpvis::mix_sub_rays(model, inputs, axes, map, numbers, count, index, &mixes_out.data[numbers - pixels.data]);
"""
)
def mix_pixels(
    model: FlightModel,
    inputs: SensorInputs,
    axes: wp.mat33,
    pixels: wp.array2d[wp.int32],
    counts: wp.array[wp.int32],
    depth: wp.array3d[float],
    normals: wp.array3d[wp.vec3],
    segmentation: wp.array3d[wp.int32],
    view: int,
    number: int,
    tile: int,
    index: int,
    mixes_out: wp.array2d[wp.vec4],
): ...


@wp.kernel
def mix_sub_rays(
    # Cameras:
    axes: wp.array[wp.mat33],
    window: Window,
    # In:
    model: FlightModel,
    inputs: SensorInputs,
    pixels: wp.array2d[wp.int32],
    counts: wp.array[wp.int32],
    depth: wp.array3d[float],
    normals: wp.array3d[wp.vec3],
    segmentation: wp.array3d[wp.int32],
    first: int,
    step: int,
    # Out:
    mixes_out: wp.array2d[wp.vec4],
):
    """Write the sum of each edge pixel's phasors: range [m], amplitude, total light, amplitude at normal incidence.

    The range is +inf without returned light, and NaN if coherence is too low because the light is of several ranges.
    Nothing is written for pixel -1. On a CPU, a thread computes a tile of pixels. Images are maps of `place_sub_rays`
    or, if `counts` of edge pixels are not None, lists of `list_sub_rays`, of which a thread takes one in `step` tiles.
    """
    view, tile, index = wp.tid()
    view, tile = locate(window, view, tile)
    number = first + tile * TILE_PIXELS
    end = number + TILE_PIXELS
    if counts:
        end = wp.min(counts[view], first + depth.shape[2] // SUB_RAYS)
    while number + index < end:
        mix_pixels(
            model,
            inputs,
            axes[view],
            pixels,
            counts,
            depth,
            normals,
            segmentation,
            view,
            number,
            tile,
            index,
            mixes_out,
        )
        number += step * TILE_PIXELS
        tile += step


@wp.func_native("warpvis::measure<warpvis::Flight>(warpvis::sensor_row(inputs, images_out, view, y), x, model, axes);")
def measure_pixels(
    model: FlightModel,
    inputs: SensorInputs,
    axes: wp.mat33,
    view: int,
    y: int,
    x: int,
    images_out: MeasuredImages,
): ...


@wp.kernel(cuda_max_registers=64)
def measure_time_of_flight(
    # Cameras:
    axes: wp.array[wp.mat33],
    window: Window,
    # In:
    model: FlightModel,
    inputs: SensorInputs,
    # Out:
    images_out: MeasuredImages,
):
    """Write the measured depth of every pixel, and the reason for missing depth."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    measure_pixels(model, inputs, axes[view], view, y, x, images_out)
