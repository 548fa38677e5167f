# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Points of a map for display: its surface, and the border of what was measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.maps import Voxel, VoxelMap


@dataclass(frozen=True, eq=False)
class MapPoints:
    """Centers of voxels [m], evenly thinned out if there are too many."""

    surface: NDArray[np.float32]
    """Voxels of surfaces, ``(N, 3)``."""
    unknown: NDArray[np.float32]
    """Voxels that no image has measured, next to free ones, ``(M, 3)``: unknown space begins there."""


def map_points(voxels: VoxelMap, *, max_height: float, max_points: int) -> MapPoints:
    """Return at most `max_points` points of each kind, of voxels whose centers are between the floor and a height.

    Args:
        voxels: The map, with z up and the floor at z = 0.
        max_height: Maximum height [m].
        max_points: Maximum number of points.
    """
    states = voxels.states.numpy()
    heights = voxels.origin[2] + voxels.cell_size * (np.arange(states.shape[2]) + 0.5)
    top = int(np.searchsorted(heights, max_height))
    first = int(np.searchsorted(heights, -voxels.cell_size))
    surface = np.argwhere(states[:, :, :top] == Voxel.SURFACE)
    part = states[:, :, first:top]
    free = part == Voxel.FREE
    border = np.zeros_like(free)
    for axis in range(3):
        low, high = (
            tuple(index if axis == other else slice(None) for other in range(3))
            for index in (slice(None, -1), slice(1, None))
        )
        border[low] |= free[high]
        border[high] |= free[low]
    unknown = np.argwhere(border & (part < Voxel.FREE)) + (0, 0, first)
    return MapPoints(*(_centers(voxels, indices, max_points) for indices in (surface, unknown)))


def _centers(voxels: VoxelMap, indices: NDArray[np.int64], max_points: int) -> NDArray[np.float32]:
    if len(indices) > max_points:
        indices = indices[np.linspace(0, len(indices) - 1, max_points).astype(np.int64)]
    return (np.array(voxels.origin) + voxels.cell_size * (indices + 0.5)).astype(np.float32)
