# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Strictly increasing functions of one variable and their inverses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SAMPLES = 4096
_MAX_STEPS = 200


class Rising:
    """A function of one variable, restricted to the interval from 0 on which it increases strictly."""

    def __init__(self, function: Callable[[Floats], tuple[Floats, Floats]], limit: float) -> None:
        """Find the end of the interval.

        Args:
            function: Returns values and derivatives; must be 0 at 0.
            limit: Upper end of its domain.
        """
        self._function = function
        self._samples = np.linspace(0.0, limit, _SAMPLES + 1)
        rises = self._rises(self._samples[1:])
        self.turns = not rises.all()
        """Whether the function stops increasing before the limit."""
        if self.turns:
            first = int(np.argmin(rises)) + 1
            self._samples = np.append(
                self._samples[:first], self._last_rise(self._samples[first - 1], self._samples[first])
            )
        self.end = float(self._samples[-1])
        """End of the interval."""
        with np.errstate(all="ignore"):
            self._values = np.maximum.accumulate(function(self._samples)[0])
        self.max_value = float(self._values[-1])
        """Value at the end of the interval."""

    def _rises(self, samples: Floats) -> NDArray[np.bool_]:
        with np.errstate(all="ignore"):
            values, slopes = self._function(samples)
            return (values > 0) & (slopes > 0)

    def _last_rise(self, low: float, high: float) -> float:
        """Bisect until the bounds are adjacent floating-point numbers."""
        while low < (midpoint := (low + high) / 2) < high:
            if self._rises(np.array([midpoint]))[0]:
                low = midpoint
            else:
                high = midpoint
        return low

    def inverse(self, values: Floats) -> Floats:
        """Return the inverse at non-negative values; NaN for values that are never reached.

        Newton's method starts from a table. A step that leaves the bracket is replaced by bisection, which guarantees
        convergence.
        """
        reached = (values >= 0) & (values <= self.max_value)
        target = values[reached]
        index = np.clip(np.searchsorted(self._values, target) - 1, 0, len(self._samples) - 2)
        low, high = self._samples[index], self._samples[index + 1]
        x = (low + high) / 2
        active = np.arange(len(target))
        for _ in range(_MAX_STEPS):
            current, a, b = x[active], low[active], high[active]
            with np.errstate(all="ignore"):
                value, slope = self._function(current)
                error = value - target[active]
                step = current - error / slope
            a, b = np.where(error <= 0, current, a), np.where(error >= 0, current, b)
            step = np.where((step >= a) & (step <= b), step, (a + b) / 2)
            x[active], low[active], high[active] = step, a, b
            moved = np.abs(step - current) > 4e-15 * np.abs(step)
            active = active[moved]
            if not len(active):
                break
        result = np.full(values.shape, np.nan)
        result[reached] = x
        return result
