# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Autocorrelation of the noise between pixels, and the spacing of nodes that reproduces it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.sensors.depth._walls import Wall

MAX_LAG = 64
"""Maximum lag of the autocorrelation [px]; also limited to a quarter of the image."""

_MAX_SPACING = 64


def correlation(walls: list[Wall], rounding: float) -> NDArray[np.float64]:
    """Return the autocorrelation of 1 / z about the planes, along rows and columns, at lags of 0, 1, 2, ... px.

    Args:
        walls: The images.
        rounding: Variance of the rounding error [1/m^2], which is uncorrelated between pixels.
    """
    max_lag = min(MAX_LAG, *(min(wall.known.shape) // 4 for wall in walls))
    sums, counts = np.zeros(max_lag + 1), np.zeros(max_lag + 1)
    for wall in walls:
        filled, known = np.where(wall.known, wall.inverse - wall.plane, 0.0), wall.known
        for lag in range(max_lag + 1):
            for rows, valid in ((filled, known), (filled.T, known.T)):
                sums[lag] += (rows[lag:] * rows[: len(rows) - lag]).sum()
                counts[lag] += (valid[lag:] & valid[: len(valid) - lag]).sum()
    products = sums / np.maximum(counts, 1)
    products[0] = max(products[0] - rounding, products[0] * 1e-3)
    return products / products[0]


def expected_correlation(spacing: int, count: int) -> NDArray[np.float64]:
    """Return the autocorrelation of the noise of `StereoDepth` at lags of 0, 1, 2, ... px along a row.

    It is averaged over a cell. Pixel i of a cell is the sum of the previous node times cos(a) and the next node times
    sin(a), with a = pi / 2 i / spacing.
    """
    angle = np.arange(spacing) / spacing * (np.pi / 2)
    weights = np.zeros((spacing, 2 * spacing + count + 2))
    result = np.empty(count)
    for lag in range(count):
        pixel = np.arange(spacing) + lag
        cell, lagged = pixel // spacing, pixel % spacing / spacing * (np.pi / 2)
        weights = np.where(cell == 0, np.cos(angle) * np.cos(lagged) + np.sin(angle) * np.sin(lagged), 0.0)
        weights = np.where(cell == 1, np.sin(angle) * np.cos(lagged), weights)
        result[lag] = weights.mean()
    return result


def find_spacing(measured: NDArray[np.float64]) -> int:
    """Return the spacing whose autocorrelation fits best in the sense of least squares."""
    spacings = range(1, min(_MAX_SPACING, len(measured) - 1) + 1)
    errors = [float(((expected_correlation(spacing, len(measured)) - measured) ** 2).sum()) for spacing in spacings]
    return spacings[int(np.argmin(errors))]
