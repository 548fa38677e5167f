# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptions of rooms in JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from warpvis.core.checks import check_mapping, check_number, describe_exception
from warpvis.core.types import Json
from warpvis.errors import SceneError, WarpvisError
from warpvis.situations.rooms._items import RoomItem, RoomLight
from warpvis.situations.rooms._outline import Opening, Outline
from warpvis.situations.rooms.shapes import CATEGORIES, COLORS
from warpvis.situations.rooms.shapes._colors import MATERIALS

FORMAT = 1
"""Version of the description."""

_OPENING = ("kind", "name", "wall", "start", "width", "low", "high", "is_open")
_ITEM = ("name", "category", "color", "support", "level")


def describe(
    facts: Mapping[str, Json], outline: Outline, items: Sequence[RoomItem], lamps: Sequence[RoomLight]
) -> dict[str, Json]:
    """Return the description of a room."""
    return {
        "format": FORMAT,
        **facts,
        "floor": [list(corner) for corner in outline.floor],
        "height": outline.height,
        "thickness": outline.thickness,
        "openings": [{name: getattr(opening, name) for name in _OPENING} for opening in outline.openings],
        "lamps": [{"position": list(lamp.position), "color": list(lamp.color)} for lamp in lamps],
        "items": [
            {
                **{name: getattr(item, name) for name in _ITEM},
                "parameters": dict(item.parameters),
                "pose": list(item.pose),
                "size": list(item.size),
                "movable": item.movable,
            }
            for item in items
        ],
    }


def restore(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of `Room` from its description; raise a `SceneError` if it is invalid."""
    check_mapping(data, "a description of a room", SceneError)
    if data.get("format") != FORMAT:
        raise SceneError(f"format of a room must be {FORMAT}, got {data.get('format')!r}")
    try:
        openings = tuple(Opening(**{name: opening[name] for name in _OPENING}) for opening in data["openings"])
        floor = tuple((_number(x, "floor"), _number(y, "floor")) for x, y in data["floor"])
        outline = Outline(floor, _number(data["height"], "height"), _number(data["thickness"], "thickness"), openings)
        _check_outline(outline)
        items = tuple(_item(item) for item in data["items"])
        lamps = tuple(RoomLight(_three(lamp["position"]), _three(lamp["color"])) for lamp in data["lamps"])
        facts = {name: data[name] for name in ("kind", "seed", "wall_color", "floor_material")}
    except WarpvisError:
        raise
    except KeyError as error:
        raise SceneError(f"the description of a room lacks {error}") from None
    except (TypeError, ValueError, AttributeError) as error:
        raise SceneError(f"the description of a room is invalid: {describe_exception(error)}") from None
    for name, words in (("wall_color", {**COLORS, **MATERIALS}), ("floor_material", {**COLORS, **MATERIALS})):
        if facts[name] not in words:
            raise SceneError(f"{name} of a room must be a color or a material of items, got {facts[name]!r}")
    return {**facts, "outline": outline, "items": items, "lamps": lamps}


def _number(value: object, name: str) -> float:
    return check_number(value, f"{name} of a room", minimum=-1000.0, maximum=1000.0, error=SceneError)


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (_number(value, "a lamp") for value in values)
    return x, y, z


def _check_outline(outline: Outline) -> None:
    """Raise a `SceneError` unless the floor is a rectangle or an L, and the openings are in its walls."""
    if len(outline.floor) not in (4, 6) or not outline.height > 0 or not outline.thickness > 0:
        raise SceneError("floor of a room must have 4 or 6 corners, and its height and thickness must be positive")
    corners = outline.floor
    ends = zip(corners, (*corners[1:], corners[0]), strict=True)
    if any((a == c) == (b == d) for (a, b), (c, d) in ends) or not outline.area > 0:
        raise SceneError("floor of a room must be a rectangle or an L, counterclockwise, with edges along x and y")
    for opening in outline.openings:
        length = outline.walls[opening.wall].length
        if not 0 <= opening.start <= opening.start + opening.width <= length or not opening.low < opening.high:
            raise SceneError(f"{opening.kind} {opening.name!r} of a room must be within its wall")


def _item(data: Mapping[str, Any]) -> RoomItem:
    """Return an item from its description."""
    check_mapping(data, "an item of a room", SceneError)
    values = {name: data[name] for name in _ITEM}
    subject = f"item {values['name']!r} of a room"
    if values["category"] not in CATEGORIES:
        raise SceneError(f"category of {subject} must be one of {', '.join(CATEGORIES)}, got {values['category']!r}")
    if values["color"] not in COLORS:
        raise SceneError(f"color of {subject} must be one of {', '.join(COLORS)}, got {values['color']!r}")
    pose = tuple(_number(value, f"pose of {subject}") for value in data["pose"])
    if len(pose) != 7:
        raise SceneError(f"pose of {subject} must be 7 numbers, x y z qx qy qz qw, got {len(pose)}")
    item = RoomItem(**values, pose=pose, parameters=dict(data["parameters"]))
    try:
        item.shape  # noqa: B018
    except (TypeError, ValueError, ArithmeticError, LookupError) as error:
        raise SceneError(f"parameters of {subject} are invalid: {describe_exception(error)}") from None
    return item
