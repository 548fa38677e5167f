# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Object models as BOP datasets hold them: PLY files in millimetres, their boxes and diameters."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_BLOCK = 512  # of points whose distances are looked at together: half a million, which stay in a core's cache


def ply_text(points: NDArray[np.float64], faces: NDArray[np.int32]) -> str:
    """Write a mesh as PLY text: single-precision vertices with normals, and triangles.

    Args:
        points: Vertices [mm], shape ``(n, 3)``.
        faces: Corner indices, shape ``(m, 3)``.
    """
    rows = np.concatenate([points, vertex_normals(points, faces)], axis=1).astype(np.float32)
    header = [
        "ply",
        "format ascii 1.0",
        f"element vertex {len(points)}",
        *(f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    vertices = ("%.9g %.9g %.9g %.9g %.9g %.9g\n" * len(rows)) % tuple(rows.ravel().tolist())
    triangles = ("3 %d %d %d\n" * len(faces)) % tuple(faces.ravel().tolist())
    return "\n".join(header) + "\n" + vertices + triangles


def vertex_normals(points: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Average the unit normals of the triangles around each vertex, weighted by their angles there, shape ``(n, 3)``.

    (Thuermer and Wuethrich, "Computing vertex normals from polygonal facets", 1998.) 0 where there is no triangle.
    """
    corners = points[faces]
    total = np.zeros_like(points)
    normals = _units(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    for k in range(3):
        after, before = (_units(corners[:, (k + step) % 3] - corners[:, k]) for step in (1, 2))
        angles = np.arccos(np.clip(np.einsum("ij,ij->i", after, before), -1, 1))
        np.add.at(total, faces[:, k], normals * angles[:, None])
    return _units(total)


def model_info(points: NDArray[np.float64]) -> dict[str, float]:
    """Measure a model for ``models_info.json``: its diameter, and the least corner and size of its box [mm]."""
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    info = {"diameter": diameter(points)}
    info |= {f"min_{axis}": value for axis, value in zip("xyz", low, strict=True)}
    return info | {f"size_{axis}": b - a for axis, a, b in zip("xyz", low, high, strict=True)}


def diameter(points: NDArray[np.float64]) -> float:
    """Find the greatest distance between two of the points, shape ``(n, 3)``.

    Points are left out that are too near to the middle of the box to belong to the farthest two.
    """
    points = np.unique(points, axis=0)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    radii = np.linalg.norm(points - middle, axis=1)
    order = np.argsort(-radii, kind="stable")
    points, radii = points[order] - middle, radii[order]
    greatest = 0.0
    for first in range(0, len(points), _BLOCK):
        if (2 * radii[first]) ** 2 <= greatest:
            break  # neither of these is so far out that another such one could be that far from it
        block = points[first : first + _BLOCK]
        # A partner among those not yet looked at, which must be far enough out.
        least = math.sqrt(greatest) - radii[first]
        last = first + int(np.searchsorted(-radii[first:], -least, side="right"))
        for start in range(first, last, _BLOCK):
            steps = block[:, None] - points[None, start : min(start + _BLOCK, last)]
            greatest = max(greatest, float(np.einsum("ijk,ijk->ij", steps, steps).max()))
    return math.sqrt(greatest)


def _units(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scale vectors to length 1, but for those that have none."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(lengths > 0, lengths, 1)
