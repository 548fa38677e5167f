# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for PROTOs without a file that are not in `BUILTIN`: furniture, cars, people, boxes, and depth cameras.

Sizes of furniture, cars and small robots are those of the bounding objects in the PROTO files of R2021c to R2023b,
without their tilts, or, where these are too coarse, the sizes in the files' descriptions; axes are those since R2022a:
x forward, z up. A pedestrian's limbs are placed like its bounding objects in Webots R2022b to R2023b. Fields of depth
cameras are those of Webots' user guide (https://cyberbotics.com/doc/guide, the pages Range-Finder Sensors and Camera
Sensors); positions were measured on the nodes that the PROTO files of R2021c to R2025a expand to.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import FileFormatError
from warpvis.webots._nodes import Node, Value, Version, new_node
from warpvis.webots.protos._appearances import object_appearance, plain_appearance

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
    """Build a Solid that replaces an instance, with its name and the fields in `copied`."""
    fields = {field: node.fields[field] for field in copied if field in node.fields}
    if default_name or "name" in node.fields:
        fields["name"] = [node.text("name", default_name)]
    return new_node(node, "Solid", {**fields, "children": [*children]}, node.name)


def box_at(node: Node, size: Vector, place: Vector = (0.0, 0.0, 0.0), appearance: Node | None = None) -> Node:
    """Build a Shape of a Box centered on a position; see `shape_at`."""
    return shape_at(node, new_node(node, "Box", {"size": numbers(size)}), place, appearance)


def shape_at(node: Node, geometry: Node, place: Vector = (0.0, 0.0, 0.0), appearance: Node | None = None) -> Node:
    """Build a Shape of a geometry centered on a position, by default with the appearance of the whole instance."""
    appearance = object_appearance(node) if appearance is None else appearance
    fields: dict[str, Value] = {"geometry": geometry}
    shape = new_node(node, "Shape", fields if appearance is None else {**fields, "appearance": appearance})
    return new_node(node, "Pose", {"translation": numbers(place), "children": [shape]}) if any(place) else shape


# Capsules of a pedestrian with hanging arms: end points (across, along, up) relative to the origin, radius [m].
_LIMBS = (
    ((0.0, 0.0, 0.15), (0.0, 0.0, -0.12), 0.17),  # torso
    ((0.01, 0.0, 0.36), (0.01, 0.0, 0.26), 0.07),  # neck
    ((0.04, 0.0, 0.45), (0.04, 0.0, 0.43), 0.12),  # head
    *(((-0.02, 0.24 * side, 0.2), (-0.03, 0.26 * side, -0.07), 0.07) for side in (-1, 1)),  # upper arms
    *(((-0.04, 0.25 * side, -0.13), (-0.03, 0.25 * side, -0.48), 0.05) for side in (-1, 1)),  # lower arms
    *(((-0.03, 0.116 * side, -0.25), (-0.04, 0.116 * side, -0.76), 0.09) for side in (-1, 1)),  # upper legs
    *(((-0.05, 0.116 * side, -0.8), (-0.06, 0.116 * side, -1.13), 0.075) for side in (-1, 1)),  # lower legs
    *(((-0.08, 0.115 * side, -1.22), (0.09, 0.115 * side, -1.22), 0.05) for side in (-1, 1)),  # feet
)
_CLOTHES = ("shirt", "skin", "skin", "shirt", "shirt", "skin", "skin", *("pants",) * 4, "shoes", "shoes")
"""What covers each limb."""
_SKIN = (0.8, 0.6, 0.5)
# PROTOs with a size that are not similar to a box: terrain, a hole, a hollow pipe.
_UNLIKE_BOXES = {"Pit", "SolidPipe", "UnevenTerrain"}
_STANDING = 1.27  # default height of the origin above the ground [m]
_ON_GROUND = 0.1  # up to this height above the parent's origin, the origin is a box's bottom, not its center [m]

_KINECT_HEAD, _KINECT_SIZE = 0.05, (0.28, 0.038, 0.064)  # height above the foot; size to the right, up and back [m]
_KINECT_OFF = 0.0127  # distance of the two sensors from the center [m]
_KINECT_TURNED = (-0.5774, 0.5773, 0.5774, -2.0944), (0.577351, -0.577351, -0.577351, -2.09439)
_ASTRA_FIELD_OF_VIEW, _ASTRA_RANGE = 1.04, (0.6, 8.0)

DEPTH_CAMERAS = ("Kinect", "Astra")
"""The PROTOs that `expand_depth_camera` expands."""


def stand_in(node: Node) -> Node | None:
    """Build a Solid as the stand-in of an instance without a file; return None if its size is unknown.

    A Pedestrian becomes a human of capsules, a type in `KNOWN` its boxes, an instance with a field ``size`` of three
    lengths a box, and one with ``radius`` and ``height`` a cylinder. Box or cylinder stand on the origin if that is at
    ground height, and are centered on it otherwise.
    """
    if node.type == "Pedestrian":
        return _pedestrian(node)
    if node.type in KNOWN:
        known = KNOWN[node.type]
        # Webots' furniture is named by its type in words: "office chair" for OfficeChair.
        default_name = known.name or re.sub(r"(?<!^)(?=[A-Z])", " ", node.type).lower()
        furniture = solid_of(node, known_shapes(node, known), default_name)
        if node.version.z_up:
            furniture.fields.setdefault("translation", [*known.translation])
        return furniture
    size = None if node.type in _UNLIKE_BOXES else _size_of(node)
    if size is None:
        return None
    translation = node.numbers("translation")
    up = 2 if node.version.z_up else 1
    lifted = len(translation) != 3 or abs(translation[up]) <= _ON_GROUND
    place = tuple(size[up] / 2 * (lifted and axis == up) for axis in range(3))
    lengths: dict[str, Value] = {name: node.fields[name] for name in ("radius", "height") if name in node.fields}
    if len(lengths) < 2 or len(node.numbers("size")) == 3:
        return solid_of(node, [box_at(node, size, place)])
    return solid_of(node, [shape_at(node, new_node(node, "Cylinder", lengths), place)])


def stand_in_geometry(node: Node) -> Node | None:
    """Build a Box as the stand-in of a geometry PROTO with a `size` of three lengths, such as TexturedBox."""
    size = _size_of(node)
    return None if size is None else new_node(node, "Box", {"size": [*size]}, node.name)


def _size_of(node: Node) -> tuple[float, ...] | None:
    """Read the size of an instance from its fields [m]; return None if it has no valid size."""
    try:
        if node.type == "WoodenPalletStack":
            up = 2 if node.version.z_up else 1
            pallet = node.vector("palletSize", in_axes(node, (1.2, 0.8, 0.14), "z"))
            pallet[up] *= node.integer("palletNumber", 8)
            return tuple(pallet.tolist()) if (pallet > 0).all() else None
        size = node.numbers("size")
        radius, height = node.number("radius", 0.0), node.number("height", 0.0)
    except FileFormatError:
        return None
    if len(size) == 3 and (size > 0).all():
        return tuple(map(float, size))
    return in_axes(node, (2 * radius, 2 * radius, height), "z") if radius > 0 and height > 0 else None


def _pedestrian(node: Node) -> Node:
    shapes = []
    shirt, pants = node.vector("shirtColor", (0.25, 0.55, 0.2)), node.vector("pantsColor", (0.24, 0.25, 0.5))
    colors = {
        "shirt": shirt,
        "pants": pants,
        "shoes": node.vector("shoesColor", (0.28, 0.15, 0.06)),
        "skin": np.array(_SKIN),
    }
    looks = {name: plain_appearance(node, tuple(map(float, np.clip(row, 0, 1)))) for name, row in colors.items()}
    for (first, second, radius), part in zip(_LIMBS, _CLOTHES, strict=True):
        one, other = (np.array(in_axes(node, end, "z")) for end in (first, second))
        along = one - other
        height = float(np.linalg.norm(along))
        upright = np.array(in_axes(node, (0.0, 0.0, 1.0), "z"))
        axis, angle = np.cross(upright, along / height), float(np.arccos(np.clip(along @ upright / height, -1, 1)))
        if not axis.any():
            axis = np.array([1.0, 0.0, 0.0])
        capsule = new_node(node, "Capsule", {"radius": [radius], "height": [height]})
        fields: dict[str, Value] = {
            "translation": numbers((one + other) / 2),
            "rotation": numbers((*axis, angle)),
            "children": [shape_at(node, capsule, appearance=looks[part])],
        }
        shapes.append(new_node(node, "Pose", fields))
    body = solid_of(node, shapes, "pedestrian")
    body.fields.setdefault("translation", [*in_axes(node, (0.0, 0.0, _STANDING), "z")])
    body.fields["recognitionColors"] = [*np.concatenate([shirt, pants]).tolist()]
    return body


def expand_depth_camera(node: Node) -> Node | None:
    """Build the Solid that such a PROTO expands to, without the meshes of its body; return None for other types.

    Kinect: a head of 0.28 m x 0.038 m x 0.064 m, the bounding box of its mesh, 0.05 m above a foot that is not drawn,
    with the range finder ``"<cameraName> range"`` and the camera ``"<cameraName> color"``. Up to R2021b they are
    12.7 mm to the left and to the right of the center; since R2022a both are 12.7 mm in front of it. In all releases,
    the head of a Kinect with ``foot FALSE`` looks along -z of the Kinect's axes, with y up. Astra: two boxes, the
    bounding object of its mesh, with the range finder ``"<name> depth"`` and the camera ``"<name> rgb"`` in front.
    """
    if node.type == "Kinect":
        return _kinect(node)
    return _astra(node) if node.type == "Astra" else None


def _kinect(node: Node) -> Node:
    width, height = float(node.integer("width", 320)), float(node.integer("height", 190))
    name, foot, z_up = node.text("cameraName", "kinect"), node.flag("foot", True), node.version.z_up
    camera: dict[str, Value] = {"fieldOfView": [1.0], "width": [width], "height": [height]}
    left, right = [-_KINECT_OFF, 0.0, 0.0], [_KINECT_OFF, 0.0, 0.0]
    head: dict[str, Value] = {}
    if z_up:  # the head still has its axes of releases before R2022a
        left = right = [0.0, 0.0, -_KINECT_OFF]
        camera["rotation"] = [*_KINECT_TURNED[1]]
    if foot:
        head["translation"] = [0.0, 0.0, _KINECT_HEAD] if z_up else [0.0, _KINECT_HEAD, 0.0]
        head["rotation"] = [*_KINECT_TURNED[0]] if z_up else [1.0, 0.0, 0.0, 0.0]
    ranges: dict[str, Value] = {
        "name": [f"{name} range"],
        "maxRange": [node.number("maxRange", 3.5)],
        "noise": [node.number("rangeNoise", 0.0)],
    }
    head["children"] = [
        box_at(node, _KINECT_SIZE),
        new_node(node, "Camera", {**camera, "translation": [*right], "name": [f"{name} color"]}),
        new_node(node, "RangeFinder", {**camera, **ranges, "translation": [*left]}),
    ]
    return solid_of(node, [new_node(node, "Pose", head)], "Kinect", ("translation", "rotation"))


def _astra(node: Node) -> Node:
    camera: dict[str, Value] = {"fieldOfView": [_ASTRA_FIELD_OF_VIEW], "width": [640.0], "height": [480.0]}
    name = node.text("name", "Astra")
    # Offset of the body's center from the origin, which was at the center and is at the foot since R2023a.
    forward, up = (0.007, 0.027) if node.version >= Version(2023, 1) else (0.0, 0.0)
    ranges: dict[str, Value] = {
        "name": [f"{name} depth"],
        "minRange": [_ASTRA_RANGE[0]],
        "maxRange": [_ASTRA_RANGE[1]],
        "noise": [node.number("rangeNoise", 0.0)],
    }
    parts: list[Node] = []
    for size, place in (((0.04, 0.165, 0.029), (-0.001, 0.0, 0.007)), ((0.061, 0.06, 0.014), (-0.016, 0.0, -0.02))):
        position = in_axes(node, (place[0] + forward, place[1], place[2] + up), "-z")
        parts.append(box_at(node, [*map(abs, in_axes(node, size, "-z"))], position))
    color: dict[str, Value] = {"name": [f"{name} rgb"]}
    for kind, offset, more in (("Camera", 0.011, color), ("RangeFinder", 0.037, ranges)):
        position = in_axes(node, (0.02 + forward, offset, 0.007 + up), "-z")
        parts.append(new_node(node, kind, {**camera, **more, "translation": [*position]}))
    return solid_of(node, parts, "Astra", ("translation", "rotation"))
