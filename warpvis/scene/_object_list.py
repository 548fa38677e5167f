# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ordered objects of a scene; instances added together are created one by one, on access."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import overload

import numpy as np
from numpy.typing import NDArray

from warpvis.scene._object import SceneObject
from warpvis.scene._shared_mesh import SharedMesh
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.solids import Solid


@dataclass(frozen=True, eq=False)
class Instances:
    """Objects that share one mesh and were added together."""

    first: int
    """Index of the first one in the scene."""
    names: Sequence[str] = field(repr=False)
    label: int
    mesh: SharedMesh = field(repr=False)
    rows: NDArray[np.float64] = field(repr=False)
    """Object to world, ``x y z qx qy qz qw``, shape ``(n, 7)``."""
    movable: bool
    solid: Solid | None = None
    """Round solid that rays hit instead of the triangles, if they are movable."""
    lazy_appearance: LazyAppearance | None = field(default=None, repr=False)
    """The appearance they share."""

    @property
    def triangle_count(self) -> int:
        """Number of triangles of each one."""
        return len(self.mesh.faces)

    def make(self, index: int) -> SceneObject:
        """Create the object with the given index in the scene."""
        place = index - self.first
        name, row = self.names[place], self.rows[place]
        if not self.movable:
            return SceneObject.from_shared_mesh(name, self.label, self.mesh, row, self.lazy_appearance)
        arrays = self.mesh.rounded, self.mesh.faces
        return SceneObject.placed(name, self.label, arrays, row.astype(np.float32), self.solid, self.lazy_appearance)

    def poses(self, first: int, count: int) -> NDArray[np.float32]:
        """Return the poses of `count` objects from the scene index `first`, in single precision."""
        return self.rows[first - self.first : first - self.first + count].astype(np.float32)


class ObjectList(Sequence[SceneObject]):
    """A list of objects; those of `add_instances` take no time and little memory until they are accessed."""

    def __init__(self, objects: Iterable[SceneObject] = ()) -> None:
        """Create a list of the given objects."""
        self._items: list[SceneObject | Instances] = list(objects)

    def append(self, item: SceneObject) -> None:
        """Append an object."""
        self._items.append(item)

    def add_instances(self, instances: Instances) -> None:
        """Append instances; the first one gets the next index."""
        self._items += [instances] * len(instances.names)

    def runs(self) -> Iterator[tuple[int, int, SceneObject | Instances]]:
        """Yield the stored items in order: index of a run's first object, length of the run, and its item."""
        first = 0
        for _, run in groupby(self._items, key=id):
            same = list(run)
            yield first, len(same), same[0]
            first += len(same)

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
