# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of `warpvis.kernels.sensors.random_numbers`: Philox in integers, normals by SciPy in double precision."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

_WORD = 0xFFFFFFFF


def philox(counter: ArrayLike, key: tuple[int, int]) -> NDArray[np.uint32]:
    """Return the random words of counters (..., 4), by ten rounds of Philox (Salmon et al. 2011)."""
    first, second, third, fourth = np.moveaxis(np.asarray(counter, dtype=np.uint64), -1, 0)
    left, right = key
    low, shift = np.uint64(_WORD), np.uint64(32)
    for _ in range(10):
        one, two = first * np.uint64(0xD2511F53), third * np.uint64(0xCD9E8D57)
        first, third = (two >> shift) ^ second ^ np.uint64(left), (one >> shift) ^ fourth ^ np.uint64(right)
        second, fourth = two & low, one & low
        left, right = (left + 0x9E3779B9) & _WORD, (right + 0xBB67AE85) & _WORD
    return np.stack([first, second, third, fourth], axis=-1).astype(np.uint32)


def random_words(
    views: ArrayLike, frames: ArrayLike, shape: tuple[int, int], seed: int, stream: int
) -> NDArray[np.uint32]:
    """Return words of all pixels of views by view and frame number, shape (V, H, W)."""
    height, width = shape
    view, y, x = np.meshgrid(np.asarray(views), np.arange(height), np.arange(width), indexing="ij")
    frame = np.broadcast_to(np.asarray(frames)[:, None, None], view.shape)
    words = philox(np.stack([x >> 2, y, view, frame], axis=-1), (seed, stream))
    return np.take_along_axis(words, (x & 3)[..., None], axis=-1)[..., 0]


def to_uniform(words: NDArray[np.uint32]) -> NDArray[np.float64]:
    """Return the midpoints of 2^23 equal parts of (0, 1)."""
    return ((words >> np.uint32(9)).astype(np.float64) * 2 + 1) * 2.0**-24


def to_normal(words: NDArray[np.uint32]) -> NDArray[np.float64]:
    """Return normal quantiles of the midpoints of 2^32 equal parts of (0, 1)."""
    return ndtri((words.astype(np.float64) + 0.5) * 2.0**-32)


def draw_normals(
    views: ArrayLike, frames: ArrayLike, shape: tuple[int, int], seed: int, stream: int
) -> NDArray[np.float64]:
    """Return standard normal numbers of all pixels, shape (V, H, W)."""
    return to_normal(random_words(views, frames, shape, seed, stream))


def draw_uniforms(
    views: ArrayLike, frames: ArrayLike, places: ArrayLike, seed: int, stream: int
) -> NDArray[np.float64]:
    """Return uniform numbers between 0 and 1 of views at pixels (y, x), shape (V, K)."""
    y, x = np.asarray(places, dtype=np.int64).T
    view, frame = (np.broadcast_to(np.asarray(given)[:, None], (len(views), len(x))) for given in (views, frames))
    counters = np.stack([np.broadcast_to(x >> 2, view.shape), np.broadcast_to(y, view.shape), view, frame], axis=-1)
    words = philox(counters, (seed, stream))
    return to_uniform(np.take_along_axis(words, np.broadcast_to(x & 3, view.shape)[..., None], axis=-1)[..., 0])
