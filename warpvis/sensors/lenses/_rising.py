# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Functions of one number that rise from zero, up to where they turn back, and their inverses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SAMPLES = 4096
_MAX_STEPS = 200


class Rising:
    """A function of one number from 0 on, as far as it rises."""

    def __init__(self, function: Callable[[Floats], tuple[Floats, Floats]], limit: float) -> None:
        """Find where it ceases to rise.

        Args:
            function: Gives values and slopes; 0 at 0.
            limit: The greatest number that it is defined for.
        """
        self._function = function
        self._places = np.linspace(0.0, limit, _SAMPLES + 1)
        rises = self._rises(self._places[1:])
        self.turns = not rises.all()
        """Whether it turns back, or leaps, before the limit."""
        if self.turns:
            first = int(np.argmin(rises)) + 1
            self._places = np.append(
                self._places[:first], self._last_rise(self._places[first - 1], self._places[first])
            )
        self.end = float(self._places[-1])
        """The greatest number up to which it rises."""
        with np.errstate(all="ignore"):
            self._values = np.maximum.accumulate(function(self._places)[0])
        self.most = float(self._values[-1])
        """Its value there."""

    def _rises(self, places: Floats) -> NDArray[np.bool_]:
        with np.errstate(all="ignore"):
            values, slopes = self._function(places)
            return (values > 0) & (slopes > 0)

    def _last_rise(self, least: float, most: float) -> float:
        """Halve until neighbouring numbers are left."""
        while least < (middle := (least + most) / 2) < most:
            if self._rises(np.array([middle]))[0]:
                least = middle
            else:
                most = middle
        return least

    def inverse(self, values: Floats) -> Floats:
        """Return where it has values from 0 up; NaN where it never does.

        By Newton's steps from a table; one that leaves the bracket is a halving instead, so that all end.
        """
        there = (values >= 0) & (values <= self.most)
        wanted = values[there]
        index = np.clip(np.searchsorted(self._values, wanted) - 1, 0, len(self._places) - 2)
        low, high = self._places[index], self._places[index + 1]
        place = (low + high) / 2
        active = np.arange(len(wanted))
        for _ in range(_MAX_STEPS):
            at, a, b = place[active], low[active], high[active]
            with np.errstate(all="ignore"):
                value, slope = self._function(at)
                error = value - wanted[active]
                step = at - error / slope
            a, b = np.where(error <= 0, at, a), np.where(error >= 0, at, b)
            step = np.where((step >= a) & (step <= b), step, (a + b) / 2)
            place[active], low[active], high[active] = step, a, b
            moved = np.abs(step - at) > 4e-15 * np.abs(step)
            active = active[moved]
            if not len(active):
                break
        found = np.full(values.shape, np.nan)
        found[there] = place
        return found
