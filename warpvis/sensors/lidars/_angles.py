# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Directions by angles, and how often a lidar turns: what the modules of its makers share."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.checks import as_items, check_angle, check_number
from warpvis.errors import CameraError


def directions_at(azimuth: ArrayLike, elevation: ArrayLike) -> NDArray[np.float64]:
    """Return unit vectors of the sensor frame (x forward, y left, z up), shape ``(..., 3)``.

    Args:
        azimuth: Angles from x towards y, so to the left [rad].
        elevation: Angles above the horizontal plane [rad]; both are broadcast against each other.
    """
    azimuth, elevation = np.broadcast_arrays(
        np.asarray(azimuth, dtype=np.float64), np.asarray(elevation, dtype=np.float64)
    )
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


def check_rate(rate: object, least: float, most: float) -> float:
    """Return how often a sensor turns in a second.

    Raises:
        CameraError: It is no number, or not one that the sensor turns at.
    """
    return check_number(rate, "rate", least=least, most=most, error=CameraError)


def check_increment(increment: object, name: str) -> float:
    """Return the angle between neighboring rays [rad], which is less than a turn.

    Raises:
        CameraError: If it is none.
    """
    return check_angle(increment, name, least=-2.0 * math.pi, most=2.0 * math.pi, error=CameraError)


def check_span(span: object, name: str, most: float = math.inf) -> tuple[float, float]:
    """Return two angles [rad], the lower one first.

    Raises:
        CameraError: They are not two angles from `-most` to `most`, in this order.
    """
    ends = as_items(span, name, CameraError)
    if len(ends) != 2:
        raise CameraError(f"{name} must be two angles in radians, got {span!r}")
    low, high = (
        check_angle(end, f"{name}[{place}]", least=-most, most=most, error=CameraError)
        for place, end in enumerate(ends)
    )
    if low > high:
        raise CameraError(f"{name} must be two angles, the lower one first, got {low:g} and {high:g}")
    return low, high
