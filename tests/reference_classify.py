# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of the kernels that back-project and label depth images."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from reference_voxels import shown_depth

from warpvis import Camera, Label
from warpvis.cameras import LensCamera, Rays
from warpvis.core.poses import poses_to_matrices
from warpvis.maps import Sphere


def pixel_rays(camera: Camera) -> NDArray[np.float64]:
    """Return camera-frame rays of all pixels, shape (H, W, 3): z = 1 for a pinhole, depth 1 or NaN for a lens."""
    if isinstance(camera, LensCamera):
        rays = camera.lens.unproject(np.stack(np.mgrid[: camera.height, : camera.width][::-1], axis=-1) + 0.5)
        return rays / rays[..., 2:] if camera.kind == "z" else rays
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    return np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)


def back_project(camera: Camera, pose: NDArray, depth: NDArray) -> NDArray[np.float64]:
    return _points(camera, pose, shown_depth(camera, depth))


def back_project_rays(camera: LensCamera, pose: NDArray, depth: NDArray) -> NDArray[np.float64]:
    return back_project(camera, pose, depth)


def back_project_bundle(rays: Rays, pose: NDArray, depth: NDArray) -> NDArray[np.float64]:
    """Return world points of rays with origins, (H, W, 3); NaN outside the range of the rays."""
    matrix = poses_to_matrices(np.asarray(pose, dtype=np.float32))
    inside = (depth > 0) & (depth >= rays.near) & (depth <= rays.far) & np.isfinite(depth)
    local = rays.origins + rays.rays * np.where(inside, depth, np.nan).astype(np.float64)[..., None]
    return local @ matrix[:3, :3].T + matrix[:3, 3]


def _points(camera: Camera, pose: NDArray, depth: NDArray) -> NDArray[np.float64]:
    """Return points of finite depths, ignoring the camera's range."""
    matrix = poses_to_matrices(np.asarray(pose, dtype=np.float32))
    with np.errstate(invalid="ignore"):
        local = pixel_rays(camera) * np.asarray(depth, dtype=np.float64)[..., None]
        points = local @ matrix[:3, :3].T + matrix[:3, 3]
    return np.where(np.isfinite(depth)[..., None], points, np.nan)


def fill_depth(depth: NDArray, empty: float, too_near: float) -> NDArray:
    return np.where(np.isneginf(depth), too_near, np.where(np.isfinite(depth), depth, empty))


def _has_depth(depth: NDArray, max_range: float, near: float = 0.0) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        return np.isfinite(depth) & (depth > 0) & (depth >= np.float32(near)) & (depth <= max_range)


def classify_depth(
    camera: Camera,
    pose: NDArray,
    depth: NDArray,
    spheres: tuple[Sphere, ...] = (),
    *,
    sigma: float = 0.01,
    ground_height: float = 0.0,
    up: int = 2,
    plane: tuple[float, float, float, float] | None = None,
    noise: tuple[float, float, float] = (0.0, 0.0, 0.0),
    below_label: int = Label.GROUND,
    max_range: float | None = None,
) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.float64]]:
    """Return labels, spheres, and the margin of each pixel to another label [m].

    `noise` has the coefficients of the tolerance's growth, with the factor.
    """
    valid = _has_depth(depth, camera.far if max_range is None else max_range, camera.near)
    points = _points(camera, pose, np.where(valid, depth, np.nan))
    normal = np.eye(3)[up] if plane is None else np.array(plane[:3]) / np.linalg.norm(plane[:3])
    offset = -ground_height if plane is None else plane[3] / np.linalg.norm(plane[:3])
    height = points @ normal + offset
    slope = pixel_rays(camera) @ poses_to_matrices(np.asarray(pose, dtype=np.float32))[:3, :3].T @ normal
    with np.errstate(invalid="ignore"):
        tolerance = sigma + np.abs(slope) * np.polynomial.Polynomial(noise)(np.asarray(depth, dtype=np.float64))
    margin = np.minimum(np.abs(height - tolerance), np.abs(height + tolerance))
    ratio = np.full((len(spheres) + 1, *depth.shape), np.inf)
    ratio[-1] = 1.0  # outside all spheres
    for i, sphere in enumerate(spheres):
        distance = np.linalg.norm(points - np.array(sphere.center), axis=-1)
        ratio[i] = distance / (sphere.diameter / 2)
        margin = np.minimum(margin, np.abs(distance - sphere.diameter / 2))
    sphere = np.argmin(np.where(np.isnan(ratio), np.inf, ratio), axis=0)
    sphere = np.where(sphere == len(spheres), -1, sphere)
    with np.errstate(invalid="ignore"):
        ground, below = height < tolerance, height < -tolerance
    sphere = np.where(valid & ~ground, sphere, -1)
    label_of = np.array([*(item.label for item in spheres), Label.OBSTACLE])
    labels = np.where(below, below_label, np.where(ground, Label.GROUND, label_of[sphere]))
    return np.where(valid, labels, Label.EMPTY).astype(np.uint8), sphere, np.where(valid, margin, np.inf)


def classify_rays(camera: LensCamera, pose: NDArray, depth: NDArray, *spheres, **options):
    """As `classify_depth`; pixels without a ray have no point."""
    return classify_depth(camera, pose, np.where(camera.mask, np.nan, depth), *spheres, **options)


def label_objects(object_label: NDArray, depth: NDArray, objects: NDArray, max_range: float) -> NDArray[np.uint8]:
    known = (objects >= 0) & (objects < len(object_label)) & _has_depth(depth, max_range)
    return np.where(known, object_label[np.where(known, objects, 0)], Label.EMPTY).astype(np.uint8)


back_project_rows, classify_rows = back_project, classify_depth
label_objects_rows = label_objects
