# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reference of the kernel of `warpvis.kernels.visibility.heights`, without iteration: the union of all shadows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_GAP = 1e-6


def climb(
    corners: NDArray,
    eyes: NDArray,
    targets: NDArray,
    *,
    up: int,
    raise_eyes: bool,
    max_height: float,
    end_tolerance: float,
) -> NDArray[np.float64]:
    """Return smallest free heights, shape (E, N); `corners` of the triangles have shape (T, 3, 3)."""
    pairs = [(target, eye) if raise_eyes else (eye, target) for eye in eyes for target in targets]
    heights = [_first_gap(shadows(corners, *pair, up, end_tolerance), max_height) for pair in pairs]
    return np.array(heights).reshape(len(eyes), len(targets))


def shadows(corners: NDArray, fixed: NDArray, raised: NDArray, up: int, end_tolerance: float) -> NDArray[np.float64]:
    """Return intervals of heights at which the line of sight hits a triangle, shape (n, 2)."""
    fixed, raised = np.asarray(fixed, dtype=np.float64), np.asarray(raised, dtype=np.float64)
    distance = np.linalg.norm(raised - fixed)
    if distance <= 2 * end_tolerance:
        return np.zeros((0, 2))
    share = end_tolerance / distance
    floor = [(up + 1) % 3, (up + 2) % 3]
    way = (raised - fixed)[floor]
    way = way if way.any() else np.array([1e-6, 0.0])
    local = np.asarray(corners, dtype=np.float64) - fixed
    side = way[0] * local[..., floor[1]] - way[1] * local[..., floor[0]]
    place = np.stack([local[..., floor] @ way / (way @ way), local[..., up]], axis=-1)

    # Segments in the vertical plane: either two or none of a triangle's edges cross it.
    crosses = (side < 0) != (np.roll(side, -1, axis=1) < 0)
    cut = crosses.any(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (side / (side - np.roll(side, -1, axis=1)))[..., None]
        points = place + t * (np.roll(place, -1, axis=1) - place)
    ends = points[cut][crosses[cut]].reshape(-1, 2, 2)
    ends = np.take_along_axis(ends, ends[..., :1].argsort(axis=1), axis=1)
    (s0, y0), (s1, y1) = ends[:, 0].T, ends[:, 1].T

    within = (s1 >= share) & (s0 <= 1 - share)
    s0, y0, s1, y1 = s0[within], y0[within], s1[within], y1[within]
    slope = np.divide(y1 - y0, s1 - s0, out=np.zeros_like(s0), where=s1 > s0)
    first, last = np.maximum(s0, share), np.minimum(s1, 1 - share)
    one = np.where(first > s0, y0 + (first - s0) * slope, y0) / first
    other = np.where(last < s1, y0 + (last - s0) * slope, y1) / last
    return np.sort(np.stack([one, other], axis=1), axis=1) - (raised - fixed)[up]


def _first_gap(intervals: NDArray, max_height: float) -> float:
    height = 0.0
    for low, high in intervals[intervals[:, 0].argsort()]:
        if low - _GAP > height:
            break
        height = max(height, high)
    return height if height <= max_height else np.inf
