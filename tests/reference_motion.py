# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of the kernels of `warpvis.kernels.casting.motions`, `moving_rays` and `moving_objects`, by matrix powers.

They use no quaternion interpolation and no trigonometric formulas: rotations are orthogonal matrices, and exponentials
are power series.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from reference_ray_table import cast_ray_table, in_groups

from warpvis import Scene
from warpvis.core.poses import poses_to_matrices


def exponential(matrix: NDArray) -> NDArray[np.float64]:
    """Return the exponential of a square matrix by its series, after scaling; squaring restores the scale."""
    halvings = max(0, int(np.ceil(np.log2(np.abs(matrix).max() + 1e-300))) + 4)
    small = matrix / 2.0**halvings
    term = total = np.eye(len(matrix))
    for k in range(1, 20):
        term = term @ small / k
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total


def crossed(vector: NDArray) -> NDArray[np.float64]:
    """Return the cross-product matrix of a vector."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0.0]])


def turn_of(rotation: NDArray) -> NDArray[np.float64]:
    """Return axis times angle of a rotation matrix: the axis is its fixed vector, the trace gives the cosine."""
    values, vectors = np.linalg.eig(rotation)
    axis = np.real(vectors[:, np.argmin(np.abs(values - 1))])
    axis /= np.linalg.norm(axis)
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    return np.arctan2(skew @ axis / 2, (np.trace(rotation) - 1) / 2) * axis


def begin_legs(
    poses: NDArray, linear: NDArray | None = None, angular: NDArray | None = None
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return origins, rotation matrices, translations and rotation vectors of segments; poses (T, rows, columns, 7)."""
    matrices = poses_to_matrices(poses)
    path, turn = np.zeros((2, *poses.shape[:-1], 3))
    if linear is not None and angular is not None:
        path[:], turn[:] = linear, angular
    else:
        path[:-1] = matrices[1:, ..., :3, 3] - matrices[:-1, ..., :3, 3]
        for at in np.ndindex(len(poses) - 1, *poses.shape[1:-1]):
            after = matrices[(at[0] + 1, *at[1:])]
            turn[at] = turn_of(matrices[at][:3, :3].T @ after[:3, :3])
    return matrices[..., :3, 3], matrices[..., :3, :3], path, turn


def between(first: NDArray, second: NDArray, share: float) -> NDArray[np.float64]:
    """Return the matrix between two poses: linear translation and a power of the relative rotation."""
    a, b = poses_to_matrices(np.array([first, second]))
    result = np.eye(4)
    result[:3, 3] = (1 - share) * a[:3, 3] + share * b[:3, 3]
    result[:3, :3] = a[:3, :3] @ exponential(share * crossed(turn_of(a[:3, :3].T @ b[:3, :3])))
    return result


def along_screw(pose: NDArray, linear: NDArray, angular: NDArray, time: float) -> NDArray[np.float64]:
    """Return the matrix after motion at constant body velocities: the pose times the exponential of the twist."""
    twist = np.zeros((4, 4))
    twist[:3, :3], twist[:3, 3] = crossed(angular), linear
    return poses_to_matrices(pose) @ exponential(time * twist)


def cast_moving_rays(
    scene: Scene, rays: NDArray, poses: NDArray, origins: NDArray | None = None, **options: Any
) -> Any:
    """Return the images of rays (H, W, 3), each from its pose (H, W, 7)."""
    starts = np.zeros_like(rays) if origins is None else origins
    keys = np.concatenate([poses, starts], axis=-1)

    def cast(some: NDArray, key: NDArray) -> Any:
        return cast_ray_table(scene, some, key[:7], origins=np.broadcast_to(key[7:], some.shape), **options)

    return in_groups(rays, keys, cast)


def cast_at_moving_objects(
    scene_at: Callable[[float], Scene],
    rays: NDArray,
    poses: NDArray,
    times: NDArray,
    origins: NDArray | None = None,
    **options: Any,
) -> Any:
    """Return the images of rays cast at times (H, W), with the scene at each ray's time."""
    starts = np.zeros_like(rays) if origins is None else origins
    keys = np.concatenate([times[..., None], poses, starts], axis=-1)

    def cast(some: NDArray, key: NDArray) -> Any:
        at = np.broadcast_to(key[8:], some.shape)
        return cast_ray_table(scene_at(float(key[0])), some, key[1:8], origins=at, **options)

    return in_groups(rays, keys, cast)


def measure_moving_incidence(poses: NDArray, directions: NDArray, normals: NDArray) -> NDArray[np.float64]:
    """Return cosines between rays (H, W, 3) in the frames of their poses (H, W, 7) and normals (H, W, 3)."""
    along = np.einsum("yxij,yxj->yxi", poses_to_matrices(poses)[..., :3, :3], directions)
    return np.abs((along * normals).sum(axis=-1))


def back_project_moving(poses: NDArray, rays: NDArray, origins: NDArray | float, depth: NDArray) -> NDArray[np.float64]:
    """Return world points at depths (H, W) along rays (H, W, 3) in the frames of their poses (H, W, 7)."""
    matrices = poses_to_matrices(poses)
    local = origins + rays * np.where(np.isfinite(depth), depth, np.nan)[..., None]
    return np.einsum("yxij,yxj->yxi", matrices[..., :3, :3], local) + matrices[..., :3, 3]
