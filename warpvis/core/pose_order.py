# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Detection of quaternions in the order w x y z that are read as x y z w."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import on_gpu
from warpvis.core.checks import format_percent
from warpvis.core.poses import Convention, vectors_in_axes
from warpvis.core.types import PoseLike
from warpvis.core.user_warnings import warn_user

# With fewer poses, cameras may be upright in either order by coincidence. Of more poses, a subset is checked.
_MIN_POSES, _MAX_POSES = 3, 256
# Maximum z component of a level axis, and minimum z component of an axis that points up.
_LEVEL, _STEEP = 1e-3, 0.1


def warn_of_order(poses: PoseLike, convention: Convention) -> None:
    """Warn if some cameras are upside down, but all would be level and upright with w first.

    Cameras of robots and of `look_at` are level and upright if the vertical axis of the world is z, and poses rarely
    mix upright and inverted cameras. The poses must be valid; those on a GPU are not checked.
    """
    if (type(poses) is not np.ndarray and on_gpu(poses)) or np.shape(poses)[1:] != (7,) or len(poses) < _MIN_POSES:
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
            f"{share} of the cameras are upside down, but all would be upright if the quaternions had w first. If they "
            'have, pass quaternion="wxyz".',
            UserWarning,
        )


@cache
def _axes(convention: Convention) -> NDArray[np.float64]:
    """Return the right and down axes of a camera in a frame of the convention."""
    return vectors_in_axes(np.eye(3)[:2], "opencv", convention)


def _heights(quaternions: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the z components of an axis rotated by quaternions ``x y z w``."""
    x, y, z, w = quaternions.T
    return 2 * (x * z - y * w) * axis[0] + 2 * (y * z + x * w) * axis[1] + (1 - 2 * (x * x + y * y)) * axis[2]
