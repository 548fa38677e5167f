# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What stands in the page's 3D picture: meshes, agents, and the cloud."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.camera import Camera
from warpvis.visibility import Agent, FieldOfView, State
from warpvis.viz import STATE_COLORS

if TYPE_CHECKING:
    from viser import SceneApi

    from warpvis.viewer._state import Look, ViewerState

AGENT_COLORS = (STATE_COLORS[State.FIRST], STATE_COLORS[State.SECOND])
"""Colours of the first agent and of the second, which those of "this one only" are, too."""

_FRUSTUM_SIZE, _FIELD_SIZE = 0.28, 0.45
_ARC = 24
_HIDDEN = (150, 150, 150)
_DARK_GROUND = (52, 52, 56)
_POINT_SIZE = 0.32
"""Of a point, in spacings."""


class Meshes:
    """The scene's objects. Those that share a mesh are sent once; what moves hangs on a frame of its own."""

    def __init__(self, scene: SceneApi, state: ViewerState, *, dark: bool = False) -> None:
        """Add them to the page."""
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
        """Return the colour of every object; on a dark page the ground is dark."""
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
        assert mesh is not None  # they share it
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

    @property
    def visible(self) -> bool:
        """Whether they are shown."""
        return all(node.visible for node in self._nodes())

    @visible.setter
    def visible(self, visible: bool) -> None:
        for node in self._nodes():
            node.visible = visible

    def _nodes(self) -> list[Any]:
        return [*self._meshes.values(), *(batch for batch, _ in self._batches)]

    def show(self, look: Look) -> None:
        """Put them where they are, in the colours of who sees them."""
        for frame, pose in zip(self._frames, look.object_poses, strict=True):
            place(frame, pose)
        colors = self._all_colors(look.object_states)
        for index in np.flatnonzero((colors[:-1] != self._colors[:-1]).any(axis=1)).tolist():
            if index in self._meshes:
                self._meshes[index].color = tuple(colors[index].tolist())
        for batch, indices in self._batches:
            if (colors[indices] != self._colors[indices]).any():
                batch.batched_colors = colors[indices]
        self._colors = colors


class AgentMark:
    """An agent's view: a frustum with its picture, or of a wide field its borders and what it attends to."""

    def __init__(self, scene: SceneApi, agent: Agent, color: tuple[int, int, int]) -> None:
        """Add it to the page."""
        self._path, self._color = f"/agents/{agent.name}", color
        self._scene = scene
        self.frame = scene.add_frame(self._path, show_axes=False)
        scene.add_label(f"{self._path}/name", agent.name, position=(0, -0.15, 0), anchor="bottom-center")
        self._camera: object = None
        self._frustum: Any = None

    def show(self, agent: Agent, picture: NDArray[np.uint8]) -> None:
        """Put it where the agent is, with what it sees."""
        place(self.frame, agent.poses[0])
        if agent.camera != self._camera:
            self._draw(agent)
            self._camera = agent.camera
        if isinstance(agent.camera, Camera):
            self._frustum.image = picture

    def _draw(self, agent: Agent) -> None:
        if isinstance(agent.camera, FieldOfView):
            segments = _borders(agent.camera)
            self._scene.add_line_segments(f"{self._path}/field", segments, self._color, thickness=0.008)
            if isinstance(agent.attention, Camera):
                self._frustum = self._add_frustum(agent.attention)
        elif isinstance(agent.camera, Camera):
            self._frustum = self._add_frustum(agent.camera)
        else:
            self._scene.add_frame(f"{self._path}/axes", axes_length=0.2, axes_radius=0.008)

    def _add_frustum(self, camera: Camera) -> Any:
        aspect = (camera.width / camera.fx) / (camera.height / camera.fy)
        return self._scene.add_camera_frustum(
            f"{self._path}/frustum",
            fov=camera.vfov,
            aspect=aspect,
            scale=_FRUSTUM_SIZE,
            color=self._color,
            thickness=0.008,
            cast_shadow=False,
            receive_shadow=False,
        )


class CloudNode:
    """The cloud of points."""

    def __init__(self, scene: SceneApi, state: ViewerState) -> None:
        """Add it to the page, empty."""
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

    def show(self, look: Look) -> None:
        """Show the points in their colours; only what changed is sent."""
        if not np.array_equal(look.points, self._points):
            self.node.points = self._points = look.points
        self.node.colors = look.point_colors


class SightNode:
    """Lines from eyes to what is hidden: as far as they see in the agent's colour, and on in grey."""

    def __init__(self, scene: SceneApi, names: Sequence[str]) -> None:
        """Add it to the page, empty."""
        self._scene, self._colors = scene, dict(zip(names, AGENT_COLORS, strict=False))
        self._node: Any = None
        self._segments = np.zeros((0, 2, 3))
        self.visible = True

    def show(self, look: Look) -> None:
        """Show the lines."""
        lines = look.lines if self.visible else ()
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
    """The frustum of a camera at a pose that was proposed."""

    def __init__(self, scene: SceneApi) -> None:
        """Show nothing yet."""
        self._scene = scene
        self.node: Any = None

    def show(self, camera: Camera, pose: NDArray[np.float64]) -> None:
        """Show it at a pose, row ``x y z qx qy qz qw``."""
        self.clear()
        aspect = (camera.width / camera.fx) / (camera.height / camera.fy)
        self.node = self._scene.add_camera_frustum(
            "/proposal",
            fov=camera.vfov,
            aspect=aspect,
            scale=_FRUSTUM_SIZE,
            color=STATE_COLORS[State.BOTH],
            thickness=0.012,
        )
        place(self.node, pose)

    def clear(self) -> None:
        """Show nothing."""
        if self.node is not None:
            self.node.remove()
            self.node = None


def place(node: Any, pose: NDArray[np.floating]) -> None:
    """Put a node at a pose, row ``x y z qx qy qz qw``; nothing is sent if it is there already."""
    position, wxyz = pose[:3], pose[[6, 3, 4, 5]]
    if not np.array_equal(position, node.position):
        node.position = position
    if not np.array_equal(wxyz, node.wxyz):
        node.wxyz = wxyz


def _borders(field: FieldOfView) -> NDArray[np.float64]:
    """Draw a wide field's width and height as two arcs with spokes, segments of the OpenCV frame, ``(n, 2, 3)``."""
    half = min(field.hfov / 2, math.pi)
    sides = np.linspace(-half, half, _ARC + 1)
    level = np.stack([np.sin(sides), np.zeros_like(sides), np.cos(sides)], axis=1)
    heights = np.linspace(-field.down, field.up, _ARC + 1)
    upright = np.stack([np.zeros_like(heights), -np.sin(heights), np.cos(heights)], axis=1)
    segments = [np.stack([arc[:-1], arc[1:]], axis=1) for arc in (level, upright)]
    spokes = np.stack([np.zeros((4, 3)), np.stack([level[0], level[-1], upright[0], upright[-1]])], axis=1)
    return _FIELD_SIZE * np.concatenate([*segments, spokes])
