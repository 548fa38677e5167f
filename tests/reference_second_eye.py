# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a second eye beside a camera sees of its points, in double precision."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def shift_places(depth: NDArray, shift: float) -> NDArray[np.float64]:
    y, x = np.mgrid[: depth.shape[-2], : depth.shape[-1]] + 0.5
    z = np.where(np.isfinite(depth) & (depth > 0), depth.astype(np.float64), np.nan)
    return np.stack([x - shift / z, np.where(np.isnan(z), np.nan, y)], axis=-1)


def judge_hidden(depth: NDArray, surface: NDArray, slack: float) -> NDArray[np.bool_]:
    seen = np.isfinite(depth) & (depth > 0)
    return seen & (surface.astype(np.float64) * (1 + slack) < np.where(seen, depth, 0))
