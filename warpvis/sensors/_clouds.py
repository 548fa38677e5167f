# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Point clouds of ray patterns, in the sensor frame, as structured NumPy arrays, and their motion compensation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.rays import Rays
from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_flag, check_number
from warpvis.core.motion import Motion, poses_of_view, rotate
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.rendering import Views
from warpvis.sensors._echoes import require_image, require_rays

Cloud = NDArray[np.void]
"""Points with named fields."""

# Field of the cloud, attribute of `Views`, and dtype of the field.
_VIEW_FIELDS = (("object", "segmentation", "<i4"), ("label", "labels", "u1"))
_DESKEWED_FIELDS = ("x", "y", "z", "time")


def point_clouds(
    views: Views,
    rays: Rays,
    *,
    intensity: ArrayInput | None = None,
    incidence: ArrayInput | None = None,
    organized: bool = False,
) -> list[Cloud]:
    """Return a point cloud for each view, in the sensor frame at the time each ray was cast, as lidar drivers do.

    Args:
        views: Rendered images of the rays, with depth. Segmentation and labels become fields if present.
        rays: The rendered ray pattern; its `kind` must be ``"range"``.
        intensity: Intensities, with the shape of the depth image: an array of NumPy, Warp, PyTorch, ...
        incidence: Cosines of the angle of incidence, with the same shape.
        organized: Whether clouds keep the shape of the rays, with NaN where nothing was measured. By default, rays
            without a measurement are left out, and points are sorted by time if the rays have times.

    Returns:
        For each view, a structured array of shape ``(points,)``, or of the rays' shape if `organized`. Its fields, as
        far as available: ``x y z`` [m], ``intensity``, ``ring`` (uint16), ``time`` [s], ``range`` [m], ``incidence``,
        ``object`` (int32, index into the scene's objects), ``label`` (uint8); float32 unless noted.
    """
    require_rays(rays)
    image = require_image(views, "depth")
    if rays.kind != "range":
        raise ArrayError(f'rays must have kind "range" to be converted to points, got {rays.kind!r}')
    organized = check_flag(organized, "organized")
    directions = np.asarray(rays.directions).reshape(-1, 3)
    depth = _flatten(image, "depth", len(directions), None)
    fields: dict[str, NDArray[Any]] = {}
    for name, values in (("intensity", intensity), ("incidence", incidence)):
        if values is not None:
            fields[name] = _flatten(values, name, len(directions), len(depth)).astype("<f4")
    for name, output, kind in _VIEW_FIELDS:
        if getattr(views, output) is not None:
            fields[name] = _flatten(getattr(views, output), output, len(directions), len(depth)).astype(kind)
    return [
        _cloud(rays, depth[view], {name: rows[view] for name, rows in fields.items()}, organized)
        for view in range(len(depth))
    ]


def _cloud(rays: Rays, depth: NDArray, fields: dict[str, NDArray], organized: bool) -> Cloud:
    """Return the cloud of one view from arrays of shape ``(rays,)``."""
    valid = np.isfinite(depth)
    distance = np.where(valid, depth, np.nan).astype(np.float64)
    points = distance[:, None] * np.asarray(rays.directions).reshape(-1, 3)
    if rays.origins is not None:
        points += np.asarray(rays.origins).reshape(-1, 3)
    columns = {name: points[:, axis].astype("<f4") for axis, name in enumerate("xyz")}
    if "intensity" in fields:
        columns["intensity"] = fields.pop("intensity")
    if rays.rings is not None:
        columns["ring"] = np.asarray(rays.rings).reshape(-1).astype("<u2")
    if rays.times is not None:
        columns["time"] = np.asarray(rays.times).reshape(-1).astype("<f4")
    columns |= {"range": distance.astype("<f4"), **fields}
    cloud = np.empty(len(depth), dtype=[(name, values.dtype) for name, values in columns.items()])
    for name, values in columns.items():
        cloud[name] = values
    if organized:
        return cloud.reshape(rays.shape)
    if rays.times is None:
        return cloud[valid]
    order = np.argsort(np.asarray(rays.times).reshape(-1), kind="stable")
    return cloud[order[valid[order]]]


def _flatten(values: Any, name: str, rays: int, views: int | None) -> NDArray[Any]:
    """Copy an image of each view to the host and flatten it to shape ``(views, rays)``."""
    host = as_numpy(values, name=name)
    count = host.shape[0] if host.ndim > 1 else 1
    if host.size != count * rays or (views is not None and count != views):
        expected = "views" if views is None else str(views)
        raise ArrayError(f"{name} must have shape ({expected}, {rays}) or the shape of the rays, got {host.shape}")
    return host.reshape(count, rays)


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
        PoseError: If the poses of the motion are on a GPU, or are poses of rays.
    """
    if not isinstance(motion, Motion):
        raise ArrayError(f"motion must be a warpvis.sensors.Motion, got {type(motion).__name__}")
    target_time = check_number(target_time, "target_time")
    views = motion.at(target_time).reshape(-1, 7)
    clouds = points if isinstance(points, list | tuple) else [points]
    if any(isinstance(cloud, np.ndarray) and cloud.dtype.names is not None for cloud in clouds):
        if len(clouds) != len(views):
            raise ArrayError(
                f"points must be one cloud for each of the {len(views)} views of the motion, got {len(clouds)}"
            )
        deskewed = [_deskew_cloud(cloud, motion, view, views[view]) for view, cloud in enumerate(clouds)]
        return deskewed if clouds is points else deskewed[0]
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
    missing = [name for name in _DESKEWED_FIELDS if name not in names]
    if missing:
        raise ArrayError(f"points must have the fields {', '.join(_DESKEWED_FIELDS)}, missing {', '.join(missing)}")
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
