# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Twin of the kernel of `warpvis.kernels.ray_table`; see `reference`, whose brute force takes rays of any direction."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis import Camera, Scene


def cast_ray_table(
    scene: Scene,
    rays: NDArray,
    pose: NDArray,
    *,
    near: float = 0.0,
    far: float = np.inf,
    cull_backfaces: bool = False,
    near_plane: str = "occlude",
) -> Any:
    """What is seen along rays of the camera frame, shape (H, W, 3), of depth 1: `reference.Images`.

    Where a ray is NaN nothing is.
    """
    import reference

    known = np.isfinite(rays).all(axis=-1)
    aside = np.array([0.0, 0.0, 1.0])
    range_only = Camera(1, 1, 1.0, 1.0, 0.5, 0.5, near, far)
    seen = reference._cast(scene, range_only, pose, np.where(known[..., None], rays, aside), cull_backfaces, near_plane)
    seen.depth[~known], seen.points[~known], seen.normals[~known] = np.inf, np.nan, np.nan
    seen.labels[~known], seen.objects[~known] = 0, -1
    return seen
