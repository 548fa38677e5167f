# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reference of the kernel of `warpvis.kernels.visibility.clearance`; see `reference`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from reference_clearance import _windings


def find_inside(corners: NDArray, points: NDArray) -> NDArray[np.bool_]:
    """Return whether points are inside closed triangles, corners of shape (T, 3, 3), by winding number."""
    corners = np.asarray(corners, dtype=np.float64)
    return np.array([_windings(corners, point) > 0.5 for point in np.asarray(points, dtype=np.float64)])
