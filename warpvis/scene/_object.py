# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""One object of a scene: its mesh, name and label, and its pose if it is movable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.core.types import MeshLike
from warpvis.errors import SceneError
from warpvis.scene._shared_mesh import SharedMesh, placed_at
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance
from warpvis.scene.solids import Solid

_ONE = np.array(1.0)
_IDENTITY = np.array([0, 0, 0, 0, 0, 0, 1], dtype=np.float32)


@dataclass(frozen=True)
class SceneObject:
    """One object of a scene: a mesh, a name and a label."""

    name: str
    label: int
    """Its class: a `Label`, or another number from 6 to 255; `Scene.label_names` names it."""
    vertices: NDArray[np.float32] = field(repr=False)
    """Corners in the world frame [m], shape ``(n, 3)``; for a movable object, at its `pose`."""
    faces: NDArray[np.int32] = field(repr=False)
    """Corner indices of the triangles, shape ``(m, 3)``."""
    mesh_vertices: NDArray[np.float32] | None = field(default=None, repr=False)
    """Corners in the frame of a movable object, or of its parent [m], shape ``(n, 3)``; None for static objects."""
    pose: NDArray[np.float32] | None = field(default=None, repr=False)
    """Initial pose of a movable object, object to world, ``x y z qx qy qz qw``; None if it is static or attached."""
    parent: int | None = None
    """Index of the movable object that it is attached to; None if not attached."""
    solid: Solid | None = None
    """Round solid that rays hit instead of the triangles, if a movable object was added as a `solids.Solid`."""
    origin: NDArray[np.float64] | None = field(default=None, repr=False, compare=False)
    """Pose with which a static or attached object was added, object to world, ``x y z qx qy qz qw``: the frame of its
    normals, and of textures without coordinates. None for the identity."""
    lazy_appearance: LazyAppearance | None = field(default=None, repr=False, compare=False)
    """Holds or creates its `appearance`."""

    @classmethod
    def placed(
        cls,
        name: str,
        label: int,
        mesh: tuple[NDArray[np.float32], NDArray[np.int32]],
        place: NDArray[np.float32],
        solid: Solid | None = None,
        lazy_appearance: LazyAppearance | None = None,
    ) -> SceneObject:
        """Create a movable object from a mesh in its frame. `vertices` are computed on access."""
        item = object.__new__(cls)
        item.__dict__.update(name=name, label=label, faces=mesh[1], mesh_vertices=mesh[0], pose=place, solid=solid)
        item.__dict__.update(lazy_appearance=lazy_appearance)
        return item

    @classmethod
    def from_shared_mesh(
        cls,
        name: str,
        label: int,
        shared: SharedMesh,
        row: NDArray[np.float64] | None,
        lazy_appearance: LazyAppearance | None = None,
    ) -> SceneObject:
        """Create a static object from a shared mesh and a pose. `vertices` are computed on access."""
        item = object.__new__(cls)
        item.__dict__.update(
            name=name, label=label, faces=shared.faces, shared=shared, row=row, lazy_appearance=lazy_appearance
        )
        return item

    def __getattr__(self, name: str) -> NDArray[np.float32]:
        """Compute the vertices that `placed` and `from_shared_mesh` left out."""
        if name == "vertices" and self.mesh_vertices is not None and self.pose is not None:
            vertices = placed_at(self.mesh_vertices, self.pose).astype(np.float32)
        elif name == "vertices" and "shared" in self.__dict__:
            vertices = self.__dict__["shared"].rounded_at(self.__dict__["row"])
            if self.__dict__["shared"].exceeds_cache:
                return vertices
        else:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        object.__setattr__(self, "vertices", vertices)
        return vertices

    @property
    def shared_mesh(self) -> SharedMesh | None:
        """The mesh, in its own frame, that a static object shares with others; None for most."""
        return self.__dict__.get("shared")

    @property
    def appearance(self) -> Appearance | None:
        """Its appearance, as added or as read from a file or trimesh's `visual`; None if not given.

        Textures are decoded on first access.
        """
        return None if self.lazy_appearance is None else self.lazy_appearance.get()

    @property
    def place(self) -> NDArray[np.floating]:
        """Initial pose of an object that is movable or shares a mesh: ``x y z qx qy qz qw``."""
        row = self.__dict__.get("row", self.pose)
        return _IDENTITY if row is None else row

    @property
    def movable(self) -> bool:
        """Whether the object's pose may differ between worlds."""
        return self.pose is not None or self.parent is not None

    @property
    def points(self) -> wp.array | None:
        """Its vertices on the scene's device, once `Scene.update_vertices` was called; else None."""
        return None

    @property
    def triangle_count(self) -> int:
        """Number of triangles of the mesh."""
        return len(self.faces)

    @property
    def bounds(self) -> NDArray[np.float32]:
        """Minimum and maximum corner of the axis-aligned box [m], shape ``(2, 3)``."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])


def take_snapshot(item: SceneObject) -> SceneObject:
    """Return a snapshot of the object with its current vertices, which do not deform any more."""
    if item.points is None:
        return item
    return SceneObject(
        item.name,
        item.label,
        item.vertices,
        item.faces,
        item.mesh_vertices,
        item.pose,
        lazy_appearance=item.lazy_appearance,
    )


def detach(item: SceneObject, objects: Sequence[SceneObject], *, is_instance: bool = False) -> SceneObject:
    """Return the object as a movable one that is detached from all others.

    A static object then has its vertices in the world's frame, and the identity for a pose; an instance has its shared
    mesh and its pose.
    """
    if item.parent is not None:
        return replace(item, pose=objects[item.parent].pose, parent=None)
    shared = item.shared_mesh
    if is_instance and shared is not None:
        place = item.place.astype(np.float32)
        return SceneObject.placed(
            item.name, item.label, (shared.rounded, shared.faces), place, lazy_appearance=item.lazy_appearance
        )
    if item.pose is None:
        return replace(item, mesh_vertices=item.vertices, pose=_IDENTITY)
    return item


def check_mesh(mesh: MeshLike, name: str) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the vertices [m], shape ``(n, 3)``, and faces, ``(m, 3)``, of a mesh given to `Scene.add`.

    Raises:
        SceneError: If the mesh is empty or malformed.
    """
    if isinstance(mesh, tuple | list) and len(mesh) == 2:
        vertices, faces = mesh
    elif hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
        vertices, faces = mesh.vertices, mesh.faces
    else:
        raise SceneError(
            f"mesh of {name!r} must be a trimesh.Trimesh or a pair (vertices, faces), got {type(mesh).__name__}"
        )
    try:
        vertices, faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
    except (
        TypeError,
        ValueError,
        OverflowError,
        RuntimeError,
    ) as error:  # arrays of other libraries may raise any exception
        raise SceneError(f"mesh of {name!r} must hold arrays of numbers: {error}") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise SceneError(f"vertices of {name!r} must have shape (n, 3), got {vertices.shape}")
    if faces.size == 0:
        raise SceneError(f"mesh of {name!r} must have triangles, got none")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise SceneError(f"faces of {name!r} must be integers of shape (m, 3), got {faces.dtype} {faces.shape}")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise SceneError(f"vertices of {name!r} must be finite: {len(bad)} are not, the first at {bad[0]}")
    low, high = faces.min(), faces.max()
    if low < 0 or high >= len(vertices):
        noun = "vertex" if len(vertices) == 1 else "vertices"
        raise SceneError(f"faces of {name!r} must index its {len(vertices)} {noun}, got indices from {low} to {high}")
    return vertices, faces.astype(np.int32)


def keep_winding(faces: np.ndarray, linear: NDArray[np.float64]) -> np.ndarray:
    """Reverse the winding of triangles if a linear transform mirrors them, so that front faces stay front faces.

    Args:
        faces: Corner indices, shape ``(m, 3)``.
        linear: Linear part of the transform, shape ``(3, 3)``.
    """
    return faces[:, ::-1] if np.linalg.det(linear) < 0 else faces


def check_scale(scale: float | ArrayLike, name: str) -> NDArray[np.float64]:
    """Check a scale factor, or three of them.

    Raises:
        SceneError: If they are not positive numbers.
    """
    if isinstance(scale, float) and scale == 1.0:
        return _ONE
    try:
        factors = np.asarray(scale, dtype=np.float64)
    except (TypeError, ValueError, OverflowError, RuntimeError):  # other libraries' arrays may raise any exception
        raise SceneError(f"scale of {name!r} must be one or three positive numbers, got {scale!r}") from None
    if factors.shape not in ((), (3,)) or not (np.isfinite(factors).all() and (factors > 0).all()):
        raise SceneError(f"scale of {name!r} must be one or three positive numbers, got {scale!r}")
    return factors
