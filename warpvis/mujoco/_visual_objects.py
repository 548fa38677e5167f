# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Objects of a scene for what MuJoCo draws beside geoms and sites: their vertices move, and their triangles stay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Label
from warpvis.mujoco._scene import Selection
from warpvis.mujoco._shapes import drawn_number, free_name, shape_count
from warpvis.mujoco._visual_shapes import Blocks
from warpvis.mujoco._visuals import MAIN_PARTS, VisualKey
from warpvis.scene import Scene


@dataclass
class _Kept:
    """What one object is made of."""

    name: str
    capacity: int
    """How many blocks it has triangles for."""
    faces: NDArray[np.int32]
    """Those of one block."""
    vertices: NDArray[np.float32]
    """Where they were at the last update [m], shape ``(capacity * t, 3)``."""

    def holds(self, blocks: Blocks) -> bool:
        """Tell whether blocks are these triangles elsewhere."""
        fits = self.capacity >= len(blocks.vertices)
        return fits and self._corners() == blocks.vertices.shape[1] and np.array_equal(self.faces, blocks.faces)

    def blocks(self) -> Blocks:
        """Return what makes the same object."""
        return Blocks(self.vertices.reshape(self.capacity, -1, 3), self.faces)

    def _corners(self) -> int:
        return len(self.vertices) // self.capacity


class VisualObjects:
    """The objects that stand behind the geoms and sites of a scene, and before what was added to it.

    Each is made when it is first drawn, and hidden when it is not. One of several shapes, such as the segments of a
    tendon, has triangles for twice as many once there are more than it was made for.
    """

    def __init__(self, model: mujoco.MjModel, selection: Selection, scene: Scene) -> None:
        """Begin without any.

        Args:
            model: The model.
            selection: Names and labels of what is drawn, and what is left out.
            scene: Where the objects are.
        """
        self._model, self._selection, self._scene = model, selection, scene
        self._kept: dict[VisualKey, _Kept] = {}
        self._shown: set[VisualKey] = set()

    def __len__(self) -> int:
        return len(self._kept)

    def meanings(self) -> list[tuple[int, int]]:
        """List id and `mujoco.mjtObj` of every object."""
        return [(key.which, key.kind) for key in self._kept]

    def hidden(self, first: int) -> list[int]:
        """List the objects that are not drawn now, the first of all being number `first` of the scene."""
        if len(self._shown) == len(self._kept):
            return []
        return [first + place for place, key in enumerate(self._kept) if key not in self._shown]

    def state(self) -> dict[VisualKey, Blocks]:
        """Return what `update` makes the same objects of, as they are now."""
        return {key: self._kept[key].blocks() for key in self._kept if key in self._shown}

    def update(self, drawn: Mapping[VisualKey, Blocks], first: int) -> None:
        """Show these things and no others.

        Args:
            drawn: The shapes of each.
            first: How many objects are before these in the scene.
        """
        shown = {key: blocks for key, blocks in drawn.items() if not self._is_left_out(key)}
        self._shown = set(shown)
        new = {
            key: blocks for key, blocks in shown.items() if key not in self._kept or not self._kept[key].holds(blocks)
        }
        if new:
            self._make(new, first)
        for key, blocks in shown.items():
            kept = self._kept[key]
            vertices = blocks.filled_up(kept.capacity)
            if key in new or not np.array_equal(vertices, kept.vertices):
                self._scene.update_vertices(kept.name, vertices)
                kept.vertices = vertices

    def _is_left_out(self, key: VisualKey) -> bool:
        return drawn_number(self._model, key.kind, key.which) in self._selection.left_out

    def _make(self, new: Mapping[VisualKey, Blocks], first: int) -> None:
        """Make objects, or make them anew."""
        scene, draft = self._scene, Scene()
        objects = scene.objects
        mine = dict(zip(self._kept, objects[first:], strict=False))
        added = objects[first + len(mine) :]
        taken = {item.name for item in objects} | set(self._selection.names[: shape_count(self._model)])
        for key, blocks in new.items():
            before, count = self._kept.get(key), len(blocks.vertices)
            capacity = count if before is None or count <= before.capacity else max(count, 2 * before.capacity)
            name = free_name(self._name(key), taken) if before is None else before.name
            taken.add(name)
            vertices = blocks.filled_up(capacity)
            draft.add((vertices, blocks.all_faces(capacity)), name=name, label=self._label(key), movable=True)
            self._kept[key] = _Kept(name, capacity, np.array(blocks.faces), vertices)
            mine[key] = draft[name]
        ordered = [*objects[:first], *mine.values(), *added]
        index = {item.name: number for number, item in enumerate(ordered)}
        scene.replace_objects(
            [
                item if item.carrier is None else replace(item, carrier=index[objects[item.carrier].name])
                for item in ordered
            ]
        )

    def _name(self, key: VisualKey) -> str:
        number = drawn_number(self._model, key.kind, key.which)
        if number is None:
            return f"{mujoco.mju_type2Str(key.kind) or 'mark'}_{key.which}_{key.part}"
        own = self._selection.names[number]
        return own if key.part in MAIN_PARTS else f"{own}_{key.part}"

    def _label(self, key: VisualKey) -> int:
        number = drawn_number(self._model, key.kind, key.which)
        return Label.OBSTACLE if number is None else self._selection.labels[number]
