# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The best-known PROTOs of Webots as boxes and planes of our own, for worlds whose PROTO files are not at hand.

Fields, their defaults and their meaning are those of Webots' user guide (https://cyberbotics.com/doc/guide, the pages
Floors, Tables, Apartment Structure, Solids, Factory and Cabinet), in its editions for both conventions of axes. What
the guide does not say is marked "assumed".
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.webots.geometry import revolve, turned
from warpvis.webots.nodes import Node, Value
from warpvis.webots.polygons import positive, positives, refuse, whole

Vector: TypeAlias = Sequence[float] | NDArray[np.float64]

_KEPT = ("translation", "rotation", "recognitionColors")


def expand(node: Node) -> Node | None:
    """A Solid that stands for an instance of a PROTO; None for PROTOs that are not in `BUILTIN`.

    Lengths in comments and names here: *along* is the length of a wall or the width of a door, a table or a cabinet,
    *across* its thickness or depth, and *up*. These are the axes y, x and z since R2022a, and x, z and y before, so
    that a field like ``size`` has them in the order across, along, up, or along, up, across.

    Returns:
        A node of type Solid with the instance's DEF name, translation, rotation and name, and its shapes as children.

    Raises:
        FileFormatError: Its sizes do not make one.
    """
    if node.type not in _EXPANDERS:
        return None
    make, name = _EXPANDERS[node.type]
    fields: dict[str, Value] = {field: node.fields[field] for field in _KEPT if field in node.fields}
    if "translation" not in fields and node.type in _LIFTED:
        fields["translation"] = _list(_space(node, 0, 0, _LIFTED[node.type][node.version.z_up]))
    fields["name"] = [node.text("name", name)]
    fields["children"] = list(make(node))
    return _node(node, "Solid", fields, name=node.name)


def _floor(node: Node, field: str = "size", default: tuple[float, float] = (10, 10)) -> Iterable[Node]:
    """One level rectangle that faces up; texture sizes and subdivisions do not change it."""
    yield _shape(node, "Plane", {"size": _list(positives(node, field, default))})


def _rectangle_arena(node: Node) -> Iterable[Node]:
    """A floor and four walls around it; their corners belong to the second pair (assumed: it does not show)."""
    x, y = positives(node, "floorSize", (1, 1))
    thickness, height = positive(node, "wallThickness", 0.01), positive(node, "wallHeight", 0.1)
    yield from _floor(node, "floorSize", (1, 1))
    longer = x + 2 * thickness
    for sign in (-1, 1):
        at_x, at_y = sign * (x + thickness) / 2, sign * (y + thickness) / 2
        yield _box(node, _level(node, thickness, y, height), _level(node, at_x, 0, height / 2))
        yield _box(node, _level(node, longer, thickness, height), _level(node, 0, at_y, height / 2))


def _circle_arena(node: Node) -> Iterable[Node]:
    """A disc and a pipe around it. Assumed: corners as of a Cylinder, and a floor up to the middle of the wall."""
    radius = positive(node, "radius", 1.0)
    thickness, height = positive(node, "wallThickness", 0.01), positive(node, "wallHeight", 0.1)
    corners = whole(node, "subdivision", 48, 3, 1000)
    yield _face_set(node, [(0, 0), (radius + thickness / 2, 0)], corners)
    outer, inner = radius + thickness, radius
    pipe = [(outer, height), (outer, 0.0), (inner, 0.0), (inner, height), (outer, height)]
    yield _face_set(node, pipe, corners)


def _wall(node: Node) -> Iterable[Node]:
    """A box that stands on the ground: 0.2 across, 1 along and 2.4 up by default."""
    along, up, across = _sizes(node, "size", (1, 2.4, 0.2))
    yield _part(node, (along, up, across), (0, up / 2, 0))


def _solid_box(node: Node) -> Iterable[Node]:
    """A box about its origin, of size x y z in both conventions."""
    yield _box(node, positives(node, "size", (2, 2, 2)), (0, 0, 0))


def _small_box(node: Node) -> Iterable[Node]:
    """A closed box about its origin: the guide's default translation lifts it by half its height."""
    yield _box(node, positives(node, "size", (0.6, 0.6, 0.6)), (0, 0, 0))


def _table(node: Node) -> Iterable[Node]:
    """A tray with its upper side at the table's height, and four feet under its corners, `feetPadding` further in."""
    along, up, across = _sizes(node, "size", (1.8, 0.74, 1))
    feet = positives(node, "feetSize", (0.1, 0.1))  # along the level axes, in the order of `size`
    foot_along, foot_across = feet[::-1] if node.version.z_up else feet
    padding = node.number("feetPadding", 0.0)
    tray = positive(node, "frameThickness", 0.05)
    _check(node, tray < up, "frameThickness below the table's height", f"{tray:g}")
    yield _part(node, (along, tray, across), (0, up - tray / 2, 0))
    to_side, to_front = (along - foot_along) / 2 - padding, (across - foot_across) / 2 - padding
    for one in (-to_side, to_side):
        for other in (-to_front, to_front):
            yield _part(node, (foot_along, up - tray, foot_across), (one, (up - tray) / 2, other))


def _door(node: Node) -> Iterable[Node]:
    """A wall with an opening from the ground to `frameHeight`, a frame within it, and the closed leaf in the middle.

    The frame's posts and its lintel are `frameSize` wide and high. Assumed: it sticks out of the wall by `frameSize`
    across on both sides; the leaf is closed, whatever its `position`, and fills the frame; handles are left out.
    """
    along, up, across = _sizes(node, "size", (1, 2.4, 0.2))
    frame, lintel, out = _sizes(node, "frameSize", (0.05, 0.05, 0.05))
    height, leaf = positive(node, "frameHeight", 2.0), positive(node, "doorThickness", 0.05)
    _check(node, height <= up, "frameHeight at most the door's height", f"{height:g}")
    _check(node, 2 * frame < along and lintel < height, "a frame with an opening", f"frameSize {frame:g} {lintel:g}")
    if height < up:
        yield _part(node, (along, up - height, across), (0, (up + height) / 2, 0))
    yield from _frame(node, (along, height, across + 2 * out), (frame, lintel), 0.0, sill=False)
    yield _part(node, (along - 2 * frame, height - lintel, leaf), (0, (height - lintel) / 2, 0))


def _window(node: Node) -> Iterable[Node]:
    """Walls below and above an open window, and a frame in it.

    Assumed: the frame sticks out of the wall by `frameSize` across on both sides, and nothing is within it; the sill is
    left out, for the guide does not say on which side it is.
    """
    along, up, across = _sizes(node, "size", (0.8, 2.4, 0.2))
    frame, bar, out = _sizes(node, "frameSize", (0.05, 0.05, 0.02))
    below, height = positive(node, "bottomWallHeight", 0.7), positive(node, "windowHeight", 1.4)
    over = up - below - height
    _check(node, over > -1e-9 * up, "bottomWallHeight and windowHeight within the height", f"{below:g} and {height:g}")
    _check(node, 2 * frame < along and 2 * bar < height, "a frame with an opening", f"frameSize {frame:g} {bar:g}")
    yield _part(node, (along, below, across), (0, below / 2, 0))
    if over > 1e-9 * up:
        yield _part(node, (along, over, across), (0, up - over / 2, 0))
    yield from _frame(node, (along, height, across + 2 * out), (frame, bar), below, sill=True)


def _cabinet(node: Node) -> Iterable[Node]:
    """The outer panels of a cabinet: back, sides, bottom and top, of `outerThickness`, around rows and columns.

    Its origin is at the middle of its back, at the bottom: so do worlds place it against walls. Assumed: `depth` is the
    whole depth. What `layout` puts into it, doors among them, is left out, so it is open.
    """
    depth, panel = positive(node, "depth", 0.5), positive(node, "outerThickness", 0.03)
    rows = _lengths(node, "rowsHeights", (0.24, 0.2, 0.2, 0.4, 0.4))
    columns = _lengths(node, "columnsWidths", (0.4, 0.17, 0.17))
    _check(node, panel < depth, "outerThickness below the depth", f"{panel:g}")
    inside, height = columns.sum(), rows.sum() + 2 * panel
    width = inside + 2 * panel
    yield _part(node, (width, height, panel), (0, height / 2, panel / 2))
    middle, front = (depth + panel) / 2, depth - panel
    for sign in (-1, 1):
        yield _part(node, (panel, height, front), (sign * (inside + panel) / 2, height / 2, middle))
    for bottom in (0.0, height - panel):
        yield _part(node, (inside, panel, front), (0, bottom + panel / 2, middle))


def _frame(node: Node, size: Vector, bars: Vector, bottom: float, *, sill: bool) -> Iterable[Node]:
    """Two posts and, between them, a lintel and if wanted a bar below, within a size along, up, across."""
    along, up, across = size
    post, bar = bars
    for sign in (-1, 1):
        yield _part(node, (post, up, across), (sign * (along - post) / 2, bottom + up / 2, 0))
    for height in [up - bar / 2] + [bar / 2] * sill:
        yield _part(node, (along - 2 * post, bar, across), (0, bottom + height, 0))


def _sizes(node: Node, field: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
    """A field's lengths along, up and across."""
    along, up, across = default
    if not node.version.z_up:
        along, up, across = positives(node, field, default)
    else:
        across, along, up = positives(node, field, (across, along, up))
    return float(along), float(up), float(across)


def _lengths(node: Node, field: str, default: tuple[float, ...]) -> NDArray[np.float64]:
    count = len(node.numbers(field)) if field in node.fields else len(default)
    if not count:
        refuse(node, f"at least one number in {field}", "none")
    return positives(node, field, default if field not in node.fields else (0.0,) * count)


def _check(node: Node, right: bool, wanted: str, got: str) -> None:
    if not right:
        refuse(node, wanted, got)


def _space(node: Node, along: float, across: float, up: float) -> tuple[float, float, float]:
    """A vector x y z."""
    return (across, along, up) if node.version.z_up else (along, up, across)


def _level(node: Node, first: float, second: float, up: float) -> tuple[float, float, float]:
    """A vector x y z; floors give x and the other level axis, y or z, in both conventions."""
    return (first, second, up) if node.version.z_up else (first, up, second)


def _part(node: Node, size: Vector, place: Vector) -> Node:
    """A box of a size along, up, across about such a place."""
    return _box(node, *(_space(node, along, across, up) for along, up, across in (size, place)))


def _box(node: Node, size: Vector, place: Vector) -> Node:
    """A box of a size x y z about a place."""
    shape = _shape(node, "Box", {"size": _list(size)})
    if not np.any(place):
        return shape
    return _node(node, "Pose", {"translation": _list(place), "children": [shape]})


def _face_set(node: Node, profile: Sequence[tuple[float, float]], corners: int) -> Node:
    """A surface of revolution about the upright axis."""
    triangles = revolve(profile, [True] * (len(profile) - 1), corners)
    assert triangles is not None
    vertices, faces = triangles
    points = vertices if node.version.z_up else turned(vertices)
    coord = _node(node, "Coordinate", {"point": _list(points.ravel())})
    index = np.concatenate([faces, np.full((len(faces), 1), -1)], axis=1)
    return _shape(node, "IndexedFaceSet", {"coord": coord, "coordIndex": _list(index.ravel())})


def _shape(node: Node, geometry: str, fields: dict[str, Value]) -> Node:
    return _node(node, "Shape", {"geometry": _node(node, geometry, fields)})


def _list(numbers: Vector | NDArray) -> list[float | str | bool | Node]:
    return [float(number) for number in numbers]


def _node(of: Node, kind: str, fields: dict[str, Value], name: str | None = None) -> Node:
    """A node at the place of another in the file."""
    parts = [
        part
        for value in fields.values()
        for part in ([value] if isinstance(value, Node) else value or ())
        if isinstance(part, Node)
    ]
    size, height = 1 + sum(part.size for part in parts), 1 + max((part.height for part in parts), default=0)
    return Node(kind, fields, name, of.file, of.line, of.version, protos=of.protos, size=size, height=height)


_EXPANDERS: dict[str, tuple[Callable[[Node], Iterable[Node]], str]] = {
    "Cabinet": (_cabinet, "cabinet"),
    "CardboardBox": (_small_box, "cardboard box"),
    "CircleArena": (_circle_arena, "circle arena"),
    "Door": (_door, "door"),
    "Floor": (_floor, "floor"),
    "RectangleArena": (_rectangle_arena, "rectangle arena"),
    "SolidBox": (_solid_box, "box"),
    "Table": (_table, "table"),
    "Wall": (_wall, "wall"),
    "Window": (_window, "window"),
    "WoodenBox": (_small_box, "wooden box"),
}
"""For each PROTO, what makes its shapes, and its default name."""

_LIFTED = {"CardboardBox": (0.3, 0.3), "SolidBox": (0.0, 1.0), "WoodenBox": (0.3, 0.3)}
"""How far default translations lift [m]: before R2022a, and since."""

BUILTIN: frozenset[str] = frozenset(_EXPANDERS)
"""PROTOs that `expand` knows."""
