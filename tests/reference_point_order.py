# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of the kernels of `warpvis.kernels.casting.point_order`; see `reference`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

OUTSIDE_CELLS = 1024


def hilbert_curve(bits: int) -> NDArray[np.int64]:
    """Return cells ``(x, y)`` in Hilbert order, composed recursively of four smaller curves."""
    if bits == 0:
        return np.zeros((1, 2), dtype=np.int64)
    part, side = hilbert_curve(bits - 1), 1 << (bits - 1)
    swapped = part[:, ::-1]
    return np.concatenate(
        [swapped, part + [0, side], part + [side, side], np.array([2 * side - 1, side - 1]) - swapped]
    )


def _inside(at: NDArray, size: tuple[int, int]) -> NDArray[np.bool_]:
    return ((at >= 0) & (at < size)).all(axis=-1)


def cells_of(at: NDArray, size: tuple[int, int], bits: int) -> NDArray[np.int64]:
    """Return the cell of each point, in single precision, which decides at cell borders."""
    side, curve = 1 << bits, hilbert_curve(bits)
    number = np.empty((side, side), dtype=np.int64)
    number[curve[:, 0], curve[:, 1]] = np.arange(side * side)
    inside = _inside(at, size)
    cell = np.where(inside[..., None], at, 0).astype(np.float32) / np.float32(size) * np.float32(side)
    cell = np.minimum(cell.astype(np.int64), side - 1)
    return np.where(inside, number[cell[..., 0], cell[..., 1]], side * side + np.arange(at.shape[-2]) % OUTSIDE_CELLS)


def count_points(at: NDArray, size: tuple[int, int], bits: int) -> NDArray[np.int64]:
    """Return the number of points in each cell of each view, shape (views, cells)."""
    cells = cells_of(at, size, bits)
    return np.stack([np.bincount(row, minlength=(1 << 2 * bits) + OUTSIDE_CELLS) for row in cells])


def sort_points(at: NDArray, size: tuple[int, int], bits: int) -> NDArray[np.int64]:
    """Return the points of each view sorted by their cells, shape (views, points)."""
    return np.argsort(cells_of(at, size, bits), axis=-1, kind="stable")


def measure_blocks(at: NDArray, columns: int, size: tuple[int, int], step: int, most: float) -> NDArray[np.float64]:
    """Return the excess of the extent of sampled blocks of points over `most`, summed for each view."""
    total = np.zeros(len(at))
    for view, points in enumerate(at):
        rows = points.reshape(-1, columns, 2)
        for y in range(0, len(rows), 4):
            for x in range(0, columns, 8 * step):
                block = rows[y : y + 4, x : x + 8]
                corners = block[[0, 0, -1, -1], [0, -1, 0, -1]]
                corners = corners[_inside(corners, size)].astype(np.float64)
                if len(corners):
                    total[view] += min(np.ptp(corners, axis=0).sum() - most, 8 * most)
    return total


def clear_unused(used: NDArray, points: NDArray) -> NDArray:
    """Return points (V, N, 2) with NaN for those that are not used."""
    return np.where((np.arange(points.shape[1]) < used[:, None])[..., None], points, np.nan)
