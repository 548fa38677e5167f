# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Search order of the pixels in a window."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def closest_first(reach: int, max_squared: int | None = None) -> NDArray[np.int32]:
    """Return offsets (column, row) to the pixels of a window by increasing distance, then by rows, shape ``(N, 2)``.

    Args:
        reach: Half the side of the window [px].
        max_squared: Maximum squared distance [px^2]; unlimited by default.
    """
    offsets = np.arange(-reach, reach + 1, dtype=np.int32)
    row, column = (grid.ravel() for grid in np.meshgrid(offsets, offsets, indexing="ij"))
    squared = row * row + column * column
    order = np.argsort(squared, kind="stable")
    if max_squared is not None:
        order = order[squared[order] <= max_squared]
    return np.stack([column, row], axis=-1)[order]
