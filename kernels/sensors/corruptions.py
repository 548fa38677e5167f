# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Simple corruptions of depth for learning: additive and multiplicative noise, lost pixels, lost rectangles."""

import warp as wp

from warpvis.kernels.constants import (
    REASON_DROPOUT,
    STREAM_ADDED,
    STREAM_LOST,
    STREAM_MULTIPLIED,
    STREAM_RECTANGLES,
)
from warpvis.kernels.pinhole import PinholeCamera, Window
from warpvis.kernels.sensors.noise import clean_reason, draw_normal, draw_uniform, limit_depth, range_reason

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})


@wp.struct
class CorruptionModel:
    """The parameters of `warpvis.sensors.Corruptions`."""

    added: float
    multiplied: float
    dropout: float
    min_count: int  # rectangles per view
    max_count: int
    min_side: int  # of a rectangle [px]
    max_side: int
    seed: wp.uint32


@wp.func
def draw_whole(low: int, high: int, uniform: float) -> int:
    """Map a uniform number to an integer from `low` to `high`."""
    return low + wp.min(int(wp.floor(uniform * float(high - low + 1))), high - low)


@wp.kernel
def place_rectangles(
    # Cameras:
    camera: PinholeCamera,
    # In:
    model: CorruptionModel,
    draws: wp.array[wp.vec2ui],
    # Out:
    rectangles_out: wp.array2d[wp.vec4i],
):
    """Write left, top, right and bottom of every view's rectangles; right and bottom are exclusive; 0 if unused."""
    view, number = wp.tid()
    draw = draws[view]
    count = draw_whole(model.min_count, model.max_count, draw_uniform(model.seed, STREAM_RECTANGLES, draw, 0, 0))
    rectangle = wp.vec4i()
    if number < count:
        # Row 0 of the random numbers is for the count; each rectangle has one of the following rows.
        row = number + 1
        width = draw_whole(model.min_side, model.max_side, draw_uniform(model.seed, STREAM_RECTANGLES, draw, row, 0))
        height = draw_whole(model.min_side, model.max_side, draw_uniform(model.seed, STREAM_RECTANGLES, draw, row, 1))
        across = draw_uniform(model.seed, STREAM_RECTANGLES, draw, row, 2)
        down = draw_uniform(model.seed, STREAM_RECTANGLES, draw, row, 3)
        left = draw_whole(0, int(camera.width) - 1, across) - width // 2
        top = draw_whole(0, int(camera.height) - 1, down) - height // 2
        rectangle = wp.vec4i(left, top, left + width, top + height)
    rectangles_out[view, number] = rectangle


@wp.kernel
def corrupt_depth(
    # Cameras:
    camera: PinholeCamera,
    window: Window,
    # In:
    model: CorruptionModel,
    true_depth: wp.array3d[float],
    rectangles: wp.array2d[wp.vec4i],
    draws: wp.array[wp.vec2ui],
    # Out:
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
):
    """Write corrupted depth of `true_depth`, or of `depth_out` if `true_depth` is None; reasons may be None.

    Pixels without depth do not change.
    """
    view, y, x = wp.tid()
    view += window.first_view
    y += window.first_row
    draw = draws[view]
    depth = float(depth_out[view, y, x])
    if true_depth:
        clean = float(true_depth[view, y, x])
        depth = limit_depth(camera.near, camera.far, clean)
        if reasons_out:
            reasons_out[view, y, x] = wp.uint8(clean_reason(clean, depth))
    if wp.isfinite(depth):
        # Random numbers that have no effect are not generated: generating them is most of the work.
        lost = bool(False)
        if model.dropout > 0.0:
            lost = draw_uniform(model.seed, STREAM_LOST, draw, y, x) < model.dropout
        for number in range(model.max_count):
            box = rectangles[view, number]
            lost = lost or (x >= box[0] and y >= box[1] and x < box[2] and y < box[3])
        if model.multiplied > 0.0:
            depth *= 1.0 + model.multiplied * draw_normal(model.seed, STREAM_MULTIPLIED, draw, y, x)
        if model.added > 0.0:
            depth += model.added * draw_normal(model.seed, STREAM_ADDED, draw, y, x)
        depth = limit_depth(camera.near, camera.far, depth)
        reason = range_reason(depth)
        if lost:
            depth = wp.nan
            reason = REASON_DROPOUT
        if reasons_out:
            reasons_out[view, y, x] = wp.uint8(reason)
    depth_out[view, y, x] = depth
