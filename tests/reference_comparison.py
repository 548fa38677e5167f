# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reference of the kernel that compares measured with expected depth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from warpvis import Camera
from warpvis.maps import Agreement


def compare_depth(
    camera: Camera,
    expected: NDArray,
    depth: NDArray,
    sigma: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    *,
    threshold: float = 4.0,
    tolerance: float = 0.0,
    edge: int = 1,
    empty: int = Agreement.NO_SURFACE,
) -> tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]]:
    """Return labels of one view, residuals, and the distance of depth to the nearest limit [m]."""
    expected, depth = expected.astype(np.float64), depth.astype(np.float64)
    size = 2 * edge + 1
    unknown = np.isnan(expected)
    nearest = ndimage.minimum_filter(np.where(unknown, np.inf, expected), size, mode="nearest")
    farthest = ndimage.maximum_filter(np.where(unknown, 0.0, expected), size, mode="nearest")
    with np.errstate(invalid="ignore"):
        measured = np.isfinite(depth) & (depth > 0) & (depth >= camera.near) & (depth <= camera.far)
        below = depth - (nearest - tolerance - threshold * sigma(nearest))
        above = np.where(np.isinf(farthest), np.inf, farthest + tolerance + threshold * sigma(farthest) - depth)
        own = np.where(
            ~np.isfinite(expected), -np.inf, tolerance + threshold * sigma(expected) - np.abs(depth - expected)
        )
        labels = np.select(
            [~measured, own >= 0, np.isinf(nearest), below < 0, above < 0],
            [Agreement.NO_MEASUREMENT, Agreement.AGREES, empty, Agreement.NEARER, Agreement.FARTHER],
            Agreement.AGREES,
        )
        residual = np.where(measured & np.isfinite(expected), (depth - expected) / sigma(expected), np.nan)
        labels = np.where(unknown & (labels > Agreement.AGREES), Agreement.NO_SURFACE, labels)
        margin = np.fmin(np.abs(np.fmin(below, above)), np.abs(own))
    return labels.astype(np.uint8), residual, margin
