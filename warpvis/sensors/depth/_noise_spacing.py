# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""How far noise goes on from one pixel to its neighbours, and which spacing of nodes makes it so."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.sensors.depth._walls import Wall

MAX_LAG = 64
"""Distances at which pixels are compared [px]: up to this, and to a quarter of the picture."""

_MAX_SPACING = 64


def correlation(walls: list[Wall], rounding: float) -> NDArray[np.float64]:
    """Return the autocorrelation of 1 / z about the planes, along rows and columns, at 0, 1, 2, ... px.

    Args:
        walls: The pictures.
        rounding: Variance that rounding adds [1/m^2], of which neighbours know nothing.
    """
    most = min(MAX_LAG, *(min(wall.known.shape) // 4 for wall in walls))
    sums, counts = np.zeros(most + 1), np.zeros(most + 1)
    for wall in walls:
        filled, known = np.where(wall.known, wall.inverse - wall.plane, 0.0), wall.known
        for lag in range(most + 1):
            for rows, there in ((filled, known), (filled.T, known.T)):
                sums[lag] += (rows[lag:] * rows[: len(rows) - lag]).sum()
                counts[lag] += (there[lag:] & there[: len(there) - lag]).sum()
    products = sums / np.maximum(counts, 1)
    products[0] = max(products[0] - rounding, products[0] * 1e-3)
    return products / products[0]


def expected_correlation(spacing: int, count: int) -> NDArray[np.float64]:
    """Return the autocorrelation of `StereoDepth`'s noise at 0, 1, 2, ... px along a row, the mean over a cell.

    A pixel i of a cell takes cos(a) of the node before it and sin(a) of the node behind, a = pi / 2 i / spacing.
    """
    angle = np.arange(spacing) / spacing * (np.pi / 2)
    weights = np.zeros((spacing, 2 * spacing + count + 2))
    found = np.empty(count)
    for lag in range(count):
        place = np.arange(spacing) + lag
        cell, turn = place // spacing, place % spacing / spacing * (np.pi / 2)
        weights = np.where(cell == 0, np.cos(angle) * np.cos(turn) + np.sin(angle) * np.sin(turn), 0.0)
        weights = np.where(cell == 1, np.sin(angle) * np.cos(turn), weights)
        found[lag] = weights.mean()
    return found


def find_spacing(measured: NDArray[np.float64]) -> int:
    """Return the spacing whose autocorrelation is nearest, by least squares."""
    spacings = range(1, min(_MAX_SPACING, len(measured) - 1) + 1)
    errors = [float(((expected_correlation(spacing, len(measured)) - measured) ** 2).sum()) for spacing in spacings]
    return spacings[int(np.argmin(errors))]
