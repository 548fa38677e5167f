# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tessellation of Webots' geometry nodes, identical to Webots', since its range finders see triangles.

Front faces are counter-clockwise; Webots culls back faces. Shapes are upright along z; in files from before R2022a they
are rotated by -90 degrees about x, so that z becomes y. Numbers of segments, first angles and limits are those of
Webots' source, ``src/wren/StaticMesh.cpp`` and ``src/webots/nodes/``. Invalid fields are replaced by the same values as
in its node classes, which warn of them (``src/webots/nodes/Wb*.cpp`` and ``WbFieldChecker.cpp``).
"""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.file_content import reading, require_content
from warpvis.errors import FileFormatError
from warpvis.scene import keep_winding
from warpvis.scene.collada import frame_of, without_skins
from warpvis.webots._nodes import Node, Value, Version, correction
from warpvis.webots._urls import with_slashes
from warpvis.webots.shapes._polygons import (
    Triangles,
    compact,
    elevation_grid,
    extrusion,
    indexed_face_set,
    join,
    positive,
    positives,
    refuse,
    whole,
)

Resolve = Callable[[str, Node], Path | None]
"""Finds the file of a node's URL; returns None if it is not available."""

# Defaults of lengths that must be positive; if one element of a vector is not, the whole vector is reset.
_LENGTHS: dict[str, dict[str, tuple[float, ...]]] = {
    "Box": {"size": (1, 1, 1)},
    "Capsule": {"radius": (1,), "height": (1,)},
    "Cone": {"bottomRadius": (1,), "height": (1,)},
    "Cylinder": {"radius": (1,), "height": (1,)},
    "ElevationGrid": {"xSpacing": (1,), "ySpacing": (1,), "zSpacing": (1,)},
    "Plane": {"size": (1, 1)},
    "Sphere": {"radius": (1,)},
}
# Whole numbers: minimum, maximum, and replacement of others.
_COUNTS: dict[str, dict[str, tuple[int, float, int]]] = {
    "Capsule": {"subdivision": (4, 1000, 4)},
    "Cone": {"subdivision": (3, 1000, 3)},
    "Cylinder": {"subdivision": (3, 1000, 3)},
    "ElevationGrid": dict.fromkeys(("xDimension", "yDimension", "zDimension"), (0, np.inf, 0)),
}


class MissingMeshError(FileFormatError):
    """A mesh file is missing, or no reader of its format is installed; the rest of the world can be read without it."""


def tessellate(node: Node, *, resolve: Resolve | None = None) -> Triangles | None:
    """Tessellate a geometry node of a type in `GEOMETRIES` in its frame; return None if there are no triangles.

    Args:
        node: The node. Its version determines which axis is upright.
        resolve: Finds the files of Mesh and CadShape; by default `find_beside`.
    """
    if node.type in _FILES:
        return _mesh_file(node, resolve or find_beside)
    if node.type in _LISTED:
        return _LISTED[node.type](node)
    if node.type not in _UPRIGHT:
        refuse(node, f"one of {', '.join(sorted(GEOMETRIES))} as geometry", node.type)
    triangles = _UPRIGHT[node.type](node)
    if triangles is None or node.version.z_up:
        return triangles
    return turned(triangles[0]), triangles[1]


def turned(vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotate points by -90 degrees about x, from z up to y up."""
    x, y, z = vertices.T
    return np.stack([x, z, -y], axis=1)


def revolve(profile: Sequence[tuple[float, float]], shown: Sequence[bool], segments: int) -> Triangles | None:
    """Build a surface of revolution about z, whose normals point outward where the profile descends.

    The profile consists of pairs of radius and height, and `shown` whether there are triangles between two of them. A
    radius of zero is one vertex, and equal pairs share a ring. Vertex `k` of a ring is at ``(r sin a, r cos a)`` with
    ``a = 2 pi k / segments``.
    """
    angles = 2 * np.pi * np.arange(segments) / segments
    rings: dict[tuple[float, float], NDArray[np.int64]] = {}
    vertices = np.empty((0, 3))
    for radius, height in profile:
        if (radius, height) not in rings:
            around = angles if radius > 0 else angles[:1]
            ring = np.stack([radius * np.sin(around), radius * np.cos(around), np.full(len(around), height)], axis=1)
            rings[radius, height] = len(vertices) + np.arange(segments) % len(around)
            vertices = np.concatenate([vertices, ring])
    faces = [np.empty((0, 3), dtype=np.int64)]
    for upper, lower, seen in zip(profile[:-1], profile[1:], shown, strict=True):
        corner, below = rings[upper], rings[lower]
        right, across = np.roll(corner, -1), np.roll(below, -1)
        if seen and lower[0] > 0:
            faces.append(np.stack([corner, across, below], axis=1))
        if seen and upper[0] > 0:
            faces.append(np.stack([corner, right, across], axis=1))
    return compact(vertices, np.concatenate(faces))


def find_beside(url: str, node: Node) -> Path | None:
    """Resolve a URL relative to the file that contains it; return None for ``webots://`` and web URLs."""
    return None if "://" in url else Path(node.file).parent / with_slashes(url)


_BOX_FACES = [
    *([0, 6, 4], [0, 2, 6], [1, 7, 3], [1, 5, 7], [0, 5, 1], [0, 4, 5]),
    *([2, 7, 6], [2, 3, 7], [0, 3, 2], [0, 1, 3], [4, 7, 5], [4, 6, 7]),
]


def _box(node: Node) -> Triangles:
    inside = _is_inside_out(node)
    size = node.vector("size", (2, 2, 2)) if inside else positives(node, "size", (2, 2, 2))
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = np.array(_BOX_FACES, dtype=np.int32)
    return corners * np.abs(size), faces[:, ::-1].copy() if inside else faces


def _plane(node: Node) -> Triangles:
    x, y = positives(node, "size", (1, 1)) / 2
    corners = np.array([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)])
    return corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)


def _cylinder(node: Node) -> Triangles | None:
    radius, top = positive(node, "radius", 1), positive(node, "height", 2) / 2
    # The default is 12 in the manual, but 36 in all public versions of the node's definition.
    segments = whole(node, "subdivision", 36 if node.version >= Version(2019, 1) else 12, 3, 1000)
    shown = [node.flag(field, True) for field in ("top", "side", "bottom")]
    return revolve([(0, top), (radius, top), (radius, -top), (0, -top)], shown, segments)


def _cone(node: Node) -> Triangles | None:
    radius, top = positive(node, "bottomRadius", 1), positive(node, "height", 2) / 2
    shown = [node.flag(field, True) for field in ("side", "bottom")]
    return revolve([(0, top), (radius, -top), (0, -top)], shown, whole(node, "subdivision", 12, 3, 1000))


def _capsule(node: Node) -> Triangles | None:
    radius, top = positive(node, "radius", 1), positive(node, "height", 2) / 2
    segments = whole(node, "subdivision", 12, 4, 1000)
    rows = segments // 4
    angles = np.pi / 2 * np.arange(rows) / rows
    cap = [(radius * np.cos(a), top + radius * np.sin(a)) for a in angles] + [(0.0, top + radius)]
    shown = [node.flag(field, True) for field in ("top", "side", "bottom")]
    profile = cap[::-1] + [(r, -z) for r, z in cap]
    return revolve(profile, np.repeat(shown, (rows, 1, rows)).tolist(), segments)


def _sphere(node: Node) -> Triangles | None:
    radius = positive(node, "radius", 1)
    if not node.flag("ico", True):
        rows = whole(node, "subdivision", 24, 3, 32)  # 1, the icosphere's default, becomes 24
        angles = np.pi * np.arange(rows + 1) / rows
        profile = [(radius * np.sin(a), radius * np.cos(a)) for a in angles]
        profile[0], profile[-1] = (0.0, radius), (0.0, -radius)
        return revolve(profile, [True] * rows, rows)
    vertices, faces = _icosphere(whole(node, "subdivision", 1, 1, 5 if node.version.z_up else 6))
    return radius * vertices, faces.copy()


@lru_cache
def _icosphere(subdivision: int) -> Triangles:
    """Subdivide a unit icosahedron, splitting each face in four, with new vertices on the sphere."""
    short, long = np.sqrt((5 - np.sqrt(5)) / 10), np.sqrt((5 + np.sqrt(5)) / 10)
    # Three golden rectangles: vertices at (+-short, +-long) in the xy, yz and zx planes.
    signs = np.array([(a, b) for a in (-1, 1) for b in (-1, 1)])
    rectangle = np.c_[signs * (short, long), np.zeros(4)]
    vertices = np.concatenate([np.roll(rectangle, k, axis=1) for k in range(3)])
    # Faces are all triples of vertices with pairwise distances of the edge length, 2 short.
    near = np.abs(np.linalg.norm(vertices[:, None] - vertices, axis=2) - 2 * short) < 1e-9
    faces = np.array(
        [(a, b, c) for a in range(12) for b in range(a) for c in range(b) if near[a, b] & near[b, c] & near[c, a]]
    )
    inwards = np.linalg.det(vertices[faces]) < 0
    faces[inwards] = faces[inwards, ::-1]
    for _ in range(subdivision):
        edges = np.sort(faces[:, [(0, 1), (1, 2), (2, 0)]].reshape(-1, 2), axis=1)
        edges, middle = np.unique(edges, axis=0, return_inverse=True)
        middles = vertices[edges].sum(axis=1)
        (a, b, c), (ab, bc, ca) = faces.T, (len(vertices) + middle.reshape(-1, 3)).T
        vertices = np.concatenate([vertices, middles / np.linalg.norm(middles, axis=1, keepdims=True)])
        parts = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        faces = np.concatenate([np.stack(part, axis=1) for part in parts])
    return vertices, faces.astype(np.int32)


def _mesh_file(node: Node, resolve: Resolve) -> Triangles | None:
    """Read the triangles of the first URL. ``materialIndex`` is ignored, since it does not affect depth.

    The unit and up axis of COLLADA files are applied; up becomes y, and since R2022b z (Webots' pull requests 4172 and
    4448). Other formats are not converted, and since R2022b their ``name`` is ignored.
    """
    urls = node.texts("url")
    if not urls or not urls[0]:
        return None
    path = resolve(urls[0], node)
    if path is None or not path.is_file():
        raise MissingMeshError(f"{node.place}: the file {urls[0]!r} of {node.type} is missing")
    suffix = PurePosixPath(with_slashes(urls[0])).suffix.lower()  # from the URL, as cached files have no suffix
    try:
        parts = _read(path, suffix, path.stat().st_mtime_ns)
    except FileFormatError as error:
        raise type(error)(f"{node.place}: {error}") from None
    collada, converts_up_axis = suffix == ".dae", node.version >= Version(2022, 2)
    part_name = mesh_part_name(node, suffix)
    chosen = [part for name, part in parts if part_name in ("", name)]
    if not chosen:
        known = ", ".join(repr(name) for name, _ in parts[:10])
        refuse(node, f"the name of a part of {path}, one of {known}", repr(part_name))
    vertices, faces = join(chosen)
    if collada and converts_up_axis:
        x, y, z = vertices.T
        vertices = np.stack([x, -z, y], axis=1)
    return compact(vertices, faces if node.flag("ccw", True) else faces[:, ::-1])


def mesh_part_name(node: Node, suffix: str) -> str:
    """Return the name of the only part that a Mesh shows; empty for all parts."""
    uses_name = node.type == "Mesh" and (suffix == ".dae" or node.version < Version(2022, 2))
    return node.text("name", "") if uses_name else ""


@lru_cache(maxsize=64)
def _read(path: Path, suffix: str, changed: int) -> list[tuple[str, tuple[NDArray[np.float64], NDArray[np.int64]]]]:
    """Read name, vertices and faces of each part of a mesh file; the modification time `changed` is part of the key.

    COLLADA files are converted to meters with y up, as by the Open Asset Import Library, which Webots uses.
    """
    parts = []
    for name, mesh, placement in load_mesh_parts(path, suffix):
        vertices = np.asarray(mesh.vertices, dtype=np.float64) @ placement[:3, :3].T + placement[:3, 3]
        parts.append((name, (vertices, keep_winding(np.asarray(mesh.faces, dtype=np.int64), placement[:3, :3]))))
    if not parts:
        raise FileFormatError(f"{path}: holds no triangles")
    if not all(np.isfinite(vertices).all() for _, (vertices, _) in parts):
        raise FileFormatError(f"{path}: vertices must be finite")
    return parts


def load_mesh_parts(path: Path, suffix: str) -> list[tuple[str, Any, NDArray[np.float64]]]:
    """Load name, trimesh mesh and placement, ``(4, 4)``, of each part of a mesh file that has triangles, by name."""
    import trimesh

    kind = suffix.lstrip(".")
    if kind not in trimesh.available_formats():
        needs = ": reading it needs pycollada" if kind == "dae" else ""
        raise MissingMeshError(f"{path}: no reader of {suffix or 'files without a suffix'} is installed{needs}")
    require_content(path, "a mesh")
    options: dict[str, Any] = {"process": False}
    if kind == "obj":
        options |= {"skip_materials": True, "split_objects": True, "group_material": False}
    with reading(path, kind.upper()):
        upright = np.eye(4)
        if kind == "dae":
            file = path.read_bytes()
            upright[:3, :3] = frame_of(file)
            scene = trimesh.load_scene(io.BytesIO(without_skins(file)), file_type=kind, **options)
        else:
            named = path.suffix.lower() == suffix
            scene = trimesh.load_scene(path if named else io.BytesIO(path.read_bytes()), file_type=kind, **options)
        parts = []
        for name in sorted(scene.graph.nodes_geometry):  # for a deterministic order
            placement, key = scene.graph[name]
            if len(getattr(scene.geometry[key], "faces", ())):
                parts.append((str(name), scene.geometry[key], upright @ placement))
        return parts


_UPRIGHT: dict[str, Callable[[Node], Triangles | None]] = {
    "Capsule": _capsule,
    "Cone": _cone,
    "Cylinder": _cylinder,
    "Plane": _plane,
    "Sphere": _sphere,
}
_LISTED: dict[str, Callable[[Node], Triangles | None]] = {
    "Box": _box,
    "ElevationGrid": elevation_grid,
    "Extrusion": extrusion,
    "IndexedFaceSet": indexed_face_set,
}
_FILES = {"CadShape", "Mesh"}

GEOMETRIES: frozenset[str] = frozenset({*_UPRIGHT, *_LISTED, *_FILES})
"""Node types that `tessellate` accepts."""


def reset_fields(node: Node) -> tuple[Node, list[str]]:
    """Replace values that are invalid in Webots in a copy, as Webots does, with a note for every replaced field."""
    fixes: dict[str, Value] = {}
    notes = []
    for field, original, replacement in _wrong_numbers(node):
        fixes[field] = [*map(float, replacement)]
        notes.append(correction(node, field, original, replacement))
    if node.type == "IndexedFaceSet":
        valid, dropped = _polygons_in_range(node)
        if dropped:
            fixes["coordIndex"] = [*valid]
            notes.append(f"{node.place}: {dropped} faces of {node.type} have invalid indices and are skipped")
    return (dataclasses.replace(node, fields={**node.fields, **fixes}) if fixes else node), notes


def _wrong_numbers(node: Node) -> Iterator[tuple[str, ArrayLike, tuple[float, ...]]]:
    for field, lengths in _LENGTHS.get(node.type, {}).items():
        values = node.vector(field, lengths)
        if (values <= 0).any() and not (node.type == "Box" and _is_inside_out(node)):
            yield field, values, lengths
    for field, (lower, upper, default) in (_COUNTS.get(node.type) or _sphere_counts(node)).items():
        if field in node.fields and not lower <= node.integer(field, default) <= upper:
            yield field, node.integer(field, default), (default,)


def _is_inside_out(node: Node) -> bool:
    """Return whether a box shows its inside, by three negative sizes, according to manuals until 2018.

    Later sources accept positive sizes only.
    """
    return node.version < Version(2019, 1) and bool((node.vector("size", (2, 2, 2)) < 0).all())


def _sphere_counts(node: Node) -> dict[str, tuple[int, float, int]]:
    if node.type != "Sphere":
        return {}
    if not node.flag("ico", True):
        return {"subdivision": (3, 32, 24)}
    return {"subdivision": (1, 5 if node.version.z_up else 6, 1)}


def _polygons_in_range(node: Node) -> tuple[list[float], int]:
    """Remove polygons with an invalid index; return the indices of the others, and the number of removed polygons."""
    coordinate = node.node("coord")
    index = node.numbers("coordIndex")
    if coordinate is None or not len(index):
        return [], 0
    count = len(coordinate.numbers("point")) // 3
    ends = index == -1
    number = np.cumsum(ends) - ends  # index of each position's polygon, including its -1
    wrong = np.unique(number[(index < -1) | (index >= count)])
    return index[~np.isin(number, wrong)].tolist(), len(wrong)
