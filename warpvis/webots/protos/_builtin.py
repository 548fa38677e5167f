# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Built-in replacements of common Webots PROTOs by boxes and planes, for worlds whose PROTO files are not available.

Fields and their defaults are those of Webots' user guide (https://cyberbotics.com/doc/guide, the pages Floors, Tables,
Apartment Structure, Solids, Factory and Cabinet). Positions and dimensions were measured on expanded PROTO files of
R2019a to R2021c (y up) and R2022b to R2025a (z up): boxes agree to 1e-6 m, leaves of doors to 1e-5 m. Handles and knobs
are omitted. Fields are corrected with a warning as in Webots; other lengths that are not positive are errors.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from warpvis.webots._nodes import Node, Version, new_node
from warpvis.webots.protos._appearances import field_appearance, plain_appearance
from warpvis.webots.protos._standins import Vector, box_at, in_axes, numbers, shape_at, solid_of
from warpvis.webots.shapes._geometry import revolve, turned
from warpvis.webots.shapes._polygons import positive, positives, refuse, whole


def expand(node: Node) -> Node | None:
    """Expand an instance of a PROTO in `BUILTIN` to a Solid with its shapes; return None for other types.

    In this module, *along* is the length of a wall or the width of a door, table or cabinet, *across* its thickness or
    depth, and *up* its height. Their axes are y, x and z since R2022a, and x, z and y before, so that the order in a
    field like ``size`` is across, along, up, or along, up, across.
    """
    if node.type not in _EXPANDERS:
        return None
    make, name = _EXPANDERS[node.type]
    solid = solid_of(node, make(node), name)
    if "translation" not in solid.fields and node.type in _LIFTED:
        since, height = _LIFTED[node.type]
        solid.fields["translation"] = numbers(in_axes(node, (0, 0, height if node.version >= since else 0.0), "z"))
    return solid


def _floor(
    node: Node, field: str = "size", default: tuple[float, float] = (10, 10), appearance: Node | None = None
) -> Iterable[Node]:
    """Build one level rectangle that faces up, regardless of texture sizes and subdivisions."""
    plane = new_node(node, "Plane", {"size": numbers(positives(node, field, default))})
    yield shape_at(node, plane, appearance=appearance)


def _rectangle_arena(node: Node) -> Iterable[Node]:
    """Build a floor and four walls around it; the corners belong to the second pair of walls."""
    x, y = positives(node, "floorSize", (1, 1))
    thickness, height = positive(node, "wallThickness", 0.01), positive(node, "wallHeight", 0.1)
    floor, walls = _arena_appearances(node)
    yield from _floor(node, "floorSize", (1, 1), floor)
    longer = x + 2 * thickness
    for sign in (-1, 1):
        wall_x, wall_y = sign * (x + thickness) / 2, sign * (y + thickness) / 2
        yield box_at(node, _level(node, thickness, y, height), _level(node, wall_x, 0, height / 2), walls)
        yield box_at(node, _level(node, longer, thickness, height), _level(node, 0, wall_y, height / 2), walls)


def _circle_arena(node: Node) -> Iterable[Node]:
    """Build a disc up to the middle of the wall, with a corner on x, and a pipe with one on the other level axis.

    `wallThickness` is measured at the pipe's outer corners and the middles of its inner sides.
    """
    radius = positive(node, "radius", 1.0)
    thickness, height = positive(node, "wallThickness", 0.01), positive(node, "wallHeight", 0.1)
    corners = int(_changed(node, "subdivision", whole(node, "subdivision", 48, -1000, 1000), lower=8))
    floor, wall = _arena_appearances(node)
    yield _face_set(node, [(0, 0), (radius + thickness / 2, 0)], corners, 0.25, floor)
    outer = radius + thickness
    inner = outer - abs(outer * np.cos(np.pi / corners) - radius)
    pipe = [(outer, height), (outer, 0.0), (inner, 0.0), (inner, height), (outer, height)]
    yield _face_set(node, pipe, corners, 0.5 if node.version.z_up else 0.0, wall)


def _arena_appearances(node: Node) -> tuple[Node | None, Node | None]:
    """Return the appearances of an arena's floor and walls."""
    floor = field_appearance(node, "floorAppearance", "ChequeredParquetry")
    return floor, field_appearance(node, "wallAppearance", "BrushedAluminium")


def _wall(node: Node) -> Iterable[Node]:
    """Build a box on the ground: 0.2 across, 1 along and 2.4 up by default [m]."""
    along, up, across = _sizes(_with_default_size(node), "size", (1, 2.4, 0.2))
    yield _part(node, (along, up, across), (0, up / 2, 0))


def _solid_box(node: Node) -> Iterable[Node]:
    """Build a box centered on its origin, of size x y z in both conventions."""
    yield box_at(node, positives(_with_default_size(node), "size", (2, 2, 2)))


def _wooden_box(node: Node) -> Iterable[Node]:
    """Build a box centered on its origin, with sides of 0.01 to 3 m."""
    size = positives(node, "size", (0.6, 0.6, 0.6))
    yield box_at(node, [_changed(node, "size", side, 0.01, 3) for side in size])


def _cardboard_box(node: Node) -> Iterable[Node]:
    """Build a hollow box centered on its origin, whose lid rotates by `lidAngle` about its rear edge, at -x.

    Its volume is at most 1 m^3, and its sides are 0.01 to 2.5 m. Before R2023a it is solid, without a lid; its beveled
    edges are omitted, and the box has the size of the mesh between them.
    """
    size = positives(node, "size", (0.6, 0.6, 0.6))
    if not 1e-6 <= size.prod() <= 1:
        _warn(node, f"size {size[0]:g} {size[1]:g} {size[2]:g}", "0.6 0.6 0.6")
        size = np.full(3, 0.6)
    size = np.array([_changed(node, "size", side, 0.01, 2.5) for side in size])
    if node.version < Version(2023, 1):
        yield box_at(node, 0.9966 * size)
        return
    thin, angle = 0.0005, node.number("lidAngle", 0.0)
    x, _, z = size / 2
    for axis in range(3):
        panel = size - 0.0001
        panel[axis] = thin
        for side in (-1, 1):
            place = np.zeros(3)
            place[axis] = side * (size[axis] - thin) / 2
            if (axis, side) != (2, 1):
                yield box_at(node, panel, place)
    lid = box_at(node, [size[0] - 0.0001, size[1] - 0.0001, thin])
    hinge = [x * (np.cos(angle) - 1), 0, z - thin / 2 + x * np.sin(angle)]
    yield new_node(
        node, "Pose", {"translation": numbers(hinge), "rotation": numbers([0, 1, 0, -angle]), "children": [lid]}
    )


def _table(node: Node) -> Iterable[Node]:
    """Build a tray with its top at the table's height, and four feet `feetPadding` inward from its corners."""
    along, up, across = _sizes(node, "size", (1.8, 0.74, 1))
    feet = node.vector("feetSize", (0.1, 0.1))  # along the level axes, in the order of `size`
    _check(node, bool((feet >= 0).all()), "a feetSize that is not negative", f"{feet[0]:g} {feet[1]:g}")
    foot_along, foot_across = feet[::-1] if node.version.z_up else feet
    padding = node.number("feetPadding", 0.0)
    tray = positive(node, "frameThickness", 0.05)
    _check(node, tray < up, "frameThickness below the table's height", f"{tray:g}")
    top, legs = (field_appearance(node, f"{part}Appearance", "VarnishedPine") for part in ("tray", "leg"))
    yield _part(node, (along, tray, across), (0, up - tray / 2, 0), top)
    to_side, to_front = (along - foot_along) / 2 - padding, (across - foot_across) / 2 - padding
    for one in (-to_side, to_side):
        for other in (-to_front, to_front):
            if feet.all():
                yield _part(node, (foot_along, up - tray, foot_across), (one, (up - tray) / 2, other), legs)


def _door(node: Node) -> Iterable[Node]:
    """Build a wall above `frameHeight`, a frame below it, and in front the closed leaf, regardless of `position`.

    The frame's posts and lintel are `frameSize` wide and high, and protrude from the wall by `frameSize` across on both
    sides. The leaf covers half of each post and of the lintel; its handle is omitted.
    """
    along, up, across = _sizes(node, "size", (1, 2.4, 0.2))
    post, lintel, out = _sizes(node, "frameSize", (0.05, 0.05, 0.05))
    height = _changed(node, "frameHeight", positive(node, "frameHeight", 2.0), upper=up)
    leaf = positive(node, "doorThickness", 0.05)
    _check(node, 2 * post < along and lintel < height, "a frame with an opening", f"frameSize {post:g} {lintel:g}")
    wall, frame = _wall_appearances(node)
    if height < up:
        yield _part(node, (along, up - height, across), (0, (up + height) / 2, 0), wall)
    yield from _frame(node, (along, height, across + 2 * out), (post, lintel), 0.0, frame)
    before = across / 2 + out + leaf / 2 + 0.001
    door = field_appearance(node, "doorAppearance", "GenericDoorAppearance")
    yield _part(node, (along - post, height - lintel / 2, leaf), (0, height / 2, before), door)


def _wall_appearances(node: Node) -> tuple[Node | None, Node | None]:
    """Return the appearances of the wall and the frame of a door or window."""
    return field_appearance(node, "wallAppearance", "Roughcast"), field_appearance(
        node, "frameAppearance", "VarnishedPine"
    )


def _window(node: Node) -> Iterable[Node]:
    """Build walls below and above a pane, a frame around it, and a sill on the lower wall.

    The frame protrudes from the wall by `frameSize` across on both sides, and the sill further by the first number of
    `windowSillSize`; the second is its height, and the frame's lower bar is on top of it. Inconsistent sizes are all
    replaced by the defaults; in Webots since R2022a, also if the wall is not thicker than twice `frameSize` across.
    """
    usual = (0.8, 2.4, 0.2), (0.05, 0.05, 0.02) if not node.version.z_up else (0.02, 0.05, 0.05)
    size, frame = _sizes(node, "size", usual[0]), _sizes(node, "frameSize", usual[1])
    below, height = node.number("bottomWallHeight", 0.7), positive(node, "windowHeight", 1.4)
    _check(node, below >= 0, "a bottomWallHeight [m] that is not negative", f"{below:g}")
    pane = positive(node, "windowThickness", 0.05)
    sill_out, sill = node.vector("windowSillSize", (0.1, 0.05))
    _check(node, min(sill_out, sill) >= 0, "a windowSillSize [m] that is not negative", f"{sill_out:g} {sill:g}")
    side = 2 if node.version.z_up else 0
    if height <= 2 * frame[1] or below + height > size[1] * (1 + 1e-9) or size[side] <= 2 * frame[side]:
        _warn(node, "inconsistent sizes", "the defaults")
        (size, frame), below, height = usual, 0.7, 1.4
    (along, up, across), (post, bar, out) = size, frame
    _check(node, 2 * post < along, "a frame with an opening", f"frameSize {post:g} along")
    over, deep = up - below - height, across + 2 * out
    wall, wood = _wall_appearances(node)
    glass = plain_appearance(node, (0.8, 0.85, 0.85), transparency=0.7)
    if below > 0:
        yield _part(node, (along, below, across), (0, below / 2, 0), wall)
    if over > 1e-9 * up:
        yield _part(node, (along, over, across), (0, up - over / 2, 0), wall)
    yield _part(node, (along - 2 * post, height - 2 * bar, pane), (0, below + height / 2, 0), glass)
    if sill_out > 0 and sill > 0:
        yield _part(node, (along, sill, deep + 2 * sill_out), (0, below + sill / 2, 0), wood)
    yield _part(node, (along - 2 * post, bar, deep), (0, below + sill + bar / 2, 0), wood)
    yield from _frame(node, (along, height, deep), (post, bar), below, wood)


_LAYOUT = (
    *("RightSidedDoor (1, 4, 1, 2)", "LeftSidedDoor (2, 4, 2, 2)", "Drawer (3, 3, 1, 1)", "Drawer (2, 2, 1, 1)"),
    *("Drawer (3, 2, 1, 1)", "Drawer (1, 1, 3, 1)", "Shelf (1, 5, 3, 0)", "Shelf (1, 4, 3, 0)", "Shelf (1, 3, 3, 0)"),
    *("Shelf (1, 2, 3, 0)", "Shelf (1, 3, 0, 1)", "Shelf (2, 3, 0, 1)"),
)
_ITEM = re.compile(
    r"[\s,()]*(RightSidedDoor|LeftSidedDoor|Drawer|Shelf)" + r"[\s,()]+(\d{1,6})" * 4 + r"(?:[\s,()].*)?"
)


def _cabinet(node: Node) -> Iterable[Node]:
    """Build back, sides, bottom and top, of `outerThickness`, around rows and columns, and the items of `layout`.

    The origin is at the bottom center of the back. Doors and drawers are closed and `innerThickness` thick; their
    handles are omitted. Rows and columns are at least three times as high and wide as that.
    """
    inner, outer = positive(node, "innerThickness", 0.02), positive(node, "outerThickness", 0.03)
    if 2 * outer <= inner:
        outer = _changed(node, "outerThickness", outer, lower=0.51 * inner)
    depth = _changed(node, "depth", positive(node, "depth", 0.5), lower=2 * outer + 3 * inner)
    cells = []
    for field, default in (("columnsWidths", (0.4, 0.17, 0.17)), ("rowsHeights", (0.24, 0.2, 0.2, 0.4, 0.4))):
        cells.append(np.array([_changed(node, field, length, 3 * inner) for length in _lengths(node, field, default)]))
    inside, height = cells[0].sum(), cells[1].sum()
    width, middle = inside + 2 * outer, (depth + outer) / 2
    yield _part(node, (width, height, outer), (0, outer + height / 2, outer / 2))
    for sign in (-1, 1):
        yield _part(node, (outer, height, depth - outer), (sign * (inside + outer) / 2, outer + height / 2, middle))
    for bottom in (0.0, height + outer):
        yield _part(node, (width, outer, depth), (0, bottom + outer / 2, depth / 2))
    counts = np.array([len(lengths) for lengths in cells])
    for line in node.texts("layout") if "layout" in node.fields else _LAYOUT:
        item = _ITEM.fullmatch(line)
        numbers = [int(number) for number in item.groups()[1:]] if item else [0, 0, 0, 0]
        first, count = np.array(numbers[:2]) - 1, np.array(numbers[2:])
        fits = ((first >= 0) & (first < counts) & (first + count <= counts)).all()
        if item is None or not fits or (item[1] != "Shelf" and not count.all()):
            _warn(node, f"layout {line!r}", "nothing")
            continue
        first[0] += item[1] == "Shelf" and count[0] == 0  # the shelf is at the right of its column
        low, high = (np.array([cells[i][: end[i]].sum() for i in (0, 1)]) for end in (first, first + count))
        place = (low + high) / 2 + (-inside / 2, outer)  # along and up
        if item[1] == "Shelf":
            offset = 0.0001 if count[0] < count[1] else 0.0
            size = (*(inner + high - low), 0.995 * (depth - outer - inner))
            yield _part(node, size, (*(place + offset), (depth + outer - inner) / 2 + offset))
        else:
            yield _part(
                node, (*(0.995 * (high - low)), inner), (*place, depth - inner / 2)
            )  # a closed door, or a front
            if item[1] == "Drawer":
                yield from _drawer(node, 0.995 * (high - low), place, depth, 0.995 * (depth - outer), inner)


def _drawer(node: Node, size: Vector, place: Vector, depth: float, deep: float, thick: float) -> Iterable[Node]:
    """Build back, bottom and sides of a drawer."""
    (along, up), (center, height), middle = size, place, depth - deep / 2
    yield _part(node, (along - thick, up - thick, thick), (center, height, depth - deep + thick / 2))
    yield _part(node, (along - thick, thick, deep - 2 * thick), (center, height - up / 2 + thick, middle))
    for sign in (-1, 1):
        side = center + sign * (along / 2 - thick)
        yield _part(node, (thick, up - 2 * thick, deep - 2 * thick), (side, height + thick / 2, middle))


def _frame(node: Node, size: Vector, bars: Vector, bottom: float, appearance: Node | None) -> Iterable[Node]:
    """Build two posts and a lintel between them at the top, of a total size along, up, across."""
    along, up, across = size
    post, bar = bars
    for sign in (-1, 1):
        yield _part(node, (post, up, across), (sign * (along - post) / 2, bottom + up / 2, 0), appearance)
    yield _part(node, (along - 2 * post, bar, across), (0, bottom + up - bar / 2, 0), appearance)


def _changed(node: Node, field: str, value: float, lower: float = 0.0, upper: float = np.inf) -> float:
    """Clip a field's value as Webots does, with a warning."""
    clipped = min(max(value, lower), upper)
    if clipped != value:
        _warn(node, f"{field} {value:g}", f"{clipped:g}")
    return clipped


def _with_default_size(node: Node) -> Node:
    """Remove a `size` that is not positive, for which Webots' file uses the default."""
    size = node.numbers("size")
    if (size > 0).all():
        return node
    _warn(node, f"size {' '.join(f'{side:g}' for side in size)}", "the default size")
    return new_node(node, node.type, {name: value for name, value in node.fields.items() if name != "size"}, node.name)


def _warn(node: Node, original: str, replacement: str) -> None:
    message = f"{node.place}: instead of {original} of {node.type}, Webots uses {replacement}"
    warnings.warn(message, stacklevel=2)


def _sizes(node: Node, field: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
    """Read a field's lengths along, up and across."""
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


def _check(node: Node, right: bool, expected: str, got: str) -> None:
    if not right:
        refuse(node, expected, got)


def _level(node: Node, first: float, second: float, up: float) -> tuple[float, float, float]:
    """Convert lengths along x, the other level axis and up to a vector x y z, in both conventions."""
    return (first, second, up) if node.version.z_up else (first, up, second)


def _part(node: Node, size: Vector, place: Vector, appearance: Node | None = None) -> Node:
    """Build a box from its size and center, both along, up, across."""
    sides, center = (in_axes(node, (across, along, up), "z") for along, up, across in (size, place))
    return box_at(node, sides, center, appearance)


def _face_set(
    node: Node, profile: Sequence[tuple[float, float]], corners: int, revolutions: float, appearance: Node | None
) -> Node:
    """Build a surface of revolution about the upright axis, rotated about it."""
    triangles = revolve(profile, [True] * (len(profile) - 1), corners)
    assert triangles is not None
    x, y, z = triangles[0].T
    c, s = np.cos(2 * np.pi * revolutions), np.sin(2 * np.pi * revolutions)
    vertices = np.stack([c * x - s * y, s * x + c * y, z], axis=1)
    points = vertices if node.version.z_up else turned(vertices)
    coord = new_node(node, "Coordinate", {"point": numbers(points.ravel())})
    index = np.pad(triangles[1], ((0, 0), (0, 1)), constant_values=-1)
    face_set = new_node(node, "IndexedFaceSet", {"coord": coord, "coordIndex": numbers(index.ravel())})
    return shape_at(node, face_set, appearance=appearance)


_EXPANDERS: dict[str, tuple[Callable[[Node], Iterable[Node]], str]] = {
    "Cabinet": (_cabinet, "cabinet"),
    "CardboardBox": (_cardboard_box, "cardboard box"),
    "CircleArena": (_circle_arena, "circle arena"),
    "Door": (_door, "door"),
    "Floor": (_floor, "floor"),
    "RectangleArena": (_rectangle_arena, "rectangle arena"),
    "SolidBox": (_solid_box, "box"),
    "Table": (_table, "table"),
    "Wall": (_wall, "wall"),
    "Window": (_window, "window"),
    "WoodenBox": (_wooden_box, "wooden box"),
}
"""Functions that build the shapes, and default names, by PROTO."""

_LIFTED = {
    "CardboardBox": (Version(0, 0), 0.3),
    "SolidBox": (Version(2023, 2), 1.0),
    "WoodenBox": (Version(0, 0), 0.3),
}
"""Heights of default translations [m], and the first releases with them."""

BUILTIN: frozenset[str] = frozenset(_EXPANDERS)
"""PROTOs that `expand` expands."""
