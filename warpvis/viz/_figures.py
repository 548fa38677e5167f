# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Figures; pictures of floor maps and label images; colored depth images with a scale, and contact sheets of them."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy, check_shape
from warpvis.core.checks import as_items, as_path, check_text, is_number, is_whole
from warpvis.core.file_content import writing
from warpvis.core.labels import LABEL_COUNT, Label, LabelNames
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, FileFormatError, WarpvisError
from warpvis.maps import FloorMap, label_colors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from PIL.Image import Image as Picture

_DPI = 130
# Height of a line of a legend [inches].
_LEGEND_LINE = 0.21

_Meaning = tuple[str, tuple[int, int, int]]
Legend = Mapping[int, _Meaning] | Mapping[Label, _Meaning]
"""Meaning and RGB color, 0 to 255, of each value of a map."""
Bounds = tuple[float, float, float, float]
"""A map's left, right, bottom and top border [m]: matplotlib's ``extent``."""

_WIDTH, _COLUMNS = 5.4, 3
# Height of the title and the axis labels [inches].
_TITLE_HEIGHT = 0.75

NOTHING, TOO_NEAR = (70, 70, 70), (255, 255, 255)
"""Colors of pixels without depth: no surface up to far, and a surface nearer than near."""

_SCALE_HEIGHT, _MIN_WIDTH = 16, 160
_SHEET_COLUMNS, _THUMBNAIL = 4, 240
_GAP, _CAPTION_HEIGHT = 6, 14
_SUFFIXES = "the name of a picture must end in .png or .jpg"


def require_matplotlib() -> None:
    """Raise `WarpvisError` if matplotlib is not installed."""
    if importlib.util.find_spec("matplotlib") is None:
        raise WarpvisError("pictures need matplotlib, which is missing: pip install 'warpvis[viz]'")


def new_figure(width: float, height: float, *, gap: float = 0.04167) -> Figure:
    """Create a figure of a size [inches] with gaps between its panels [inches], by default matplotlib's."""
    require_matplotlib()
    # Do not use pyplot: it keeps figures alive and selects a backend for the whole process.
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    return Figure(figsize=(width, height), dpi=_DPI, layout=ConstrainedLayoutEngine(w_pad=gap, h_pad=gap))


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure."""
    write_picture(figure.savefig, path)


def write_picture(write: Callable[[Path], object], path: str | os.PathLike[str], expected: str | None = None) -> None:
    """Write a picture; if its format is not supported, the message is `expected` or that of `write`."""
    path = as_path(path)
    with writing(path):
        try:
            write(path)
        except ValueError as error:  # matplotlib: "Format 'xyz' is not supported (supported formats: ...)"
            raise FileFormatError(f"{path}: {expected or error}") from None


def save_map(floor: FloorMap, path: str | os.PathLike[str], *, view: int = 0, title: str = "Seen floor") -> None:
    """Write a picture of one view's floor map, with axes in meters and a legend.

    Args:
        floor: The maps of all views.
        path: Picture to write.
        view: Index of the view.
        title: Title of the picture.
    """
    check_text(title, "title")
    if not isinstance(floor, FloorMap):
        raise ArrayError(f"floor must be a FloorMap, got {type(floor).__name__}")
    if not is_whole(view) or view not in range(len(floor.cells)):
        raise ArrayError(f"view must be from 0 to {len(floor.cells) - 1}, got {view!r}")
    shown = np.unique(floor.cells.numpy()[view])
    legend = {value: meaning for value, meaning in floor.legend.items() if value in shown}
    figure = new_figure(5.0, 4.77 + legend_height(legend, columns=2))
    draw_map(figure.subplots(), floor.rgb()[view], floor.bounds, floor.axes, title)
    draw_legend(figure, legend, columns=2)
    save_figure(figure, path)


def draw_map(axes: Axes, colors: ArrayLike, bounds: Bounds, names: tuple[str, str], title: str) -> None:
    """Draw a map's colors, shape ``(rows, columns, 3)``, row 0 at the bottom, with axes of given names."""
    axes.imshow(np.asarray(colors), origin="lower", extent=bounds, interpolation="nearest")
    first, second = names
    axes.set(title=title, xlabel=f"{first} [m]", ylabel=f"{second} [m]")


def legend_height(legend: Legend, columns: int) -> float:
    """Return the height of a legend [inches]."""
    return _LEGEND_LINE * -(-len(legend) // columns)


def draw_legend(figure: Figure, legend: Legend, columns: int) -> None:
    """Draw the legend of a map's colors below a figure."""
    from matplotlib.patches import Patch

    handles = [
        Patch(facecolor=np.array(color) / 255, edgecolor="black", linewidth=0.5, label=meaning)
        for meaning, color in legend.values()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)


def save_labels(
    labels: ArrayInput,
    path: str | os.PathLike[str],
    *,
    label_names: Mapping[int, str] | None = None,
    title: str = "Labels",
) -> None:
    """Write a picture of a label image with a legend of its classes.

    Args:
        labels: The image, whole numbers from 0 to 255, shape ``(H, W)``.
        path: Picture to write.
        label_names: Names of custom classes: `Scene.label_names`, or those of `open_dataset`.
        title: Title of the picture.
    """
    check_text(title, "title")
    image, names = as_numpy(labels, name="labels"), LabelNames(label_names)
    check_shape(image.shape, ("H", "W"), name="labels")
    if image.dtype.kind not in "iu" or not image.size or image.min() < 0 or image.max() >= LABEL_COUNT:
        raise ArrayError("labels must be an image of whole numbers from 0 to 255")
    colors = label_colors()
    legend = {number: (names.name(number), tuple(colors[number])) for number in np.unique(image).tolist()}
    height = _WIDTH * image.shape[0] / image.shape[1]
    figure = new_figure(_WIDTH, _TITLE_HEIGHT + height + legend_height(legend, _COLUMNS))
    axes = figure.subplots()
    axes.imshow(colors[image], interpolation="nearest")
    axes.set(title=title, xlabel="x [px]", ylabel="y [px]")
    draw_legend(figure, legend, columns=_COLUMNS)
    save_figure(figure, path)


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
    cell = (max(1, round(width * small)), max(1, round(height * small)) + _CAPTION_HEIGHT)
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
        sheet.paste(picture.resize(size, Image.Resampling.NEAREST), (x, y + _CAPTION_HEIGHT))
        draw.text((x, y), name, fill="black")
    sheet.paste(scale, (0, sheet.height - scale.height))
    write_picture(sheet.save, path, _SUFFIXES)


def _scale(width: int, depth_range: tuple[float, float]) -> Picture:
    """Draw the color scale with its first, middle and last depth."""
    from PIL import Image, ImageDraw

    low, high = depth_range
    strip = np.tile(np.linspace(low, high, width), (_SCALE_HEIGHT // 2, 1))
    picture = Image.new("RGB", (width, _SCALE_HEIGHT // 2 + _CAPTION_HEIGHT), "white")
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
