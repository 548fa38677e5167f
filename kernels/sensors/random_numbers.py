# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Counter-based random numbers of pixels: functions of only seed, stream, frame, view, y and x.

Philox4x32-10 computes four words from the counter (x // 4, y, view, frame), which four adjacent pixels share; its key
is (seed, stream). Each purpose has a separate stream, so that no two uses of a pixel have the same numbers. Modules
with kernels that use these functions must be compiled with ``"fuse_fp": False``, so that CPU and CUDA compute the same
bits.
"""

import warp as wp

from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import Window, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

RANDOM_HEADERS = ("shared/scalar.h", "shared/random.h")

_NATIVE = read_native(*RANDOM_HEADERS)

PIXEL_NUMBERS = "\n".join(
    [
        read_native("shared/constants.h"),
        "#if defined(__CUDA_ARCH__)",
        read_native(*RANDOM_HEADERS, "shared/random_pixel.h"),
        "#else",
        read_native("cpu/lanes.h", "cpu/number_lanes.h", "shared/random.h", "cpu/random_lanes.h"),
        "#endif\n",
    ]
)
"""C++ number types of formulas that are written once: they hold one pixel on CUDA, and 16 pixels of a row on a CPU."""


def for_pixels(statement: str) -> str:
    """Return C++ that runs a statement for the pixels of a thread: for pixel ``x`` on CUDA, for a row on a CPU.

    The statement processes the ``PixelWords::PIXELS`` pixels from ``x`` on.
    """
    return f"""
#if !defined(__CUDA_ARCH__)
for (x = 0; x < width; x += PixelWords::PIXELS)
#endif
    {statement}
"""


@wp.func_native(
    _NATIVE
    + """
Philox numbers = {{(unsigned)x >> 2, (unsigned)y, view, frame}};
numbers.mix(seed, stream);
return numbers.word[x & 3];
"""
)
def random_word(seed: wp.uint32, stream: wp.uint32, view: wp.uint32, frame: wp.uint32, y: int, x: int) -> wp.uint32: ...


@wp.func_native(_NATIVE + "return Random::uniform(word);")
def to_uniform(word: wp.uint32) -> float: ...


@wp.func_native(_NATIVE + "return Random::normal(word);")
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
    PIXEL_NUMBERS
    + """
const int width = normals_out.shape[2];
float* row = normals_out.data + ((long long)view * normals_out.shape[1] + y) * width;
"""
    + for_pixels("""{
    const PixelWords words = PixelWords::draw(RandomKey{seed, draw[0], draw[1]}, stream, y, x);
    for (int k = 0, place = x; k < PixelWords::WORDS && place < width; ++k, place += Numbers::PIXELS)
        Numbers::store(row + place, Random::normal(words.block[k]), width - place);
}""")
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
