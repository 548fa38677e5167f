# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Detection of poses with which the floor of depth images is not at its height, such as upright."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.pose_meaning import refuse_other_meaning
from warpvis.core.checks import format_percent
from warpvis.core.poses import Convention, poses_to_matrices
from warpvis.core.user_warnings import warn_user

# Numbers of views and points of a view that are examined.
_MAX_VIEWS, _MAX_POINTS = 8, 400

# Depth below the floor that is no error of the sensor, and distance from the floor of its points [m].
_BELOW, _ON_FLOOR = 0.25, 0.1

# Minimum number of points, and fraction of the points on or below the floor that are on it with the right poses.
_MIN_POINTS, _FITS = 50, 0.8

# Fraction of the points below the floor that is suspicious, and on or below it that a floor has.
_SUSPICIOUS, _MIN_LOW = 0.3, 0.05


def check_floor(
    depth: NDArray[np.floating],
    camera: ImageCamera,
    poses: NDArray[np.floating],
    plane: NDArray[np.float64],
    max_range: float,
    convention: Convention,
) -> None:
    """Raise `PoseError` if many points are below the floor, and poses of another meaning fit it; warn if none fits.

    Args:
        depth: Depth images on the host [m], shape ``(V, H, W)``.
        camera: Their camera.
        poses: Rows with OpenCV axes, shape ``(V, 7)``.
        plane: The floor: ``plane[:3] . p + plane[3]`` is the height of a point [m], shape ``(4,)``.
        max_range: Maximum depth [m].
        convention: The axes that were given.
    """
    views = np.unique(np.linspace(0, len(depth) - 1, min(len(depth), _MAX_VIEWS)).astype(int))
    y, x, rays = _examined_pixels(camera)
    z = depth[views[:, None], y, x].astype(np.float64)
    valid = (z > 0) & (z >= camera.near) & (z <= min(max_range, 1e6))
    if valid.sum() < _MIN_POINTS:
        return
    owner, pixel = np.nonzero(valid)
    local = rays[pixel] * z[valid][:, None]

    def heights(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
        rows = np.einsum("i,vij->vj", plane[:3], matrices[:, :3])
        return np.einsum("nj,nj->n", rows[owner, :3], local) + rows[owner, 3] + plane[3]

    def agreement(matrices: NDArray[np.float64]) -> float:
        found = heights(matrices)
        low = found < _ON_FLOOR
        return float((found[low] > -_ON_FLOOR).mean()) if low.sum() > _MIN_LOW * len(found) else 0.0

    matrices = poses_to_matrices(poses[views])
    below = float((heights(matrices) < -_BELOW).mean())
    if below < _SUSPICIOUS:
        return
    refuse_other_meaning(matrices, agreement, convention, "the floor at its height", minimum=_FITS, world=True)
    warn_user(
        f"{format_percent(below)} of the points are more than {_BELOW} m below the floor: pass poses in a world whose "
        "floor is at ground_height, such as FloorFit.camera_to_world of fit_floor, or floor=",
        UserWarning,
    )


@lru_cache(maxsize=16)
def _examined_pixels(camera: ImageCamera) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Return rows and columns of pixels of a grid, and their rays of depth 1, shape ``(N, 3)``."""
    step = max(1, int(np.sqrt(camera.width * camera.height / _MAX_POINTS)))
    y, x = np.mgrid[step // 2 : camera.height : step, step // 2 : camera.width : step].reshape(2, -1)
    return y, x, camera.depth_rays(np.stack([x, y], axis=-1) + 0.5)
