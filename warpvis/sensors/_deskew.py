# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Motion compensation (deskewing) of point clouds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_number
from warpvis.core.motion import Motion, poses_of_view, rotate
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.sensors._clouds import Cloud

_REQUIRED_FIELDS = ("x", "y", "z", "time")


@overload
def deskew(points: Cloud, motion: Motion, *, times: None = None, target_time: float = 0.0) -> Cloud: ...


@overload
def deskew(points: Sequence[Cloud], motion: Motion, *, times: None = None, target_time: float = 0.0) -> list[Cloud]: ...


@overload
def deskew(
    points: ArrayInput, motion: Motion, *, times: ArrayLike | None = None, target_time: float = 0.0
) -> NDArray[np.float64]: ...


def deskew(points: Any, motion: Motion, *, times: ArrayLike | None = None, target_time: float = 0.0) -> Any:
    """Transform points measured by a moving sensor, each in the sensor frame at its own time, to the frame at one time.

    Args:
        points: A cloud with the fields ``x y z time``, as returned by `point_clouds`, or a list with one cloud for each
            view; or points in the sensor frame [m], shape ``(..., 3)``, or ``(V, ..., 3)`` for several views.
        motion: The motion of the sensor that was rendered.
        times: Times of points without fields, after the start of the frame [s]; the shape of the points without the
            view axis and the last axis.
        target_time: Time of the target frame, after the start of each frame [s].

    Returns:
        The points in the form in which they were given: clouds with all their fields, arrays in double precision.

    Raises:
        ArrayError: If an argument is invalid, or if the motion does not cover some of the times.
        PoseError: If the poses of the motion are on a GPU, or are poses of rays.
    """
    if not isinstance(motion, Motion):
        raise ArrayError(f"motion must be a warpvis.sensors.Motion, got {type(motion).__name__}")
    target_time = check_number(target_time, "target_time")
    views = motion.at(target_time).reshape(-1, 7)
    if isinstance(points, np.ndarray) and points.dtype.names is not None:
        _require_views(1, len(views))
        return _deskew_cloud(points, motion, 0, views[0])
    if isinstance(points, list | tuple) and any(isinstance(part, np.ndarray) and part.dtype.names for part in points):
        _require_views(len(points), len(views))
        return [_deskew_cloud(cloud, motion, view, views[view]) for view, cloud in enumerate(points)]
    array = as_numpy(points, name="points").astype(np.float64)
    if times is None:
        raise ArrayError("times must be given for points without a time field")
    moments = as_numpy(times, name="times")
    shape = moments.shape if array.ndim == moments.ndim + 1 and len(views) == 1 else (len(views), *moments.shape)
    if array.shape != (*shape, 3):
        raise ArrayError(
            f"points must have shape {(*moments.shape, 3)}, or {(len(views), *moments.shape, 3)} for {len(views)} "
            f"views, for times of shape {moments.shape}, got {array.shape}"
        )
    rows = array.reshape(len(views), -1, 3)
    transformed = [_transform(rows[view], motion, view, moments.ravel(), pose) for view, pose in enumerate(views)]
    return np.stack(transformed).reshape(array.shape)


def _deskew_cloud(cloud: Any, motion: Motion, view: int, pose: NDArray[np.float64]) -> Cloud:
    names = getattr(getattr(cloud, "dtype", None), "names", None) or ()
    missing = [name for name in _REQUIRED_FIELDS if name not in names]
    if missing:
        raise ArrayError(f"points must have the fields {', '.join(_REQUIRED_FIELDS)}, missing {', '.join(missing)}")
    points = np.stack([cloud[name].astype(np.float64).ravel() for name in "xyz"], axis=-1)
    coordinates = _transform(points, motion, view, cloud["time"].ravel(), pose)
    result = cloud.copy()
    for axis, name in enumerate("xyz"):
        result[name] = coordinates[:, axis].reshape(cloud.shape)
    return result


def _transform(
    points: NDArray[np.float64], motion: Motion, view: int, times: NDArray, pose: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Transform points from the sensor frames at their times to the frame of `pose`."""
    if not np.isfinite(times).all():
        raise ArrayError(f"times must be finite, and {int((~np.isfinite(times)).sum())} are not")
    rows = poses_of_view(motion, view, times)
    # Subtract positions first: this is exact far from the world origin.
    offset = rows[:, :3] - pose[:3] + rotate(rows[:, 3:], points)
    return rotate(pose[3:] * (-1, -1, -1, 1), offset)


def _require_views(clouds: int, views: int) -> None:
    if clouds != views:
        raise ArrayError(f"points must be one cloud for each of the {views} views of the motion, got {clouds}")
