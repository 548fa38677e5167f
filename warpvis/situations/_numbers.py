# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays of random numbers that are the same with every version of NumPy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


class Numbers:
    """Numbers of a PCG64 stream.

    NumPy guarantees the raw stream of a bit generator in all versions, but not the distributions of its `Generator`,
    so these are computed here.
    """

    def __init__(self, *seed: int) -> None:
        """Start the stream of a seed of one or several whole numbers."""
        self._bits = np.random.PCG64(list(seed))

    def unit(self, *shape: int) -> NDArray[np.float64]:
        """Return numbers from 0 (inclusive) to 1 (exclusive)."""
        raw = np.asarray(self._bits.random_raw(int(np.prod(shape, dtype=np.int64))), dtype=np.uint64)
        return ((raw >> np.uint64(11)).astype(np.float64) * 2.0**-53).reshape(shape)

    def uniform(self, low: float, high: float, *shape: int) -> NDArray[np.float64]:
        """Return numbers from `low` to `high`."""
        return low + (high - low) * self.unit(*shape)

    def below(self, count: int, *shape: int) -> NDArray[np.int64]:
        """Return whole numbers from 0 to `count` - 1."""
        return (self.unit(*shape) * count).astype(np.int64)

    def order(self, count: int) -> NDArray[np.int64]:
        """Return the numbers below `count` in random order."""
        return np.argsort(self.unit(count), kind="stable")

    def one(self, items: Sequence) -> object:
        """Return one of the items."""
        return items[int(self.unit(1)[0] * len(items))]
