# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Vertex normals of files: replacement of invalid ones, and transformation together with a mesh."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.scene.materials import Appearance

_UP = (0.0, 0.0, 1.0)
"""Normal of faces without area, which no ray hits."""


def replace_invalid(
    normals: NDArray[np.generic], vertices: NDArray[np.floating], faces: NDArray[np.integer]
) -> tuple[NDArray[np.float64] | None, int]:
    """Replace vertex normals that are zero or not finite by the normals of the faces at that vertex.

    Args:
        normals: Vertex normals of any length, shape ``(n, 3)``.
        vertices: Corners of the mesh, shape ``(n, 3)``.
        faces: Corner indices of its triangles, shape ``(m, 3)``.

    Returns:
        The normals of vertices, shape ``(n, 3)``, or of corners, ``(m, 3, 3)``, if some were replaced; None if all of
        them are invalid. And the number of invalid ones that faces use.
    """
    rows = normals.astype(np.float64)
    is_bad = ~have_direction(rows)
    if not is_bad.any():
        return rows, 0
    used = np.unique(faces[is_bad[faces]])
    if not len(used):
        rows[is_bad] = _UP
        return rows, 0
    if is_bad[faces].all():
        return None, len(used)
    corners = rows[faces]
    with np.errstate(invalid="ignore", over="ignore"):
        a, b, c = (vertices[faces[:, number]] for number in range(3))
        flat = np.cross(b - a, c - a)
    flat[~have_direction(flat)] = _UP
    bad_corners = is_bad[faces]
    corners[bad_corners] = np.repeat(flat[:, None], 3, axis=1)[bad_corners]
    return corners, len(used)


def transform_normals(normals: NDArray[np.floating], linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Transform normals together with a surface by linear maps: by their inverse transpose, up to length.

    The inverse transpose is the matrix of cofactors divided by the determinant, so flattening maps are allowed; they
    can yield normals of length 0.

    Args:
        normals: Shape ``(..., 3)``.
        linear: One map, shape ``(3, 3)``, or one for each normal, ``(n, 3, 3)``.

    Returns:
        Normals of any length, in the shape of `normals`.
    """
    a, b, c = (linear[..., number] for number in range(3))
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)
    sign = np.where((a * cofactors[..., 0]).sum(axis=-1) < 0, -1.0, 1.0)
    return np.einsum("...ij,...j->...i", cofactors * sign[..., None, None], normals)


def transform_appearance(appearance: Appearance, linear: NDArray[np.float64]) -> Appearance:
    """Return the appearance of a mesh transformed by a linear map, whose triangles are reversed if it mirrors."""
    changes: dict[str, Any] = {}
    if np.linalg.det(linear) < 0:
        corner_rows = {name: getattr(appearance, name) for name in ("uv", "normals")}
        changes = {name: rows[:, ::-1] for name, rows in corner_rows.items() if rows is not None and rows.ndim == 3}
        map_uv = appearance.map_uv
        if any(rows.ndim == 3 for rows in map_uv.values()):
            changes["map_uv"] = {name: rows[:, ::-1] if rows.ndim == 3 else rows for name, rows in map_uv.items()}
    if appearance.normals is not None:
        moved = transform_normals(changes.get("normals", appearance.normals).astype(np.float64), linear)
        length = np.linalg.norm(moved, axis=-1, keepdims=True)
        is_valid = bool((np.isfinite(length) & (length > 0)).all())
        changes["normals"] = (moved / length).astype(np.float32) if is_valid else None
    if appearance.vertex_grid is not None:
        changes["vertex_grid"] = None
    return replace_arrays(appearance, **changes) if changes else appearance


def replace_arrays(appearance: Appearance, **changes: Any) -> Appearance:
    """Return the appearance with other arrays, which are valid; the others are neither checked nor copied again."""
    changed = copy.copy(appearance)
    for name, rows in changes.items():
        object.__setattr__(changed, name, rows)
    return changed


def have_direction(vectors: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether vectors are finite and not zero, also as the sum of their squares."""
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(vectors, axis=-1)
    return np.isfinite(length) & (length > 0)
