# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for Webots' roads without a file: the surface and its sidewalks, without lines, barriers and tilt.

Fields, defaults and way points are those of the PROTO files in projects/objects/road/protos (R2021c to R2025b). A Road
is straight between its way points, where Webots interpolates with B-splines.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import FileFormatError
from warpvis.webots._nodes import Node, new_node
from warpvis.webots.protos._appearances import field_appearance
from warpvis.webots.protos._standins import in_axes, numbers, shape_at, solid_of

_Points = NDArray[np.float64]
_MAX_SUBDIVISION = 500


def expand_road(node: Node) -> Node | None:
    """Build the stand-in of a road; return None for other types, and for roads without a surface."""
    if node.type not in ROADS:
        return None
    try:
        shapes = ROADS[node.type](node)
    except FileFormatError:
        return None
    return solid_of(node, shapes, "crossroad" if node.type == "Crossroad" else "road") if shapes else None


def _straight(node: Node) -> list[Node]:
    length = node.number("length", 10.0)
    widths = [node.number(f"{end}RoadBorderWidth", 0.8) for end in ("starting", "ending")]
    return _road(node, np.array([(0.0, 0.0, 0.0), (length if length > 0 else 10.0, 0.0, 0.0)]), widths)


def _curved(node: Node) -> list[Node]:
    radius = max(node.number("curvatureRadius", 10.0), node.number("width", 7.0) / 2)
    count = int(np.clip(node.integer("subdivision", 16), 1, _MAX_SUBDIVISION))
    angles = np.linspace(0.0, node.number("totalAngle", 1.5708), count + 1)
    points = np.stack([radius * np.sin(angles), radius * np.cos(angles), np.zeros_like(angles)], axis=1)
    headings = np.stack([np.cos(angles), -np.sin(angles)], axis=1)
    return _road(node, points, node.numbers("roadBorderWidth"), headings)


def _free(node: Node) -> list[Node]:
    points = node.numbers("wayPoints")
    if len(points) < 6 or len(points) % 3:
        return []
    points = points.reshape(-1, 3)
    if not node.version.z_up:
        points = points[:, [2, 0, 1]]  # forward, left, up
    return _road(node, points, node.numbers("roadBorderWidth"))


def _crossroad(node: Node) -> list[Node]:
    points = node.numbers("shape")
    if len(points) < 9 or len(points) % 3:
        return []
    index = [*range(len(points) // 3), -1]
    return [_faces(node, points.reshape(-1, 3), index, field_appearance(node, "appearance", "Asphalt"))]


def _intersection(node: Node) -> list[Node]:
    """Build the square of four roads, and the beginnings of the roads."""
    if node.integer("roadNumber", 4) != 4:
        return []
    half = node.number("roadsWidth", 7.0) / 2
    lengths = node.numbers("startRoadsLength")
    lengths = lengths if len(lengths) else np.array([5.0])
    reach = [half + lengths[min(side, len(lengths) - 1)] * node.flag("startRoads", True) for side in range(4)]
    rectangles = [(-reach[2], reach[0], -half, half), (-half, half, half, reach[1]), (-half, half, -reach[3], -half)]
    shapes = []
    for low_x, high_x, low_y, high_y in rectangles:
        corners = np.array([(low_x, low_y, 0.0), (high_x, low_y, 0.0), (high_x, high_y, 0.0), (low_x, high_y, 0.0)])
        shapes.append(_faces(node, _turned(node, corners), [0, 1, 2, 3, -1], _asphalt(node)))
    return shapes


def _road(
    node: Node, points: _Points, borders: Sequence[float] | _Points, headings: _Points | None = None
) -> list[Node]:
    """Build a road along way points, in axes since R2022a; `borders` are the widths of its sidewalks at the points."""
    steps = np.diff(points[:, :2], axis=0)
    if headings is None:
        steps /= np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-12)
        headings = np.concatenate([steps[:1], (steps[:-1] + steps[1:]) / 2, steps[-1:]])
    left = np.stack([-headings[:, 1], headings[:, 0], np.zeros(len(points))], axis=1)
    left /= np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-12)
    half, height = node.number("width", 7.0) / 2, node.number("roadBorderHeight", 0.15)
    given = borders if len(borders) else (0.8,)
    width = np.array([given[min(i, len(given) - 1)] for i in range(len(points))])[:, None]
    up = np.array([0.0, 0.0, height])
    shapes = [_ribbon(node, [points - half * left, points + half * left], _asphalt(node))]
    pavement = field_appearance(node, "pavementAppearance", "Pavement")
    for side, name in ((1, "leftBorder"), (-1, "rightBorder")):
        if not node.flag(name, True):
            continue
        near, far = points + side * half * left, points + side * (half + width) * left
        profile = [near, near + up, far + up, far]
        shapes.append(_ribbon(node, profile if side > 0 else profile[::-1], pavement))
    return shapes


def _ribbon(node: Node, rows: list[_Points], appearance: Node | None) -> Node:
    """Build the surface between lines from right to left, seen from above; each has the same number of points."""
    count = len(rows[0])
    index: list[int] = []
    for row in range(len(rows) - 1):
        for point in range(count - 1):
            first, second = row * count + point, (row + 1) * count + point
            index += [first, first + 1, second + 1, second, -1]
    return _faces(node, _turned(node, np.concatenate(rows)), index, appearance)


def _faces(node: Node, points: _Points, index: list[int], appearance: Node | None) -> Node:
    coord = new_node(node, "Coordinate", {"point": numbers(points.ravel())})
    face_set = new_node(node, "IndexedFaceSet", {"coord": coord, "coordIndex": numbers(index)})
    return shape_at(node, face_set, appearance=appearance)


def _asphalt(node: Node) -> Node | None:
    return field_appearance(node, "appearance", "Asphalt")


def _turned(node: Node, points: _Points) -> _Points:
    """Convert points to the axes of a node's version."""
    return np.array([in_axes(node, row, "z") for row in points.tolist()])


ROADS: dict[str, Callable[[Node], list[Node]]] = {
    "Crossroad": _crossroad,
    "CurvedRoadSegment": _curved,
    "Road": _free,
    "RoadIntersection": _intersection,
    "StraightRoadSegment": _straight,
}
"""Functions that build the shapes of roads, by PROTO."""
