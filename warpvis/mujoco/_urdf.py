# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""URDF robots as MuJoCo compiles them: what they look like, with meshes found where ROS packages have them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco  # noqa: TID253 - the whole package is about it

from warpvis.core.checks import said_by
from warpvis.errors import FileFormatError

VISUAL_GROUP = 1
"""The group of geoms that MuJoCo makes of visual elements; those of collision elements are in group 0."""

_READ_BY_MUJOCO = (".obj", ".msh")
_STL_HEADER, _STL_TRIANGLE = 84, 50  # bytes of a binary STL file
_SCHEME = re.compile(r"(package|model|file)://(.*)")

# What a link weighs that has no inertia and no volume: nothing moves here, but MuJoCo refuses to compile it.
_LEAST_MASS, _LEAST_INERTIA = 1e-6, 1e-9


def compile_urdf(
    path: Path, robot: ElementTree.Element, search_path: Sequence[Path]
) -> tuple[mujoco.MjModel, tuple[int, ...], list[str]]:
    """Compile a robot.

    Args:
        path: Its file.
        robot: The file's root, which is changed.
        search_path: Folders to look for packages and meshes in.

    Returns:
        The model; the groups of geoms that show what it looks like; and the meshes of which no file was found.

    Raises:
        ValueError: MuJoCo does not compile it.
        FileFormatError: A mesh does not parse.
    """
    missing: list[str] = []
    assets: dict[str, bytes] = {}
    kinds = []
    named = {""}
    for link in robot.iter("link"):
        for element in [item for item in link if item.tag in ("visual", "collision")]:
            name = element.attrib.pop("name", "")
            if name not in named:  # of one that is taken MuJoCo tells standard error; the link's name is as good
                element.set("name", name)
            named.add(name)
            mesh = element.find("geometry/mesh")
            if mesh is not None and not _point_to_file(mesh, path, search_path, assets):
                missing.append(mesh.get("filename", ""))
                link.remove(element)
                continue
            kinds.append(element.tag)
    # Links keep their names, whether or not they move; what is drawn stays; paths are as they are written.
    options = robot.find("mujoco/compiler")
    if options is None:
        options = ElementTree.SubElement(ElementTree.SubElement(robot, "mujoco"), "compiler")
    options.attrib.update(strippath="false", discardvisual="false", fusestatic="false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, encoding="unicode"), assets=assets or None)
    spec.compiler.balanceinertia = True
    spec.compiler.boundmass, spec.compiler.boundinertia = _LEAST_MASS, _LEAST_INERTIA
    for asset in spec.meshes:
        asset.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # what is open has no volume
    groups = (VISUAL_GROUP,) if "visual" in kinds else (0,)
    return spec.compile(), groups, missing


def _point_to_file(
    mesh: ElementTree.Element, path: Path, search_path: Sequence[Path], assets: dict[str, bytes]
) -> bool:
    """Write into a mesh element which file MuJoCo shall read; False if there is none."""
    found = _find_mesh(mesh.get("filename", ""), path, search_path)
    if found is None:
        return False
    name = str(found)
    if not _is_read_by_mujoco(found):
        name = f"{name}.obj"
        if name not in assets:
            assets[name] = _as_obj(found)
    mesh.set("filename", name)
    return True


def _find_mesh(url: str, path: Path, search_path: Sequence[Path]) -> Path | None:
    """Find the file of a mesh: of a package in a folder of the search path or above the file, or beside the file."""
    folder = path.resolve().parent
    scheme = _SCHEME.fullmatch(url)
    kind, rest = (scheme[1], scheme[2]) if scheme else ("", url)
    places = [folder / rest] if kind in ("", "file") else []
    for root in search_path:
        places.append(root / rest)
        package, _, tail = rest.partition("/")
        if kind in ("package", "model") and root.resolve().name == package:
            places.append(root / tail)
    if kind in ("package", "model"):
        places += [parent / rest for parent in folder.parents] + [folder / rest]
    return next((place.resolve() for place in places if url and place.is_file()), None)


def _is_read_by_mujoco(path: Path) -> bool:
    """Tell whether MuJoCo reads a mesh file itself: OBJ, MSH, and binary STL."""
    suffix = path.suffix.lower()
    if suffix != ".stl":
        return suffix in _READ_BY_MUJOCO
    with path.open("rb") as stream:
        header = stream.read(_STL_HEADER)
    count = int.from_bytes(header[80:], "little")
    return path.stat().st_size == _STL_HEADER + count * _STL_TRIANGLE


def _as_obj(path: Path) -> bytes:
    """Convert a mesh file of a kind that MuJoCo does not read to OBJ, by trimesh."""
    import trimesh

    try:
        loaded: Any = trimesh.load_scene(path, process=False)
        whole = loaded.to_mesh()
        return trimesh.exchange.obj.export_obj(whole, include_normals=False, include_texture=False).encode()
    except Exception as error:  # trimesh's readers raise what they like
        raise FileFormatError(f"{path}: does not read as {path.suffix.lstrip('.').upper()}: {said_by(error)}") from None
