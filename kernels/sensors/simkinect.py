# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Kinect noise of Handa's simkinect: lateral jitter, window-based detection of dots, quantized disparity.

Disparities are integers in 1/8 px throughout, so that sums over windows are exact in any order.
"""

import warp as wp

from warpvis.kernels.constants import REASON_EDGE, REASON_EMPTY
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.sensors.noise import MeasuredImages, SensorInputs, limit_depth, range_reason, write_pixel

wp.set_module_options(pixel_options("shared/noise.h"))

LEVELS = wp.constant(8.0)
"""Disparity levels per pixel."""
MAX_LEVEL = wp.constant(8388608.0)
"""From this level on a pixel is empty, which prevents overflow of window sums: a depth of 3.4e-5 m by default."""
REACH = wp.constant(4)
"""Half width of a dot's window, without the center [px]."""
NEAR_MEAN = wp.constant(0.8)
"""Largest deviation from the window's mean, in levels, at which a disparity at the window's center is near it."""
NEAR_MEAN_SCALE = wp.constant(1.152)
"""The same elsewhere, times the squared distance from the center: 0.1 px by weights of 1 / (1.2^2 r^2)."""
STEPS_AT_UNIT = wp.constant(35130.0)
"""Disparity in steps at a depth of one unit."""


@wp.struct
class SimKinectModel:
    """The parameters of `warpvis.sensors.SimKinect`."""

    disparity_scale: float  # f b [px m]
    shift: float
    units: float  # per meter
    sigma: float


@wp.func
def depth_or_zero(true_depth: wp.array3d[float], view: int, y: int, x: int) -> float:
    """Return the depth of a pixel; 0 if it is not finite or the pixel is outside the image."""
    if y >= true_depth.shape[1] or x >= true_depth.shape[2]:
        return 0.0
    depth = true_depth[view, y, x]
    return wp.where(wp.isfinite(depth), depth, 0.0)


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
    width, height = true_depth.shape[2], true_depth.shape[1]
    across = wp.clamp(float(x) + model.shift * normals_across[view, y, x], 0.0, float(width))
    down = wp.clamp(float(y) + model.shift * normals_down[view, y, x], 0.0, float(height))
    column, row = int(across), int(down)
    right, below = across - float(column), down - float(row)
    upper = (1.0 - right) * depth_or_zero(true_depth, view, row, column)
    upper += right * depth_or_zero(true_depth, view, row, column + 1)
    lower = (1.0 - right) * depth_or_zero(true_depth, view, row + 1, column)
    lower += right * depth_or_zero(true_depth, view, row + 1, column + 1)
    depth = (1.0 - below) * upper + below * lower
    level = wp.rint(LEVELS * (model.disparity_scale / (depth + 1.0e-10)))
    levels_out[view, y, x] = wp.where(level < MAX_LEVEL, int(level), 0)


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
    rows, columns = wp.min(levels.shape[1], dots.shape[0]), wp.min(levels.shape[2], dots.shape[1])
    detected = int(0)
    if y >= REACH and x >= REACH and y < rows - REACH - 1 and x < columns - REACH - 1 and dots[y, x] != wp.uint8(0):
        count, total, light = int(0), int(0), int(0)
        for row in range(y - REACH, y + REACH + 1):
            for column in range(x - REACH, x + REACH + 1):
                level = levels[view, row, column]
                total += level
                count += wp.where(level > 0, 1, 0)
                light += int(dots[row, column])
        found = int(0)
        for row in range(y - REACH, y + REACH + 1):
            for column in range(x - REACH, x + REACH + 1):
                dot = int(dots[row, column])
                level = levels[view, row, column]
                if dot > 0 and level > 0:
                    squared = (row - y) * (row - y) + (column - x) * (column - x)
                    share = wp.where(squared > 0, NEAR_MEAN_SCALE * float(squared), NEAR_MEAN)
                    if float(wp.abs(level * count - total)) < share * float(count):
                        found += dot
        # More than 1 / 1.2 of the light in the window.
        if 6 * found > 5 * light:
            detected = levels[view, y, x]
    detected_out[view, y, x] = detected


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
    level = int(0)
    for number in range(nearest.shape[0]):
        column, row = x + nearest[number][0], y + nearest[number][1]
        if row >= 0 and column >= 0 and row < detected.shape[1] and column < detected.shape[2]:
            level = detected[view, row, column]
            if level > 0:
                break
    depth = float(wp.inf)
    reason = int(REASON_EMPTY)
    if level > 0:
        units = wp.rint(model.disparity_scale / (float(level) / LEVELS) * model.units)
        steps = wp.rint(STEPS_AT_UNIT / units + model.sigma * normals[view, y, x] + 0.5)
        # Depth is infinite below the first step of disparity.
        depth = limit_depth(inputs.camera, wp.where(steps > 0.0, STEPS_AT_UNIT / steps / model.units, wp.inf))
        reason = range_reason(depth)
    elif wp.isfinite(inputs.true_depth[view, y, x]):
        depth = wp.nan
        reason = REASON_EDGE
    write_pixel(images_out, view, y, x, depth, reason)
