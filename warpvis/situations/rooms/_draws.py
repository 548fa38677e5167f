# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Random numbers that are the same on every machine and with every version of NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

_Item = TypeVar("_Item")
_BATCH = 512


class Draws:
    """Numbers of a PCG64 stream.

    NumPy guarantees the raw stream of a bit generator in all versions, but not the distributions of its `Generator`,
    so these are computed here.
    """

    def __init__(self, seed: int) -> None:
        """Start the stream of a seed."""
        self._bits = np.random.PCG64(seed)
        self._numbers: list[float] = []

    def unit(self) -> float:
        """Return a number from 0 (inclusive) to 1 (exclusive)."""
        if not self._numbers:
            raw = np.asarray(self._bits.random_raw(_BATCH), dtype=np.uint64)
            self._numbers = ((raw >> np.uint64(11)) * 2.0**-53).tolist()
        return self._numbers.pop()

    def uniform(self, low: float, high: float) -> float:
        """Return a number from `low` to `high`."""
        return low + (high - low) * self.unit()

    def chance(self, probability: float) -> bool:
        """Return True with a probability."""
        return self.unit() < probability

    def below(self, count: int) -> int:
        """Return an integer from 0 to `count` - 1."""
        return int(self.unit() * count)

    def integer(self, low: int, high: int) -> int:
        """Return an integer from `low` to `high`, both inclusive."""
        return low + self.below(high - low + 1)

    def step(self, low: float, high: float, step: float) -> float:
        """Return one of the values `low`, `low` + `step`, ... up to `high` [m], rounded to 0.1 mm."""
        return round(low + step * self.below(int((high - low) / step + 1.5)), 4)

    def choice(self, items: Sequence[_Item]) -> _Item:
        """Return one of the items."""
        return items[self.below(len(items))]

    def weighted(self, items: Sequence[tuple[_Item, float]]) -> _Item:
        """Return an item of pairs ``(item, weight)``."""
        rest = self.unit() * sum(weight for _, weight in items)
        for item, weight in items:
            rest -= weight
            if rest < 0:
                return item
        return items[-1][0]

    def shuffled(self, items: Sequence[_Item]) -> list[_Item]:
        """Return the items in random order."""
        found = list(items)
        for index in range(len(found) - 1, 0, -1):
            other = self.below(index + 1)
            found[index], found[other] = found[other], found[index]
        return found
