# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of the kernels that read poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices, quaternion_product


def poses_to_opencv(poses: NDArray, opencv_to_given: NDArray) -> NDArray[np.float64]:
    rows = np.asarray(poses, dtype=np.float64)
    unit = rows[:, 3:] / np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    return np.concatenate([rows[:, :3], quaternion_product(unit, opencv_to_given)], axis=1)


def quaternions_to_xyzw(rows: NDArray) -> NDArray:
    return np.asarray(rows)[:, [0, 1, 2, 4, 5, 6, 3]]


def poses_from_matrices(matrices: NDArray, opencv_to_given: NDArray) -> NDArray[np.float64]:
    """Return matrices of the OpenCV frame, shape (V, 4, 4): quaternions are compared as matrices, since q equals -q."""
    turn = poses_to_matrices(np.concatenate([np.zeros(3), opencv_to_given]))
    return np.asarray(matrices, dtype=np.float64) @ turn
