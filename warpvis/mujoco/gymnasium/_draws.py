# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a sensor's random numbers follow from in observations: the seed of the last reset, and observations since."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


class Draws:
    """Numbers of views and frames of environments: an environment has the same ones alone and among others.

    Without a seed they are others every time, as those of Gymnasium's environments are.
    """

    def __init__(self, environments: int, cameras: int) -> None:
        """Begin without a seed."""
        self._views = np.array([_words(None, cameras) for _ in range(environments)])
        self._frames = np.full(environments, -1, dtype=np.int64)  # of the last observation

    def reset(self, seeds: Sequence[int | None]) -> None:
        """Begin anew in each environment that has a seed; the others go on."""
        for environment, seed in enumerate(seeds):
            if seed is not None:
                self._views[environment] = _words(seed, self._views.shape[1])
                self._frames[environment] = -1

    def advance(self, environments: Sequence[int] | NDArray[np.bool_] | slice = slice(None)) -> None:
        """Go on to the next observation, in some environments or all."""
        self._frames[environments] += 1

    def now(self) -> NDArray[np.int64]:
        """Return the numbers of the last observation, of each camera in each environment, ``(C, E, 2)``."""
        frames = np.broadcast_to(self._frames, self._views.T.shape)
        return np.stack([self._views.T, frames], axis=-1)


def _words(seed: int | None, cameras: int) -> NDArray[np.int64]:
    """Draw a word of 32 bits for each camera."""
    return np.random.SeedSequence(seed).generate_state(cameras).astype(np.int64)


def seeds_of_reset(
    seed: int | Sequence[int | None] | None, environments: int, chosen: NDArray[np.bool_] | None
) -> list[int | None]:
    """List the seed that each environment of a vector is reset with: of one seed, this and those that follow it.

    Args:
        seed: What `gymnasium.vector.VectorEnv.reset` was given.
        environments: How many there are.
        chosen: Which of them are reset; all if it is None.
    """
    if seed is None or isinstance(seed, int):
        seeds = [None if seed is None else seed + environment for environment in range(environments)]
    else:
        seeds = list(seed)
    return seeds if chosen is None else [word if mine else None for word, mine in zip(seeds, chosen, strict=True)]
