# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visibility of points through a lens, projected on the host in double precision and tested along their rays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.lens_camera import LensCamera
from warpvis.core.labels import Visibility
from warpvis.core.poses import poses_to_matrices
from warpvis.core.threads import check_threads
from warpvis.rendering import CasterName, Output, choose_caster, render_along
from warpvis.scene import Scene
from warpvis.scene.worlds import part_of

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds

# Maximum number of points per batch: projected points take 200 bytes each.
_MAX_BATCH = 1 << 20

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ProjectedPoints:
    """Projections of N points into V views."""

    pixels: Floats
    """Image positions [px], ``(V, N, 2)``; NaN where a point is not in the image."""
    depth: Floats
    """Depth of the camera's kind [m], ``(V, N)``."""
    rays: Floats
    """Rays of depth 1 from the camera to the points, ``(V, N, 3)``; NaN where a point is not in the image."""

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether points are in the image, ``(V, N)``."""
        return np.isfinite(self.pixels[..., 0])

    def judge(self, camera: LensCamera, surface: NDArray[np.floating], tolerance: float) -> NDArray[np.uint8]:
        """Return the `Visibility` of points given surface depths, as `warpvis.kernels.visibility.points.judge` does."""
        with np.errstate(invalid="ignore"):
            behind = (self.depth - surface) * np.linalg.norm(self.rays, axis=-1) > tolerance
        status = np.where(behind, Visibility.OCCLUDED, Visibility.VISIBLE)
        status = np.where(self.depth > camera.far, Visibility.TOO_FAR, status)
        status = np.where(self.depth < camera.near, Visibility.TOO_NEAR, status)
        return np.where(self.inside, status, Visibility.OUT_OF_VIEW).astype(np.uint8)


def project_points(camera: LensCamera, poses: NDArray[np.float32], points: Floats) -> ProjectedPoints:
    """Project points in the world.

    Args:
        camera: The camera.
        poses: Rows ``(V, 7)`` from `warpvis.core.poses.host_poses`.
        points: Points [m], shape ``(N, 3)``.
    """
    matrices = poses_to_matrices(poses.astype(np.float64))
    local_points = np.einsum("vij,vni->vnj", matrices[:, :3, :3], points - matrices[:, None, :3, 3])
    depth = local_points[..., 2] if camera.kind == "z" else np.linalg.norm(local_points, axis=-1)
    pixels = camera.project(local_points)
    inside = ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=-1) & (depth > 0)
    with np.errstate(all="ignore"):
        rays = np.where(inside[..., None], local_points / depth[..., None], np.nan)
    return ProjectedPoints(np.where(inside[..., None], pixels, np.nan), depth, rays)


def judge_in_scene(
    scene: Scene,
    camera: LensCamera,
    poses: NDArray[np.float32],
    worlds: Worlds,
    points: NDArray[np.float32],
    tolerance: float,
    *,
    occluders: bool,
    caster: CasterName,
    threads: int | None,
) -> tuple[NDArray[np.uint8], NDArray[np.int32] | None]:
    """Compute the visibility of points in a scene, and their occluders; see `warpvis.point_visibility`."""
    # With near = 0, surfaces that are too near have a finite depth and an object.
    outputs: list[Output] = ["depth", "segmentation"] if occluders else ["depth"]
    eye = replace(camera, near=0.0)
    choose_caster(caster, eye)
    threads = check_threads(threads)
    shape = (len(poses), len(points))
    status = np.empty(shape, dtype=np.uint8)
    hidden_by = np.full(shape, -1, dtype=np.int32) if occluders else None
    for views, batch in _batches(*shape):
        projected = project_points(camera, poses[views], points[batch].astype(np.float64))
        rows = wp.array(np.ascontiguousarray(poses[views]), dtype=wp.transform, device=scene.device)
        rays = wp.array(projected.rays, dtype=wp.vec3d, device=scene.device)
        seen = render_along(scene, eye, rows, part_of(worlds, views), rays, outputs=outputs, threads=threads)
        judged = projected.judge(camera, seen.depth.numpy(), tolerance)
        status[views, batch] = judged
        if hidden_by is not None:
            hidden_by[views, batch] = np.where(judged == Visibility.OCCLUDED, seen.segmentation.numpy(), -1)
    return status, hidden_by


def judge_in_images(
    depth: NDArray[np.float32],
    camera: LensCamera,
    poses: NDArray[np.float32],
    points: NDArray[np.float32],
    tolerance: float,
) -> NDArray[np.uint8]:
    """Compute the visibility of points in depth images; see `warpvis.point_visibility_from_depth`."""
    status = np.empty((len(poses), len(points)), dtype=np.uint8)
    for views, batch in _batches(*status.shape):
        projected = project_points(camera, poses[views], points[batch].astype(np.float64))
        columns, rows = np.moveaxis(np.where(projected.inside[..., None], projected.pixels, 0).astype(np.int64), -1, 0)
        surface = depth_in_range(camera, depth[np.arange(len(depth))[views, None], rows, columns])
        judged = projected.judge(camera, surface, tolerance)
        in_range = (judged == Visibility.VISIBLE) | (judged == Visibility.OCCLUDED)
        status[views, batch] = np.where(in_range & np.isnan(surface), Visibility.UNKNOWN, judged)
    return status


def depth_in_range(camera: LensCamera, depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return depth as in REP 117: -inf nearer than near, +inf beyond far, and NaN where nothing was measured."""
    near, far, infinity = np.float32(camera.near), np.float32(camera.far), np.float32(np.inf)
    with np.errstate(invalid="ignore"):
        clamped = np.where(depth < near, -infinity, np.where(depth > far, infinity, depth))
        return np.where((depth > 0) | (depth == -infinity), clamped, np.float32(np.nan))


def _batches(views: int, points: int) -> Iterator[tuple[slice, slice]]:
    """Yield slices of views and points, at most `_AT_ONCE` pairs each."""
    max_points = max(1, min(points, _MAX_BATCH))
    step = max(1, _MAX_BATCH // max_points)
    for first in range(0, views, step):
        for start in range(0, points, max_points):
            yield slice(first, min(first + step, views)), slice(start, min(start + max_points, points))
