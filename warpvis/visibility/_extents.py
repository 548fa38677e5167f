# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Directions and solid angles of objects: of the parts that an agent sees, and of boxes around objects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera, as_pinhole
from warpvis.core.poses import poses_to_matrices
from warpvis.scene import Scene
from warpvis.scene.worlds import pose_columns
from warpvis.visibility._reference_model import Extents, Floats, angles_to_quads, quad_solid_angles

# Faces of a box: indices of corners, whose bits are the upper bounds in x, y and z.
_BOX_FACES = np.array([[0, 2, 6, 4], [1, 3, 7, 5], [0, 1, 5, 4], [2, 3, 7, 6], [0, 1, 3, 2], [4, 5, 7, 6]])
_BITS = (np.arange(8)[:, None] >> np.arange(3)) & 1


@dataclass(frozen=True, eq=False)
class ObjectBoxes:
    """Boxes of K objects, aligned with their frames if they are movable, otherwise with the world."""

    bounds: Floats
    """Lower and upper bounds [m], ``(K, 2, 3)``."""
    columns: NDArray[np.int64]
    """Index of the movable object that each object moves with; -1 if static, ``(K,)``."""

    @classmethod
    def of(cls, scene: Scene, indices: Sequence[int]) -> ObjectBoxes:
        """Return the boxes of a scene's objects."""
        corners = [scene.objects[index].frame_vertices for index in indices]
        bounds = np.array([[points.min(axis=0), points.max(axis=0)] for points in corners], dtype=np.float64)
        return cls(bounds, np.array(pose_columns(scene), dtype=np.int64)[list(indices)])

    @classmethod
    def none(cls) -> ObjectBoxes:
        """Return the boxes of no objects."""
        return cls(np.empty((0, 2, 3)), np.empty(0, dtype=np.int64))

    def centers(self, object_poses: NDArray[np.float32] | None) -> Floats:
        """Return the boxes' centers in each world [m], ``(W, K, 3)``.

        Args:
            object_poses: Poses of the movable objects, ``(W, M, 7)``; None if nothing is movable, for one world.
        """
        centers = self.bounds.mean(axis=1)
        if object_poses is None:
            return centers[None]
        moved = self.columns >= 0
        frames = poses_to_matrices(object_poses[:, self.columns[moved]].astype(np.float64))
        worlds = np.repeat(centers[None], len(frames), axis=0)
        worlds[:, moved] = (frames[..., :3, :3] @ centers[moved, :, None])[..., 0] + frames[..., :3, 3]
        return worlds

    def corners(self, k: NDArray[np.intp], object_poses: NDArray[np.float32] | None) -> Floats:
        """Return the corners of boxes in the world [m], ``(N, 8, 3)``.

        Args:
            k: The objects, ``(N,)``.
            object_poses: Poses of the movable objects, ``(M, 7)``; None if nothing is movable.
        """
        corners = self.bounds[k][:, _BITS, np.arange(3)]
        if object_poses is not None:
            moved = self.columns[k] >= 0
            frames = poses_to_matrices(object_poses[self.columns[k][moved]].astype(np.float64))
            corners[moved] = corners[moved] @ frames[:, :3, :3].swapaxes(1, 2) + frames[:, None, :3, 3]
        return corners

    def measure(
        self, k: NDArray[np.intp], object_poses: NDArray[np.float32] | None, origin: Floats, direction: Floats
    ) -> Extents:
        """Measure boxes from a point in the world.

        Args:
            k: The objects, ``(N,)``.
            object_poses: Poses of the movable objects, ``(M, 7)``; None if nothing is movable.
            origin: The point [m], ``(3,)``.
            direction: Unit vector, ``(3,)``.
        """
        corners = self.corners(k, object_poses) - origin
        quads = corners[:, _BOX_FACES]
        angles, faces = angles_to_quads(direction, quads).min(axis=1), quad_solid_angles(quads)
        centers = _unit(corners.mean(axis=1), direction)
        offsets = _unit(corners, direction) - centers[:, None]
        # The variance of the ends of a line is three times that of its points.
        covariances = offsets.swapaxes(1, 2) @ offsets / (8 * 3)
        # Front and back of a convex surface have the same solid angle.
        return Extents(angles, faces.sum(axis=1) / 2, centers, covariances)


@dataclass(frozen=True, eq=False)
class VisibleParts:
    """Pixels in which an agent sees each of K objects, in its F images in V situations, or in one for all of them."""

    poses: Floats
    """Poses of the agent, rows ``x y z qx qy qz qw``, ``(V or 1, 7)``."""
    faces: tuple[tuple[ImageCamera, Floats], ...]
    """Camera and poses of each image, as `poses`."""
    boxes: NDArray[np.int32]
    """Bounding boxes of visible pixels: x, y, width and height [px], -1 for none, ``(F, V or 1, K, 4)``."""
    pixels: NDArray[np.int32]
    """Visible pixels, ``(F, V or 1, K)``."""

    def select(self, views: slice) -> VisibleParts:
        """Return a slice of the situations."""
        poses = self.poses[views] if len(self.poses) > 1 else self.poses
        faces = tuple((camera, rows[views] if len(rows) > 1 else rows) for camera, rows in self.faces)
        shared = self.pixels.shape[1] == 1
        boxes, pixels = (rows if shared else rows[:, views] for rows in (self.boxes, self.pixels))
        return VisibleParts(poses, faces, boxes, pixels)

    def axis(self, view: int) -> tuple[Floats, Floats]:
        """Return the agent's eyes [m] and the direction of its axis in a situation, ``(3,)`` each."""
        pose = poses_to_matrices(_row(self.poses, view)[None])[0]
        return pose[:3, 3], pose[:3, 2]

    def measure(self, k: NDArray[np.intp], view: int, direction: Floats) -> Extents | None:
        """Measure the visible parts of objects in a situation, as the bounding rectangles of their visible pixels.

        Args:
            k: The objects, ``(N,)``.
            view: Index of the situation.
            direction: Unit vector in the world, ``(3,)``.

        Returns:
            Extents of the rectangles, with the solid angles of the visible pixels; None if the agent's camera is no
            pinhole.
        """
        quads, shares = [], []
        for (face, poses), boxes, pixels in zip(self.faces, self.boxes, self.pixels, strict=True):
            camera = as_pinhole(face)
            if camera is None:
                return None
            x, y, width, height = _row(boxes, view)[k].T.astype(np.float64)
            counts = np.where(width > 0, _row(pixels, view)[k], 0)
            shares.append(counts / np.maximum(width * height, 1))
            x = np.where(counts > 0, x, np.nan)
            corners = np.stack([x, y, x + width, y, x + width, y + height, x, y + height], axis=-1).reshape(-1, 4, 2)
            # Image coordinates of pixel borders are whole numbers.
            rays = np.ones((len(k), 4, 3))
            rays[..., :2] = (corners - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
            quads.append(rays @ poses_to_matrices(_row(poses, view)[None])[0, :3, :3].T)
        cones = np.stack(quads)
        angles, areas = angles_to_quads(direction, cones), quad_solid_angles(cones) * np.stack(shares)
        corners = _unit(cones, direction)
        solid_angles = areas.sum(axis=0)
        weights = (areas / np.where(solid_angles > 0, solid_angles, 1.0))[..., None]
        middles = corners.mean(axis=2)
        centers = _unit((weights * middles).sum(axis=0), direction)
        a, b, c, d = np.moveaxis(corners, 2, 0)
        # Points of a parallelogram with sides u and v have the covariance (u u^T + v v^T) / 12 around its center.
        sides = np.stack([(b - a + c - d) / 2, (d - a + c - b) / 2], axis=2) / math.sqrt(12)
        axes = np.concatenate([sides, (middles - centers)[:, :, None]], axis=2)
        covariances = (weights[..., None] * (axes.swapaxes(2, 3) @ axes)).sum(axis=0)
        return Extents(angles.min(axis=0), solid_angles, centers, covariances)


def _unit(vectors: Floats, default: Floats) -> Floats:
    """Return vectors scaled to length 1, ``(..., 3)``; `default` for vectors of length 0 and NaN."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    is_valid = lengths > 0
    return np.where(is_valid, vectors / np.where(is_valid, lengths, 1.0), default)


def _row(values: NDArray[Any], view: int) -> NDArray[Any]:
    """Return the values of a situation: all situations may share one row."""
    return values[view if len(values) > 1 else 0]
