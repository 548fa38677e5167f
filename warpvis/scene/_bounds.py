# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The bounding box of a scene, and guesses of its unit from its size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices
from warpvis.scene._object import ObjectList

# Corners transformed per batch, 24 bytes each: a batch stays in the CPU's caches.
_MAX_CORNERS = 1 << 16

# Range of typical model sizes, from a cup to a hall [m], and size above which millimeters are more likely than meters.
_MIN_MODEL, _LARGEST_MODEL = 0.01, 100.0
_MANY_METERS = 60.0

# A scene this many times larger than the camera's range is rarely intended.
_TOO_LARGE = 10.0


def bounds_of(objects: ObjectList) -> NDArray[np.float32]:
    """Return the minimum and maximum corner of the objects' axis-aligned box [m], shape ``(2, 3)``."""
    shared: dict[int, tuple[NDArray[np.floating], list[NDArray[np.floating]]]] = {}
    boxes = []
    for _, _, item, rows in objects.runs():
        if item.shares_mesh or (item.pose is not None and item.points is None):
            vertices = item.mesh.vertices if item.shares_mesh else item.mesh.rounded
            rows = rows if item.shares_mesh else rows.astype(np.float32)
            shared.setdefault(id(vertices), (vertices, []))[1].append(rows)
        else:
            boxes.append(item.bounds)
    boxes += [_bounds_at(vertices, np.concatenate(rows)) for vertices, rows in shared.values()]
    ends = np.stack(boxes)
    return np.stack([ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)])


def _bounds_at(vertices: NDArray[np.floating], rows: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the axis-aligned box around a mesh at several poses."""
    matrices = poses_to_matrices(rows.astype(np.float64))
    corners = np.ascontiguousarray(vertices.T, dtype=np.float64)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    step = max(1, _MAX_CORNERS // len(vertices))
    for start in range(0, len(matrices), step):
        part = matrices[start : start + step]
        placed = part[:, :3, :3] @ corners
        low = np.minimum(low, (placed.min(axis=2) + part[:, :3, 3]).min(axis=0))
        high = np.maximum(high, (placed.max(axis=2) + part[:, :3, 3]).max(axis=0))
    return np.stack([low, high]).astype(np.float32)


def fits_millimeters(size: NDArray[np.floating]) -> bool:
    """Return whether a scene's size, read as millimeters, is typical of models."""
    return bool(_MIN_MODEL <= np.max(size) / 1000 <= _LARGEST_MODEL)


def looks_like_millimeters(size: NDArray[np.floating]) -> bool:
    """Return whether a scene's sides [m] are more likely millimeters: all are large, except for flat scenes."""
    return fits_millimeters(size) and bool(np.max(size) > _MANY_METERS) and bool(np.median(size) > _MANY_METERS / 4)


def too_large_for(size: NDArray[np.floating], far: float) -> bool:
    """Return whether a scene's sides [m] are likely millimeters, given a camera of range `far` that sees nothing."""
    return bool(np.max(size) > _TOO_LARGE * far) and fits_millimeters(size)
