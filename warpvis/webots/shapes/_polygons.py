# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Triangles of the Webots nodes that list points: IndexedFaceSet, ElevationGrid and Extrusion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import FARTHEST
from warpvis.errors import FileFormatError
from warpvis.webots._nodes import Node

MAX_POINTS = 1 << 22
"""A grid or an extrusion has at most so many points: a short text can ask for any number of them."""
MAX_CORNERS = 2000
"""A polygon that is not convex has at most so many corners: the time to cut it up grows with their square."""

Triangles = tuple[NDArray[np.float64], NDArray[np.int32]]
Points = NDArray[np.float64]
Indices = NDArray[np.int64]


def refuse(node: Node, wanted: str, got: object) -> NoReturn:
    """Say what a node should have had.

    Raises:
        FileFormatError: Always.
    """
    raise FileFormatError(f"{node.file}:{node.line}: expected {wanted} in {node.type}, got {got}")


def whole(node: Node, field: str, default: int, least: int, most: int | None = None) -> int:
    """Read a field's whole number, which must be from `least` to `most`."""
    value = node.integer(field, default)
    if value < least or (most is not None and value > most):
        limits = f"of at least {least}" if most is None else f"from {least} to {most}"
        refuse(node, f"{field} {limits}", value)
    return value


def positive(node: Node, field: str, default: float) -> float:
    """Read a field's number, which must be above zero."""
    return float(positives(node, field, (default,))[0])


def positives(node: Node, field: str, default: tuple[float, ...]) -> Points:
    """Read a field's vector, whose numbers must all be above zero."""
    values = node.vector(field, default)
    if not ((values > 0) & (values <= FARTHEST)).all():
        refuse(node, f"a positive {field} [m] of at most {FARTHEST:g}", " ".join(f"{value:g}" for value in values))
    return values


def tuples(node: Node, field: str, width: int, default: Sequence[Sequence[float]]) -> Points:
    """Read a field's vectors, shape ``(n, width)``."""
    if field not in node.fields:
        return np.array(default, dtype=np.float64).reshape(-1, width)
    values = node.numbers(field)
    if len(values) % width:
        refuse(node, f"groups of {width} numbers in {field}", f"{len(values)} numbers")
    if len(values) and np.abs(values).max() > FARTHEST:
        refuse(node, f"numbers of at most {FARTHEST:g} in {field}", f"{np.abs(values).max():g}")
    return values.reshape(-1, width)


def compact(vertices: Points, faces: NDArray[np.integer]) -> Triangles | None:
    """Drop vertices that no triangle uses; return None where there are no triangles."""
    if not len(faces):
        return None
    used, corners = np.unique(faces, return_inverse=True)
    return vertices[used], corners.reshape(-1, 3).astype(np.int32)


def join(parts: Sequence[tuple[Points, NDArray[np.integer]]]) -> tuple[Points, NDArray[np.integer]]:
    """Join meshes to one: vertices [m], shape ``(n, 3)``, and corner indices, shape ``(m, 3)``."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    vertices = np.concatenate([vertices for vertices, _ in parts])
    return vertices, np.concatenate([faces + start for (_, faces), start in zip(parts, starts[:-1], strict=True)])


def indexed_face_set(node: Node) -> Triangles | None:
    """Make the triangles of an IndexedFaceSet: polygons of ``coordIndex`` end at -1, or at the end of the list.

    Polygons may be concave whatever ``convex`` says: Webots cuts up each of them. Those of fewer than three corners are
    left out, as it does.
    """
    coordinate = node.node("coord")
    if coordinate is None:
        return None
    points = tuples(coordinate, "point", 3, ())
    given = node.numbers("coordIndex")
    wrong = np.flatnonzero((given != np.floor(given)) | (given < -1) | (given >= len(points)))
    if len(wrong):
        wanted = f"-1 or an index below {len(points)}, the number of points, at every place of coordIndex"
        refuse(node, wanted, f"{given[wrong[0]]:g} at place {wrong[0]}")
    faces = triangulate(node, points, split_polygons(given.astype(np.int64)))
    return compact(points, faces if node.flag("ccw", True) else faces[:, ::-1])


def elevation_grid(node: Node) -> Triangles | None:
    """Make the triangles of an ElevationGrid, facing up; None for a grid without cells.

    Point (i, j) lies at ``(xSpacing * i, ySpacing * j)`` with height ``height[i + j * xDimension]`` along z; before
    R2022a at ``zSpacing * j`` along z, with the height along y. Heights that are not given are zero, and those beyond
    the grid are not used (Webots' reference, ElevationGrid).
    """
    second = "y" if node.version.z_up else "z"
    columns, rows = (whole(node, f"{axis}Dimension", 0, 0) for axis in ("x", second))
    steps = [positive(node, f"{axis}Spacing", 1.0) for axis in ("x", second)]
    if columns * rows > MAX_POINTS:
        refuse(node, f"a grid of at most {MAX_POINTS} points", f"{columns} x {rows}")
    if columns < 2 or rows < 2:
        return None
    given = node.numbers("height")[: columns * rows]
    heights = np.zeros(columns * rows)
    heights[: len(given)] = given
    j, i = (axis.ravel() for axis in np.indices((rows, columns)))
    corner = np.arange(rows * columns).reshape(rows, columns)
    here, right, above, across = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    if node.version.z_up:
        vertices = np.stack([steps[0] * i, steps[1] * j, heights], axis=1)
        cells = [(above, here, across), (across, here, right)]
    else:
        vertices = np.stack([steps[0] * i, heights, steps[1] * j], axis=1)
        cells = [(here, above, right), (right, above, across)]
    faces = np.stack([np.stack(cell, axis=-1) for cell in cells], axis=2)
    return vertices, faces.reshape(-1, 3).astype(np.int32)


def triangulate(node: Node, points: Points, groups: list[Indices], names: Indices | None = None) -> Indices:
    """Cut polygons into triangles of the same winding, shape ``(m, 3)``.

    A polygon that crosses itself is cut as far as it goes; Webots' tessellator draws nothing of it. A triangle that has
    a point twice is left out.

    Args:
        node: Where they come from, for messages.
        points: Shape ``(n, 3)``.
        groups: Polygons of equal numbers of corners, shape ``(k, corners)`` each.
        names: Which point each row is, where rows are corners; each another one by default.
    """
    parts = [np.empty((0, 3), dtype=np.int64)]
    for polygons in groups:
        corners = polygons.shape[1]
        if corners < 3:
            continue
        concave = np.zeros(len(polygons), dtype=bool)
        if corners > 3:
            turns = _turns(points[polygons])
            concave = (turns < -1e-9 * np.abs(turns).max(axis=1, keepdims=True)).any(axis=1)
        if corners == 4:  # a fan from the corner that turns the other way does
            first = np.where(concave, turns.argmin(axis=1), 0)
            polygons = np.take_along_axis(polygons, (first[:, None] + np.arange(4)) % 4, axis=1)
            concave[:] = False
        fan = [(0, k, k + 1) for k in range(1, corners - 1)]
        parts.append(polygons[~concave][:, fan].reshape(-1, 3))
        if concave.any() and corners > MAX_CORNERS:
            refuse(node, f"at most {MAX_CORNERS} corners of a polygon that is not convex", corners)
        parts += [polygon[_ears(points[polygon])] for polygon in polygons[concave]]
    faces = np.concatenate(parts)
    named = faces if names is None else names[faces]
    return faces[(named != np.roll(named, 1, axis=1)).all(axis=1)]


def split_polygons(index: Indices) -> list[Indices]:
    """Split a list that has -1 after each polygon, into groups of equal numbers of corners."""
    if len(index) and index[-1] != -1:
        index = np.append(index, -1)
    ends = np.flatnonzero(index == -1)
    starts = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else ends
    lengths = ends - starts
    return [index[starts[lengths == count, None] + np.arange(count)] for count in np.unique(lengths)]


def _normals(corners: Points) -> Points:
    """Compute Newell's normals of polygons ``(..., n, 3)``, twice their area long; concave corners do not turn them."""
    around = corners - corners[..., :1, :]
    return np.cross(around, np.roll(around, -1, axis=-2)).sum(axis=-2)


def _turns(corners: Points) -> Points:
    """Measure how far each corner of polygons ``(k, n, 3)`` turns about the normal; below zero is the other way."""
    edges = np.roll(corners, -1, axis=1) - corners
    return np.einsum("knx,kx->kn", np.cross(np.roll(edges, 1, axis=1), edges), _normals(corners))


def _ears(corners: Points) -> Indices:
    """Cut one simple polygon ``(n, 3)`` into triangles by ear clipping, as corner numbers."""
    normal = _normals(corners)
    # Dropping the axis that the normal is longest along keeps the polygon simple; the other two in cyclic order.
    axis = int(np.argmax(np.abs(normal)))
    flat = corners[:, [(axis + 1) % 3, (axis + 2) % 3]] * (1.0, np.sign(normal[axis]))
    left, ears = list(range(len(flat))), []
    least = 1e-12 * np.ptp(flat, axis=0).max() ** 2
    while len(left) > 2:
        ear = _find_ear(flat, left, least)
        if ear is None:
            break
        before, after = left[ear - 1], left[(ear + 1) % len(left)]
        if _turn(flat[before], flat[left[ear]], flat[after]) > least:
            ears.append((before, left[ear], after))
        del left[ear]
    return np.array(ears, dtype=np.int64).reshape(-1, 3)


def _find_ear(flat: Points, left: list[int], least: float) -> int | None:
    """Find the place in `left` of a corner whose triangle holds no other; else of one on its neighbours' line."""
    places = flat[left]
    before, after = np.roll(places, 1, axis=0), np.roll(places, -1, axis=0)
    turns = _turn(before, places, after)
    reflex = places[turns <= least]  # only these can lie within an ear
    for k in np.flatnonzero(turns > least):
        triangle = (before[k], places[k], after[k])
        inside = np.ones(len(reflex), dtype=bool)
        for first, second in zip(triangle, triangle[1:] + triangle[:1], strict=True):
            inside &= (_turn(first, second, reflex) >= 0) & (reflex != first).any(axis=1)
        if not inside.any():
            return int(k)
    straight = np.flatnonzero(np.abs(turns) <= least)
    return int(straight[0]) if len(straight) else None


def _turn(a: Points, b: Points, c: Points) -> NDArray[np.float64]:
    """Compute twice the signed area of triangles in the plane."""
    one, two = b - a, c - a
    return np.asarray(one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])
