# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Point clouds of ray patterns, in the sensor frame: structured NumPy arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.rays import Rays
from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_flag
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.rendering import Views

Cloud = NDArray[np.void]
"""Points with named fields."""

# Field of the cloud, attribute of `Views`, and dtype of the field.
_VIEW_FIELDS = (("object", "segmentation", "<i4"), ("label", "labels", "u1"))


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

    Raises:
        ArrayError: If an argument is invalid.
    """
    if not isinstance(rays, Rays):
        raise ArrayError(f"rays must be warpvis.cameras.Rays, got {type(rays).__name__}")
    if not isinstance(views, Views):
        raise ArrayError(f"views must be warpvis.Views, got {type(views).__name__}")
    if not isinstance(views.depth, wp.array):
        raise ArrayError("views must have depth. Add it to outputs.")
    if rays.kind != "range":
        raise ArrayError(f'rays must have kind "range" to be converted to points, got {rays.kind!r}')
    organized = check_flag(organized, "organized")
    directions = np.asarray(rays.directions).reshape(-1, 3)
    depth = _flatten(views.depth, "depth", len(directions), None)
    fields: dict[str, NDArray[Any]] = {}
    for name, values in (("intensity", intensity), ("incidence", incidence)):
        if values is not None:
            fields[name] = _flatten(values, name, len(directions), len(depth)).astype("<f4")
    for name, image, kind in _VIEW_FIELDS:
        if getattr(views, image) is not None:
            fields[name] = _flatten(getattr(views, image), image, len(directions), len(depth)).astype(kind)
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
    host = as_numpy(values.numpy() if isinstance(values, wp.array) else values, name=name)
    count = host.shape[0] if host.ndim > 1 else 1
    if host.size != count * rays or (views is not None and count != views):
        expected = "views" if views is None else str(views)
        raise ArrayError(f"{name} must have shape ({expected}, {rays}) or the shape of the rays, got {host.shape}")
    return host.reshape(count, rays)
