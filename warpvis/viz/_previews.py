# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colored depth images with a scale, and contact sheets of many images."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import as_items, check_text, is_number
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.viz._figures import require_matplotlib, write_picture

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

NOTHING, TOO_NEAR = (70, 70, 70), (255, 255, 255)
"""Colors of pixels without depth: no surface up to far, and a surface nearer than near."""

_SCALE_HEIGHT, _MIN_WIDTH = 16, 160
_SHEET_COLUMNS, _THUMBNAIL = 4, 240
_GAP, _TITLE_HEIGHT = 6, 14
_SUFFIXES = "the name of a picture must end in .png or .jpg"


def depth_colors(depth: ArrayInput, depth_range: tuple[float, float]) -> NDArray[np.uint8]:
    """Color a depth image: Turbo from blue (near) to red (far), gray without a surface, white where it is too near.

    Colors: Mikhailov, "Turbo, an improved rainbow colormap for visualization", 2019.

    Args:
        depth: Planar depth [m], shape ``(..., H, W)``.
        depth_range: Depths of the first and the last color [m].

    Returns:
        RGB image, shape ``(..., H, W, 3)`` uint8.
    """
    require_matplotlib()
    from matplotlib import colormaps

    low, high = _check_range(depth_range)
    values = as_numpy(depth, name="depth").astype(np.float64)
    seen = np.isfinite(values)
    share = np.clip((np.where(seen, values, low) - low) / max(high - low, 1e-9), 0, 1)
    table = (colormaps["turbo"](np.linspace(0, 1, 256))[:, :3] * 255).round().astype(np.uint8)
    colors = table[(share * 255).astype(np.uint8)]
    colors[~seen] = NOTHING
    colors[values == -np.inf] = TOO_NEAR
    return colors


def save_preview(depth: ArrayInput, path: str | os.PathLike[str], depth_range: tuple[float, float]) -> None:
    """Write a depth image with the colors of `depth_colors`, at its resolution, with a scale below.

    Args:
        depth: Planar depth [m], shape ``(H, W)``.
        path: Picture to write.
        depth_range: Depths at the ends of the scale [m].
    """
    from PIL import Image

    image = as_numpy(depth, name="depth")
    if image.ndim != 2 or not image.size:
        raise ArrayError(f"depth must have shape (H, W), got {image.shape}")
    colors = depth_colors(image, depth_range)
    scale = _scale(max(image.shape[1], _MIN_WIDTH), depth_range)
    picture = Image.new("RGB", (max(image.shape[1], _MIN_WIDTH), image.shape[0] + scale.height), "white")
    picture.paste(Image.fromarray(colors), (0, 0))
    picture.paste(scale, (0, image.shape[0]))
    write_picture(picture.save, path, _SUFFIXES)


def save_contact_sheet(
    depth: Sequence[ArrayInput],
    names: Sequence[str],
    path: str | os.PathLike[str],
    depth_range: tuple[float, float],
) -> None:
    """Write a contact sheet of depth images, each below its name, with one scale.

    Args:
        depth: Images [m], each of shape ``(H, W)``.
        names: Names of the images.
        path: Picture to write.
        depth_range: Depths at the ends of the scale [m].
    """
    from PIL import Image, ImageDraw

    images = [as_numpy(image, name="depth") for image in as_items(depth, "depth")]
    names = [check_text(name, "a name") for name in as_items(names, "names")]
    _check_range(depth_range)
    if not images or len(names) != len(images) or any(image.ndim != 2 or not image.size for image in images):
        raise ArrayError(
            f"depth must be images of shape (H, W) with one name each, got {len(images)} images and {len(names)} names"
        )
    height, width = (max(image.shape[axis] for image in images) for axis in (0, 1))
    small = min(1.0, _THUMBNAIL / width)
    cell = (max(1, round(width * small)), max(1, round(height * small)) + _TITLE_HEIGHT)
    columns = min(_SHEET_COLUMNS, len(images))
    rows = -(-len(images) // columns)
    sheet_width = max(columns * (cell[0] + _GAP) + _GAP, _MIN_WIDTH)
    scale = _scale(sheet_width, depth_range)
    sheet = Image.new("RGB", (sheet_width, rows * (cell[1] + _GAP) + _GAP + scale.height), "white")
    draw = ImageDraw.Draw(sheet)
    for number, (image, name) in enumerate(zip(images, names, strict=True)):
        row, column = divmod(number, columns)
        x, y = _GAP + column * (cell[0] + _GAP), _GAP + row * (cell[1] + _GAP)
        picture = Image.fromarray(depth_colors(image, depth_range))
        size = (max(1, round(image.shape[1] * small)), max(1, round(image.shape[0] * small)))
        sheet.paste(picture.resize(size, Image.Resampling.NEAREST), (x, y + _TITLE_HEIGHT))
        draw.text((x, y), name, fill="black")
    sheet.paste(scale, (0, sheet.height - scale.height))
    write_picture(sheet.save, path, _SUFFIXES)


def _scale(width: int, depth_range: tuple[float, float]) -> Picture:
    """Draw the color scale with its first, middle and last depth."""
    from PIL import Image, ImageDraw

    low, high = depth_range
    strip = np.tile(np.linspace(low, high, width), (_SCALE_HEIGHT // 2, 1))
    picture = Image.new("RGB", (width, _SCALE_HEIGHT // 2 + _TITLE_HEIGHT), "white")
    picture.paste(Image.fromarray(depth_colors(strip, depth_range)), (0, 2))
    draw = ImageDraw.Draw(picture)
    top = _SCALE_HEIGHT // 2 + 2
    for place, anchor, value in ((2, "la", low), (width // 2, "ma", (low + high) / 2), (width - 2, "ra", high)):
        draw.text((place, top), f"{value:.3g} m", fill="black", anchor=anchor)
    return picture


def _check_range(depth_range: tuple[float, float]) -> tuple[float, float]:
    values = list(depth_range) if isinstance(depth_range, tuple | list) else []
    if (
        len(values) != 2
        or not all(is_number(value) and np.isfinite(value) for value in values)
        or values[0] > values[1]
    ):
        raise ArrayError(f"depth_range must be two finite depths [m] in ascending order, got {depth_range!r}")
    return float(values[0]), float(values[1])
