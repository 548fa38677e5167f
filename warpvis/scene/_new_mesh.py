# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Objects that get another mesh: what `Scene.update_mesh` puts in their place."""

from __future__ import annotations

import numpy as np
import warp as wp

from warpvis.core.arrays import FARTHEST, on_gpu
from warpvis.core.types import ArrayInput
from warpvis.errors import SceneError
from warpvis.scene._object import SceneObject, check_mesh


def with_mesh(item: SceneObject, vertices: ArrayInput, faces: ArrayInput | None) -> SceneObject:
    """Return the object with another mesh, in the frame of one that moves, and else in the world.

    Args:
        item: The object, which is of one piece with no other.
        vertices: Corners [m], shape ``(n, 3)``.
        faces: Corner indices of the triangles, shape ``(m, 3)``; those that it has for None.

    Raises:
        SceneError: The mesh is empty or malformed.
    """
    name = item.name
    given = item.faces if faces is None else _host(faces, f"faces of {name!r}")
    corners, triangles = check_mesh((_host(vertices, f"vertices of {name!r}"), given), name)
    if np.abs(corners).max() > FARTHEST:
        where = "the origin of its frame" if item.movable else "the origin"
        raise SceneError(f"vertices of {name!r} must lie within 1e18 m of {where}")
    rounded = np.ascontiguousarray(corners, dtype=np.float32)
    if item.pose is None:
        return SceneObject(name, item.label, rounded, triangles)
    return SceneObject.placed(name, item.label, (rounded, triangles), item.pose)


def _host(array: ArrayInput, name: str) -> ArrayInput:
    """Copy an array of a GPU to the host; return any other as it is."""
    if isinstance(array, wp.array):
        return array.numpy()
    if not on_gpu(array):
        return array
    try:
        return wp.from_dlpack(array).numpy()
    except (RuntimeError, TypeError) as error:
        raise SceneError(f"{name} must be an array of numbers: {error}") from None
