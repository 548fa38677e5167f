# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Eyes that turn in the heads of agents."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from warpvis.core.checks import check_angle
from warpvis.core.poses import quaternion_product
from warpvis.errors import ArrayError
from warpvis.visibility._agents import Agent
from warpvis.visibility._reference_model import ReferenceModel

MAX_EYE_ANGLE = ReferenceModel().max_eye_angle
"""Maximum angle between the eyes and the head's axis [rad]."""


@dataclass
class Eyes:
    """Angles by which agents' eyes are turned from the axes of their heads, for agents whose gaze is known."""

    angles: dict[str, tuple[float, float]] = field(default_factory=dict)
    """To the right and up [rad], by name."""

    def turn(self, name: str, right: float, up: float) -> None:
        """Turn an agent's eyes to the right and up from the axis of the head [rad]."""
        angles = check_angle(right, "right"), check_angle(up, "up")
        turned = math.acos(math.cos(angles[0]) * math.cos(angles[1]))
        if turned > MAX_EYE_ANGLE + 1e-9:
            raise ArrayError(
                f"right and up must turn the eyes of {name!r} by at most {math.degrees(MAX_EYE_ANGLE):.0f} degrees, "
                f"got {math.degrees(turned):.0f} degrees"
            )
        self.angles = {**self.angles, name: angles}

    def release(self, name: str) -> None:
        """Forget an agent's gaze."""
        self.angles = {other: angles for other, angles in self.angles.items() if other != name}

    def looking(self, agent: Agent) -> Agent:
        """Return an agent, at the pose of its head, at the pose of its eyes."""
        if agent.name not in self.angles:
            return agent
        right, up = self.angles[agent.name]
        rotation = quaternion_product(
            np.array([0.0, math.sin(right / 2), 0.0, math.cos(right / 2)]),
            np.array([math.sin(up / 2), 0.0, 0.0, math.cos(up / 2)]),
        )
        row = agent.poses[0]
        pose = np.concatenate([row[:3], quaternion_product(row[3:], rotation)])
        return replace(agent, pose=pose, convention="opencv", quaternion="xyzw")
