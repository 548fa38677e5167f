# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for Webots' lamps without a file: their light, a glowing bulb, and a simple support.

Lights, bulbs and bounding boxes are those of the PROTO files in projects/objects/lights/protos (R2019b to R2024a), in
axes since R2022a; fields of R2018b are those of the user guide. A light is inside of its bulb, which does not block it
in Webots. Here, a light that casts shadows is moved below it, and the light of a FloorLight casts none.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

from warpvis.webots._nodes import Node, Value, Version, new_node
from warpvis.webots.protos._appearances import field_appearance, plain_appearance
from warpvis.webots.protos._standins import box_at, in_axes, numbers, shape_at, solid_of

_Vector = tuple[float, float, float]
_DOWN, _AHEAD = (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)
_INVERSE_SQUARE, _CONSTANT = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)  # attenuation; up to R2018b, it is a field


class _Lamp(NamedTuple):
    name: str
    kind: Literal["Point", "Spot"]
    location: _Vector  # of the light [m]
    outside: _Vector | None  # where it is if it casts shadows [m]; None if it then casts none
    bulb: tuple[float, float] = (0.0, 0.0)  # height and radius of a sphere [m]; none if 0
    rods: tuple[_Vector, ...] = ()  # lower and upper end and radius of the cylinders of its support [m]
    box: tuple[_Vector, _Vector] | None = None  # size and center of its support [m]
    direction: _Vector = _DOWN  # of a spot
    cone: tuple[float, float] = (0.0, 0.0)  # beam width and cut-off angle of a spot [rad]
    intensity: float = 1.0
    height: float = 0.0  # of the origin by default [m]


LAMPS: dict[str, _Lamp] = {
    "CeilingLight": _Lamp(
        *("ceiling light", "Point", (0.0, 0.0, -0.6), (0.0, 0.0, -0.71), (-0.55, 0.15)),
        rods=((-0.408, 0.0, 0.02), (-0.03, 0.0, 0.07)),
        height=2.4,
    ),
    "CeilingSpotLight": _Lamp(
        *("ceiling light", "Spot", (0.0, 0.0, -0.038), (0.0, 0.0, -0.05)),
        rods=((-0.04, 0.04, 0.05),),
        cone=(0.3, 0.48),
        height=1.0,
    ),
    "ConstructionLamp": _Lamp(
        *("construction lamp", "Spot", (0.007, 0.0, 0.005), (0.07, 0.0, 0.005)),
        box=((0.07, 0.155, 0.12), (0.03, 0.005, 0.0)),
        direction=_AHEAD,
        cone=(0.2, 1.0),
        intensity=2.0,
        height=0.07,
    ),
    "FloorLight": _Lamp(
        *("floor light", "Point", (0.0, 0.0, 1.5), None, (1.524, 0.19)),
        rods=((0.0, 0.05, 0.15), (0.05, 1.328, 0.02)),
    ),
}
"""Lamps by PROTO."""


def expand_lamp(node: Node) -> Node | None:
    """Build the stand-in of a lamp; return None for other types."""
    if node.type not in LAMPS:
        return None
    lamp = LAMPS[node.type]
    name = f"{lamp.kind.lower()}Light"
    color, intensity = node.vector(f"{name}Color", (1.0, 1.0, 1.0)), node.number(f"{name}Intensity", lamp.intensity)
    outside = lamp.outside if node.flag(f"{name}CastShadows", False) else None
    attenuation = _INVERSE_SQUARE if node.version >= Version(2019, 1) else _CONSTANT
    light: dict[str, Value] = {
        "location": numbers(in_axes(node, outside or lamp.location, "z")),
        "ambientIntensity": [node.number(f"{name}AmbientIntensity", 0.0)],
        "attenuation": numbers(node.vector(f"{name}Attenuation", attenuation)),
        "color": numbers(color),
        "intensity": [intensity],
        "radius": [node.number(f"{name}Radius", 100.0)],
        "castShadows": [outside is not None],
    }
    if lamp.kind == "Spot":
        light["direction"] = numbers(in_axes(node, lamp.direction, "z"))
        light |= {"beamWidth": [lamp.cone[0]], "cutOffAngle": [lamp.cone[1]]}
    solid = solid_of(node, [new_node(node, f"{lamp.kind}Light", light), *_shapes(node, lamp, light)], lamp.name)
    solid.fields.setdefault("translation", numbers(in_axes(node, (0.0, 0.0, lamp.height), "z")))
    return solid


def _shapes(node: Node, lamp: _Lamp, light: dict[str, Value]) -> list[Node]:
    """Build support and bulb."""
    gray = plain_appearance(node, tuple((0.5 * node.vector("supportColor", (1.0, 1.0, 1.0))).tolist()))
    support = field_appearance(node, "supportAppearance") or gray
    shapes = []
    if lamp.box is not None:
        size, place = (in_axes(node, row, "z") for row in lamp.box)
        shapes.append(box_at(node, size, place, support))
    for low, high, radius in lamp.rods:
        rod = new_node(node, "Cylinder", {"radius": [radius], "height": [high - low]})
        shapes.append(shape_at(node, rod, in_axes(node, (0.0, 0.0, (low + high) / 2), "z"), support))
    height, radius = lamp.bulb
    if radius:
        glow = plain_appearance(node, tuple(node.vector("bulbColor", (1.0, 1.0, 1.0)).tolist()))
        glow.fields |= {"emissiveColor": light["color"], "emissiveIntensity": light["intensity"]}
        ball = new_node(node, "Sphere", {"radius": [radius], "subdivision": [3.0]})
        shapes.append(shape_at(node, ball, in_axes(node, (0.0, 0.0, height), "z"), glow))
    return shapes
