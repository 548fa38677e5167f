# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of sight from agents to hidden objects, with their intersections with the occluders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.labels import Visibility
from warpvis.core.poses import look_at, poses_to_matrices
from warpvis.rendering import Renderer
from warpvis.viewer._stage import Stage
from warpvis.visibility import Agent, Perspective

_PIXEL = Camera(1, 1, 1000.0, 1000.0, 0.5, 0.5)
"""A camera with one pixel, whose ray is the camera's axis."""


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
        """Set up the renderer."""
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
        poses = np.array([_pose_toward(eye, target) for target in targets])
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


def _pose_toward(eye: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the pose of a camera that faces a target, with an arbitrary up direction."""
    direction = target - eye
    return look_at(eye, target, up=np.eye(3)[np.abs(direction).argmin()])
