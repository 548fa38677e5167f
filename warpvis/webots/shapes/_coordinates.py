# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Texture coordinates of Webots' geometry nodes, with v upward.

Coordinates of Box, Plane, Cylinder, Cone, Sphere and ElevationGrid follow src/wren/StaticMesh.cpp of Webots, whose v is
downward. Extrusion, Capsule, UV spheres, IndexedFaceSets without texCoord, and mesh files have no coordinates here.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import FileFormatError
from warpvis.webots._nodes import Node
from warpvis.webots.shapes._polygons import Points, split_polygons, triangulate, tuples

Corners = NDArray[np.float64]
"""Positions of the corners of triangles in the node's frame, z up [m], shape ``(m, 3, 3)``."""


def texture_coordinates(
    node: Node, vertices: Points, faces: NDArray[np.integer], *, mirrored: bool = False
) -> NDArray[np.float32] | None:
    """Compute texture coordinates of the corners of a geometry node's triangles.

    Args:
        node: The node.
        vertices: Vertices from `tessellate`.
        faces: Faces from `tessellate`.
        mirrored: Whether to reverse the corners of every triangle, for a mirroring transform.

    Returns:
        Coordinates, shape ``(m, 3, 2)``, or None if the node has none.
    """
    found: NDArray[np.float64] | None = None
    if node.type == "IndexedFaceSet":
        found = _indexed(node)
    elif node.type in _SHAPES:
        corners = vertices[faces]
        if not node.version.z_up:
            x, y, z = np.moveaxis(corners, -1, 0)
            corners = np.stack([x, -z, y], axis=-1)
        found = _SHAPES[node.type](node, corners)
    if found is None or len(found) != len(faces):
        return None
    return (found[:, ::-1] if mirrored else found).astype(np.float32)


def _unit(corners: Corners) -> Corners:
    """Scale positions around the origin to the range -1 to 1 along all axes."""
    sizes = np.abs(corners).max(axis=(0, 1))
    return corners / np.where(sizes > 0, sizes, 1.0)


def _box(node: Node, corners: Corners) -> NDArray[np.float64]:
    flat = np.ptp(corners, axis=1) == 0
    side, rows = flat.argmax(axis=1), np.arange(len(corners))
    ahead = np.sign(corners[rows, 0, side])[:, None]
    x, y, z = np.moveaxis(_unit(corners), -1, 0)
    u = np.choose(side[:, None], [ahead * y, -ahead * x, x])
    v = np.choose(side[:, None], [z, z, ahead * y])
    return np.stack([u, v], axis=-1) / 2 + 0.5


def _plane(node: Node, corners: Corners) -> NDArray[np.float64]:
    return _unit(corners)[..., :2] / 2 + 0.5


def _around(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the angle from y toward -x in revolutions.

    Triangles across the seam get values above 1, and corners at poles the mean of the other corners.
    """
    share = np.arctan2(-x, y) / (2 * np.pi) % 1.0
    share[share > 1 - 1e-9] = 0.0
    pole = np.maximum(np.abs(x), np.abs(y)) < 1e-9
    low, high = np.where(pole, 1.0, share).min(axis=1), np.where(pole, 0.0, share).max(axis=1)
    share = np.where((high - low > 0.5)[:, None] & (share < 0.5), share + 1, share)
    mean = np.where(pole, 0.0, share).sum(axis=1) / np.maximum((~pole).sum(axis=1), 1)
    return np.where(pole, mean[:, None], share)


def _cylinder(node: Node, corners: Corners) -> NDArray[np.float64]:
    x, y, z = np.moveaxis(_unit(corners), -1, 0)
    side = np.stack([_around(x, y), z / 2 + 0.5], axis=-1)
    cap = np.stack([x, np.sign(z) * y], axis=-1) / 2 + 0.5
    return np.where((np.ptp(z, axis=1) == 0)[:, None, None], cap, side)


def _cone(node: Node, corners: Corners) -> NDArray[np.float64]:
    x, y, z = np.moveaxis(_unit(corners), -1, 0)
    count = node.integer("subdivision", 12)
    around, apex = _around(x, y), z > 0
    # The lower corners are offset by one segment, unlike the apex.
    side = np.stack([np.where(apex, around, around - 1 / count), z / 2 + 0.5], axis=-1)
    cap = np.stack([x, -y], axis=-1) / 2 + 0.5
    return np.where((np.ptp(z, axis=1) == 0)[:, None, None], cap, side)


def _sphere(node: Node, corners: Corners) -> NDArray[np.float64] | None:
    if not node.flag("ico", True):
        return None
    x, y, z = np.moveaxis(corners / np.linalg.norm(corners, axis=-1, keepdims=True), -1, 0)
    return np.stack([_around(x, y), 0.5 + np.arcsin(np.clip(z, -1, 1)) / np.pi], axis=-1)


def _elevation_grid(node: Node, corners: Corners) -> NDArray[np.float64]:
    low, high = corners[..., :2].min(axis=(0, 1)), corners[..., :2].max(axis=(0, 1))
    return (corners[..., :2] - low) / (high - low)


def _indexed(node: Node) -> NDArray[np.float64] | None:
    """Return the coordinates of an IndexedFaceSet's triangles, in the order of `indexed_face_set`."""
    coordinates, coordinate = node.node("texCoord"), node.node("coord")
    if coordinates is None or coordinate is None:
        return None
    rows, points = tuples(coordinates, "point", 2, ()), tuples(coordinate, "point", 3, ())
    index = node.numbers("coordIndex").astype(np.int64)
    numbers = node.numbers("texCoordIndex").astype(np.int64) if len(node.numbers("texCoordIndex")) else index
    index, numbers = (row if len(row) and row[-1] == -1 else np.append(row, -1) for row in (index, numbers))
    inside = index >= 0
    if len(numbers) != len(index) or not ((numbers >= 0) == inside).all():
        raise FileFormatError(f"{node.file}:{node.line}: texCoordIndex must have the same polygons as coordIndex")
    if inside.any() and numbers.max() >= len(rows):
        raise FileFormatError(f"{node.file}:{node.line}: texCoordIndex must index the points of texCoord")
    # Corners instead of points, since each corner has its own coordinates.
    corners = np.where(inside, np.cumsum(inside) - 1, -1)
    faces = triangulate(node, points[index[inside]], split_polygons(corners), index[inside])
    if not node.flag("ccw", True):
        faces = faces[:, ::-1]
    return rows[numbers[inside]][faces]


_SHAPES: dict[str, Callable[[Node, Corners], NDArray[np.float64] | None]] = {
    "Box": _box,
    "Cone": _cone,
    "Cylinder": _cylinder,
    "ElevationGrid": _elevation_grid,
    "Plane": _plane,
    "Sphere": _sphere,
}
