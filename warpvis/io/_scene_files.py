# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the reader for a scene file, and export as binary glTF 2.0.

The export has a node per object; shared meshes are written once. Section numbers are those of the specification.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_items, as_path, check_flag
from warpvis.core.file_content import is_file, require_content, writing
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.core.types import Json
from warpvis.errors import FileFormatError, SceneError
from warpvis.io._meshes import read_mesh_file
from warpvis.io._readers import MODEL_CONFIG, RASTERS, SCENE_READERS
from warpvis.scene import Y_UP_TO_Z_UP, Axis, FileParts, SceneObject
from warpvis.scene.lights import HEADLIGHT

_FLOAT, _UNSIGNED = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
"""Targets of buffer views (3.6.2.1), which some programs require."""
_MAX_BYTES = 2**32 - 1
"""Maximum size of a file, whose length is a 32-bit number (4.4.2)."""


def read_parts(
    path: str | os.PathLike[str],
    *,
    search_path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] = (),
    strict: bool = False,
) -> FileParts:
    """Read the objects of a file; see `warpvis.Scene.load` for the arguments."""
    path, strict = as_path(path), check_flag(strict, "strict", FileFormatError)
    folders = (
        [search_path] if isinstance(search_path, os.PathLike) else as_items(search_path, "search_path", SceneError)
    )
    search_folders = [as_path(folder, "search_path") for folder in folders]
    if is_file(path / MODEL_CONFIG):  # the folder of a model of Gazebo
        path = path / MODEL_CONFIG
    if not path.is_file():
        raise FileFormatError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}")
    missing = next((folder for folder in search_folders if not folder.is_dir()), None)
    if missing is not None:
        raise FileFormatError(f"{missing}: search_path must be folders, and this is not one")
    reader, content = SCENE_READERS.get(path.suffix.lower(), ("", "a mesh"))
    require_content(path, content, images=path.suffix.lower() not in RASTERS)
    if reader:
        module, _, function = reader.partition(":")
        return getattr(import_module(module), function)(path, search_path=search_folders, strict=strict)
    if path.suffix.lower() in (".ply", ".glb"):
        from warpvis.io.datasets._scans import find_scan

        scan = find_scan(path, search_folders)
        if scan is not None:
            return scan()
    found = read_mesh_file(path, search_path=search_folders, strict=strict)
    return found if found.lights else replace(found, lights=(HEADLIGHT,))


def export_scene(
    path: str | os.PathLike[str], objects: Sequence[SceneObject], extras: Iterable[Json], up: Axis
) -> None:
    """Write objects as binary glTF, with `extras` for their nodes; see `Scene.export`."""
    path = as_path(path)
    if path.suffix.lower() != ".glb":
        raise FileFormatError(f"{path}: scenes are exported as binary glTF, so the name must end in .glb")
    try:
        chunks = gltf_chunks(objects, extras, up)
    except ValueError as error:
        raise FileFormatError(f"{path}: {error}") from None
    with writing(path), path.open("wb") as file:
        file.writelines(chunks)


class _Buffer:
    """The bytes of a file, and the JSON that describes them."""

    def __init__(self) -> None:
        self.chunks: list[bytes] = []
        self.length = 0
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, rows: np.ndarray, target: int, **more: Any) -> int:
        """Add an accessor whose data is a multiple of four bytes long, and return its index."""
        data = rows.tobytes()
        self.views.append({"buffer": 0, "byteOffset": self.length, "byteLength": len(data), "target": target})
        self.accessors.append({"bufferView": len(self.views) - 1, "count": len(rows), **more})
        self.chunks.append(data)
        self.length += len(data)
        return len(self.accessors) - 1

    def add_mesh(self, vertices: NDArray[np.float32], faces: NDArray[np.int32], name: str) -> dict[str, Any]:
        """Add the arrays of a mesh, and return its JSON; raise a `ValueError` if a vertex is not finite."""
        if not np.isfinite(vertices).all():
            raise ValueError(f"vertices of {name!r} must be finite")
        box = {"min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist()}
        corners = faces.astype("<u4").reshape(-1)
        place = self.add(vertices.astype("<f4"), _VERTICES, componentType=_FLOAT, type="VEC3", **box)
        order = self.add(corners, _INDICES, componentType=_UNSIGNED, type="SCALAR")
        return {"primitives": [{"attributes": {"POSITION": place}, "indices": order}]}


def gltf_chunks(objects: Sequence[SceneObject], extras: Iterable[Json], up: Axis) -> list[bytes]:
    """Write objects, with `extras` for their nodes, as the parts of a binary glTF file, whose vertical axis is y."""
    upright = Y_UP_TO_Z_UP.T if up == "z" else np.eye(4)
    buffer, meshes, nodes = _Buffer(), list[dict[str, Any]](), list[dict[str, Any]]()
    known: dict[tuple[int, int], int] = {}
    referenced = []  # keeps the arrays alive whose ids are in `known`
    for item, metadata, placement in zip(objects, extras, _placements(objects, upright), strict=True):
        vertices = _frame_vertices(item)
        if vertices is None:
            vertices = item.vertices @ upright[:3, :3].T.astype(np.float32)
        arrays = id(vertices), id(item.faces)
        if arrays not in known:
            known[arrays] = len(meshes)
            referenced.append((vertices, item.faces))
            meshes.append({"name": item.name, **buffer.add_mesh(vertices, item.faces, item.name)})
        nodes.append({"name": item.name, "extras": metadata, **placement, "mesh": known[arrays]})
    content = {
        "asset": {"version": "2.0", "generator": "warpvis"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": buffer.length}],
    }
    return _chunks(json.dumps(content, separators=(",", ":")).encode(), buffer)


def _frame_vertices(item: SceneObject) -> NDArray[np.float32] | None:
    """Return an object's vertices in its own frame; None if deforming or static, with vertices in the world's frame."""
    return item.mesh.rounded if item.shares_mesh or (item.pose is not None and item.points is None) else None


def _placements(objects: Sequence[SceneObject], upright: NDArray[np.float64]) -> Iterator[dict[str, list[float]]]:
    """Yield the transform of each object's node; an empty one for vertices in the world's frame."""
    has_frame = np.array([_frame_vertices(item) is not None for item in objects])
    rows = np.array([item.place for item, flag in zip(objects, has_frame, strict=True) if flag]).reshape(-1, 7)
    placed = iter(poses_to_opencv(upright @ poses_to_matrices(rows)).tolist() if len(rows) else ())
    for flag in has_frame:
        row = next(placed) if flag else None
        yield {} if row is None else {"translation": row[:3], "rotation": row[3:]}


def _chunks(text: bytes, buffer: _Buffer) -> list[bytes]:
    """Add the header and chunk headers to JSON and data (4.4), both padded to a multiple of four bytes."""
    text += b" " * (-len(text) % 4)
    length = 12 + 8 + len(text) + 8 + buffer.length
    if length > _MAX_BYTES:
        raise ValueError(f"binary glTF has at most {_MAX_BYTES} bytes, but this file would have {length}")
    head = b"glTF" + _word(2) + _word(length)
    return [head, _word(len(text)) + b"JSON", text, _word(buffer.length) + b"BIN\0", *buffer.chunks]


def _word(number: int) -> bytes:
    return number.to_bytes(4, "little")
