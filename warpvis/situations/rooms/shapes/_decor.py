# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Plants, pictures, rugs, books, toys, and what divides a room."""

from __future__ import annotations

import math

from warpvis.situations.rooms.shapes._builder import ShapeBuilder
from warpvis.situations.rooms.shapes._colors import DARK, LIGHT, MAIN
from warpvis.situations.rooms.shapes._registry import BRIGHT, EVERY_COLOR, FABRIC, category


def _leaves(b: ShapeBuilder, count: int, base: float, length: float, rise: float, part: str) -> None:
    """Add arched leaves around an axis: flat lofts that lean outward."""
    for number in range(count):
        angle = 2 * math.pi * number / count + 0.4 * (number % 3)
        high = rise * (0.75 + 0.25 * ((number * 7) % 5) / 4)
        out = length * (0.7 + 0.3 * ((number * 3) % 4) / 3)
        rows = []
        for t, width in ((0.0, 0.1), (0.35, 0.7), (0.65, 1.0), (0.88, 0.6), (1.0, 0.05)):
            along = out * t**1.4
            rows.append(
                (
                    base + high * (t - 0.25 * t * t),
                    0.02 + 0.1 * length * width,
                    0.02 + 0.1 * length * width,
                    along * math.cos(angle),
                    along * math.sin(angle),
                )
            )
        b.loft(rows, ("leaf", "light leaf")[number % 2], part, sides=4)


@category("plant", {}, {"height": 0.9}, {"height": 1.4}, colors=("green",), movable=True)
def plant(b: ShapeBuilder, height: float = 1.15) -> None:
    """Build a plant in a pot."""
    b.lathe(
        [(0, 0), (0.12, 0), (0.16, 0.26), (0.145, 0.26), (0.14, 0.235), (0, 0.235)],
        (0, 0, 0),
        "terracotta",
        "pot",
        sides=14,
    )
    b.cylinder(0.138, 0.01, (0, 0, 0.23), "soil", "pot", sides=12)
    b.cylinder(0.018, height * 0.35, (0, 0, 0.24), "walnut", "leaves", sides=6)
    _leaves(b, 9, 0.24 + height * 0.25, 0.3, height * 0.68 - 0.24, "leaves")


@category("pot plant", {}, colors=("green",), mount="support", movable=True)
def pot_plant(b: ShapeBuilder) -> None:
    """Build a small plant in a pot."""
    b.lathe(
        [(0, 0), (0.045, 0), (0.06, 0.09), (0.054, 0.09), (0.05, 0.08), (0, 0.08)],
        (0, 0, 0),
        "terracotta",
        "pot",
        sides=12,
    )
    _leaves(b, 7, 0.08, 0.12, 0.17, "leaves")


@category("vase", {}, {"height": 0.32}, colors=EVERY_COLOR, mount="support", movable=True)
def vase(b: ShapeBuilder, height: float = 0.24) -> None:
    """Build a vase with a narrow neck."""
    h = height
    rows = [
        (0, 0),
        (h * 0.2, 0),
        (h * 0.3, h * 0.3),
        (h * 0.27, h * 0.5),
        (h * 0.12, h * 0.78),
        (h * 0.18, h),
        (h * 0.15, h),
        (h * 0.1, h * 0.8),
        (0, h * 0.78),
    ]
    b.lathe(rows, (0, 0, 0), MAIN, sides=16)


@category("ball", {}, {"radius": 0.06}, {"radius": 0.16}, colors=BRIGHT, movable=True)
def ball(b: ShapeBuilder, radius: float = 0.11) -> None:
    """Build a ball with a stripe."""
    b.ball(radius, (0, 0, radius), sides=16)
    b.cylinder(radius + 0.001, radius * 0.2, (0, 0, radius * 0.9), LIGHT, sides=16)


@category("teddy bear", {}, {"size": 0.8}, colors=("brown", "beige", "white", "pink"), movable=True)
def teddy_bear(b: ShapeBuilder, size: float = 1.0) -> None:
    """Build a sitting toy bear; x is its front."""
    s = size
    b.ball((0.1 * s, 0.11 * s, 0.13 * s), (0, 0, 0.13 * s), sides=10)
    b.ball((0.06 * s, 0.07 * s, 0.08 * s), (0.05 * s, 0, 0.12 * s), LIGHT, sides=8)
    b.ball(0.09 * s, (0.01 * s, 0, 0.32 * s), sides=10)
    b.ball((0.045 * s, 0.04 * s, 0.035 * s), (0.09 * s, 0, 0.305 * s), "snout", sides=8)
    b.ball(0.014 * s, (0.132 * s, 0, 0.317 * s), "burner", sides=6)
    for side in (-1, 1):
        b.ball(0.036 * s, (0, side * 0.07 * s, 0.4 * s), sides=8)
        b.ball(0.012 * s, (0.085 * s, side * 0.038 * s, 0.35 * s), "burner", sides=6)
        b.ball((0.055 * s, 0.04 * s, 0.075 * s), (0.05 * s, side * 0.125 * s, 0.18 * s), sides=8)
        b.ball((0.1 * s, 0.05 * s, 0.05 * s), (0.12 * s, side * 0.08 * s, 0.05 * s), sides=8)
        b.ball((0.012 * s, 0.035 * s, 0.035 * s), (0.215 * s, side * 0.08 * s, 0.05 * s), "snout", sides=8)


@category(
    "book",
    {},
    {"size": 0.21, "thick": 0.025},
    {"size": 0.28, "thick": 0.02},
    colors=EVERY_COLOR,
    mount="support",
    movable=True,
)
def book(b: ShapeBuilder, size: float = 0.24, thick: float = 0.035) -> None:
    """Build a closed book that lies flat; its spine is at the back."""
    width = size * 0.7
    b.box((width - 0.006, size - 0.01, thick - 0.006), (0, 0, 0.003), "paper")
    for z in (0, thick - 0.003):
        b.box((width, size, 0.003), (0, 0, z), MAIN)
    b.box((0.003, size, thick), (0.0015 - width / 2, 0, 0), DARK)
    b.support((0, 0), (width, size), thick)


@category("books", {}, {"count": 4}, {"count": 9}, {"count": 6}, colors=EVERY_COLOR, mount="support", movable=True)
def books(b: ShapeBuilder, count: int = 7) -> None:
    """Build a row of standing books; their spines are at the front. The color is that of the widest ones."""
    words = [MAIN, "red", "blue", MAIN, "green", "yellow", MAIN, "purple", "orange", "turquoise"]
    y = 0.0
    thick = [0.03, 0.022, 0.04, 0.03, 0.026, 0.034, 0.03, 0.02, 0.036, 0.028][:count]
    y = -sum(thick) / 2
    for number, width in enumerate(thick):
        height = 0.2 + 0.012 * ((number * 5) % 6)
        depth = 0.15 + 0.006 * ((number * 3) % 4)
        b.box((depth, width - 0.001, height), (0.085 - depth / 2, y + width / 2, 0), words[number])
        b.box((0.0015, width * 0.6, height * 0.12), (0.0858, y + width / 2, height * 0.65), "paper")
        y += width


@category("rug", {"length": 2.0, "width": 1.4}, colors=FABRIC + ("orange", "purple"))
def rug(b: ShapeBuilder, length: float = 2.0, width: float = 1.4) -> None:
    """Build a rug with a border; other items may stand on it."""
    b.box((width, length, 0.004), (0, 0, 0), DARK)
    b.box((width - 0.2, length - 0.2, 0.006), (0, 0, 0), MAIN)
    b.box((width - 0.5, length - 0.5, 0.0065), (0, 0, 0), LIGHT)


@category("picture", {}, {"width": 0.4, "height": 0.5}, {"width": 0.9, "height": 0.6}, colors=EVERY_COLOR, mount="wall")
def picture(b: ShapeBuilder, width: float = 0.6, height: float = 0.45) -> None:
    """Build a framed picture: hills below a sky with a sun."""
    b.box((0.025, width, height), (0.0125, 0, 0), "walnut")
    b.box((0.002, width - 0.06, height - 0.06), (0.026, 0, 0.03), "paper")
    inner, low = width - 0.14, 0.07
    b.box((0.001, inner, height - 0.14), (0.0275, 0, low), LIGHT)
    b.box((0.001, inner, (height - 0.14) * 0.45), (0.0285, 0, low), MAIN)
    b.box((0.001, inner * 0.6, (height - 0.14) * 0.25), (0.0295, -inner * 0.2, low), DARK)
    b.cylinder(height * 0.09, 0.001, (0.028, inner * 0.25, height * 0.68), "yellow", axis="x", sides=14)


@category("clock", colors=("white", "black", "red", "blue", "yellow"), mount="wall")
def clock(b: ShapeBuilder) -> None:
    """Build a wall clock that shows ten past ten."""
    b.cylinder(0.16, 0.03, (0, 0, 0.16), MAIN, axis="x", sides=24)
    b.cylinder(0.14, 0.002, (0.03, 0, 0.16), "paper", axis="x", sides=24)
    b.box((0.002, 0.012, 0.08), (0.033, 0, 0.16), "burner")
    b.box((0.002, 0.09, 0.01), (0.033, -0.04, 0.155), "burner")
    for y, z in ((0, 0.28), (0, 0.03), (0.125, 0.155), (-0.125, 0.155)):
        b.box((0.002, 0.012, 0.012), (0.033, y, z), "burner")


@category("whiteboard", {"width": 1.2}, {"width": 1.8}, {"width": 0.9}, colors=("white",), mount="wall")
def whiteboard(b: ShapeBuilder, width: float = 1.2) -> None:
    """Build a whiteboard with a tray and some writing."""
    b.box((0.02, width, 0.9), (0.01, 0, 0), "metal")
    b.box((0.004, width - 0.05, 0.85), (0.022, 0, 0.025), MAIN)
    b.box((0.06, width * 0.5, 0.015), (0.03, 0, 0), "metal")
    for number, word in enumerate(("blue", "red", "burner")):
        length = width * (0.5 - 0.12 * number)
        b.box((0.001, length, 0.018), (0.0245, width * 0.38 - length / 2, 0.7 - 0.11 * number), word)
        b.cylinder(0.008, 0.09, (0.05, number * 0.14 - 0.2, 0.023), word, axis="y", sides=6)


@category("mirror", colors=("brown", "white", "black", "gray"), mount="wall")
def mirror(b: ShapeBuilder) -> None:
    """Build a wall mirror, whose glass does not reflect here."""
    b.box((0.03, 0.5, 1.2), (0.015, 0, 0), MAIN)
    b.box((0.002, 0.42, 1.12), (0.031, 0, 0.04), "glass")


@category("curtain", {"height": 2.0}, colors=FABRIC + ("yellow", "white"), mount="wall")
def curtain(b: ShapeBuilder, height: float = 2.0, width: float = 0.3) -> None:
    """Build a gathered curtain with a piece of its rail."""
    folds = 5
    for number in range(folds):
        y = (number + 0.5) * width / folds - width / 2
        b.cylinder(
            width / folds * 0.55,
            height - 0.03,
            (0.055, y, 0),
            (MAIN, DARK)[number % 2],
            sides=8,
            top=width / folds * 0.5,
        )
    b.box((0.055, 0.02, 0.02), (0.0275, 0, height - 0.03), "metal")
    b.cylinder(0.012, width, (0.055, -width / 2, height - 0.02), "metal", axis="y", sides=8)


@category("radiator", {"width": 0.8}, {"width": 1.0}, {"width": 1.2}, colors=("white",), mount="wall")
def radiator(b: ShapeBuilder, width: float = 1.0) -> None:
    """Build a radiator of fins."""
    for number in range(round(width / 0.08)):
        b.box((0.08, 0.055, 0.5), (0.07, 0.04 - width / 2 + number * 0.08, 0), MAIN)
    b.box((0.05, width, 0.03), (0.07, 0, 0.05), DARK)
    b.box((0.05, width, 0.03), (0.07, 0, 0.42), DARK)
    for side in (-1, 1):
        b.box((0.04, 0.04, 0.04), (0.02, side * width * 0.3, 0.4), "metal")


@category("screen", {}, {"panels": 2}, colors=("beige", "white", "gray", "blue", "green"), movable=True)
def screen(b: ShapeBuilder, panels: int = 3, height: float = 1.7) -> None:
    """Build a partition of framed panels on feet; x is its front."""
    for number in range(panels):
        y = (number - (panels - 1) / 2) * 0.6
        b.box((0.03, 0.56, height - 0.12), (0, y, 0.08), MAIN)
        for side in (-1, 1):
            b.box((0.045, 0.03, height - 0.06), (0, y + side * 0.285, 0.05), "oak")
        for z in (0.06, height - 0.04):
            b.box((0.045, 0.6, 0.04), (0, y, z), "oak")
    for side in (-1, 1):
        b.box((0.36, 0.05, 0.05), (0, side * ((panels - 1) * 0.3 + 0.2), 0), "oak")


@category(
    "poster stand", {}, {"width": 0.6}, colors=("white", "red", "blue", "green", "yellow", "orange"), movable=True
)
def poster_stand(b: ShapeBuilder, width: float = 0.5, height: float = 1.65) -> None:
    """Build a panel with a poster on a foot; x is its front."""
    b.box((0.32, width, 0.02), (0, 0, 0), "metal")
    b.box((0.04, width, height - 0.02), (0, 0, 0.02), "metal")
    for side in (-1, 1):
        b.box((0.002, width - 0.04, height - 0.1), (side * 0.021, 0, 0.06), MAIN)
        b.box((0.002, width - 0.12, 0.3), (side * 0.023, 0, height - 0.45), "paper")
        b.box((0.002, width - 0.2, 0.06), (side * 0.023, 0, height - 0.6), "paper")


@category("pillar", {}, {"width": 0.3}, {"height": 2.7}, colors=("white", "gray", "beige"))
def pillar(b: ShapeBuilder, width: float = 0.4, height: float = 2.6) -> None:
    """Build a square pillar with a base."""
    b.box((width, width, height), (0, 0, 0), LIGHT)
    b.box((width + 0.03, width + 0.03, 0.1), (0, 0, 0), MAIN)


@category("coat rack", colors=("brown", "black", "white"), movable=True)
def coat_rack(b: ShapeBuilder) -> None:
    """Build a coat rack with a coat."""
    b.cylinder(0.2, 0.03, (0, 0, 0), MAIN, sides=14)
    b.cylinder(0.022, 1.7, (0, 0, 0.03), MAIN, sides=8)
    for yaw in (0, 90):
        b.box((0.36, 0.03, 0.03), (0, 0, 1.6), MAIN, yaw=yaw)
    b.ball(0.035, (0, 0, 1.75), MAIN, sides=8)
    b.loft(
        [(0.75, 0.11, 0.2, 0.1, 0), (1.3, 0.09, 0.17, 0.1, 0), (1.5, 0.07, 0.15, 0.08, 0), (1.6, 0.03, 0.04, 0.06, 0)],
        "blue",
        sides=10,
    )


@category("step ladder", colors=("gray", "yellow", "red"), movable=True)
def step_ladder(b: ShapeBuilder) -> None:
    """Build a step ladder of four treads."""
    for number in range(4):
        z, x = 0.25 + number * 0.25, 0.3 - number * 0.12
        b.box((0.12, 0.4 - number * 0.02, 0.03), (x, 0, z - 0.03), "plastic")
        for side in (-1, 1):
            b.box((0.06, 0.03, 0.25), (x + 0.03, side * (0.21 - number * 0.01), z - 0.25), MAIN)
            b.box((0.04, 0.03, 0.25), (-0.3 + number * 0.07, side * (0.2 - number * 0.01), z - 0.25), MAIN)
    b.box((0.2, 0.36, 0.03), (-0.04, 0, 1.0), MAIN)


@category("basketball hoop", colors=("red",), mount="wall")
def hoop(b: ShapeBuilder) -> None:
    """Build a small basketball hoop on a board."""
    b.box((0.02, 0.5, 0.35), (0.01, 0, 0), "paper")
    b.box((0.004, 0.2, 0.15), (0.022, 0, 0.06), MAIN)
    b.lathe([(0.12, 0), (0.13, 0.008), (0.12, 0.016), (0.112, 0.008), (0.12, 0)], (0.15, 0, 0.06), "orange", sides=16)


@category("pen holder", colors=EVERY_COLOR, mount="support", movable=True)
def pen_holder(b: ShapeBuilder) -> None:
    """Build a cup with pens."""
    b.lathe([(0, 0), (0.04, 0), (0.04, 0.1), (0.036, 0.1), (0.036, 0.01), (0, 0.01)], (0, 0, 0), MAIN, sides=12)
    for number, word in enumerate(("blue", "red", "yellow", "burner")):
        b.cylinder(
            0.005,
            0.13 + 0.012 * number,
            (0.02 * math.cos(number * 1.6), 0.02 * math.sin(number * 1.6), 0.01),
            word,
            sides=6,
        )


@category("paper stack", colors=("white",), mount="support", movable=True)
def paper_stack(b: ShapeBuilder) -> None:
    """Build a stack of sheets of A4, 210 by 297 mm, with writing."""
    b.box((0.297, 0.21, 0.012), (0, 0, 0), "paper")
    for number in range(5):
        b.box((0.008, 0.15, 0.0006), (-0.09 + number * 0.035, 0, 0.012), "gray")


@category("toy car", colors=BRIGHT, movable=True)
def toy_car(b: ShapeBuilder) -> None:
    """Build a toy car that drives along x."""
    b.cushion((0.24, 0.11, 0.05), (0, 0, 0.025), MAIN, radius=0.02)
    b.cushion((0.13, 0.1, 0.045), (-0.01, 0, 0.07), LIGHT, radius=0.02)
    for x in (-0.07, 0.07):
        for y in (-0.06, 0.04):
            b.cylinder(0.028, 0.02, (x, y, 0.028), "plastic", axis="y", sides=10)


@category("toy blocks", colors=BRIGHT, movable=True)
def toy_blocks(b: ShapeBuilder) -> None:
    """Build a small tower of toy blocks; the color is that of the lowest."""
    for number, word in enumerate((MAIN, "yellow", "blue")):
        size = 0.09 - 0.015 * number
        b.box((size, size, 0.06), (0, 0, 0.06 * number), word, yaw=15.0 * number)
    b.cylinder(0.03, 0.05, (0, 0, 0.18), "red", sides=12, top=0.004)
