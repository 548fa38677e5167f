# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reference of the kernel of `warpvis.kernels.casting.ray_bundles`, by the brute force of `reference`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis import Camera, Scene
from warpvis.core.poses import poses_to_matrices


def cast_ray_table(
    scene: Scene,
    rays: NDArray,
    pose: NDArray,
    *,
    near: float = 0.0,
    far: float = np.inf,
    cull_backfaces: bool = False,
    near_plane: str = "occlude",
    origins: NDArray | None = None,
) -> Any:
    """Return `reference.Images` of rays of depth 1 in the camera frame, shape (H, W, 3).

    NaN rays hit nothing. Rays start at `origins` in the camera frame, of the same shape, or at the camera.
    """
    import reference

    if origins is not None:
        options = {"near": near, "far": far, "cull_backfaces": cull_backfaces, "near_plane": near_plane}
        matrix = poses_to_matrices(np.asarray(pose, dtype=np.float32))
        return in_groups(
            rays, origins, lambda some, at: cast_ray_table(scene, some, moved(pose, matrix[:3, :3] @ at), **options)
        )

    known = np.isfinite(rays).all(axis=-1)
    aside = np.array([0.0, 0.0, 1.0])
    range_only = Camera(1, 1, 1.0, 1.0, 0.5, 0.5, near, far)
    seen = reference._cast(scene, range_only, pose, np.where(known[..., None], rays, aside), cull_backfaces, near_plane)
    seen.depth[~known], seen.points[~known], seen.normals[~known] = np.inf, np.nan, np.nan
    seen.labels[~known], seen.objects[~known] = 0, -1
    return seen


def in_groups(rays: NDArray, keys: NDArray, cast: Callable[[NDArray, NDArray], Any]) -> Any:
    """Cast rays, shape (..., 3), in groups of equal keys, shape (..., k): `cast` takes rays and key."""
    import reference

    shape, rays = rays.shape[:-1], rays.reshape(-1, 3)
    different, group = np.unique(keys.reshape(len(rays), -1), axis=0, return_inverse=True)
    parts: list[Any] = [cast(rays[group.ravel() == index], key) for index, key in enumerate(different)]
    order = np.argsort(np.concatenate([np.flatnonzero(group.ravel() == index) for index in range(len(different))]))
    joined = [np.concatenate([getattr(part, f.name) for part in parts])[order] for f in fields(reference.Images)]
    return reference.Images(*(image.reshape(*shape, *image.shape[1:]) for image in joined))


def moved(pose: NDArray, by: NDArray) -> NDArray:
    """Return a pose row with its position translated."""
    return np.concatenate([np.asarray(pose)[:3] + by, np.asarray(pose)[3:]])
