# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of `kernels.sensors.fattening`: every pixel scans its whole window."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray


def find_nearest_in_rows(true_depth: NDArray, reach: int) -> NDArray[np.float64]:
    """Return the smallest depth within `reach` pixels in the same row, (V, H, W)."""
    beside = np.pad(true_depth.astype(np.float64), ((0, 0), (0, 0), (reach, reach)), constant_values=np.inf)
    return sliding_window_view(beside, 2 * reach + 1, axis=2).min(axis=-1)


def fatten_surfaces(
    true_depth: NDArray, scale: float, step: float, reach: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the index of the pixel shown by each pixel (V, H, W), and the margin [px] of its decision."""
    height, width = true_depth.shape[1:]
    disparity = scale / true_depth.astype(np.float64)
    y, x = np.mgrid[:height, :width]
    shown = np.broadcast_to(y * width + x, true_depth.shape).copy()
    closest, margin = np.full(true_depth.shape, np.inf), np.full(true_depth.shape, np.inf)
    for down in range(-reach, reach + 1):
        for across in range(-reach, reach + 1):
            row, column = y + down, x + across
            inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
            row, column = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
            apart = np.where(inside, disparity[:, row, column] - disparity, -np.inf)
            margin = np.minimum(margin, np.abs(apart - step))
            taken = (apart >= step) & (down**2 + across**2 < closest)
            shown = np.where(taken, row * width + column, shown)
            closest = np.where(taken, down**2 + across**2, closest)
    return shown, margin
