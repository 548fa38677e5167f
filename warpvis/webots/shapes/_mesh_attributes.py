# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Texture coordinates and normals of mesh files that Webots nodes reference, read when colors are first needed."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import FileFormatError
from warpvis.scene import keep_winding
from warpvis.scene.normals import transform_normals
from warpvis.webots._nodes import Node, Version
from warpvis.webots._urls import with_slashes
from warpvis.webots.shapes._geometry import load_mesh_parts, mesh_part_name

_Corners = NDArray[np.float64]


class MeshAttributes(NamedTuple):
    """Attributes of the corners of a mesh's triangles, in the order of `tessellate`."""

    uv: _Corners | None  # shape ``(m, 3, 2)``, v upwards; None if no part has any, 0 for parts without
    normals: _Corners | None  # shape ``(m, 3, 3)``, in the node's frame; None if no part has any, NaN for parts without


def mesh_attributes(node: Node, find: Callable[[str, Node], Path | None]) -> MeshAttributes:
    """Read the attributes of the mesh file of a Mesh or CadShape; see `_geometry` about parts and axes."""
    nothing = MeshAttributes(None, None)
    urls = node.texts("url")
    path = find(urls[0], node) if urls and urls[0] else None
    if path is None:
        return nothing
    suffix = PurePosixPath(with_slashes(urls[0])).suffix.lower()
    chosen = mesh_part_name(node, suffix)
    try:
        parts = [part for name, *part in _read(path, suffix, path.stat().st_mtime_ns) if chosen in ("", name)]
    except (FileFormatError, OSError):  # does not affect depth
        return nothing
    uv, normals = _joined([part[0] for part in parts], 0.0), _joined([part[1] for part in parts], np.nan)
    if normals is not None and suffix == ".dae" and node.version >= Version(2022, 2):
        x, y, z = np.moveaxis(normals, -1, 0)
        normals = np.stack([x, -z, y], axis=-1)
    if not node.flag("ccw", True):
        uv, normals = (None if rows is None else rows[:, ::-1] for rows in (uv, normals))
    return MeshAttributes(uv, normals)


@lru_cache(maxsize=16)
def _read(path: Path, suffix: str, changed: int) -> list[tuple[str, _Corners, _Corners]]:
    """Read name, texture coordinates and normals of each part; NaN where it has none."""
    found = []
    for name, mesh, placement in load_mesh_parts(path, suffix):
        linear = placement[:3, :3]
        faces = keep_winding(np.asarray(mesh.faces, dtype=np.int64), linear)
        uv, normals = getattr(mesh.visual, "uv", None), mesh._cache.cache.get("vertex_normals")
        has_uv = uv is not None and np.shape(uv) == (len(mesh.vertices), 2)
        corner_uv = np.asarray(uv, dtype=np.float64)[faces] if has_uv else np.full((len(faces), 3, 2), np.nan)
        corner_normals = np.full((len(faces), 3, 3), np.nan)
        if normals is not None:  # the property would compute missing ones
            corner_normals = transform_normals(np.asarray(normals, dtype=np.float64), linear)[faces]
        found.append((name, corner_uv, corner_normals))
    return found


def _joined(parts: list[_Corners], missing: float) -> _Corners | None:
    """Concatenate parts, and replace numbers that are not finite by `missing`; return None if no number is finite."""
    if not any(np.isfinite(part).any() for part in parts):
        return None
    rows = np.concatenate(parts)
    return np.where(np.isfinite(rows), rows, missing)
