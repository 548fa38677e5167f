# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Screens, lamps, computers, tools and laboratory ware."""

from __future__ import annotations

from warpvis.situations.rooms.shapes._builder import ShapeBuilder
from warpvis.situations.rooms.shapes._colors import DARK, LIGHT, MAIN
from warpvis.situations.rooms.shapes._registry import BRIGHT, EVERY_COLOR, category

DEVICE = ("black", "gray", "white")


@category("monitor", {}, {"width": 0.6}, colors=("black", "gray", "white"), mount="support", movable=True)
def monitor(b: ShapeBuilder, width: float = 0.54) -> None:
    """Build a monitor on a stand."""
    height = width * 0.6
    b.box((0.2, 0.24, 0.015), (0, 0, 0), MAIN, "foot")
    b.box((0.03, 0.06, 0.3), (-0.04, 0, 0.01), MAIN, "stand")
    b.box((0.03, width, height), (0, 0, 0.12), MAIN, "screen")
    b.box((0.002, width - 0.03, height - 0.03), (0.016, 0, 0.135), "screen light", "screen")
    b.box((0.001, width * 0.4, height * 0.5), (0.0175, -width * 0.2, 0.17), "paper", "screen")


@category("laptop", {}, colors=DEVICE, mount="support", movable=True)
def laptop(b: ShapeBuilder) -> None:
    """Build an open laptop; x points to the user."""
    b.box((0.23, 0.33, 0.016), (0, 0, 0), MAIN)
    b.box((0.1, 0.29, 0.001), (-0.03, 0, 0.016), "burner")
    b.box((0.06, 0.1, 0.001), (0.075, 0, 0.016), DARK)
    for number in range(4):  # the screen leans back
        x = -0.112 - number * 0.016
        b.box((0.0175, 0.33, 0.0515), (x, 0, 0.012 + number * 0.05), MAIN)
        b.box((0.002, 0.3, 0.05), (x + 0.009, 0, 0.014 + number * 0.05), "screen light")


@category("keyboard", colors=DEVICE, mount="support", movable=True)
def keyboard(b: ShapeBuilder) -> None:
    """Build a keyboard; x points to the user."""
    b.box((0.14, 0.44, 0.016), (0, 0, 0), MAIN)
    for row in range(4):
        b.box((0.022, 0.41, 0.006), (-0.05 + row * 0.03, 0, 0.016), LIGHT if row != 3 else DARK)


@category("mouse", colors=DEVICE + ("red", "blue"), mount="support", movable=True)
def mouse(b: ShapeBuilder) -> None:
    """Build a computer mouse."""
    b.cushion((0.11, 0.062, 0.034), (0, 0, 0), MAIN, radius=0.016)


@category("phone", colors=("black", "white", "red", "blue", "pink"), mount="support", movable=True)
def phone(b: ShapeBuilder) -> None:
    """Build a mobile phone that lies flat."""
    b.box((0.15, 0.073, 0.008), (0, 0, 0), MAIN)
    b.box((0.142, 0.066, 0.0006), (0, 0, 0.008), "screen")


@category("printer", colors=DEVICE, mount="support", movable=True)
def printer(b: ShapeBuilder) -> None:
    """Build a printer."""
    b.cushion((0.36, 0.44, 0.22), (-0.04, 0, 0), MAIN, radius=0.03)
    b.box((0.14, 0.3, 0.015), (0.2, 0, 0.05), DARK)
    b.box((0.12, 0.22, 0.004), (0.19, 0, 0.065), "paper")
    b.box((0.2, 0.36, 0.01), (-0.06, 0, 0.22), DARK)
    b.box((0.05, 0.12, 0.004), (0.09, 0.12, 0.219), "screen light")


@category("television", {}, {"width": 1.2}, colors=("black", "gray"), mount="support", movable=True)
def television(b: ShapeBuilder, width: float = 1.0) -> None:
    """Build a television on two feet."""
    height = width * 0.57
    for side in (-1, 1):
        b.box((0.2, 0.03, 0.02), (0, side * width * 0.32, 0), "plastic", "feet")
        b.box((0.03, 0.03, 0.06), (0, side * width * 0.32, 0.02), "plastic", "feet")
    b.box((0.05, width, height), (0, 0, 0.07), MAIN, "screen")
    b.box((0.004, width - 0.03, height - 0.04), (0.027, 0, 0.09), "screen", "screen")


@category("speaker", colors=("black", "gray", "brown", "white"), mount="support", movable=True)
def speaker(b: ShapeBuilder) -> None:
    """Build a loudspeaker."""
    b.box((0.18, 0.16, 0.27), (0, 0, 0), MAIN)
    for z, radius in ((0.09, 0.06), (0.2, 0.03)):
        b.cylinder(radius, 0.008, (0.09, 0, z), "burner", axis="x", sides=14)
        b.cylinder(radius * 0.4, 0.005, (0.098, 0, z), "metal", axis="x", sides=10)


@category("lamp", {}, {"height": 0.5}, colors=EVERY_COLOR, mount="support", movable=True)
def lamp(b: ShapeBuilder, height: float = 0.42) -> None:
    """Build a table lamp with a conical shade."""
    b.cylinder(0.075, 0.02, (0, 0, 0), MAIN, sides=14)
    b.cylinder(0.014, height - 0.16, (0, 0, 0.02), "metal", sides=8)
    b.lathe(
        [(0.13, height - 0.18), (0.08, height), (0.076, height), (0.126, height - 0.18), (0.13, height - 0.18)],
        (0, 0, 0),
        LIGHT,
        sides=16,
    )
    b.ball(0.035, (0, 0, height - 0.13), "glow", sides=8)


@category("floor lamp", {}, {"height": 1.7}, colors=EVERY_COLOR, movable=True)
def floor_lamp(b: ShapeBuilder, height: float = 1.55) -> None:
    """Build a floor lamp with a cylindrical shade."""
    b.cylinder(0.15, 0.025, (0, 0, 0), "dark metal", "foot", sides=16)
    b.cylinder(0.015, height - 0.3, (0, 0, 0.025), "dark metal", "pole", sides=8)
    b.lathe(
        [(0.2, height - 0.3), (0.15, height), (0.146, height), (0.196, height - 0.3), (0.2, height - 0.3)],
        (0, 0, 0),
        MAIN,
        "shade",
        sides=18,
    )
    b.ball(0.05, (0, 0, height - 0.2), "glow", "shade", sides=8)


@category("ceiling lamp", {}, {"panel": True}, colors=("white", "gray", "black", "yellow"), mount="ceiling")
def ceiling_lamp(b: ShapeBuilder, panel: bool = False) -> None:
    """Build a flat lamp that touches the ceiling: a round one, or a rectangular panel."""
    if panel:
        b.box((0.6, 0.6, 0.04), (0, 0, 0.012), MAIN)
        b.box((0.56, 0.56, 0.012), (0, 0, 0), "glow")
    else:
        b.lathe([(0, 0), (0.12, 0.01), (0.2, 0.05), (0.2, 0.06), (0, 0.06)], (0, 0, 0), "glow", sides=20)
        b.cylinder(0.21, 0.025, (0, 0, 0.06), MAIN, sides=20)


@category("hammer", colors=("red", "brown", "yellow", "blue"), mount="support", movable=True)
def hammer(b: ShapeBuilder) -> None:
    """Build a hammer that lies on its side, with the handle along x."""
    b.box((0.22, 0.026, 0.022), (0.02, 0, 0.001), MAIN)
    b.box((0.06, 0.018, 0.018), (-0.12, 0, 0.003), "oak")
    b.box((0.03, 0.11, 0.026), (-0.15, 0, 0), "metal")


@category("screwdriver", colors=("red", "yellow", "blue", "green", "orange"), mount="support", movable=True)
def screwdriver(b: ShapeBuilder) -> None:
    """Build a screwdriver along x."""
    b.cylinder(0.016, 0.1, (0, 0, 0.016), MAIN, axis="x", sides=8)
    b.cylinder(0.004, 0.11, (-0.11, 0, 0.016), "metal", axis="x", sides=6)


@category("drill", colors=("yellow", "red", "blue", "green", "turquoise"), mount="support", movable=True)
def drill(b: ShapeBuilder) -> None:
    """Build a cordless drill that stands on its battery."""
    b.box((0.12, 0.075, 0.05), (-0.02, 0, 0), "plastic")
    b.box((0.04, 0.035, 0.11), (-0.04, 0, 0.05), MAIN)
    b.cylinder(0.034, 0.16, (-0.08, 0, 0.185), MAIN, axis="x", sides=12)
    b.cylinder(0.022, 0.05, (0.08, 0, 0.185), "plastic", axis="x", top=0.012, sides=10)
    b.cylinder(0.004, 0.06, (0.13, 0, 0.185), "metal", axis="x", sides=6)


@category("toolbox", colors=("red", "blue", "yellow", "black", "green"), mount="support", movable=True)
def toolbox(b: ShapeBuilder) -> None:
    """Build a closed toolbox with a handle."""
    b.box((0.22, 0.44, 0.14), (0, 0, 0), MAIN)
    b.box((0.23, 0.45, 0.02), (0, 0, 0.13), DARK)
    b.box((0.18, 0.42, 0.05), (0, 0, 0.15), MAIN)
    for side in (-1, 1):
        b.box((0.02, 0.02, 0.06), (0, side * 0.1, 0.2), "plastic")
        b.box((0.012, 0.04, 0.05), (0.117, side * 0.13, 0.11), "metal")
    b.box((0.025, 0.24, 0.02), (0, 0, 0.26), "plastic")


@category("microscope", colors=("white", "gray", "black"), mount="support", movable=True)
def microscope(b: ShapeBuilder) -> None:
    """Build a microscope; x points to the user."""
    b.box((0.2, 0.15, 0.03), (0, 0, 0), MAIN)
    b.box((0.05, 0.06, 0.28), (-0.07, 0, 0.03), MAIN)
    b.box((0.14, 0.12, 0.015), (0.0, 0, 0.12), "plastic")
    b.box((0.15, 0.06, 0.05), (0.0, 0, 0.27), MAIN)
    b.cylinder(0.022, 0.1, (0.03, 0, 0.17), "metal", sides=10, top=0.03)
    for side in (-1, 1):
        b.loft([(0.3, 0.016, 0.016, 0.05, side * 0.03), (0.38, 0.018, 0.018, 0.11, side * 0.03)], "plastic", sides=8)


@category(
    "flask",
    {},
    {"radius": 0.04},
    colors=("blue", "green", "orange", "yellow", "purple", "pink"),
    mount="support",
    movable=True,
)
def flask(b: ShapeBuilder, radius: float = 0.055) -> None:
    """Build a conical flask that is filled with a liquid."""
    r, h = radius, radius * 2.6
    b.lathe([(0, 0), (r, 0), (r, 0.008), (r * 0.62, h * 0.4), (0, h * 0.4)], (0, 0, 0), MAIN, sides=16)
    rows = [(0, h * 0.4), (r * 0.62, h * 0.4), (r * 0.3, h * 0.72), (r * 0.3, h * 0.96), (r * 0.38, h), (0, h)]
    b.lathe(rows, (0, 0, 0), "glass", sides=16)


@category(
    "beaker",
    {},
    {"radius": 0.045, "height": 0.12},
    colors=("white", "blue", "green", "turquoise"),
    mount="support",
    movable=True,
)
def beaker(b: ShapeBuilder, radius: float = 0.036, height: float = 0.09) -> None:
    """Build a beaker, which is opaque here."""
    r, h = radius, height
    b.lathe(
        [(0, 0), (r, 0), (r, h), (r * 1.08, h), (r * 0.94, h - 0.004), (r * 0.94, 0.01), (0, 0.01)],
        (0, 0, 0),
        LIGHT,
        sides=16,
    )
    b.cylinder(r * 0.93, h * 0.4, (0, 0, 0.01), DARK, sides=14)


@category("test tube rack", colors=("white", "blue", "red", "green"), mount="support", movable=True)
def test_tube_rack(b: ShapeBuilder) -> None:
    """Build a rack with five test tubes."""
    for z in (0, 0.07):
        b.box((0.07, 0.22, 0.01), (0, 0, z), MAIN)
    for side in (-1, 1):
        b.box((0.07, 0.01, 0.08), (0, side * 0.11, 0), MAIN)
    for number in range(5):
        b.cylinder(0.011, 0.13, (0, (number - 2) * 0.038, 0.01), "glass", sides=8)
        b.cylinder(0.012, 0.015, (0, (number - 2) * 0.038, 0.14), BRIGHT[number], sides=8)


@category("centrifuge", colors=("white", "gray", "blue"), mount="support", movable=True)
def centrifuge(b: ShapeBuilder) -> None:
    """Build a laboratory centrifuge."""
    b.cushion((0.4, 0.36, 0.24), (0, 0, 0), MAIN, radius=0.05)
    b.cylinder(0.14, 0.03, (-0.03, 0, 0.24), DARK, sides=18)
    b.box((0.012, 0.22, 0.06), (0.2, 0, 0.1), "screen light")
