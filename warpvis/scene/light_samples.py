# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Points of lights and directions of ambient light, to which pixels cast rays.

A pixel has the class ``4 (y mod 4) + x mod 4``, and all pixels of a class have the same points, so that rays of a
packet have a common light. The classes divide a larger set of points: the mean over 4 x 4 pixels is smoother by far.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

CLASSES = 16
"""Number of classes of pixels."""

_GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
# Powers of the inverse of the root of x^4 = x + 1: a sequence of low discrepancy in three dimensions (R3).
_STEPS = 1.2207440846057596 ** -np.arange(1.0, 4.0)
# Order of a 4 x 4 Bayer matrix: consecutive numbers are far apart.
_ORDER = np.array([0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5])


def _numbers(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return three numbers from 0 to 1 for each sample of each class, shape ``(CLASSES, count)``."""
    shift = np.mod(0.5 + _ORDER[:, None] * _STEPS, 1.0)
    sample = np.arange(count)
    first = (sample + shift[:, :1]) / count
    second = np.mod(sample * _GOLDEN + shift[:, 1:2], 1.0)
    third = np.mod(sample * _STEPS[2] + shift[:, 2:], 1.0)
    return first, second, third


@cache
def sphere_samples(count: int) -> NDArray[np.float32]:
    """Return points of a unit ball that are uniform on a disk from every direction, ``(CLASSES, count, 3)``.

    They are uniform points of the sphere in four dimensions without their last coordinate; without two coordinates,
    such points are uniform on a disk. Each class has a spiral of equal areas in x and y.
    """
    area, turn, other = _numbers(count)
    radius = np.sqrt(area)
    rows = [
        radius * np.cos(2 * np.pi * turn),
        radius * np.sin(2 * np.pi * turn),
        np.sqrt(1 - area) * np.cos(2 * np.pi * other),
    ]
    return np.stack(rows, axis=-1).astype(np.float32)


@cache
def direction_samples(count: int) -> NDArray[np.float32]:
    """Return unit vectors, uniform on the sphere, shape ``(CLASSES, count, 3)``."""
    height, turn, _ = _numbers(count)
    z = 1 - 2 * height
    radius = np.sqrt(1 - z**2)
    rows = [radius * np.cos(2 * np.pi * turn), radius * np.sin(2 * np.pi * turn), z]
    return np.stack(rows, axis=-1).astype(np.float32)
