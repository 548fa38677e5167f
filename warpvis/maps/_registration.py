# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Result of registration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.errors import ArrayError


@dataclass(frozen=True, eq=False)
class Registration:
    """Registered poses of V views or hypotheses, as arrays of Warp on the scene's device.

    Twists are (rotation [rad], translation [m]) in the world frame: a small twist ``(r, t)`` moves the camera or the
    object by the rotation r about its own origin and the translation t, both along the axes of the world. If J joints
    were moved, their positions replace the twist: `covariance` and `H` have shape ``(V, J, J)``, and `b` ``(V, J)``.

    With `groups`, all fields but the poses and positions are those of the view's group, the twist along the axes of
    the world being that of the view.
    """

    poses: wp.array
    """Poses of the camera in the given convention, or of the moved object, to world, shape ``(V,)`` transform. If
    joints were moved, the given poses of the camera."""
    covariance: wp.array
    """Covariance of the twist, the inverse of `H`, ``(V, 6, 6)`` float64; +inf if depth does not determine the pose."""
    H: wp.array
    """Information matrix of the twist, ``(V, 6, 6)`` float64."""
    b: wp.array
    """Gradient of `e`, ``(V, 6)`` float64."""
    e: wp.array
    """Robust cost: half the sum of squared residuals, linear above `huber` and constant above `max_distance`,
    ``(V,)`` float64."""
    num_inliers: wp.array
    """Number of pixels that determine the pose, ``(V,)`` int32."""
    num_measured: wp.array
    """Number of pixels with measured depth, ``(V,)`` int32."""
    converged: wp.array
    """Whether the last step was not significant, ``(V,)`` uint8. Views without surfaces to compare keep their poses,
    and are not converged."""
    iterations: wp.array
    """Number of steps, ``(V,)`` int32."""
    object_poses: wp.array | None = None
    """If an object or joints were moved: poses of all movable objects, ``(V, M)`` transform."""
    joint_positions: wp.array | None = None
    """If joints were moved: their positions [rad, m] in the order of `moving`, ``(V, J)`` float64. The variance of a
    joint whose links are invisible is +inf."""

    @cached_property
    def inlier_ratio(self) -> NDArray[np.float64]:
        """Fraction of the measured pixels that are inliers, shape ``(V,)``; waits for a GPU.

        If an object or joints were moved, only pixels of what moves are inliers.
        """
        return self.num_inliers.numpy() / np.maximum(self.num_measured.numpy(), 1)

    def best(self) -> int:
        """Return the index of the view with the lowest cost per measured pixel; it waits for a GPU.

        Raises:
            ArrayError: If no view has inliers.
        """
        error = self.e.numpy() / np.maximum(self.num_measured.numpy(), 1)
        error = np.where(self.num_inliers.numpy() > 0, error, np.inf)
        if not np.isfinite(error).any():
            raise ArrayError("no view has inliers: initial poses must be such that surfaces are within max_distance")
        return int(error.argmin())
