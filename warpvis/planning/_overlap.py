# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Overlap of oriented boxes with triangles and with each other, by separating axes, in NumPy."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]

# Boxes times triangles whose bounding boxes are compared per call, 1 byte each.
_PAIRS = 1 << 24


def boxes_meet_triangles(
    centers: Floats, axes: Floats, halves: Floats, triangles: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """Return which boxes overlap a triangle.

    Args:
        centers: Centers of the boxes [m], ``(n, 3)``.
        axes: Their rotations, box to world, ``(n, 3, 3)``.
        halves: Half extents of all boxes [m], ``(3,)``.
        triangles: Corners of the triangles [m], ``(T, 3, 3)``.

    Returns:
        Flags of the boxes, ``(n,)``: touching counts as overlapping.
    """
    found = np.zeros(len(centers), dtype=bool)
    reach = np.abs(axes) @ halves
    low, high = centers - reach, centers + reach
    lows, highs = triangles.min(axis=1), triangles.max(axis=1)
    close = ((lows <= high.max(axis=0)) & (highs >= low.min(axis=0))).all(axis=1)
    triangles, lows, highs = triangles[close], lows[close], highs[close]
    if not len(triangles):
        return found
    step = max(1, _PAIRS // len(triangles))
    for first in range(0, len(centers), step):
        part = slice(first, first + step)
        near = np.ones((len(centers[part]), len(triangles)), dtype=bool)
        for axis in range(3):
            near &= (lows[:, axis] <= high[part, None, axis]) & (highs[:, axis] >= low[part, None, axis])
        box, triangle = np.nonzero(near)
        local = (triangles[triangle] - centers[part][box][:, None]) @ axes[part][box]
        found[part][box[_meets_origin_box(local, halves)]] = True
    return found


def boxes_meet_boxes(
    centers: Floats, axes: Floats, halves: Floats, others: Floats, other_axes: Floats, other_halves: Floats
) -> NDArray[np.bool_]:
    """Return whether n boxes overlap n other ones, ``(n,)``; see `boxes_meet_triangles`."""
    between, found = others - centers, np.ones(len(centers), dtype=bool)
    crosses = np.cross(axes.swapaxes(1, 2)[:, :, None], other_axes.swapaxes(1, 2)[:, None]).reshape(-1, 9, 3)
    directions = np.concatenate([axes.swapaxes(1, 2), other_axes.swapaxes(1, 2), crosses], axis=1)
    reach = np.abs(directions @ axes) @ halves + np.abs(directions @ other_axes) @ other_halves
    gap = np.abs((directions * between[:, None]).sum(axis=2)) - reach
    # Cross products of parallel edges are zero up to rounding, and separate nothing.
    length = np.linalg.norm(directions, axis=2)
    return found & ~((gap > 0) & (length > 1e-6)).any(axis=1)


def points_in_boxes(points: Floats, centers: Floats, axes: Floats, halves: Floats) -> NDArray[np.bool_]:
    """Return whether n points are in n boxes, ``(n,)``."""
    local = ((points - centers)[:, None] @ axes)[:, 0]
    return np.asarray((np.abs(local) <= halves).all(axis=1))


def _meets_origin_box(triangles: Floats, halves: Floats) -> NDArray[np.bool_]:
    """Return which triangles, ``(m, 3, 3)``, overlap a box around the origin (Akenine-Möller 2001)."""
    edges = np.roll(triangles, -1, axis=1) - triangles
    crosses = np.cross(np.eye(3)[:, None], edges[:, None]).reshape(-1, 9, 3)
    normal = np.cross(edges[:, 0], edges[:, 1])[:, None]
    directions = np.concatenate([np.tile(np.eye(3), (len(triangles), 1, 1)), normal, crosses], axis=1)
    along = directions @ triangles.swapaxes(1, 2)  # (m, 13, 3)
    reach = np.abs(directions) @ halves
    return ~((along.min(axis=2) > reach) | (along.max(axis=2) < -reach)).any(axis=1)
