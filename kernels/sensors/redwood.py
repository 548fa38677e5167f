# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Kinect noise of the Redwood data set's simulator and Habitat: tabulated distortion, jitter, quantized disparity."""

import warp as wp

from warpvis.kernels.constants import REASON_DROPOUT, REASON_EMPTY, REASON_RANGE
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.sensors.noise import MeasuredImages, SensorInputs, limit_depth, range_reason, write_pixel

wp.set_module_options(pixel_options("shared/noise.h"))

FARTHEST = wp.constant(10.0)
"""Surfaces at this depth or beyond are out of range [m]."""
JITTER = wp.constant(0.25)
"""Standard deviation of the lateral jitter [px]."""
DISPARITY_SCALE = wp.constant(35.130)
"""Focal length times baseline [px m]."""
DISPARITY_SIGMA = wp.constant(0.027778)
"""Standard deviation of disparity [px]."""
LEVELS = wp.constant(8.0)
"""Disparity levels per pixel."""
MIN_FACTOR = wp.constant(1.0e-5)
"""Entries of the table below this are missing."""
TABLE_WIDTH, TABLE_HEIGHT, CELL_WIDTH, CELL_HEIGHT = (
    wp.constant(640),
    wp.constant(480),
    wp.constant(8),
    wp.constant(6),
)
"""Image size of the table, and size of its cells [px]."""


@wp.struct
class RedwoodModel:
    """The parameters of `warpvis.sensors.RedwoodNoise`."""

    multiplier: float


@wp.func
def moved(pixel: int, shift: float, size: int) -> int:
    """Return the pixel nearest to a shifted pixel along one axis, clamped to the image."""
    return int(wp.clamp(float(pixel) + shift, 0.0, float(size - 1)) + 0.5)


@wp.func
def cell_of(pixel: int, size: int, table_size: int, cell: int) -> int:
    """Return the table's cell for a pixel of an image of any size."""
    return int(float(pixel) / float(wp.max(size - 1, 1)) * float(table_size - 1) + 0.5) // cell


@wp.func
def distortion_of(table: wp.array3d[float], y: int, x: int, depth: float) -> float:
    """Return the divisor of depth, interpolated between a cell's entries at 1, 3, 5, 7 and 9 m."""
    after = int((depth + 1.0) / 2.0)
    share = (depth - float(2 * after - 1)) / 2.0
    before = wp.clamp(after - 1, 0, 4)
    return (1.0 - share) * table[y, x, before] + share * table[y, x, wp.min(after, 4)]


@wp.kernel
def measure_redwood(
    window: Window,
    # In:
    model: RedwoodModel,
    table: wp.array3d[float],
    inputs: SensorInputs,
    normals_across: wp.array3d[float],
    normals_down: wp.array3d[float],
    normals: wp.array3d[float],
    # Out:
    images_out: MeasuredImages,
):
    """Write distorted depth of every second pixel, as quantized disparity with noise."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    height, width = inputs.true_depth.shape[1], inputs.true_depth.shape[2]
    jitter = JITTER * model.multiplier
    row = moved(y, jitter * normals_down[view, y, x], height)
    column = moved(x, jitter * normals_across[view, y, x], width)
    depth = float(inputs.true_depth[view, row - row % 2, column - column % 2])
    reason = int(REASON_EMPTY)
    if wp.isfinite(depth):
        reason = REASON_RANGE
        if depth >= FARTHEST:
            depth = wp.inf
        else:
            cell_row = cell_of(row, height, TABLE_HEIGHT, CELL_HEIGHT)
            cell_column = cell_of(column, width, TABLE_WIDTH, CELL_WIDTH)
            factor = distortion_of(table, cell_row, cell_column, depth)
            if factor < MIN_FACTOR:
                depth = wp.nan
                reason = REASON_DROPOUT
            else:
                noise = DISPARITY_SIGMA * model.multiplier * normals[view, y, x]
                levels = wp.rint((DISPARITY_SCALE * factor / depth + noise) * LEVELS)
                # Depth is infinite below the first step of disparity.
                depth = wp.where(levels > 0.0, DISPARITY_SCALE * LEVELS / levels, wp.inf)
                depth = limit_depth(inputs.camera, depth)
                reason = range_reason(depth)
    write_pixel(images_out, view, y, x, depth, reason)
