# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Counter-based random numbers of pixels: functions of only seed, stream, frame, view, y and x.

Philox4x32-10 computes four words from the counter (x // 4, y, view, frame), which four adjacent pixels share; its key
is (seed, stream). Each purpose has a separate stream, so that no two uses of a pixel have the same numbers. Modules
with kernels that use these functions must be compiled with ``pixel_options("shared/random.h")`` of
``kernels/native_source.py``, so that CPU and CUDA compute the same bits.
"""

import warp as wp

from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate

wp.set_module_options(pixel_options("shared/random.h"))


@wp.func_native(
    """
typedef warpvis::PixelWords<warpvis::OnePixel> Words;
return Words::draw_one(warpvis::RandomKey{seed, view, frame}, stream, y, x);
"""
)
def random_word(seed: wp.uint32, stream: wp.uint32, view: wp.uint32, frame: wp.uint32, y: int, x: int) -> wp.uint32: ...


@wp.func_native("return warpvis::Random<warpvis::OnePixel>::uniform(word);")
def to_uniform(word: wp.uint32) -> float: ...


@wp.func_native("return warpvis::Random<warpvis::OnePixel>::normal(word);")
def to_normal(word: wp.uint32) -> float: ...


@wp.kernel
def draw_uniforms(
    # In:
    draws: wp.array[wp.vec2ui],
    pixels: wp.array[wp.vec2i],
    seed: wp.uint32,
    stream: wp.uint32,
    # Out:
    uniforms_out: wp.array2d[float],
):
    """Write a uniform number in (0, 1) for every view and place (y, x); `draws` contains view numbers and frames."""
    view, k = wp.tid()
    number, pixel = draws[view], pixels[k]
    word = random_word(seed, stream, number[0], number[1], pixel[0], pixel[1])
    uniforms_out[view, k] = to_uniform(word)


@wp.func_native(
    """
const warpvis::RandomKey key = {seed, draw[0], draw[1]};
warpvis::draw_normals<warpvis::PixelNumbers>(key, stream, normals_out, view, y, x);
"""
)
def draw_pixels(
    draw: wp.vec2ui,
    seed: wp.uint32,
    stream: wp.uint32,
    view: int,
    y: int,
    x: int,
    normals_out: wp.array3d[float],
): ...


@wp.kernel
def draw_normals(
    window: Window,
    # In:
    draws: wp.array[wp.vec2ui],
    seed: wp.uint32,
    stream: wp.uint32,
    # Out:
    normals_out: wp.array3d[float],
):
    """Write a standard normal number for every pixel; `draws` contains each view's number and frame."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    draw_pixels(draws[view], seed, stream, view, y, x, normals_out)
