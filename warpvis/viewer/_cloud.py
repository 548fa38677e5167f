# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Point cloud of all surfaces, with the agents that see each point."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Visibility
from warpvis.core.poses import poses_to_matrices
from warpvis.planning import surface_samples
from warpvis.viewer._stage import Stage
from warpvis.visibility import Agent, point_visibility

_POINTS = 20_000
"""Approximate number of points."""
_MIN_SPACING = 0.005
_SPARSER = 1.4
"""Spacing of points on the ground, relative to other surfaces."""


class SurfaceCloud:
    """Points distributed evenly over a stage's surfaces; they move with their objects."""

    def __init__(self, stage: Stage, points: int = _POINTS) -> None:
        """Sample about `points` points on the surfaces."""
        self.stage = stage
        objects = stage.scene.objects
        ground = [index for index, item in enumerate(objects) if item.label in stage.scene.ground_labels]
        obstacles = [index for index in range(len(objects)) if index not in set(ground)]
        area = _area(stage, obstacles) + _area(stage, ground) / _SPARSER**2
        self.spacing = max(_MIN_SPACING, math.sqrt(area / points))
        samples = [
            surface_samples(stage.scene, spacing=spacing, objects=chosen)
            for spacing, chosen in ((self.spacing, obstacles), (_SPARSER * self.spacing, ground))
            if chosen
        ]
        self.objects: NDArray[np.int32] = np.concatenate([sample.objects for sample in samples])
        self._columns = stage.columns[self.objects]
        self._moving = self._columns >= 0
        self.points = np.concatenate([sample.points for sample in samples]).astype(np.float64)
        self.normals = np.nan_to_num(np.concatenate([sample.normals for sample in samples]).astype(np.float64))
        self._to_object_frames(stage.object_poses)

    def _to_object_frames(self, object_poses: NDArray[np.float64]) -> None:
        """Transform the points of movable objects to the frames of their meshes."""
        if not self._moving.any():
            return
        frames = poses_to_matrices(object_poses)[self._columns[self._moving]]
        offsets = self.points[self._moving] - frames[:, :3, 3]
        self.points[self._moving] = np.einsum("nji,nj->ni", frames[:, :3, :3], offsets)
        self.normals[self._moving] = np.einsum("nji,nj->ni", frames[:, :3, :3], self.normals[self._moving])

    def __len__(self) -> int:
        return len(self.points)

    def positions(self, object_poses: NDArray[np.float64], lift: float = 0.0) -> NDArray[np.float32]:
        """Return the points in the world [m], ``(N, 3)``, offset along their normals by `lift` [m]."""
        lifted = self.points + lift * self.normals
        points = lifted.astype(np.float32)
        if self._moving.any():
            frames = poses_to_matrices(object_poses)[self._columns[self._moving]]
            local = lifted[self._moving]
            points[self._moving] = np.einsum("nij,nj->ni", frames[:, :3, :3], local) + frames[:, :3, 3]
        return points

    def seen_by(
        self, agent: Agent, object_poses: NDArray[np.float64], points: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """Return which points an agent sees, ``(N,)``; it does not see its own body."""
        seen = np.zeros(len(points), dtype=bool)
        for face in agent.faces:
            found = point_visibility(
                self.stage.scene,
                face.camera,
                agent.face_poses(face),
                points,
                object_poses=object_poses if len(object_poses) else None,
                exclude=agent.body or None,
            )
            seen |= found.numpy()[0] == Visibility.VISIBLE  # type: ignore[union-attr]  # occluders are not requested
        return seen & ~np.isin(self.objects, [self.stage.scene.index(name) for name in agent.body])

    def states(
        self, agents: Sequence[Agent], object_poses: NDArray[np.float64], points: NDArray[np.float32]
    ) -> NDArray[np.uint8]:
        """Return a `State` for each point, ``(N,)``: which of the first two agents see it."""
        states = np.zeros(len(points), dtype=np.uint8)
        for number, agent in enumerate(agents[:2]):
            states += np.uint8(1 + number) * self.seen_by(agent, object_poses, points)
        return states


def _area(stage: Stage, indices: Sequence[int]) -> float:
    """Return the total surface area of objects [m^2]."""
    total = 0.0
    for item in (stage.scene.objects[index] for index in indices):
        vertices, faces = item.vertices.astype(np.float64), item.faces
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        total += float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2
    return total
