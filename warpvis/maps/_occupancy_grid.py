# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Occupancy grids of the floor: values of ROS's ``nav_msgs/OccupancyGrid``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import check_up
from warpvis.maps._floor_map import FLOOR_AXES
from warpvis.maps._voxel_map import Voxel, VoxelMap

OCCUPIED, FREE, UNKNOWN = 100, 0, -1
"""Values of cells, as in ``nav_msgs/OccupancyGrid``."""

# Tolerance of the share of unknown voxels.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class OccupancyGrid:
    """Which columns of space above the floor are free."""

    cells: NDArray[np.int8]
    """100 if occupied, 0 if free, -1 if unknown, ``(rows, columns)``; row 0 has the lowest second coordinate."""
    origin: tuple[float, float]
    """Lower corner of the first cell on the map's axes [m]."""
    cell_size: float
    """Side of a cell [m]."""
    up: Literal["z", "y"]
    """The world's vertical axis. The map's axes are x and y where z is up, z and x where y is up."""


def project_columns(band: VoxelMap, max_unknown: float, *, trim: bool) -> OccupancyGrid:
    """Return the grid of the columns of a map; `trim` removes unknown rows and columns at its sides."""
    first, second = FLOOR_AXES[band.up]
    columns = np.transpose(band.states.numpy(), (second, first, check_up(band.up)))
    free = (columns == Voxel.FREE).mean(axis=2)
    cells = np.full(free.shape, UNKNOWN, dtype=np.int8)
    cells[(free > 0) & (1.0 - free <= max_unknown + _ROUNDING)] = FREE
    cells[(columns == Voxel.SURFACE).any(axis=2)] = OCCUPIED
    row = column = 0
    if trim and (cells != UNKNOWN).any():
        rows, places = (np.flatnonzero((cells != UNKNOWN).any(axis=axis)) for axis in (1, 0))
        row, column = int(rows[0]), int(places[0])
        cells = cells[row : rows[-1] + 1, column : places[-1] + 1].copy()
    corner = band.origin[first] + column * band.cell_size, band.origin[second] + row * band.cell_size
    return OccupancyGrid(cells, corner, band.cell_size, band.up)
