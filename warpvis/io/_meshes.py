# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mesh files and archives of them: glTF by our own reader, OBJ, STL, PLY, COLLADA and others by trimesh."""

from __future__ import annotations

import html
import io
import itertools
import logging
import posixpath
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import describe_exception, is_whole, truncate
from warpvis.core.file_content import require_content
from warpvis.core.labels import Label, LabelRules
from warpvis.core.plugins import MESH_READERS, load_plugin, plugin_names
from warpvis.core.types import MeshLike
from warpvis.errors import FileFormatError, SceneError
from warpvis.io._files import is_archive, unpack
from warpvis.io._gltf import FileMeshes, read_gltf
from warpvis.io._gltf_data import Find, uri_name
from warpvis.io._gltf_materials import Locate
from warpvis.io._gltf_placements import Shape, split
from warpvis.io._obj import ObjMaterials, has_normals, obj_order, obj_splits, require_obj_elements, straighten_obj
from warpvis.io._ply import (
    has_corner_coordinates,
    ply_appearance,
    ply_texture,
    straighten_ply,
    without_coordinates,
    without_normals,
)
from warpvis.io._readers import SCENE_READERS
from warpvis.scene import Axis, FileParts, Part, keep_winding
from warpvis.scene.appearances import FileNormals, LazyAppearance, choose_appearance
from warpvis.scene.collada import unit_and_axis, without_skins
from warpvis.scene.materials import Texture
from warpvis.scene.normals import have_direction, transform_normals

_GLTF = ("glb", "gltf")
_NAMELESS = ("geometry_0", "geometry")
"""trimesh's names for the mesh of a file without names."""
_MAX_NAMED = 5
_NEEDED = {"dae": "pycollada: pip install 'warpvis[collada]'", "3mf": "lxml and networkx: pip install lxml networkx"}
"""Packages that trimesh's readers of these formats need."""

# The 3MF core specification, section 3.4: a model without a unit is in millimeters.
_METERS = {b"micron": 1e-6, b"millimeter": 1e-3, b"centimeter": 1e-2, b"inch": 0.0254, b"foot": 0.3048, b"meter": 1.0}
_NAME = re.compile(rb"""\b(?:partnumber|name)\s*=\s*(?:"([^"]*)"|'([^']*)')""")


def read_mesh_file(
    path: Path, *, search_path: Sequence[Path], strict: bool, image_folders: Sequence[Path] = ()
) -> FileParts:
    """Read the parts of a mesh file, or of all mesh files of an archive; see `warpvis.Scene.load`.

    Images may be in the file's folder, in `image_folders`, and below them.
    """
    kind = _kind(path.name)
    if search_path and kind != "gltf":
        raise SceneError(f"{path}: its geometry is in a single file; leave out search_path")
    if is_archive(path.name):
        loaded = _load_archive(path)
    elif (read := _reader_of_others(path, kind)) is not None:
        return _read_by_plugin(read, path)
    else:
        locate = _locator(path, [*search_path, *image_folders])
        loaded = _load(str(path), kind, path.read_bytes(), _finder(path, search_path), locate)
    is_single = len(loaded.parts) == 1
    names = [part.name or (path.stem if is_single else f"mesh_{number}") for number, part in enumerate(loaded.parts)]
    parts = [
        replace(part, name=name, category=part.category or _category(part))
        for name, part in zip(unique_names(names), loaded.parts, strict=True)
    ]
    messages = [f"{path}: left out {note}" for note in loaded.notes]
    if loaded.empty:
        more = ", ..." if len(loaded.empty) > _MAX_NAMED else ""
        listed = ", ".join(repr(truncate(name)) for name in loaded.empty[:_MAX_NAMED]) + more
        messages.append(f"{path}: left out {listed}, which hold lines or points and no triangles")
    if strict and messages:
        raise FileFormatError(messages[0])
    if loaded.unlit:
        messages.append(f"{path}: left out the lights of {', '.join(loaded.unlit[:_MAX_NAMED])}")
    up: Axis | None = "y" if loaded.up == "y" else "z" if loaded.up else None
    classes, lights = _classes(path, parts), tuple(loaded.lights)
    return FileParts(path, parts, up=up, warnings=tuple(messages), classes=classes, lights=lights, sky=loaded.sky)


def _category(part: Part) -> str:
    """Return the category that `Scene.export` writes; empty if there is none."""
    word = part.extras.get("category", "")
    return word if isinstance(word, str) else ""


def _classes(path: Path, parts: Sequence[Part]) -> LabelRules:
    """Return the classes that `Scene.export` writes in addition to labels: their names, and which are ground."""
    names: dict[int, str] = {}
    for part in parts:
        number, name = part.extras.get("label"), part.extras.get("label_name")
        if is_whole(number) and isinstance(name, str) and names.setdefault(number, name) != name:
            raise FileFormatError(f"{path}: names the label {number} both {names[number]!r} and {name!r}")
    ground = {int(Label.GROUND): True}
    for part in parts:
        number, flag = _number(part.extras.get("label")), part.extras.get("ground")
        if number is not None and isinstance(flag, bool):
            ground[number] = flag
    chosen = tuple(number for number, flag in ground.items() if flag)
    return LabelRules(label_names=names, ground_labels=None if chosen == (Label.GROUND,) else chosen)


def _number(label: object) -> int | None:
    """Return the number of a label as written by `Scene.export`; None for other values."""
    if isinstance(label, str):
        return Label.__members__.get(label)
    return int(label) if is_whole(label) else None


def _kind(name: str) -> str:
    return Path(name).suffix.lower().lstrip(".")


def _reader_of_others(path: Path, kind: str) -> Callable[[Path], Mapping[str, MeshLike]] | None:
    """Return the function of another distribution that reads a format; None for formats that are read here."""
    import trimesh
    from trimesh.exchange.load import mesh_loaders

    known = {*_GLTF, *trimesh.available_formats()}
    read = None if kind in known else load_plugin(MESH_READERS, kind)
    if kind in known or read is not None:
        return read
    if kind in mesh_loaders:
        needed = _NEEDED.get(kind, "packages that are not installed, as trimesh's documentation says")
        raise FileFormatError(f"{path}: reading .{kind} needs {needed}")
    supported = ", ".join(sorted({*known, *plugin_names(MESH_READERS), "tar"}))
    scenes = ", ".join(extension.lstrip(".") for extension in SCENE_READERS)
    found = repr(path.suffix) if path.suffix else "a name without a suffix"
    raise FileFormatError(f"{path}: {found} is not a scene format; supported are {scenes}, and {supported}")


def _read_by_plugin(read: Callable[[Path], Mapping[str, MeshLike]], path: Path) -> FileParts:
    """Return the parts of a file, from a function that returns meshes by name."""
    try:
        return FileParts(path, [Part(name, _arrays(mesh)) for name, mesh in read(path).items()])
    except Exception as error:  # third-party readers may raise any exception
        raise FileFormatError(f"{path}: cannot be read: {describe_exception(error)}") from error


def _arrays(mesh: Any) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
    vertices, faces = (mesh.vertices, mesh.faces) if hasattr(mesh, "vertices") else mesh
    return np.asarray(vertices, dtype=np.float64), np.asarray(faces)


def _load_archive(path: Path) -> FileMeshes:
    """Read all mesh files of an archive."""
    import trimesh

    files = unpack(path)
    readable = {*_GLTF, *trimesh.exchange.load.mesh_formats()} - {"xyz"}
    members = [name for name in files if _kind(name) in readable and not _is_litter(name)]
    if not members:
        known = ", ".join(sorted(readable))
        raise FileFormatError(f"{path}: contains no mesh file; supported are {known}")
    combined, axes = FileMeshes(), {}
    # Deferred appearances keep these alive until first use.
    companions = {name: file for name, file in files.items() if name not in members}
    for member in members:
        loaded = _load(
            f"{path}/{member}",
            _kind(member),
            files[member],
            partial(_find_member, companions, member),
            partial(_locate_member, companions, member),
        )
        stem = posixpath.splitext(posixpath.basename(member))[0]
        combined.parts += [replace(part, name=part.name or stem) for part in loaded.parts]
        combined.empty += loaded.empty
        combined.notes += loaded.notes
        combined.lights += loaded.lights
        combined.unlit += loaded.unlit
        combined.sky = combined.sky or loaded.sky
        axes[loaded.up] = member
    if len(axes) > 1:
        both = " and ".join(map(repr, list(axes.values())[:2]))
        raise FileFormatError(f"{path}: {both} have different vertical axes; unpack it and load them separately")
    combined.up = next(iter(axes))
    return combined


def _is_litter(member: str) -> bool:
    """Return whether a file is metadata that macOS adds to archives."""
    return member.startswith("__MACOSX/") or posixpath.basename(member).startswith("._")


def _find_member(files: dict[str, bytes], member: str, name: str) -> bytes:
    place = posixpath.normpath(posixpath.join(posixpath.dirname(member), name))
    if place not in files:
        raise FileNotFoundError(f"{name} is not in the archive")
    return files[place]


def file_finders(path: Path) -> tuple[Find, Locate]:
    """Return the functions that read the buffers and find the images that a file references."""
    return _finder(path, []), _locator(path, [])


def _finder(path: Path, search_path: Sequence[Path]) -> Find:
    """Return a function that reads the files that a glTF file references, relative to it or in the folders."""
    from trimesh.resolvers import FilePathResolver

    places = [FilePathResolver(str(path)), *map(FilePathResolver, map(str, search_path))]

    def find(name: str) -> bytes:
        for place in places:
            try:
                found = place.get(name)
            except (FileNotFoundError, ValueError):  # ValueError for paths outside of the folder
                continue
            require_content(found, "a buffer of glTF", name=f"{path}: {name}", images=False)
            return found
        searched = "neither next to it nor on the search path" if search_path else "not next to it"
        raise FileNotFoundError(f"{name} is {searched}")

    return find


def _locator(path: Path, search_path: Sequence[Path]) -> Locate:
    """Return a function that finds the images that a file references, relative to it or in the folders."""
    folders = [folder.absolute() for folder in (path.parent, *search_path)]  # the working directory may change
    roots = [folder.resolve() for folder in folders]

    def locate(name: str) -> Path | None:
        for folder in folders:
            place = folder / name.replace("\\", "/")
            try:
                if place.is_file() and any(map(place.resolve().is_relative_to, roots)):
                    return place
            except (OSError, ValueError):  # not a valid file name
                continue
        return None

    return locate


def _locate_member(files: dict[str, bytes], member: str, name: str) -> bytes | None:
    return files.get(posixpath.normpath(posixpath.join(posixpath.dirname(member), name.replace("\\", "/"))))


def _load(name: str, kind: str, file: bytes, find: Find, locate: Locate) -> FileMeshes:
    """Read one file."""
    require_content(file, "a mesh", name=name)
    if not file:
        raise FileFormatError(f"{name}: is empty")
    try:
        if kind in _GLTF:
            return read_gltf(name, file, find, locate)
        if kind == "dae":
            return _load_collada(name, file, locate)
        if kind == "3mf":
            return _load_3mf(Path(name), file)
        if kind == "ply":
            return _load_ply(name, file, locate)
        return _load_obj(name, file, locate) if kind == "obj" else _load_by_trimesh(name, file, kind)
    except FileFormatError:
        raise
    except Exception as error:  # third-party readers may raise any exception
        raise FileFormatError(f"{name}: cannot be read as {kind.upper()}: {describe_exception(error)}") from None


class _Textures:
    """Finds the images that a COLLADA file references, for trimesh."""

    def __init__(self, locate: Locate) -> None:
        self._locate = locate

    def get(self, name: str) -> bytes:
        """Return the bytes of an image file."""
        found = self._locate(uri_name(name.removeprefix("file://")).removeprefix("./"))
        if found is None:
            raise FileNotFoundError(name)
        return found.read_bytes() if isinstance(found, Path) else found


def _load_collada(name: str, file: bytes, locate: Locate) -> FileMeshes:
    """Read COLLADA in meters, with the vertical axis defined in the file; files with x up are rotated to y up."""
    meters, axis = unit_and_axis(file)
    rotation = np.eye(3) if axis != "X_UP" else np.array([(0.0, -1, 0), (1, 0, 0), (0, 0, 1)])
    found = _load_by_trimesh(name, without_skins(file), "dae", meters * rotation, resolver=_Textures(locate))
    found.up = "z" if axis == "Z_UP" else "y"
    return found


def _load_3mf(path: Path, file: bytes) -> FileMeshes:
    """Read 3MF in meters, in the file's order; z is up, as specified by the format."""
    meters, names = unit_and_names(unpack(path, file))
    found = _load_by_trimesh(str(path), file, "3mf", meters * np.eye(3))
    order = {name: number for number, name in enumerate(names)}
    found.parts.sort(key=lambda part: order.get(part.name, len(order)))
    found.up = "z"
    return found


def _load_obj(name: str, file: bytes, locate: Locate) -> FileMeshes:
    text, notes = straighten_obj(file)
    materials = ObjMaterials(name, text, locate)
    options: dict[str, Any] = {"group_material": False, "skip_materials": True, **obj_splits(text)}
    options["expects_normals"] = has_normals(text)
    try:
        found = _load_by_trimesh(name, text, "obj", appearance_of=materials.appearance, **options)
    except Exception:  # trimesh's exceptions do not name the line
        require_obj_elements(file)
        raise
    found.notes += notes
    order = obj_order(text)
    found.parts.sort(key=lambda part: order.get(part.name, -1))
    return found


def _load_ply(name: str, file: bytes, locate: Locate) -> FileMeshes:
    """Read PLY; an image replaces the colors of vertices."""
    image = ply_texture(file)
    source, file = locate(image) if image else None, straighten_ply(file)
    if source is None:
        found = _load_by_trimesh(name, without_coordinates(file), "ply")
        found.notes += [f"the texture {truncate(image)}, which was not found"] if image else []
        return found
    # Coordinates of corners split vertices, which normals of vertices do not fit.
    splits = has_corner_coordinates(file)
    file = without_normals(file) if splits else file
    textured = partial(ply_appearance, Texture(source, name=f"{name}: {image}"))
    return _load_by_trimesh(name, file, "ply", appearance_of=textured, skip_materials=True, fix_texture=splits)


def _load_by_trimesh(
    file_name: str,
    file: bytes,
    kind: str,
    linear: NDArray[np.float64] | None = None,
    appearance_of: Callable[[str, LazyAppearance | None, int], LazyAppearance | None] = lambda name, found, faces: (
        found
    ),
    expects_normals: bool = False,
    **options: Any,
) -> FileMeshes:
    """Read a file; transform its vertices, and convert its appearances by name, appearance and number of triangles.

    Nodes that use the same mesh share it.
    """
    import trimesh

    # trimesh logs tracebacks of exceptions that it raises or handles; a user's own handlers still receive them.
    log = logging.getLogger("trimesh")
    if not log.handlers:
        log.addHandler(logging.NullHandler())
    # Preserve face order and shared corners of the file.
    loaded = trimesh.load_scene(io.BytesIO(file), file_type=kind, process=False, **options)
    found, file_normals = FileMeshes(), FileNormals(file_name)
    uses = Counter(loaded.graph[node][1] for node in loaded.graph.nodes_geometry)
    shapes = dict[str, Shape]()
    for node in loaded.graph.nodes_geometry:
        placement, geometry = loaded.graph[node]
        mesh, name = loaded.geometry[geometry], "" if node in _NAMELESS else str(node)
        if not len(getattr(mesh, "faces", ())):
            found.empty.append(name or str(node))
            continue
        is_shared = uses[geometry] > 1
        if geometry not in shapes:
            place: Any = np.eye(4) if is_shared else placement
            axes = None if is_shared else linear
            vertices, subject = np.asarray(mesh.vertices, dtype=np.float64), name or kind.upper()
            with np.errstate(invalid="ignore", over="ignore"):  # the scene checks that vertices are finite
                corners = vertices @ place[:3, :3].T + place[:3, 3]
                corners = corners if axes is None else corners @ axes.T
            appearance = choose_appearance(None, mesh, subject, (len(vertices), len(mesh.faces)), color_space="srgb")
            appearance = appearance_of(name, appearance, len(mesh.faces))
            triangles = corners, keep_winding(mesh.faces, place[:3, :3])
            normals = mesh._cache.cache.get("vertex_normals")  # the property would compute missing ones
            if normals is not None:
                total = place[:3, :3] if axes is None else axes @ place[:3, :3]
                read = partial(transform_normals, normals.astype(np.float32), total)
                mesh = None if have_direction(normals).all() else partial(tuple, triangles)  # freed unless needed
                appearance = file_normals.add(appearance, repr(subject), read, mesh)
            elif expects_normals:
                appearance = file_normals.add(appearance, repr(subject), _refuse_normals, None)
            shapes[geometry] = Shape(*triangles, appearance)
        if is_shared:
            matrix = placement[None].astype(np.float64)
            matrix[:, :3] = matrix[:, :3] if linear is None else linear @ matrix[:, :3]
            found.parts += shapes[geometry].shared([name], matrix, split(matrix), {}, movable=False)
        else:
            found.parts.append(Part(name, triangles, appearance=appearance))
    return found


def _refuse_normals() -> NDArray[np.float32]:
    """Raise an error for an OBJ object whose normals trimesh did not read."""
    raise ValueError("some corners have none, or the index of none")


def unique_names(names: Sequence[str]) -> list[str]:
    """Append ``_1``, ``_2``, ... to repeated names, so that all names are unique."""
    taken, assigned = set(names), set[str]()
    numbers: dict[str, itertools.count[int]] = {}
    unique = []
    for name in names:
        free = name
        if name in assigned:
            count = numbers.setdefault(name, itertools.count(1))
            free = next(candidate for candidate in (f"{name}_{number}" for number in count) if candidate not in taken)
        taken.add(free)
        assigned.add(free)
        unique.append(free)
    return unique


def unit_and_names(files: dict[str, bytes]) -> tuple[float, list[str]]:
    """Read the unit of a 3MF file [m], and the names of its parts, in order, from the files in its archive."""
    models = [files[name] for name in sorted(files) if name.lower().endswith(".model")]
    found: dict[str, None] = {}
    unit = b"millimeter"
    for model in models:
        root = re.search(rb"<(?:\w+:)?model\b[^>]*", model)
        match = re.search(rb"""\sunit\s*=\s*["']([^"']*)["']""", root[0]) if root else None
        unit = match[1] if match else unit
        found |= {html.unescape((a or b).decode(errors="replace")): None for a, b in _NAME.findall(model)}
    if unit not in _METERS:
        known = ", ".join(name.decode() for name in _METERS)
        raise ValueError(f"the unit must be one of {known}, got {unit.decode(errors='replace')!r}")
    return _METERS[unit], list(found)
