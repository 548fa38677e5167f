# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reference of the kernels of registration: normal equations and steps, in double precision."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from warpvis.cameras.base import AnyCamera
from warpvis.core.poses import vectors_in_axes


def robust_cost(residual: NDArray[np.float64], huber: float) -> NDArray[np.float64]:
    """Return Huber's cost of residuals."""
    size = np.abs(residual)
    return np.where(size <= huber, size**2 / 2, huber * (size - huber / 2))


def at_edge(depth: NDArray[np.float64], max_jump: float) -> NDArray[np.bool_]:
    """Return pixels of an image, ``(H, W)``, at which inverse depth bends along a row or a column."""
    edge = np.zeros(depth.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        row = depth[:, 1:-1] * (depth[:, 1:-1] * (1 / depth[:, :-2] + 1 / depth[:, 2:]) - 2)
        column = depth[1:-1] * (depth[1:-1] * (1 / depth[:-2] + 1 / depth[2:]) - 2)
    edge[:, 1:-1] |= np.abs(row) > max_jump
    edge[1:-1] |= np.abs(column) > max_jump
    return edge


def sum_terms(
    camera: AnyCamera,
    pose: NDArray[np.float64],
    rendered: NDArray,
    normals: NDArray,
    measured: NDArray,
    *,
    sigma: float,
    huber: float,
    max_distance: float,
    min_cosine: float,
    max_jump: float = math.inf,
    moving: NDArray[np.bool_] | None = None,
    center: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, int, int]:
    """Return H, b, the cost and the numbers of inliers and of measured pixels of one view.

    `moving` are the pixels of the object that moves about `center`; None if the camera moves.
    """
    rotation = Rotation.from_quat(pose[3:]).as_matrix()
    to_world = [
        vectors_in_axes(table.reshape(-1, 3), camera.axes, "opencv") @ rotation.T
        for table in (camera.rays, np.zeros_like(camera.rays) if camera.origins is None else camera.origins)
    ]
    rays, offsets = to_world
    edge = np.zeros(rendered.shape, bool) if math.isinf(max_jump) else at_edge(rendered.astype(np.float64), max_jump)
    z, m, n = rendered.ravel().astype(float), measured.ravel().astype(float), normals.reshape(-1, 3).astype(float)
    with np.errstate(invalid="ignore"):
        valid = np.isfinite(m) & (m > 0) & (m >= camera.near) & (m <= camera.far) & np.isfinite(rays).all(axis=1)
        seen = valid & np.isfinite(z)
        residual = np.where(seen, (m - z) / sigma, np.inf)
        along = (n * rays).sum(axis=1)
        inlier = seen & (np.abs(along * (m - z)) <= max_distance)
        inlier &= along**2 > min_cosine**2 * (rays**2).sum(axis=1)
    cost = robust_cost(np.minimum(np.abs(residual), max_distance / sigma), huber)[valid].sum()
    inlier &= ~edge.ravel()
    sign = 1.0
    if moving is not None:
        inlier &= moving.ravel()
        offsets = offsets + pose[:3] - center
        sign = -1.0
    scaled = sign * n[inlier] / (along[inlier] * sigma)[:, None]
    arms = offsets[inlier] + m[inlier, None] * rays[inlier]
    jacobian = np.hstack([np.cross(arms, scaled), scaled])
    weights = np.minimum(1, huber / np.maximum(np.abs(residual[inlier]), huber))
    matrix = jacobian.T @ (weights[:, None] * jacobian)
    return matrix, jacobian.T @ (weights * residual[inlier]), float(cost), int(inlier.sum()), int(valid.sum())


sum_terms_rows = sum_terms


def add_strips(strips: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sums of views from those of their strips, ``(V, strips, sums)``."""
    return strips.sum(axis=1)


def spread_object_poses(poses: NDArray[np.float32], world: NDArray[np.int32] | None, count: int) -> NDArray[np.float32]:
    """Return the object poses of every view, ``(count, M, 7)``, from those of worlds."""
    if len(poses) == 1:
        return np.repeat(poses, count, axis=0)
    return poses[np.arange(count) if world is None else world]


def step_poses(
    pose: NDArray[np.float64], matrix: NDArray[np.float64], side: NDArray[np.float64], damping: float = 1e-4
) -> NDArray[np.float64]:
    """Return a pose after a damped step that is not limited."""
    scale = np.repeat([np.trace(matrix[:3, :3]) / 3, np.trace(matrix[3:, 3:]) / 3], 3)
    step = np.linalg.solve(matrix + damping * np.diag(scale), -side)
    turned = Rotation.from_rotvec(step[:3]) * Rotation.from_quat(pose[3:])
    return np.concatenate([pose[:3] + step[3:], turned.as_quat()])


def write_results(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the covariance of an information matrix, inf if it is singular."""
    if np.linalg.matrix_rank(matrix, hermitian=True) < len(matrix):
        return np.full(matrix.shape, np.inf)
    return np.linalg.inv(matrix)
