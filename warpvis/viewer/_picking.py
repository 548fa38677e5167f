# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A picked point of a scene and who sees it, eyes that are turned, and the objects that people mean."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_point
from warpvis.core.labels import Label
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import ArrayError
from warpvis.viewer._stage import Stage
from warpvis.visibility import (
    Agent,
    Candidate,
    FieldOfView,
    LineOfSight,
    Perspective,
    cast_ray,
    line_of_sight,
)

# Distance from an agent's eyes below which there is no line of sight [m].
_AT_EYES = 1e-3


@dataclass(frozen=True, eq=False)
class Picked:
    """A picked point, and whether each agent sees it."""

    point: tuple[float, float, float]
    """The point in the world [m]."""
    object: str | None
    """Name of the object whose surface was picked, with which the point moves; None for a fixed point."""
    lines: tuple[LineOfSight, ...]
    """The line of sight of each agent, except of those whose own body was picked, or whose eyes are at the point."""
    reasons: dict[str, str]
    """Whether each agent sees the point, and if not, why, in words."""

    @property
    def title(self) -> str:
        """The point in words."""
        where = ", ".join(f"{round(value, 2) + 0.0:.2f}" for value in self.point)  # + 0.0: no -0.00
        return f"point {'' if self.object is None else f'on {self.object} '}at ({where})"


class Picker:
    """The picked point of a stage. It moves with its object."""

    def __init__(self, stage: Stage) -> None:
        """Start without a point."""
        self._stage = stage
        self._picked: tuple[NDArray[np.float64], str | None] | None = None
        """The point in the frame of its object, or in the world; and the name of its object."""

    def pick(self, point: ArrayLike) -> None:
        """Pick a fixed point in the world [m], ``(3,)``."""
        self._picked = as_point(point, "point"), None

    def pick_along(self, origin: ArrayLike, direction: ArrayLike, object_poses: NDArray[np.float64]) -> bool:
        """Pick the first point of a surface along a ray, and return whether there is one."""
        start, way = as_point(origin, "origin"), as_point(direction, "direction")
        if not way.any():
            raise ArrayError("direction must not be 0")
        hit = cast_ray(self._stage.scene, start, way, object_poses=_given(object_poses))
        if hit is None:
            return False
        point, name = hit[0], self._stage.scene.objects[hit[1]].name
        column = self._stage.column(name)
        if column >= 0:
            frame = poses_to_matrices(object_poses[column][None])[0]
            point = (point - frame[:3, 3]) @ frame[:3, :3]
        self._picked = point, name
        return True

    def clear(self) -> None:
        """Forget the point."""
        self._picked = None

    def find(self, agents: Sequence[Agent], object_poses: NDArray[np.float64]) -> Picked | None:
        """Return who sees the point, or None without one."""
        if self._picked is None:
            return None
        point, name = self._picked
        column = -1 if name is None else self._stage.column(name)
        if column >= 0:
            frame = poses_to_matrices(object_poses[column][None])[0]
            point = frame[:3, :3] @ point + frame[:3, 3]
        lines, reasons = [], {}
        for agent in agents:
            if math.dist(point, agent.poses[0, :3]) < _AT_EYES:
                reasons[agent.name] = "its eyes are there"
                continue
            if name in agent.excluded:
                reasons[agent.name] = "own body, which it does not see"
                continue
            line = line_of_sight(self._stage.scene, agent, point, object_poses=_given(object_poses))
            lines.append(line)
            reasons[agent.name] = line.reason
        x, y, z = point.tolist()
        return Picked((x, y, z), name, tuple(lines), reasons)


def _given(object_poses: NDArray[np.float64]) -> NDArray[np.float64] | None:
    return object_poses if len(object_poses) else None


def find_meant(
    seen: Perspective, agents: Sequence[Agent], stage: Stage, gazing: Sequence[str]
) -> dict[str, tuple[Candidate, ...]]:
    """Return the candidates of each person, most likely first; `agents` look along the axes of their poses.

    People are all agents but the first one, or a single agent with a `FieldOfView`. `gazing` are those whose gaze, and
    not only the direction of the head, is known.
    """
    robot = agents[0].name if len(agents) > 1 else None
    people = agents[1:] if robot is not None else [a for a in agents if isinstance(a.camera, FieldOfView)]
    bodies = [name for agent in agents for name in agent.body]
    labels = None if all(item.label != Label.OBJECT for item in stage.scene.objects) else [Label.OBJECT]
    found = {}
    for agent in people:
        gaze = poses_to_matrices(agent.poses)[0, :3, 2] if agent.name in gazing else None
        found[agent.name] = tuple(seen.candidates(agent.name, robot, labels=labels, exclude=bodies, gaze=gaze))
    return found


def probabilities(meant: Mapping[str, Sequence[Candidate]]) -> dict[str, dict[str, float]]:
    """Return the probability that each person means each object, by their names."""
    return {name: {item.object: item.probability for item in found} for name, found in meant.items()}
