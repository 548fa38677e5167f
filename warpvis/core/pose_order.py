# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Find poses whose quaternions have w first, though they are read with w last."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import on_gpu
from warpvis.core.checks import format_percent
from warpvis.core.poses import Convention, vectors_in_axes
from warpvis.core.types import PoseLike
from warpvis.core.user_warnings import warn_user

# Fewer poses may be upright by chance in either order; of more, some are enough.
_MIN_POSES, _MAX_POSES = 3, 256
# Heights of the cameras' axes: of a level one, and of one that surely points up or down.
_LEVEL, _STEEP = 1e-3, 0.1


def warn_of_order(poses: PoseLike, convention: Convention) -> None:
    """Warn if some cameras are upside down, and with w first all would be level and upright.

    The cameras of robots and of `look_at` are level and upright in a world whose vertical axis is z; few sets of poses
    mix upright and inverted ones. Poses on a GPU are not looked at.

    Args:
        poses: Valid poses, as they were given.
        convention: The axes of their frame.
    """
    if on_gpu(poses) or np.shape(poses)[1:] != (7,) or len(poses) < _MIN_POSES:
        return
    rows = np.asarray(poses, dtype=np.float64)
    rows = rows[:: -(-len(rows) // _MAX_POSES)]
    right, down = _axes(convention)
    inverted = _heights(rows[:, 3:], down) > _STEEP
    if inverted.all() or not inverted.any():
        return
    swapped = rows[:, [4, 5, 6, 3]]
    if (np.abs(_heights(swapped, right)) < _LEVEL).all() and (_heights(swapped, down) < 0).all():
        share = format_percent(float(inverted.mean()))
        warn_user(
            f"{share} of the cameras are upside down, and with w first in the quaternions all would be upright: if it "
            'is, pass quaternion="wxyz"',
            UserWarning,
        )


@cache
def _axes(convention: Convention) -> NDArray[np.float64]:
    """Return a camera's right and down axes in a frame of its own."""
    return vectors_in_axes(np.eye(3)[:2], "opencv", convention)


def _heights(quaternions: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the z components of an axis as rotations ``x y z w`` turn it."""
    x, y, z, w = quaternions.T
    return 2 * (x * z - y * w) * axis[0] + 2 * (y * z + x * w) * axis[1] + (1 - 2 * (x * x + y * y)) * axis[2]
