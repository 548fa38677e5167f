# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Simple corruptions of depth for learning: additive and multiplicative noise, lost pixels, lost rectangles."""

import warp as wp

from warpvis.kernels.constants import STREAM_RECTANGLES
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.sensors.noise import MeasuredImages, SensorInputs
from warpvis.kernels.sensors.random_numbers import random_word, to_uniform

wp.set_module_options(pixel_options("shared/corruptions.h"))


@wp.struct
class CorruptionModel:
    """The parameters of `warpvis.sensors.Corruptions`, and the lost rectangles."""

    added: float
    multiplied: float
    dropout: float
    min_count: int  # rectangles per view
    max_count: int
    min_side: int  # of a rectangle [px]
    max_side: int
    rectangles: wp.array2d[wp.vec4i]  # left, top, right and bottom (exclusive) of each view's rectangles; 0 if unused


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
    # In:
    model: CorruptionModel,
    inputs: SensorInputs,
    # Out:
    rectangles_out: wp.array2d[wp.vec4i],
):
    """Write the rectangles of every view."""
    view, number = wp.tid()
    draw = inputs.draws[view]
    count = draw_whole(model.min_count, model.max_count, draw_uniform(inputs.seed, draw, 0, 0))
    rectangle = wp.vec4i()
    if number < count:
        # Row 0 of the random numbers is for the count; each rectangle has one of the following rows.
        row = number + 1
        width = draw_whole(model.min_side, model.max_side, draw_uniform(inputs.seed, draw, row, 0))
        height = draw_whole(model.min_side, model.max_side, draw_uniform(inputs.seed, draw, row, 1))
        across = draw_uniform(inputs.seed, draw, row, 2)
        down = draw_uniform(inputs.seed, draw, row, 3)
        left = draw_whole(0, int(inputs.camera.width) - 1, across) - width // 2
        top = draw_whole(0, int(inputs.camera.height) - 1, down) - height // 2
        rectangle = wp.vec4i(left, top, left + width, top + height)
    rectangles_out[view, number] = rectangle


@wp.func_native("warpvis::measure<warpvis::Corruption>(warpvis::sensor_row(inputs, images_out, view, y), x, model);")
def corrupt_pixels(
    model: CorruptionModel,
    inputs: SensorInputs,
    view: int,
    y: int,
    x: int,
    images_out: MeasuredImages,
): ...


@wp.kernel
def corrupt_depth(
    window: Window,
    # In:
    model: CorruptionModel,
    inputs: SensorInputs,
    # Out:
    images_out: MeasuredImages,
):
    """Write corrupted depth of the exact depth, or of `images_out` if `inputs.true_depth` is None.

    Pixels without depth do not change.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    corrupt_pixels(model, inputs, view, y, x, images_out)
