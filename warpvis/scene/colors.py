# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of colours and of places and directions, as lights and materials have them; and their colour spaces."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from warpvis.errors import SceneError

_COUNTS = {2: "two", 3: "three", 4: "four"}


def check_color(
    given: ArrayLike, what: str, lengths: tuple[int, ...], *, most: float = 1.0, or_what: str = ""
) -> tuple[Any, ...]:
    """Return a colour as numbers, of which the fourth is 1 where three are given and four could be.

    Args:
        given: The colour.
        what: What it is of, for messages.
        lengths: How many numbers it may have.
        most: What they are at most; infinity for any number that is finite.
        or_what: What else could be given, for messages.

    Raises:
        SceneError: It is no such colour.
    """
    count = " or ".join(_COUNTS[length] for length in lengths)
    limit = "from 0 to 1" if most == 1 else "of at least 0"
    message = f"{what} must be {or_what}{count} numbers {limit}, got {shown(given)}"
    try:
        numbers = np.asarray(given)
        if numbers.dtype.kind not in "iuf" or numbers.ndim != 1 or len(numbers) not in lengths:
            raise SceneError(message)
    except (TypeError, ValueError, RuntimeError):  # arrays of other libraries raise what they like
        raise SceneError(message) from None
    values = numbers.astype(np.float64).tolist()
    if not all(0 <= value <= most and value != np.inf for value in values):
        raise SceneError(message)
    return (*values, *([1.0] if len(values) < lengths[-1] else []))


def check_vector(given: ArrayLike, what: str) -> tuple[float, float, float]:
    """Return three finite numbers.

    Raises:
        SceneError: They are none.
    """
    message = f"{what} must be three finite numbers, got {shown(given)}"
    try:
        numbers = np.asarray(given)
        if numbers.dtype.kind not in "iuf" or numbers.shape != (3,) or not np.isfinite(numbers).all():
            raise SceneError(message)
    except (TypeError, ValueError, RuntimeError):  # arrays of other libraries raise what they like
        raise SceneError(message) from None
    return tuple(numbers.astype(np.float64).tolist())


def linear_color(color: ArrayLike) -> tuple[float, ...]:
    """Turn a colour of sRGB, from 0 to 1, into one that is proportional to light (IEC 61966-2-1)."""
    parts = np.asarray(color, dtype=np.float64)
    return tuple(np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4).tolist())


def screen_color(color: ArrayLike) -> tuple[float, ...]:
    """Turn a colour that is proportional to light into one of sRGB."""
    parts = np.asarray(color, dtype=np.float64)
    return tuple(np.where(parts <= 0.0031308, parts * 12.92, 1.055 * parts ** (1 / 2.4) - 0.055).tolist())


def shown(given: object) -> str:
    """Write what was given as messages show it: its type, if it is long."""
    text = repr(given)
    return text if len(text) <= 80 else type(given).__name__
