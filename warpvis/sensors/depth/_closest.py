# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The pixels about one, in the order in which they are looked at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def closest_first(reach: int, most_squared: int | None = None) -> NDArray[np.int32]:
    """Return columns and rows to the pixels of a window, the closest first, of equally close ones by rows, ``(N, 2)``.

    Args:
        reach: How far the window reaches to all sides [px].
        most_squared: Leave those out that are farther away, by their squared distance.
    """
    to = np.arange(-reach, reach + 1, dtype=np.int32)
    row, column = (places.ravel() for places in np.meshgrid(to, to, indexing="ij"))
    squared = row * row + column * column
    order = np.argsort(squared, kind="stable")
    if most_squared is not None:
        order = order[squared[order] <= most_squared]
    return np.stack([column, row], axis=-1)[order]
