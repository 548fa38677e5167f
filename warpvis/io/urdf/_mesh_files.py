# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mesh files of a robot: all their parts joined to one mesh, in the file's own frame, with its colors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import truncate
from warpvis.errors import FileFormatError
from warpvis.io._meshes import read_mesh_file
from warpvis.io._readers import SCENE_READERS
from warpvis.io.urdf._places import Places
from warpvis.scene import Part, in_file_frame, keep_winding
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance, Material
from warpvis.scene.normals import have_direction

GRAY = Material(base_color=(0.5, 0.5, 0.5, 1.0))
"""Material of surfaces without a color, as in RViz and MuJoCo."""


_MAX_LISTED = 5
"""Maximum number of missing files in a warning."""


class FileMesh(NamedTuple):
    """The triangles of a mesh file, and their appearance, if the file has any."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.integer]
    appearance: LazyAppearance | None


@dataclass
class MeshFiles:
    """The mesh files of a robot, each of which is read once."""

    places: Places
    strict: bool
    missing: list[str] = field(default_factory=list)
    """URLs whose files were not found."""
    empty: list[str] = field(default_factory=list)
    """Files without triangles."""
    warnings: list[str] = field(default_factory=list)
    """Warnings of the readers."""
    _read: dict[Path, FileMesh | None] = field(default_factory=dict)
    _scaled: dict[tuple[Path, tuple[float, ...]], FileMesh] = field(default_factory=dict)

    def load(self, url: str, scale: tuple[float, ...]) -> FileMesh | None:
        """Return the mesh of a URL with factors along its axes; None if there is no such file, or it has no triangles.

        Equal arguments return the same arrays.
        """
        path = self.places.find(url)
        if path is None:
            self.missing += [] if url in self.missing else [url]
            return None
        if path not in self._read:
            self._read[path] = self._load(path)
        mesh = self._read[path]
        if mesh is None or scale == (1.0, 1.0, 1.0):
            return mesh
        if (path, scale) not in self._scaled:
            linear = np.diag(scale)
            appearance = None if mesh.appearance is None else mesh.appearance.transformed(linear)
            self._scaled[path, scale] = FileMesh(mesh.vertices * scale, keep_winding(mesh.faces, linear), appearance)
        return self._scaled[path, scale]

    def skipped(self) -> list[str]:
        """Describe missing meshes and meshes without triangles, as parts of a sentence."""
        parts = []
        if self.missing:
            searched = "in the robot's folder, in packages above it, or on the search path"
            more = f" and {len(self.missing) - _MAX_LISTED} others" if len(self.missing) > _MAX_LISTED else ""
            listed = ", ".join(map(truncate, self.missing[:_MAX_LISTED])) + more
            parts.append(f"{listed}, whose files were not found {searched}")
        return [*parts, f"{', '.join(self.empty)}, without triangles"] if self.empty else parts

    def _load(self, path: Path) -> FileMesh | None:
        if path.suffix.lower() in SCENE_READERS:
            raise FileFormatError(f"{path}: must be a mesh file, got {path.suffix}")
        found = read_mesh_file(path, search_path=(), strict=self.strict)
        self.warnings += found.warnings
        parts = [in_file_frame(part) for part in found.parts]
        if not parts:
            self.empty.append(str(path))
            return None
        return join_parts(parts)


def join_parts(parts: Sequence[Part]) -> FileMesh:
    """Join parts without poses to one mesh."""
    meshes = [(np.asarray(part.mesh[0]), np.asarray(part.mesh[1])) for part in parts if isinstance(part.mesh, tuple)]
    looks = [_lazy(part) for part in parts]
    if len(parts) == 1:
        return FileMesh(*meshes[0], looks[0])
    firsts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = np.concatenate([faces + first for (_, faces), first in zip(meshes, firsts, strict=False)])
    appearance = None
    if any(look is not None for look in looks):
        has_colors = any(look is not None and look.has_colors for look in looks)
        appearance = LazyAppearance(partial(_joined, meshes, looks), has_colors=has_colors)
    return FileMesh(np.concatenate([vertices for vertices, _ in meshes]), faces, appearance)


def _lazy(part: Part) -> LazyAppearance | None:
    return LazyAppearance(None, part.appearance) if isinstance(part.appearance, Appearance) else part.appearance


def _joined(meshes: Sequence[tuple[NDArray, NDArray]], looks: Sequence[LazyAppearance | None]) -> Appearance | None:
    """Join the appearances of parts; those without colors are gray, and those without normals flat."""
    found = [None if look is None else look.get() for look in looks]
    if not any(found):
        return None
    colored = [look is not None and look.has_colors for look in looks]
    plain = Appearance((GRAY,))
    appearances = [item or plain for item in found]
    materials = [item.materials if flag else (GRAY,) for item, flag in zip(appearances, colored, strict=True)]
    firsts = np.cumsum([0, *map(len, materials)])
    faces, corners = [len(faces) for _, faces in meshes], [len(vertices) for vertices, _ in meshes]
    both = list(zip(appearances, meshes, strict=True))
    numbers = _filled([item.face_materials for item in appearances], faces, 0, ())
    uv = [item.corner_uv(mesh[1]) for item, mesh in both]
    maps = dict.fromkeys(name for item in appearances for name in item.map_uv)
    map_uv = {name: _filled([item.corner_uv(mesh[1], name) for item, mesh in both], faces, 0, (3, 2)) for name in maps}
    normals = None
    if any(item.normals is not None for item in appearances):
        normals = np.concatenate([_corner_normals(item, *mesh) for item, mesh in both])
    return Appearance(
        tuple(material for items in materials for material in items),
        (np.repeat(firsts[:-1], faces) + (0 if numbers is None else numbers)).astype(np.int32),
        _filled(uv, faces, 0, (3, 2)),
        _filled([_floats(item.vertex_colors) for item in appearances], corners, 1, (4,)),
        _filled([_floats(item.face_colors) for item in appearances], faces, 1, (4,)),
        normals=normals,
        map_uv={name: rows for name, rows in map_uv.items() if rows is not None},
    )


def _corner_normals(appearance: Appearance, vertices: NDArray, faces: NDArray) -> NDArray[np.float32]:
    """Return the normals of corners, shape ``(m, 3, 3)``; those of the faces if there are none."""
    found = appearance.corner_normals(faces)
    if found is not None:
        return found
    a, b, c = (vertices[faces[:, number]] for number in range(3))
    with np.errstate(over="ignore", invalid="ignore"):
        flat = np.cross(b - a, c - a)
        flat = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    flat[~have_direction(flat)] = (0.0, 0.0, 1.0)
    return np.repeat(flat[:, None].astype(np.float32), 3, axis=1)


def _filled(
    parts: Sequence[NDArray | None], counts: Sequence[int], value: float, shape: tuple[int, ...]
) -> NDArray[np.float32] | None:
    """Concatenate parts with given numbers of rows, filled where they are None; None if all are."""
    if all(part is None for part in parts):
        return None
    rows = [
        np.full((count, *shape), value, dtype=np.float32) if part is None else part
        for part, count in zip(parts, counts, strict=True)
    ]
    return np.concatenate(rows)


def _floats(colors: NDArray | None) -> NDArray[np.float32] | None:
    return None if colors is None else (colors / (255.0 if colors.dtype == np.uint8 else 1.0)).astype(np.float32)
