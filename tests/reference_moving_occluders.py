# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reference of the kernel of `warpvis.kernels.visibility.moving_occluders`, without a tree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def clear_hidden_worlds(
    corners: list[NDArray], eyes: NDArray, points: NDArray, pairs: NDArray, tolerance: float
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Return in which worlds each pair is not hidden, and the margin along the line to the opposite result [m].

    `corners` are those of the triangles of the moving objects in every world, ``(triangles, 3, 3)`` each. Both results
    have shape ``(pairs, worlds)``.
    """
    import reference

    eyes, points = np.asarray(eyes, dtype=np.float64), np.asarray(points, dtype=np.float64)
    margins = np.full((len(pairs), len(corners)), np.inf)
    for row, (camera, point) in zip(margins, pairs, strict=True):
        line = points[point] - eyes[camera]
        for world, triangles in enumerate(corners):
            share = reference._nearest_triangle(line[None], triangles - eyes[camera], False)[0][0]
            row[world] = share * np.linalg.norm(line) - np.linalg.norm(line) + tolerance
    return margins >= 0, np.abs(margins)
