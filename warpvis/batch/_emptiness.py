# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Empty frames, which see nothing: their number and the likely reason.

They are counted in the process that renders them, from the images before a format rounds them, and the count is stored
in the record of their shard. So the total covers the whole dataset, including shards of earlier calls and of other
processes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import pluralize
from warpvis.core.labels import Label
from warpvis.scene import too_large_for
from warpvis.sensors import Reason

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.scene import Scene

# A sparse grid of pixels is tested first; all pixels are tested only in images whose grid sees nothing.
_STEP = 32

_SHOWS: dict[str, Callable[[np.ndarray], NDArray[np.bool_]]] = {
    "depth": np.isfinite,
    "reasons": lambda reasons: reasons == Reason.VALID,
    "segmentation": lambda objects: objects >= 0,
    "labels": lambda labels: labels != 0,
    "points": lambda points: np.isfinite(points[..., 0]),
    "normals": lambda normals: np.isfinite(normals).all(axis=-1) & normals.any(axis=-1),
    "true_depth": np.isfinite,
}
"""Functions that return the pixels that see something, by image name; the first available image decides."""

_POSES_AT_ONCE = 1 << 20


def count_empty(images: Mapping[str, np.ndarray], object_labels: Collection[int] = ()) -> int:
    """Count frames that see nothing within the camera's range.

    If visibility is the only output, count frames that see none of the chosen objects. If one of the scene's
    `object_labels` is EMPTY, the image of labels is not used.
    """
    for name, shows in _SHOWS.items():
        if name in images and not (name == "labels" and Label.EMPTY in object_labels):
            image = images[name]
            samples = shows(image[:, _STEP // 2 :: _STEP, _STEP // 2 :: _STEP])
            candidates = np.flatnonzero(~samples.reshape(len(image), -1).any(axis=1))
            return sum(not shows(image[frame]).any() for frame in candidates)
    return int((~images["visible_pixels"].any(axis=1)).sum()) if "visible_pixels" in images else 0


def describe_empty(empty: int, frames: int, plan: Plan, scene: Scene) -> str:
    """Return a message with the number of empty frames; an empty string if no frame is empty.

    If all frames are empty, the message compares the sizes of the scene and of the camera's range.
    """
    if not empty:
        return ""
    only_chosen = all(name not in plan.outputs for name in _SHOWS) and 0 < len(plan.chosen) < len(plan.object_names)
    target = "nothing of the chosen objects" if only_chosen else "nothing"
    message = f"{empty} of {pluralize(frames, 'frame')} {'sees' if empty == 1 else 'see'} {target}"
    return message if empty < frames else f"{message}: {_reason(plan, scene)}"


def _reason(plan: Plan, scene: Scene) -> str:
    boxes = [item.bounds for index, item in enumerate(scene.objects) if index not in plan.exclude]
    if not boxes:
        return "every object is excluded"
    low, high = np.min(boxes, axis=0)[0].astype(np.float64), np.max(boxes, axis=0)[1].astype(np.float64)
    size, near, far = high - low, plan.camera.near, plan.camera.far
    extent = " x ".join(map(_format_length, size))
    limits = f"near is {_format_length(near)} m" + ("" if math.isinf(far) else f", far is {_format_length(far)} m")
    distance = _nearest(plan.frames.camera_to_world, low, high)
    if too_large_for(size, far):
        hint = "are its units millimeters (a scale of 0.001)?"
    elif distance > far:
        hint = f"the nearest camera is {_format_length(distance)} m away from it"
    elif np.linalg.norm(size) < near:
        hint = "it is smaller than that: are its units not meters?"
    else:
        hint = "do the cameras point away from it because convention does not match their axes?"
    return f"the scene spans {extent} m, {limits}; {hint}"


def _nearest(poses: NDArray[np.floating], low: NDArray[np.float64], high: NDArray[np.float64]) -> float:
    """Return the distance from a box to the nearest camera [m]."""
    nearest = math.inf
    for first in range(0, len(poses), _POSES_AT_ONCE):
        eyes = poses[first : first + _POSES_AT_ONCE, :3]
        offsets = np.maximum(np.maximum(low - eyes, eyes - high), 0.0)
        nearest = min(nearest, float(np.linalg.norm(offsets, axis=1).min()))
    return nearest


def _format_length(length: float) -> str:
    return f"{length:.0f}" if length >= 100 else f"{length:.3g}"
