# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mip levels of textures and skies, and their texels as `native/shared/textures.h` reads them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.scene.lights import cube_coordinates
from warpvis.scene.materials import linear_color, screen_color

CUBE_SIDES = 6
CUBE_WRAP = 3
"""Index of the wrap mode of cubes, whose sides have a border, after those of `materials.Wrap`."""

_LINEAR_BYTES = (255 * np.array(linear_color(np.arange(256) / 255))).astype(np.float32)
"""Linear light of the 256 sRGB values, from 0 to 255."""


def mip_levels(
    image: NDArray[Any], sides: int = 1, *, is_encoded: bool = False, is_single: bool = False
) -> list[NDArray[Any]]:
    """Return the mip levels of an image, ``(h, w, 4)`` each: down to one texel, or one per cube side below each other.

    Each level has half the texels of the one before it along both axes, rounded down, and is interpolated linearly
    between its texels at the centers of the new ones, as Mesa's `glGenerateMipmap` does (`util_gen_mipmap`): for even
    sizes, the mean of two texels. Bytes are rounded to the nearest, halves up; floats stay floats. With `is_encoded`,
    sRGB colors are interpolated as linear light. With `is_single`, only the finest level is made.
    """
    if image.shape[2] == 3:
        opaque = np.full((*image.shape[:2], 1), 255 if image.dtype == np.uint8 else 1, dtype=image.dtype)
        image = np.concatenate([image, opaque], axis=2)
    height = image.shape[0] // sides
    levels = [image[: height * sides]]
    while not is_single and (height > 1 or levels[-1].shape[1] > 1):
        parts: NDArray[Any] = levels[-1].reshape(sides, height, -1, 4)
        if is_encoded:
            parts = np.concatenate([_LINEAR_BYTES[parts[..., :3]], parts[..., 3:]], axis=-1)
        parts = _halved(_halved(parts, 1), 2)
        if is_encoded:
            parts[..., :3] = 255 * np.array(screen_color(parts[..., :3] / 255))
        height = parts.shape[1]
        rounded = (parts + 0.5).astype(np.uint8) if image.dtype == np.uint8 else parts
        levels.append(rounded.reshape(sides * height, -1, 4))
    return levels


def _halved(image: NDArray[Any], axis: int) -> NDArray[np.float32]:
    """Interpolate an image linearly at half as many positions along an axis."""
    count = image.shape[axis]
    half = max(count // 2, 1)
    position = (np.arange(half) + 0.5) * count / half - 0.5
    first = position.astype(np.int64)
    second = np.minimum(first + 1, count - 1)
    share = (position - first).astype(np.float32).reshape([-1 if k == axis else 1 for k in range(image.ndim)])
    return image.take(first, axis) * (1 - share) + image.take(second, axis) * share


def count_texels(shapes: Sequence[tuple[int, ...]], sides: int) -> list[int]:
    """Return the number of texels that levels of a height and width take, with the borders of cube sides."""
    if sides == 1:
        return [height * width for height, width in shapes]
    return [sides * (height // sides + 2) * (width + 2) for height, width in shapes]


def pack_texels(levels: Sequence[NDArray[Any]], sides: int) -> NDArray[np.uint32]:
    """Return the texels of levels as words: RGBA bytes, or two words of four numbers in half precision."""
    if sides > 1:
        levels = [_bordered(level.reshape(sides, -1, *level.shape[1:])) for level in levels]
    kind = np.uint8 if levels[0].dtype == np.uint8 else np.float16
    return np.concatenate([np.ascontiguousarray(level, dtype=kind).reshape(-1).view("<u4") for level in levels])


def _bordered(sides: NDArray[Any]) -> NDArray[Any]:
    """Return the sides of a cube, ``(6, h, w, 4)``, with a border of one texel of the adjacent sides.

    The texel at a corner is the mean of the three that meet there (OpenGL 4.6 core specification, 8.13.1).
    """
    _, height, width, channels = sides.shape
    found = np.empty((CUBE_SIDES, height + 2, width + 2, channels), dtype=sides.dtype)
    found[:, 1:-1, 1:-1] = sides
    (side, row, column), source = _border(height, width)
    found[side, row, column] = sides[source]
    for y, inner_y in ((0, 1), (-1, -2)):
        for x, inner_x in ((0, 1), (-1, -2)):
            mean = np.mean([found[:, inner_y, inner_x], found[:, y, inner_x], found[:, inner_y, x]], axis=0)
            found[:, y, x] = mean + 0.5 if sides.dtype == np.uint8 else mean
    return found


@lru_cache(maxsize=64)
def _border(height: int, width: int) -> tuple[tuple[NDArray[np.int64], ...], tuple[NDArray[np.int64], ...]]:
    """Return the places of border texels without corners, and of those that they repeat: side, row and column."""
    side, row, column = np.nonzero(np.broadcast_to(_is_border(height, width), (CUBE_SIDES, height + 2, width + 2)))
    right = (2 * column - 1) / width - 1  # from -1 to 1 between the edges of a side
    down = (2 * row - 1) / height - 1
    beyond = np.maximum(np.abs(right), np.abs(down))
    right = np.where(np.abs(right) > 1, right, right * beyond)  # so that the position along the edge stays
    down = np.where(np.abs(down) > 1, down, down * beyond)
    ones = np.ones(len(side))
    x, y, z = (
        np.choose(side, choices)
        for choices in (
            [ones, -ones, right, right, right, -right],
            [-down, -down, ones, -ones, -down, -down],
            [-right, right, down, -down, ones, -ones],
        )
    )
    image, place = cube_coordinates(np.stack([x, y, z], axis=-1))
    size = np.array([width, height])
    at = np.clip((place * size).astype(np.int64), 0, size - 1)
    return (side, row, column), (image.astype(np.int64), at[:, 1], at[:, 0])


def _is_border(height: int, width: int) -> NDArray[np.bool_]:
    """Return which texels of a side with a border are adjacent to one of its edges, shape ``(h + 2, w + 2)``."""
    rows = np.isin(np.arange(height + 2), (0, height + 1))
    columns = np.isin(np.arange(width + 2), (0, width + 1))
    return np.logical_xor(rows[:, None], columns[None])
