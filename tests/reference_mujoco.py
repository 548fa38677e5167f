# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of the kernels that read MuJoCo's arrays."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray


def geom_transforms(geom_xpos: NDArray, geom_xmat: NDArray, worlds: NDArray, geoms: NDArray) -> NDArray[np.float64]:
    """Return geom to world of every pair of a world and a geom, matrices of shape (W, M, 4, 4)."""
    return _matrices(geom_xpos, geom_xmat)[np.asarray(worlds)[:, None], np.asarray(geoms)]


def camera_transforms(cam_xpos: NDArray, cam_xmat: NDArray, cameras: NDArray, worlds: NDArray) -> NDArray[np.float64]:
    """Return OpenCV camera to world of every pair of a camera and a world, matrices of shape (C, W, 4, 4)."""
    turn = np.diag([1.0, -1, -1, 1])
    return _matrices(cam_xpos, cam_xmat)[np.asarray(worlds), np.asarray(cameras)[:, None]] @ turn


def _matrices(position: NDArray, rotation: NDArray) -> NDArray[np.float64]:
    matrices = np.zeros((*np.shape(position)[:2], 4, 4))
    matrices[..., :3, :3] = np.reshape(rotation, (*np.shape(position), 3))
    matrices[..., :3, 3], matrices[..., 3, 3] = position, 1
    return matrices


def viewer_transforms(
    subtree_com: NDArray, cameras: NDArray, bodies: NDArray, poses: NDArray, worlds: NDArray
) -> NDArray[np.float64]:
    """Return pose rows of every pair of a camera and a world, (C, W, 7), NaN for the model's cameras."""
    rows = np.full((len(cameras), len(worlds), 7), np.nan)
    for row, (camera, body) in enumerate(zip(cameras, bodies, strict=True)):
        if camera < 0:
            rows[row] = poses[row]
            rows[row, :, :3] += subtree_com[worlds, body] if body >= 0 else 0
    return rows


def hidden_objects(
    geom_rgba: NDArray, geom_matid: NDArray, mat_rgba: NDArray, worlds: NDArray, geoms: NDArray, views: int
) -> NDArray[np.uint8]:
    hidden = np.zeros((views, len(geoms)), dtype=np.uint8)
    for view, column in np.ndindex(hidden.shape):
        world, geom = worlds[view % len(worlds)], geoms[column]
        rgba, material = geom_rgba[world % len(geom_rgba), geom], geom_matid[world % len(geom_matid), geom]
        if material >= 0 and rgba.tolist() == [0.5, 0.5, 0.5, 1]:
            rgba = mat_rgba[world % len(mat_rgba), material]
        hidden[view, column] = geom >= 0 and rgba[3] == 0
    return hidden


def scale_sizes(made: NDArray, scales: NDArray, worlds: int) -> NDArray[np.float64]:
    """Return sizes of movable objects, (worlds, M, 4), from original sizes and scale factors, (1 or W, M, 3)."""
    factors = np.concatenate([scales, np.ones((*scales.shape[:2], 1))], axis=-1).astype(np.float64)
    return made * factors[np.arange(worlds) % len(factors)]


def geom_sizes(
    sizes: NDArray, rows: NDArray, geoms: NDArray, kinds: NDArray, own: NDArray, made: NDArray
) -> NDArray[np.float64]:
    """Return sizes of movable objects per world, for spheres, capsules, ellipsoids, cylinders (2 to 5) and boxes."""
    found = np.tile(made.astype(np.float64), (len(rows), 1, 1))
    for (row, world), (column, geom) in product(enumerate(rows), enumerate(geoms)):
        now = sizes[world % len(sizes), geom].astype(np.float64)
        if geom < 0 or (now == own[geom]).all():
            continue
        kind = kinds[geom]
        radii = {4: now, 6: now / own[geom]}.get(kind, now[[0, 0, 0]])
        found[row, column] = [*radii, now[1] / now[0] if kind in (3, 5) else made[column, 3]]
    return found


def geoms_of_objects(objects: NDArray, geom_ids: NDArray) -> NDArray[np.int32]:
    return np.where(objects < 0, -1, np.asarray(geom_ids)[objects]).astype(np.int32)


def pairs_of_objects(objects: NDArray, pairs: NDArray) -> NDArray[np.int32]:
    return np.where(np.asarray(objects)[:, None] < 0, -1, np.asarray(pairs)[objects]).astype(np.int32)
