# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the reader for a scene file, and export of scenes."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence

from warpvis.core.checks import as_items, as_path, check_flag
from warpvis.core.file_content import require_content
from warpvis.core.types import Json
from warpvis.errors import FileFormatError, SceneError
from warpvis.io._gltf_writer import gltf_chunks
from warpvis.io._meshes import read_mesh_file
from warpvis.scene import Axis, FileParts, SceneObject

_WEBOTS = (".wbt",)
_MUJOCO = (".xml", ".urdf")


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
    if not path.is_file():
        raise FileFormatError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}")
    missing = next((folder for folder in search_folders if not folder.is_dir()), None)
    if missing is not None:
        raise FileFormatError(f"{missing}: search_path must be folders, and this is not one")
    kind = path.suffix.lower()
    require_content(path, "a Webots world" if kind in _WEBOTS else "a model" if kind in _MUJOCO else "a mesh")
    if kind in _WEBOTS:
        from warpvis.webots import read_world

        return read_world(path, search_path=search_folders, strict=strict)
    if kind in _MUJOCO:
        from warpvis.mujoco import read_model

        return read_model(path, search_path=search_folders, strict=strict)
    return read_mesh_file(path, search_path=search_folders, strict=strict)


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
    try:
        with path.open("wb") as file:
            file.writelines(chunks)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be written: {error.strerror}") from None
