# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Twins of ``kernels/silhouettes.py``: BOP's definition of what is visible, word for word, in float64 NumPy."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from warpvis import Camera, Scene, SceneObject, Visibility


@dataclass
class Alone:
    """A world of one object."""

    objects: tuple[SceneObject, ...]

    def __len__(self) -> int:
        return 1


def measure_silhouettes(
    scene: Scene, camera: Camera, pose: NDArray, index: int, *, canvas: tuple[int, int, int, int], delta: float
) -> dict[str, NDArray]:
    """Masks of an object: its silhouette on the canvas, and in the image: silhouette, visible, too near, too far.

    As bop_toolkit_lib/visibility.py has it: the object is rendered alone on a larger canvas, depth becomes distance,
    and a pixel is visible where ``d_model - d_test <= delta``. With a `delta` of 0, visible is what the image shows.
    """
    import reference

    left, top, right, bottom = canvas
    everything = replace(camera, near=0.0, far=math.inf)
    wide = replace(
        everything,
        width=camera.width + left + right,
        height=camera.height + top + bottom,
        cx=camera.cx + left,
        cy=camera.cy + top,
    )
    model = reference.cast_rays(Alone((scene.objects[index],)), wide, pose).depth
    image = (slice(top, top + camera.height), slice(left, left + camera.width))
    silhouette = np.isfinite(model)[image]
    test = reference.cast_rays(scene, everything, pose)
    length = np.linalg.norm(reference.pixel_rays(camera), axis=-1)
    with np.errstate(invalid="ignore"):
        behind = (model[image] - test.depth) * length
        near, far = silhouette & (model[image] < camera.near), silhouette & (model[image] > camera.far)
    visible = behind <= delta if delta > 0 else test.objects == index
    return {
        "canvas": np.isfinite(model),
        "silhouette": silhouette,
        "visible": silhouette & visible & ~near & ~far,
        "near": near,
        "far": far,
        "shown": test.objects,
    }


measure_silhouettes_packets = measure_silhouettes


def judge_silhouettes(
    masks: dict[str, NDArray], canvas: tuple[int, int, int, int], min_pixels: int
) -> dict[str, object]:
    """What an object's masks say: counts, fraction, status, what hides it, and boxes."""
    count = {name: int(mask.sum()) for name, mask in masks.items() if name != "shown"}
    hidden = masks["silhouette"] & ~masks["visible"] & ~masks["near"] & ~masks["far"]
    by = np.bincount(masks["shown"][hidden & (masks["shown"] >= 0)], minlength=1)
    reasons = {
        Visibility.OCCLUDED: int(hidden.sum()),
        Visibility.TOO_NEAR: count["near"],
        Visibility.TOO_FAR: count["far"],
    }
    if count["visible"] >= min_pixels:
        status = Visibility.VISIBLE
    elif max(reasons.values()) > 0:
        status = max(reasons, key=lambda reason: reasons[reason])
    else:
        whole = count["canvas"] == count["silhouette"] > 0
        status = Visibility.TOO_FAR if whole else Visibility.OUT_OF_VIEW
    return {
        "visible_pixels": count["visible"],
        "image_pixels": count["silhouette"],
        "silhouette_pixels": count["canvas"],
        "too_near_pixels": count["near"],
        "too_far_pixels": count["far"],
        "fraction": count["visible"] / count["canvas"] if count["canvas"] else 0.0,
        "status": status,
        "occluder": int(by.argmax()) if by.max() > 0 else -1,
        "visible_box": _box(masks["visible"], 0, 0),
        "silhouette_box": _box(masks["canvas"], canvas[0], canvas[1]),
    }


def _box(mask: NDArray, left: int, top: int) -> list[int]:
    y, x = np.nonzero(mask)
    if len(x) == 0:
        return [-1] * 4
    return [int(x.min()) - left, int(y.min()) - top, int(np.ptp(x)) + 1, int(np.ptp(y)) + 1]


def spread_poses(object_poses: NDArray, columns: NDArray, at_rest: NDArray) -> NDArray:
    """Every object's pose in every world, shape (W, objects, 7)."""
    return np.where(columns[:, None] >= 0, object_poses[:, columns], at_rest)
