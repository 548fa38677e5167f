# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The bounding box of a scene; instances of a shared mesh are transformed in batches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices
from warpvis.scene._object import SceneObject
from warpvis.scene._object_list import Instances, ObjectList

# Corners transformed per batch, 24 bytes each: a batch stays in the CPU's caches.
_MAX_CORNERS = 1 << 16


def bounds_of(objects: ObjectList) -> NDArray[np.float32]:
    """Return the minimum and maximum corner of the objects' axis-aligned box [m], shape ``(2, 3)``."""
    shared: dict[int, tuple[NDArray[np.floating], list[NDArray[np.floating]]]] = {}
    boxes = []
    for first, count, item in objects.runs():
        placed = _placed(item, first, count)
        if placed is None:
            assert isinstance(item, SceneObject)
            boxes.append(item.bounds)
        else:
            vertices, rows = placed
            shared.setdefault(id(vertices), (vertices, []))[1].append(rows)
    boxes += [_bounds_at(vertices, np.concatenate(rows)) for vertices, rows in shared.values()]
    ends = np.stack(boxes)
    return np.stack([ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)])


def _placed(
    item: SceneObject | Instances, first: int, count: int
) -> tuple[NDArray[np.floating], NDArray[np.floating]] | None:
    """Return a mesh that may be shared, and its poses, shape ``(n, 7)``; None for a mesh in the world's frame."""
    if isinstance(item, Instances):
        if item.movable:
            return item.mesh.rounded, item.poses(first, count)
        return item.mesh.vertices, item.rows[first - item.first : first - item.first + count]
    if item.shared_mesh is not None:
        return item.shared_mesh.vertices, item.place[None]
    if item.pose is not None and item.mesh_vertices is not None and item.points is None:
        return item.mesh_vertices, item.pose[None]
    return None


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
