# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scans whose vertices or faces belong to segments, and segments to objects: ScanNet, ScanNet++ and Matterport3D.

Both kinds of JSON files are those of ScanNet (BenchmarkScripts/util_3d.py): `segIndices` of a mesh, and `segGroups`.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.categories import label_of_category
from warpvis.core.file_content import is_file, read_text
from warpvis.core.labels import Label
from warpvis.errors import FileFormatError
from warpvis.io._meshes import unique_names
from warpvis.io.datasets._fields import Fields
from warpvis.io.datasets._joined import Shape, split
from warpvis.io.datasets._ply_mesh import read_ply_mesh
from warpvis.scene import Axis, FileParts, Part
from warpvis.scene.lights import HEADLIGHT

UNLABELED = -1
"""Number of the triangles that belong to no instance, which are one object."""
_TABLE = "scannetv2-labels.combined.tsv"
_PARENTS = 4
"""Number of folders above a scan in which the table of labels is searched."""

# The 40 classes of NYUv2 (ScanNet's nyu40id, from 1), where the table of labels is missing.
_NYU40 = (
    "wall,floor,cabinet,bed,chair,sofa,table,door,window,bookshelf,picture,counter,blinds,desk,shelves,curtain,dresser,"
    "pillow,mirror,floor mat,clothes,ceiling,books,refrigerator,television,paper,towel,shower curtain,box,whiteboard,"
    "person,night stand,toilet,sink,lamp,bathtub,bag,otherstructure,otherfurniture,otherprop"
).split(",")


@dataclass(frozen=True)
class Instance:
    """An object of a scan."""

    number: int
    """Its number in the file, which is part of its name."""
    category: str
    """Its class in words."""
    group: str = ""
    """The class in a smaller vocabulary, which patterns match, too, and which determines the label of unknown words."""
    extras: dict[str, Any] = field(default_factory=dict)


def scan_parts(
    path: Path,
    shape: Shape,
    numbers: NDArray[np.integer],
    instances: Sequence[Instance],
    up: Axis,
    notes: Sequence[str],
) -> FileParts:
    """Return one part for each instance, and one for the triangles of none.

    Args:
        path: The file of the mesh.
        shape: The mesh.
        numbers: Index in `instances` of each face, `UNLABELED` for none, shape ``(m,)``.
        instances: The objects of the scan.
        up: The vertical axis of the mesh.
        notes: Warnings.
    """

    def make(number: int, part: Shape) -> Part:
        mesh = part.vertices, part.faces
        if number == UNLABELED:
            return Part("unlabeled", mesh, appearance=part.appearance)
        found = instances[number]
        label = label_of_category(found.category)
        if found.group and label == Label.OBJECT:
            label = label_of_category(found.group)
        return Part(
            f"{found.category.replace(' ', '_') or 'object'}_{found.number}",
            mesh,
            label,
            category=found.category,
            aliases=(found.group,) if found.group else (),
            appearance=part.appearance,
            extras=found.extras,
        )

    parts = split(shape, numbers, make)
    names = unique_names([part.name for part in parts])
    parts = [replace(part, name=name) for name, part in zip(names, parts, strict=True)]
    return FileParts(path, parts, up=up, warnings=tuple(notes), lights=(HEADLIGHT,))


def of_corners(numbers: NDArray[np.integer], faces: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return the number that most corners of each face have; that of the first corner if all three differ."""
    first, second, third = (numbers[faces[:, corner]] for corner in range(3))
    return np.where(second == third, second, first)


def read_segmented(path: Path, segments: Path, groups: Path, *, per_face: bool, folders: Sequence[Path]) -> FileParts:
    """Read a mesh whose vertices, or faces, have segments, and whose segments have objects."""
    mesh = read_ply_mesh(path)
    fields, found = Fields.read(segments), Fields.read(groups)
    indices = fields.numbers("segIndices")
    expected = mesh.face_count if per_face else len(mesh.shape.vertices)
    if len(indices) != expected:
        noun = "faces" if per_face else "vertices"
        raise FileFormatError(
            f"{segments}: 'segIndices' must have a segment for each of the {expected} {noun} of {path.name}, "
            f"got {len(indices)}"
        )
    table = _read_table(path, folders)
    owners, instances = {}, []
    for number, group in enumerate(found.children("segGroups", required=True)):
        label = group.text("label", "")
        row = table.get(label, {})
        numbers: dict[str, Any] = {key: group.values[key] for key in ("objectId", "id") if key in group.values}
        known = next((value for value in numbers.values() if type(value) is int), number)
        instances.append(Instance(known, label, row.get("nyu40class", ""), {**numbers, **row}))
        owners.update(dict.fromkeys(group.numbers("segments").tolist(), number))
    segment, place = np.unique(indices, return_inverse=True)
    owner = np.array([owners.get(number, UNLABELED) for number in segment.tolist()], dtype=np.int64)[place.reshape(-1)]
    by_face = owner[mesh.polygons] if per_face else of_corners(owner, mesh.shape.faces)
    return scan_parts(path, mesh.shape, by_face, instances, "z", ())


def read_labeled_vertices(path: Path, folders: Sequence[Path]) -> FileParts:
    """Read a mesh whose vertices have a class of NYUv2: ScanNet's ``*.labels.ply``."""
    mesh = read_ply_mesh(path)
    if "label" not in mesh.vertex:
        raise FileFormatError(f"{path}: vertices must have the property label, got {', '.join(mesh.vertex)}")
    names = dict(enumerate(_NYU40, start=1))
    for row in _read_table(path, folders).values():
        if row.get("nyu40id", "").isdigit() and row.get("nyu40class"):
            names[int(row["nyu40id"])] = row["nyu40class"]
    labels = mesh.vertex["label"].astype(np.int64)
    used = [number for number in np.unique(labels).tolist() if number > 0]
    instances = [Instance(number, names.get(number, ""), extras={"nyu40id": number}) for number in used]
    places = np.where(labels > 0, np.searchsorted(used, labels), UNLABELED)
    return scan_parts(path, mesh.shape, of_corners(places, mesh.shape.faces), instances, "z", ())


def _read_table(path: Path, folders: Sequence[Path]) -> dict[str, dict[str, str]]:
    """Return the NYUv2 class and its number by the label of annotators, from ScanNet's table; empty without a file."""
    places = [*folders, *[path.parent, *path.parent.parents][: _PARENTS + 1]]
    table = next((folder / _TABLE for folder in places if is_file(folder / _TABLE)), None)
    if table is None:
        return {}
    rows = csv.DictReader(read_text(table, "a table").splitlines(), delimiter="\t")
    if "raw_category" not in (rows.fieldnames or ()):
        raise FileFormatError(f"{table}: must have the column 'raw_category', got {', '.join(rows.fieldnames or ())}")
    keys = ("nyu40class", "nyu40id")
    return {row["raw_category"]: {key: row[key] for key in keys if row.get(key)} for row in rows}
