# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Texture sampling with mip maps, and conversion of color spaces.

The mip level follows from the longer side of a pixel's footprint in texels (OpenGL 4.6 core specification, 8.14.1).
Colors are interpolated linearly between texels and between levels.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

CUBE_SIDES = wp.constant(6)
WRAP_MIRROR, WRAP_CLAMP = wp.constant(1), wp.constant(2)
TEXTURE_LINEAR_FILTER = wp.constant(1)


@wp.struct
class DeviceTexture:
    """The layout of a texture in the array of all texels: from the finest level to the coarsest, rows from the top."""

    first: int
    width: int
    height: int  # for a cube, of its six sides together
    levels: int
    wrap_u: int
    wrap_v: int
    filter: int
    is_linear: bool  # whether its texels are in linear color space


@wp.func
def to_linear(value: float) -> float:
    """Convert a display value to linear light (IEC 61966-2-1)."""
    if value <= 0.04045:
        return value / 12.92
    return wp.pow((value + 0.055) / 1.055, 2.4)


@wp.func
def to_screen(value: float) -> float:
    """Convert linear light to a display value: the inverse of `to_linear`."""
    if value <= 0.0031308:
        return value * 12.92
    return 1.055 * wp.pow(value, 1.0 / 2.4) - 0.055


@wp.func
def to_linear_color(color: wp.vec4) -> wp.vec4:
    return wp.vec4(to_linear(color[0]), to_linear(color[1]), to_linear(color[2]), color[3])


@wp.func
def to_screen_color(color: wp.vec4) -> wp.vec4:
    return wp.vec4(to_screen(color[0]), to_screen(color[1]), to_screen(color[2]), color[3])


@wp.func
def texel_color(texel: wp.uint32) -> wp.vec4:
    byte = wp.uint32(255)
    return (
        wp.vec4(
            float(texel & byte),
            float((texel >> wp.uint32(8)) & byte),
            float((texel >> wp.uint32(16)) & byte),
            float(texel >> wp.uint32(24)),
        )
        / 255.0
    )


@wp.func
def wrapped(index: int, size: int, mode: int) -> int:
    """Return the index of a texel for an index outside of the texture."""
    if mode == WRAP_CLAMP:
        return wp.clamp(index, 0, size - 1)
    repetition = index // size
    if index < repetition * size:  # division rounds toward 0
        repetition -= 1
    offset = index - repetition * size
    if mode == WRAP_MIRROR and (repetition & 1) != 0:
        return size - 1 - offset
    return offset


@wp.func
def fetch(
    texels: wp.array[wp.uint32], texture: DeviceTexture, first: int, size: wp.vec2i, index: wp.vec2i, linear: bool
) -> wp.vec4:
    """Return a texel of a level, converted to linear space if `linear`, and to display color space otherwise."""
    column, row = wrapped(index[0], size[0], texture.wrap_u), wrapped(index[1], size[1], texture.wrap_v)
    color = texel_color(texels[first + row * size[0] + column])
    if linear and not texture.is_linear:
        return to_linear_color(color)
    if texture.is_linear and not linear:
        return to_screen_color(color)
    return color


@wp.func
def sample_level(
    texels: wp.array[wp.uint32], texture: DeviceTexture, level: int, uv: wp.vec2, side: int, linear: bool
) -> wp.vec4:
    """Return a level's color at a position; `side` is a side of a cube, or -1."""
    first, width, height = int(texture.first), int(texture.width), int(texture.height)
    sides = int(1)
    if side >= 0:
        sides = CUBE_SIDES
    for _ in range(level):
        first += width * height
        width, height = wp.max(width // 2, 1), wp.max(height // sides // 2, 1) * sides
    size = wp.vec2i(width, height // sides)
    if side > 0:
        first += side * width * size[1]
    x, y = uv[0] * float(size[0]), (1.0 - uv[1]) * float(size[1])
    if texture.filter != TEXTURE_LINEAR_FILTER:
        return fetch(texels, texture, first, size, wp.vec2i(int(wp.floor(x)), int(wp.floor(y))), linear)
    x -= 0.5
    y -= 0.5
    column, row = int(wp.floor(x)), int(wp.floor(y))
    right, below = x - float(column), y - float(row)
    upper = wp.lerp(
        fetch(texels, texture, first, size, wp.vec2i(column, row), linear),
        fetch(texels, texture, first, size, wp.vec2i(column + 1, row), linear),
        right,
    )
    lower = wp.lerp(
        fetch(texels, texture, first, size, wp.vec2i(column, row + 1), linear),
        fetch(texels, texture, first, size, wp.vec2i(column + 1, row + 1), linear),
        right,
    )
    return wp.lerp(upper, lower, below)


@wp.func
def sample(
    texels: wp.array[wp.uint32], texture: DeviceTexture, uv: wp.vec3, across: wp.vec3, down: wp.vec3, linear: bool
) -> wp.vec4:
    """Return the color at (u, v, cube side or -1); `across` and `down` are the neighboring pixels' coordinates."""
    side, height = int(uv[2]), int(texture.height)
    if side >= 0:
        height = height // CUBE_SIDES
    size = wp.vec2(float(texture.width), float(height))
    length_across = wp.length(wp.cw_mul(wp.vec2(across[0] - uv[0], across[1] - uv[1]), size))
    length_down = wp.length(wp.cw_mul(wp.vec2(down[0] - uv[0], down[1] - uv[1]), size))
    longest = wp.max(length_across, length_down)
    level = float(0.0)
    if longest > 1.0 and texture.filter == TEXTURE_LINEAR_FILTER:
        level = wp.min(wp.log2(longest), float(texture.levels - 1))
    finer = int(level)
    position = wp.vec2(uv[0], uv[1])
    color = sample_level(texels, texture, finer, position, side, linear)
    if level > float(finer):
        coarser = sample_level(texels, texture, finer + 1, position, side, linear)
        color = wp.lerp(color, coarser, level - float(finer))
    return color
