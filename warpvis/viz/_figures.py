# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Figures and floor maps from arrays, independent of scenes and views."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import as_items, as_path, check_mapping, check_text
from warpvis.core.labels import Label
from warpvis.errors import ArrayError, FileFormatError, WarpvisError

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
    """Write a figure.

    Raises:
        FileFormatError: If the file cannot be written, or its format is not supported.
    """
    path = as_path(path)
    try:
        figure.savefig(path)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be written: {error.strerror or error}") from None
    except ValueError as error:  # matplotlib: "Format 'xyz' is not supported (supported formats: ...)"
        raise FileFormatError(f"{path}: {error}") from None


def save_map(
    cells: ArrayLike,
    path: str | os.PathLike[str],
    *,
    bounds: Bounds,
    legend: Legend,
    axes: tuple[str, str] = ("x", "y"),
    title: str = "Seen floor",
) -> None:
    """Write a picture of a floor map with axes in meters and a legend.

    Args:
        cells: Values of the cells, shape ``(rows, columns)``, row 0 at the bottom.
        path: Picture to write.
        bounds: The map's left, right, bottom and top border [m].
        legend: Meaning and RGB color, 0 to 255, of every value; `warpvis.maps.MAP_LEGEND` for labels.
        axes: Names of the horizontal and the vertical axis.
        title: Title of the picture.

    Raises:
        ArrayError: If the cells do not have two axes, or contain a value that is not in the legend.
        FileFormatError: If the picture cannot be written.
    """
    check_text(title, "title")
    names = as_items(axes, "axes")
    if len(names) != 2 or not all(isinstance(name, str) for name in names):
        raise ArrayError(f"axes must be two names, got {axes!r}")
    borders = as_numpy(bounds, name="bounds").astype(np.float64)
    if borders.shape != (4,) or not np.isfinite(borders).all():
        raise ArrayError(f"bounds must be left, right, bottom and top, got {borders.tolist()}")
    _check_legend(legend)
    values = as_numpy(cells, name="cells")
    if values.ndim != 2:
        raise ArrayError(f"cells must have shape (rows, columns), got {values.shape}")
    colors = np.zeros((*values.shape, 3), dtype=np.uint8)
    known = np.zeros(values.shape, dtype=bool)
    for value, (_, color) in legend.items():
        colors[values == value] = color
        known |= values == value
    if not known.all():
        raise ArrayError(f"cells must contain only values of the legend, got {values[~known][0]}")
    figure = new_figure(5.0, 4.77 + legend_height(legend, columns=2))
    draw_map(figure.subplots(), colors, bounds, axes, title)
    draw_legend(figure, legend, columns=2)
    save_figure(figure, path)


def _check_legend(legend: object) -> None:
    for entry in check_mapping(legend, "legend").values():
        meaning, color = entry if isinstance(entry, tuple | list) and len(entry) == 2 else ("", None)
        if color is None or as_numpy(color, name="a color of the legend").shape != (3,):
            raise ArrayError(f"legend must map every value to a meaning and an RGB color, got {entry!r}")
        check_text(meaning, "a meaning of the legend")


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
