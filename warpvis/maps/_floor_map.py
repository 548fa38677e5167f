# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Floor maps: labeled points projected to the floor, as in the paper, and the colors of labels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.depth_images import read_labels
from warpvis.core.arrays import as_numpy, as_warp, check_length, empty, get_device
from warpvis.core.labels import LABEL_COUNT, Label, LabelNames
from warpvis.core.poses import check_up
from warpvis.core.threads import launch_images
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError

Color = tuple[int, int, int]

MAP_LEGEND: dict[Label, tuple[str, Color]] = {
    Label.EMPTY: ("not seen", (0, 0, 0)),
    Label.GROUND: ("visible ground", (127, 237, 140)),
    Label.OBSTACLE: ("visible part of an obstacle", (99, 74, 42)),
    Label.OBJECT: ("visible object", (239, 87, 0)),
    Label.HUMAN: ("visible human", (11, 96, 205)),
    Label.ROBOT: ("robot", (181, 181, 181)),
}
"""Meaning and color (red, green, blue; 0 to 255) of each `Label` of a map.

All colors differ by at least 30 in CIELAB, also with missing red, green or blue cones in the simulation of Machado,
Oliveira and Fernandes (2009).
"""

# Step of red, green and blue between candidate colors, and limits of their lightness (L* of CIELAB).
_STEP, _DARKEST, _BRIGHTEST = 17, 25, 92
# From linear sRGB to XYZ, relative to the white D65: IEC 61966-2-1.
_TO_XYZ = np.array([(0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505)])
_TO_XYZ /= _TO_XYZ.sum(axis=1, keepdims=True)

# The floor's axes, in the order of a view from above: the first to the right, the second up.
FLOOR_AXES = {"z": (0, 1), "y": (2, 0)}

_MAX_CELLS = 2**31 - 1


@cache
def _palette() -> NDArray[np.uint8]:
    """Choose colors greedily, each as far as possible from all previous ones, starting from `MAP_LEGEND`."""
    levels = np.arange(0, 256, _STEP)
    choice = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    light = _to_lab(choice)[:, 0]
    choice = choice[(light >= _DARKEST) & (light <= _BRIGHTEST)]
    chosen = [np.array(color) for _, color in MAP_LEGEND.values()]
    places = _to_lab(choice)
    distance = np.min([np.linalg.norm(places - _to_lab(color), axis=1) for color in chosen], axis=0)
    while len(chosen) < LABEL_COUNT:
        farthest = distance.argmax()
        chosen.append(choice[farthest])
        distance = np.minimum(distance, np.linalg.norm(places - places[farthest], axis=1))
    return np.array(chosen, dtype=np.uint8)


def _to_lab(colors: NDArray[np.integer]) -> NDArray[np.float64]:
    """Convert sRGB, 0 to 255, to the approximately perceptually uniform CIELAB (CIE 015), ``(..., 3)``."""
    parts = colors / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    xyz = linear @ _TO_XYZ.T
    x, y, z = np.moveaxis(np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29), -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def label_colors() -> NDArray[np.uint8]:
    """Return the constant color of every label, red, green and blue, shape ``(256, 3)`` uint8."""
    return _palette().copy()


def legend_of(labels: Iterable[int], names: LabelNames) -> dict[int, tuple[str, Color]]:
    """Return the legend of a map, with the meaning and color of each label."""
    colors = label_colors().tolist()
    legend: dict[int, tuple[str, Color]] = {}
    for number in sorted(map(int, labels)):
        is_custom = names.word(number) not in Label.__members__
        legend[number] = (names.name(number) if is_custom else MAP_LEGEND[Label(number)][0], tuple(colors[number]))
    return legend


def ground_bits(labels: Iterable[int]) -> object:
    """Return the ground labels as a bit mask for kernels, a `warpvis.kernels.maps.labels.GroundLabels`."""
    from warpvis.kernels.maps.labels import GroundLabels

    words = [0] * (LABEL_COUNT // 32)
    for label in labels:
        words[label // 32] |= 1 << label % 32
    return GroundLabels(*words)


@dataclass(frozen=True)
class FloorMap:
    """Maps of the floor as seen from above, one per view."""

    cells: wp.array
    """Label of each cell, ``(V, rows, columns)`` uint8; row 0 has the lowest second coordinate."""
    bounds: tuple[float, float, float, float]
    """Minimum and maximum of the first coordinate, then of the second [m]: matplotlib's ``extent``."""
    cell_size: float
    """Side of a cell [m]."""
    up: Literal["z", "y"]
    """The world's vertical axis. The map's axes are x and y where z is up, z and x where y is up."""
    label_names: LabelNames = field(default_factory=LabelNames)
    """Names of the classes."""

    @property
    def legend(self) -> dict[int, tuple[str, Color]]:
        """Meaning and color (red, green, blue; 0 to 255) of the labels in the map; see `MAP_LEGEND`."""
        return legend_of(np.unique(self.cells.numpy()), self.label_names)

    @property
    def axes(self) -> tuple[str, str]:
        """Names of the map's axes."""
        first, second = FLOOR_AXES[self.up]
        return "xyz"[first], "xyz"[second]

    def rgb(self) -> NDArray[np.uint8]:
        """Return the maps in color, ``(V, rows, columns, 3)``; as in `cells`, row 0 is the bottom of a picture."""
        return label_colors()[self.cells.numpy()]

    def area(self, label: Label | int | str) -> NDArray[np.float64]:
        """Compute the floor area of a label in each view [m^2], shape ``(V,)``."""
        count = (self.cells.numpy() == self.label_names.number(label)).sum(axis=(1, 2))
        return count * self.cell_size**2


def floor_map(
    points: ArrayInput,
    labels: ArrayInput,
    *,
    bounds: ArrayLike,
    cell_size: float = 0.02,
    up: Literal["z", "y"] = "z",
    level_tolerance: float = 0.01,
    robots: ArrayLike = (),
    label_names: Mapping[int, str] | None = None,
    ground_labels: Iterable[Label | int | str] = (Label.GROUND,),
    threads: int | None = None,
) -> FloorMap:
    """Project visible points to the floor, as in the paper's figure (c).

    A cell has the highest label of the points above it: ground is the lowest, followed by obstacles and user-defined
    classes by number; objects, humans and robots are highest. Between adjacent pixels of the same label at the same
    height (any ground; tops of obstacles within `level_tolerance`), the cells in between are filled.

    Args:
        points: World points [m], shape ``(V, H, W)`` vec3, NaN for no point.
        labels: Labels of the points, shape ``(V, H, W)`` uint8.
        bounds: Lower and upper corner of the map [m], shape ``(2, 2)`` on the floor's axes (x and y where z is up,
            z and x where y is up), or ``(2, 3)`` in the world (a scene's `bounds`).
        cell_size: Side of a cell [m].
        up: The world's vertical axis.
        level_tolerance: Maximum height difference of adjacent points of a level surface [m].
        robots: Discs to draw: rows of center on the floor's axes and radius [m], shape ``(R, 3)``.
        label_names: Names of user-defined classes for the legend: a scene's `label_names`.
        ground_labels: Classes that are ground: a scene's `ground_labels`.
        threads: Number of CPU threads; all cores by default. Each view is computed by one thread.

    Returns:
        The maps, on the device of `points`.
    """
    from warpvis.kernels.maps import floor_map as kernels

    device = points.device if isinstance(points, wp.array) else get_device("cpu")
    points = as_warp(points, wp.vec3, ("V", "H", "W"), name="points", device=device)
    labels = read_labels(labels, points.shape, device)
    names = LabelNames(label_names)
    ground = frozenset(names.numbers(ground_labels, "ground_labels"))
    low, high = check_floor_bounds(bounds, up)
    columns, rows = count_cells(high - low, check_length(cell_size, "cell_size", zero=False))

    grid = kernels.Grid()
    grid.first_axis, grid.second_axis = FLOOR_AXES[up]
    grid.up_axis = check_up(up)
    grid.origin, grid.cell = wp.vec2(*low), cell_size
    grid.level = check_length(level_tolerance, "level_tolerance", infinite=True)
    grid.ground = ground_bits(ground)
    discs = _check_robots(robots, device)

    shape = (len(points), rows, columns)
    marks = wp.zeros(shape, dtype=wp.int32, device=device)
    cells = empty(shape, wp.uint8, name="the map", device=device)
    launch_images(
        kernels.mark_cells,
        points.shape,
        lambda window: [window, grid, points, labels, marks],
        device=device,
        threads=threads,
        split_views=False,  # Warp's atomics are not atomic on the CPU: only one thread may write to a map
    )
    launch_images(
        kernels.finish_map,
        shape,
        lambda window: [window, grid, marks, discs, cells],
        device=device,
        threads=threads,
    )
    first, second = low.tolist()
    extent = (first, first + columns * cell_size, second, second + rows * cell_size)
    return FloorMap(cells, extent, cell_size, up, names)


def check_floor_bounds(bounds: ArrayLike, up: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    check_up(up)
    corners = as_numpy(bounds, name="bounds").astype(np.float64)
    if corners.shape == (2, 3):
        corners = corners[:, FLOOR_AXES[up]]
    if corners.shape != (2, 2) or not np.isfinite(corners).all() or (corners[1] <= corners[0]).any():
        raise ArrayError(
            f"bounds must be the lower and upper corner of the map, shape (2, 2) or (2, 3), got {corners.tolist()}"
        )
    return corners[0], corners[1]


def count_cells(size: NDArray[np.float64], side: float, grid: str = "a map", cells: str = "cells") -> list[int]:
    """Return the number of cells along each axis of a grid."""
    # Tolerate rounding of the quotient: a map of 4 m in cells of 2 cm has 200 cells.
    counts = np.ceil(size / side - 1e-6).clip(min=1)
    if counts.prod() > _MAX_CELLS:
        shape = " x ".join(f"{count:.0f}" for count in counts)
        raise ArrayError(
            f"{grid} must have at most {_MAX_CELLS} {cells}, got {shape}; use a cell_size greater than {side} m"
        )
    return [int(count) for count in counts]


def _check_robots(robots: ArrayLike, device: wp.Device) -> wp.array:
    discs = as_numpy(robots, name="robots").astype(np.float32)
    if discs.size == 0:
        return wp.zeros(0, dtype=wp.vec3, device=device)
    if discs.ndim != 2 or discs.shape[1] != 3 or not np.isfinite(discs).all():
        raise ArrayError(f"robots must be finite rows of center and radius [m], shape (R, 3), got shape {discs.shape}")
    return wp.array(discs, dtype=wp.vec3, device=device)
