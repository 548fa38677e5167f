# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mesh files, read and written by trimesh: OBJ, STL, PLY, glTF and others."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpvis.core.labels import Label, LabelPatterns
from warpvis.core.poses import check_up
from warpvis.errors import FileFormatError, SceneError
from warpvis.scene import keep_winding

if TYPE_CHECKING:
    import trimesh

    from warpvis.scene import Scene

_GLTF = (".glb", ".gltf")

# Turns geometry whose vertical axis is y upright in a world whose vertical axis is z: (x, y, z) to (x, -z, y).
_Y_UP_TO_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def load_scene(
    scene: Scene,
    path: str | os.PathLike[str],
    *,
    file_up: str | None,
    scale: float,
    labels: Mapping[str, Label | int | str],
) -> Scene:
    """Fill `scene` with the objects of a file; see `Scene.load`."""
    path = Path(path)
    if path.suffix.lower() == ".wbt":
        return _load_world(scene, path, file_up=file_up, scale=scale, labels=labels)
    loaded = _read(path)
    if file_up is None:
        file_up = "y" if path.suffix.lower() in _GLTF else scene.up
    check_up(file_up)
    upright = np.eye(4)
    if file_up != scene.up:
        upright = _Y_UP_TO_Z_UP if file_up == "y" else _Y_UP_TO_Z_UP.T

    patterns = LabelPatterns(labels)
    for name, mesh, placement, own_label in _parts(loaded, path):
        corners = np.c_[mesh.vertices, np.ones(len(mesh.vertices))] @ (upright @ placement).T
        faces = keep_winding(mesh.faces, placement[:3, :3])
        scene.add((corners[:, :3], faces), name=name, label=patterns.label(name, own_label), scale=scale)
    if not len(scene):
        raise SceneError(f"{path}: holds no triangles")
    patterns.require_used((item.name for item in scene.objects), path)
    return scene


def _load_world(
    scene: Scene, path: Path, *, file_up: str | None, scale: float, labels: Mapping[str, Label | int | str]
) -> Scene:
    """A Webots world, on the device of `scene`, with the vertical axis that the file says."""
    from warpvis.webots import load_webots

    if scale != 1 or file_up is not None:
        raise SceneError(f"{path}: a Webots world is in metres and says which axis is up: leave out scale and file_up")
    loaded = load_webots(path, device=scene.device, labels=labels).scene
    if scene.up == "y" and loaded.up != "y":
        raise SceneError(f"{path}: the world's vertical axis is z: leave out up")
    return loaded


def export_scene(scene: Scene, path: str | os.PathLike[str]) -> None:
    """Write a scene as binary glTF; see `Scene.export`."""
    path = Path(path)
    if path.suffix.lower() != ".glb":
        raise FileFormatError(f"{path}: scenes are exported as binary glTF, so the name must end in .glb")
    exported = scene.to_trimesh()
    if scene.up == "z":
        exported.apply_transform(_Y_UP_TO_Z_UP.T)
    try:
        path.write_bytes(exported.export(file_type="glb"))
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be written: {error.strerror}") from None


def _read(path: Path) -> trimesh.Scene:
    import trimesh

    if not path.is_file():
        raise FileFormatError(f"{path}: no such file")
    kind = path.suffix.lower().lstrip(".")
    if kind not in trimesh.available_formats():
        known = ", ".join(sorted(trimesh.available_formats()))
        raise FileFormatError(f"{path}: {path.suffix or 'no suffix'!r} is not a mesh format; trimesh reads {known}")
    # Face order and shared corners stay as they are in the file.
    options: dict[str, Any] = {"process": False}
    try:
        if kind == "obj":
            options |= {"group_material": False, "skip_materials": True, **_obj_splits(path)}
        return trimesh.load_scene(path, **options)
    except Exception as error:  # trimesh's readers raise what they like
        raise FileFormatError(f"{path}: does not read as {kind.upper()}: {error or type(error).__name__}") from None


def _obj_splits(path: Path) -> dict[str, bool]:
    """An OBJ file's objects become parts; its groups do where it names no objects."""
    text = path.read_bytes()
    objects = text.startswith(b"o ") or b"\no " in text
    return {"split_objects": objects, "split_groups": not objects}


def _parts(loaded: trimesh.Scene, path: Path) -> list[tuple[str, trimesh.Trimesh, np.ndarray, Label]]:
    """Name, mesh, mesh-to-file matrix and label of every part of the file that has triangles."""
    parts = []
    for node in loaded.graph.nodes_geometry:
        placement, geometry = loaded.graph[node]
        mesh = loaded.geometry[geometry]
        if len(getattr(mesh, "faces", ())):
            extras = {**mesh.metadata, **_node_extras(loaded, node)}
            parts.append((str(node), mesh, placement, Label.parse(extras.get("label", Label.OBSTACLE))))
    if len(parts) == 1 and parts[0][0] in (path.name, "geometry_0"):  # a format without names
        parts = [(path.stem, *parts[0][1:])]
    return parts


def _node_extras(loaded: trimesh.Scene, node: str) -> dict[str, Any]:
    for parent in loaded.graph.transforms.parents.get(node, ()), None:
        attributes = loaded.graph.transforms.edge_data.get((parent, node), {})
        if attributes.get("metadata"):
            return dict(attributes["metadata"])
    return {}
