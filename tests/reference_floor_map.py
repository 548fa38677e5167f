# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of the kernels of floor maps."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray
from reference_voxels import precedence

from warpvis import Label


def mark_cells(
    points: NDArray,
    labels: NDArray,
    low: NDArray,
    cell: float,
    shape: tuple[int, int],
    sigma: float,
    ground: Collection[int] = (1,),
) -> NDArray[np.int64]:
    """Return the cells of one view's map, z up, by definition: points first, then level quads of four pixels."""
    cells = np.zeros(shape, dtype=np.int64)
    order = precedence(np.arange(256), ground)
    at = (points[..., :2].astype(np.float64) - low) / cell

    def mark(row: int, column: int, label: int) -> None:
        if 0 <= row < shape[0] and 0 <= column < shape[1]:
            cells[row, column] = max(cells[row, column], label, key=lambda number: order[number])

    def in_triangle(a: NDArray, b: NDArray, c: NDArray, p: NDArray) -> bool:
        sides = [(q - o)[0] * (p - o)[1] - (q - o)[1] * (p - o)[0] for o, q in ((a, b), (b, c), (c, a))]
        return min(sides) >= 0 or max(sides) <= 0

    for y, x in np.argwhere((labels != Label.EMPTY) & np.isfinite(points).all(axis=-1)):
        label = labels[y, x]
        mark(*np.floor(at[y, x, ::-1]).astype(int), label)
        quad = [(y, x), (y, x + 1), (y + 1, x + 1), (y + 1, x)]
        if y + 1 >= labels.shape[0] or x + 1 >= labels.shape[1] or any(labels[q] != label for q in quad):
            continue
        heights = np.array([points[q][2] for q in quad])
        level = label in ground or (np.abs(heights - heights[0]) < sigma).all()
        if not level or not np.isfinite([points[q] for q in quad]).all():
            continue
        a, b, c, d = (at[q] for q in quad)
        low_cell = np.maximum(np.floor(np.min([a, b, c, d], axis=0)), 0).astype(int)
        high_cell = np.minimum(np.floor(np.max([a, b, c, d], axis=0)) + 1, shape[::-1]).astype(int)
        for row in range(low_cell[1], high_cell[1]):
            for column in range(low_cell[0], high_cell[0]):
                center = np.array([column + 0.5, row + 0.5])
                if in_triangle(a, b, c, center) or in_triangle(a, c, d, center):
                    mark(row, column, label)
    return cells


def finish_map(cells: NDArray, low: NDArray, cell: float, robots: NDArray) -> NDArray[np.uint8]:
    rows, columns = np.indices(cells.shape)
    centers = low + cell * np.stack([columns + 0.5, rows + 0.5], axis=-1)
    out = cells.copy()
    for x, y, radius in robots:
        out[np.linalg.norm(centers - [x, y], axis=-1) <= radius] = Label.ROBOT
    return out.astype(np.uint8)
