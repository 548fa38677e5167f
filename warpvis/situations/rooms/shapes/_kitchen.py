# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Kitchen appliances and what is eaten from; base units are 0.6 m deep and 0.9 m high (EN 1116)."""

from __future__ import annotations

import itertools

from warpvis.situations.rooms.shapes._builder import ShapeBuilder
from warpvis.situations.rooms.shapes._colors import DARK, LIGHT, MAIN
from warpvis.situations.rooms.shapes._registry import BRIGHT, EVERY_COLOR, WOOD, category
from warpvis.situations.rooms.shapes._tables import cupboard


@category("sink", colors=WOOD + ("green", "blue"), access=0.6)
def sink(b: ShapeBuilder, width: float = 0.8) -> None:
    """Build a base unit with a sink and a tap."""
    cupboard(b, width, 2)
    for y, size in ((-(width / 2 - 0.08), 0.16), (width / 2 - 0.08, 0.16)):
        b.box((0.62, size, 0.04), (0, y, 0.86), "oak", "top")
    inner = width - 0.32
    for x, size in ((0.25, 0.12), (-0.25, 0.12)):
        b.box((size, inner, 0.04), (x, 0, 0.86), "oak", "top")
    b.box((0.38, inner, 0.005), (0, 0, 0.861), "dark metal", "top")
    for x, y, dx, dy in (
        (0.185, 0, 0.02, inner),
        (-0.185, 0, 0.02, inner),
        (0, inner / 2, 0.39, 0.02),
        (0, -inner / 2, 0.39, 0.02),
    ):
        b.box((dx, dy, 0.044), (x, y, 0.861), "metal", "top")
    b.cylinder(0.02, 0.28, (-0.25, 0, 0.9), "metal", "tap", sides=8)
    b.cylinder(0.015, 0.2, (-0.25, 0, 1.17), "metal", "tap", axis="x", sides=8)
    b.cylinder(0.015, 0.06, (-0.06, 0, 1.12), "metal", "tap", sides=8)


@category("stove", colors=("white", "gray", "black"), access=0.7)
def stove(b: ShapeBuilder) -> None:
    """Build a cooker with an oven and four hot plates."""
    b.box((0.56, 0.6, 0.86), (0, 0, 0), MAIN, "body")
    b.box((0.02, 0.56, 0.5), (0.29, 0, 0.14), DARK, "body")
    b.box((0.005, 0.42, 0.3), (0.3025, 0, 0.22), "screen", "body")
    b.cylinder(0.012, 0.48, (0.325, -0.24, 0.67), "metal", "body", axis="y", sides=8)
    for number in range(5):
        b.cylinder(0.022, 0.03, (0.28, (number - 2) * 0.1, 0.78), "plastic", "body", axis="x", sides=10)
    b.box((0.6, 0.6, 0.04), (0, 0, 0.86), "plastic", "body")
    for x in (-0.14, 0.14):
        for y in (-0.14, 0.14):
            b.cylinder(0.09, 0.006, (x, y, 0.9), "dark metal", "body", sides=16)
    for x in (-0.14, 0.14):
        for y in (-0.14, 0.14):
            b.support((x, y), (0.2, 0.2), 0.906, name=f"plate {x} {y}")


@category(
    "fridge", {}, {"height": 1.5, "width": 0.6}, {"width": 0.75}, colors=("white", "gray", "black", "red"), access=0.7
)
def fridge(b: ShapeBuilder, height: float = 1.8, width: float = 0.62) -> None:
    """Build a refrigerator with two doors."""
    split = round(height * 0.36, 3)
    b.box((0.58, width - 0.04, 0.05), (0, 0, 0), "plastic", "body")
    b.box((0.6, width, height - 0.05), (-0.02, 0, 0.05), DARK, "body")
    b.cushion((0.06, width, split - 0.06), (0.31, 0, 0.055), MAIN, "body", radius=0.015)
    b.cushion((0.06, width, height - split - 0.01), (0.31, 0, split + 0.005), MAIN, "body", radius=0.015)
    for z, length in ((split - 0.32, 0.26), (split + 0.08, 0.36)):
        b.box((0.03, 0.02, length), (0.36, 0.06 - width / 2, z), "metal", "body")
    b.support((-0.02, 0), (0.5, width - 0.1), height)


@category("wall cabinet", {"width": 0.6}, {"width": 0.8}, {"width": 1.2}, colors=WOOD + ("green", "blue"), mount="wall")
def wall_cabinet(b: ShapeBuilder, width: float = 0.8) -> None:
    """Build a kitchen wall unit."""
    b.box((0.33, width, 0.6), (0.165, 0, 0), MAIN)
    count = round(width / 0.4)
    for number in range(count):
        y = (number + 0.5) * width / count - width / 2
        b.box((0.018, width / count - 0.01, 0.59), (0.339, y, 0.005), DARK)
        b.box((0.015, 0.014, 0.1), (0.3555, y + (0.5 - number % 2) * (width / count - 0.08), 0.05), "metal")


@category("microwave", colors=("white", "gray", "black"), mount="support", movable=True)
def microwave(b: ShapeBuilder) -> None:
    """Build a microwave oven."""
    b.box((0.34, 0.46, 0.26), (0, 0, 0.01), MAIN)
    b.box((0.3, 0.4, 0.01), (0, 0, 0), "plastic")
    b.box((0.01, 0.31, 0.22), (0.175, -0.06, 0.03), "screen")
    b.box((0.012, 0.1, 0.05), (0.174, 0.16, 0.2), "screen light")
    b.cylinder(0.025, 0.02, (0.17, 0.16, 0.09), "metal", axis="x", sides=10)


@category("toaster", colors=("red", "gray", "white", "black", "turquoise"), mount="support", movable=True)
def toaster(b: ShapeBuilder) -> None:
    """Build a toaster with two slots."""
    b.cushion((0.18, 0.28, 0.18), (0, 0, 0), MAIN, radius=0.04)
    for x in (-0.04, 0.04):
        b.box((0.03, 0.2, 0.004), (x, 0, 0.178), "burner")
    b.box((0.03, 0.02, 0.02), (0, 0.145, 0.12), "plastic")


@category("kettle", colors=("gray", "white", "red", "black"), mount="support", movable=True)
def kettle(b: ShapeBuilder) -> None:
    """Build an electric kettle."""
    b.lathe([(0, 0), (0.085, 0), (0.088, 0.02), (0.07, 0.19), (0.05, 0.21), (0, 0.215)], (0, 0, 0), MAIN, sides=16)
    b.ball(0.014, (0, 0, 0.222), "plastic", sides=6)
    b.box((0.05, 0.025, 0.02), (-0.085, 0, 0.17), "plastic")
    b.box((0.02, 0.025, 0.14), (-0.115, 0, 0.05), "plastic")
    b.box((0.05, 0.025, 0.02), (-0.095, 0, 0.035), "plastic")
    b.loft([(0.14, 0.012, 0.02, 0.075, 0), (0.18, 0.012, 0.016, 0.1, 0)], MAIN, sides=8)


@category("pot", {}, {"radius": 0.12}, colors=("gray", "red", "black", "blue"), mount="support", movable=True)
def pot(b: ShapeBuilder, radius: float = 0.1) -> None:
    """Build a cooking pot with a lid and two handles."""
    h = radius * 1.15
    b.lathe(
        [(0, 0), (radius, 0), (radius, h), (radius * 0.98, h + 0.006), (0.02, h + 0.02), (0, h + 0.02)],
        (0, 0, 0),
        MAIN,
        sides=18,
    )
    b.cylinder(0.018, 0.025, (0, 0, h + 0.02), "plastic", sides=8)
    for side in (-1, 1):
        b.box((0.07, 0.035, 0.015), (0, side * (radius + 0.014), h * 0.75), "plastic")


@category("pan", colors=("black", "gray", "red"), mount="support", movable=True)
def pan(b: ShapeBuilder) -> None:
    """Build a frying pan with a handle along x."""
    b.lathe(
        [(0, 0), (0.1, 0), (0.13, 0.045), (0.124, 0.045), (0.097, 0.006), (0, 0.006)], (-0.09, 0, 0), MAIN, sides=18
    )
    b.box((0.2, 0.025, 0.018), (0.13, 0, 0.03), "plastic")


@category(
    "mug",
    {},
    {"radius": 0.045, "height": 0.09},
    {"radius": 0.038, "height": 0.11},
    colors=EVERY_COLOR,
    mount="support",
    movable=True,
)
def mug(b: ShapeBuilder, radius: float = 0.041, height: float = 0.098) -> None:
    """Build a mug with a handle to its left."""
    r, h = radius, height
    b.lathe([(0, 0), (r, 0), (r, h), (r - 0.005, h), (r - 0.005, 0.008), (0, 0.008)], (0, 0, 0), MAIN, sides=16)
    b.box((0.012, 0.026, 0.01), (0, r + 0.012, h * 0.74))
    b.box((0.012, 0.026, 0.01), (0, r + 0.012, h * 0.24))
    b.box((0.012, 0.01, h * 0.5 + 0.01), (0, r + 0.028, h * 0.24))


@category("cup", {}, colors=BRIGHT, mount="support", movable=True)
def cup(b: ShapeBuilder) -> None:
    """Build a cup on a saucer."""
    b.lathe([(0, 0), (0.045, 0), (0.075, 0.014), (0.072, 0.018), (0.04, 0.006), (0, 0.006)], (0, 0, 0), LIGHT, sides=18)
    b.lathe(
        [(0, 0.006), (0.025, 0.006), (0.042, 0.068), (0.038, 0.068), (0.022, 0.012), (0, 0.012)],
        (0, 0, 0),
        MAIN,
        sides=16,
    )
    b.box((0.01, 0.024, 0.008), (0, 0.046, 0.054))
    b.box((0.01, 0.008, 0.03), (0, 0.055, 0.03))


@category("glass", {}, {"height": 0.15}, colors=("blue", "green", "turquoise", "white"), mount="support", movable=True)
def glass(b: ShapeBuilder, height: float = 0.12) -> None:
    """Build a drinking glass, which is opaque here."""
    h = height
    b.lathe([(0, 0), (0.028, 0), (0.036, h), (0.033, h), (0.026, 0.01), (0, 0.01)], (0, 0, 0), LIGHT, sides=14)


@category("bowl", {}, {"radius": 0.12}, colors=EVERY_COLOR, mount="support", movable=True)
def bowl(b: ShapeBuilder, radius: float = 0.085) -> None:
    """Build a bowl."""
    r = radius
    rows = [
        (0, 0),
        (r * 0.5, 0),
        (r * 0.85, r * 0.35),
        (r, r * 0.75),
        (r * 0.94, r * 0.75),
        (r * 0.78, r * 0.38),
        (r * 0.4, 0.01),
        (0, 0.01),
    ]
    b.lathe(rows, (0, 0, 0), MAIN, sides=18)


@category("plate", {}, {"radius": 0.1}, colors=EVERY_COLOR, mount="support", movable=True)
def plate(b: ShapeBuilder, radius: float = 0.13) -> None:
    """Build a plate."""
    r = radius
    b.lathe(
        [(0, 0), (r * 0.6, 0), (r, 0.02), (r * 0.98, 0.024), (r * 0.6, 0.006), (0, 0.006)], (0, 0, 0), MAIN, sides=20
    )


@category(
    "bottle",
    {},
    {"height": 0.24, "radius": 0.033},
    {"height": 0.3, "radius": 0.038},
    colors=("green", "brown", "blue", "red", "white", "yellow"),
    mount="support",
    movable=True,
)
def bottle(b: ShapeBuilder, height: float = 0.31, radius: float = 0.037) -> None:
    """Build a bottle with a label and a cap."""
    r, h = radius, height
    rows = [(0, 0), (r, 0), (r, h * 0.58), (r * 0.4, h * 0.78), (r * 0.38, h * 0.94), (0, h * 0.94)]
    b.lathe(rows, (0, 0, 0), MAIN, sides=14)
    b.cylinder(r + 0.0008, h * 0.25, (0, 0, h * 0.2), "paper", sides=14)
    b.cylinder(r * 0.45, h * 0.07, (0, 0, h * 0.93), DARK, sides=10)


@category("can", colors=BRIGHT, mount="support", movable=True)
def can(b: ShapeBuilder) -> None:
    """Build a beverage can of 0.33 l: 66 mm wide and 115 mm high."""
    b.lathe(
        [(0, 0), (0.026, 0), (0.033, 0.008), (0.033, 0.104), (0.027, 0.115), (0.025, 0.112), (0, 0.112)],
        (0, 0, 0),
        MAIN,
        sides=14,
    )
    b.cylinder(0.0272, 0.0012, (0, 0, 0.1138), "metal", sides=14)
    b.cylinder(0.0335, 0.03, (0, 0, 0.042), LIGHT, sides=14)


@category("teapot", colors=BRIGHT, mount="support", movable=True)
def teapot(b: ShapeBuilder) -> None:
    """Build a teapot with a spout along x."""
    rows = [(0, 0), (0.055, 0), (0.085, 0.05), (0.08, 0.09), (0.045, 0.125), (0, 0.13)]
    b.lathe(rows, (0, 0, 0), MAIN, sides=16)
    b.ball(0.014, (0, 0, 0.14), DARK, sides=6)
    b.loft([(0.04, 0.022, 0.018, 0.075, 0), (0.08, 0.016, 0.014, 0.105, 0), (0.115, 0.012, 0.011, 0.13, 0)], sides=8)
    b.box((0.05, 0.018, 0.014), (-0.09, 0, 0.092), DARK)
    b.box((0.014, 0.018, 0.07), (-0.115, 0, 0.036), DARK)
    b.box((0.04, 0.018, 0.014), (-0.095, 0, 0.03), DARK)


@category("cutting board", colors=("brown", "beige"), mount="support", movable=True)
def cutting_board(b: ShapeBuilder) -> None:
    """Build a wooden board."""
    b.cushion((0.24, 0.36, 0.02), (0, 0, 0), MAIN, radius=0.009)


def _fruit(b: ShapeBuilder, radius: float) -> None:
    b.ball(radius, (0, 0, radius), sides=12)
    b.cylinder(0.004, 0.02, (0, 0, 2 * radius - 0.004), "walnut", sides=5)


@category("apple", colors=("red", "green", "yellow"), mount="support", movable=True)
def apple(b: ShapeBuilder) -> None:
    """Build an apple."""
    _fruit(b, 0.04)


@category("orange", colors=("orange",), mount="support", movable=True)
def orange(b: ShapeBuilder) -> None:
    """Build an orange."""
    b.ball(0.042, (0, 0, 0.042), sides=12)


@category("banana", colors=("yellow",), mount="support", movable=True)
def banana(b: ShapeBuilder) -> None:
    """Build a banana: a bent, thin body along x."""
    rows = []
    for number in range(7):
        t = number / 6 - 0.5
        rows.append((0.09 * 2 * t, 0.018 * (1 - (2 * t) ** 4 * 0.75), 0.08 * t * t))
    points = [(x, r, y) for x, r, y in rows]
    for (x0, r0, y0), (x1, r1, y1) in itertools.pairwise(points):
        yaw = 57.29578 * ((y1 - y0) / (x1 - x0))
        r = (r0 + r1) / 2
        b.box((x1 - x0 + 0.008, 2 * r, 0.034), ((x0 + x1) / 2, (y0 + y1) / 2, 0), yaw=yaw)
