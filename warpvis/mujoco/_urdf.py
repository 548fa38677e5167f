# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""URDF robots as MuJoCo compiles them, with meshes found where ROS packages have them and read by `Scene.load`.

MuJoCo's own decoder keeps only the first object of an OBJ file, does not read most other formats, and takes at most
200,000 triangles of STL.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Container, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import truncate
from warpvis.core.file_content import is_file
from warpvis.errors import FileFormatError, SceneError
from warpvis.mujoco._robot_appearances import join_appearances
from warpvis.scene import Scene
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance

VISUAL_GROUP = 1
"""The group of geoms that MuJoCo makes of visual elements; those of collision elements are in group 0."""

_READ_BY_MUJOCO = ".msh"  # its own format
_NO_MESHES = (".wbt", ".xml", ".urdf")  # `Scene.load` reads these, too
_MIN_VERTICES = 4  # MuJoCo compiles no mesh with fewer
_SCHEME = re.compile(r"(package|model|file)://(.*)")

# MuJoCo compiles no body that moves without mass.
_MIN_MASS, _MIN_INERTIA = 1e-6, 1e-9

_DEFAULT_COLOR = "0.5 0.5 0.5 1"
"""Of geoms in MuJoCo."""
_UNCOLORED = "warpvis-without-color-"
"""Begins the names, while MuJoCo reads the file, of elements without a color of their own."""


class _Mesh(NamedTuple):
    """The triangles of a mesh file, and what they look like, if the file says it."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    appearance: LazyAppearance | None


class CompiledRobot(NamedTuple):
    """A robot as MuJoCo compiles it."""

    model: mujoco.MjModel
    groups: tuple[int, ...]
    """The groups of its geoms."""
    appearances: dict[int, LazyAppearance]
    """Appearances that mesh files give geoms without a color of their own; coordinates are of corners of faces."""
    left_out: list[str]
    """Meshes that are left out, as parts of a sentence."""
    warnings: list[str]
    """Of the meshes' readers."""


def compile_urdf(path: Path, robot: ElementTree.Element, search_path: Sequence[Path], *, strict: bool) -> CompiledRobot:
    """Compile a robot as it looks, without masses: its visual elements, or else its collision elements.

    Args:
        path: Its file.
        robot: The file's root, which is changed.
        search_path: Folders to look for packages and meshes in.
        strict: Whether a part of a mesh file without triangles is an error.

    Raises:
        ValueError: MuJoCo does not compile it.
        FileFormatError: A mesh does not parse, or `strict` is set and a part of it has no triangles.
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
            if name in names:  # MuJoCo prints a warning about one that is taken; the link's name identifies it, too
                name = ""
            names.add(name)
            if not _set_color(element, colored):
                uncolored[f"{_UNCOLORED}{len(uncolored)}"] = name
                name = f"{_UNCOLORED}{len(uncolored) - 1}"
            if name:
                element.set("name", name)
    # Links keep their names, whether or not they move; what is drawn stays; paths are as they are written.
    options = robot.find("mujoco/compiler")
    if options is None:
        options = ElementTree.SubElement(ElementTree.SubElement(robot, "mujoco"), "compiler")
    options.attrib.update(strippath="false", discardvisual="false", fusestatic="false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, encoding="unicode"))
    spec.compiler.balanceinertia = True
    spec.compiler.boundmass, spec.compiler.boundinertia = _MIN_MASS, _MIN_INERTIA
    meshes = {asset.name: found.read.get(asset.file) for asset in spec.meshes}
    for asset in spec.meshes:
        asset.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # what is open has no volume
        mesh = meshes[asset.name]
        if mesh is not None:
            asset.file = ""
            asset.uservert, asset.userface = mesh.vertices.ravel(), mesh.faces.ravel()
    own = []
    for geom in spec.geoms:
        if geom.name in uncolored:
            geom.name = uncolored[geom.name]
            mesh = meshes.get(geom.meshname)
            own += [(geom, mesh)] if mesh is not None and mesh.appearance is not None else []
    model = spec.compile()
    appearances = {geom.id: _compiled_appearance(model, geom.id, mesh) for geom, mesh in own}
    return CompiledRobot(model, groups, appearances, found.left_out(), found.warnings)


@dataclass
class _Meshes:
    """The mesh files of a robot."""

    path: Path
    search_path: Sequence[Path]
    strict: bool
    read: dict[str, _Mesh | None] = field(default_factory=dict)
    """Meshes by path; None for files without triangles."""
    missing: list[str] = field(default_factory=list)
    """URLs of which there is no file."""
    warnings: list[str] = field(default_factory=list)

    def find(self, url: str) -> str | None:
        """Return the path of a mesh and read it; None if there is no such file, or no triangle in it."""
        found = _find_mesh(url, self.path, self.search_path)
        if found is None:
            self.missing.append(url)
            return None
        name = str(found)
        if name not in self.read and found.suffix.lower() != _READ_BY_MUJOCO:
            self.read[name] = _read_mesh(found, self.warnings, strict=self.strict)
        return None if self.read.get(name, ()) is None else name

    def left_out(self) -> list[str]:
        """Describe what was not found and what has no triangles, as parts of a sentence."""
        parts = []
        if self.missing:
            names = ", ".join(map(truncate, dict.fromkeys(self.missing)))
            parts.append(f"{names}, of which no file was found beside it, in packages above it, or on the search path")
        empty = ", ".join(name for name, mesh in self.read.items() if mesh is None)
        return [*parts, f"{empty}, without triangles"] if empty else parts


def _prepare(robot: ElementTree.Element, tag: str, meshes: _Meshes) -> bool:
    """Write paths of meshes into links' elements, and remove elements without a surface; return whether one is left."""
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
    except ValueError:  # MuJoCo's error names the line
        return False


def _set_color(element: ElementTree.Element, colored: Container[str | None]) -> bool:
    """Give MuJoCo's default color to an element without one, to which MuJoCo gives that of the element before.

    Returns:
        Whether it has a color of its own.
    """
    material = element.find("material")
    if material is None:
        material = ElementTree.SubElement(element, "material", name="")
    if material.find("color") is None and material.get("name") not in colored:
        ElementTree.SubElement(material, "color", rgba=_DEFAULT_COLOR)
        return False
    return True


def _compiled_appearance(model: mujoco.MjModel, geom: int, mesh: _Mesh) -> LazyAppearance:
    """Return a mesh's look for the faces that MuJoCo compiled, whose corners it orders anew where they are mirrored."""
    number = int(model.geom_dataid[geom])
    first = int(model.mesh_faceadr[number])
    compiled = model.mesh_face[first : first + len(mesh.faces)].copy()

    def make() -> Appearance | None:
        assert mesh.appearance is not None
        found = mesh.appearance.get()
        if found is None or found.uv is None:
            return found
        order = (compiled[:, :, None] == mesh.faces[:, None, :]).argmax(axis=2)
        uv = found.corner_uv(mesh.faces)
        assert uv is not None
        return replace(found, uv=np.take_along_axis(uv, order[:, :, None], axis=1))

    return LazyAppearance(make)


def _find_mesh(url: str, path: Path, search_path: Sequence[Path]) -> Path | None:
    """Find the file of a mesh: of a package in a folder of the search path or above the file, or beside the file."""
    folder = path.resolve().parent
    scheme = _SCHEME.fullmatch(url)
    kind, rest = (scheme[1], scheme[2]) if scheme else ("", url)
    if kind in ("package", "model"):
        rest = rest.lstrip("/")
    places = [folder / rest] if kind in ("", "file") else []
    for root in search_path:
        places.append(root / rest)
        package, _, tail = rest.partition("/")
        if kind in ("package", "model") and root.resolve().name == package:
            places.append(root / tail)
    if kind in ("package", "model"):
        places += [parent / rest for parent in folder.parents] + [folder / rest]
    return next((place.resolve() for place in places if url and is_file(place)), None)


def _read_mesh(path: Path, warned: list[str], *, strict: bool) -> _Mesh | None:
    """Read all triangles of a mesh file, in the file's own frame; None if it has none.

    Where the file has no colors, vertices at the same place become one, so that MuJoCo's normals are smooth.

    Raises:
        FileFormatError: The file does not parse, or `strict` is set and a part of it has no triangles.
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
