# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Meshes that objects share: one that was added before is neither checked nor kept again."""

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

# Larger meshes are not added many times, and to remember them takes memory.
_MAX_REMEMBERED = 1_000_000


class SharedMeshes:
    """The meshes that a scene was given, as long as the arrays live that hold them."""

    def __init__(self) -> None:
        """Begin with none."""
        self._known: dict[tuple[int, int], _Known] = {}

    def get(self, mesh: MeshLike, factors: NDArray[np.float64], name: str) -> SharedMesh:
        """Return a mesh's scaled corners and its triangles: the same arrays as when the same mesh came before.

        trimesh's arrays know whether they were changed. Of others the numbers are compared.

        Raises:
            SceneError: The mesh is empty or malformed.
        """
        arrays = _arrays(mesh)
        key = (0, 0) if arrays is None else (id(arrays[0]), id(arrays[1]))
        known = self._known.get(key)
        if arrays is not None and known is not None and known.is_of(arrays, factors):
            return known.mesh
        vertices, faces = check_mesh(mesh, name)
        shared = SharedMesh(vertices * factors, faces)
        if arrays is not None and len(vertices) <= _MAX_REMEMBERED:
            # An id may come to be another array's.
            references = tuple(weakref.ref(array, lambda _: self._known.pop(key, None)) for array in arrays)
            self._known[key] = _Known(references, _hashes(arrays), factors, shared)
        return shared


class _Known(NamedTuple):
    """A mesh, and what it was made of."""

    arrays: tuple[weakref.ref, ...]
    """Vertices and faces."""
    hashes: tuple[int, int] | None
    """Theirs, if they have any."""
    factors: NDArray[np.float64]
    mesh: SharedMesh

    def is_of(self, arrays: tuple[np.ndarray, np.ndarray], factors: NDArray[np.float64]) -> bool:
        """Tell whether these are the arrays, unchanged, and the factors."""
        if self.arrays[0]() is not arrays[0] or self.arrays[1]() is not arrays[1]:
            return False
        if factors is not self.factors and not np.array_equal(factors, self.factors):
            return False
        hashes = _hashes(arrays)
        if hashes:
            return hashes == self.hashes
        return np.array_equal(arrays[0] * factors, self.mesh.vertices) and np.array_equal(arrays[1], self.mesh.faces)


def instance_names(names: str | Sequence[str] | None, indices: range, taken: Mapping[str, int]) -> list[str]:
    """Name objects by their indices, by what their names begin with, or as they are called.

    Raises:
        SceneError: A name is taken, or there are more or fewer of them than objects.
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
    """Return the arrays of vertices and faces of a mesh that has some."""
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
    """Return hashes of arrays that know when they are changed, as trimesh's do."""
    vertices, faces = arrays
    if type(vertices).__hash__ is None or type(faces).__hash__ is None:
        return None
    return hash(vertices), hash(faces)
