# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Directions from angles, and checks of angles and revolution rates, shared by the lidar modules."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.checks import as_items, check_angle, check_number
from warpvis.errors import CameraError


def directions_at(azimuth: ArrayLike, elevation: ArrayLike) -> NDArray[np.float64]:
    """Return unit vectors of the sensor frame (x forward, y left, z up), shape ``(..., 3)``.

    Args:
        azimuth: Angles from x toward y, that is to the left [rad].
        elevation: Angles above the horizontal plane [rad]. Both are broadcast against each other.
    """
    azimuth, elevation = np.broadcast_arrays(
        np.asarray(azimuth, dtype=np.float64), np.asarray(elevation, dtype=np.float64)
    )
    horizontal = np.cos(elevation)
    return np.stack([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), np.sin(elevation)], axis=-1)


def check_rate(rate: object, minimum: float, maximum: float) -> float:
    """Check that `rate` is a revolution rate within limits [Hz], and return it.

    Raises:
        CameraError: If `rate` is not a number from `minimum` to `maximum`.
    """
    return check_number(rate, "rate", minimum=minimum, maximum=maximum, error=CameraError)


def check_increment(increment: object, name: str) -> float:
    """Check that an angle between adjacent rays is at most a full turn [rad], and return it.

    Raises:
        CameraError: If it is not such an angle.
    """
    return check_angle(increment, name, minimum=-2.0 * math.pi, maximum=2.0 * math.pi, error=CameraError)


def check_span(span: object, name: str, maximum: float = math.inf) -> tuple[float, float]:
    """Check that `span` is two angles in ascending order [rad], and return them.

    Raises:
        CameraError: If `span` is not two ascending angles from ``-maximum`` to `maximum`.
    """
    ends = as_items(span, name, CameraError)
    if len(ends) != 2:
        raise CameraError(f"{name} must be two angles in radians, got {span!r}")
    low, high = (
        check_angle(end, f"{name}[{index}]", minimum=-maximum, maximum=maximum, error=CameraError)
        for index, end in enumerate(ends)
    )
    if low > high:
        raise CameraError(f"{name} must be two angles, the lower one first, got {low:g} and {high:g}")
    return low, high
