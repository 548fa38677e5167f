# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a sensor's random numbers follow from in an environment: seed, episode, and observations since its beginning."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

WORDS = 3
"""How many words of 32 bits tell them: two of the episode, and the frame."""

_LOW = 2**16


class Draws:
    """The numbers of one environment: it has the same ones alone and among others.

    An episode has those of the last seed and of how many resets there were since, so that each has noise and, of a
    sensor with parameters of its own, a sensor of its own. Without a seed they are others every time, as those of
    Gymnasium's environments are.
    """

    def __init__(self) -> None:
        """Begin without a seed."""
        self._entropy = np.random.SeedSequence().entropy
        self._episode, self._frame = 0, -1
        self._words = self._draw()

    def reset(self, seed: int | None) -> None:
        """Begin the next episode, or the first one of a seed."""
        self._episode += 1
        if seed is not None:
            self._entropy, self._episode = seed, 0
        self._frame = -1
        self._words = self._draw()

    def _draw(self) -> list[int]:
        sequence = np.random.SeedSequence(self._entropy, spawn_key=(self._episode,))
        return [int(word) for word in sequence.generate_state(WORDS - 1)]

    def next(self) -> NDArray[np.uint32]:
        """Go on to the next observation, and return its words, ``(3,)``."""
        self._frame = (self._frame + 1) % 2**32
        return np.array([*self._words, self._frame], dtype=np.uint32)


def as_halves(words: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return words as numbers that single precision holds, twice as many."""
    return np.concatenate(np.divmod(words, _LOW)).astype(np.float32)


def from_halves(halves: NDArray[np.float32]) -> NDArray[np.uint32]:
    """Return the words of rows that `as_halves` made, ``(W, 3)``."""
    high, low = np.split(halves.astype(np.uint32), 2, axis=1)
    return high * np.uint32(_LOW) + low


def view_draws(words: NDArray[np.uint32], cameras: int) -> NDArray[np.uint32]:
    """Return the number and frame of every camera in W environments, of their words ``(W, 3)``, as ``(C, W, 2)``."""
    numbers = np.array([_numbers(first, second, cameras) for first, second, _ in words.tolist()], dtype=np.uint32)
    return np.stack([numbers.T, np.broadcast_to(words[:, 2], numbers.T.shape)], axis=-1)


@lru_cache(maxsize=2**16)
def _numbers(first: int, second: int, cameras: int) -> tuple[int, ...]:
    """Draw a number for each camera of an episode."""
    return tuple(int(word) for word in np.random.SeedSequence([first, second]).generate_state(cameras))
