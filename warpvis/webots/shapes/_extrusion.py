# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Triangles of Webots' Extrusion: a cross-section swept along a spine.

The rules are those of VRML97 (ISO/IEC 14772-1, section 6.18), except for Webots' deviations: the spine is a B-spline of
its points (``splineSubdivision``), the cross-section's second axis is reversed, and ``orientation`` rotates about the
axes of the node.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.webots._nodes import Node
from warpvis.webots.shapes._polygons import MAX_POINTS, Points, Triangles, compact, refuse, triangulate, tuples

_SQUARE = ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1))


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
    points = (np.einsum("nij,nkj->nki", _matrices(rotations), offsets) + spine[:, None]).reshape(-1, 3)
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


def _matrices(rotations: Points) -> NDArray[np.float64]:
    """Convert rotations ``x y z angle`` [rad] to matrices, shape ``(n, 3, 3)``; a zero axis gives the identity."""
    axes, angles = rotations[:, :3], rotations[:, 3, None, None]
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    x, y, z = np.divide(axes, lengths, out=np.zeros_like(axes), where=lengths > 0).T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    return np.eye(3) + np.sin(angles) * cross + (1 - np.cos(angles)) * (cross @ cross)


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
