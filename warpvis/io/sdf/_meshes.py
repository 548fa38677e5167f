# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Geometries of SDF as meshes. Equal ones share their arrays, so that a scene recognizes instances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import truncate
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import FileFormatError, SceneError
from warpvis.io._meshes import read_mesh_file
from warpvis.io.sdf._files import Finder
from warpvis.io.sdf._shapes import Triangles, box, cone, plane, polylines, round_solid, terrain
from warpvis.io.sdf._xml import Node
from warpvis.scene import keep_winding
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance
from warpvis.scene.solids import Solid

SHAPES = (
    *("box", "sphere", "cylinder", "capsule", "ellipsoid", "cone", "plane", "mesh", "heightmap", "polyline"),
    *("image", "empty"),
)


@dataclass(frozen=True, eq=False)
class Piece:
    """A part of a geometry."""

    mesh: Triangles | Solid
    name: str = ""
    """Name of the part in a mesh file of several parts."""
    pose: NDArray[np.float64] | None = None
    """Pose in the geometry, ``(4, 4)``; None for the identity."""
    appearance: LazyAppearance | None = None
    """Its own appearance, of a mesh file."""
    uv: NDArray[np.float32] | None = None
    """Texture coordinates of a shape."""


@dataclass(eq=False)
class Shapes:
    """Reads geometries, each of which is read once."""

    finder: Finder
    strict: bool = False
    skipped: dict[str, None] = field(default_factory=dict)
    """Descriptions of geometries that were not read."""
    warnings: dict[str, None] = field(default_factory=dict)
    """Warnings of the readers of mesh files."""
    _cache: dict[Any, list[Piece]] = field(default_factory=dict)
    _nodes: dict[Path, dict[str, list[str]]] = field(default_factory=dict)

    def pieces(self, geometry: Node) -> list[Piece]:
        """Return the parts of a ``<geometry>``; none, with a note in `skipped`, if it cannot be read."""
        shapes = geometry.children(*SHAPES)
        if not shapes:
            if geometry.children():
                self.skip(f"<{truncate(geometry.children()[0].tag)}>", geometry, "is no known geometry")
            return []
        shape = shapes[0]
        match shape.tag:
            case "empty":
                return []
            case "image":
                self.skip("<image>", shape, "is not supported; use a heightmap or a mesh")
                return []
            case "mesh":
                return self._file_pieces(shape)
            case "heightmap":
                return self._terrain(shape)
            case "polyline":
                return self._shared(text_key(geometry), lambda: [Piece(polylines(geometry.children("polyline")))])
        return self._shared(text_key(shape), lambda: [_simple(shape)])

    def _shared(self, key: Any, make: Callable[[], list[Piece]]) -> list[Piece]:
        if key not in self._cache:
            self._cache[key] = make()
        return self._cache[key]

    def skip(self, subject: str, node: Node, reason: str) -> None:
        """Note what is not read, and why; raise an error if `strict` is set."""
        message = f"{subject} ({node.path}:{node.line}), which {reason}"
        if self.strict:
            raise FileFormatError(f"{node.path}:{node.line}: {subject} {reason}")
        self.skipped[message] = None

    def _found(self, shape: Node) -> Path | None:
        uri = shape.string("uri") or shape.string("filename") or shape.get("filename", "")
        if not uri:
            shape.fail("must have a <uri>")
        path = self.finder.file(uri, shape)
        if path is None:
            self.skip(truncate(uri), shape, "was not found; search_path adds folders to search")
        return path

    def _terrain(self, shape: Node) -> list[Piece]:
        path = self._found(shape)
        if path is None:
            return []
        try:
            return self._shared((path, text_key(shape)), lambda: [_terrain_piece(shape, path)])
        except FileFormatError as error:
            if self.strict:
                raise
            self.skipped[str(error)] = None
            return []

    def _file_pieces(self, shape: Node) -> list[Piece]:
        path = self._found(shape)
        if path is None:
            return []
        scale = shape.numbers("scale", (1.0, 1.0, 1.0))
        if 0 in scale:
            shape.fail("must have a scale other than 0")
        submesh = shape.string("submesh/name") or shape.string("submesh")
        center = shape.flag("submesh/center", False)
        parts = self.mesh_parts(path)
        if submesh and parts:
            names = {submesh, *self._collada_names(path).get(submesh, ())}
            chosen = [part for part in parts if any(_is_part(part.name, name) for name in names)]
            if not chosen:
                known = ", ".join(truncate(part.name) for part in parts[:5])
                self.skip(f"submesh {truncate(submesh)!r} of {path}", shape, f"has {known}")
            parts = chosen
        return self._shared((path, scale, submesh, center), lambda: _placed(parts, scale, center=center))

    def _collada_names(self, path: Path) -> dict[str, list[str]]:
        """Return the identifiers of meshes in a COLLADA file by the names of their nodes, which Gazebo uses."""
        if path.suffix.lower() != ".dae":
            return {}
        if path not in self._nodes:
            found: dict[str, list[str]] = {}
            for node in ElementTree.parse(path).iter():
                tag = node.tag.rpartition("}")[2]
                if tag == "node":
                    links = [item.get("url", "")[1:] for item in node if item.tag.endswith("}instance_geometry")]
                    for key in (node.get("name", ""), node.get("id", "")):
                        found.setdefault(key, []).extend(links)
                elif tag == "geometry" and node.get("name"):
                    found.setdefault(node.get("name", ""), []).append(node.get("id", ""))
            self._nodes[path] = found
        return self._nodes[path]

    def scaled(self, path: Path, scale: tuple[float, ...]) -> list[Piece]:
        """Return the parts of a mesh file, scaled."""
        return self._shared((path, scale, "", False), lambda: _placed(self.mesh_parts(path), scale, center=False))

    def mesh_parts(self, path: Path) -> list[Piece]:
        """Return the parts of a mesh file, in its own frame and in meters; none if it cannot be read."""
        key = path.resolve()
        if key not in self._cache:
            self._cache[key] = []
            try:
                model = path.parent.parent
                folders = [model, model / "materials" / "textures"]
                found = read_mesh_file(path, search_path=(), strict=self.strict, image_folders=folders)
                self.warnings.update(dict.fromkeys(found.warnings))
                self._cache[key] = [
                    Piece(
                        part.mesh,
                        part.name,
                        None if part.pose is None else _matrix(part.pose),
                        _lazy(part.appearance),
                    )
                    for part in found.parts
                    if not isinstance(part.mesh, Solid)
                ]
                if not self._cache[key]:
                    self.skipped[f"{path}, which has no triangles"] = None
            except (FileFormatError, SceneError) as error:
                if self.strict:
                    raise
                self.skipped[str(error)] = None
        return self._cache[key]


def _is_part(part: str, name: str) -> bool:
    """Return whether a part of a mesh file has a name, with or without a number."""
    head, _, number = part.rpartition("_")
    return part == name or (head == name and number.isdigit())


def _matrix(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    return poses_to_matrices(pose) if pose.shape[-1] == 7 else pose


def _lazy(appearance: Appearance | LazyAppearance | None) -> LazyAppearance | None:
    return LazyAppearance(None, appearance) if isinstance(appearance, Appearance) else appearance


def text_key(element: Node) -> tuple[object, ...]:
    """Return a key that is equal for elements with the same content."""
    return tuple((item.tag, (item.text or "").strip(), *sorted(item.items())) for item in element.iter())


def _simple(shape: Node) -> Piece:
    """Return a shape that is defined by numbers."""
    match shape.tag:
        case "box":
            mesh, uv = box(shape.positives("size", (1.0, 1.0, 1.0)))
            return Piece(mesh, uv=uv)
        case "plane":
            mesh, uv = plane(shape)
            return Piece(mesh, uv=uv)
        case "cone":
            return Piece(cone(shape))
    solid = round_solid(shape)
    assert solid is not None
    return Piece(solid)


def _terrain_piece(shape: Node, path: Path) -> Piece:
    mesh, uv = terrain(shape, path)
    return Piece(mesh, uv=uv)


def _placed(parts: list[Piece], scale: tuple[float, ...], *, center: bool) -> list[Piece]:
    """Return parts of a mesh file, scaled along the axes of the file, and centered if requested."""
    if scale == (1.0, 1.0, 1.0) and not center:
        return parts
    placed = []
    for part in parts:
        linear, offset = np.diag(scale), np.zeros(3)
        if part.pose is not None:
            linear, offset = linear @ part.pose[:3, :3], linear @ part.pose[:3, 3]
        assert not isinstance(part.mesh, Solid)
        vertices, faces = part.mesh
        vertices = np.asarray(vertices, dtype=np.float64) @ linear.T + offset
        mesh = vertices, keep_winding(faces, linear)
        appearance = None if part.appearance is None else part.appearance.transformed(linear)
        placed.append(replace(part, mesh=mesh, pose=None, appearance=appearance))
    if center and placed:
        corners = np.concatenate([part.mesh[0] for part in placed])  # type: ignore[index]  # no solids
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        placed = [replace(part, mesh=(part.mesh[0] - middle, part.mesh[1])) for part in placed]  # type: ignore[index]
    return placed
