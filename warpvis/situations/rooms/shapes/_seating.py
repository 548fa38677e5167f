# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Chairs, sofas and beds. Seats are 0.42 to 0.48 m high (EN 1335-1, EN 1729-1), mattresses 1.9 or 2.0 m long."""

from __future__ import annotations

from warpvis.situations.rooms.shapes._builder import ShapeBuilder
from warpvis.situations.rooms.shapes._colors import DARK, LIGHT, MAIN
from warpvis.situations.rooms.shapes._registry import EVERY_COLOR, FABRIC, WOOD, category


def legs(
    b: ShapeBuilder, size: tuple[float, float], height: float, width: float, material: str, part: str = ""
) -> None:
    """Add four legs at the corners of a rectangle."""
    x, y = (size[0] - width) / 2, (size[1] - width) / 2
    for number, (dx, dy) in enumerate(((x, y), (x, -y), (-x, y), (-x, -y))):
        b.box((width, width, height), (dx, dy, 0), material, part or f"leg {number}")


@category("chair", {}, {"slats": 3}, {"width": 0.46, "slats": 2}, colors=WOOD + ("red", "blue", "green"), movable=True)
def chair(b: ShapeBuilder, width: float = 0.43, slats: int = 0) -> None:
    """Build a chair with four legs and a backrest, solid or of horizontal slats."""
    depth, seat, back = 0.44, 0.45, 0.9
    legs(b, (depth, width), seat - 0.03, 0.04, MAIN, "seat")
    b.cushion((depth, width, 0.04), (0, 0, seat - 0.04), LIGHT, "seat", radius=0.015)
    for side in (-1, 1):
        b.box((0.035, 0.035, back - seat), (0.0175 - depth / 2, side * (width / 2 - 0.0175), seat), MAIN, "back")
    for slat in range(slats):
        b.box(
            (0.02, width - 0.07, 0.07),
            (0.016 - depth / 2, 0, seat + 0.12 + slat * 0.3 / max(slats - 1, 1)),
            MAIN,
            "back",
        )
    if not slats:
        b.box((0.022, width - 0.07, 0.34), (0.017 - depth / 2, 0, seat + 0.11), MAIN, "back")
    b.seat((0.02, 0, seat))


@category("office chair", {}, {"arms": False}, colors=("black", "gray", "blue", "red", "green"), movable=True)
def office_chair(b: ShapeBuilder, arms: bool = True) -> None:
    """Build a swivel chair with a five-star base."""
    for number in range(5):
        yaw = 72.0 * number
        b.box((0.3, 0.04, 0.03), (0, 0, 0.055), "plastic", "base")
        b.box((0.5, 0.035, 0.03), (0, 0, 0.06), "plastic", "base", yaw=yaw)
    for x, y in ((0.24, 0.0), (-0.24, 0.0), (0.074, 0.228), (0.074, -0.228), (-0.194, 0.141), (-0.194, -0.141)):
        b.cylinder(0.03, 0.06, (x, y, 0.0), "plastic", "base", sides=6)
    b.cylinder(0.03, 0.33, (0, 0, 0.08), "dark metal", "stem", sides=8)
    b.cushion((0.48, 0.48, 0.08), (0, 0, 0.4), MAIN, "seat")
    b.box((0.03, 0.08, 0.3), (-0.235, 0, 0.42), "plastic", "back")
    b.cushion((0.07, 0.44, 0.5), (-0.22, 0, 0.55), MAIN, "back")
    if arms:
        for side in (-1, 1):
            b.box((0.04, 0.04, 0.22), (-0.05, side * 0.265, 0.43), "plastic", f"arm {side}")
            b.box((0.26, 0.06, 0.03), (0, side * 0.265, 0.65), "plastic", f"arm {side}")
    b.seat((0.02, 0, 0.48))


@category("stool", {}, {"height": 0.65}, {"height": 0.75}, colors=WOOD + ("red", "yellow", "turquoise"), movable=True)
def stool(b: ShapeBuilder, height: float = 0.46) -> None:
    """Build a round stool."""
    for x, y in ((0.11, 0.11), (0.11, -0.11), (-0.11, 0.11), (-0.11, -0.11)):
        b.cylinder(0.018, height - 0.04, (x, y, 0), "oak", sides=8)
    b.cylinder(0.125, 0.02, (0, 0, height * 0.35), "oak", sides=12)
    b.cylinder(0.17, 0.04, (0, 0, height - 0.04), MAIN, sides=16)
    b.seat((0, 0, height))


@category("bench", {"width": 1.2}, {"width": 0.9}, movable=True)
def bench(b: ShapeBuilder, width: float = 1.2) -> None:
    """Build a wooden bench without a backrest."""
    for side in (-1, 1):
        b.box((0.32, 0.05, 0.41), (0, side * (width / 2 - 0.12), 0), MAIN, "all")
    b.box((0.36, width, 0.04), (0, 0, 0.41), MAIN, "all")
    count = max(1, int(width / 0.55))
    for number in range(count):
        b.seat((0, (number - (count - 1) / 2) * 0.55, 0.45))


def _upholstered(b: ShapeBuilder, width: float, seats: int, depth: float) -> None:
    """Add the body of a sofa or an armchair: feet, base, back, arms, and cushions."""
    arm, seat = 0.18, 0.43
    inside = width - 2 * arm
    legs(b, (depth - 0.1, width - 0.1), 0.08, 0.05, "walnut", "base")
    b.box((depth - 0.04, width - 0.04, 0.2), (0, 0, 0.08), MAIN, "base")
    b.cushion((0.2, inside, 0.57), (0.1 - depth / 2, 0, 0.27), MAIN, "back", radius=0.05)
    for side in (-1, 1):
        b.cushion((depth - 0.02, arm, 0.5), (0, side * (width - arm) / 2, 0.1), MAIN, f"arm {side}", radius=0.05)
    each = inside / seats
    for number in range(seats):
        y = (number - (seats - 1) / 2) * each
        b.cushion((depth - 0.2, each - 0.01, 0.16), (0.1, y, 0.27), LIGHT, "cushions")
        b.cushion((0.14, each - 0.02, 0.4), (0.26 - depth / 2, y, 0.42), LIGHT, "backs", radius=0.05)
        b.seat((0.12, y, seat))
    b.support((0.16, 0), (depth - 0.5, inside - 0.1), seat, name="seat")


@category("sofa", {"width": 1.9, "seats": 2}, {"width": 2.2}, {"width": 1.6, "seats": 2}, colors=FABRIC, access=0.35)
def sofa(b: ShapeBuilder, width: float = 2.2, seats: int = 3) -> None:
    """Build a sofa."""
    _upholstered(b, width, seats, 0.9)


@category("armchair", {}, {"width": 0.95}, colors=FABRIC + ("yellow", "orange"), access=0.35)
def armchair(b: ShapeBuilder, width: float = 0.86) -> None:
    """Build an armchair."""
    _upholstered(b, width, 1, 0.84)


@category("bed", {"width": 0.9}, {"width": 1.4}, {"width": 1.6}, {"width": 1.8}, colors=EVERY_COLOR, access=0.4)
def bed(b: ShapeBuilder, width: float = 1.6, length: float = 2.0) -> None:
    """Build a bed: its head is at the back, against a wall, and x points to its foot."""
    frame = width + 0.08
    b.box((0.05, frame, 1.0), (0.025 - length / 2 - 0.05, 0, 0), "oak", "head")
    legs(b, (length, frame - 0.1), 0.15, 0.08, "oak", "base")
    b.box((length, frame, 0.14), (0, 0, 0.14), "oak", "base")
    b.cushion((length - 0.04, width, 0.2), (0, 0, 0.28), "linen", "base", radius=0.05)
    b.cushion((length * 0.66, width + 0.05, 0.21), (length * 0.17 - 0.02, 0, 0.29), MAIN, "base", radius=0.06)
    b.cushion((0.22, width + 0.05, 0.215), (0.4 - length / 2 + 0.05, 0, 0.291), LIGHT, "base", radius=0.05)
    for number in range(2 if width > 1.2 else 1):
        y = (number - 0.5) * width / 2 if width > 1.2 else 0.0
        b.cushion((0.36, min(0.7, width * 0.46), 0.14), (0.26 - length / 2, y, 0.46), "white", "pillows", radius=0.06)
    b.support((length * 0.2, 0), (length * 0.5, width - 0.2), 0.5, name="blanket")
    b.seat((length * 0.3, -width / 2 + 0.12, 0.5), -90.0)
    b.seat((length * 0.3, width / 2 - 0.12, 0.5), 90.0)


@category("cushion", {}, {"size": 0.35}, colors=EVERY_COLOR, mount="support", movable=True)
def cushion(b: ShapeBuilder, size: float = 0.4) -> None:
    """Build a cushion that lies flat."""
    b.cushion((size, size, 0.12), (0, 0, 0), MAIN, radius=0.055)
    b.cushion((size * 0.3, size * 0.3, 0.005), (0, 0, 0.12), DARK, radius=0.002)
