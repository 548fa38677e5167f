# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Objects on supports and on the floor: which ones belong where, and where they fit."""

from __future__ import annotations

from warpvis.situations.rooms._boxes import boxes_overlap, direction, extents_meet
from warpvis.situations.rooms._plan import Placed, Plan
from warpvis.situations.rooms.shapes import Shape
from warpvis.situations.rooms.shapes._builder import Support

Weights = tuple[tuple[str, float], ...]


def _weights(text: str) -> Weights:
    """Return categories with weights from text: ``"plate 3, test tube rack 2"``."""
    pairs = (entry.strip().rsplit(" ", 1) for entry in text.split(","))
    return tuple((name, float(weight)) for name, weight in pairs)


_DINING = _weights(
    "plate 3, mug 3, glass 3, bowl 2, bottle 2, cup 2, teapot 1, vase 1, apple 1, orange 0.6, banana 0.6, "
    "can 1, phone 0.5"
)
_KITCHEN = _weights(
    "pot 2, pan 1, kettle 1.2, toaster 1.2, microwave 0.8, cutting board 1.2, bottle 2, mug 2, bowl 2, plate 1.5, "
    "glass 1.5, apple 1, orange 0.8, banana 0.8, can 1, teapot 0.8, pot plant 0.5"
)
_TABLEWARE = _weights("bottle 2, mug 2, bowl 2, plate 1.5, glass 1.5, vase 0.5, pot plant 0.5")
_DESK = _weights(
    "book 3, mug 3, pen holder 2, paper stack 2.5, phone 1.5, bottle 1, pot plant 1, can 0.7, apple 0.5, "
    "glass 0.7, lamp 0.4"
)
_BOOKS = _weights("books 6, book 1.5, vase 1, pot plant 1")
_SHELF = _BOOKS + _weights(
    "box 0.6, teddy bear 0.4, bowl 0.6, speaker 0.5, ball 0.3, toy car 0.3, basket 0.3, toy blocks 0.3"
)
_RACK = _weights("box 4, toolbox 1.5, bottle 1, can 1, basket 1.5, bucket 1, crate 1, drill 0.5")
_TOOLS = _weights(
    "hammer 2, screwdriver 3, drill 2, toolbox 1.2, can 1.5, bottle 1, mug 1, box 0.8, paper stack 0.5, lamp 0.4"
)
_GLASSWARE = _weights("flask 4, beaker 4, test tube rack 2, bottle 2")
_LAB = _GLASSWARE + _weights(
    "microscope 1.5, centrifuge 0.7, laptop 0.6, paper stack 1, box 0.6, pen holder 0.5, book 1"
)
_DECOR = _weights(
    "vase 2, pot plant 2, book 2, lamp 1, bowl 1, speaker 1, mug 1, teddy bear 0.5, toy car 0.5, books 1, phone 0.5"
)
_TOPS = _weights("box 3, books 1, printer 1.5, pot plant 1.5, paper stack 1, basket 1, vase 0.5")
_SOFT = _weights("cushion 5, book 1, teddy bear 1, laptop 0.3, phone 0.5")
_PLAY = _weights(
    "ball 2, teddy bear 1.5, toy car 1.5, toy blocks 1.5, basket 1, box 1, suitcase 0.5, crate 0.3, step ladder 0.1"
)

_THEMES: dict[str, tuple[Weights, float]] = {
    "table": (_DINING, 6),
    "round table": (_DINING, 6),
    "coffee table": (_DINING + _DECOR, 5),
    "side table": (_DECOR, 6),
    "desk": (_DESK, 4.5),
    "workbench": (_TOOLS, 5),
    "lab bench": (_LAB, 6),
    "counter": (_KITCHEN, 5),
    "kitchen island": (_KITCHEN, 4),
    "stove": (_weights("pot 3, pan 2, kettle 1"), 6),
    "bookcase": (_SHELF, 9),
    "shelf": (_RACK, 5),
    "wall shelf": (_SHELF, 9),
    "cabinet": (_DECOR, 4.5),
    "dresser": (_DECOR, 4.5),
    "nightstand": (_DECOR + _DESK, 9),
    "filing cabinet": (_TOPS, 4),
    "tool cabinet": (_TOOLS, 5),
    "fridge": (_TOPS, 3),
    "sofa": (_SOFT, 1.8),
    "armchair": (_SOFT, 2),
    "bed": (_SOFT, 0.8),
    "crate": (_TOOLS, 4),
    "box": (_weights("book 2, box 1"), 2),
}
"""By category of the supporting item: objects with weights, and objects per square meter at a clutter of 0.5."""

_BY_KIND: dict[str, dict[str, Weights]] = {
    "office": {"table": _DESK, "round table": _DESK, "cabinet": _TOPS, "bookcase": _BOOKS, "wall shelf": _BOOKS},
    "workshop": {"table": _TOOLS, "desk": _DESK + _TOOLS, "cabinet": _TOOLS, "wall shelf": _TOOLS},
    "lab": {
        "cabinet": _TOPS,
        "shelf": _RACK + _LAB,
        "fridge": _weights("box 1"),
        "wall shelf": _GLASSWARE,
        "desk": _DESK + _GLASSWARE,
    },
    "kitchen": {
        "cabinet": _KITCHEN,
        "shelf": _KITCHEN,
        "wall shelf": _TABLEWARE,
        "fridge": _weights("box 1, basket 1, bowl 1"),
    },
}
"""By kind of the room: objects on some supports, where they differ."""

_FLOOR: dict[str, Weights] = {
    "living room": _PLAY,
    "bedroom": _PLAY,
    "office": _weights("box 3, suitcase 0.6, trash bin 1, ball 0.3"),
    "kitchen": _weights("basket 1, bucket 1, box 1, ball 0.5, toy car 0.5"),
    "workshop": _weights("box 3, crate 2, bucket 1.5, toolbox 1, trash bin 1"),
    "lab": _weights("box 3, trash bin 1, crate 0.5"),
}

# Objects that face the front of their support, such as books in a shelf.
_FACING = frozenset(
    ("books", "speaker", "microscope", "laptop", "toaster", "microwave", "printer", "centrifuge", "teddy bear")
)
_TRIES = 5


def add_objects(plan: Plan, kind: str) -> None:
    """Place objects on all supports and on the floor; their number grows with the clutter, from 0 to 1."""
    draws = plan.draws
    themes = _BY_KIND.get(kind, {})
    for item in list(plan.items):
        found = _THEMES.get(item.shape.category)
        if found is None or plan.clutter == 0:
            continue
        weights, density = themes.get(item.shape.category, found[0]), found[1]
        for level in item.shape.supports:
            area = 4 * level.half[0] * level.half[1]
            expected = 2 * plan.clutter * density * area * draws.uniform(0.4, 1.6)
            for _ in range(min(int(expected + draws.unit()), 12)):
                add_on_support(plan, item, level, draws.weighted(weights))
    floor = _FLOOR[kind]
    for _ in range(int(plan.clutter * plan.outline.area * draws.uniform(0.15, 0.5) + draws.unit())):
        plan.on_floor(plan.shape(draws.weighted(floor)), tries=4)


def add_on_support(plan: Plan, item: Placed, level: Support, category: str) -> Placed | None:
    """Place an object of a category on a rectangle of an item; return None if there is no space."""
    draws = plan.draws
    shape = plan.shape(category)
    if shape.size[2] > level.clearance - 0.005:
        return None
    yaw = item.yaw + (draws.uniform(-8, 8) if category in _FACING else draws.uniform(0, 360))
    for _ in range(_TRIES):
        spot = spot_on_support(plan, item, level, shape, yaw)
        if spot is not None:
            color = plan.color(category)
            placed = Placed(shape, color, *spot, round(item.z + level.z, 6), round(yaw % 360, 1), item, level.name)
            if is_free(plan, placed, item):
                return plan.add(placed)
    return None


def spot_on_support(plan: Plan, item: Placed, level: Support, shape: Shape, yaw: float) -> tuple[float, float] | None:
    """Draw a position on a support such that a shape does not overhang; None if it is too large."""
    c, s = direction(yaw - item.yaw)
    (x0, y0, _), (x1, y1, _) = shape.bounds
    corners = [(c * x - s * y, s * x + c * y) for x in (x0, x1) for y in (y0, y1)]
    low_x, high_x = -level.half[0] - min(x for x, _ in corners), level.half[0] - max(x for x, _ in corners)
    low_y, high_y = -level.half[1] - min(y for _, y in corners), level.half[1] - max(y for _, y in corners)
    if low_x > high_x or low_y > high_y:
        return None
    x, y = plan.draws.uniform(low_x, high_x), plan.draws.uniform(low_y, high_y)
    return item.point(level.center[0] + x, level.center[1] + y)


def is_free(plan: Plan, placed: Placed, support: Placed) -> bool:
    """Return whether an object overlaps no other item, apart from touching its support from above."""
    if not all(plan.outline.contains_box(box) for box in placed.boxes):
        return False
    x0, y0, z0, x1, y1, z1 = placed.extent
    extent = (x0 - 0.004, y0 - 0.004, z0, x1 + 0.004, y1 + 0.004, z1)
    for other in plan.items:
        if extents_meet(extent, other.extent) and any(boxes_overlap(a, b) for a in placed.boxes for b in other.boxes):
            return False
    if support.shape.category == "round table":
        radius = support.shape.size[0] / 2
        return all(
            ((x - support.x) ** 2 + (y - support.y) ** 2) ** 0.5 <= radius
            for box in placed.boxes
            for x, y in box.corners
        )
    return True
