# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Kinect noise of Handa's simkinect: lateral jitter, window-based detection of dots, quantized disparity.

Disparities are integers in 1/8 px throughout, so that sums over windows are exact in any order.
"""

import warp as wp

from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.sensors.noise import MeasuredImages, SensorInputs

wp.set_module_options(pixel_options("shared/simkinect.h", cpu=("cpu/dot_rows.h",)))


@wp.struct
class SimKinectModel:
    """The parameters of `warpvis.sensors.SimKinect`."""

    disparity_scale: float  # f b [px m]
    shift: float
    units: float  # per meter
    sigma: float


@wp.func_native("warpvis::measure<warpvis::LevelShift>(warpvis::sensor_row(inputs, view, y), x, model, levels_out);")
def shift_pixels(
    model: SimKinectModel,
    inputs: SensorInputs,
    view: int,
    y: int,
    x: int,
    levels_out: wp.array3d[int],
): ...


@wp.kernel
def shift_to_levels(
    window: Window,
    # In:
    model: SimKinectModel,
    inputs: SensorInputs,
    # Out:
    levels_out: wp.array3d[int],
):
    """Write disparity in levels from bilinear depth at a randomly shifted position; 0 where there is no depth."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    shift_pixels(model, inputs, view, y, x, levels_out)


@wp.func_native("warpvis::detect_dot(dots, pixel, words, levels, view, detected_out);")
def detect_dot(
    dots: wp.array2d[wp.uint8],
    pixel: int,
    words: wp.vec3ui,
    levels: wp.array3d[int],
    view: int,
    detected_out: wp.array3d[int],
): ...


@wp.func_native("warpvis::detect_dots<warpvis::PixelNumbers>(dots, levels, view, y, x, detected_out);")
def detect_pixels(
    dots: wp.array2d[wp.uint8], levels: wp.array3d[int], view: int, y: int, x: int, detected_out: wp.array3d[int]
): ...


@wp.kernel
def detect_dots(
    window: Window,
    # In:
    dots: wp.array2d[wp.uint8],
    pixels: wp.array[wp.int32],
    words: wp.array[wp.vec3ui],
    levels: wp.array3d[int],
    # Out:
    detected_out: wp.array3d[int],
):
    """Write levels at detected dots, whose window receives enough light from dots near its mean; 0 elsewhere.

    Windows exclude the image's last row and column, as in simkinect. If `pixels` is not None, thread x detects the dot
    at that pixel, and does not write 0; `words` are the bits of the dots in its window, three rows in a word.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    if pixels:
        detect_dot(dots, pixels[x], words[x], levels, view, detected_out)
        return
    detect_pixels(dots, levels, view, y, x, detected_out)


@wp.func_native(
    """
const auto row = warpvis::sensor_row(inputs, images_out, view, y);
warpvis::measure<warpvis::DotFill>(row, x, model, detected, nearest, words);
"""
)
def fill_pixels(
    model: SimKinectModel,
    inputs: SensorInputs,
    detected: wp.array3d[int],
    nearest: wp.array[wp.vec2i],
    words: wp.array2d[wp.uint32],
    view: int,
    y: int,
    x: int,
    images_out: MeasuredImages,
): ...


@wp.kernel
def fill_from_dots(
    window: Window,
    # In:
    model: SimKinectModel,
    inputs: SensorInputs,
    detected: wp.array3d[int],
    nearest: wp.array[wp.vec2i],
    words: wp.array2d[wp.uint32],
    # Out:
    images_out: MeasuredImages,
):
    """Write the depth of the nearest detected dot, as quantized disparity with noise.

    `nearest` contains column and row offsets by increasing distance; equal distances are in row-major order. `words`
    are the bits of those at which dots can be detected, by pixel, for GPUs; None if unknown.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    fill_pixels(model, inputs, detected, nearest, words, view, y, x, images_out)
