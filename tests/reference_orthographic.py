# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of the kernels of `warpvis.kernels.casting.orthographic`: each pixel casts its ray from its own camera."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from reference_coinciding import show_later_along

from warpvis import Camera, Scene
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.core.poses import poses_to_matrices

AHEAD = np.array([[[0.0, 0.0, 1.0]]])


def eyes(camera: OrthographicCamera, pose: NDArray, pixels: NDArray) -> NDArray[np.float64]:
    """Return the world origins of rays through image points (..., 2), shape (..., 3)."""
    aside = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    matrix = poses_to_matrices(pose)
    return aside @ matrix[:3, :2].T + matrix[:3, 3]


def centers(camera: OrthographicCamera) -> NDArray[np.float64]:
    """Return the pixel centers, shape (H, W, 2)."""
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    return np.stack([x, y], axis=-1)


def cast_parallel_rays(
    scene: Scene,
    camera: OrthographicCamera,
    pose: NDArray,
    *,
    pixels: NDArray | None = None,
    cull_backfaces: bool = False,
    near_plane: str = "occlude",
) -> Any:
    """Return `reference.Images` of all pixels, or of image points, shape (H, W, 2)."""
    import reference

    pixels = centers(camera) if pixels is None else pixels
    range_only = Camera(1, 1, 1.0, 1.0, 0.5, 0.5, camera.near, camera.far)
    rows = np.repeat(np.asarray(pose, dtype=np.float64)[None], pixels[..., 0].size, axis=0)
    rows[:, :3] = eyes(camera, pose, pixels).reshape(-1, 3)
    seen = [reference._cast(scene, range_only, row, AHEAD, cull_backfaces, near_plane) for row in rows]
    shape = pixels.shape[:-1]
    images = {field.name: np.stack([getattr(one, field.name)[0, 0] for one in seen]) for field in fields(seen[0])}
    return reference.Images(**{name: image.reshape(*shape, *image.shape[1:]) for name, image in images.items()})


def show_later_from_plane(
    scene: Scene,
    camera: OrthographicCamera,
    pose: NDArray,
    segmentation: NDArray,
    depth: NDArray,
    **options: Any,
) -> NDArray:
    """As `reference_coinciding.show_later`, along parallel rays."""
    origins = eyes(camera, pose, centers(camera))
    rays = np.broadcast_to(poses_to_matrices(pose)[:3, 2], origins.shape)
    return show_later_along(scene, origins, rays, segmentation, depth, **options)
