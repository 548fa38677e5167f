# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Figures, and pictures of floor maps and label images."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from warpvis.core.arrays import as_numpy, check_shape
from warpvis.core.checks import as_path, check_text, is_whole
from warpvis.core.file_content import writing
from warpvis.core.labels import LABEL_COUNT, Label, LabelNames
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, FileFormatError, WarpvisError
from warpvis.maps import FloorMap, label_colors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
