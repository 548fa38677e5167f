# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes of the page's 3D view: meshes, agents, the point cloud, lines of sight, the proposal, and handles to drag."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras import as_pinhole
from warpvis.cameras.pinhole import Camera
from warpvis.core.poses import check_up, poses_to_matrices, poses_to_opencv
from warpvis.visibility import Agent, FieldOfView, State
from warpvis.viz import STATE_COLORS

if TYPE_CHECKING:
    from viser import SceneApi

    from warpvis.viewer._state import Snapshot, ViewerState


def agent_colors(names: Iterable[str]) -> dict[str, tuple[int, int, int]]:
    """Return the color of each agent by name: one for the first agent, and another for all others."""
    return {name: STATE_COLORS[State.SECOND if number else State.FIRST] for number, name in enumerate(names)}


"""Colors of the first and the second agent, the same as those of objects that only this agent sees."""

_FRUSTUM_SIZE, _FIELD_SIZE = 0.28, 0.45
_ARC = 24
_HIDDEN = (150, 150, 150)
_DARK_GROUND = (52, 52, 56)
_POINT_SIZE = 0.32
"""Size of a point, relative to the spacing of points."""

_AGENT_SIZE, _MIN_SIZE, _MAX_SIZE = 0.4, 0.3, 0.6


class _Nodes(ABC):
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


class Meshes(_Nodes):
    """Meshes of the scene's objects. Shared meshes are sent once; movable objects are children of frames."""

    def __init__(self, scene: SceneApi, state: ViewerState, *, dark: bool = False) -> None:
        self._state, self._dark = state, dark
        self._colors = self._all_colors({})
        self._frames = [
            scene.add_frame(f"/moving/{row}", show_axes=False) for row in range(len(state.stage.object_poses))
        ]
        self._meshes: dict[int, Any] = {}
        self._batches: list[tuple[Any, NDArray[np.int64]]] = []
        shared = defaultdict(list)
        for index, item in enumerate(state.scene.objects):
            mesh = item.shared_mesh
            shared[id(mesh) if mesh is not None else -1 - index].append(index)
        for indices in shared.values():
            if len(indices) > 1:
                self._add_batch(scene, np.array(indices))
            else:
                self._add_mesh(scene, indices[0])

    def _all_colors(self, states: dict[str, State]) -> NDArray[np.uint8]:
        """Return the color of every object; on a dark page, the ground is dark."""
        colors = self._state.colors(states)
        if self._dark:
            ground = self._state.scene.ground_labels
            dark = [item.label in ground and item.name not in states for item in self._state.scene.objects]
            colors[np.flatnonzero(dark)] = _DARK_GROUND
        return colors

    def _add_mesh(self, scene: SceneApi, index: int) -> None:
        item = self._state.scene.objects[index]
        vertices, faces = self._state.stage.mesh(item.name)
        row = int(self._state.stage.columns[index])
        path = f"/moving/{row}/{index}" if row >= 0 else f"/objects/{index}"
        color = tuple(self._colors[index].tolist())
        self._meshes[index] = scene.add_mesh_simple(
            path,
            vertices,
            faces,
            color=color,
            flat_shading=True,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _add_batch(self, scene: SceneApi, indices: NDArray[np.int64]) -> None:
        items = [self._state.scene.objects[index] for index in indices]
        mesh = items[0].shared_mesh
        assert mesh is not None  # only objects with a shared mesh are batched
        places = np.array([item.place for item in items], dtype=np.float64)
        batch = scene.add_batched_meshes_simple(
            f"/objects/{indices[0]}",
            mesh.rounded,
            mesh.faces,
            batched_wxyzs=places[:, [6, 3, 4, 5]],
            batched_positions=places[:, :3],
            batched_colors=self._colors[indices],
            flat_shading=True,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )
        self._batches.append((batch, indices))

    def _nodes(self) -> list[Any]:
        return [*self._meshes.values(), *(batch for batch, _ in self._batches)]

    def show(self, snapshot: Snapshot) -> None:
        """Update poses and colors, which show which agents see each object."""
        for frame, pose in zip(self._frames, snapshot.object_poses, strict=True):
            place(frame, pose)
        colors = self._all_colors(snapshot.object_states)
        for index in np.flatnonzero((colors[:-1] != self._colors[:-1]).any(axis=1)).tolist():
            if index in self._meshes:
                self._meshes[index].color = tuple(colors[index].tolist())
        for batch, indices in self._batches:
            if (colors[indices] != self._colors[indices]).any():
                batch.batched_colors = colors[indices]
        self._colors = colors


class AgentMark:
    """An agent's view: a frustum with its image, or the borders of a wide field and the frustum of attention."""

    def __init__(self, scene: SceneApi, agent: Agent, color: tuple[int, int, int]) -> None:
        self._path, self._color = f"/agents/{agent.name}", color
        self._style = {"color": color, "thickness": 0.008, "cast_shadow": False, "receive_shadow": False}
        self._scene = scene
        self.frame = scene.add_frame(self._path, show_axes=False)
        scene.add_label(f"{self._path}/name", agent.name, position=(0, -0.15, 0), anchor="bottom-center")
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
            segments = _borders(agent.camera)
            self._scene.add_line_segments(f"{self._path}/field", segments, self._color, thickness=0.008)
            attention = None if agent.attention is None else as_pinhole(agent.attention)
            if attention is not None:
                self._frustum = _add_frustum(self._scene, f"{self._path}/frustum", attention, **self._style)
        elif agent.pinhole is not None:
            self._frustum = _add_frustum(self._scene, f"{self._path}/frustum", agent.pinhole, **self._style)
        else:
            self._scene.add_frame(f"{self._path}/axes", axes_length=0.2, axes_radius=0.008)


class CloudNode:
    """The point cloud."""

    def __init__(self, scene: SceneApi, state: ViewerState) -> None:
        self._points = np.zeros((0, 3), dtype=np.float32)
        self.node = scene.add_point_cloud(
            "/cloud",
            self._points,
            self._points.astype(np.uint8),
            point_size=_POINT_SIZE * state.cloud.spacing,
            point_shape="circle",
            point_shading="flat",
            precision="float32",
        )

    def show(self, snapshot: Snapshot) -> None:
        """Update points and colors; points are sent only if they changed."""
        if not np.array_equal(snapshot.points, self._points):
            self.node.points = self._points = snapshot.points
        self.node.colors = snapshot.point_colors


class SightNode:
    """Lines from agents to hidden objects: in the agent's color up to the occluder, gray behind it."""

    def __init__(self, scene: SceneApi, names: Sequence[str]) -> None:
        """Store the agents' names and colors."""
        self._scene, self._colors = scene, agent_colors(names)
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
                "/sight", segments.astype(np.float32), colors.astype(np.uint8), thickness=0.012
            )


class ProposalMark:
    """The frustum of a camera at the proposed pose."""

    def __init__(self, scene: SceneApi) -> None:
        """Start without a frustum."""
        self._scene = scene
        self.node: Any = None

    def show(self, camera: Camera, pose: NDArray[np.float64]) -> None:
        """Show the frustum at a pose, row ``x y z qx qy qz qw``."""
        self.clear()
        self.node = _add_frustum(self._scene, "/proposal", camera, color=STATE_COLORS[State.BOTH], thickness=0.012)
        place(self.node, pose)

    def clear(self) -> None:
        """Remove the frustum."""
        if self.node is not None:
            self.node.remove()
            self.node = None


def _add_frustum(scene: SceneApi, path: str, camera: Camera, **style: Any) -> Any:
    aspect = (camera.width / camera.fx) / (camera.height / camera.fy)
    return scene.add_camera_frustum(path, fov=camera.vfov, aspect=aspect, scale=_FRUSTUM_SIZE, **style)


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


class Gizmos(_Nodes):
    """All handles of a page. `dragged` is called after the state is updated with a handle's pose."""

    def __init__(self, scene: SceneApi, state: ViewerState, dragged: Callable[[], None]) -> None:
        self._state, self._dragged = state, dragged
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
