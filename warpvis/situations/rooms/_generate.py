# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Generate furnished rooms."""

from __future__ import annotations

import math
from collections import Counter

from warpvis.core.checks import as_items, check_choice, check_number, check_whole
from warpvis.errors import SceneError
from warpvis.situations.rooms._draws import Draws
from warpvis.situations.rooms._items import RoomItem, RoomLight
from warpvis.situations.rooms._objects import add_objects
from warpvis.situations.rooms._outline import draw_outline
from warpvis.situations.rooms._plan import Placed, Plan
from warpvis.situations.rooms._room import Room
from warpvis.situations.rooms._rules import RULES

ROOM_KINDS = tuple(RULES)
"""Kinds of rooms."""

_MIN_SIZE, _MAX_SIZE = 2.4, 12.0
_LAMP_SPACING = 3.6


def generate_room(
    seed: int,
    kind: str | None = None,
    size: tuple[float, float] | None = None,
    clutter: float = 0.5,
) -> Room:
    """Generate a furnished room.

    It is the same for the same arguments on every machine. Furniture is placed by rules, and no two items overlap. A
    person of a radius of 0.3 m can walk between all doors.

    Args:
        seed: Any whole number from 0.
        kind: ``"living room"``, ``"office"``, ``"kitchen"``, ``"workshop"``, ``"bedroom"`` or ``"lab"``; drawn by
            default.
        size: Sides of the floor's bounding box along x and y [m], from 2.4 to 12; drawn by default. It is rounded to
            0.1 m.
        clutter: Amount of objects on supports and on the floor, from 0 (none) to 1.

    Returns:
        The room; `Room.build` returns its scene.

    Raises:
        SceneError: If an argument is invalid.
    """
    seed = check_whole(seed, "seed", minimum=0, error=SceneError)
    if kind is not None:
        check_choice(kind, "kind", ROOM_KINDS, SceneError)
    clutter = check_number(clutter, "clutter", minimum=0.0, maximum=1.0, error=SceneError)
    draws = Draws(seed)
    kind = kind or draws.choice(ROOM_KINDS)
    furnish, ranges, windows = RULES[kind]
    drawn = (draws.step(*ranges[0], 0.1), draws.step(*ranges[1], 0.1))
    if size is not None:
        drawn = _check_size(size)
    elif draws.chance(0.5):
        drawn = drawn[::-1]
    plan = Plan(draws, draw_outline(draws, drawn, may_be_l=True, windows=windows), clutter)
    furnish(plan)
    lamps = _add_lamps(plan)
    add_objects(plan, kind)
    wall_color = draws.weighted((("wall", 4), ("white", 3), ("beige", 1), ("paper", 2), ("glass", 1)))
    floor_material = draws.weighted((("oak", 3), ("pine", 2), ("walnut", 1), ("gray", 2)))
    return Room(kind, seed, plan.outline, _name_items(plan.items), tuple(lamps), wall_color, floor_material)


def _check_size(size: object) -> tuple[float, float]:
    """Check the sides of a floor, and round them."""
    numbers = as_items(size, "size", SceneError)
    if len(numbers) != 2:
        raise SceneError(f"size must be two numbers, the sides of the floor along x and y [m], got {size!r}")
    sides = []
    for number in numbers:
        value = check_number(number, "size", error=SceneError)
        if not _MIN_SIZE <= value <= _MAX_SIZE:
            hint = f"; sizes are in meters: did you mean {value / 100:g}?" if 240 <= value <= 1200 else ""
            raise SceneError(f"size must be from {_MIN_SIZE} to {_MAX_SIZE:g} m, got {value:g}{hint}")
        sides.append(round(value, 1))
    return sides[0], sides[1]


def _add_lamps(plan: Plan) -> list[RoomLight]:
    """Add lamps at the ceiling, about one for every 13 square meters."""
    draws, height = plan.draws, plan.outline.height
    shape = plan.shape("ceiling lamp")
    word = plan.color("ceiling lamp")
    warm = draws.choice((0.84, 0.92, 1.0))
    places = []
    for x0, y0, x1, y1 in plan.outline.rectangles:
        columns, rows = math.ceil((x1 - x0) / _LAMP_SPACING), math.ceil((y1 - y0) / _LAMP_SPACING)
        for row in range(rows):
            for column in range(columns):
                x = x0 + (column + 0.5) * (x1 - x0) / columns
                places.append((round(x, 3), round(y0 + (row + 0.5) * (y1 - y0) / rows, 3)))
    lights = []
    brightness = 0.95 / len(places) ** 0.6
    for at in places:
        z = round(height - shape.size[2], 6)
        if plan.put(shape, at, 0.0, z=z, support="ceiling", color=word, gap=0.0) is not None:
            color = (brightness, round(brightness * (1 + warm) / 2, 6), round(brightness * warm, 6))
            lights.append(RoomLight((*at, round(z - 0.2, 6)), (round(brightness, 6), color[1], color[2])))
    return lights


def _name_items(placed: list[Placed]) -> tuple[RoomItem, ...]:
    """Name items by category and number, and describe them."""
    counts: Counter[str] = Counter()
    for item in placed:
        category = item.shape.category
        counts[category] += 1
        item.name = f"{category.replace(' ', '_')}_{counts[category]}"
    found = []
    for item in placed:
        half = math.radians(item.yaw) / 2
        pose = (item.x, item.y, item.z, 0.0, 0.0, round(math.sin(half), 12), round(math.cos(half), 12))
        support = item.support.name if isinstance(item.support, Placed) else item.support or ""
        found.append(
            RoomItem(item.name, item.shape.category, item.color, pose, support, item.level, item.shape.parameters)
        )
    return tuple(found)
