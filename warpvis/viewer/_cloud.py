# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Point cloud of all surfaces, with the agents that see each point, and lines of sight to hidden objects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.labels import Visibility
from warpvis.core.poses import look_at, poses_to_matrices
from warpvis.planning import surface_samples
from warpvis.rendering import Renderer
from warpvis.viewer._stage import Stage
from warpvis.visibility import Agent, Perspective, point_visibility

_POINTS = 20_000
"""Approximate number of points."""
_MIN_SPACING = 0.005
_SPARSER = 1.4
"""Spacing of points on the ground, relative to other surfaces."""

_PIXEL = Camera(1, 1, 1000.0, 1000.0, 0.5, 0.5)
"""A camera with one pixel, whose ray is the camera's axis."""


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


@dataclass(frozen=True, eq=False)
class SightLine:
    """A line of sight to the center of a hidden object."""

    agent: str
    object: str
    occluder: str
    """Name of the object that hides it."""
    eye: NDArray[np.float64]
    stop: NDArray[np.float64]
    """Intersection of the line with the occluder [m]."""
    target: NDArray[np.float64]
    """Center of the object's box [m]."""


class SightLines:
    """Finds lines of sight with one ray each."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._renderer = Renderer(stage.scene, _PIXEL, outputs=("depth", "segmentation"))

    def find(
        self, agents: Sequence[Agent], seen: Perspective, object_poses: NDArray[np.float64]
    ) -> tuple[SightLine, ...]:
        """Return the lines from each agent to the objects that are fully hidden from it.

        Objects are skipped if the ray to their center hits the object itself before another one.
        """
        lines = []
        for number, agent in enumerate(agents):
            hidden = np.flatnonzero((seen.status[number, 0] == Visibility.OCCLUDED) & ~seen.body[number])
            if len(hidden):
                lines += self._find_for_agent(agent, [seen.objects[k] for k in hidden], object_poses)
        return tuple(lines)

    def _find_for_agent(self, agent: Agent, names: Sequence[str], object_poses: NDArray[np.float64]) -> list[SightLine]:
        eye = agent.poses[0, :3]
        targets = [self._center(name, object_poses) for name in names]
        ups = [np.eye(3)[np.abs(target - eye).argmin()] for target in targets]  # any that is not along the ray
        poses = np.array([look_at(eye, target, up=up) for target, up in zip(targets, ups, strict=True)])
        views = self._renderer.render(
            poses, object_poses=object_poses if len(object_poses) else None, exclude=agent.body or None
        )
        depths, objects = views.depth.numpy()[:, 0, 0], views.segmentation.numpy()[:, 0, 0]
        lines = []
        for name, target, depth, index in zip(names, targets, depths, objects, strict=True):
            direction = target - eye
            length = float(np.linalg.norm(direction))
            occluder = self._stage.scene.objects[index].name if index >= 0 else name
            if occluder != name and depth < length:
                lines.append(
                    SightLine(agent.name, name, occluder, eye, eye + direction * (float(depth) / length), target)
                )
        return lines

    def _center(self, name: str, object_poses: NDArray[np.float64]) -> NDArray[np.float64]:
        vertices, _ = self._stage.mesh(name)
        center = (vertices.min(axis=0).astype(np.float64) + vertices.max(axis=0)) / 2
        column = self._stage.column(name)
        if column < 0:
            return center
        frame = poses_to_matrices(object_poses[column][None])[0]
        return frame[:3, :3] @ center + frame[:3, 3]
