# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mesh files, read by trimesh: OBJ, STL, PLY, glTF and others."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warpvis.core.labels import Label
from warpvis.errors import FileFormatError, SceneError
from warpvis.scene import FileParts, Part, keep_winding

if TYPE_CHECKING:
    import trimesh
    from trimesh.resolvers import Resolver

_GLTF = (".glb", ".gltf")
_MOST_NAMED = 5


def read_mesh_file(path: Path, *, search_path: Sequence[Path], strict: bool) -> FileParts:
    """Read the parts of a mesh file; see `warpvis.Scene.load`.

    Raises:
        FileFormatError: The file does not parse, or a part of it has no triangles and `strict` is set.
        SceneError: `search_path` is given, and such a file names no other files that hold geometry.
    """
    suffix = path.suffix.lower()
    if search_path and suffix != ".gltf":
        raise SceneError(f"{path}: its geometry is all in one file: leave out search_path")
    parts, empty = _parts(_read(path, search_path), path)
    message = ""
    if empty:
        some = ", ".join(map(repr, empty[:_MOST_NAMED])) + (", ..." if len(empty) > _MOST_NAMED else "")
        message = f"{path}: left out {some}, which hold lines or points and no triangles"
    if strict and message:
        raise FileFormatError(message)
    return FileParts(path, parts, up="y" if suffix in _GLTF else None, warnings=(message,) if message else ())


def _read(path: Path, search_path: Sequence[Path]) -> trimesh.Scene:
    import trimesh

    kind = path.suffix.lower().lstrip(".")
    if kind not in trimesh.available_formats():
        known = ", ".join(sorted(trimesh.available_formats()))
        given = repr(path.suffix) if path.suffix else "a name without a suffix"
        raise FileFormatError(f"{path}: {given} is no format of scenes; those are wbt, xml, urdf, and {known}")
    # Face order and shared corners stay as they are in the file.
    options: dict[str, object] = {"process": False}
    try:
        if kind == "obj":
            options |= {"group_material": False, "skip_materials": True, **_obj_splits(path)}
        if search_path:
            options["resolver"] = _resolver(path, search_path)
        return trimesh.load_scene(path, **options)
    except Exception as error:  # trimesh's readers raise what they like
        said = " ".join(str(error).split()) or type(error).__name__
        raise FileFormatError(f"{path}: does not read as {kind.upper()}: {said}") from None


def _resolver(path: Path, search_path: Sequence[Path]) -> Resolver:
    """Make what finds the files that a glTF file names, beside it or in the folders."""
    from trimesh.resolvers import FilePathResolver

    class SearchPathResolver(FilePathResolver):
        def get(self, name: str) -> bytes:
            for place in (self, *map(FilePathResolver, map(str, search_path))):
                try:
                    return FilePathResolver.get(place, name)
                except (FileNotFoundError, ValueError):
                    continue
            raise FileNotFoundError(f"{name} is neither beside it nor on the search path")

    return SearchPathResolver(str(path))


def _obj_splits(path: Path) -> dict[str, bool]:
    """Make an OBJ file's objects parts; its groups where it names no objects."""
    text = path.read_bytes()
    objects = text.startswith(b"o ") or b"\no " in text
    return {"split_objects": objects, "split_groups": not objects}


def _parts(loaded: trimesh.Scene, path: Path) -> tuple[list[Part], list[str]]:
    """Return the parts of the file that have triangles, and the names of those that have none."""
    parts, empty = [], []
    for node in loaded.graph.nodes_geometry:
        placement, geometry = loaded.graph[node]
        mesh = loaded.geometry[geometry]
        if not len(getattr(mesh, "faces", ())):
            empty.append(str(node))
            continue
        extras = {**mesh.metadata, **_node_extras(loaded, node)}
        corners = np.c_[mesh.vertices, np.ones(len(mesh.vertices))] @ placement.T
        faces = keep_winding(mesh.faces, placement[:3, :3])
        parts.append(Part(str(node), (corners[:, :3], faces), Label.parse(extras.get("label", Label.OBSTACLE))))
    if len(parts) == 1 and parts[0].name in (path.name, "geometry_0"):  # a format without names
        parts = [Part(path.stem, parts[0].mesh, parts[0].label)]
    return parts, empty


def _node_extras(loaded: trimesh.Scene, node: str) -> dict[str, object]:
    for parent in loaded.graph.transforms.parents.get(node, ()), None:
        attributes = loaded.graph.transforms.edge_data.get((parent, node), {})
        if attributes.get("metadata"):
            return dict(attributes["metadata"])
    return {}
