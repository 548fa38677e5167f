# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The viewer's copy of a scene with movable objects, or of a MuJoCo model with joints, and frames to play in it."""

from __future__ import annotations

import fnmatch
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.frames import Frames
from warpvis.cameras.pinhole import Camera, require_camera
from warpvis.core.checks import as_items
from warpvis.core.labels import Label, LabelInput, LabelRules
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.errors import ArrayError, SceneError
from warpvis.scene import Mesh, Scene, SceneObject, require_scene
from warpvis.scene.worlds import pose_columns
from warpvis.visibility import Agent

if TYPE_CHECKING:
    import mujoco

    from warpvis.mujoco import MujocoScene

_DRAGGABLE_LABELS = (Label.OBJECT, Label.HUMAN, Label.ROBOT)
_MAX_DRAGGABLE = 40

_UNNAMED = "*unnamed*"
_UNLIMITED = {"hinge": np.pi, "slide": 1.0}
_PICTURE = (320, 240)


@dataclass(frozen=True, eq=False)
class Stage:
    """A scene in which agents' bodies and objects can be moved without rebuilding acceleration structures."""

    scene: Scene
    """Scene with the same object names and indices as the original one."""
    handles: tuple[str, ...]
    """Names of the objects that a user may drag."""
    object_poses: NDArray[np.float64] = field(repr=False)
    """Initial poses of the movable objects, rows ``x y z qx qy qz qw``, ``(M, 7)``."""
    colored: Scene = field(repr=False)
    """Scene for colors, with the same movable objects: `scene`, or the one from whose objects it was joined."""
    parts: Mapping[str, Sequence[SceneObject]] = field(default_factory=dict, repr=False)
    """Objects of `colored` from which each object was joined, by name; others are objects of both scenes."""

    @classmethod
    def from_scene(cls, scene: Scene, bodies: Iterable[str] = (), movable: Sequence[str] | None = None) -> Stage:
        """Copy a scene and make static objects movable, with origins at the centers of their boxes.

        Agents' `bodies` move with the agents and cannot be dragged; for `movable`, see `ViewerState`.
        """
        items = list(require_scene(scene).require_objects())
        body_names = {scene.objects[scene.index(name)].name for name in bodies}
        draggable = _choose_draggable(items, body_names, movable)
        moving = body_names | set(draggable)
        objects = [_make_movable(item) if item.name in moving and not item.movable else item for item in items]
        copy = Scene(device=scene.device, up=scene.up, label_names=scene.label_names, ground_labels=scene.ground_labels)
        copy.replace_objects(objects)
        copy.lights, copy.background = scene.lights, scene.background
        poses = [objects[index].pose for index in copy.movable]
        rows = np.array(poses, dtype=np.float64).reshape(-1, 7)
        return cls(copy, tuple(draggable), rows, copy)

    @cached_property
    def columns(self) -> NDArray[np.int32]:
        """Row of `object_poses` that moves each object, ``(objects,)``; -1 for static objects."""
        return pose_columns(self.scene)

    def column(self, name: str) -> int:
        """Return the row of `object_poses` that moves an object; -1 if it is static."""
        return int(self.columns[self.scene.index(name)])

    def parts_of(self, name: str) -> Sequence[SceneObject]:
        """Return the objects of `colored` that an object consists of."""
        return self.parts[name] if name in self.parts else (self.scene[name],)

    def mesh(self, name: str) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return the vertices of an object in its mesh frame [m], ``(n, 3)``, and its triangles, ``(m, 3)``."""
        item = self.scene[name]
        return item.frame_vertices, item.faces


def _choose_draggable(items: Sequence[SceneObject], bodies: set[str], movable: Sequence[str] | None) -> list[str]:
    """Return the names of the objects that may be dragged."""
    if movable is None:
        chosen = [item.name for item in items if item.label in _DRAGGABLE_LABELS or item.pose is not None]
        chosen = [name for name in chosen if name not in bodies]
        return chosen if len(chosen) <= _MAX_DRAGGABLE else []
    patterns = as_items(movable, "movable", SceneError)
    for pattern in patterns:
        if not isinstance(pattern, str) or not any(fnmatch.fnmatchcase(item.name, pattern) for item in items):
            raise SceneError(f"{pattern!r} in movable matches no object of the scene")
    free = [item for item in items if item.parent is None and item.name not in bodies]
    return [item.name for item in free if any(fnmatch.fnmatchcase(item.name, pattern) for pattern in patterns)]


def _make_movable(item: SceneObject) -> SceneObject:
    """Return a static object as a movable one, with its origin at the center of its box."""
    low, high = item.bounds.astype(np.float64)
    center = (low + high) / 2
    pose = np.array([*center, 0, 0, 0, 1], dtype=np.float32)
    local = (item.vertices - pose[:3]).astype(np.float32)
    return SceneObject(item.name, item.label, Mesh(local, item.faces), pose, lazy_appearance=item.lazy_appearance)


def check_frames(frames: Frames | None, movable_names: Sequence[str]) -> Frames | None:
    """Return frames if they match a scene with these movable objects."""
    if frames is None:
        return None
    if not isinstance(frames, Frames) or not len(frames):
        raise ArrayError(f"frames must be a non-empty warpvis.Frames, got {type(frames).__name__}")
    num_objects = 0 if frames.object_poses is None else frames.object_poses.shape[1]
    if num_objects and num_objects != len(movable_names):
        raise ArrayError(
            f"frames must have poses of the scene's {len(movable_names)} movable objects, got {num_objects}"
        )
    return frames


def objects_in_frame(frames: Frames, number: int) -> NDArray[np.float32]:
    """Return the poses of the movable objects in a frame, ``(M, 7)``; ``(0, 7)`` if they keep their initial poses."""
    if frames.object_poses is None:
        return np.zeros((0, 7), dtype=np.float32)
    return frames.object_poses[frames.world_of(number)]


@dataclass(frozen=True)
class Joint:
    """A joint with one degree of freedom."""

    name: str
    low: float
    """Minimum value [rad] or [m]."""
    high: float
    """Maximum value [rad] or [m]."""
    address: int
    """Index of its value in qpos."""


class MujocoStage:
    """A MuJoCo model as a scene in which the geoms of a body form one object, moved by the model's joints.

    Unless labels are given, bodies in a kinematic tree with a free root are labeled as objects, and other bodies with
    joints as robots.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData | None = None, *, labels: LabelInput | None = None
    ) -> None:
        """Create a stage from a model.

        Args:
            model: The model.
            data: Initial joint positions; by default those of the model's first keyframe, if it has one.
            labels: Labels by name or pattern of geoms or bodies, as for `warpvis.mujoco.scene_from_mujoco`.
        """
        import mujoco

        from warpvis.mujoco import scene_from_mujoco

        if not isinstance(model, mujoco.MjModel):
            raise SceneError(f"model must be a mujoco.MjModel, got {type(model).__name__}")
        if data is not None and (not isinstance(data, mujoco.MjData) or len(data.qpos) != model.nq):
            raise SceneError(f"data must be a mujoco.MjData of the model, got {type(data).__name__}")
        self.model, self.data = model, mujoco.MjData(model)
        if data is not None:
            for name in ("qpos", "mocap_pos", "mocap_quat"):
                getattr(self.data, name)[:] = getattr(data, name)
        elif model.nkey:
            mujoco.mj_resetDataKeyframe(model, self.data, 0)
        mujoco.mj_kinematics(model, self.data)
        mujoco.mj_comPos(model, self.data)
        mujoco.mj_camlight(model, self.data)
        self._start = self.data.qpos.copy()
        self._loaded: MujocoScene = scene_from_mujoco(model, labels=labels)
        self._patterns = list(LabelRules.of(labels).labels)
        self.joints = self._scalar_joints()
        self._free: dict[str, tuple[int, NDArray[np.float64]]] = {}
        """For each object with a free joint: the index of its first qpos value, and object to body, ``(4, 4)``."""
        self.stage = self._build()

    def set_joint(self, name: str, value: float) -> None:
        """Set a joint's value [rad] or [m]."""
        self.data.qpos[self._joint(name).address] = value
        self._move()

    def value(self, name: str) -> float:
        """Return a joint's value [rad] or [m]."""
        return float(self.data.qpos[self._joint(name).address])

    def can_place(self, name: str) -> bool:
        """Return whether an object has a free joint."""
        return name in self._free

    def place(self, name: str, row: NDArray[np.float64]) -> None:
        """Set the pose of an object with a free joint, a row ``x y z qx qy qz qw``; attached bodies follow."""
        address, inside = self._free[name]
        body = poses_to_opencv((poses_to_matrices(row[None])[0] @ np.linalg.inv(inside))[None])[0]
        self.data.qpos[address : address + 7] = body[[0, 1, 2, 6, 3, 4, 5]]
        self._move()

    def reset(self) -> None:
        """Reset all joints to their initial positions."""
        self.data.qpos[:] = self._start
        self._move()

    def object_poses(self) -> NDArray[np.float64]:
        """Return the poses of the movable objects, rows ``x y z qx qy qz qw``, ``(M, 7)``."""
        from warpvis.mujoco import geom_poses

        return geom_poses(self.data, self._loaded).astype(np.float64).reshape(-1, 7)

    def cameras(self) -> list[str]:
        """Return the names of the model's cameras."""
        return [self.model.camera(index).name for index in range(self.model.ncam)]

    def agent(self, name: str, camera: str) -> Agent:
        """Create an agent from one of the model's cameras."""
        if not isinstance(camera, str) or camera not in self.cameras():
            raise SceneError(f"the model has no camera {camera!r}; it has {', '.join(self.cameras()) or 'none'}")
        lens, pose = self.eyes(camera)
        return Agent(name, lens, pose)

    def eyes(self, name: str) -> tuple[Camera, NDArray[np.float64]]:
        """Return one of the model's cameras, with 320 x 240 pixels, and its current pose, ``(7,)``."""
        from warpvis.mujoco import camera_from_mujoco, camera_poses

        index = self.model.camera(name).id
        pose = camera_poses(self.data, self.model, [index])[0]
        return require_camera(camera_from_mujoco(self.model, index, *_PICTURE)), pose.astype(np.float64)

    def _move(self) -> None:
        import mujoco

        mujoco.mj_kinematics(self.model, self.data)

    def _joint(self, name: str) -> Joint:
        for joint in self.joints:
            if isinstance(name, str) and joint.name == name:
                return joint
        raise SceneError(f"the model has no hinge or slide joint {name!r}")

    def _scalar_joints(self) -> list[Joint]:
        import mujoco

        kinds = {int(mujoco.mjtJoint.mjJNT_HINGE): "hinge", int(mujoco.mjtJoint.mjJNT_SLIDE): "slide"}
        joints = []
        for index in range(self.model.njnt):
            kind = kinds.get(int(self.model.jnt_type[index]))
            if kind is None:
                continue
            low, high = self.model.jnt_range[index]
            if not self.model.jnt_limited[index]:
                low, high = -_UNLIMITED[kind], _UNLIMITED[kind]
            name = self.model.joint(index).name or f"joint {index}"
            joints.append(Joint(name, float(low), float(high), int(self.model.jnt_qposadr[index])))
        return joints

    def _build(self) -> Stage:
        """Build the stage, with the geoms of each body joined to one object."""
        items = list(self._loaded.scene.objects)
        movable_parts, static_parts = defaultdict(list), defaultdict(list)
        for index, item in enumerate(items):
            if item.movable:
                movable_parts[index if item.parent is None else item.parent].append(item)
            else:
                static_parts[self._group(index, item)].append(item)
        names: set[str] = set()
        objects: list[SceneObject] = []
        joined: dict[str, Sequence[SceneObject]] = {}
        for (name, label), parts in static_parts.items():
            mesh = _joined([(part.vertices, part.faces) for part in parts])
            objects.append(SceneObject(_unique_name(name, names), label, Mesh(*mesh)))
            joined[objects[-1].name] = parts
        for root in self._loaded.scene.movable:
            objects.append(self._joined_body(root, movable_parts[root], names))
            joined[objects[-1].name] = movable_parts[root]
        scene = Scene(label_names=self._loaded.scene.label_names, ground_labels=self._loaded.scene.ground_labels)
        scene.replace_objects(objects)
        return Stage(scene, tuple(self._free), self.object_poses(), self._loaded.scene, joined)

    def _joined_body(self, root: int, parts: Sequence[SceneObject], names: set[str]) -> SceneObject:
        item = self._loaded.scene.objects[root]
        body = self._body(root)
        label = item.label
        if label == Label.OBSTACLE and not self._has_given_label(root):
            label = Label.OBJECT if self._is_free(int(self.model.body_rootid[body])) else Label.ROBOT
        name = _unique_name(self.model.body(body).name.rstrip("/") or item.name, names)
        self._note_free(name, body, root)
        if len(parts) == 1:
            return replace(item, name=name, label=label)
        mesh = _joined([(part.frame_vertices, part.faces) for part in parts])
        return SceneObject(name, label, Mesh(*mesh), item.pose)

    def _note_free(self, name: str, body: int, root: int) -> None:
        """Record the object of a body with a free joint."""
        if not self._is_free(body):
            return
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = self.data.xmat[body].reshape(3, 3), self.data.xpos[body]
        placed = poses_to_matrices(self.object_poses()[self._loaded.scene.movable.index(root)][None])[0]
        address = int(self.model.jnt_qposadr[self.model.body_jntadr[body]])
        self._free[name] = (address, np.linalg.inv(frame) @ placed)

    def _group(self, index: int, item: SceneObject) -> tuple[str, int]:
        """Return the name and label by which static geoms are joined: the name of the body, or of a world's geom."""
        body = self._body(index)
        if body == 0 and not fnmatch.fnmatchcase(item.name, _UNNAMED):
            return item.name, item.label
        return self.model.body(body).name.rstrip("/") or item.name, item.label

    def _body(self, index: int) -> int:
        """Return the body that a geom moves with, through welds."""
        body = int(self.model.geom_bodyid[self._loaded.geom_ids[index]])
        return int(self.model.body_weldid[body]) or body

    def _is_free(self, body: int) -> bool:
        """Return whether a body has a free joint."""
        import mujoco

        joint = int(self.model.body_jntadr[body])
        return joint >= 0 and self.model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE

    def _has_given_label(self, index: int) -> bool:
        """Return whether the given labels match the name of an object or its body."""
        body = self.model.geom_bodyid[self._loaded.geom_ids[index]]
        names = (self._loaded.scene.objects[index].name, self.model.body(body).name)
        return any(fnmatch.fnmatchcase(word, pattern) for word in names for pattern in self._patterns)


def as_mujoco_stage(scene: object) -> MujocoStage | None:
    """Return the stage of a MuJoCo model, or None for other scenes. Import MuJoCo only for a model."""
    if type(scene).__module__.partition(".")[0] != "mujoco":
        return None
    import mujoco

    return MujocoStage(scene) if isinstance(scene, mujoco.MjModel) else None


def _joined(
    meshes: Iterable[tuple[NDArray[np.float32] | None, NDArray[np.int32]]],
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Concatenate meshes in the same frame."""
    vertices, faces, count = [], [], 0
    for corners, triangles in meshes:
        assert corners is not None  # all meshes of a group are movable, or none is
        vertices.append(corners)
        faces.append(triangles + count)
        count += len(corners)
    return np.concatenate(vertices).astype(np.float32), np.concatenate(faces).astype(np.int32)


def _unique_name(name: str, taken: set[str]) -> str:
    """Return a unique name, with a numeric suffix if necessary, and add it to `taken`."""
    unique, number = name, 1
    while unique in taken:
        unique, number = f"{name}_{number}", number + 1
    taken.add(unique)
    return unique
