# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Content and colors of a picture of two agents' views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_items, is_whole, pluralize
from warpvis.core.labels import Label
from warpvis.core.types import ObjectPoses
from warpvis.errors import ArrayError, SceneError
from warpvis.scene import Scene, require_scene
from warpvis.visibility import Agent, Perspective, State
from warpvis.viz._agent_views import pose_of

STATE_COLORS: dict[State, tuple[int, int, int]] = {
    State.BOTH: (17, 119, 51),
    State.FIRST: (86, 180, 233),
    State.SECOND: (230, 159, 0),
    State.NEITHER: (120, 94, 240),
}
"""RGB colors of the four states, 0 to 255, distinguishable with any kind of color blindness: colors of Okabe and Ito
for one agent; dark green and violet, from the palettes of Tol and IBM, for both and neither."""

GRAYS = {
    Label.GROUND: 0.88,
    Label.OBSTACLE: 0.70,
    Label.OBJECT: 0.70,
    Label.HUMAN: 0.45,
    Label.ROBOT: 0.45,
}
"""Brightness of objects without a state, from 0 to 1."""


def drawn_label(scene: Scene, label: int) -> Label:
    """Return the `Label` that a class is drawn as: ground for all ground labels, obstacle for custom classes."""
    if label in scene.ground_labels:
        return Label.GROUND
    return Label(label) if Label.OBJECT <= label <= Label.ROBOT else Label.OBSTACLE


@dataclass(frozen=True)
class PanelData:
    """Data shared by all panels."""

    scene: Scene
    agents: tuple[Agent, Agent]
    view: int
    states: dict[int, State]
    """State of each colored object, by its index in the scene."""
    colors: NDArray[np.float64]
    """RGB color of each object from 0 to 1, and white for -1, shape ``(objects + 1, 3)``."""
    object_poses: ObjectPoses

    @classmethod
    def from_perspective(
        cls,
        scene: Scene,
        agents: Sequence[Agent],
        seen: Perspective,
        view: int,
        labels: Sequence[Label | int | str] | None,
        object_poses: ObjectPoses,
    ) -> PanelData:
        """Collect the data; see `warpvis.viz.save_perspective` for the arguments and errors."""
        require_scene(scene)
        if not isinstance(seen, Perspective):
            raise SceneError(f"seen must be a result of perspective, got {type(seen).__name__}")
        pair = as_items(agents, "agents", SceneError)
        if len(pair) != 2 or not all(isinstance(agent, Agent) and agent.name in seen.agents for agent in pair):
            names = ", ".join(repr(getattr(agent, "name", agent)) for agent in pair)
            raise SceneError(f"agents must be two agents of seen, got {names or 'none'}")
        included = set(seen.labels) - scene.ground_labels if labels is None else scene.label_names.numbers(labels)
        first, second = pair
        found = seen.states(first.name, second.name)
        if not is_whole(view) or view not in range(len(found)):
            raise ArrayError(f"view must be an index from 0 into {pluralize(len(found), 'situation')}, got {view!r}")
        bodies = {*first.body, *second.body}
        states = {
            scene.index(name): State(state)
            for name, label, state in zip(seen.objects, seen.labels, found[view], strict=True)
            if label in included and name not in bodies
        }
        colors = np.array([[GRAYS[drawn_label(scene, item.label)]] * 3 for item in scene.objects] + [[1.0] * 3])
        for name in bodies:
            colors[scene.index(name)] = GRAYS[Label.HUMAN]
        for index, state in states.items():
            colors[index] = np.array(STATE_COLORS[state]) / 255
        poses = seen.objects_at(view) if object_poses is None else object_poses
        return cls(scene, (first, second), view, states, colors, poses)

    @property
    def bodies(self) -> set[int]:
        """Indices of the objects that are the agents' bodies."""
        return {self.scene.index(name) for agent in self.agents for name in agent.body}

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Minimum and maximum corner of the scene and the agents' eyes [m], shape ``(2, 3)``."""
        corners = np.concatenate([self.scene.bounds.astype(np.float64), *(self.pose(k)[None, :3] for k in (0, 1))])
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    def pose(self, agent: int) -> NDArray[np.float64]:
        """Return the pose of the first (0) or second (1) agent, a row ``x y z qx qy qz qw``."""
        return pose_of(self.agents[agent], self.view)
