# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Warnings with the likely reason why cameras see nothing, for results in host memory only: GPUs are not waited for."""

from __future__ import annotations

import math

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.user_warnings import warn_user
from warpvis.rendering._views import Views
from warpvis.scene import Scene, too_large_for
from warpvis.scene.closed import contains_points

# Approximate number of pixels per image that are checked first.
_PIXELS = 256

# Maximum smallest extent of an object that may enclose a camera, in multiples of the camera's `near`.
_MAX_NEARS = 4.0

# Minimum distance of cameras with positions in millimeters, in multiples of the scene's size.
_FAR_AWAY = 10.0

# Maximum number of cameras without a valid depth that are tested for being inside objects.
_MAX_EYES = 8


def find_blind(views: Views) -> tuple[bool, NDArray[np.intp]]:
    """Return whether no pixel of any view has a depth, and the views where most pixels are too near (-inf)."""
    no_views = np.empty(0, dtype=np.intp)
    if views.depth is None or not views.depth.device.is_cpu or not views.depth.size:
        return False, no_views
    depth = views.depth.numpy().reshape(len(views.depth), -1)
    sample = depth[:, :: max(1, depth.shape[1] // _PIXELS)]
    too_near = np.flatnonzero(np.isneginf(sample).mean(axis=1) > 0.5)
    return not np.isfinite(sample).any() and not np.isfinite(depth).any(), too_near


def warn_of_units(scene: Scene, far: float, seen: NDArray[np.bool_], poses: NDArray[np.float32]) -> None:
    """Warn if an invisible scene, or positions of cameras, appear to be in millimeters.

    Args:
        scene: The scene.
        far: The camera's maximum depth [m].
        seen: Mask of the objects that are not excluded, shape ``(objects,)``.
        poses: The cameras' poses, shape ``(V, 7)``.
    """
    if not seen.any() or not len(poses):
        return
    boxes = np.array([item.bounds for item, included in zip(scene.objects, seen, strict=True) if included])
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    size = high - low
    reach = float(size.max())
    distances, scaled = (
        np.linalg.norm(np.maximum(np.maximum(low - eyes, eyes - high), 0), axis=1)
        for eyes in (poses[:, :3], poses[:, :3] / 1000)
    )
    if distances.min() > max(_FAR_AWAY * reach, min(far, 1e6)) and scaled.max() <= reach:
        warn_user(
            f"no surface is visible in any view: the cameras are {distances.min():.4g} m or more away from the scene. "
            "If their positions are in millimeters, divide them by 1000",
            UserWarning,
        )
    elif math.isfinite(far) and too_large_for(size, far):
        spans = " x ".join(f"{side:.4g}" for side in size)
        warn_user(
            f"no surface is visible in any view: the scene spans {spans} m, and the camera's far is {far:.4g} m. If "
            "the scene is in millimeters, load it with scale=0.001",
            UserWarning,
        )


def warn_of_eyes_inside(
    scene: Scene, near: float, poses: NDArray[np.float32], views: NDArray[np.intp], seen: NDArray[np.bool_]
) -> None:
    """Warn if cameras are inside small closed objects, with an extent of at most a few times `near`.

    Large closed objects are ignored: a camera inside the closed mesh of a room is valid.

    Args:
        scene: The scene.
        near: The cameras' minimum depth [m].
        poses: The cameras' poses, shape ``(V, 7)``.
        views: Indices of the views that see too little.
        seen: Mask of the objects that are at their initial poses and not excluded, shape ``(objects,)``.
    """
    eyes = poses[views[:_MAX_EYES], :3]
    if not len(eyes):
        return
    enclosing = []
    for item, included in zip(scene.objects, seen, strict=True):
        is_small = included and np.ptp(item.bounds, axis=0).min() <= _MAX_NEARS * near
        if is_small and contains_points(item.vertices, item.faces, eyes).any():
            enclosing.append(item.name)
    if enclosing:
        names = ", ".join(map(repr, enclosing[:3]))
        warn_user(
            f"{len(views)} of {len(poses)} views see almost nothing: the camera is inside {names}. Move the camera, or "
            "exclude the object that carries it",
            UserWarning,
        )


def seen_objects(scene: Scene, excluded: wp.array | None) -> NDArray[np.bool_]:
    """Return a mask of the objects that are not excluded from any view, shape ``(objects,)``."""
    if excluded is None or not excluded.size:
        return np.ones(len(scene), dtype=bool)
    return ~excluded.numpy().astype(bool).any(axis=0)
