# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Kinect noise of the Redwood data set's simulator and Habitat: tabulated distortion, jitter, quantized disparity."""

import warp as wp

from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.sensors.noise import MeasuredImages, SensorInputs

wp.set_module_options(pixel_options("shared/redwood.h"))


@wp.struct
class RedwoodModel:
    """The parameters of `warpvis.sensors.RedwoodNoise`."""

    multiplier: float  # of both standard deviations
    jitter: float  # standard deviation of the lateral jitter [px]
    farthest: float  # surfaces at this depth or beyond are out of range [m]
    disparity_scale: float  # focal length times baseline [px m]
    disparity_sigma: float  # standard deviation of disparity [px]
    levels: float  # of disparity per pixel
    min_factor: float  # entries of the table below this are missing


@wp.func_native(
    "warpvis::measure<warpvis::Redwood>(warpvis::sensor_row(inputs, images_out, view, y), x, model, table);"
)
def measure_pixels(
    model: RedwoodModel,
    table: wp.array3d[float],
    inputs: SensorInputs,
    view: int,
    y: int,
    x: int,
    images_out: MeasuredImages,
): ...


@wp.kernel
def measure_redwood(
    window: Window,
    # In:
    model: RedwoodModel,
    table: wp.array3d[float],
    inputs: SensorInputs,
    # Out:
    images_out: MeasuredImages,
):
    """Write distorted depth of every second pixel, as quantized disparity with noise."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    measure_pixels(model, table, inputs, view, y, x, images_out)
