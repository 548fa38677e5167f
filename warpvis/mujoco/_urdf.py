# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compilation of URDF robots by MuJoCo, with meshes found in ROS packages and read by `Scene.load`.

MuJoCo's decoder reads only the first object of an OBJ file, few other formats, and at most 200,000 triangles of STL.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Container, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import truncate
from warpvis.core.file_content import is_file
from warpvis.errors import FileFormatError, SceneError
from warpvis.scene import Scene, SceneObject
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance, Material

VISUAL_GROUP = 1
"""The group of geoms of visual elements in MuJoCo; geoms of collision elements are in group 0."""

_READ_BY_MUJOCO = ".msh"  # MuJoCo's format
_NO_MESHES = (".wbt", ".xml", ".urdf")  # formats of `Scene.load` that are not meshes
_MIN_VERTICES = 4  # MuJoCo's minimum for a mesh
_SCHEME = re.compile(r"(package|model|file)://(.*)")

# MuJoCo requires mass and inertia of moving bodies.
_MIN_MASS, _MIN_INERTIA = 1e-6, 1e-9

_DEFAULT_COLOR = "0.5 0.5 0.5 1"
"""MuJoCo's default color of geoms."""
_UNCOLORED = "warpvis-without-color-"
"""Prefix of temporary names of elements without a color."""


class _Mesh(NamedTuple):
    """The triangles of a mesh file, and their appearance, if the file has any."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    appearance: LazyAppearance | None


class CompiledRobot(NamedTuple):
    """A robot compiled by MuJoCo."""

    model: mujoco.MjModel
    groups: tuple[int, ...]
    """Groups of its visible geoms."""
    appearances: dict[int, LazyAppearance]
    """Appearances from mesh files, by geom, for geoms without a color; texture coordinates are per face corner."""
    skipped: list[str]
    """Descriptions of skipped meshes, as parts of a sentence."""
    warnings: list[str]
    """Warnings of the mesh readers."""


def compile_urdf(path: Path, robot: ElementTree.Element, search_path: Sequence[Path], *, strict: bool) -> CompiledRobot:
    """Compile the visual elements of a robot, or its collision elements if it has none, without masses.

    The root element is modified. With `strict`, a part of a mesh file without triangles is an error.

    Raises:
        ValueError: If MuJoCo cannot compile it.
    """
    found = _Meshes(path, search_path, strict)
    shown, hidden, groups = "visual", "collision", (VISUAL_GROUP,)
    if not _prepare(robot, shown, found):
        shown, hidden, groups = "collision", "visual", (0,)
        _prepare(robot, shown, found)
    colored = {item.get("name") for item in robot.iter("material") if item.find("color") is not None}
    names, uncolored = {""}, dict[str, str]()
    for link in robot.iter("link"):
        for element in [item for item in link if item.tag in (hidden, "inertial")]:
            link.remove(element)
        for element in link.iter(shown):
            name = element.attrib.pop("name", "")
            if name in names:  # MuJoCo warns about duplicates; the link's name suffices
                name = ""
            names.add(name)
            if not _set_color(element, colored):
                uncolored[f"{_UNCOLORED}{len(uncolored)}"] = name
                name = f"{_UNCOLORED}{len(uncolored) - 1}"
            if name:
                element.set("name", name)
    # Keep fixed links, visual elements, and paths.
    options = robot.find("mujoco/compiler")
    if options is None:
        options = ElementTree.SubElement(ElementTree.SubElement(robot, "mujoco"), "compiler")
    options.attrib.update(strippath="false", discardvisual="false", fusestatic="false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, encoding="unicode"))
    spec.compiler.balanceinertia = True
    spec.compiler.boundmass, spec.compiler.boundinertia = _MIN_MASS, _MIN_INERTIA
    meshes = {asset.name: found.read.get(asset.file) for asset in spec.meshes}
    for asset in spec.meshes:
        asset.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # open meshes have no volume
        mesh = meshes[asset.name]
        if mesh is not None:
            asset.file = ""
            asset.uservert, asset.userface = mesh.vertices.ravel(), mesh.faces.ravel()
    uncolored_geoms = []
    for geom in spec.geoms:
        if geom.name in uncolored:
            geom.name = uncolored[geom.name]
            mesh = meshes.get(geom.meshname)
            uncolored_geoms += [(geom, mesh)] if mesh is not None and mesh.appearance is not None else []
    model = spec.compile()
    appearances = {geom.id: _compiled_appearance(model, geom.id, mesh) for geom, mesh in uncolored_geoms}
    return CompiledRobot(model, groups, appearances, found.skipped(), found.warnings)


@dataclass
class _Meshes:
    """The mesh files of a robot."""

    path: Path
    search_path: Sequence[Path]
    strict: bool
    read: dict[str, _Mesh | None] = field(default_factory=dict)
    """Meshes by path; None for files without triangles."""
    missing: list[str] = field(default_factory=list)
    """URLs whose files were not found."""
    warnings: list[str] = field(default_factory=list)

    def find(self, url: str) -> str | None:
        """Read a mesh and return its path; None if there is no such file, or it has no triangles."""
        found = _find_mesh(url, self.path, self.search_path)
        if found is None:
            self.missing.append(url)
            return None
        name = str(found)
        if name not in self.read and found.suffix.lower() != _READ_BY_MUJOCO:
            self.read[name] = _read_mesh(found, self.warnings, strict=self.strict)
        return None if self.read.get(name, ()) is None else name

    def skipped(self) -> list[str]:
        """Describe missing meshes and meshes without triangles, as parts of a sentence."""
        parts = []
        if self.missing:
            names = ", ".join(map(truncate, dict.fromkeys(self.missing)))
            searched = "in the robot's folder, in packages above it, or on the search path"
            parts.append(f"{names}, whose files were not found {searched}")
        empty = ", ".join(name for name, mesh in self.read.items() if mesh is None)
        return [*parts, f"{empty}, without triangles"] if empty else parts


def _prepare(robot: ElementTree.Element, tag: str, meshes: _Meshes) -> bool:
    """Write paths of meshes into links' elements, and remove elements without a surface; return whether any remain."""
    count = 0
    for link in robot.iter("link"):
        for element in link.findall(tag):
            mesh = element.find("geometry/mesh")
            name = "" if mesh is None else meshes.find(mesh.get("filename", ""))
            if name is None or any(_is_zero(shape.get("radius", "")) for shape in element.iterfind("geometry/*")):
                link.remove(element)
                continue
            count += 1
            if mesh is not None:
                mesh.set("filename", name)
    return count > 0


def _is_zero(number: str) -> bool:
    try:
        return float(number) == 0
    except ValueError:  # MuJoCo raises an error with the line
        return False


def _set_color(element: ElementTree.Element, colored: Container[str | None]) -> bool:
    """Set MuJoCo's default color for an element without a color, for which MuJoCo uses the previous element's.

    Return whether the element has a color.
    """
    material = element.find("material")
    if material is None:
        material = ElementTree.SubElement(element, "material", name="")
    if material.find("color") is None and material.get("name") not in colored:
        ElementTree.SubElement(material, "color", rgba=_DEFAULT_COLOR)
        return False
    return True


def _compiled_appearance(model: mujoco.MjModel, geom: int, mesh: _Mesh) -> LazyAppearance:
    """Return a mesh's appearance for the compiled faces, whose corners MuJoCo reorders where they are mirrored."""
    number = int(model.geom_dataid[geom])
    first = int(model.mesh_faceadr[number])
    compiled = model.mesh_face[first : first + len(mesh.faces)].copy()

    def make() -> Appearance | None:
        assert mesh.appearance is not None
        found = mesh.appearance.get()
        if found is None or (found.uv is None and not found.map_uv):
            return found
        order = (compiled[:, :, None] == mesh.faces[:, None, :]).argmax(axis=2)
        uv = found.corner_uv(mesh.faces)
        ordered = None if uv is None else np.take_along_axis(uv, order[:, :, None], axis=1)
        map_uv = {name: np.take_along_axis(rows, order[:, :, None], axis=1) for name, rows in found.map_uv.items()}
        return replace(found, uv=ordered, map_uv=map_uv)

    return LazyAppearance(make)


def _find_mesh(url: str, path: Path, search_path: Sequence[Path]) -> Path | None:
    """Find the file of a mesh in packages of the search path or of parent folders, or in the robot file's folder."""
    folder = path.resolve().parent
    scheme = _SCHEME.fullmatch(url)
    kind, relative = (scheme[1], scheme[2]) if scheme else ("", url)
    if kind in ("package", "model"):
        relative = relative.lstrip("/")
    places = [folder / relative] if kind in ("", "file") else []
    for root in search_path:
        places.append(root / relative)
        package, _, tail = relative.partition("/")
        if kind in ("package", "model") and root.resolve().name == package:
            places.append(root / tail)
    if kind in ("package", "model"):
        places += [parent / relative for parent in folder.parents] + [folder / relative]
    return next((place.resolve() for place in places if url and is_file(place)), None)


def _read_mesh(path: Path, warned: list[str], *, strict: bool) -> _Mesh | None:
    """Read all triangles of a mesh file in the file's frame; return None if it has none.

    Without colors in the file, vertices at the same position are merged, so that MuJoCo's normals are smooth.
    """
    if path.suffix.lower() in _NO_MESHES:
        raise FileFormatError(f"{path}: must be a mesh file, got {path.suffix}")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            scene = Scene.load(path, device="cpu", up="z", file_up="z", strict=strict)
        except FileFormatError:
            raise
        except SceneError:
            return None
        finally:
            warned += [str(item.message) for item in caught]
    sizes = np.cumsum([0, *(len(item.vertices) for item in scene)])
    faces = np.concatenate([item.faces + first for item, first in zip(scene, sizes, strict=False)])
    vertices, appearance = np.concatenate([item.vertices for item in scene]), join_appearances(list(scene))
    if appearance is None:
        vertices, places = np.unique(vertices, axis=0, return_inverse=True)
        faces = places.reshape(-1)[faces]
    few = max(0, _MIN_VERTICES - len(vertices))
    return _Mesh(np.concatenate([vertices, vertices[:1].repeat(few, axis=0)]), faces.astype(np.int32), appearance)


_GRAY = Material(base_color=(0.5, 0.5, 0.5, 1.0))
"""MuJoCo's default material."""


def join_appearances(items: Sequence[SceneObject]) -> LazyAppearance | None:
    """Return the lazily loaded appearance of objects that are concatenated in order; None if no object has any."""
    return LazyAppearance(partial(_joined, items)) if any(map(_has_colors, items)) else None


def _has_colors(item: SceneObject) -> bool:
    return item.lazy_appearance is not None and item.lazy_appearance.has_colors


def _joined(items: Sequence[SceneObject]) -> Appearance | None:
    found = [item.appearance if _has_colors(item) else None for item in items]
    if not any(found):
        return None
    appearances = [appearance or Appearance((_GRAY,)) for appearance in found]
    firsts = np.cumsum([0, *(len(appearance.materials) for appearance in appearances)])
    faces, corners = [len(item.faces) for item in items], [len(item.vertices) for item in items]
    numbers = _filled([appearance.face_materials for appearance in appearances], faces, 0, ())
    uv = [appearance.corner_uv(item.faces) for item, appearance in zip(items, appearances, strict=True)]
    maps = dict.fromkeys(name for appearance in appearances for name in appearance.map_uv)
    map_uv = {
        name: [appearance.corner_uv(item.faces, name) for item, appearance in zip(items, appearances, strict=True)]
        for name in maps
    }
    return Appearance(
        tuple(material for appearance in appearances for material in appearance.materials),
        (np.repeat(firsts[:-1], faces) + (0 if numbers is None else numbers)).astype(np.int32),
        _filled(uv, faces, 0, (3, 2)),
        _filled([_floats(appearance.vertex_colors) for appearance in appearances], corners, 1, (4,)),
        _filled([_floats(appearance.face_colors) for appearance in appearances], faces, 1, (4,)),
        map_uv={name: rows for name, parts in map_uv.items() if (rows := _filled(parts, faces, 0, (3, 2))) is not None},
    )


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
