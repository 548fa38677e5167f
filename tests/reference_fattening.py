# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision reference of `kernels.sensors.fattening`: pixels scan their windows of the row, then the column."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def fatten_surfaces(
    true_depth: NDArray, scale: float, step: float, reach: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the index of the pixel shown by each pixel (V, H, W), and the margin [px] of its decisions."""
    views, height, width = true_depth.shape
    shown = np.broadcast_to(np.arange(height * width).reshape(height, width), true_depth.shape)
    disparity, margin = scale / true_depth.astype(np.float64), np.full(true_depth.shape, np.inf)
    for axis in (2, 1):
        closest, found = np.full(true_depth.shape, np.inf), shown
        seen_margin = margin
        for lag in range(-reach, reach + 1):
            places = np.arange(true_depth.shape[axis]) + lag
            inside = (places >= 0) & (places < true_depth.shape[axis])
            inside = inside if axis == 2 else inside[:, None]
            places = np.clip(places, 0, true_depth.shape[axis] - 1)
            in_front = np.where(inside, np.take(disparity, places, axis) - disparity, -np.inf)
            taken = (in_front >= step) & (abs(lag) < closest)
            found = np.where(taken, np.take(shown, places, axis), found)
            closest = np.where(taken, abs(lag), closest)
            seen_margin = np.minimum(seen_margin, np.minimum(np.abs(in_front - step), np.take(margin, places, axis)))
        shown, margin = found, seen_margin
        disparity = np.take_along_axis(
            scale / true_depth.astype(np.float64).reshape(views, -1), shown.reshape(views, -1), 1
        )
        disparity = disparity.reshape(true_depth.shape)
    return shown, margin
