# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Triangle meshes that objects share, and a cache of them: a mesh added before is neither checked nor stored again."""

from __future__ import annotations

import weakref
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import FARTHEST
from warpvis.core.poses import poses_to_matrices
from warpvis.core.types import MeshLike
from warpvis.errors import SceneError

# If all instances of a mesh together have more corners, their world vertices are not cached.
_MAX_CACHED = 1 << 24
# Larger meshes are rarely added many times, and caching them takes memory.
_MAX_REMEMBERED = 1_000_000
_NAMED = 3


@dataclass(eq=False)
class Mesh:
    """Triangles in one frame, on the host or on the scene's device; host copies are made on access."""

    source: np.ndarray | wp.array = field(repr=False)
    """Corners [m], shape ``(n, 3)`` of single or double precision, or vec3 on a device."""
    source_faces: NDArray[np.int32] | wp.array = field(repr=False)
    """Corner indices of the triangles, shape ``(m, 3)``."""
    deforms: bool = False
    """Whether the corners on the device change: host copies are then made on every access, so they are current after a
    replayed CUDA graph, too."""
    uses: int = 0
    """Number of static objects that share it."""
    normals: wp.array | None = field(default=None, repr=False)
    """Shading normals of the corners of deforming faces on the device, ``(m, 3)`` vec3; None if they do not follow."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arrays of the host."""
        return Mesh, (self.vertices, self.faces, False, self.uses)

    @property
    def vertices(self) -> NDArray[np.floating]:
        """The corners on the host, in double precision if they were given so."""
        return self.rounded if isinstance(self.source, wp.array) else self.source

    @property
    def rounded(self) -> NDArray[np.float32]:
        """The corners in single precision."""
        return self._host_copy() if self.deforms else self._rounded

    @cached_property
    def _rounded(self) -> NDArray[np.float32]:
        return self._host_copy()

    def _host_copy(self) -> NDArray[np.float32]:
        """Return the corners in single precision; a copy, unless they are on the host and fixed."""
        if isinstance(self.source, np.ndarray):
            return self.source.astype(np.float32, copy=False)
        return np.array(self.source.numpy())

    @cached_property
    def faces(self) -> NDArray[np.int32]:
        """The corner indices on the host."""
        return self.source_faces.numpy() if isinstance(self.source_faces, wp.array) else self.source_faces

    @cached_property
    def single(self) -> Mesh:
        """The same mesh without corners in double precision, which movable objects do not need."""
        return Mesh(self.rounded, self.faces)

    @property
    def exceeds_cache(self) -> bool:
        """Whether the world vertices of all instances would take too much memory to cache."""
        return self.uses * len(self.source) > _MAX_CACHED

    @cached_property
    def reach(self) -> float:
        """Maximum absolute coordinate of a corner under any rotation [m]."""
        return float(np.sqrt(3.0) * np.abs(self.vertices).max())

    def placed(self, row: NDArray[np.float64] | None) -> NDArray[np.floating]:
        """Return the corners in the world of an object at a pose."""
        return self.vertices if row is None else placed_at(self.vertices, row)

    def check_reach(self, rows: NDArray[np.floating], name: str) -> None:
        """Raise a `SceneError` if a corner of an object at any of the poses, ``(n, 7)``, is too far away."""
        if self.reach + np.abs(rows[:, :3]).max(initial=0) > FARTHEST and any(
            np.abs(self.placed(row.astype(np.float64))).max() > FARTHEST for row in rows
        ):
            raise SceneError(f"vertices of {name!r} must lie within 1e18 m of the origin")


def placed_at(vertices: np.ndarray, pose: np.ndarray) -> NDArray[np.float64]:
    """Transform vertices from an object's frame to the world, shape ``(n, 3)``, by a pose of 7 numbers."""
    matrix = poses_to_matrices(pose)
    return vertices @ matrix[:3, :3].T + matrix[:3, 3]


def keep_winding(faces: np.ndarray, linear: NDArray[np.float64]) -> np.ndarray:
    """Reverse triangles, ``(m, 3)``, if a linear transform, ``(3, 3)``, mirrors them: front faces stay front faces."""
    return faces[:, ::-1] if np.linalg.det(linear) < 0 else faces


def check_mesh(mesh: MeshLike, name: str) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the vertices [m], shape ``(n, 3)``, and faces, ``(m, 3)``, of a mesh given to `Scene.add`."""
    arrays = _members(mesh)
    if arrays is None:
        raise SceneError(
            f"mesh of {name!r} must be a trimesh.Trimesh or a pair (vertices, faces), got {type(mesh).__name__}"
        )
    try:
        vertices, faces = np.asarray(arrays[0], dtype=np.float64), np.asarray(arrays[1])
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:  # other libraries' arrays may raise these
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
    check_indices(int(faces.min()), int(faces.max()), len(vertices), name)
    return vertices, faces.astype(np.int32)


def check_indices(low: int, high: int, count: int, name: str) -> None:
    """Raise a `SceneError` unless face indices from `low` to `high` are within those of `count` vertices."""
    if low < 0 or high >= count:
        noun = "vertex" if count == 1 else "vertices"
        raise SceneError(f"faces of {name!r} must index its {count} {noun}, got indices from {low} to {high}")


def check_values(vertices: np.ndarray, name: str) -> None:
    """Raise a `SceneError` unless all are finite and within the range of single precision."""
    if np.abs(vertices).max(initial=0) <= FARTHEST:  # false for NaN too
        return
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        indices = ", ".join(map(str, bad[:_NAMED])) + (", ..." if len(bad) > _NAMED else "")
        raise SceneError(f"vertices of {name!r} must be finite: {len(bad)} are not, at {indices}")
    raise SceneError(f"vertices of {name!r} must lie within 1e18 m of the origin of its frame")


class MeshCache:
    """The meshes added to a scene, for the lifetime of the arrays they were made from."""

    def __init__(self) -> None:
        """Create an empty cache."""
        self._known: dict[tuple[int, int], _Known] = {}

    def get(self, mesh: MeshLike, factors: NDArray[np.float64], name: str) -> Mesh:
        """Return a mesh with scaled corners: the same one if the same mesh was added before.

        trimesh's arrays are compared by hash, other arrays by value.
        """
        arrays = _members(mesh)
        if arrays is None or not all(isinstance(array, np.ndarray) for array in arrays):
            vertices, faces = check_mesh(mesh, name)
            return Mesh(vertices * factors, faces)
        key = id(arrays[0]), id(arrays[1])
        known = self._known.get(key)
        if known is not None and known.is_of(arrays, factors):
            return known.mesh
        vertices, faces = check_mesh(mesh, name)
        shared = Mesh(vertices * factors, faces)
        if len(vertices) <= _MAX_REMEMBERED:
            # The id of a freed array may be reused.
            references = tuple(weakref.ref(array, lambda _: self._known.pop(key, None)) for array in arrays)
            self._known[key] = _Known(references, _hashes(arrays), factors, shared)
        return shared


class _Known(NamedTuple):
    """A mesh, and the arrays and factors it was made from."""

    arrays: tuple[weakref.ref, ...]
    """Vertices and faces."""
    hashes: tuple[int, int] | None
    """Hashes of the arrays, if they are hashable."""
    factors: NDArray[np.float64]
    mesh: Mesh

    def is_of(self, arrays: tuple[np.ndarray, np.ndarray], factors: NDArray[np.float64]) -> bool:
        """Return whether the arrays are the same and unchanged, and the factors are equal."""
        if self.arrays[0]() is not arrays[0] or self.arrays[1]() is not arrays[1]:
            return False
        if factors is not self.factors and not np.array_equal(factors, self.factors):
            return False
        hashes = _hashes(arrays)
        if hashes:
            return hashes == self.hashes
        return np.array_equal(arrays[0] * factors, self.mesh.vertices) and np.array_equal(arrays[1], self.mesh.faces)


def _members(mesh: MeshLike) -> tuple[Any, Any] | None:
    """Return the vertices and faces of a mesh, of any type; None if it has none."""
    if isinstance(mesh, tuple | list) and len(mesh) == 2:
        return mesh[0], mesh[1]
    return (mesh.vertices, mesh.faces) if hasattr(mesh, "vertices") and hasattr(mesh, "faces") else None


def _hashes(arrays: tuple[np.ndarray, np.ndarray]) -> tuple[int, int] | None:
    """Return hashes of arrays that track changes, as trimesh's do; None for others."""
    vertices, faces = arrays
    if type(vertices).__hash__ is None or type(faces).__hash__ is None:
        return None
    return hash(vertices), hash(faces)
