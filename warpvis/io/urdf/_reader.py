# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Read a URDF robot as the parts of a scene, with its joints."""

from __future__ import annotations

import fnmatch
import itertools
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Label
from warpvis.errors import FileFormatError
from warpvis.io.urdf._elements import Robot, UrdfMaterial, Visual, is_xacro, parse_robot, parse_visuals, parse_xml
from warpvis.io.urdf._mesh_files import GRAY, FileMesh, MeshFiles
from warpvis.io.urdf._places import Places
from warpvis.io.urdf._xacro import expand_xacro
from warpvis.scene import FileParts, Part, move_with_links, solids
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.lights import HEADLIGHT
from warpvis.scene.materials import Appearance, Material, Texture
from warpvis.scene.solids import Solid

_MAX_NOTES = 5
"""Maximum number of corrected values in a warning."""

_GROUND_NAMES = ("*floor*", "*ground*")

# Corners of a unit box and its triangles, facing outward.
_BOX_CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
_BOX_FACES = np.array(
    [
        *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
        *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
    ],
    dtype=np.int32,
)

_Mesh = tuple[NDArray[np.float64], NDArray[np.integer]]


class _Surface(NamedTuple):
    visual: Visual
    mesh: _Mesh | Solid
    appearance: LazyAppearance


def read_urdf(path: Path, *, search_path: Sequence[Path] = (), strict: bool = False) -> FileParts:
    """Read the visual elements of a robot with all joints at zero, or its collision elements if it has no visual ones.

    Every element is an object that is named after its link (``hand``, ``hand_1``, ...), with all parts of its mesh
    file. Patterns also match it by its link and by its own name. Objects are `Label.ROBOT`, or `Label.GROUND` if their
    names contain "floor" or "ground".

    Args:
        path: The file, URDF or xacro.
        search_path: Folders to search for packages and meshes, in addition to the folders above the file.
        strict: Whether elements that cannot be shown are an error.

    Raises:
        FileFormatError: If the file or a mesh cannot be read, or if something cannot be shown and `strict` is set.
    """
    robot, places = _parse(path, search_path)
    meshes = MeshFiles(places, strict)
    appearances = _Appearances(places)
    surfaces = _surfaces(parse_visuals(robot, "visual"), meshes, appearances)
    if not surfaces:
        surfaces = _surfaces(parse_visuals(robot, "collision"), meshes, appearances)
    skipped = [*robot.skipped, *meshes.skipped()]
    message = f"{path}: skipped {'; '.join(skipped)}" if skipped else ""
    if strict and message:
        raise FileFormatError(message)
    sentences = [message] if message else []
    notes = [*robot.corrected, *appearances.warnings]
    if notes:
        more = f"; and {len(notes) - _MAX_NOTES} more" if len(notes) > _MAX_NOTES else ""
        sentences.append(f"{path}: {'; '.join(notes[:_MAX_NOTES])}{more}")
    parts = move_with_links(_parts(robot, surfaces), robot.joints)
    return FileParts(
        path,
        parts,
        up="z",
        defines_frame=True,
        warnings=(*sentences, *meshes.warnings),
        lights=(HEADLIGHT,),
        joints=robot.joints,
    )


def _parse(path: Path, search_path: Sequence[Path]) -> tuple[Robot, Places]:
    places = Places(path, search_path)
    try:
        text = path.read_bytes()
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    root = parse_xml(path, text)
    has_expressions = path.suffix.lower() == ".xacro" and (b"${" in text or b"$(" in text)
    if has_expressions or is_xacro(root):
        root = parse_xml(path, expand_xacro(path, places))
    tag = str(root.tag).rpartition("}")[2]
    if tag != "robot":
        raise FileFormatError(f"{path}: must be URDF, which begins with <robot>, got XML of <{tag}>")
    return parse_robot(path, root), places


class _Appearances:
    """Appearances of elements: that of the URDF material, else that of the mesh file, else gray."""

    def __init__(self, places: Places) -> None:
        self._places = places
        self._found: dict[tuple[int, UrdfMaterial | None], LazyAppearance] = {}
        self._kept: list[LazyAppearance] = []  # whose ids are keys
        self._gray = LazyAppearance(None, Appearance((GRAY,)), fits_any_mesh=True)
        self.warnings: list[str] = []

    def of(self, mesh: FileMesh | None, material: UrdfMaterial | None) -> LazyAppearance:
        """Return the appearance of a mesh, or of a shape; the same for the same arguments."""
        own = None if mesh is None else mesh.appearance
        if own is None and material is None:
            return self._gray
        if own is not None and own.has_colors and material is None:
            return own
        key = id(own), material
        if key not in self._found:
            self._found[key] = self._make(own, material)
            self._kept += [] if own is None else [own]
        return self._found[key]

    def _make(self, own: LazyAppearance | None, material: UrdfMaterial | None) -> LazyAppearance:
        color = GRAY.base_color if material is None or material.color is None else material.color
        mode = "blend" if color[3] < 1 else "opaque"
        plain = Material(base_color=color, alpha_mode=mode)  # type: ignore[arg-type]
        textured = self._textured(plain, material)
        if own is None:
            return LazyAppearance(None, Appearance((plain,)), fits_any_mesh=True)

        def make() -> Appearance | None:
            found = own.get()
            if found is None:
                return Appearance((plain,))
            if textured is not None and found.uv is not None:
                return Appearance((textured,), uv=found.uv, normals=found.normals)
            if material is not None and material.color is None and own.has_colors:  # a texture without coordinates
                return found
            return Appearance((plain,), normals=found.normals)

        return LazyAppearance(make)

    def _textured(self, plain: Material, material: UrdfMaterial | None) -> Material | None:
        if material is None or material.texture is None:
            return None
        place = self._places.find(material.texture)
        if place is None:
            sentence = f"the texture {material.texture} was not found"
            self.warnings += [] if sentence in self.warnings else [sentence]
            return None
        color = (1.0, 1.0, 1.0, 1.0) if material.color is None else plain.base_color
        return replace(plain, base_color=color, texture=Texture(place))


def _surfaces(visuals: Iterable[Visual], meshes: MeshFiles, appearances: _Appearances) -> list[_Surface]:
    """Return the elements that have a surface and are not fully transparent; equal shapes share their arrays."""
    shapes: dict[tuple[str, tuple[float, ...]], _Mesh | Solid] = {}
    found = []
    for visual in visuals:
        if visual.material is not None and visual.material.color is not None and visual.material.color[3] == 0:
            continue
        loaded = None
        if visual.shape == "mesh":
            loaded = meshes.load(visual.url, visual.sizes)
            if loaded is None:
                continue
            shape: _Mesh | Solid = (loaded.vertices, loaded.faces)
        else:
            key = visual.shape, visual.sizes
            shape = shapes[key] if key in shapes else shapes.setdefault(key, _make_shape(*key))
        found.append(_Surface(visual, shape, appearances.of(loaded, visual.material)))
    return found


def _make_shape(kind: str, sizes: tuple[float, ...]) -> _Mesh | Solid:
    if kind == "box":
        return _BOX_CORNERS * np.abs(sizes), _BOX_FACES
    if kind == "sphere":
        return solids.sphere(sizes[0])
    make = solids.cylinder if kind == "cylinder" else solids.capsule
    return make(sizes[0], sizes[1] / 2)


def _parts(robot: Robot, surfaces: Sequence[_Surface]) -> list[Part]:
    """Return the parts; round shapes on moving links with other surfaces are triangles, since these can be attached."""
    links, pieces = robot.joints.link_poses(), robot.joints.pieces()
    counts = Counter(surface.visual.link for surface in surfaces)
    names = _names([surface.visual.link or "link" for surface in surfaces])
    triangles: dict[int, _Mesh] = {}
    parts = []
    for surface, name in zip(surfaces, names, strict=True):
        visual, shape = surface.visual, surface.mesh
        if isinstance(shape, Solid) and counts[visual.link] > 1 and pieces.get(visual.link) is not None:
            shape = triangles.setdefault(id(shape), (shape.vertices, shape.faces))
        pose = visual.origin if visual.link not in links else links[visual.link][0] @ visual.origin
        aliases = tuple(dict.fromkeys(word for word in (visual.link, visual.name) if word and word != name))
        label = Label.GROUND if _is_ground(name) or _is_ground(visual.name) else Label.ROBOT
        parts.append(Part(name, shape, label, pose, link=visual.link, aliases=aliases, appearance=surface.appearance))
    return parts


def _names(links: Sequence[str]) -> list[str]:
    """Return unique names: the link's for its first element, then with ``_1``, ``_2``, ..."""
    taken, counts, names = set(links), Counter[str](), []
    for link in links:
        name = link
        while counts[link] and name in taken:
            name = f"{link}_{counts[link]}"
            counts[link] += 1
        counts[link] = max(counts[link], 1)
        taken.add(name)
        names.append(name)
    return names


def _is_ground(name: str) -> bool:
    return any(fnmatch.fnmatchcase(name.lower(), pattern) for pattern in _GROUND_NAMES)
