# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of the kernels that measure the visibility of bodies."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warpvis import Camera, Visibility


def exclude_others(members: NDArray, hidden: NDArray | None, views: int) -> NDArray[np.uint8]:
    """Return which objects are not shown if a body is alone, ``(views, objects)``."""
    others = np.tile(members == 0, (views, 1))
    return (others if hidden is None else others | (hidden != 0)).astype(np.uint8)


def distance_to_free(depth: NDArray, isolated: NDArray) -> float:
    """Return the smallest distance [px] from a pixel of a body to one that shows nothing nearer, in one image."""
    best = math.inf
    for y, x in np.argwhere(np.isfinite(isolated)):
        free = np.argwhere(depth >= isolated[y, x])
        if len(free):
            best = min(best, float(np.hypot(*(free - [y, x]).T).min()))
    return best


def angle_to_image(camera: Camera, direction: NDArray, samples: int = 4001) -> float:
    """Return the smallest angle from a camera-frame direction to points of the image's border [rad]; 0 inside."""
    direction = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    if direction[2] > 0:
        x, y = camera.fx * direction[0] / direction[2] + camera.cx, camera.fy * direction[1] / direction[2] + camera.cy
        if 0 <= x <= camera.width and 0 <= y <= camera.height:
            return 0.0
    across, down = np.linspace(0, camera.width, samples), np.linspace(0, camera.height, samples)
    border = [
        (across, 0 * across),
        (across, 0 * across + camera.height),
        (0 * down, down),
        (0 * down + camera.width, down),
    ]
    x, y = np.concatenate(border, axis=1)
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=1)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return float(np.arccos(np.clip(rays @ direction, -1, 1)).min())


def shape_values(
    camera: Camera, fraction: float, reason: int, silhouette_box: NDArray, distance: float, angle: float
) -> float:
    """Return a body's shaped value."""
    diagonal = math.hypot(camera.width, camera.height)
    if fraction == 1:
        x, y, width, height = silhouette_box
        return 1 + min(x, y, camera.width - x - width, camera.height - y - height) / diagonal
    if fraction > 0:
        return fraction
    if reason == Visibility.OCCLUDED:
        return -0.5 * min(distance / diagonal, 1)
    return -0.5 - 0.5 * angle / math.pi


def body_centers(centers: NDArray, members: NDArray) -> NDArray[np.float64]:
    """Return the means of the centers of bodies' objects in the world, ``(bodies, 3)``."""
    return np.array([centers[mine != 0].mean(axis=0) for mine in members])
