# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reference of ``kernels/mujoco/coinciding.py``: every pixel against every triangle and solid of later objects."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from warpvis import Camera, Scene
from warpvis.core.poses import poses_to_matrices
from warpvis.scene import SceneObject

CLOSENESS = 4e-6


def show_later(
    scene: Scene,
    camera: Camera,
    pose: NDArray,
    segmentation: NDArray,
    depth: NDArray,
    *,
    object_poses: NDArray,
    excluded: Collection[int] = (),
    cull_backfaces: bool = True,
) -> NDArray:
    """Return the object shown in every pixel: the last one whose surface contains the hit point.

    Args:
        scene: The scene.
        camera: The camera.
        pose: Camera to world, row of 7.
        segmentation: Result of a caster, shape (H, W).
        depth: Result of a caster, shape (H, W).
        object_poses: Poses of the movable objects, rows of 7.
        excluded: Objects excluded from the view.
        cull_backfaces: Whether back faces are ignored.
    """
    import reference

    rays = reference.pixel_rays(camera) @ poses_to_matrices(pose)[:3, :3].T
    origins = np.broadcast_to(np.asarray(pose, dtype=np.float64)[:3], rays.shape)
    return show_later_along(
        scene,
        origins,
        rays,
        segmentation,
        depth,
        object_poses=object_poses,
        excluded=excluded,
        cull_backfaces=cull_backfaces,
    )


def show_later_along(
    scene: Scene,
    origins: NDArray,
    rays: NDArray,
    segmentation: NDArray,
    depth: NDArray,
    *,
    object_poses: NDArray,
    excluded: Collection[int] = (),
    cull_backfaces: bool = True,
) -> NDArray:
    """As `show_later` for any world rays, shape (H, W, 3); the hit point is depth times the ray."""
    path = rays * np.where(segmentation >= 0, depth, 0.0)[..., None]
    points = path + origins
    reach = CLOSENESS * (np.linalg.norm(path, axis=-1) + np.linalg.norm(points, axis=-1))
    shown = segmentation.copy()
    for later, item in enumerate(scene.objects):
        place = _place(scene, later, object_poses)
        mask = (segmentation >= 0) & (segmentation < later)
        if later in excluded or not mask.any():
            continue
        local = (points[mask] - place[:3, 3]) @ place[:3, :3]
        on = _on_solid if item.solid is not None else _on_mesh
        found = on(item, local, rays[mask] @ place[:3, :3], reach[mask], cull_backfaces)
        mask[mask] = found
        shown[mask] = later
    return shown


def _place(scene: Scene, index: int, object_poses: NDArray) -> NDArray:
    parent = scene.objects[index].parent
    index = index if parent is None else parent
    return poses_to_matrices(object_poses[scene.movable.index(index)]) if index in scene.movable else np.eye(4)


def _on_mesh(item: SceneObject, points: NDArray, rays: NDArray, reach: NDArray, cull: bool) -> NDArray:
    vertices = item.vertices if item.mesh_vertices is None else item.mesh_vertices
    found = np.zeros(len(points), dtype=bool)
    for a, b, c in vertices[item.faces].astype(np.float64):
        normal = np.cross(b - a, c - a)
        if not normal.any():
            continue
        normal /= np.linalg.norm(normal)
        near = np.abs((points - a) @ normal) <= reach
        for p, q in ((a, b), (b, c), (c, a)):
            inwards = np.cross(normal, q - p)
            near &= (points - p) @ inwards >= -reach * np.linalg.norm(inwards)
        found |= near & (rays @ normal < 0) if cull else near
    return found


def _on_solid(item: SceneObject, points: NDArray, rays: NDArray, reach: NDArray, cull: bool) -> NDArray:
    """Estimate the distance outside the solid along its gradient by finite differences."""

    def outside(p: NDArray) -> NDArray:
        p = p / item.solid.radii
        across, along = np.hypot(p[:, 0], p[:, 1]), np.abs(p[:, 2]) - item.solid.half
        if item.solid.kind.name == "CYLINDER":
            return np.maximum(across - 1, along)
        return np.hypot(across, np.maximum(along, 0)) - 1

    step = 1e-6 * item.solid.radii.min()
    slope = np.stack([(outside(points + d) - outside(points - d)) / (2 * step) for d in step * np.eye(3)], axis=1)
    near = np.abs(outside(points)) <= reach * np.linalg.norm(slope, axis=1)
    return near & (np.einsum("nk,nk->n", slope, rays) < 0) if cull else near


show_later_rows = show_later  # on CPU cores
