# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reference of the kernels of poses that move together, in double precision."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation


def _blocks(initial: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the 6x6 rotations of twists from the frames of poses to the world, ``(V, 6, 6)``."""
    return np.array([block_diag(matrix, matrix) for matrix in Rotation.from_quat(initial[:, 3:]).as_matrix()])


def add_groups(
    groups: NDArray[np.integer], initial: NDArray[np.float64], H: NDArray[np.float64], b: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return sums of H and b of each group along the axes of initial poses."""
    turn = _blocks(initial)
    matrices, sides = turn.swapaxes(1, 2) @ H @ turn, (turn.swapaxes(1, 2) @ b[..., None])[..., 0]
    members = groups == np.arange(groups.max() + 1)[:, None]
    return np.array([matrices[rows].sum(axis=0) for rows in members]), np.array(
        [sides[rows].sum(axis=0) for rows in members]
    )


def spread_sums(
    groups: NDArray[np.integer], initial: NDArray[np.float64], H: NDArray[np.float64], b: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return H and b of each view's group along the axes of the world."""
    turn = _blocks(initial)
    return turn @ H[groups] @ turn.swapaxes(1, 2), (turn @ b[groups][..., None])[..., 0]


def move_views(
    groups: NDArray[np.integer], initial: NDArray[np.float64], motions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return poses after the motions of their groups, rows ``x y z qx qy qz qw``."""
    rotations, moved = Rotation.from_quat(initial[:, 3:]), motions[groups]
    origins = initial[:, :3] + rotations.apply(moved[:, :3])
    return np.concatenate([origins, (rotations * Rotation.from_quat(moved[:, 3:])).as_quat()], axis=1)
