# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A cache of shared meshes: a mesh that was added before is neither checked nor stored again."""

from __future__ import annotations

import weakref
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_items
from warpvis.core.types import MeshLike
from warpvis.errors import SceneError
from warpvis.scene._object import check_mesh
from warpvis.scene._shared_mesh import SharedMesh

# Larger meshes are rarely added many times, and caching them takes memory.
_MAX_REMEMBERED = 1_000_000


class SharedMeshes:
    """The meshes added to a scene, for the lifetime of the arrays they were made from."""

    def __init__(self) -> None:
        """Create an empty cache."""
        self._known: dict[tuple[int, int], _Known] = {}

    def get(self, mesh: MeshLike, factors: NDArray[np.float64], name: str) -> SharedMesh:
        """Return a mesh's scaled corners and its triangles: the same arrays if the same mesh was added before.

        trimesh's arrays are compared by hash, other arrays by value.

        Raises:
            SceneError: If the mesh is empty or malformed.
        """
        arrays = _arrays(mesh)
        key = (0, 0) if arrays is None else (id(arrays[0]), id(arrays[1]))
        known = self._known.get(key)
        if arrays is not None and known is not None and known.is_of(arrays, factors):
            return known.mesh
        vertices, faces = check_mesh(mesh, name)
        shared = SharedMesh(vertices * factors, faces)
        if arrays is not None and len(vertices) <= _MAX_REMEMBERED:
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
    mesh: SharedMesh

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


def instance_names(names: str | Sequence[str] | None, indices: range, taken: Mapping[str, int]) -> list[str]:
    """Return names of objects: given ones, or numbered ones from a prefix or the objects' indices.

    Raises:
        SceneError: If a name is taken, or the number of names differs from the number of objects.
    """
    if names is None:
        chosen = [f"object_{index}" for index in indices]
    elif isinstance(names, str):
        chosen = [f"{names}_{number}" for number in range(len(indices))]
    else:
        chosen = [str(name) for name in as_items(names, "names", SceneError)]
        if len(chosen) != len(indices):
            raise SceneError(f"names must be one for each of {len(indices)} poses, got {len(chosen)}")
    taken_already = next((name for name in chosen if name in taken), None)
    if taken_already is not None:
        raise SceneError(f"the scene already has an object named {taken_already!r}; give other names")
    if len(set(chosen)) < len(chosen):
        name, times = Counter(chosen).most_common(1)[0]
        raise SceneError(f"names must be different, got {name!r} {times} times")
    return chosen


def _arrays(mesh: MeshLike) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the vertex and face arrays of a mesh, or None if it has no NumPy arrays."""
    vertices: object
    faces: object
    if isinstance(mesh, tuple | list):
        vertices, faces = mesh if len(mesh) == 2 else (None, None)
    else:
        vertices, faces = getattr(mesh, "vertices", None), getattr(mesh, "faces", None)
    if not isinstance(vertices, np.ndarray) or not isinstance(faces, np.ndarray):
        return None
    return vertices, faces


def _hashes(arrays: tuple[np.ndarray, np.ndarray]) -> tuple[int, int] | None:
    """Return hashes of arrays that track changes, as trimesh's do; None for others."""
    vertices, faces = arrays
    if type(vertices).__hash__ is None or type(faces).__hash__ is None:
        return None
    return hash(vertices), hash(faces)
