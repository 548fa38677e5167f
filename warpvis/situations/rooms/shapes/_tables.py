# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tables, desks, benches and counters; desks are 0.72 to 0.75 m high (EN 527-1), counters 0.9 m (EN 1116)."""

from __future__ import annotations

from warpvis.situations.rooms.shapes._builder import OUTSIDE, ShapeBuilder
from warpvis.situations.rooms.shapes._colors import DARK, MAIN
from warpvis.situations.rooms.shapes._registry import WOOD, category
from warpvis.situations.rooms.shapes._seating import legs


def _plate_on_legs(
    b: ShapeBuilder, size: tuple[float, float, float], thickness: float, leg: float, material: str, inset: float = 0.04
) -> None:
    x, y, z = size
    legs(b, (x - inset, y - inset), z - thickness, leg, material)
    b.box((x, y, thickness), (0, 0, z - thickness), MAIN, "top")
    b.support((0, 0), (x, y), z)


@category(
    "table",
    {"length": 1.2},
    {"length": 1.4},
    {"length": 1.6, "width": 0.9},
    {"length": 1.8, "width": 0.9},
    {"length": 0.9, "width": 0.9},
)
def table(b: ShapeBuilder, length: float = 1.4, width: float = 0.8) -> None:
    """Build a dining table; its long side is along y."""
    _plate_on_legs(b, (width, length, 0.74), 0.04, 0.06, DARK)


@category("round table", {"diameter": 0.9}, {"diameter": 1.1}, {"diameter": 1.2})
def round_table(b: ShapeBuilder, diameter: float = 1.1) -> None:
    """Build a round table on a column."""
    radius = diameter / 2
    b.cylinder(radius * 0.5, 0.03, (0, 0, 0), "dark metal", "foot", sides=16)
    b.cylinder(0.045, 0.67, (0, 0, 0.03), "dark metal", "column", sides=10)
    b.cylinder(radius, 0.035, (0, 0, 0.705), MAIN, OUTSIDE, sides=24)
    b.disk_part(radius, 0.705, 0.74)
    b.support((0, 0), (radius * 1.36, radius * 1.36), 0.74)


@category("coffee table", {}, {"length": 0.9, "width": 0.6}, {"length": 1.2}, {"length": 0.8, "width": 0.8})
def coffee_table(b: ShapeBuilder, length: float = 1.1, width: float = 0.55) -> None:
    """Build a low table with a shelf below its top."""
    legs(b, (width, length), 0.42 - 0.04, 0.05, DARK, "all")
    b.box((width - 0.06, length - 0.06, 0.02), (0, 0, 0.13), DARK, "all")
    b.box((width, length, 0.04), (0, 0, 0.38), MAIN, "all")
    b.support((0, 0), (width, length), 0.42)


@category("side table", {}, {"diameter": 0.4, "height": 0.55}, movable=True)
def side_table(b: ShapeBuilder, diameter: float = 0.48, height: float = 0.5) -> None:
    """Build a small round table."""
    b.cylinder(diameter * 0.32, 0.02, (0, 0, 0), "dark metal", sides=12)
    b.cylinder(0.022, height - 0.045, (0, 0, 0.02), "dark metal", sides=8)
    b.cylinder(diameter / 2, 0.025, (0, 0, height - 0.025), MAIN, sides=20)
    b.support((0, 0), (diameter * 0.68, diameter * 0.68), height)


@category(
    "desk",
    {"width": 1.2, "depth": 0.7},
    {"width": 1.4},
    {"width": 1.6},
    {"width": 1.4, "drawers": False},
    {"width": 1.6, "drawers": False},
)
def desk(b: ShapeBuilder, width: float = 1.4, depth: float = 0.8, drawers: bool = True) -> None:
    """Build a desk; a person sits at its front, x. Drawers are at its left."""
    for side in (-1, 1):
        y = side * (width / 2 - 0.04)
        b.box((depth - 0.1, 0.05, 0.03), (0, y, 0), "metal", f"foot {side}")
        b.box((0.06, 0.05, 0.68), (-0.12, y, 0.03), "metal", f"foot {side}")
    b.box((0.02, width - 0.14, 0.3), (0.05 - depth / 2, 0, 0.38), MAIN, "panel")
    b.box((depth, width, 0.03), (0, 0, 0.71), MAIN, "top")
    if drawers:
        y = width / 2 - 0.32
        b.box((depth - 0.2, 0.4, 0.6), (-0.01, y, 0.1), DARK, "drawers")
        for number in range(3):
            b.box((0.012, 0.37, 0.18), (depth / 2 - 0.104, y, 0.115 + number * 0.195), MAIN, "drawers")
            b.box((0.015, 0.12, 0.015), (depth / 2 - 0.0905, y, 0.2 + number * 0.195), "metal", "drawers")
        for x in (-0.2, 0.2):
            b.box((0.04, 0.34, 0.1), (x, y, 0), "plastic", "drawers")
    b.support((0, 0), (depth, width), 0.74)


@category("workbench", {"width": 1.5}, {"width": 1.8}, {"width": 2.0}, colors=("brown", "beige", "gray"), access=0.6)
def workbench(b: ShapeBuilder, width: float = 1.8) -> None:
    """Build a workbench with a shelf, a tool board behind it and a clamp."""
    depth, height = 0.7, 0.9
    legs(b, (depth - 0.06, width - 0.06), height - 0.07, 0.09, "pine")
    b.box((depth - 0.1, width - 0.16, 0.03), (-0.02, 0, 0.22), "pine", "shelf")
    b.box((depth, width, 0.07), (0, 0, height - 0.07), MAIN, "top")
    b.box((0.03, width, 0.7), (0.015 - depth / 2, 0, height), "pine", "board")
    for number in range(int(width / 0.25)):
        y = 0.2 - width / 2 + number * 0.25
        b.box((0.02, 0.025, 0.26), (0.04 - depth / 2, y, height + 0.25), ("dark metal", "metal")[number % 2], "tools")
        b.box(
            (0.03, 0.035, 0.12), (0.045 - depth / 2, y, height + 0.45), ("red", "blue", "yellow")[number % 3], "tools"
        )
    b.box((0.14, 0.16, 0.12), (depth / 2 - 0.08, width / 2 - 0.14, height), "blue", "clamp")
    b.box((0.04, 0.16, 0.13), (depth / 2 + 0.04, width / 2 - 0.14, height - 0.01), "dark metal", "clamp")
    b.cylinder(0.015, 0.2, (depth / 2 - 0.03, width / 2 - 0.14, height + 0.05), "metal", "clamp", axis="x", sides=6)
    b.support((0.05, -0.14), (depth - 0.16, width - 0.34), height)
    b.support((-0.02, 0), (depth - 0.14, width - 0.3), 0.25, 0.5, "shelf")


@category("lab bench", {"width": 1.5}, {"width": 1.8}, {"width": 2.4}, colors=("white", "gray", "blue"), access=0.6)
def lab_bench(b: ShapeBuilder, width: float = 1.8, depth: float = 0.75) -> None:
    """Build a laboratory bench with cabinets and a shelf above its top."""
    b.box((depth - 0.1, width - 0.04, 0.1), (-0.05, 0, 0), "plastic", "body")
    b.box((depth - 0.04, width, 0.76), (-0.02, 0, 0.1), MAIN, "body")
    count = round(width / 0.5)
    for number in range(count):
        y = (number + 0.5) * width / count - width / 2
        b.box((0.015, width / count - 0.02, 0.52), (depth / 2 - 0.0325, y, 0.12), "ceramic", "body")
        b.box((0.015, width / count - 0.02, 0.18), (depth / 2 - 0.0325, y, 0.66), "ceramic", "body")
        for z in (0.58, 0.75):
            b.box((0.02, 0.14, 0.012), (depth / 2 - 0.02, y, z), "metal", "body")
    b.box((depth, width, 0.03), (0, 0, 0.86), "plastic", "top")
    for side in (-1, 0, 1):
        b.box((0.04, 0.04, 0.45), (0.1 - depth / 2, side * (width / 2 - 0.04), 0.89), "metal", f"post {side}")
    b.box((0.22, width, 0.025), (0.12 - depth / 2, 0, 1.34), "metal", "shelf")
    b.support((0.11, 0), (depth - 0.26, width - 0.04), 0.89)
    b.support((0.12 - depth / 2, 0), (0.22, width), 1.365, name="shelf")


def cupboard(b: ShapeBuilder, width: float, doors: int, depth: float = 0.6, height: float = 0.86) -> None:
    """Add a kitchen base unit without a worktop."""
    b.box((depth - 0.08, width, 0.1), (-0.03, 0, 0), "plastic", "body")
    b.box((depth - 0.03, width, height - 0.1), (-0.005, 0, 0.1), MAIN, "body")
    for number in range(doors):
        y = (number + 0.5) * width / doors - width / 2
        b.box((0.015, width / doors - 0.012, height - 0.13), (depth / 2 - 0.015, y, 0.115), DARK, "body")
        b.box((0.0075, width / doors * 0.5, 0.015), (depth / 2 - 0.00375, y, height - 0.12), "metal", "body")


@category(
    "counter",
    {"width": 0.6},
    {"width": 0.8},
    {"width": 1.2},
    {"width": 1.6},
    colors=WOOD + ("green", "blue"),
    access=0.6,
)
def counter(b: ShapeBuilder, width: float = 1.2) -> None:
    """Build a kitchen counter with cupboards below."""
    cupboard(b, width, max(1, round(width / 0.5)))
    b.box((0.62, width, 0.04), (0, 0, 0.86), "oak", "top")
    b.support((0, 0), (0.62, width), 0.9)


@category("kitchen island", {"width": 1.4}, {"width": 1.8}, colors=WOOD + ("green", "blue"))
def kitchen_island(b: ShapeBuilder, width: float = 1.4) -> None:
    """Build a free-standing counter with an overhanging top."""
    cupboard(b, width, round(width / 0.5))
    b.box((0.95, width + 0.1, 0.04), (-0.12, 0, 0.86), "oak", "top")
    b.support((-0.12, 0), (0.95, width + 0.1), 0.9)
