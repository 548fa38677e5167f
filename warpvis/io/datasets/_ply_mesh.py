# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""PLY meshes with all properties of vertices and faces, such as the number of each face's object."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.file_content import reading, require_content
from warpvis.errors import FileFormatError
from warpvis.io._ply import PLY_TYPES
from warpvis.io.datasets._joined import Shape
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance

_END = b"end_header"
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")
_MAX_HEADER = 1 << 16

_Property = tuple[str, str, str]
"""Name, type, and for a list the type of its length, else an empty text."""
_Rows = dict[str, Any]
"""The values of an element by property: arrays of shape ``(n,)``, or for lists ``(n, k)`` or a list of arrays."""


class PlyMesh(NamedTuple):
    """The contents of a PLY file."""

    shape: Shape
    """Its triangles, with the colors of vertices."""
    vertex: dict[str, NDArray[Any]]
    """Properties of vertices, shape ``(n,)``."""
    face: dict[str, NDArray[Any]]
    """Properties of the faces that triangles come from, shape ``(m,)``."""
    polygons: NDArray[np.int64]
    """Number of each triangle's face in the file, shape ``(m,)``."""
    face_count: int
    """Number of faces in the file, which may have more than three corners."""


def read_ply_mesh(path: Path) -> PlyMesh:
    """Read a PLY file, ASCII or binary; faces with more than three corners become fans."""
    require_content(path, "a mesh")
    with reading(path, "PLY"):
        elements = _read_elements(path.read_bytes())
        vertex, face = elements.get("vertex"), elements.get("face")
        if vertex is None or face is None:
            raise FileFormatError(
                f"{path}: must have the elements vertex and face, got {', '.join(elements) or 'none'}"
            )
        missing = next((name for name in "xyz" if name not in vertex), None)
        if missing:
            raise FileFormatError(f"{path}: vertices must have the properties x, y and z, got {', '.join(vertex)}")
        corners = next((face[name] for name in _CORNERS if name in face), None)
        if corners is None:
            raise FileFormatError(f"{path}: faces must have the property vertex_indices, got {', '.join(face)}")
        faces, polygons = _triangles(corners)
        count = len(vertex["x"])
        if len(faces) and not 0 <= faces.min() <= faces.max() < count:
            wrong = faces[(faces < 0) | (faces >= count)][0]
            raise FileFormatError(f"{path}: corners of faces must be vertices from 0 to {count - 1}, got {wrong}")
        shape = Shape(np.stack([vertex[name].astype(np.float64) for name in "xyz"], axis=1), faces, _colors(vertex))
        rows = {name: values[polygons] for name, values in face.items() if _is_scalar(values)}
        scalars = {name: values for name, values in vertex.items() if _is_scalar(values)}
        return PlyMesh(shape, scalars, rows, polygons, len(corners))


def _is_scalar(values: Any) -> bool:
    return isinstance(values, np.ndarray) and values.ndim == 1


def _colors(vertex: _Rows) -> LazyAppearance | None:
    """Return the colors of vertices in sRGB."""
    names = [name for name in ("red", "green", "blue", "alpha") if name in vertex]
    if names[:3] != ["red", "green", "blue"]:
        return None
    colors = np.stack([vertex[name] for name in names], axis=1)
    colors = colors if colors.dtype.kind == "f" else np.clip(colors, 0, 255).astype(np.uint8)
    return LazyAppearance(None, Appearance(vertex_colors=colors))


def _triangles(corners: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return fans of polygons, shape ``(m, 3)``, and the polygon of each triangle, shape ``(m,)``."""
    if isinstance(corners, np.ndarray):
        count, size = len(corners), corners.shape[1]
        if size < 3:
            return np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
        rows = corners.astype(np.int64)
        fans = np.stack([rows[:, [0, corner, corner + 1]] for corner in range(1, size - 1)], axis=1)
        return fans.reshape(-1, 3), np.repeat(np.arange(count), size - 2)
    parts = [_triangles(np.asarray(polygon)[None])[0] for polygon in corners]
    polygons = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return np.concatenate([np.zeros((0, 3), np.int64), *parts]), polygons


def _read_elements(file: bytes) -> dict[str, _Rows]:
    end = file.find(_END, 0, _MAX_HEADER)
    if not file.startswith(b"ply") or end < 0:
        raise ValueError("it must begin with a header from 'ply' to 'end_header'")
    start = end + len(_END)
    start += 2 if file[start : start + 2] == b"\r\n" else 1
    lines = [line.split() for line in file[:end].decode("ascii").splitlines()]
    order = next((_ORDERS.get(words[1]) for words in lines if words[:1] == ["format"]), None)
    if order is None:
        raise ValueError(f"its format must be one of {', '.join(_ORDERS)}")
    found: dict[str, _Rows] = {}
    values = [] if order else file[start:].split()
    place = start if order else 0
    for name, count, properties in _layout(lines):
        if order:
            found[name], place = _read_binary(file, place, count, properties, order)
        else:
            found[name], place = _read_ascii(values, place, count, properties)
    return found


def _layout(lines: list[list[str]]) -> list[tuple[str, int, list[_Property]]]:
    found: list[tuple[str, int, list[_Property]]] = []
    for words in lines:
        if words[:1] == ["element"]:
            found.append((words[1], int(words[2]), []))
            if found[-1][1] < 0:
                raise ValueError(f"the number of elements {words[1]!r} must not be negative, got {words[2]}")
        elif words[:2] == ["property", "list"]:
            found[-1][2].append((words[4], PLY_TYPES[words[3]], PLY_TYPES[words[2]]))
        elif words[:1] == ["property"]:
            found[-1][2].append((words[2], PLY_TYPES[words[1]], ""))
    return found


def _read_binary(file: bytes, place: int, count: int, properties: list[_Property], order: str) -> tuple[_Rows, int]:
    """Read an element with rows of equal length at once, and others row by row."""
    fields: list[Any] = []
    lengths, end = {}, place
    for number, (_, kind, length_kind) in enumerate(properties):
        size = 1
        if length_kind:
            length = np.dtype(order + length_kind)
            size = int(np.frombuffer(file, length, 1, end)[0]) if count else 0
            if size < 0:
                raise ValueError(f"a list has the length {size}")
            lengths[f"length_{number}"] = size
            fields.append((f"length_{number}", length))
            end += length.itemsize
        fields.append((f"value_{number}", order + kind, (size,)))
        end += size * np.dtype(kind).itemsize
    row = np.dtype(fields)
    fits = place + count * row.itemsize <= len(file)
    rows = np.frombuffer(file, row, count, place) if fits and row.itemsize else None
    if rows is None or not all(bool((rows[name] == size).all()) for name, size in lengths.items()):
        if not lengths:
            raise ValueError(f"it ends before its {count} elements of {row.itemsize} bytes each")
        return _read_row_by_row(file, place, count, properties, order)
    found = {}
    for number, (name, _, length_kind) in enumerate(properties):
        values = rows[f"value_{number}"]
        found[name] = values if length_kind else values[:, 0]
    return found, place + count * row.itemsize


def _read_row_by_row(file: bytes, place: int, count: int, properties: list[_Property], order: str) -> tuple[_Rows, int]:
    if count > len(file):
        raise ValueError(f"it ends before its {count} elements")
    lists: dict[str, list[Any]] = {name: [] for name, _, _ in properties}
    for _ in range(count):
        for name, kind, length_kind in properties:
            size = 1
            if length_kind:
                size = int(np.frombuffer(file, order + length_kind, 1, place)[0])
                place += np.dtype(length_kind).itemsize
            values = np.frombuffer(file, order + kind, size, place) if size else np.zeros(0, kind)
            place += values.nbytes
            lists[name].append(values if length_kind else values[0])
    return {name: lists[name] if is_list else np.array(lists[name], kind) for name, kind, is_list in properties}, place


def _read_ascii(words: list[bytes], place: int, count: int, properties: list[_Property]) -> tuple[_Rows, int]:
    if count > len(words) - place:
        raise ValueError(f"it ends before its {count} elements")
    if not any(length_kind for _, _, length_kind in properties):
        size = count * len(properties)
        rows = np.array(words[place : place + size], dtype=np.float64).reshape(count, len(properties))
        return {name: rows[:, column].astype(kind) for column, (name, kind, _) in enumerate(properties)}, place + size
    lists: dict[str, list[Any]] = {name: [] for name, _, _ in properties}
    for _ in range(count):
        for name, kind, length_kind in properties:
            size = int(words[place]) if length_kind else 1
            place += 1 if length_kind else 0
            values = np.array(words[place : place + size], dtype=np.float64).astype(kind)
            if len(values) != size:
                raise ValueError(f"it ends before its {count} elements")
            place += size
            lists[name].append(values if length_kind else values[0])
    return {name: lists[name] if is_list else np.array(lists[name], kind) for name, kind, is_list in properties}, place
