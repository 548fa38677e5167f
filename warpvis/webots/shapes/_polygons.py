# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Triangulation of polygons and grids: IndexedFaceSet, ElevationGrid and Extrusion.

The rules of Extrusion are those of VRML97 (ISO/IEC 14772-1, section 6.18), except for Webots' deviations: the spine is
a B-spline of its points (``splineSubdivision``), the cross-section's second axis is reversed, and ``orientation``
rotates about the axes of the node.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import FARTHEST
from warpvis.webots._nodes import Node, fail, rotation_matrices

MAX_POINTS = 1 << 22
"""Maximum number of points of a grid or extrusion, since a short text can define any number."""
MAX_CORNERS = 2000
"""Maximum number of corners of a concave polygon; the time of triangulation is quadratic in it."""

Triangles = tuple[NDArray[np.float64], NDArray[np.int32]]
Points = NDArray[np.float64]
Indices = NDArray[np.int64]

_SQUARE = ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1))


def refuse(node: Node, expected: str, got: object) -> NoReturn:
    """Raise a FileFormatError with the expected and the actual content of a node."""
    fail(node, f"{expected} in {node.type}", got)


def whole(node: Node, field: str, default: int, lower: int, upper: int | None = None) -> int:
    """Read a whole number, which must be from `lower` to `upper`."""
    value = node.integer(field, default)
    if value < lower or (upper is not None and value > upper):
        limits = f"of at least {lower}" if upper is None else f"from {lower} to {upper}"
        refuse(node, f"{field} {limits}", value)
    return value


def positive(node: Node, field: str, default: float) -> float:
    """Read a number, which must be positive."""
    return float(positives(node, field, (default,))[0])


def positives(node: Node, field: str, default: tuple[float, ...]) -> Points:
    """Read a vector, whose elements must be positive."""
    values = node.vector(field, default)
    if not ((values > 0) & (values <= FARTHEST)).all():
        refuse(node, f"a positive {field} [m] of at most {FARTHEST:g}", " ".join(f"{value:g}" for value in values))
    return values


def tuples(node: Node, field: str, width: int, default: Sequence[Sequence[float]]) -> Points:
    """Read a list of vectors, shape ``(n, width)``."""
    if field not in node.fields:
        return np.array(default, dtype=np.float64).reshape(-1, width)
    values = node.numbers(field)
    if len(values) % width:
        refuse(node, f"groups of {width} numbers in {field}", f"{len(values)} numbers")
    if len(values) and np.abs(values).max() > FARTHEST:
        refuse(node, f"numbers of at most {FARTHEST:g} in {field}", f"{np.abs(values).max():g}")
    return values.reshape(-1, width)


def compact(vertices: Points, faces: NDArray[np.integer]) -> Triangles | None:
    """Remove unused vertices; return None if there are no triangles."""
    if not len(faces):
        return None
    used, corners = np.unique(faces, return_inverse=True)
    return vertices[used], corners.reshape(-1, 3).astype(np.int32)


def join(parts: Sequence[tuple[Points, NDArray[np.integer]]]) -> tuple[Points, NDArray[np.integer]]:
    """Concatenate meshes: vertices [m], shape ``(n, 3)``, and faces, shape ``(m, 3)``."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    vertices = np.concatenate([vertices for vertices, _ in parts])
    return vertices, np.concatenate([faces + start for (_, faces), start in zip(parts, starts[:-1], strict=True)])


def indexed_face_set(node: Node) -> Triangles | None:
    """Tessellate an IndexedFaceSet, in whose ``coordIndex`` polygons end at -1 or at the end of the list.

    As in Webots, polygons may be concave regardless of ``convex``, and those of fewer than three corners are skipped.
    """
    coordinate = node.node("coord")
    if coordinate is None:
        return None
    points = tuples(coordinate, "point", 3, ())
    indices = node.numbers("coordIndex")
    wrong = np.flatnonzero((indices != np.floor(indices)) | (indices < -1) | (indices >= len(points)))
    if len(wrong):
        expected = f"-1 or an index below {len(points)}, the number of points, at every position of coordIndex"
        refuse(node, expected, f"{indices[wrong[0]]:g} at position {wrong[0]}")
    faces = triangulate(node, points, split_polygons(indices.astype(np.int64)))
    return compact(points, faces if node.flag("ccw", True) else faces[:, ::-1])


def elevation_grid(node: Node) -> Triangles | None:
    """Tessellate an ElevationGrid, facing up; return None for a grid without cells.

    Point (i, j) is at ``(xSpacing * i, ySpacing * j)`` with height ``height[i + j * xDimension]`` along z; before
    R2022a, at ``zSpacing * j`` along z with the height along y. Missing heights are zero, and excess heights are
    ignored (Webots' reference, ElevationGrid).
    """
    second = "y" if node.version.z_up else "z"
    columns, rows = (whole(node, f"{axis}Dimension", 0, 0) for axis in ("x", second))
    steps = [positive(node, f"{axis}Spacing", 1.0) for axis in ("x", second)]
    if columns * rows > MAX_POINTS:
        refuse(node, f"a grid of at most {MAX_POINTS} points", f"{columns} x {rows}")
    if columns < 2 or rows < 2:
        return None
    known = node.numbers("height")[: columns * rows]
    heights = np.zeros(columns * rows)
    heights[: len(known)] = known
    j, i = (axis.ravel() for axis in np.indices((rows, columns)))
    corner = np.arange(rows * columns).reshape(rows, columns)
    near, right, above, across = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    if node.version.z_up:
        vertices = np.stack([steps[0] * i, steps[1] * j, heights], axis=1)
        cells = [(above, near, across), (across, near, right)]
    else:
        vertices = np.stack([steps[0] * i, heights, steps[1] * j], axis=1)
        cells = [(near, above, right), (right, above, across)]
    faces = np.stack([np.stack(cell, axis=-1) for cell in cells], axis=2)
    return vertices, faces.reshape(-1, 3).astype(np.int32)


def triangulate(node: Node, points: Points, groups: list[Indices], names: Indices | None = None) -> Indices:
    """Triangulate polygons, preserving their winding, shape ``(m, 3)``.

    Polygons are grouped by number of corners, shape ``(k, corners)``. If rows of `points` are corners, `names` has the
    index of each one's point. A self-intersecting polygon is triangulated as far as possible; Webots' tessellator skips
    it. Triangles with a repeated point are removed.
    """
    parts = [np.empty((0, 3), dtype=np.int64)]
    for polygons in groups:
        corners = polygons.shape[1]
        if corners < 3:
            continue
        concave = np.zeros(len(polygons), dtype=bool)
        if corners > 3:
            angles = _signed_turns(points[polygons])
            concave = (angles < -1e-9 * np.abs(angles).max(axis=1, keepdims=True)).any(axis=1)
        if corners == 4:  # a fan from the reflex corner is valid
            first = np.where(concave, angles.argmin(axis=1), 0)
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
    """Split a list of polygons, each terminated by -1, into groups by number of corners."""
    if len(index) and index[-1] != -1:
        index = np.append(index, -1)
    ends = np.flatnonzero(index == -1)
    starts = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else ends
    lengths = ends - starts
    return [index[starts[lengths == count, None] + np.arange(count)] for count in np.unique(lengths)]


def _normals(corners: Points) -> Points:
    """Compute Newell's normals of polygons ``(..., n, 3)``, of length twice the area; concave corners are allowed."""
    around = corners - corners[..., :1, :]
    return np.cross(around, np.roll(around, -1, axis=-2)).sum(axis=-2)


def _signed_turns(corners: Points) -> Points:
    """Compute a signed measure of the turn at each corner of polygons ``(k, n, 3)``; negative at reflex corners."""
    edges = np.roll(corners, -1, axis=1) - corners
    return np.einsum("knx,kx->kn", np.cross(np.roll(edges, 1, axis=1), edges), _normals(corners))


def _ears(corners: Points) -> Indices:
    """Triangulate one simple polygon ``(n, 3)`` by ear clipping; return corner indices."""
    normal = _normals(corners)
    # Projecting along the dominant axis of the normal keeps the polygon simple; the other two are in cyclic order.
    axis = int(np.argmax(np.abs(normal)))
    flat = corners[:, [(axis + 1) % 3, (axis + 2) % 3]] * (1.0, np.sign(normal[axis]))
    remaining, ears = list(range(len(flat))), []
    tolerance = 1e-12 * np.ptp(flat, axis=0).max() ** 2
    while len(remaining) > 2:
        ear = _find_ear(flat, remaining, tolerance)
        if ear is None:
            break
        before, after = remaining[ear - 1], remaining[(ear + 1) % len(remaining)]
        if _signed_area(flat[before], flat[remaining[ear]], flat[after]) > tolerance:
            ears.append((before, remaining[ear], after))
        del remaining[ear]
    return np.array(ears, dtype=np.int64).reshape(-1, 3)


def _find_ear(flat: Points, remaining: list[int], tolerance: float) -> int | None:
    """Find the position in `remaining` of an ear: a corner whose triangle contains no other, else a collinear one."""
    points = flat[remaining]
    before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
    areas = _signed_area(before, points, after)
    reflex = points[areas <= tolerance]  # only these can be inside an ear
    for k in np.flatnonzero(areas > tolerance):
        triangle = (before[k], points[k], after[k])
        inside = np.ones(len(reflex), dtype=bool)
        for first, second in zip(triangle, triangle[1:] + triangle[:1], strict=True):
            inside &= (_signed_area(first, second, reflex) >= 0) & (reflex != first).any(axis=1)
        if not inside.any():
            return int(k)
    straight = np.flatnonzero(np.abs(areas) <= tolerance)
    return int(straight[0]) if len(straight) else None


def _signed_area(a: Points, b: Points, c: Points) -> NDArray[np.float64]:
    """Compute twice the signed area of triangles in the plane."""
    one, two = b - a, c - a
    return np.asarray(one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])


def extrusion(node: Node) -> Triangles | None:
    """Tessellate an Extrusion; return None if neither sides nor caps have triangles."""
    upwards = (0, 0, 1) if node.version.z_up else (0, 1, 0)
    section = tuples(node, "crossSection", 2, _SQUARE)
    spine = tuples(node, "spine", 3, ((0, 0, 0), upwards))
    if len(section) < 2 or len(spine) < 2:
        refuse(node, "at least two points in crossSection and spine", f"{len(section)} and {len(spine)}")
    scale = _for_each(node, "scale", tuples(node, "scale", 2, ((1, 1),)), len(spine))
    rotations = _for_each(node, "orientation", tuples(node, "orientation", 4, ((0, 0, 1, 0),)), len(spine))
    subdivision = max(node.integer("splineSubdivision", 4), 0)
    count = (len(spine) - 1) * max(subdivision, 1) + 1
    if count * len(section) > MAX_POINTS:
        refuse(node, f"at most {MAX_POINTS} points", f"{count} x {len(section)}")
    if subdivision > 0:
        scale, rotations = _interpolate(scale, subdivision), _interpolate(rotations, subdivision)
        spine = _smooth(spine, subdivision)
    side, other = _axes(node, spine)
    flat = section * scale[:, None]
    offsets = flat[..., :1] * side[:, None] - flat[..., 1:] * other[:, None]
    points = (np.einsum("nij,nkj->nki", rotation_matrices(rotations), offsets) + spine[:, None]).reshape(-1, 3)
    faces = triangulate(node, points, _outlines(node, section, len(spine)))
    return compact(points, faces if node.flag("ccw", True) else faces[:, ::-1])


def _for_each(node: Node, field: str, values: Points, count: int) -> Points:
    """Broadcast one value, or one value per point, to all points of the spine."""
    if len(values) not in (1, count):
        refuse(node, f"1 or {count} values in {field}, one for all or each point of the spine", len(values))
    return np.broadcast_to(values, (count, values.shape[1]))


def _smooth(spine: Points, subdivision: int) -> Points:
    """Evaluate a uniform cubic B-spline from the first to the last point, with linear extrapolation at both ends."""
    ends = 2 * spine[[0, -1]] - spine[[1, -2]]
    control = np.concatenate([ends[:1], spine, ends[1:]])
    t = np.arange(1, subdivision + 1)[:, None] / subdivision
    weights = np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]) / 6
    pieces = np.stack([control[k : k + len(spine) - 1] for k in range(4)])
    return np.concatenate([spine[:1], np.einsum("wtx,wsc->stc", weights, pieces).reshape(-1, 3)])


def _interpolate(values: Points, subdivision: int) -> Points:
    """Interpolate values linearly at the points of the B-spline."""
    t = np.arange((len(values) - 1) * subdivision + 1) / subdivision
    knots = np.arange(len(values))
    return np.stack([np.interp(t, knots, column) for column in values.T], axis=1)


def _axes(node: Node, spine: Points) -> tuple[Points, Points]:
    """Compute the cross-section's two unit axes at every point of the spine."""
    closed = bool((spine[0] == spine[-1]).all())
    ends = (spine[-2], spine[1]) if closed else (2 * spine[0] - spine[1], 2 * spine[-1] - spine[-2])
    ahead, behind = np.vstack([spine[1:], ends[1]]) - spine, np.vstack([ends[0], spine[:-1]]) - spine
    tangents = ahead - behind
    lengths = np.linalg.norm(tangents, axis=1, keepdims=True)
    if lengths.min() <= 1e-12 * np.abs(spine).max():
        refuse(node, "a spine with a tangent at every point", f"none at point {np.argmin(lengths)} of its curve")
    tangents /= lengths
    bends = np.cross(ahead, behind)
    sizes = np.linalg.norm(bends, axis=1)
    # Differences of collinear points are parallel only up to rounding.
    bent = sizes > 1e-9 * np.linalg.norm(ahead, axis=1) * np.linalg.norm(behind, axis=1)
    bends[bent] /= sizes[bent, None]
    # The first axis is that of the first bend; before R2022a, only of a bend at the start.
    known = bent if node.version.z_up else bent[:2]
    previous = bends[np.argmax(known)] if known.any() else _across(tangents[0], node.version.z_up)
    if not closed and (previous > 0).any():
        previous = -previous
    other = np.empty_like(spine)
    for k in range(len(spine)):
        bend = bends[k] if bent[k] else previous
        previous = other[k] = -bend if bend @ previous < 0 else bend
    side = np.cross(tangents, other)
    return _unit(side), _unit(other)


def _unit(vectors: Points) -> Points:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _across(direction: NDArray[np.float64], z_up: bool) -> NDArray[np.float64]:
    """Choose the second axis of a straight spine."""
    x, y, z = direction
    if not z_up:
        return np.cross((-1, 0, x / z) if z else (0, 0, 1), -direction)
    if not (x or z):
        return np.array([0.0, 0, 1])
    # The z axis, rotated by the rotation from +y to the direction. Webots tests its signs; along z the last component
    # is the cosine of a right angle, 6e-17, which is above zero, so the same formula is used here.
    first, third = np.array([z, -x]) / np.hypot(x, z)
    angle = np.arccos(y)
    cosine = np.cos(angle)
    return np.array([first * third * (1 - cosine), -first * np.sin(angle), third**2 * (1 - cosine) + cosine])


def _outlines(node: Node, section: Points, count: int) -> list[NDArray[np.int64]]:
    """List the polygons of sides and caps, grouped by number of corners."""
    width = len(section)
    index = np.arange(count * width).reshape(count, width)
    ring = width
    if (section[0] == section[-1]).all():
        index[:, -1] = index[:, 0]
        ring = width - 1
    sides = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)
    groups = [sides.reshape(-1, 4)]
    if node.flag("beginCap", True):
        groups.append(index[:1, :ring])
    if node.flag("endCap", True):
        groups.append(index[-1:, :ring][:, ::-1])
    return groups
