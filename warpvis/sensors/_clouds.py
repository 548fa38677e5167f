# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Point clouds of lidars' images, in the sensor's frame: NumPy arrays with a named field for all that is known."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_flag
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.rendering import Views
from warpvis.sensors._rays import Rays

Cloud = NDArray[np.void]
"""Points with named fields."""

# Field of a cloud, of which views' image it is, and as what.
_OF_VIEWS = (("object", "segmentation", "<i4"), ("label", "labels", "u1"))


def point_clouds(
    views: Views,
    rays: Rays,
    *,
    intensity: ArrayInput | None = None,
    incidence: ArrayInput | None = None,
    organized: bool = False,
) -> list[Cloud]:
    """Make the point cloud of every view, in the sensor's frame as it was when each ray was cast, as drivers give it.

    Args:
        views: Images of these rays, with depth. What else they have becomes fields.
        rays: What was rendered, with depth along rays.
        intensity: Intensities, of the shape of depth, of NumPy, Warp, PyTorch, ...
        incidence: Cosines of incidence, likewise.
        organized: Whether clouds keep the shape of the rays, with NaN where nothing was measured. By default these are
            left out, and points are in the order of their times, or if rays have none, of the rays.

    Returns:
        For each view a structured array, shape ``(points,)``, or the rays' shape, with those of these fields that are
        known: ``x y z`` [m], ``intensity``, ``ring`` (uint16), ``time`` [s], ``range`` [m], ``incidence``, ``object``
        (int32, an index into the scene's objects), ``label`` (uint8); float32 where nothing else is said.

    Raises:
        ArrayError: An argument is not what it has to be.
    """
    if not isinstance(rays, Rays):
        raise ArrayError(f"rays must be warpvis.sensors.Rays, got {type(rays).__name__}")
    if not isinstance(views, Views):
        raise ArrayError(f"views must be warpvis.Views, got {type(views).__name__}")
    if not isinstance(views.depth, wp.array):
        raise ArrayError("views must have depth: ask for it in outputs")
    if rays.kind != "range":
        raise ArrayError(f'rays must have kind "range", of which points are made, got {rays.kind!r}')
    organized = check_flag(organized, "organized")
    directions = np.asarray(rays.directions).reshape(-1, 3)
    depth = _flat(views.depth, "depth", len(directions), None)
    fields: dict[str, NDArray[Any]] = {}
    for name, values in (("intensity", intensity), ("incidence", incidence)):
        if values is not None:
            fields[name] = _flat(values, name, len(directions), len(depth)).astype("<f4")
    for name, image, kind in _OF_VIEWS:
        if getattr(views, image) is not None:
            fields[name] = _flat(getattr(views, image), image, len(directions), len(depth)).astype(kind)
    return [
        _cloud(rays, depth[view], {name: rows[view] for name, rows in fields.items()}, organized)
        for view in range(len(depth))
    ]


def _cloud(rays: Rays, depth: NDArray, fields: dict[str, NDArray], organized: bool) -> Cloud:
    """Make the cloud of one view, whose arrays are of shape ``(rays,)``."""
    found = np.isfinite(depth)
    distance = np.where(found, depth, np.nan).astype(np.float64)
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
        return cloud[found]
    order = np.argsort(np.asarray(rays.times).reshape(-1), kind="stable")
    return cloud[order[found[order]]]


def _flat(values: Any, name: str, rays: int, views: int | None) -> NDArray[Any]:
    """Return an image of every view on the host, shape ``(views, rays)``."""
    host = as_numpy(values.numpy() if isinstance(values, wp.array) else values, name=name)
    count = host.shape[0] if host.ndim > 1 else 1
    if host.size != count * rays or (views is not None and count != views):
        wanted = "views" if views is None else str(views)
        raise ArrayError(f"{name} must be of shape ({wanted}, {rays}) or of the rays' own shape, got {host.shape}")
    return host.reshape(count, rays)
