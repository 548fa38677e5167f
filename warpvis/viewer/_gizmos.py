# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Handles that a user drags: level handles at the agents' eyes, and handles on movable objects."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import check_up, poses_to_matrices, poses_to_opencv
from warpvis.viewer._nodes import place

if TYPE_CHECKING:
    from viser import SceneApi

    from warpvis.viewer._state import ViewerState

_AGENT_SIZE, _MIN_SIZE, _MAX_SIZE = 0.4, 0.3, 0.6


class Gizmos:
    """All handles of a page. `dragged` is called after the state is updated with a handle's pose."""

    def __init__(self, scene: SceneApi, state: ViewerState, dragged: Callable[[], None]) -> None:
        """Add the handles to the page."""
        self._state, self._dragged = state, dragged
        self.agents = {name: self._add_agent(scene, name) for name in state.agents}
        self.objects = {name: self._add_object(scene, name) for name in state.stage.handles}
        self._mounts: dict[str, NDArray[np.float64]] = {}
        self.follow()

    @property
    def visible(self) -> bool:
        """Whether the handles are shown."""
        return all(gizmo.visible for gizmo in (*self.agents.values(), *self.objects.values()))

    @visible.setter
    def visible(self, visible: bool) -> None:
        for gizmo in (*self.agents.values(), *self.objects.values()):
            gizmo.visible = visible

    def follow(self) -> None:
        """Move the handles to the agents and objects after these were moved in another way."""
        for name, gizmo in self.agents.items():
            eyes = poses_to_matrices(self._state.agents[name].poses)[0]
            handle = level_frame(eyes, check_up(self._state.scene.up))
            self._mounts[name] = np.linalg.inv(handle) @ eyes
            place(gizmo, poses_to_opencv(handle[None])[0])
        for name, gizmo in self.objects.items():
            place(gizmo, self._state.object_pose(name))

    def _add_agent(self, scene: SceneApi, name: str) -> Any:
        gizmo = scene.add_transform_controls(f"/handles/agents/{name}", scale=_AGENT_SIZE, depth_test=False)

        @gizmo.on_update
        def moved(_: object) -> None:
            handle = poses_to_matrices(_pose(gizmo)[None])[0]
            self._state.move_agent(name, poses_to_opencv((handle @ self._mounts[name])[None])[0])
            self._dragged()

        return gizmo

    def _add_object(self, scene: SceneApi, name: str) -> Any:
        vertices, _ = self._state.stage.mesh(name)
        reach = 0.75 * float((vertices.max(axis=0) - vertices.min(axis=0)).max())
        size = min(max(reach, _MIN_SIZE), _MAX_SIZE)
        number = self._state.scene.index(name)
        gizmo = scene.add_transform_controls(f"/handles/objects/{number}", scale=size, depth_test=False)

        @gizmo.on_update
        def moved(_: object) -> None:
            self._state.move_object(name, _pose(gizmo))
            self._dragged()

        return gizmo


def level_frame(eyes: NDArray[np.float64], vertical: int) -> NDArray[np.float64]:
    """Return the frame at a camera's position with axes forward along the ground, left and up.

    Args:
        eyes: Camera to world, OpenCV axes, ``(4, 4)``.
        vertical: Index of the world's vertical axis.
    """
    up = np.eye(3)[vertical]
    forward = eyes[:3, 2] - up * eyes[vertical, 2]
    if np.linalg.norm(forward) < 1e-6:  # straight down or up: use the image's up or down direction
        forward = -eyes[:3, 1] * np.sign(-eyes[vertical, 2])
        forward = forward - up * forward[vertical]
    forward = forward / np.linalg.norm(forward)
    frame = np.eye(4)
    frame[:3, :3] = np.stack([forward, np.cross(up, forward), up], axis=1)
    frame[:3, 3] = eyes[:3, 3]
    return frame


def _pose(gizmo: Any) -> NDArray[np.float64]:
    """Return a handle's pose as a row ``x y z qx qy qz qw`` with a unit quaternion."""
    w, x, y, z = np.asarray(gizmo.wxyz, dtype=np.float64) / np.linalg.norm(gizmo.wxyz)
    return np.array([*gizmo.position, x, y, z, w], dtype=np.float64)
