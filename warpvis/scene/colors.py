# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of colors and vectors of lights and materials, and color space conversions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from warpvis.errors import SceneError

_COUNTS = {2: "two", 3: "three", 4: "four"}


def as_numbers(value: ArrayLike, message: str) -> np.ndarray:
    """Return an array of integers or floats; raise a `SceneError` with the message for anything else."""
    try:
        numbers = np.asarray(value)
    except (TypeError, ValueError, OverflowError, RuntimeError):  # other libraries' arrays may raise any exception
        raise SceneError(message) from None
    if numbers.dtype.kind not in "iuf":
        raise SceneError(message)
    return numbers


def check_color(
    color: ArrayLike, subject: str, lengths: tuple[int, ...], *, maximum: float = 1.0, alternatives: str = ""
) -> tuple[Any, ...]:
    """Return a color of one of the `lengths` as numbers; the fourth is 1 where it is optional and not given."""
    count = " or ".join(_COUNTS[length] for length in lengths)
    limit = "from 0 to 1" if maximum == 1 else "of at least 0"
    message = f"{subject} must be {alternatives}{count} numbers {limit}, got {shown(color)}"
    numbers = as_numbers(color, message)
    if numbers.ndim != 1 or len(numbers) not in lengths:
        raise SceneError(message)
    values = numbers.astype(np.float64).tolist()
    if not all(0 <= value <= maximum and value != np.inf for value in values):
        raise SceneError(message)
    return (*values, *([1.0] if len(values) < lengths[-1] else []))


def check_vector(vector: ArrayLike, subject: str) -> tuple[float, float, float]:
    """Return three finite numbers."""
    message = f"{subject} must be three finite numbers, got {shown(vector)}"
    numbers = as_numbers(vector, message)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise SceneError(message)
    return tuple(numbers.astype(np.float64).tolist())


def linear_color(color: ArrayLike) -> tuple[float, ...]:
    """Convert an sRGB color, from 0 to 1, to a linear one (IEC 61966-2-1)."""
    parts = np.asarray(color, dtype=np.float64)
    return tuple(np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4).tolist())


def screen_color(color: ArrayLike) -> tuple[float, ...]:
    """Convert a linear color to sRGB."""
    parts = np.asarray(color, dtype=np.float64)
    return tuple(np.where(parts <= 0.0031308, parts * 12.92, 1.055 * parts ** (1 / 2.4) - 0.055).tolist())


def shown(value: object) -> str:
    """Return the text of a value for a message: its type, if its repr is long."""
    text = repr(value)
    return text if len(text) <= 80 else type(value).__name__
