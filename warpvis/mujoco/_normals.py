# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shading normals of MuJoCo's shapes, for each corner of their triangles, as in its renderer."""

from __future__ import annotations

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

_GEOM = mujoco.mjtGeom
_MESHES = (_GEOM.mjGEOM_MESH, _GEOM.mjGEOM_SDF)
_ROUND = (_GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_ELLIPSOID, _GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_CYLINDER)


def has_normals(kind: int) -> bool:
    """Return whether shapes of a `mujoco.mjtGeom` have smooth normals that differ from those of their triangles."""
    return kind in _MESHES or kind in _ROUND


def stored_normals(model: mujoco.MjModel, mesh: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Copy a mesh's normals, shape ``(n, 3)``, and their indices at the corners of its faces, ``(m, 3)``."""
    first, start = int(model.mesh_normaladr[mesh]), int(model.mesh_faceadr[mesh])
    rows = model.mesh_normal[first : first + int(model.mesh_normalnum[mesh])]
    return rows.copy(), model.mesh_facenormal[start : start + int(model.mesh_facenum[mesh])].copy()


def corner_normals(
    stored: tuple[NDArray[np.float32], NDArray[np.int32]], vertices: NDArray[np.floating], faces: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Return normals of the corners of a mesh's faces, shape ``(m, 3, 3)``; the face normal where one is 0."""
    rows, index = stored
    normals, corners = rows[index].astype(np.float64), vertices[faces].astype(np.float64)
    none = ~(np.linalg.norm(normals, axis=-1) > 0)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat[~(np.linalg.norm(flat, axis=-1) > 0)] = 0, 0, 1  # faces without an area, which are not visible
    normals[none] = np.repeat(flat[:, None], 3, axis=1)[none]
    return normals.astype(np.float32)


def round_normals(
    kind: int, size: NDArray[np.float64], vertices: NDArray[np.floating], faces: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Return normals at the triangle corners of a round shape in its frame, shape ``(m, 3, 3)``."""
    corners = vertices[faces].astype(np.float64)
    if kind == _GEOM.mjGEOM_ELLIPSOID:
        return (corners / size**2).astype(np.float32)
    if kind == _GEOM.mjGEOM_CAPSULE:
        return (corners - [0, 0, 1] * np.clip(corners[..., 2:], -size[1], size[1])).astype(np.float32)
    if kind == _GEOM.mjGEOM_CYLINDER:
        aside = corners * [1, 1, 0]
        is_end = np.ptp(corners[..., 2], axis=1) == 0
        aside[is_end] = np.sign(corners[is_end][..., 2:]) * [0, 0, 1]
        return aside.astype(np.float32)
    return corners.astype(np.float32)
