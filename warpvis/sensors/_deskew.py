# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds that were measured while the sensor moved, in its frame of one moment."""

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

_NEEDED = ("x", "y", "z", "time")


@overload
def deskew(points: Cloud, motion: Motion, *, times: None = None, at: float = 0.0) -> Cloud: ...


@overload
def deskew(points: Sequence[Cloud], motion: Motion, *, times: None = None, at: float = 0.0) -> list[Cloud]: ...


@overload
def deskew(
    points: ArrayInput, motion: Motion, *, times: ArrayLike | None = None, at: float = 0.0
) -> NDArray[np.float64]: ...


def deskew(points: Any, motion: Motion, *, times: ArrayLike | None = None, at: float = 0.0) -> Any:
    """Bring points that a moving sensor measured, each in its frame of another moment, to its frame of one moment.

    Args:
        points: A cloud with the fields ``x y z time``, as `point_clouds` makes them, or a list of one for each view; or
            points in the sensor's frame [m], shape ``(..., 3)``, and of several views ``(V, ..., 3)``.
        motion: How the sensor moved, as it was rendered.
        times: Of points without fields: when each was measured, after its frame's start [s], of their shape without
            the last axis and without that of the views.
        at: The moment whose frame points come to, after each frame's start [s]: 0.0 for the beginning of the frame.

    Returns:
        What was given, with other coordinates: clouds with all their fields, and points in double precision.

    Raises:
        ArrayError: An argument is not what it has to be, or the motion says nothing of some of the times.
        PoseError: The motion's poses are on a GPU, or of rays.
    """
    if not isinstance(motion, Motion):
        raise ArrayError(f"motion must be a warpvis.sensors.Motion, got {type(motion).__name__}")
    at = check_number(at, "at")
    views = motion.at(at).reshape(-1, 7)
    if isinstance(points, np.ndarray) and points.dtype.names is not None:
        _require_views(1, len(views))
        return _deskew_cloud(points, motion, 0, views[0])
    if isinstance(points, list | tuple) and any(isinstance(part, np.ndarray) and part.dtype.names for part in points):
        _require_views(len(points), len(views))
        return [_deskew_cloud(cloud, motion, view, views[view]) for view, cloud in enumerate(points)]
    given = as_numpy(points, name="points").astype(np.float64)
    if times is None:
        raise ArrayError("times must be given with points that have no field of them")
    moments = as_numpy(times, name="times")
    shape = moments.shape if given.ndim == moments.ndim + 1 and len(views) == 1 else (len(views), *moments.shape)
    if given.shape != (*shape, 3):
        raise ArrayError(
            f"points must have shape {(*moments.shape, 3)}, or of {len(views)} views "
            f"{(len(views), *moments.shape, 3)}, for times of shape {moments.shape}, got {given.shape}"
        )
    rows = given.reshape(len(views), -1, 3)
    found = [_moved(rows[view], motion, view, moments.ravel(), pose) for view, pose in enumerate(views)]
    return np.stack(found).reshape(given.shape)


def _deskew_cloud(cloud: Any, motion: Motion, view: int, pose: NDArray[np.float64]) -> Cloud:
    names = getattr(getattr(cloud, "dtype", None), "names", None) or ()
    missing = [name for name in _NEEDED if name not in names]
    if missing:
        raise ArrayError(f"a cloud must have the fields {', '.join(_NEEDED)}, and has no {', '.join(missing)}")
    points = np.stack([cloud[name].astype(np.float64).ravel() for name in "xyz"], axis=-1)
    moved = _moved(points, motion, view, cloud["time"].ravel(), pose)
    result = cloud.copy()
    for axis, name in enumerate("xyz"):
        result[name] = moved[:, axis].reshape(cloud.shape)
    return result


def _moved(
    points: NDArray[np.float64], motion: Motion, view: int, times: NDArray, pose: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Bring points of the sensor's frames at their times to the frame of a pose."""
    if not np.isfinite(times).all():
        raise ArrayError(f"times must be finite, and {int((~np.isfinite(times)).sum())} are not")
    rows = poses_of_view(motion, view, times)
    # Differences first: far from the world's origin, they lose nothing.
    there = rows[:, :3] - pose[:3] + rotate(rows[:, 3:], points)
    return rotate(pose[3:] * (-1, -1, -1, 1), there)


def _require_views(clouds: int, views: int) -> None:
    if clouds != views:
        raise ArrayError(f"points must be one cloud for each of the motion's {views} views, got {clouds}")
