# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scene objects of MuJoCo's visual elements other than geoms and sites."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Label
from warpvis.mujoco._model_fields import drawn_number, free_name, shape_count
from warpvis.mujoco._scene import Selection
from warpvis.mujoco._tessellation import Blocks
from warpvis.mujoco._visuals import Paint, VisualKey
from warpvis.scene import Scene, SceneObject

_MAIN_PARTS = "skin", "faces", "capsule"
"""The main, and mostly only, shapes of skins, flexes and tendons."""


@dataclass
class _VisualObject:
    """The data of one object."""

    name: str
    capacity: int
    """Maximum number of blocks."""
    faces: NDArray[np.int32]
    """Faces of one block."""
    vertices: NDArray[np.float32]
    """Vertices of the last update [m], shape ``(capacity * t, 3)``."""
    paint: Paint | None = None
    """The last appearance; None before the first."""
    is_shaded: bool = False
    """Whether the vertices of the last update have normals."""

    def holds(self, blocks: Blocks) -> bool:
        """Return whether the object can represent the blocks with its faces and capacity."""
        count, corners, _ = blocks.vertices.shape
        fits = self.capacity >= count and len(self.vertices) == self.capacity * corners
        return fits and np.array_equal(self.faces, blocks.faces)

    def blocks(self) -> Blocks:
        """Return blocks that reproduce the object."""
        return Blocks(self.vertices.reshape(self.capacity, -1, 3), self.faces)


class VisualObjects:
    """The objects of visual elements, between the geoms and sites of a scene and its added objects.

    Each object is created when it is first drawn, and hidden when it is not drawn. The capacity of an object of several
    shapes, such as the segments of a tendon, is at least doubled when it is exceeded.
    """

    def __init__(self, model: mujoco.MjModel, selection: Selection, scene: Scene) -> None:
        self._model, self._selection, self._scene = model, selection, scene
        self._items: dict[VisualKey, _VisualObject] = {}
        self._shown: set[VisualKey] = set()

    def __len__(self) -> int:
        return len(self._items)

    def meanings(self) -> list[tuple[int, int]]:
        """List id and `mujoco.mjtObj` of every object."""
        return [(key.which, key.kind) for key in self._items]

    def hidden(self, first: int) -> list[int]:
        """List the scene indices of objects that are not drawn now, where `first` is the index of the first object."""
        if len(self._shown) == len(self._items):
            return []
        return [first + place for place, key in enumerate(self._items) if key not in self._shown]

    def state(self) -> dict[VisualKey, Blocks]:
        """Return the blocks with which `update` reproduces the visible objects."""
        return {key: self._items[key].blocks() for key in self._items if key in self._shown}

    def paints(self) -> dict[VisualKey, Paint] | None:
        """Return the appearances with which `update` reproduces the visible objects; None if they have none."""
        found = {key: item.paint for key, item in self._items.items() if key in self._shown and item.is_shaded}
        paints = {key: paint for key, paint in found.items() if paint is not None}
        return paints if len(paints) == len(self._shown) else None

    def update(
        self, drawn: Mapping[VisualKey, Blocks], first: int, paints: Mapping[VisualKey, Paint] | None = None
    ) -> None:
        """Set the shapes of the visible elements, and their appearances if they are given.

        `first` is the scene index of the first object.
        """
        left_out = self._selection.left_out
        shown = {key: blocks for key, blocks in drawn.items() if self._number(key) not in left_out}
        self._shown = set(shown)
        new = {
            key: blocks for key, blocks in shown.items() if key not in self._items or not self._items[key].holds(blocks)
        }
        if new:
            self._make(new, first)
        for key, blocks in shown.items():
            item = self._items[key]
            vertices = blocks.filled_up(item.capacity)
            paint = None if paints is None else paints[key].filled_up(item.capacity)
            stays = key not in new and np.array_equal(vertices, item.vertices)
            if not stays or (paint is not None and not item.is_shaded):
                normals = None if paint is None else paint.normals
                self._scene.update_vertices(item.name, vertices, normals=normals)
                item.vertices, item.is_shaded = vertices, paint is not None
            if paint is not None and not (item.paint is not None and paint.looks_like(item.paint)):
                self._scene.set_appearance(item.name, paint.appearance(len(item.faces)))
            item.paint = paint or item.paint

    def _make(self, new: Mapping[VisualKey, Blocks], first: int) -> None:
        """Create or rebuild objects."""
        scene, draft = self._scene, Scene()
        objects = scene.objects
        mine = dict(zip(self._items, objects[first:], strict=False))
        added = objects[first + len(mine) :]
        taken = {item.name for item in objects} | set(self._selection.names[: shape_count(self._model)])
        for key, blocks in new.items():
            before, count = self._items.get(key), len(blocks.vertices)
            capacity = count if before is None or count <= before.capacity else max(count, 2 * before.capacity)
            name = free_name(self._name(key), taken) if before is None else before.name
            taken.add(name)
            vertices = blocks.filled_up(capacity)
            draft.add((vertices, blocks.all_faces(capacity)), name=name, label=self._label(key), movable=True)
            self._items[key] = _VisualObject(name, capacity, np.array(blocks.faces), vertices)
            mine[key] = draft[name]
        put_objects(scene, [*objects[:first], *mine.values(), *added], names_of_parents(objects))

    def _number(self, key: VisualKey) -> int | None:
        return drawn_number(self._model, key.kind, key.which)

    def _name(self, key: VisualKey) -> str:
        number = self._number(key)
        if number is None:
            return f"{mujoco.mju_type2Str(key.kind) or 'mark'}_{key.which}_{key.part}"
        name = self._selection.names[number]
        return name if key.part in _MAIN_PARTS else f"{name}_{key.part}"

    def _label(self, key: VisualKey) -> int:
        number = self._number(key)
        return Label.OBSTACLE if number is None else self._selection.labels[number]


def names_of_parents(objects: Sequence[SceneObject]) -> dict[str, str]:
    """Return the name of the object to which each attached object is attached, by name."""
    return {item.name: objects[item.parent].name for item in objects if item.parent is not None}


def put_objects(scene: Scene, objects: Sequence[SceneObject], parents: Mapping[str, str]) -> None:
    """Replace a scene's objects, attached to parents of the given names."""
    index = {item.name: number for number, item in enumerate(objects)}
    scene.replace_objects(
        [replace(item, parent=index[parents[item.name]]) if item.name in parents else item for item in objects]
    )
