# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of the kernels that project points and judge their visibility."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from reference_voxels import shown_depth

from warpvis import Camera, Scene, Visibility
from warpvis.core.poses import poses_to_matrices


def camera_frames(poses: NDArray) -> tuple[NDArray, NDArray]:
    matrices = poses_to_matrices(np.asarray(poses, dtype=np.float32)).reshape(-1, 4, 4)
    return matrices[:, :3, 3], matrices[:, :3, :3].swapaxes(1, 2)


def project_points(camera: Camera, pose: NDArray, points: NDArray) -> tuple[NDArray, NDArray]:
    """Return pixels of points, NaN outside the image, and depths, shapes (N, 2) and (N,)."""
    matrix = poses_to_matrices(np.asarray(pose, dtype=np.float32))
    local = (np.asarray(points, dtype=np.float32).astype(np.float64) - matrix[:3, 3]) @ matrix[:3, :3]
    with np.errstate(divide="ignore", invalid="ignore"):
        at = camera.project(local)
        inside = (local[:, 2] > 0) & (at >= 0).all(axis=1) & (at < [camera.width, camera.height]).all(axis=1)
    return np.where(inside[:, None], at, np.nan), local[:, 2]


def judge_points(
    scene: Scene, camera: Camera, pose: NDArray, points: NDArray, tolerance: float
) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.float64]]:
    """Return every point's status, its occluder, and its margin along the ray to the opposite result [m]."""
    import reference

    at, depth = project_points(camera, pose, points)
    rays = camera.back_project(at, np.ones(len(at)))
    seen = reference._cast(scene, replace(camera, near=0.0, far=np.inf), pose, rays, False)
    margin = (depth - seen.depth) * np.linalg.norm(rays, axis=1) - tolerance
    status = _judge(camera, at, depth, margin)
    return status, np.where(status == Visibility.OCCLUDED, seen.objects, -1), np.abs(margin)


judge_points_packets = judge_points


def judge_points_measured(
    camera: Camera, pose: NDArray, depth: NDArray, points: NDArray, tolerance: float
) -> NDArray[np.uint8]:
    at, distance = project_points(camera, pose, points)
    x, y = np.where(np.isfinite(at), at, 0).astype(int).T
    surface = shown_depth(camera, depth)[y, x]
    length = np.linalg.norm(camera.back_project(at, np.ones(len(at))), axis=1)
    with np.errstate(invalid="ignore"):
        status = _judge(camera, at, distance, (distance - surface) * length - tolerance)
    in_range = (status == Visibility.VISIBLE) | (status == Visibility.OCCLUDED)
    return np.where(in_range & np.isnan(surface), Visibility.UNKNOWN, status).astype(np.uint8)


def _judge(camera: Camera, at: NDArray, depth: NDArray, margin: NDArray) -> NDArray[np.uint8]:
    status = np.where(margin > 0, Visibility.OCCLUDED, Visibility.VISIBLE)
    rounded = depth.astype(np.float32)
    status = np.where(rounded > np.float32(camera.far), Visibility.TOO_FAR, status)
    status = np.where(rounded < np.float32(camera.near), Visibility.TOO_NEAR, status)
    return np.where(np.isnan(at[:, 0]), Visibility.OUT_OF_VIEW, status).astype(np.uint8)
