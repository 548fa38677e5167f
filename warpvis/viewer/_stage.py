# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The viewer's copy of a scene, in which the objects that a user may drag are movable, and frames to play in it."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.frames import Frames
from warpvis.core.checks import as_items
from warpvis.core.labels import Label
from warpvis.errors import ArrayError, SceneError
from warpvis.scene import Mesh, Scene, SceneObject, require_scene
from warpvis.scene.worlds import pose_columns

_DRAGGABLE_LABELS = (Label.OBJECT, Label.HUMAN, Label.ROBOT)
_MAX_DRAGGABLE = 40


@dataclass(frozen=True, eq=False)
class Stage:
    """A scene in which agents' bodies and objects can be moved without rebuilding acceleration structures."""

    scene: Scene
    """Scene with the same object names and indices as the original one."""
    handles: tuple[str, ...]
    """Names of the objects that a user may drag."""
    object_poses: NDArray[np.float64] = field(repr=False)
    """Initial poses of the movable objects, rows ``x y z qx qy qz qw``, ``(M, 7)``."""

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
        poses = [objects[index].pose for index in copy.movable]
        rows = np.array(poses, dtype=np.float64).reshape(-1, 7)
        return cls(copy, tuple(draggable), rows)

    @cached_property
    def columns(self) -> NDArray[np.int32]:
        """Row of `object_poses` that moves each object, ``(objects,)``; -1 for static objects."""
        return pose_columns(self.scene)

    def column(self, name: str) -> int:
        """Return the row of `object_poses` that moves an object; -1 if it is static."""
        return int(self.columns[self.scene.index(name)])

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
