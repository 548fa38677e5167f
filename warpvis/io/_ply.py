# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Workarounds for trimesh's PLY reader, applied to the bytes before they are parsed.

The reader requires Unix line ends in headers, and binary faces with equal numbers of corners; Rhino writes old Mac line
ends, and Blender and MeshLab write triangles among quads. It drops colors of vertices if there are texture coordinates,
also without an image.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance, Material, Texture

_END = b"\rend_header\r"
PLY_TYPES = {
    **{name: code for names, code in (("char int8", "i1"), ("uchar uint8", "u1")) for name in names.split()},
    **{name: code for names, code in (("short int16", "i2"), ("ushort uint16", "u2")) for name in names.split()},
    **{name: code for names, code in (("int int32", "i4"), ("uint uint32", "u4")) for name in names.split()},
    **{name: code for names, code in (("float float32", "f4"), ("double float64", "f8")) for name in names.split()},
}
_TEXTURE = re.compile(rb"^comment\s+TextureFile\s+(\S.*?)\s*$", re.MULTILINE | re.IGNORECASE)
_CORNER_COORDINATES = re.compile(rb"^property\s+list\s+\S+\s+\S+\s+texcoord\s*$", re.MULTILINE)
_UNUSED = rb"^(property\s.*\s)(%s)(\s*)$"
_Element = tuple[str, int, list[list[str]]]
"""Name, count, and the words of its properties."""


def ply_texture(file: bytes) -> str:
    """Return the name of the image of a PLY file; empty if there is none."""
    match = _TEXTURE.search(_header(file))
    return "" if match is None else match[1].decode("utf-8", errors="replace")


def ply_appearance(texture: Texture, _: str, base: LazyAppearance | None, __: int) -> LazyAppearance | None:
    """Return the texture with the coordinates that trimesh read; without any, the colors."""

    def make() -> Appearance | None:
        found = None if base is None else base.get()
        if found is None or found.uv is None:
            return found
        return Appearance((Material(texture=texture),), uv=found.uv)

    return None if base is None else LazyAppearance(make)


def has_corner_coordinates(file: bytes) -> bool:
    """Return whether the corners of faces have texture coordinates, which may differ at a vertex."""
    return _CORNER_COORDINATES.search(_header(file)) is not None


def without_coordinates(file: bytes) -> bytes:
    """Rename the texture coordinates, so that trimesh does not read them."""
    return _renamed(file, b"texture_u|texture_v|u|v|s|t|texcoord")


def without_normals(file: bytes) -> bytes:
    """Rename the normals of vertices, so that trimesh does not read them."""
    return _renamed(file, b"nx|ny|nz")


def _header(file: bytes) -> bytes:
    return file[: file.find(b"end_header") + 1]


def _renamed(file: bytes, names: bytes) -> bytes:
    header = _header(file)
    return re.sub(_UNUSED % names, rb"\1unused_\2\3", header, flags=re.MULTILINE) + file[len(header) :]


def straighten_ply(file: bytes) -> bytes:
    """Convert PLY files that trimesh cannot read to an equivalent one that it can; return other data unchanged."""
    if file.startswith(b"ply\r") and not file.startswith(b"ply\r\n"):
        head, end, body = file.partition(_END)
        file = (head + end).replace(b"\r", b"\n") + body if end else file
    try:
        return _with_triangles(file)
    except (IndexError, KeyError, ValueError):  # trimesh reports the error
        return file


def _with_triangles(file: bytes) -> bytes:
    """Triangulate the faces of a binary file with different numbers of corners, and drop all other face properties."""
    start = file.index(b"\n", file.index(b"end_header")) + 1
    lines = [line.split() for line in file[:start].decode("ascii").splitlines()]
    kind = next(words[1] for words in lines if words[0] == "format")
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}[kind]
    elements = _elements(lines)
    if [element[0] for element in elements[:2]] != ["vertex", "face"]:
        return file
    (_, vertices, scalars), (_, count, properties) = elements[:2]
    place = start + vertices * sum(np.dtype(PLY_TYPES[code]).itemsize for _, code, _ in scalars)
    layout = [_Property(words, order) for words in properties]
    if _are_alike(file, place, count, layout):
        return file
    corners = [face for face in _corners(file, place, count, layout) if len(face) > 2]
    fans = [np.stack([np.broadcast_to(face[:1], len(face) - 2), face[1:-1], face[2:]], axis=1) for face in corners]
    triangles = np.concatenate([np.zeros((0, 3), dtype=np.int64), *fans])
    rows = np.zeros(len(triangles), dtype=[("count", "u1"), ("corners", order + "i4", 3)])
    rows["count"], rows["corners"] = 3, triangles
    head = ["ply", f"format {kind} 1.0", f"element vertex {vertices}"]
    head += [f"property {code} {name}" for _, code, name in scalars]
    head += [f"element face {len(rows)}", "property list uchar int vertex_indices", "end_header\n"]
    return "\n".join(head).encode() + file[start:place] + rows.tobytes()


class _Property:
    """A scalar or list property of a face."""

    def __init__(self, words: list[str], order: str) -> None:
        self.is_list = words[1] == "list"
        kinds = [np.dtype(order + PLY_TYPES[word]) for word in words[1:-1] if word != "list"]
        self.first, self.items = kinds[0], kinds[-1]
        self.is_corners = words[-1] in ("vertex_indices", "vertex_index")


def _elements(lines: list[list[str]]) -> list[_Element]:
    found: list[_Element] = []
    for words in lines:
        if words[0] == "element":
            found.append((words[1], int(words[2]), []))
        elif words[0] == "property":
            found[-1][2].append(words)
    return found


def _are_alike(file: bytes, place: int, count: int, layout: list[_Property]) -> bool:
    """Return whether all faces have as many corners and list items as the first, or there are no corners at all."""
    if not count or not any(item.is_list and item.is_corners for item in layout):
        return True
    fields, lengths, end = [], {}, place
    for number, item in enumerate(layout):
        if not item.is_list:
            fields.append((f"value_{number}", item.first, (1,)))
            end += item.first.itemsize
            continue
        length = max(0, int(np.frombuffer(file, item.first, 1, end)[0]))
        lengths[f"length_{number}"] = length
        fields += [(f"length_{number}", item.first, (1,)), (f"items_{number}", item.items, (length,))]
        end += item.first.itemsize + length * item.items.itemsize
    row = np.dtype(fields)
    if place + count * row.itemsize > len(file):
        return False
    rows = np.frombuffer(file, row, count, place)
    return all(bool((rows[name] == length).all()) for name, length in lengths.items())


def _corners(file: bytes, place: int, count: int, layout: list[_Property]) -> list[NDArray[np.int64]]:
    """Read the corners of each face sequentially, since the faces have different lengths."""
    faces = []
    for _ in range(count):
        for item in layout:
            if not item.is_list:
                place += item.first.itemsize
                continue
            length = int(np.frombuffer(file, item.first, 1, place)[0])
            if length < 0:
                raise ValueError
            place += item.first.itemsize
            if item.is_corners:
                faces.append(np.frombuffer(file, item.items, length, place).astype(np.int64))
            place += length * item.items.itemsize
    return faces
