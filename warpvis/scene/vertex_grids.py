# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cells of boxes, rectangles and round solids, at whose corners light is computed if it is computed per vertex."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from warpvis.scene.solids import Solid, SolidKind

if TYPE_CHECKING:
    from warpvis.kernels.shading.base_colors import DeviceVertexGrid

GridKind = Literal["box", "plane", "round"]
Numbers = tuple[float, float, float]

_ZERO, _ONE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
_DEVICE_KINDS = ("triangles", *get_args(GridKind)[:2])
"""In the order of `CornerFinder` of kernels/native/shared/vertex_grids.h, which round solids follow."""
_SOLIDS = (SolidKind.BALL, SolidKind.CYLINDER, SolidKind.CAPSULE)


@dataclass(frozen=True)
class VertexGrid:
    """The cells into which OpenGL renderers divide a shape, each of which is two triangles.

    The sides of a box and a rectangle in the plane z = 0 are divided along the axes of the frame that the object was
    added in: from the lower end, the first cell has the width `first`, the last one what remains, and others `step`.
    """

    kind: GridKind
    half: Numbers = _ONE
    """Half sizes of a box or a rectangle [m]."""
    counts: tuple[int, int, int] = (1, 1, 1)
    """Numbers of cells: of a box or a rectangle along x, y and z; of a round solid around z, along a cylinder, and from
    the middle to the ends of a ball or a cylinder's cap."""
    first: Numbers = _ONE
    """Widths of the first cells [m]."""
    step: Numbers = _ONE
    """Widths of other cells [m]."""
    period: Numbers = _ZERO
    """Steps in which an endless rectangle follows the camera [m]; 0 if it does not."""


def round_grid(slices: int, stacks: int) -> VertexGrid:
    """Return the cells of a round solid, divided around its axis and along it."""
    return VertexGrid("round", counts=(slices, stacks, max(stacks // 2, 1)))


def box_grid(half: ArrayLike, count: int) -> VertexGrid:
    """Return the cells of a box of three half sizes [m], `count` by `count` on each side."""
    x, y, z = np.asarray(half, dtype=np.float64).tolist()
    widths = 2 * x / count, 2 * y / count, 2 * z / count
    return VertexGrid("box", (x, y, z), (count,) * 3, widths, widths)


_DEFAULT_ROUND = round_grid(28, 16)  # MuJoCo's `vis.quality`


def device_grid(grid: VertexGrid | None, solid: Solid | None, place: ArrayLike) -> DeviceVertexGrid:
    """Return the grid of an object, from a pose in the frame of its entry, as the struct that kernels read."""
    from warpvis.kernels.shading.base_colors import DeviceVertexGrid

    record = DeviceVertexGrid()
    record.place = wp.transform(*place)  # type: ignore[misc]
    if solid is not None:
        grid = grid if grid is not None and grid.kind == "round" else _DEFAULT_ROUND
        record.kind = len(_DEVICE_KINDS) + _SOLIDS.index(solid.kind)
        record.half, record.straight = wp.vec3(*solid.radii), solid.half
    elif grid is not None and grid.kind != "round":
        record.kind, record.half = _DEVICE_KINDS.index(grid.kind), wp.vec3(*grid.half)
    if grid is not None:
        for name in ("first", "step", "period"):
            setattr(record, name, wp.vec3(*getattr(grid, name)))
        record.count = wp.vec3i(*grid.counts)
    return record
