# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Join the parts of a mesh file to one mesh, and split a mesh into the triangles of its instances."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices
from warpvis.errors import FileFormatError
from warpvis.scene import Part, keep_winding
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance
from warpvis.scene.normals import replace_arrays
from warpvis.scene.solids import Solid


class Shape(NamedTuple):
    """A mesh and its appearance."""

    vertices: NDArray[np.float64]
    """Shape ``(n, 3)``."""
    faces: NDArray[np.integer]
    """Corner indices, shape ``(m, 3)``."""
    appearance: LazyAppearance | None

    def transformed(self, linear: NDArray[np.float64]) -> Shape:
        """Return the mesh under a linear map, shape ``(3, 3)``; the mesh itself for the identity."""
        if np.array_equal(linear, np.eye(3)):
            return self
        appearance = None if self.appearance is None else self.appearance.transformed(linear)
        return Shape(self.vertices @ linear.T, keep_winding(self.faces, linear), appearance)


def join(parts: Sequence[Part], path: Path) -> Shape:
    """Return the parts of a mesh file as one mesh in the file's frame."""
    shapes = [placed(part, path) for part in parts]
    if len(shapes) == 1:
        return shapes[0]
    firsts = np.cumsum([0, *(len(shape.vertices) for shape in shapes)])
    faces = [shape.faces + first for shape, first in zip(shapes, firsts, strict=False)]
    has_appearance = any(shape.appearance is not None for shape in shapes)
    appearance = LazyAppearance(partial(_join_appearances, shapes)) if has_appearance else None
    return Shape(np.concatenate([shape.vertices for shape in shapes]), np.concatenate(faces), appearance)


def placed(part: Part, path: Path) -> Shape:
    """Return the mesh of a part of a file in the file's frame; raise a `FileFormatError` if its faces are invalid."""
    assert not isinstance(part.mesh, Solid)  # mesh files have none
    vertices, faces = part.mesh
    appearance = part.appearance
    if isinstance(appearance, Appearance):
        appearance = LazyAppearance(None, appearance)
    shape = Shape(np.asarray(vertices, dtype=np.float64), np.asarray(faces), appearance)
    count = len(shape.vertices)
    if len(shape.faces) and not 0 <= shape.faces.min() <= shape.faces.max() < count:
        wrong = shape.faces[(shape.faces < 0) | (shape.faces >= count)][0]
        raise FileFormatError(f"{path}: corners of {part.name!r} must be vertices from 0 to {count - 1}, got {wrong}")
    if part.pose is None:
        return shape
    matrix = part.pose if part.pose.shape == (4, 4) else poses_to_matrices(part.pose)
    turned = shape.transformed(matrix[:3, :3])
    return turned._replace(vertices=turned.vertices + matrix[:3, 3])


def _join_appearances(shapes: Sequence[Shape]) -> Appearance:
    appearances = [(shape.appearance and shape.appearance.get()) or Appearance() for shape in shapes]
    faces, corners = [len(shape.faces) for shape in shapes], [len(shape.vertices) for shape in shapes]
    firsts = np.cumsum([0, *(len(appearance.materials) for appearance in appearances)])
    numbers = _filled([appearance.face_materials for appearance in appearances], faces, 0, ())
    pairs = list(zip(shapes, appearances, strict=True))
    normals = [appearance.corner_normals(shape.faces) for shape, appearance in pairs]
    normals = [
        _face_normals(shape) if rows is None and any(item is not None for item in normals) else rows
        for (shape, _), rows in zip(pairs, normals, strict=True)
    ]
    maps = dict.fromkeys(name for appearance in appearances for name in appearance.map_uv)
    map_uv = {name: [appearance.corner_uv(shape.faces, name) for shape, appearance in pairs] for name in maps}
    return Appearance(
        tuple(material for appearance in appearances for material in appearance.materials),
        (np.repeat(firsts[:-1], faces) + (0 if numbers is None else numbers)).astype(np.int32),
        _filled([appearance.corner_uv(shape.faces) for shape, appearance in pairs], faces, 0, (3, 2)),
        _filled([_floats(appearance.vertex_colors) for appearance in appearances], corners, 1, (4,)),
        _filled([_floats(appearance.face_colors) for appearance in appearances], faces, 1, (4,)),
        _filled(normals, faces, 0, (3, 3)),
        map_uv={name: rows for name, parts in map_uv.items() if (rows := _filled(parts, faces, 0, (3, 2))) is not None},
    )


def _face_normals(shape: Shape) -> NDArray[np.float32]:
    """Return the normals of faces at their corners, shape ``(m, 3, 3)``."""
    a, b, c = (shape.vertices[shape.faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    normals = np.where(length > 0, normals / np.where(length > 0, length, 1), (0.0, 0.0, 1.0))
    return np.repeat(normals[:, None], 3, axis=1).astype(np.float32)


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


def split(shape: Shape, instances: NDArray[np.integer], make: Callable[[int, Shape], Part]) -> list[Part]:
    """Return the triangles of each instance as one part, in the order of the instances' numbers.

    Args:
        shape: The mesh.
        instances: Number of each face's instance, shape ``(m,)``. Negative ones come last.
        make: Returns the part of an instance, given its number and its mesh.
    """
    order = np.argsort(instances, kind="stable")
    numbers, starts = np.unique(instances[order], return_index=True)
    groups = dict(zip(numbers.tolist(), np.split(order, starts[1:]), strict=True))
    return [make(number, subset(shape, groups[number])) for number in sorted(groups, key=lambda key: (key < 0, key))]


def subset(shape: Shape, chosen: NDArray[np.integer]) -> Shape:
    """Return some faces of a mesh, with the vertices that they use."""
    used, corners = np.unique(shape.faces[chosen].reshape(-1), return_inverse=True)
    appearance = shape.appearance
    lazy = None if appearance is None else LazyAppearance(partial(_subset_appearance, appearance, used, chosen))
    return Shape(shape.vertices[used], corners.reshape(-1, 3).astype(np.int32), lazy)


def _subset_appearance(
    source: LazyAppearance, used: NDArray[np.integer], chosen: NDArray[np.integer]
) -> Appearance | None:
    found = source.get()
    if found is None:
        return None

    def rows(values: NDArray | None, is_corner: bool) -> NDArray | None:
        return None if values is None else values[chosen if is_corner else used]

    arrays = {name: getattr(found, name) for name in ("uv", "normals")}
    return replace_arrays(
        found,
        face_materials=rows(found.face_materials, True),
        vertex_colors=rows(found.vertex_colors, False),
        face_colors=rows(found.face_colors, True),
        vertex_grid=None,
        map_uv={name: rows(values, values.ndim == 3) for name, values in found.map_uv.items()},
        **{name: rows(values, values is not None and values.ndim == 3) for name, values in arrays.items()},
    )
