# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shelves, cabinets, boxes and baskets."""

from __future__ import annotations

from warpvis.situations.rooms.shapes._builder import ShapeBuilder
from warpvis.situations.rooms.shapes._colors import DARK, LIGHT, MAIN
from warpvis.situations.rooms.shapes._registry import BRIGHT, EVERY_COLOR, WOOD, category
from warpvis.situations.rooms.shapes._seating import legs


def _boards(b: ShapeBuilder, depth: float, width: float, heights: list[float], thickness: float, top: float) -> None:
    """Add shelves as supports, each up to the next."""
    for number, z in enumerate(heights):
        b.box((depth, width, thickness), (0, 0, z), MAIN, f"board {number}")
        ceiling = heights[number + 1] if number + 1 < len(heights) else top
        clearance = round(ceiling - z - thickness, 6) if ceiling > z + thickness else float("inf")
        b.support((0, 0), (depth, width), z + thickness, clearance, f"shelf {number + 1}")


@category(
    "bookcase",
    {"width": 0.8},
    {"width": 0.8, "shelves": 6},
    {"width": 1.0},
    {"width": 0.6},
    {"width": 0.8, "shelves": 3},
    access=0.4,
)
def bookcase(b: ShapeBuilder, width: float = 0.8, shelves: int = 5, depth: float = 0.3) -> None:
    """Build a bookcase with sides and a back, open at the front."""
    pitch, board = 0.36, 0.025
    height = 0.06 + shelves * pitch + board
    for side in (-1, 1):
        b.box((depth, 0.025, height), (0, side * (width / 2 - 0.0125), 0), MAIN, f"side {side}")
    b.box((0.012, width - 0.05, height), (0.006 - depth / 2, 0, 0), DARK, "back")
    b.box((depth - 0.04, width - 0.05, 0.06), (-0.01, 0, 0), MAIN, "plinth")
    for number in range(shelves + 1):
        z = 0.06 + number * pitch
        b.box((depth - 0.012, width - 0.05, board), (0.006, 0, z), MAIN, f"board {number}")
        if number < shelves:
            b.support((0.006, 0), (depth - 0.016, width - 0.054), z + board, pitch - board, f"shelf {number + 1}")
    if height < 1.5:
        b.support((0, 0), (depth, width), height)


@category(
    "shelf",
    {"width": 0.9},
    {"width": 1.2, "depth": 0.45},
    {"width": 0.9, "levels": 5},
    colors=("gray", "black", "white", "blue"),
    access=0.5,
)
def shelf(b: ShapeBuilder, width: float = 0.9, depth: float = 0.4, levels: int = 4) -> None:
    """Build an open rack of metal posts and boards."""
    height = 1.85
    for number, (x, y) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
        at = (x * (depth / 2 + 0.0151), y * (width / 2 - 0.015), 0)
        b.box((0.03, 0.03, height), at, "dark metal", f"post {number}")
    heights = [0.1 + number * (height - 0.14) / (levels - 1) for number in range(levels)]
    _boards(b, depth, width, [round(z, 3) for z in heights], 0.03, 0.0)


@category("wall shelf", {"width": 0.6}, {"width": 0.8}, {"width": 1.0}, mount="wall")
def wall_shelf(b: ShapeBuilder, width: float = 0.8) -> None:
    """Build a board on two brackets."""
    for side in (-1, 1):
        b.box((0.2, 0.02, 0.02), (0.1, side * width * 0.35, 0.13), "metal", "all")
        b.box((0.02, 0.02, 0.15), (0.01, side * width * 0.35, 0), "metal", "all")
    b.box((0.22, width, 0.025), (0.11, 0, 0.15), MAIN, "all")
    b.support((0.11, 0), (0.22, width), 0.175)


def _fronts(
    b: ShapeBuilder, size: tuple[float, float, float], columns: int, rows: int, material: str, handle: str
) -> None:
    """Add doors or drawers to the front of a box of a size."""
    x, y, z = size
    for column in range(columns):
        for row in range(rows):
            center = (column + 0.5) * y / columns - y / 2, row * z / rows + 0.008
            b.box((0.012, y / columns - 0.012, z / rows - 0.016), (x / 2 + 0.006, *center), material, "body")
            high = center[1] + (z / rows - 0.016) * (0.5 if rows > 1 else 0.55)
            if rows > 1:
                b.box((0.015, min(0.16, y / columns * 0.4), 0.014), (x / 2 + 0.0195, center[0], high), handle, "body")
            else:
                aside = center[0] + (0.5 - column % 2) * 0.8 * y / columns * (1 if columns > 1 else -1)
                b.box((0.015, 0.014, 0.16), (x / 2 + 0.0195, aside, high), handle, "body")


@category("cabinet", {}, {"width": 1.2}, {"width": 0.8, "height": 1.1}, {"width": 1.6, "height": 0.75}, access=0.5)
def cabinet(b: ShapeBuilder, width: float = 1.0, height: float = 0.85, depth: float = 0.42) -> None:
    """Build a cabinet with doors on short legs."""
    legs(b, (depth - 0.06, width - 0.06), 0.1, 0.05, "walnut", "body")
    b.box((depth, width, height - 0.12), (0, 0, 0.1), MAIN, "body")
    b.box((depth + 0.04, width + 0.02, 0.02), (0.01, 0, height - 0.02), DARK, "body")
    for column in range(round(width / 0.45)):
        each = width / round(width / 0.45)
        y = (column + 0.5) * each - width / 2
        b.box((0.012, each - 0.014, height - 0.16), (depth / 2 + 0.006, y, 0.12), LIGHT, "body")
        b.box(
            (0.015, 0.014, 0.14),
            (depth / 2 + 0.0195, y + (0.5 - column % 2) * 0.8 * each, height * 0.5),
            "metal",
            "body",
        )
    b.support((0, 0), (depth, width), height)


@category("dresser", {}, {"width": 0.8, "rows": 4}, {"width": 1.4}, access=0.5)
def dresser(b: ShapeBuilder, width: float = 1.0, rows: int = 3, depth: float = 0.45) -> None:
    """Build a chest of drawers."""
    height = 0.1 + rows * 0.24
    legs(b, (depth, width), 0.1, 0.06, DARK, "body")
    b.box((depth, width, height - 0.1), (0, 0, 0.1), MAIN, "body")
    columns = 2 if width > 0.9 else 1
    for column in range(columns):
        for row in range(rows):
            y = (column + 0.5) * width / columns - width / 2
            b.box((0.014, width / columns - 0.03, 0.21), (depth / 2 + 0.007, y, 0.115 + row * 0.24), LIGHT, "body")
            b.box((0.02, 0.12, 0.018), (depth / 2 + 0.024, y, 0.21 + row * 0.24), "metal", "body")
    b.support((0, 0), (depth, width), height)


@category("nightstand", {}, {"width": 0.5}, colors=WOOD)
def nightstand(b: ShapeBuilder, width: float = 0.42) -> None:
    """Build a small chest with two drawers."""
    legs(b, (0.38, width - 0.02), 0.12, 0.035, DARK, "body")
    b.box((0.4, width, 0.4), (0, 0, 0.12), MAIN, "body")
    _drawers = ((0.13, 0.18), (0.33, 0.17))
    for z, height in _drawers:
        b.box((0.012, width - 0.03, height), (0.206, 0, z), LIGHT, "body")
        b.ball(0.013, (0.22, 0, z + height / 2), "metal", "body", sides=6)
    b.support((0, 0), (0.4, width), 0.52)


@category("wardrobe", {}, {"width": 1.5}, {"width": 0.9}, access=0.6)
def wardrobe(b: ShapeBuilder, width: float = 1.2, height: float = 2.0) -> None:
    """Build a wardrobe."""
    b.box((0.54, width - 0.04, 0.08), (0, 0, 0), DARK, "body")
    b.box((0.56, width, height - 0.08), (0, 0, 0.08), MAIN, "body")
    columns = round(width / 0.5)
    for column in range(columns):
        each = width / columns
        y = (column + 0.5) * each - width / 2
        b.box((0.02, each - 0.012, height - 0.14), (0.29, y, 0.11), LIGHT, "body")
        b.box((0.02, 0.02, 0.3), (0.31, y + (0.5 - column % 2) * (each - 0.12), 0.95), "metal", "body")
    b.box((0.6, width + 0.02, 0.03), (0.01, 0, height), DARK, "body")


@category(
    "filing cabinet", {}, {"rows": 3}, {"rows": 2}, colors=("gray", "white", "black", "blue", "green"), access=0.5
)
def filing_cabinet(b: ShapeBuilder, rows: int = 4) -> None:
    """Build a metal cabinet of drawers."""
    height = 0.04 + rows * 0.31
    b.box((0.6, 0.45, height), (0, 0, 0), MAIN, "body")
    for row in range(rows):
        b.box((0.015, 0.42, 0.28), (0.3075, 0, 0.04 + row * 0.31), LIGHT, "body")
        b.box((0.015, 0.14, 0.02), (0.3225, 0, 0.22 + row * 0.31), "dark metal", "body")
        b.box((0.004, 0.09, 0.04), (0.317, 0, 0.26 + row * 0.31), "paper", "body")
    b.support((0, 0), (0.6, 0.45), height)


@category("tool cabinet", {}, {"rows": 5}, colors=("red", "blue", "black", "yellow"), access=0.5)
def tool_cabinet(b: ShapeBuilder, rows: int = 4) -> None:
    """Build a metal chest of drawers on casters."""
    height = 0.14 + rows * 0.16
    for x in (-0.17, 0.17):
        for y in (-0.27, 0.27):
            b.cylinder(0.05, 0.04, (x, y - 0.02, 0.05), "plastic", "body", axis="y", sides=10)
    b.box((0.46, 0.68, height - 0.1), (0, 0, 0.1), MAIN, "body")
    for row in range(rows):
        b.box((0.012, 0.62, 0.135), (0.236, 0, 0.13 + row * 0.16), DARK, "body")
        b.box((0.016, 0.5, 0.018), (0.25, 0, 0.23 + row * 0.16), "metal", "body")
    b.support((0, 0), (0.46, 0.68), height)


@category("crate", {}, {"size": 0.5}, {"size": 0.35}, colors=("brown", "beige"), movable=True)
def crate(b: ShapeBuilder, size: float = 0.42) -> None:
    """Build a wooden crate of slats."""
    height = size * 0.75
    b.box((size - 0.02, size - 0.02, height), (0, 0, 0), DARK)
    for number in range(3):
        z = height * number * 0.33
        b.box((size, size, height * 0.26), (0, 0, z), MAIN)
    for x in (-1, 1):
        for y in (-1, 1):
            b.box((0.05, 0.05, height - 0.004), (x * (size / 2 - 0.02), y * (size / 2 - 0.02), 0), "pine")
    b.support((0, 0), (size - 0.06, size - 0.06), height)


@category(
    "box", {"size": 0.3}, {"size": 0.4}, {"size": 0.22}, {"size": 0.5}, colors=("brown", "beige", "white"), movable=True
)
def box(b: ShapeBuilder, size: float = 0.4) -> None:
    """Build a closed cardboard box with a strip of tape."""
    width = size * 0.4 - 0.025
    for side in (-1, 1):
        b.box((size, width, size * 0.6), (0, side * (0.025 + width / 2), 0), MAIN)
    b.box((size + 0.002, 0.05, size * 0.6), (0, 0, 0), "cardboard line")
    b.support((0, 0), (size, size * 0.8), size * 0.6)


@category("basket", {}, {"radius": 0.16}, colors=("beige", "brown", "white", "gray"), movable=True)
def basket(b: ShapeBuilder, radius: float = 0.2) -> None:
    """Build an open round basket."""
    r, h = radius, radius * 1.4
    b.lathe([(0, 0), (r * 0.8, 0), (r, h), (r * 0.93, h), (r * 0.75, 0.02), (0, 0.02)], (0, 0, 0), MAIN, sides=16)
    b.lathe(
        [(r * 1.0, h - 0.03), (r * 1.03, h - 0.015), (r, h), (r * 0.95, h - 0.015), (r * 1.0, h - 0.03)],
        (0, 0, 0),
        DARK,
        sides=16,
    )


@category("trash bin", {}, {"radius": 0.12}, colors=("gray", "black", "white", "blue", "green"), movable=True)
def trash_bin(b: ShapeBuilder, radius: float = 0.14) -> None:
    """Build an open bin."""
    r, h = radius, radius * 2.3
    b.lathe([(0, 0), (r * 0.75, 0), (r, h), (r * 0.95, h), (r * 0.7, 0.02), (0, 0.02)], (0, 0, 0), MAIN, sides=14)


@category("suitcase", colors=BRIGHT + ("black", "gray"), movable=True)
def suitcase(b: ShapeBuilder) -> None:
    """Build an upright suitcase on wheels with a handle."""
    for y in (-0.15, 0.15):
        b.box((0.2, 0.05, 0.04), (0, y, 0), "plastic")
    b.cushion((0.24, 0.42, 0.58), (0, 0, 0.04), MAIN, radius=0.05)
    for y in (-0.1, 0.0, 0.1):
        b.box((0.25, 0.02, 0.5), (0, y, 0.08), DARK)
    b.box((0.02, 0.02, 0.1), (0, -0.09, 0.62), "metal")
    b.box((0.02, 0.02, 0.1), (0, 0.09, 0.62), "metal")
    b.box((0.03, 0.2, 0.025), (0, 0, 0.71), "plastic")


@category("bucket", colors=EVERY_COLOR, movable=True)
def bucket(b: ShapeBuilder) -> None:
    """Build a bucket with an upright handle."""
    b.lathe([(0, 0), (0.1, 0), (0.14, 0.27), (0.132, 0.27), (0.095, 0.015), (0, 0.015)], (0, 0, 0), MAIN, sides=14)
    for side in (-1, 1):
        b.box((0.01, 0.01, 0.12), (0, side * 0.135, 0.25), "metal")
    b.box((0.012, 0.28, 0.012), (0, 0, 0.37), "metal")
