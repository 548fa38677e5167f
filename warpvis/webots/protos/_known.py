# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes of Webots' furniture, cars and small robots, for box stand-ins where PROTO files are not available.

Sizes are those of the bounding objects in the PROTO files of R2021c to R2023b, without their tilts, or, where these are
too coarse, the sizes in the files' descriptions. Axes are those since R2022a: x forward, z up.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.webots._nodes import Node, new_node

_Sides: TypeAlias = tuple[float, float, float]
Vector: TypeAlias = Sequence[float] | NDArray[np.float64]
Ahead: TypeAlias = Literal["x", "-x", "-z", "z"]
Piece: TypeAlias = tuple[_Sides, _Sides]
"""A box: size and center [m]."""


@dataclass(frozen=True)
class Known:
    """The stand-in of a PROTO."""

    pieces: tuple[Piece, ...]  # its boxes
    ahead: Ahead = "x"  # the axis before R2022a (y up) that corresponds to x; it differs between PROTOs
    name: str = ""  # its default name, if it differs from its type in words
    translation: _Sides = (0.0, 0.0, 0.0)  # its default translation since R2022a [m]
    old_lift: float = 0.0  # how much lower its boxes were relative to its origin before R2022a [m]
    robot: bool = False  # whether it is a robot, even without a field `controller`


def _boxes(*boxes: str) -> tuple[Piece, ...]:
    """Parse boxes of six numbers: size and center."""
    rows = [tuple(map(float, box.split())) for box in boxes]
    return tuple(((x, y, z), (right, left, up)) for x, y, z, right, left, up in rows)


def _standing(across: float, along: float, up: float) -> tuple[Piece, ...]:
    """Build a box whose bottom is at the origin."""
    return (((across, along, up), (0.0, 0.0, up / 2)),)


def _feet(x: float, y: float, size: _Sides) -> tuple[Piece, ...]:
    """Build four equal feet at (+-x, +-y)."""
    return tuple((size, (one * x, other * y, size[2] / 2)) for one in (-1, 1) for other in (-1, 1))


def _seat(width: float) -> tuple[Piece, ...]:
    """Build an armchair or a sofa: seat, two arms, back and cushion, on four feet."""
    inside, arm = width - 0.4, width / 2 - 0.1
    return (
        ((1.0, inside, 0.35), (0.0, 0.0, 0.275)),
        *(((1.0, 0.2, 0.6), (0.0, side * arm, 0.4)) for side in (-1, 1)),
        ((0.1, inside, 0.25), (-0.45, 0.0, 0.575)),
        ((0.19, inside, 0.39), (-0.305, 0.0, 0.6)),
        *_feet(0.35, arm - 0.05, (0.1, 0.1, 0.1)),
    )


_EPUCK = Known(_boxes("0.066 0.066 0.045 0 0 0.025", "0.05 0.04 0.01 0 0 0.0051"), "-z", name="e-puck", robot=True)
_CARS = {  # the origin is between the rear wheels
    "BmwX5": _boxes("4.5 1.8 1.6 1.35 0 0.7"),
    "CitroenCZero": _boxes("3.3 1.4 1.5 1.25 0 0.5"),
    "LincolnMKZ": _boxes("4.9 1.8 0.8 1.44 0 0.3", "2 1.6 0.5 1.44 0 0.85"),
    "RangeRoverSportSVR": _boxes("4.5 1.8 0.8 1.25 0 0.35", "2.7 1.5 0.75 0.6 0 0.85"),
    "TeslaModel3": _boxes("4.5 1.8 0.7 1.37 0 0.21", "2.9 1.5 0.7 0.68 0 0.76"),
    "ToyotaPrius": _boxes("4.2 1.8 1.4 1.4 0 0.6"),
}

KNOWN: dict[str, Known] = {
    "Armchair": Known(_seat(1.1)),
    "BathroomSink": Known(
        _boxes(
            "0.35 0.7 0.105 0.176 0.005 0.0095", "0.42 0.42 0.18 0.23 0.005 0.07", "0.05 0.05 0.28 0.075 0.204 0.19"
        ),
        name="sink",
        translation=(0.0, 0.0, 0.05),
    ),
    "Bathtube": Known(_boxes("0.93 1.9 0.24 -0.03 0.01 0.37", "0.68 1.55 0.24 -0.01 0 0.13")),
    "Bed": Known(
        (
            *_boxes("2.1 1.75 0.4 0 0 0.45", "0.1 1.75 0.83 1.01 0 0.42"),
            *_boxes("0.1 1.75 1.25 -1.01 0 0.63", "0.54 1.33 0.3 -0.71 0 0.79"),
        ),
        "-x",
    ),
    "Can": Known(_boxes("0.0635 0.0635 0.1222 0 0 0"), translation=(0.0, 0.0, 0.06)),
    "Carafe": Known(_boxes("0.132 0.132 0.116 0.036 0 0.059", "0.106 0.106 0.068 0.0365 0 0.142"), "-z"),
    "Chair": Known(
        (*_boxes("0.5 0.5 0.1 0 0 0.45", "0.06 0.5 0.5 -0.237 0 0.75"), *_feet(0.22, 0.22, (0.06, 0.06, 0.4)))
    ),
    "Desk": Known((*_boxes("0.7 1.2 0.02 0 0 0.7"), *_feet(0.269, 0.535, (0.046, 0.046, 0.69))), "-z"),
    "DesktopComputer": Known(_boxes("0.34328 0.168 0.357 0 0 0.179")),
    "E-puck": _EPUCK,
    "EPuck": _EPUCK,
    "Fridge": Known(_standing(0.7, 0.7, 1.8)),
    "HotPlate": Known(_boxes("0.37 0.416 0.0027 0.112 0 0.031"), "-z", translation=(0.0, 0.0, -0.03)),
    "Keyboard": Known(_boxes("0.13428 0.41 0.01 0 0 0"), "-z"),
    "Monitor": Known(
        _boxes(
            "0.01176 0.469 0.24738 0 0 0.225", "0.131 0.075 0.023 0.013 0 0.011", "0.037 0.073 0.132 -0.029 0 0.086"
        ),
        "-z",
    ),
    "OfficeChair": Known(_standing(0.54, 0.43, 0.98)),
    "Oven": Known(_standing(0.5, 0.44, 0.68), old_lift=0.34),
    "PottedTree": Known(_standing(0.3, 0.3, 1.3)),
    "RoundTable": Known(_boxes("2 2 0.02 0 0 0.75", "0.09 0.09 0.68 0 0 0.4", "0.5 0.5 0.06 0 0 0.03")),
    "Sink": Known(
        (
            *_boxes(
                "0.03 0.44 0.062 0.27 0 -0.004", "0.03 0.44 0.062 -0.07 0 -0.004", "0.37 0.045 0.062 0.1 0.198 -0.004"
            ),
            *_boxes("0.37 0.045 0.062 0.1 -0.198 -0.004", "0.37 0.44 0.004 0.1 0 -0.037"),
        ),
        "-z",
    ),
    "Sofa": Known(_seat(1.8)),
    "Television": Known(_boxes("0.1 1 0.6 0 0 0"), robot=True),
    "Toilet": Known(
        _boxes("0.51 0.48 0.22 0.048 0 0.35", "0.5 0.36 0.24 -0.04 0 0.12", "0.22 0.58 0.78 -0.32 -0.01 0.628")
    ),
    "TrafficCone": Known(
        _boxes("0.5 0.5 0.015 0 0 0.015", "0.18 0.18 0.37 -0.01 -0.005 0.22", "0.07 0.07 0.44 -0.01 -0.005 0.29")
    ),
    "TurtleBot3Burger": Known(
        _boxes("0.097 0.137 0.1425 -0.032 0 0.08", "0.135 0.095 0.143 -0.032 0 0.08"),
        "-z",
        name="TurtleBot3Burger",
        robot=True,
    ),
    "WashingMachine": Known(_boxes("0.73 0.77 1.05 0 0 0"), name="whashing machine", translation=(0.0, 0.0, 0.53)),
    "WoodenChair": Known(_standing(0.42, 0.44, 0.944), "-z"),
    **{
        name + simple: Known(boxes, "z", "vehicle", translation=(0.0, 0.0, 0.4), robot=True)
        for name, boxes in _CARS.items()
        for simple in ("", "Simple")
    },
}
"""Stand-ins by PROTO name."""


def known_shapes(node: Node, known: Known) -> list[Node]:
    """Build the boxes of an instance, in the axes of its version."""
    lift = 0.0 if node.version.z_up else known.old_lift
    boxes = [
        (in_axes(node, size, known.ahead), in_axes(node, (x, y, z - lift), known.ahead))
        for size, (x, y, z) in known.pieces
    ]
    return [box_at(node, [*map(abs, size)], place) for size, place in boxes]


def in_axes(node: Node, place: Vector, ahead: Ahead) -> _Sides:
    """Convert a position or size to the axes of a node's version; `ahead` is the axis before R2022a for x."""
    x, y, z = place
    if node.version.z_up:
        return x, y, z
    return {"x": (x, z, -y), "-x": (-x, z, y), "-z": (-y, z, -x), "z": (y, z, x)}[ahead]


def numbers(values: Iterable[float]) -> list[float | str | bool | Node]:
    """Convert numbers to the value of a field."""
    return [float(value) for value in values]


def solid_of(
    node: Node,
    children: Iterable[Node],
    default_name: str = "",
    copied: Sequence[str] = ("translation", "rotation", "recognitionColors"),
) -> Node:
    """Build a Solid in place of an instance, with its name and the fields in `copied`."""
    fields = {field: node.fields[field] for field in copied if field in node.fields}
    if default_name or "name" in node.fields:
        fields["name"] = [node.text("name", default_name)]
    return new_node(node, "Solid", {**fields, "children": [*children]}, node.name)


def box_at(node: Node, size: Vector, place: Vector = (0.0, 0.0, 0.0)) -> Node:
    """Build a Shape of a Box centered on a position."""
    return shape_at(node, new_node(node, "Box", {"size": numbers(size)}), place)


def shape_at(node: Node, geometry: Node, place: Vector = (0.0, 0.0, 0.0)) -> Node:
    """Build a Shape of a geometry centered on a position."""
    shape = new_node(node, "Shape", {"geometry": geometry})
    return new_node(node, "Pose", {"translation": numbers(place), "children": [shape]}) if any(place) else shape
