# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth of empty pixels, as in `mujoco.Renderer` or as `fill` specifies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.rendering import Fill


def filled_depth(image: NDArray[np.float32] | None, camera: PlanarCamera, fill: Fill) -> NDArray[np.float32]:
    """Return a depth image whose empty pixels are filled.

    Args:
        image: Depth [m], shape ``(H, W)``: +inf where nothing is hit, -inf where a surface is too near, NaN where a
            sensor lost it. None means that all pixels are empty.
        camera: The camera.
        fill: As for `warpvis.mujoco.Renderer`.
    """
    if image is None:
        image = np.full((camera.height, camera.width), np.inf, dtype=np.float32)
    if fill == "inf":
        return image
    if not isinstance(fill, str):
        return np.where(np.isfinite(image), image, np.float32(fill))
    image = np.fmin(image, _background(camera))  # also replaces NaN
    return np.fmax(image, np.float32(camera.near), out=image, where=image == -np.inf)


def _background(camera: PlanarCamera) -> np.float32:
    """Compute the depth of `mujoco.Renderer` for empty pixels: its far plane, with the same rounding errors.

    Follows `render` in mujoco/rendering/classic/renderer.py for a depth-buffer value of 0.
    """
    z_near, z_far = np.float32(camera.near), np.float32(camera.far)
    if isinstance(camera, OrthographicCamera):
        return z_far
    c = np.float32(-0.5) * (-(z_far + z_near) / (z_far - z_near)) - np.float32(0.5)
    d = np.float32(-0.5) * (-(np.float32(2) * z_far * z_near) / (z_far - z_near))
    return np.float32(np.float64(d) / np.float64(c))
