# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The objects of a scene in their order: those that were added together are made one by one, when asked for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import overload

import numpy as np
from numpy.typing import NDArray

from warpvis.scene._object import SceneObject
from warpvis.scene.solids import Solid


@dataclass(frozen=True)
class Instances:
    """Movable objects of one mesh that were added together."""

    first: int
    """Index of the first of them in the scene."""
    names: Sequence[str] = field(repr=False)
    label: int
    mesh: tuple[NDArray[np.float32], NDArray[np.int32]] = field(repr=False)
    """Vertices in their frames [m], and faces."""
    poses: NDArray[np.float32] = field(repr=False)
    """Object to world, rows ``x y z qx qy qz qw``, shape ``(n, 7)``."""
    solid: Solid | None = None

    def make(self, index: int) -> SceneObject:
        """Make the object that has an index in the scene."""
        place = index - self.first
        return SceneObject.placed(self.names[place], self.label, self.mesh, self.poses[place], self.solid)


class ObjectList(Sequence[SceneObject]):
    """Objects, of which those of `add_instances` take no time and no memory of their own until they are asked for."""

    def __init__(self, objects: Iterable[SceneObject] = ()) -> None:
        """Begin with some objects, or with none."""
        self._items: list[SceneObject | Instances] = list(objects)

    def append(self, item: SceneObject) -> None:
        """Add an object."""
        self._items.append(item)

    def add_instances(self, instances: Instances) -> None:
        """Add objects, of which the first gets the next index."""
        self._items += [instances] * len(instances.names)

    def __len__(self) -> int:
        return len(self._items)

    @overload
    def __getitem__(self, index: int) -> SceneObject: ...

    @overload
    def __getitem__(self, index: slice) -> list[SceneObject]: ...

    def __getitem__(self, index: int | slice) -> SceneObject | list[SceneObject]:
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(len(self)))]
        item = self._items[index]
        if isinstance(item, Instances):
            index = range(len(self._items))[index]
            item = self._items[index] = item.make(index)
        return item

    def __setitem__(self, index: int, item: SceneObject) -> None:
        self._items[index] = item

    def __iter__(self) -> Iterator[SceneObject]:
        for index, item in enumerate(self._items):
            yield self[index] if isinstance(item, Instances) else item
