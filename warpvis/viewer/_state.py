# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""State of the viewer: movable agents and objects, and everything that the page shows, without a browser."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.frames import Frames
from warpvis.cameras.pinhole import Camera, require_camera
from warpvis.core.checks import as_items, is_number, is_whole
from warpvis.core.labels import Label
from warpvis.core.poses import (
    QuaternionOrder,
    check_quaternion,
    check_up,
    poses_to_matrices,
    quaternion_product,
    read_pose,
)
from warpvis.errors import ArrayError, PoseError, SceneError
from warpvis.maps import label_colors
from warpvis.rendering import DepthSensor, require_sensor
from warpvis.scene import Scene
from warpvis.viewer._materials import has_colors
from warpvis.viewer._picking import Picked, Picker, find_meant
from warpvis.viewer._pictures import (
    AgentPicture,
    PictureKind,
    Seen,
    SightLine,
    SightLines,
    SurfaceCloud,
)
from warpvis.viewer._stage import MujocoStage, Stage, as_mujoco_stage, check_frames, objects_in_frame
from warpvis.viewer._tables import Row, table_rows
from warpvis.visibility import Agent, Candidate, Eyes, Perspective, State, perspective
from warpvis.viz import STATE_COLORS

if TYPE_CHECKING:
    import mujoco

CloudKind = Literal["visibility", "labels", "none"]

_MAX_TABLE_OBJECTS = 16
_MAX_POINTS = 1_000_000
_LIFT = 0.35
"""Offset of displayed points from their surfaces, relative to the spacing of points."""
_GRAY = {Label.GROUND: (222, 222, 222), Label.OBSTACLE: (165, 165, 165), Label.HUMAN: (105, 105, 105)}
_BACKGROUND = (70, 70, 70)
_NO_POINTS = np.zeros((0, 3), dtype=np.float32)
_NO_STATES = np.zeros(0, dtype=np.uint8)
_STATE_TABLE = np.array([STATE_COLORS[state] for state in State], dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """Results for one situation."""

    agents: tuple[Agent, ...]
    """Agents at their current poses, with their eyes turned."""
    object_poses: NDArray[np.float64] = field(repr=False)
    """Poses of the movable objects, rows ``x y z qx qy qz qw``, ``(M, 7)``."""
    seen: Perspective = field(repr=False)
    """Visibility of the objects in the table."""
    rows: tuple[Row, ...] = field(repr=False)
    """Rows of the table."""
    pictures: tuple[NDArray[np.uint8], ...] = field(repr=False)
    """Picture of each agent's view, ``(h, w, 3)``, or color next to depth, ``(h, 2 w + 4, 3)``."""
    views: tuple[Seen, ...] = field(repr=False)
    """Depth, points, labels and objects of the pixels of each picture."""
    lines: tuple[SightLine, ...] = field(repr=False)
    """Lines of sight from agents to hidden objects."""
    points: NDArray[np.float32] = field(repr=False)
    """Point cloud [m], ``(N, 3)``: points of all surfaces, or of the first agent's depth image."""
    point_colors: NDArray[np.uint8] = field(repr=False)
    """RGB colors of the points, ``(N, 3)``."""
    states: NDArray[np.uint8] = field(repr=False)
    """A `State` for each point of a surface, ``(N,)``; empty for points of a depth image."""
    picked: Picked | None
    """Who sees the picked point, and why others do not; None without one."""
    meant: Mapping[str, tuple[Candidate, ...]] = field(repr=False)
    """Objects that each person may mean, most likely first, by name of the person."""
    seconds: float
    """Computation time [s]."""

    @property
    def object_states(self) -> dict[str, State]:
        """Whether the first agent and any other see each object of the table, by object name."""
        return {row.name: row.state for row in self.rows}


class ViewerState:
    """A scene with one or more agents, in which agents and objects can be moved; `snapshot` computes what they see.

    Methods may be called from any thread.

    Example:
        >>> state = ViewerState(scene, [robot, human])
        >>> state.move_object("ball", (1, 0, 0.1, 0, 0, 0, 1))
        >>> state.snapshot().rows
    """

    def __init__(
        self,
        scene: Scene | mujoco.MjModel | MujocoStage,
        agents: Sequence[Agent],
        *,
        movable: Sequence[str] | None = None,
        objects: Sequence[str] | None = None,
        frames: Frames | None = None,
        points: int = 20_000,
    ) -> None:
        """Set up the state.

        Args:
            scene: The scene; it is copied. For a MuJoCo model, the geoms of each body form one object, moved by joints.
            agents: One or more agents with one pose each: a robot, then people. Colors and states compare the first
                agent with all others.
            movable: Names or patterns of the objects that may be moved; by default objects that are labeled as an
                object, a person or a robot, or are movable already; none if these are more than 40.
            objects: Names of the objects in the table; by default the first 16 objects except the ground, and if there
                are more, without obstacles and with robots last.
            frames: Frames to play, with poses of the first agent and the scene's movable objects. For a dataset of
                `warpvis.open_dataset`, pass its `frames`.
            points: Approximate number of points of surfaces in the cloud.
        """
        items = as_items(agents, "agents", SceneError)
        wrong = [type(agent).__name__ for agent in items if not isinstance(agent, Agent)]
        if wrong or not items:
            raise SceneError(f"agents must be one or more of warpvis.Agent, got {', '.join(wrong) or 'none'}")
        for agent in items:
            if len(agent.poses) != 1:
                raise SceneError(f"{agent.name!r} must have one pose to begin with, got {len(agent.poses)}")
        bodies = [name for agent in items for name in agent.body]
        self.model = scene if isinstance(scene, MujocoStage) else as_mujoco_stage(scene)
        """The MuJoCo model whose joints move the objects; None for other scenes."""
        self.stage = Stage.from_scene(scene, bodies, movable) if self.model is None else self.model.stage  # type: ignore[arg-type]  # raises for other types
        if self.model is not None and movable is not None:
            raise SceneError("movable must be None for a MuJoCo model, whose objects with a free joint can be dragged")
        self.scene = self.stage.scene
        in_opencv_axes = [replace(a, pose=a.poses[0].copy(), convention="opencv", quaternion="xyzw") for a in items]
        self.agents: dict[str, Agent] = {agent.name: agent for agent in in_opencv_axes}
        if len(self.agents) < len(items):
            names = [agent.name for agent in items]
            repeated = next(name for name in names if names.count(name) > 1)
            raise SceneError(f"agents must have different names, got {repeated!r} more than once")
        self.initial_agents = dict(self.agents)
        """Agents at their initial poses."""
        self.object_poses = self.stage.object_poses.copy()
        self._movable_names = [scene.objects[index].name for index in scene.movable] if isinstance(scene, Scene) else []
        self.frames = check_frames(frames, self._movable_names)
        """Frames to play, or None."""
        self.frame = 0
        """Index of the frame that was shown last."""
        self.table_objects = self._choose_table_objects(objects, bodies)
        if not is_whole(points) or not 0 < points <= _MAX_POINTS:
            raise ArrayError(f"points must be a whole number from 1 to {_MAX_POINTS}, got {points!r}")
        self.cloud = SurfaceCloud(self.stage, int(points))
        self.has_colors = has_colors(self.stage.colored)
        """Whether objects have appearances, so that agents have color images."""
        self.picture_kind: PictureKind = "both" if self.has_colors else "depth"
        self.cloud_kind: CloudKind = "visibility"
        self._sight = SightLines(self.stage)
        self._vertical = check_up(self.scene.up)
        self._lock = threading.RLock()
        self._pictures: dict[str, AgentPicture] = {}
        self._sensor: DepthSensor | None = None
        self._picker, self._eyes = Picker(self.stage), Eyes()

    # Changes of the state.

    def move_agent(self, name: str, pose: ArrayLike, *, quaternion: QuaternionOrder = "xyzw") -> None:
        """Set the pose of an agent's eyes; its body follows horizontally and rotates about the vertical axis.

        Args:
            name: Name of the agent.
            pose: Camera to world, ``x y z qx qy qz qw`` in OpenCV axes, or a 4x4 matrix.
            quaternion: Order of the quaternion in a pose of 7 numbers, ``"xyzw"`` or ``"wxyz"``.
        """
        check_quaternion(quaternion)
        row = read_pose(pose, quaternion, name=f"pose of {name!r}")
        with self._lock:
            agent = self._agent(name)
            before = agent.poses[0]
            self.agents[name] = replace(agent, pose=row)
            for column in {self.stage.column(body) for body in agent.body}:
                self.object_poses[column] = self._moved_body(self.object_poses[column], before, row)

    def raise_agent(self, name: str, height: float) -> None:
        """Set the height of an agent's eyes [m] without moving its body."""
        if not is_number(height) or not math.isfinite(height):
            raise PoseError(f"height of {name!r} must be a finite number of meters, got {height!r}")
        with self._lock:
            row = self._agent(name).poses[0].copy()
            row[self._vertical] = height
            self.agents[name] = replace(self._agent(name), pose=row)

    def height(self, name: str) -> float:
        """Return the height of an agent's eyes [m]."""
        return float(self._agent(name).poses[0, self._vertical])

    def set_camera(self, name: str, camera: Camera) -> None:
        """Set an agent's camera."""
        require_camera(camera, f"camera of {name!r}")
        with self._lock:
            self.agents[name] = replace(self._agent(name), camera=camera)
            self._pictures.pop(name, None)

    def set_sensor(self, sensor: DepthSensor | None) -> None:
        """Set the depth camera model of the agents' depth images; None for exact depth."""
        if sensor is not None:
            require_sensor(sensor)
            for agent in self.agents.values():
                if agent.pinhole is not None:
                    sensor.check(self.scene, agent.camera)
        with self._lock:
            self._sensor = sensor
            self._pictures.clear()

    def move_object(self, name: str, pose: ArrayLike, *, quaternion: QuaternionOrder = "xyzw") -> None:
        """Set the pose of a movable object.

        Args:
            name: Name of the object.
            pose: Object to world, ``x y z qx qy qz qw`` or a 4x4 matrix; `object_pose` returns the current one.
            quaternion: Order of the quaternion in a pose of 7 numbers, ``"xyzw"`` or ``"wxyz"``.
        """
        check_quaternion(quaternion)
        row = read_pose(pose, quaternion, name=f"pose of {name!r}")
        with self._lock:
            column = self._column(name)
            if self.model is None:
                self.object_poses[column] = row
            elif self.model.can_place(name):
                self.model.place(name, row)
                self.object_poses = self.model.object_poses()
            else:
                raise SceneError(f"object {name!r} has no free joint. Set its joints instead")

    def set_joint(self, name: str, value: float) -> None:
        """Set the value of a joint of a MuJoCo model [rad] or [m]."""
        if self.model is None:
            raise SceneError("the scene must be a MuJoCo model to have joints")
        if not is_number(value) or not math.isfinite(value):
            raise ArrayError(f"value of {name!r} must be a number, got {value!r}")
        with self._lock:
            self.model.set_joint(name, float(value))
            self.object_poses = self.model.object_poses()

    def object_pose(self, name: str) -> NDArray[np.float64]:
        """Return the pose of a movable object, a row ``x y z qx qy qz qw``."""
        with self._lock:
            return self.object_poses[self._column(name)].copy()

    def pick(self, point: ArrayLike | None) -> None:
        """Pick a point in the world [m], ``(3,)``: `Snapshot.picked` tells who sees it. None forgets the point."""
        if point is None:
            self._picker.clear()
        else:
            self._picker.pick(point)

    def pick_along(self, origin: ArrayLike, direction: ArrayLike) -> bool:
        """Pick the first point of a surface along a ray in the world, and return whether there is one.

        The point moves with its object.
        """
        with self._lock:
            object_poses = self.object_poses.copy()
        return self._picker.pick_along(origin, direction, object_poses)

    def turn_eyes(self, name: str, right: float, up: float) -> None:
        """Turn an agent's eyes from the axis of its head, with its field of view and its field of attention.

        The gaze of a person is then known, which changes the probabilities of `Snapshot.meant`.

        Args:
            name: Name of the agent.
            right: Angle to the right [rad].
            up: Angle up [rad]. Both angles together must be in the range of the eyes, `ReferenceModel.max_eye_angle`.
        """
        self._eyes.turn(self._agent(name).name, right, up)

    def release_eyes(self, name: str) -> None:
        """Turn an agent's eyes back to the axis of its head, and treat its gaze as not known."""
        self._eyes.release(self._agent(name).name)

    def show_frame(self, number: int) -> None:
        """Move the first agent and the movable objects to their poses in a frame."""
        count = 0 if self.frames is None else len(self.frames)
        if self.frames is None or not is_whole(number) or not 0 <= number < count:
            raise ArrayError(f"frame must be an index from 0 into {count} frames, got {number!r}")
        frames, self.frame = self.frames, int(number)
        with self._lock:
            self.move_agent(next(iter(self.agents)), frames.camera_to_world[self.frame])
            for name, row in zip(self._movable_names, objects_in_frame(frames, self.frame), strict=False):
                self.object_poses[self._column(name)] = row

    def reset(self) -> None:
        """Move all agents and objects to their initial poses, and restore the agents' cameras and eyes."""
        with self._lock:
            self._eyes = Eyes()
            self.agents = dict(self.initial_agents)
            if self.model is not None:
                self.model.reset()
            self.object_poses = self.stage.object_poses.copy()
            self._pictures.clear()

    # Results.

    def snapshot(self) -> Snapshot:
        """Compute what the agents see in the current situation."""
        begin = time.perf_counter()
        with self._lock:
            eyes = self._eyes.angles
            agents = tuple(self._eyes.looking(agent) for agent in self.agents.values())
            object_poses = self.object_poses.copy()
            pictures = [self._picture(agent) for agent in agents]
            kind, cloud_kind = self.picture_kind, self.cloud_kind
        given_poses = object_poses if len(object_poses) else None
        seen = perspective(self.scene, agents, objects=self.table_objects, object_poses=given_poses)
        rows = table_rows(seen)
        colors = self.colors({row.name: row.state for row in rows})
        with_color = self.has_colors and kind in ("color", "both")
        views = [
            picture.render(agent, object_poses, with_color=with_color, hidden=self._hidden_parts(agent))
            for picture, agent in zip(pictures, agents, strict=True)
        ]
        if cloud_kind == "labels":
            points, labels = views[0].cloud()
            point_colors, states = label_colors()[labels], _NO_STATES
        elif cloud_kind == "none":
            points, point_colors, states = _NO_POINTS, _NO_POINTS.astype(np.uint8), _NO_STATES
        else:
            states = self.cloud.states(agents, object_poses, self.cloud.positions(object_poses))
            points = self.cloud.positions(object_poses, _LIFT * self.cloud.spacing)  # slightly above the surfaces
            point_colors = _STATE_TABLE[states]
        return Snapshot(
            agents=agents,
            object_poses=object_poses,
            seen=seen,
            rows=rows,
            pictures=tuple(picture.draw(view, kind, colors) for picture, view in zip(pictures, views, strict=True)),
            views=tuple(views),
            lines=self._sight.find(agents, seen, object_poses),
            points=points,
            point_colors=point_colors,
            states=states,
            picked=self._picker.find(agents, object_poses),
            meant=find_meant(seen, agents, self.stage, list(eyes)),
            seconds=time.perf_counter() - begin,
        )

    def colors(self, states: dict[str, State]) -> NDArray[np.uint8]:
        """Return the RGB color of every object and, last, of pixels without an object, ``(objects + 1, 3)``."""
        bodies = {body for agent in self.agents.values() for body in agent.body}
        rows = []
        for item in self.scene.objects:
            ground = item.label in self.scene.ground_labels
            gray = _GRAY[Label.GROUND if ground else Label.HUMAN if item.name in bodies else Label.OBSTACLE]
            state = None if item.name in bodies else states.get(item.name)
            rows.append(gray if state is None else STATE_COLORS[state])
        return np.array([*rows, _BACKGROUND], dtype=np.uint8)

    def _picture(self, agent: Agent) -> AgentPicture:
        if agent.name not in self._pictures:
            low, high = self.scene.bounds.astype(np.float64)
            sensor = None if agent.pinhole is None else self._sensor
            reach = float(np.linalg.norm(high - low)) / 2
            self._pictures[agent.name] = AgentPicture(self.scene, agent.camera, reach, sensor, self.stage.colored)
        return self._pictures[agent.name]

    def _hidden_parts(self, agent: Agent) -> list[str]:
        """Return the names of the objects of the scene for colors that an agent does not see."""
        return [part.name for name in agent.excluded for part in self.stage.parts_of(name)]

    def _choose_table_objects(self, objects: Sequence[str] | None, bodies: Iterable[str]) -> list[str]:
        """Return the names of the objects in the table."""
        if objects is not None:
            names = as_items(objects, "objects", SceneError)
            return [self.scene.objects[self.scene.index(name)].name for name in names]
        items = [item for item in self.scene.objects if item.label not in self.scene.ground_labels]
        if len(items) > _MAX_TABLE_OBJECTS:
            items = [item for item in items if item.label != Label.OBSTACLE] or items
            items.sort(key=lambda item: item.label == Label.ROBOT)  # a robot may have many links: list them last
        items = items or list(self.scene.objects)
        return [item.name for item in items[:_MAX_TABLE_OBJECTS]]

    def _agent(self, name: str) -> Agent:
        if not isinstance(name, str) or name not in self.agents:
            raise SceneError(f"there is no agent {name!r}; there are {', '.join(map(repr, self.agents))}")
        return self.agents[name]

    def _column(self, name: str) -> int:
        column = self.stage.column(name)
        if column < 0:
            raise SceneError(f"object {name!r} is not movable. Add it to movable")
        return column

    def _moved_body(
        self, body: NDArray[np.float64], before: NDArray[np.float64], after: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Move a body like the eyes, restricted to horizontal translation and rotation about the vertical axis."""
        angle = self._heading(after) - self._heading(before)
        axis = np.zeros(4)
        axis[self._vertical], axis[3] = math.sin(angle / 2), math.cos(angle / 2)
        rotation_pose = np.concatenate([np.zeros(3), axis])
        rotation = poses_to_matrices(rotation_pose[None])[0, :3, :3]
        position = rotation @ (body[:3] - before[:3]) + after[:3]
        position[self._vertical] = body[self._vertical]
        return np.concatenate([position, quaternion_product(axis, body[3:])])

    def _heading(self, pose: NDArray[np.float64]) -> float:
        """Return the heading of a camera about the vertical axis [rad]."""
        forward = poses_to_matrices(pose[None])[0, :3, 2]
        return math.atan2(forward[1], forward[0]) if self._vertical == 2 else math.atan2(forward[0], forward[2])
