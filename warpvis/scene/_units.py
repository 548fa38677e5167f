# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What the size of a scene says of its unit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# What people model and measure, from a cup to a hall [m], and from where on metres are less likely than millimetres.
_MIN_MODEL, _LARGEST_MODEL = 0.01, 100.0
_MANY_METRES = 60.0

# A scene that is so many times as large as the camera sees far is rarely meant.
_TOO_LARGE = 10.0


def fits_millimetres(size: NDArray[np.floating]) -> bool:
    """Tell whether a scene's sides, taken for millimetres, are those of what people model."""
    return bool(_MIN_MODEL <= np.max(size) / 1000 <= _LARGEST_MODEL)


def looks_like_millimetres(size: NDArray[np.floating]) -> bool:
    """Tell whether a scene's sides [m] are more likely millimetres: every one of them is large, but for flat ones."""
    return fits_millimetres(size) and bool(np.max(size) > _MANY_METRES) and bool(np.median(size) > _MANY_METRES / 4)


def too_large_for(size: NDArray[np.floating], far: float) -> bool:
    """Tell whether a scene's sides [m] are millimetres, if a camera that sees so far sees nothing of it."""
    return bool(np.max(size) > _TOO_LARGE * far) and fits_millimetres(size)
