# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of ``kernels/visibility/silhouettes.py``: BOP's definition of visibility, implemented literally."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis import Camera, Scene, SceneObject, Visibility
from warpvis.cameras import LensCamera


@dataclass
class Alone:
    """A scene with a single object."""

    objects: tuple[SceneObject, ...]

    def __len__(self) -> int:
        return 1


def measure_silhouettes(
    scene: Scene, camera: Camera, pose: NDArray, index: int, *, canvas: tuple[int, int, int, int], delta: float
) -> dict[str, NDArray]:
    """Return masks of an object: silhouette on the canvas; silhouette, visible, too near and too far in the image.

    Follows bop_toolkit_lib/visibility.py: the object is rendered alone on a larger canvas, depth is converted to
    distance,
    and a pixel is visible where ``d_model - d_test <= delta``. With a `delta` of 0, visibility is that of the image.
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
    test = reference.cast_rays(scene, everything, pose)
    length = np.linalg.norm(reference.pixel_rays(camera), axis=-1)
    return _compared(model, model[image], test, camera, length, index, delta)


def measure_silhouettes_rays(
    scene: Scene, camera: LensCamera, pose: NDArray, index: int, *, canvas: tuple[int, int, int, int], delta: float
) -> dict[str, NDArray]:
    """As `measure_silhouettes` for a lens: the canvas is a larger image of the same lens."""
    import reference

    left, top, _, _ = canvas
    rays = _canvas_rays(camera, canvas)
    model = reference.cast_ray_table(Alone((scene.objects[index],)), rays, pose).depth
    image = (slice(top, top + camera.height), slice(left, left + camera.width))
    test = reference.cast_ray_table(scene, rays[image], pose)
    return _compared(model, model[image], test, camera, np.linalg.norm(rays[image], axis=-1), index, delta)


@lru_cache(maxsize=4)
def _canvas_rays(camera: LensCamera, canvas: tuple[int, int, int, int]) -> NDArray[np.float64]:
    left, top, right, bottom = canvas
    lens = replace(camera.lens, cx=camera.lens.cx + left, cy=camera.lens.cy + top)
    x, y = np.arange(camera.width + left + right) + 0.5, np.arange(camera.height + top + bottom) + 0.5
    rays = lens.unproject(np.stack(np.meshgrid(x, y), axis=-1))
    return np.where(rays[..., 2:] > 0, rays / rays[..., 2:], np.nan) if camera.kind == "z" else rays


def _compared(
    model: NDArray, inside: NDArray, test: Any, camera: Any, length: NDArray, index: int, delta: float
) -> dict[str, NDArray]:
    """Return masks of an object from its depth on the canvas (`model`), in the image (`inside`), and the scene."""
    silhouette = np.isfinite(inside)
    with np.errstate(invalid="ignore"):
        behind = (inside - test.depth) * length
        near, far = silhouette & (inside < camera.near), silhouette & (inside > camera.far)
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
    """Return counts, fraction, status, occluder and boxes of an object's masks."""
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
    """Return every object's pose in every world, shape (W, objects, 7)."""
    return np.where(columns[:, None] >= 0, object_poses[:, columns], at_rest)


def spread_sizes(
    object_sizes: NDArray, original: NDArray, isolated: NDArray, columns: NDArray, is_attached: NDArray
) -> NDArray:
    """Return every object's size in every world, shape (W, objects, 4)."""
    of_parents = isolated * object_sizes[:, columns] / original[columns]
    of_parents[..., 3] = isolated[:, 3]
    moved = np.where(is_attached[:, None] > 0, of_parents, object_sizes[:, columns])
    return np.where(columns[:, None] >= 0, moved, isolated)
