# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reference of the rangefinder kernel: each ray against each geom, round shapes by MuJoCo's own ray function."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from warpvis.mujoco._geoms import stored_mesh


def read_rangefinders(
    model: mujoco.MjModel, data: mujoco.MjData, origin: NDArray, direction: NDArray, body: int
) -> tuple[float, NDArray[np.float64]]:
    """Return distance and normal of a ray's first hit, ignoring transparent geoms and `body`; -1 and zeros if none."""
    best, normal = np.inf, np.zeros(3)
    for geom in range(model.ngeom):
        material = model.geom_matid[geom]
        rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
        if model.geom_bodyid[geom] == body or rgba[3] == 0:
            continue
        place, rotation = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
        mesh = stored_mesh(model, int(model.geom_type[geom]), int(model.geom_dataid[geom]))
        if mesh is None:
            there = np.zeros(3)
            size, kind = model.geom_size[geom], int(model.geom_type[geom])
            distance = mujoco.mju_rayGeom(place, rotation.ravel(), size, origin, direction, kind, there)
        else:
            distance, there = meet_triangles(mesh[0][mesh[1]], (origin - place) @ rotation, direction @ rotation)
            there = rotation @ there
        if 0 <= distance < best:
            best, normal = distance, there
    return (best, normal) if np.isfinite(best) else (-1.0, np.zeros(3))


read_rangefinder_rows = read_rangefinders  # on CPU cores


def meet_triangles(corners: NDArray, origin: NDArray, direction: NDArray) -> tuple[float, NDArray[np.float64]]:
    """Return distance and normal of a ray's first hit among triangles, (n, 3, 3), from either side; -1 for a miss."""
    a = corners[:, 0] - origin
    matrices = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    normals = np.cross(matrices[..., 0], matrices[..., 1])
    steepness = normals @ direction
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.einsum("ij,ij->i", normals, a) / steepness
        u = np.einsum("ij,ij->i", np.cross(direction, a), matrices[..., 1]) / -steepness
        v = np.einsum("ij,ij->i", np.cross(direction, a), matrices[..., 0]) / steepness
    hits = (steepness != 0) & (distance >= 0) & (u >= 0) & (v >= 0) & (u + v <= 1)
    if not hits.any():
        return -1.0, np.zeros(3)
    nearest = np.flatnonzero(hits)[np.argmin(distance[hits])]
    return float(distance[nearest]), normals[nearest] / np.linalg.norm(normals[nearest])
