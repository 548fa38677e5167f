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


@wp.func_native(
    """
warpvis::shift_to_levels(model, true_depth, normals_across, normals_down, view, y, x, levels_out);
"""
)
def shift_pixels(
    model: SimKinectModel,
    true_depth: wp.array3d[float],
    normals_across: wp.array3d[float],
    normals_down: wp.array3d[float],
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
    true_depth: wp.array3d[float],
    normals_across: wp.array3d[float],
    normals_down: wp.array3d[float],
    # Out:
    levels_out: wp.array3d[int],
):
    """Write disparity in levels from bilinear depth at a shifted position; 0 where there is no depth."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    shift_pixels(model, true_depth, normals_across, normals_down, view, y, x, levels_out)


@wp.func_native("warpvis::detect_dots<warpvis::PixelNumbers>(dots, levels, view, y, x, detected_out);")
def detect_pixels(
    dots: wp.array2d[wp.uint8], levels: wp.array3d[int], view: int, y: int, x: int, detected_out: wp.array3d[int]
): ...


@wp.kernel
def detect_dots(
    window: Window,
    # In:
    dots: wp.array2d[wp.uint8],
    levels: wp.array3d[int],
    # Out:
    detected_out: wp.array3d[int],
):
    """Write levels at detected dots, whose window receives enough light from dots near its mean; 0 elsewhere.

    Windows exclude the image's last row and column, as in simkinect.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    detect_pixels(dots, levels, view, y, x, detected_out)


@wp.func_native(
    """
const auto row = warpvis::sensor_row(inputs, images_out, view, y);
warpvis::measure<warpvis::DotFill>(row, x, model, detected, nearest, normals);
"""
)
def fill_pixels(
    model: SimKinectModel,
    inputs: SensorInputs,
    detected: wp.array3d[int],
    nearest: wp.array[wp.vec2i],
    normals: wp.array3d[float],
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
    normals: wp.array3d[float],
    # Out:
    images_out: MeasuredImages,
):
    """Write the depth of the nearest detected dot, as quantized disparity with noise.

    `nearest` contains column and row offsets by increasing distance; equal distances are in row-major order.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    fill_pixels(model, inputs, detected, nearest, normals, view, y, x, images_out)
