# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Guesses of a scene's unit from its size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Range of typical model sizes, from a cup to a hall [m], and size above which millimeters are more likely than meters.
_MIN_MODEL, _LARGEST_MODEL = 0.01, 100.0
_MANY_METERS = 60.0

# A scene this many times larger than the camera's range is rarely intended.
_TOO_LARGE = 10.0


def fits_millimeters(size: NDArray[np.floating]) -> bool:
    """Return whether a scene's size, read as millimeters, is typical of models."""
    return bool(_MIN_MODEL <= np.max(size) / 1000 <= _LARGEST_MODEL)


def looks_like_millimeters(size: NDArray[np.floating]) -> bool:
    """Return whether a scene's sides [m] are more likely millimeters: all are large, except for flat scenes."""
    return fits_millimeters(size) and bool(np.max(size) > _MANY_METERS) and bool(np.median(size) > _MANY_METERS / 4)


def too_large_for(size: NDArray[np.floating], far: float) -> bool:
    """Return whether a scene's sides [m] are likely millimeters, given a camera of range `far` that sees nothing."""
    return bool(np.max(size) > _TOO_LARGE * far) and fits_millimeters(size)
