# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Object models of BOP datasets: PLY files in millimeters, boxes and diameters."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_BLOCK = 512  # points per block: distances of all pairs of two blocks take 2 MB and fit into the cache of a core


def ply_text(points: NDArray[np.float64], faces: NDArray[np.int32]) -> str:
    """Format a mesh as PLY text: single-precision vertices with normals, and triangles.

    Args:
        points: Vertices [mm], shape ``(n, 3)``.
        faces: Vertex indices of triangles, shape ``(m, 3)``.
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
    """Return vertex normals, weighted by the angles of the adjacent triangles, shape ``(n, 3)``.

    They are 0 at vertices without triangles. Source: Thuermer and Wuethrich, "Computing vertex normals from polygonal
    facets", 1998.
    """
    corners = points[faces]
    total = np.zeros_like(points)
    normals = _normalize(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    for k in range(3):
        after, before = (_normalize(corners[:, (k + step) % 3] - corners[:, k]) for step in (1, 2))
        angles = np.arccos(np.clip(np.einsum("ij,ij->i", after, before), -1, 1))
        np.add.at(total, faces[:, k], normals * angles[:, None])
    return _normalize(total)


def model_info(points: NDArray[np.float64]) -> dict[str, float]:
    """Return the entry of a model in ``models_info.json``: diameter, and minimum corner and size of the box [mm]."""
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    info = {"diameter": diameter(points)}
    info |= {f"min_{axis}": value for axis, value in zip("xyz", low, strict=True)}
    return info | {f"size_{axis}": b - a for axis, a, b in zip("xyz", low, high, strict=True)}


def diameter(points: NDArray[np.float64]) -> float:
    """Return the maximum distance between two of the points, shape ``(n, 3)``.

    Points that are too close to the center of the box to be part of the farthest pair are skipped.
    """
    points = np.unique(points, axis=0)
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    radii = np.linalg.norm(points - center, axis=1)
    order = np.argsort(-radii, kind="stable")
    points, radii = points[order] - center, radii[order]
    max_squared = 0.0
    for first in range(0, len(points), _BLOCK):
        if (2 * radii[first]) ** 2 <= max_squared:
            break  # all remaining pairs are closer than the current maximum
        block = points[first : first + _BLOCK]
        # Triangle inequality: the other point of a farther pair has at least this radius.
        min_radius = math.sqrt(max_squared) - radii[first]
        last = first + int(np.searchsorted(-radii[first:], -min_radius, side="right"))
        for start in range(first, last, _BLOCK):
            steps = block[:, None] - points[None, start : min(start + _BLOCK, last)]
            max_squared = max(max_squared, float(np.einsum("ijk,ijk->ij", steps, steps).max()))
    return math.sqrt(max_squared)


def _normalize(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Normalize vectors; zero vectors are not changed."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(lengths > 0, lengths, 1)
