# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Simple corruptions of depth for learning: additive and multiplicative noise, lost pixels, lost rectangles."""

import warp as wp

from warpvis.kernels.constants import STREAM_RECTANGLES
from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import PinholeCamera, Window, locate
from warpvis.kernels.sensors.noise import NOISE, noise_row
from warpvis.kernels.sensors.random_numbers import for_pixels, random_word, to_uniform

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
def draw_uniform(seed: wp.uint32, draw: wp.vec2ui, y: int, x: int) -> float:
    """Return a uniform random number in (0, 1) of the stream of rectangles."""
    return to_uniform(random_word(seed, wp.uint32(STREAM_RECTANGLES), draw[0], draw[1], y, x))


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
    count = draw_whole(model.min_count, model.max_count, draw_uniform(model.seed, draw, 0, 0))
    rectangle = wp.vec4i()
    if number < count:
        # Row 0 of the random numbers is for the count; each rectangle has one of the following rows.
        row = number + 1
        width = draw_whole(model.min_side, model.max_side, draw_uniform(model.seed, draw, row, 0))
        height = draw_whole(model.min_side, model.max_side, draw_uniform(model.seed, draw, row, 1))
        across = draw_uniform(model.seed, draw, row, 2)
        down = draw_uniform(model.seed, draw, row, 3)
        left = draw_whole(0, int(camera.width) - 1, across) - width // 2
        top = draw_whole(0, int(camera.height) - 1, down) - height // 2
        rectangle = wp.vec4i(left, top, left + width, top + height)
    rectangles_out[view, number] = rectangle


@wp.func_native(
    NOISE
    + read_native("shared/corruptions.h")
    + noise_row()
    + """
const int* boxes = (const int*)rectangles.data + 4LL * view * rectangles.shape[1];
const Corruption corruption = {model.added, model.multiplied, model.dropout, range, boxes, model.max_count};
"""
    + for_pixels("corruption.corrupt(row, x);")
)
def corrupt_pixels(
    camera: PinholeCamera,
    model: CorruptionModel,
    true_depth: wp.array3d[float],
    rectangles: wp.array2d[wp.vec4i],
    draw: wp.vec2ui,
    view: int,
    y: int,
    x: int,
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
): ...


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
    view, y = locate(window, view, y)
    corrupt_pixels(camera, model, true_depth, rectangles, draws[view], view, y, x, depth_out, reasons_out)
