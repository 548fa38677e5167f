# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Objects of a scene: a mesh, a name and a label, and a pose if movable; the list of them, and its bounding box."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, overload

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.core.checks import as_items
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import SceneError
from warpvis.scene._mesh import Mesh, placed_at
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance
from warpvis.scene.solids import Solid

_ONE = np.array(1.0)
IDENTITY = np.array([0, 0, 0, 0, 0, 0, 1], dtype=np.float32)
"""Pose of objects that were added without one."""

# Corners transformed per batch, 24 bytes each: a batch stays in the CPU's caches.
_MAX_CORNERS = 1 << 16

# Range of typical model sizes, from a cup to a hall [m], and size above which millimeters are more likely than meters.
_MIN_MODEL, _LARGEST_MODEL = 0.01, 100.0
_MANY_METERS = 60.0

# A scene this many times larger than the camera's range is rarely intended.
_TOO_LARGE = 10.0


@dataclass(frozen=True, eq=False)
class SceneObject:
    """One object of a scene: a mesh, a name and a label."""

    name: str
    label: int
    """Its class: a `Label`, or another number from 6 to 255; `Scene.label_names` names it."""
    mesh: Mesh = field(repr=False)
    """Its triangles: in its own frame if it is movable or shares a mesh, in its parent's if attached, else in the
    world's."""
    pose: NDArray[np.float32] | None = field(default=None, repr=False)
    """Initial pose of a movable object, object to world, ``x y z qx qy qz qw``; None if it is static or attached."""
    parent: int | None = None
    """Index of the movable object that it is attached to; None if not attached."""
    solid: Solid | None = None
    """Round solid that rays hit instead of the triangles, if a movable object was added as a `solids.Solid`."""
    origin: NDArray[np.float64] | None = field(default=None, repr=False)
    """Pose with which a static or attached object was added, object to world, ``x y z qx qy qz qw``: the frame of its
    normals, and of textures without coordinates. None for the identity."""
    shares_mesh: bool = field(default=False, repr=False)
    """Whether it is static, and shares a mesh in its own frame with others."""
    category: str = ""
    """Its class in words (``"mug"``), finer than its label; empty if not given."""
    lazy_appearance: LazyAppearance | None = field(default=None, repr=False)
    """Holds or creates its `appearance`."""
    world: NDArray[np.float32] | None = field(default=None, repr=False)
    """Cached `vertices`; given if `mesh` does not determine them."""

    @property
    def vertices(self) -> NDArray[np.float32]:
        """Corners in the world frame [m], shape ``(n, 3)``; for a movable object, at its `pose`."""
        if self.world is not None:
            return self.world
        if self.pose is None and not self.shares_mesh:
            return self.mesh.rounded
        if self.pose is not None:
            found = placed_at(self.mesh.rounded, self.pose).astype(np.float32)
        else:
            found = self.mesh.rounded if self.origin is None else self.mesh.placed(self.origin).astype(np.float32)
        if not (self.mesh.deforms or (self.shares_mesh and self.mesh.exceeds_cache)):
            object.__setattr__(self, "world", found)
        return found

    @property
    def faces(self) -> NDArray[np.int32]:
        """Corner indices of the triangles, shape ``(m, 3)``."""
        return self.mesh.faces

    @property
    def mesh_vertices(self) -> NDArray[np.float32] | None:
        """Corners in the frame of a movable object, or of its parent [m], shape ``(n, 3)``; None for static objects."""
        return self.mesh.rounded if self.movable else None

    @property
    def frame_vertices(self) -> NDArray[np.float32]:
        """Corners as `mesh_vertices`, and in the world for static objects [m], shape ``(n, 3)``."""
        return self.vertices if self.shares_mesh else self.mesh.rounded

    @property
    def shared_mesh(self) -> Mesh | None:
        """The mesh, in its own frame, that a static object shares with others; None for most."""
        return self.mesh if self.shares_mesh else None

    @property
    def appearance(self) -> Appearance | None:
        """Its appearance, as added or as read from a file or trimesh's `visual`; None if not given.

        Textures are decoded on first access.
        """
        return None if self.lazy_appearance is None else self.lazy_appearance.get()

    @property
    def place(self) -> NDArray[np.floating]:
        """Initial pose of an object that is movable or shares a mesh: ``x y z qx qy qz qw``."""
        row = self.origin if self.shares_mesh else self.pose
        return IDENTITY if row is None else row

    @property
    def movable(self) -> bool:
        """Whether the object's pose may differ between worlds."""
        return self.pose is not None or self.parent is not None

    @property
    def points(self) -> wp.array | None:
        """Its vertices on the scene's device, once `Scene.update_vertices` was called; else None."""
        return self.mesh.source if self.mesh.deforms else None

    @property
    def triangle_count(self) -> int:
        """Number of triangles of the mesh."""
        return len(self.mesh.source_faces)

    @property
    def bounds(self) -> NDArray[np.float32]:
        """Minimum and maximum corner of the axis-aligned box [m], shape ``(2, 3)``."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])


def take_snapshot(item: SceneObject) -> SceneObject:
    """Return a snapshot of the object with its current vertices, which do not deform any more."""
    if item.points is None:
        return item
    return replace(item, mesh=Mesh(item.mesh.rounded, item.faces), world=item.vertices)


def detach_all(objects: Sequence[SceneObject], instances: NDArray[np.int32]) -> list[SceneObject]:
    """Return the objects as movable ones that are detached from all others; `instances` share meshes.

    A static object then has its vertices in the world's frame, and the identity for a pose; an instance has its shared
    mesh and its pose.
    """
    items, shared = [take_snapshot(item) for item in objects], set(instances.tolist())
    return [_detach(item, items, is_instance=index in shared) for index, item in enumerate(items)]


def _detach(item: SceneObject, objects: Sequence[SceneObject], *, is_instance: bool) -> SceneObject:
    if item.parent is not None:
        return replace(item, pose=objects[item.parent].pose, parent=None)
    if item.pose is not None:
        return item
    shown: dict[str, Any] = {"category": item.category, "lazy_appearance": item.lazy_appearance}
    if is_instance:
        return SceneObject(item.name, item.label, item.mesh.single, item.place.astype(np.float32), **shown)
    mesh = Mesh(item.vertices, item.faces) if item.shares_mesh else item.mesh
    origin = None if item.shares_mesh else item.origin
    return SceneObject(item.name, item.label, mesh, IDENTITY, origin=origin, world=item.vertices, **shown)


def attach(name: str, placed: NDArray[np.floating], parent: SceneObject, *, is_solid: bool) -> NDArray[np.float32]:
    """Return the vertices of an object in the frame of its parent, from those in the world."""
    subject = f"{name!r} cannot be attached to {parent.name!r}"
    if parent.pose is None:
        fixed = "is static; add it with movable=True"
        raise SceneError(f"{subject}, which {'is itself attached to another object' if parent.movable else fixed}")
    if is_solid or parent.solid is not None or parent.points is not None:
        reason = f"{name!r} is a solid" if is_solid else f"{parent.name!r} is a solid"
        reason = reason if parent.points is None else f"{parent.name!r} is deforming"
        raise SceneError(f"{subject}: {reason}, and only rigid meshes can be attached")
    place = poses_to_matrices(parent.pose)
    return ((placed - place[:3, 3]) @ place[:3, :3]).astype(np.float32)


def check_scale(scale: float | ArrayLike, name: str) -> NDArray[np.float64]:
    """Check a scale factor, or three of them."""
    if isinstance(scale, float) and scale == 1.0:
        return _ONE
    try:
        factors = np.asarray(scale, dtype=np.float64)
    except (TypeError, ValueError, OverflowError, RuntimeError):  # other libraries' arrays may raise any exception
        factors = np.array(np.nan)
    if factors.shape not in ((), (3,)) or not (np.isfinite(factors).all() and (factors > 0).all()):
        raise SceneError(f"scale of {name!r} must be one or three positive numbers, got {scale!r}")
    return factors


class Instances(NamedTuple):
    """Objects that share one mesh and were added together."""

    first: int
    """Index of the first one in the scene."""
    names: Sequence[str]
    rows: NDArray[np.float64]
    """Object to world, ``x y z qx qy qz qw``, shape ``(n, 7)``."""
    item: SceneObject
    """An object like them, without their names and poses."""

    def make(self, index: int) -> SceneObject:
        """Create the object with the given index in the scene."""
        name, row = self.names[index - self.first], self.rows[index - self.first]
        if self.item.movable:
            return replace(self.item, name=name, pose=row.astype(np.float32))
        return replace(self.item, name=name, origin=row)


class Run(NamedTuple):
    """Consecutive objects of a scene: a single one, or instances that were not accessed one by one."""

    first: int
    length: int
    item: SceneObject
    """The object, or one like them."""
    rows: NDArray[np.floating]
    """Poses of objects that are movable or share a mesh, shape ``(length, 7)``."""


class ObjectList(Sequence[SceneObject]):
    """A list of named objects; those of `add_instances` take no time and little memory until they are accessed."""

    def __init__(self, objects: Iterable[SceneObject] = ()) -> None:
        """Create a list of the given objects."""
        given = list(objects)
        self._items: list[SceneObject | Instances] = [*given]
        self.names = {item.name: index for index, item in enumerate(given)}
        """Indices of the objects, by name."""
        self.movable = [index for index, item in enumerate(given) if item.pose is not None]
        """Indices of the movable objects with separate poses."""
        if len(self.names) < len(given):
            name, _ = Counter(item.name for item in given).most_common(1)[0]
            raise SceneError(f"objects must have different names, got {name!r} twice")

    def append(self, item: SceneObject) -> None:
        """Append an object."""
        self.names[item.name] = len(self._items)
        self.movable += [len(self._items)] if item.pose is not None else []
        self._items.append(item)

    def add_instances(self, names: Sequence[str], rows: NDArray[np.float64], item: SceneObject) -> range:
        """Append instances of an object, and return their indices."""
        indices = range(len(self._items), len(self._items) + len(rows))
        self._items += [Instances(indices.start, names, rows, item)] * len(rows)
        self.names.update(zip(names, indices, strict=True))
        self.movable += indices if item.movable else []
        return indices

    def index_of(self, name: str) -> int:
        """Return the index of the object with the given name."""
        if not isinstance(name, str) or name not in self.names:
            raise SceneError(
                f"the scene has no object {name!r}; it has {', '.join(map(repr, self.names)) or 'no objects'}"
            )
        return self.names[name]

    def new_name(self, name: str | None) -> str:
        """Return the name of a new object; by default the first free ``object_N``, N from the number of objects on."""
        if name is None:
            numbers = itertools.count(len(self._items))
            return next(free for free in map("object_{}".format, numbers) if free not in self.names)
        if str(name) in self.names:
            raise SceneError(f"the scene already has an object named {str(name)!r}; give another name")
        return str(name)

    def new_names(self, names: str | Sequence[str] | None, count: int) -> list[str]:
        """Return names of new objects: given ones, or numbered ones from a prefix or the objects' indices."""
        if names is None:
            chosen = [f"object_{index}" for index in range(len(self._items), len(self._items) + count)]
        elif isinstance(names, str):
            chosen = [f"{names}_{number}" for number in range(count)]
        else:
            chosen = [str(name) for name in as_items(names, "names", SceneError)]
            if len(chosen) != count:
                raise SceneError(f"names must be one for each of {count} poses, got {len(chosen)}")
        taken = next((name for name in chosen if name in self.names), None)
        if taken is not None:
            raise SceneError(f"the scene already has an object named {taken!r}; give other names")
        if len(set(chosen)) < len(chosen):
            name, times = Counter(chosen).most_common(1)[0]
            raise SceneError(f"names must be different, got {name!r} {times} times")
        return chosen

    def runs(self) -> Iterator[Run]:
        """Yield the objects in order, without creating those of instances."""
        first = 0
        for _, group in itertools.groupby(self._items, key=id):
            item, *others = group
            count = 1 + len(others)
            if isinstance(item, Instances):
                start = first - item.first
                yield Run(first, count, item.item, item.rows[start : start + count])
            else:
                yield Run(first, 1, item, item.place[None])
            first += count

    def parents(self) -> dict[int, int]:
        """Return the parents of attached objects, by object index."""
        return {first: item.parent for first, _, item, _ in self.runs() if item.parent is not None}

    def require_detached(self, index: int, consequence: str) -> None:
        """Raise a `SceneError`, ending in `consequence`, if an object is rigidly attached to others."""
        item = self[index]
        attached = [self[other].name for other, parent in self.parents().items() if parent == index]
        if item.parent is not None:
            attached = [self[item.parent].name]
        if attached:
            names = ", ".join(map(repr, attached))
            raise SceneError(
                f"object {item.name!r} is rigidly attached to {names}, so its {consequence}; do not attach them"
            )

    def require_deformable(self, index: int) -> None:
        """Raise a `SceneError` unless the vertices of an object can be updated."""
        item = self[index]
        if not item.movable:
            raise SceneError(
                f"object {item.name!r} is not movable, so its vertices cannot be updated; add it with movable=True"
            )
        if item.points is None:  # nothing can be attached to an object that already deforms
            self.require_detached(index, "vertices cannot be updated")

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


def bounds_of(objects: ObjectList) -> NDArray[np.float32]:
    """Return the minimum and maximum corner of the objects' axis-aligned box [m], shape ``(2, 3)``."""
    shared: dict[int, tuple[NDArray[np.floating], list[NDArray[np.floating]]]] = {}
    boxes = []
    for _, _, item, rows in objects.runs():
        if item.shares_mesh or (item.pose is not None and item.points is None):
            vertices = item.mesh.vertices if item.shares_mesh else item.mesh.rounded
            rows = rows if item.shares_mesh else rows.astype(np.float32)
            shared.setdefault(id(vertices), (vertices, []))[1].append(rows)
        else:
            boxes.append(item.bounds)
    boxes += [_bounds_at(vertices, np.concatenate(rows)) for vertices, rows in shared.values()]
    ends = np.stack(boxes)
    return np.stack([ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)])


def _bounds_at(vertices: NDArray[np.floating], rows: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the axis-aligned box around a mesh at several poses."""
    matrices = poses_to_matrices(rows.astype(np.float64))
    corners = np.ascontiguousarray(vertices.T, dtype=np.float64)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    step = max(1, _MAX_CORNERS // len(vertices))
    for start in range(0, len(matrices), step):
        part = matrices[start : start + step]
        placed = part[:, :3, :3] @ corners
        low = np.minimum(low, (placed.min(axis=2) + part[:, :3, 3]).min(axis=0))
        high = np.maximum(high, (placed.max(axis=2) + part[:, :3, 3]).max(axis=0))
    return np.stack([low, high]).astype(np.float32)


def fits_millimeters(size: NDArray[np.floating]) -> bool:
    """Return whether a scene's size, read as millimeters, is typical of models."""
    return bool(_MIN_MODEL <= np.max(size) / 1000 <= _LARGEST_MODEL)


def looks_like_millimeters(size: NDArray[np.floating]) -> bool:
    """Return whether a scene's sides [m] are more likely millimeters: all are large, except for flat scenes."""
    return fits_millimeters(size) and bool(np.max(size) > _MANY_METERS) and bool(np.median(size) > _MANY_METERS / 4)


def too_large_for(size: NDArray[np.floating], far: float) -> bool:
    """Return whether a scene's sides [m] are likely millimeters, given a camera of range `far` that sees nothing."""
    return bool(np.max(size) > _TOO_LARGE * far) and fits_millimeters(size)
