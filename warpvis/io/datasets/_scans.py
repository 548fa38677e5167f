# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scans with objects: recognized by their names and the files next to them, and split into their objects."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.core.file_content import read_text
from warpvis.errors import FileFormatError
from warpvis.io._meshes import read_mesh_file
from warpvis.io.datasets._fields import Fields
from warpvis.io.datasets._joined import Shape, join, placed
from warpvis.io.datasets._ply_mesh import read_ply_mesh
from warpvis.io.datasets._segments import UNLABELED, Instance, read_labeled_vertices, read_segmented, scan_parts
from warpvis.scene import FileParts
from warpvis.scene.materials import Texture, screen_color

_HM3D_HEADER = "HM3D Semantic Annotations"
_HM3D_LINE = re.compile(r'\s*(\d+)\s*,\s*([0-9A-Fa-f]{6})\s*,\s*"(.*)"\s*,\s*(-?\d+)\s*')
_HM3D_ROW = 'ID,RRGGBB,"category",region'


def find_scan(path: Path, search_path: Sequence[Path]) -> Callable[[], FileParts] | None:
    """Return the reader of a scan with objects; None for other meshes, and for scans without files of objects.

    Args:
        path: The mesh, a PLY or GLB file.
        search_path: Folders in which ScanNet's table of labels is searched.
    """
    folder, name = path.parent, path.name
    stem = name[: -len(path.suffix)]
    if name.endswith(".semantic.glb"):
        table = folder / f"{stem}.txt"
        return partial(_read_hm3d, path, table) if table.is_file() else None
    if path.suffix != ".ply":
        return None
    if name.endswith(("_vh_clean_2.labels.ply", "_vh_clean.labels.ply")):
        return partial(read_labeled_vertices, path, search_path)
    house = folder / f"{stem.removesuffix('_semantic')}.house"
    if (found := _segment_files(folder, stem)) is not None:
        segments, groups, per_face = found
        return partial(read_segmented, path, segments, groups, per_face=per_face, folders=search_path)
    if name == "mesh_semantic.ply" and (folder / "info_semantic.json").is_file():
        return partial(_read_replica, path, folder / "info_semantic.json")
    return partial(_read_matterport, path, house) if house.is_file() else None


def _segment_files(folder: Path, stem: str) -> tuple[Path, Path, bool] | None:
    """Return the files of segments and objects of a mesh, and whether faces have segments; None if one is missing."""
    scan = stem.removesuffix("_vh_clean_2").removesuffix("_vh_clean")
    segments = [*sorted(folder.glob(f"{_literal(stem)}*.segs.json")), folder / "segments.json"]
    groups = [folder / f"{scan}.aggregation.json"]
    groups[:0] = [folder / f"{stem}.aggregation.json"] if stem.endswith("_vh_clean") else []
    candidates = []
    if stem.endswith(("_vh_clean_2", "_vh_clean")):
        candidates = [(first, second, False) for first in segments[:-1] for second in groups]
    elif stem.startswith("mesh_aligned"):
        candidates = [(segments[-1], folder / "segments_anno.json", False)]
    candidates.append((folder / f"{stem}.fsegs.json", folder / f"{stem}.semseg.json", True))
    return next((item for item in candidates if item[0].is_file() and item[1].is_file()), None)


def _literal(name: str) -> str:
    return re.sub(r"([*?\[])", r"[\1]", name)


def _read_replica(path: Path, table: Path) -> FileParts:
    """Read Replica's mesh, whose faces have the number of an object."""
    mesh, fields = read_ply_mesh(path), Fields.read(table)
    if "object_id" not in mesh.face:
        raise FileFormatError(f"{path}: faces must have the property object_id, got {', '.join(mesh.face) or 'none'}")
    classes = {item.whole("id"): item.text("name") for item in fields.children("classes")}
    instances = []
    for item in fields.children("objects", required=True):
        number, kind = item.whole("id"), item.whole("class_id", -1)
        instances.append(Instance(number, classes.get(kind, item.text("class_name", "")), extras={"object_id": number}))
    return _numbered(path, mesh.shape, mesh.face["object_id"], instances)


def _numbered(path: Path, shape: Shape, numbers: NDArray[np.integer], instances: Sequence[Instance]) -> FileParts:
    """Return the parts of a mesh whose faces have the numbers of instances; others are unlabeled."""
    places = {instance.number: place for place, instance in enumerate(instances)}
    known, inverse = np.unique(numbers, return_inverse=True)
    place = np.array([places.get(int(number), UNLABELED) for number in known], dtype=np.int64)
    return scan_parts(path, shape, place[inverse.reshape(-1)], instances, "z", ())


def _read_matterport(path: Path, house: Path) -> FileParts:
    """Read Matterport3D's mesh, whose faces have a segment or an object that the ``.house`` file lists."""
    mesh = read_ply_mesh(path)
    categories: dict[int, tuple[str, str]] = {}
    rows: list[tuple[int, int, int]] = []
    segments: dict[int, int] = {}
    for number, line in enumerate(read_text(house, "a house of Matterport3D").splitlines(), start=1):
        words = line.split()
        if number == 1 and words[:1] != ["ASCII"]:
            raise FileFormatError(f"{house}:1: must begin with 'ASCII 1.1', got {line[:40]!r}")
        try:
            if words[:1] == ["C"]:
                categories[int(words[1])] = words[3].replace("#", " "), words[5].replace("#", " ")
            elif words[:1] == ["O"]:
                rows.append((int(words[1]), int(words[2]), int(words[3])))
            elif words[:1] == ["E"]:
                segments[int(words[3])] = int(words[2])
        except (IndexError, ValueError):
            raise FileFormatError(
                f"{house}:{number}: must be a line of a category, object or segment, got {line[:40]!r}"
            ) from None
    if "object_id" in mesh.face:
        numbers = mesh.face["object_id"].astype(np.int64)
    else:
        key = next((key for key in ("material_id", "face_material") if key in mesh.face), None)
        if key is None:
            raise FileFormatError(
                f"{path}: faces must have the property object_id or material_id, got {', '.join(mesh.face) or 'none'}"
            )
        known, inverse = np.unique(mesh.face[key].astype(np.int64), return_inverse=True)
        owners = np.array([segments.get(int(number), -1) for number in known], dtype=np.int64)
        numbers = owners[inverse.reshape(-1)]
    instances = [
        Instance(number, *categories.get(category, ("", "")), extras={"object_id": number, "region_id": region})
        for number, region, category in rows
    ]
    return _numbered(path, mesh.shape, numbers, instances)


def _read_hm3d(path: Path, table: Path) -> FileParts:
    """Read HM3D's mesh, whose texture or vertices have a color for each object."""
    lines = read_text(table, f"lines {_HM3D_ROW}").splitlines()
    if not lines or _HM3D_HEADER not in lines[0]:
        raise FileFormatError(f"{table}:1: must begin with {_HM3D_HEADER!r}, got {lines[0][:40] if lines else ''!r}")
    instances, colors = [], []
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        match = _HM3D_LINE.fullmatch(line)
        if match is None:
            raise FileFormatError(f"{table}:{number}: must be {_HM3D_ROW}, got {line[:60]!r}")
        extras = {"instance_id": int(match[1]), "region_id": int(match[4])}
        instances.append(Instance(int(match[1]), match[3], extras=extras))
        colors.append(int(match[2], 16))
    found = read_mesh_file(path, search_path=(), strict=False)
    shapes = [placed(part, path) for part in found.parts]
    if not shapes:
        return found
    places = {color: place for place, color in enumerate(colors)}
    numbers = np.concatenate([_color_places(shape, places) for shape in shapes])
    return scan_parts(path, join(found.parts, path), numbers, instances, "z", found.warnings)


def _color_places(shape: Shape, places: dict[int, int]) -> NDArray[np.int64]:
    """Return the instance of each face by its color, shape ``(m,)``, `UNLABELED` for unknown colors."""
    found = None if shape.appearance is None else shape.appearance.get()
    best = np.full(len(shape.faces), UNLABELED, dtype=np.int64)
    if found is None:
        return best
    if found.vertex_colors is not None:
        rgb = found.vertex_colors[shape.faces[:, 0], :3]
        stored = rgb.astype(np.float64) / (255.0 if rgb.dtype == np.uint8 else 1.0)
        linear = np.stack([np.asarray(screen_color(stored[:, axis])) for axis in range(3)], axis=1)
        candidates = [_codes(stored), _codes(linear)]  # files with sRGB colors, and with linear ones as in glTF
    else:
        candidates = [_texture_codes(shape, found.materials[0].texture, found.corner_uv(shape.faces))]
    for codes in candidates:
        known, inverse = np.unique(codes, return_inverse=True)
        chosen = np.array([places.get(int(code), UNLABELED) for code in known], dtype=np.int64)[inverse.reshape(-1)]
        if (chosen != UNLABELED).sum() > (best != UNLABELED).sum():
            best = chosen
    return best


def _codes(colors: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return colors from 0 to 1 as numbers 0xRRGGBB."""
    red, green, blue = np.rint(np.clip(colors, 0, 1) * 255).astype(np.int64).T
    return (red << 16) | (green << 8) | blue


def _texture_codes(shape: Shape, texture: Texture | None, uv: NDArray[np.float32] | None) -> NDArray[np.int64]:
    """Return the texel at the center of each face as a number 0xRRGGBB; -1 without a texture."""
    if texture is None or uv is None:
        return np.full(len(shape.faces), -1, dtype=np.int64)
    image = texture.image
    height, width = image.shape[:2]
    u, v = np.moveaxis(uv.astype(np.float64).mean(axis=1), -1, 0)
    column = np.floor(u % 1.0 * width).astype(np.int64).clip(0, width - 1)
    row = np.floor((1.0 - v) % 1.0 * height).astype(np.int64).clip(0, height - 1)
    return _codes(image[row, column, :3] / 255.0)
