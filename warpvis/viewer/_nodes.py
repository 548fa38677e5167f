# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes of the page's 3D view: meshes, agents, the point cloud, lines of sight, the proposal, and handles to drag."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpvis import viz
from warpvis.cameras import as_pinhole
from warpvis.cameras.pinhole import Camera
from warpvis.core.poses import check_up, poses_to_matrices, poses_to_opencv
from warpvis.visibility import Agent, FieldOfView, State
from warpvis.viz import STATE_COLORS

if TYPE_CHECKING:
    from viser import SceneApi

    from warpvis.scene import Scene
    from warpvis.viewer._state import Snapshot, ViewerState


def agent_colors(names: Iterable[str]) -> dict[str, tuple[int, int, int]]:
    """Return the color of each agent by name."""
    items = list(names)
    return dict(zip(items, viz.agent_colors(len(items)), strict=True))


_FRUSTUM_SIZE, _FIELD_SIZE = 0.28, 0.45
_ARC = 24
_HIDDEN = (150, 150, 150)
_POINT_SIZE = 0.32
"""Size of a point, relative to the spacing of points."""

_AGENT_SIZE, _MIN_SIZE, _MAX_SIZE = 0.4, 0.3, 0.6
_FULL_SIZE = 3.0
"""Diagonal of the smallest scene in which frusta and handles have their full size [m]."""


def mark_scale(scene: Scene) -> float:
    """Return the factor of the sizes of frusta and handles in a scene, up to 1."""
    low, high = scene.bounds.astype(np.float64)
    return min(1.0, float(np.linalg.norm(high - low)) / _FULL_SIZE)


class Nodes(ABC):
    """Nodes that are shown and hidden together."""

    @property
    def visible(self) -> bool:
        """Whether the nodes are shown."""
        return all(node.visible for node in self._nodes())

    @visible.setter
    def visible(self, visible: bool) -> None:
        for node in self._nodes():
            node.visible = visible

    @abstractmethod
    def _nodes(self) -> list[Any]: ...


class AgentMark:
    """An agent's view: a frustum with its image, or the borders of a wide field and the frustum of attention."""

    def __init__(self, scene: SceneApi, agent: Agent, color: tuple[int, int, int], scale: float = 1.0) -> None:
        self._path, self._color, self._scale = f"/agents/{agent.name}", color, scale
        self._style: dict[str, Any] = {"color": color, "thickness": 0.008 * scale, "scale": scale * _FRUSTUM_SIZE}
        self._style |= {"cast_shadow": False, "receive_shadow": False}
        self._scene = scene
        self.frame = scene.add_frame(self._path, show_axes=False)
        scene.add_label(f"{self._path}/name", agent.name, position=(0, -0.15 * scale, 0), anchor="bottom-center")
        self._camera: object = None
        self._frustum: Any = None

    def show(self, agent: Agent, picture: NDArray[np.uint8]) -> None:
        """Update the pose and the image."""
        place(self.frame, agent.poses[0])
        if agent.camera != self._camera:
            self._draw(agent)
            self._camera = agent.camera
        if agent.pinhole is not None:
            self._frustum.image = picture

    def _draw(self, agent: Agent) -> None:
        if isinstance(agent.camera, FieldOfView):
            segments = self._scale * _borders(agent.camera)
            self._scene.add_line_segments(
                f"{self._path}/field", segments, self._color, thickness=self._style["thickness"]
            )
            attention = None if agent.attention is None else as_pinhole(agent.attention)
            if attention is not None:
                self._frustum = _add_frustum(self._scene, f"{self._path}/frustum", attention, **self._style)
        elif agent.pinhole is not None:
            self._frustum = _add_frustum(self._scene, f"{self._path}/frustum", agent.pinhole, **self._style)
        else:
            self._scene.add_frame(f"{self._path}/axes", axes_length=0.2 * self._scale, axes_radius=0.008 * self._scale)


class CloudNode:
    """The point cloud."""

    def __init__(self, scene: SceneApi, state: ViewerState) -> None:
        self._points = np.zeros((0, 3), dtype=np.float32)
        self.node = scene.add_point_cloud(
            "/cloud",
            self._points,
            (0, 0, 0),
            point_size=_POINT_SIZE * state.cloud.spacing,
            point_shape="circle",
            point_shading="flat",
            precision="float32",
        )

    def show(self, snapshot: Snapshot) -> None:
        """Update points and colors; points are sent only if they changed."""
        if not np.array_equal(snapshot.points, self._points):
            self.node.points = self._points = snapshot.points
        if len(snapshot.points):  # browsers report an error for an empty array of colors
            self.node.colors = snapshot.point_colors


class SightNode:
    """Lines from agents to hidden objects: in the agent's color up to the occluder, gray behind it."""

    def __init__(self, scene: SceneApi, names: Sequence[str], scale: float = 1.0) -> None:
        """Store the agents' names and colors."""
        self._scene, self._colors, self._thickness = scene, agent_colors(names), 0.012 * scale
        self._node: Any = None
        self._segments = np.zeros((0, 2, 3))
        self.visible = True

    def show(self, snapshot: Snapshot) -> None:
        lines = snapshot.lines if self.visible else ()
        segments = np.array([part for line in lines for part in ((line.eye, line.stop), (line.stop, line.target))])
        if np.array_equal(segments, self._segments):
            return
        self._segments = segments
        if self._node is not None:
            self._node.remove()
            self._node = None
        if len(segments):
            colors = np.array([[color] * 2 for line in lines for color in (self._colors[line.agent], _HIDDEN)])
            self._node = self._scene.add_line_segments(
                "/sight", segments.astype(np.float32), colors.astype(np.uint8), thickness=self._thickness
            )


class ProposalMark:
    """The frustum of a camera at the proposed pose."""

    def __init__(self, scene: SceneApi, scale: float = 1.0) -> None:
        """Start without a frustum."""
        self._scene, self._scale = scene, scale
        self.node: Any = None

    def show(self, camera: Camera, pose: NDArray[np.float64]) -> None:
        """Show the frustum at a pose, row ``x y z qx qy qz qw``."""
        self.clear()
        style: dict[str, Any] = {"color": STATE_COLORS[State.BOTH], "thickness": 0.012 * self._scale}
        style["scale"] = self._scale * _FRUSTUM_SIZE
        self.node = _add_frustum(self._scene, "/proposal", camera, **style)
        place(self.node, pose)

    def clear(self) -> None:
        """Remove the frustum."""
        if self.node is not None:
            self.node.remove()
            self.node = None


def _add_frustum(scene: SceneApi, path: str, camera: Camera, **style: Any) -> Any:
    aspect = (camera.width / camera.fx) / (camera.height / camera.fy)
    return scene.add_camera_frustum(path, fov=camera.vfov, aspect=aspect, **style)


def place(node: Any, pose: NDArray[np.floating]) -> None:
    """Set the pose of a node, row ``x y z qx qy qz qw``; send only changes."""
    position, wxyz = pose[:3], pose[[6, 3, 4, 5]]
    if not np.array_equal(position, node.position):
        node.position = position
    if not np.array_equal(wxyz, node.wxyz):
        node.wxyz = wxyz


def _borders(field: FieldOfView) -> NDArray[np.float64]:
    """Return two arcs with spokes for the width and height of a field, segments in the OpenCV frame, ``(n, 2, 3)``."""
    half = min(field.hfov / 2, math.pi)
    sides = np.linspace(-half, half, _ARC + 1)
    level = np.stack([np.sin(sides), np.zeros_like(sides), np.cos(sides)], axis=1)
    heights = np.linspace(-field.down, field.up, _ARC + 1)
    upright = np.stack([np.zeros_like(heights), -np.sin(heights), np.cos(heights)], axis=1)
    segments = [np.stack([arc[:-1], arc[1:]], axis=1) for arc in (level, upright)]
    spokes = np.stack([np.zeros((4, 3)), np.stack([level[0], level[-1], upright[0], upright[-1]])], axis=1)
    return _FIELD_SIZE * np.concatenate([*segments, spokes])


class Gizmos(Nodes):
    """All handles of a page. `dragged` is called after the state is updated with a handle's pose."""

    def __init__(self, scene: SceneApi, state: ViewerState, dragged: Callable[[], None]) -> None:
        self._state, self._dragged, self._scale = state, dragged, mark_scale(state.scene)
        self.agents = {name: self._add_agent(scene, name) for name in state.agents}
        self.objects = {name: self._add_object(scene, name) for name in state.stage.handles}
        self._mounts: dict[str, NDArray[np.float64]] = {}
        self.follow()

    def _nodes(self) -> list[Any]:
        return [*self.agents.values(), *self.objects.values()]

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
        gizmo = scene.add_transform_controls(
            f"/handles/agents/{name}", scale=self._scale * _AGENT_SIZE, depth_test=False
        )

        @gizmo.on_update
        def moved(_: object) -> None:
            handle = poses_to_matrices(_pose(gizmo)[None])[0]
            self._state.move_agent(name, poses_to_opencv((handle @ self._mounts[name])[None])[0])
            self._dragged()

        return gizmo

    def _add_object(self, scene: SceneApi, name: str) -> Any:
        vertices, _ = self._state.stage.mesh(name)
        reach = 0.75 * float((vertices.max(axis=0) - vertices.min(axis=0)).max())
        size = self._scale * min(max(reach, _MIN_SIZE), _MAX_SIZE)
        number = self._state.scene.index(name)
        gizmo = scene.add_transform_controls(f"/handles/objects/{number}", scale=size, depth_test=False)

        @gizmo.on_update
        def moved(_: object) -> None:
            self._state.move_object(name, _pose(gizmo))
            self._dragged()

        return gizmo


def level_frame(eyes: NDArray[np.float64], vertical: int) -> NDArray[np.float64]:
    """Return the frame at a camera ``(4, 4)`` with axes forward along the ground, left and up (axis `vertical`)."""
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
