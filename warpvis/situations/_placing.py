# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Places of several bodies in many arrangements at once, so that none of them overlap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.situations._numbers import Numbers

_TRIES = 12
_GAP = 0.03
"""Distance that is kept between bodies [m]."""
ABSENT = (0.0, 0.0, -5.0)
"""Where bodies are that are not in the room [m]: below the floor, where nothing sees them."""


class Placing:
    """Assigns each body one of its places in W arrangements; a body is an upright cylinder."""

    def __init__(self, worlds: int, numbers: Numbers) -> None:
        """Start without bodies."""
        self._numbers = numbers
        self._centers: list[NDArray[np.float64]] = []
        self._sizes: list[tuple[float, float]] = []
        self.valid = np.ones(worlds, dtype=np.bool_)
        """Arrangements in which all bodies have a place, shape ``(W,)``."""

    def place(
        self,
        places: NDArray[np.float64],
        radius: float,
        height: float,
        wished: NDArray[np.int64] | None = None,
        *,
        optional: bool = False,
    ) -> NDArray[np.int64]:
        """Choose a place for a body in each arrangement, and return their indices, shape ``(W,)``.

        Where it finds none, the arrangement is not valid; or, if the body is optional, its index is -1.

        Args:
            places: Possible centers of its lower end [m], shape ``(n, 3)``.
            radius: Radius of the cylinder [m].
            height: Height of the cylinder [m].
            wished: The place to try first in each arrangement, shape ``(W,)``; a random one by default.
            optional: Whether the body may be absent.
        """
        worlds = len(self.valid)
        chosen = self._numbers.below(len(places), worlds) if wished is None else wished.copy()
        for _ in range(_TRIES):
            again = np.flatnonzero(self._overlaps(places[chosen], radius, height))
            if not len(again):
                break
            chosen[again] = self._numbers.below(len(places), len(again))
        centers, bad = places[chosen], self._overlaps(places[chosen], radius, height)
        if optional:
            centers[bad], chosen[bad] = ABSENT, -1
        else:
            self.valid &= ~bad
        self._centers.append(centers)
        self._sizes.append((radius, height))
        return chosen

    def center(self, world: int, number: int) -> NDArray[np.float64]:
        """Return the lower end of a body in an arrangement [m], shape ``(3,)``; bodies are numbered by `place`."""
        return self._centers[number][world]

    def is_free(self, worlds: NDArray[np.integer], centers: NDArray[np.float64], number: int) -> NDArray[np.bool_]:
        """Return where a body may be moved to without overlapping the others, shape ``(n,)``.

        Args:
            worlds: Arrangements, shape ``(n,)``.
            centers: Centers of the body's lower end [m], shape ``(n, 3)``.
            number: Number of the body, in the order of calls of `place`.
        """
        radius, height = self._sizes[number]
        free = np.ones(len(worlds), dtype=np.bool_)
        for other, (rows, size) in enumerate(zip(self._centers, self._sizes, strict=True)):
            if other != number:
                free &= ~_overlap(centers, (radius, height), rows[worlds], size)
        return free

    def _overlaps(self, centers: NDArray[np.float64], radius: float, height: float) -> NDArray[np.bool_]:
        found = np.zeros(len(self.valid), dtype=np.bool_)
        for rows, size in zip(self._centers, self._sizes, strict=True):
            found |= _overlap(centers, (radius, height), rows, size)
        return found


def _overlap(
    a: NDArray[np.float64], a_size: tuple[float, float], b: NDArray[np.float64], b_size: tuple[float, float]
) -> NDArray[np.bool_]:
    """Return whether cylinders at lower ends `a` and `b`, with radius and height, are closer than the gap."""
    apart = np.hypot(a[:, 0] - b[:, 0], a[:, 1] - b[:, 1]) >= a_size[0] + b_size[0] + _GAP
    above = (a[:, 2] >= b[:, 2] + b_size[1]) | (b[:, 2] >= a[:, 2] + a_size[1])
    return ~(apart | above)
