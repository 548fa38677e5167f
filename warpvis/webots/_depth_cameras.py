# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Built-in replacements of Webots' depth camera PROTOs, for worlds whose PROTO files are not available.

Fields are those of Webots' user guide (https://cyberbotics.com/doc/guide, the pages Range-Finder Sensors and Camera
Sensors). Positions were measured on the nodes that the PROTO files of R2021c to R2025a expand to.
"""

from __future__ import annotations

from warpvis.webots._nodes import Node, Value, Version, new_node

_KINECT_HEAD, _KINECT_SIZE = 0.05, (0.28, 0.038, 0.064)  # height above the foot; size to the right, up and back [m]
_KINECT_OFF = 0.0127  # distance of the two sensors from the center [m]
_KINECT_TURNED = (-0.5774, 0.5773, 0.5774, -2.0944), (0.577351, -0.577351, -0.577351, -2.09439)
_ASTRA_FIELD_OF_VIEW, _ASTRA_RANGE = 1.04, (0.6, 8.0)

DEPTH_CAMERAS = ("Kinect", "Astra")
"""The PROTOs that `expand_depth_camera` expands."""


def expand_depth_camera(node: Node) -> Node | None:
    """Build the Solid that such a PROTO expands to, without the meshes of its body.

    Kinect: a head of 0.28 m x 0.038 m x 0.064 m, the bounding box of its mesh, 0.05 m above a foot that is not drawn,
    with the range finder ``"<cameraName> range"`` and the camera ``"<cameraName> color"``. Up to R2021b they are
    12.7 mm to the left and to the right of the center; since R2022a both are 12.7 mm in front of it. In all releases,
    the head of a Kinect with ``foot FALSE`` looks along -z of the Kinect's axes, with y up.

    Astra: two boxes, the bounding object of its mesh, with the range finder ``"<name> depth"`` and the camera
    ``"<name> rgb"`` in front of them.

    Returns:
        A Solid, or None for other types.
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
        _box(node, _KINECT_SIZE),
        new_node(node, "Camera", {**camera, "translation": [*right], "name": [f"{name} color"]}),
        new_node(node, "RangeFinder", {**camera, **ranges, "translation": [*left]}),
    ]
    fields: dict[str, Value] = {"name": [node.text("name", "Kinect")], "children": [new_node(node, "Pose", head)]}
    return new_node(node, "Solid", {**_placed(node), **fields}, node.name)


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
    parts: list[float | str | bool | Node] = []
    for size, place in (((0.04, 0.165, 0.029), (-0.001, 0.0, 0.007)), ((0.061, 0.06, 0.014), (-0.016, 0.0, -0.02))):
        position = _axes(node, place[0] + forward, place[1], place[2] + up)
        box = _box(node, [abs(side) for side in _axes(node, *size)])
        parts.append(new_node(node, "Pose", {"translation": [*position], "children": [box]}))
    color: dict[str, Value] = {"name": [f"{name} rgb"]}
    for kind, offset, more in (("Camera", 0.011, color), ("RangeFinder", 0.037, ranges)):
        position = _axes(node, 0.02 + forward, offset, 0.007 + up)
        parts.append(new_node(node, kind, {**camera, **more, "translation": [*position]}))
    fields: dict[str, Value] = {"name": [name], "children": parts}
    return new_node(node, "Solid", {**_placed(node), **fields}, node.name)


def _placed(node: Node) -> dict[str, Value]:
    return {name: node.fields[name] for name in ("translation", "rotation") if name in node.fields}


def _axes(node: Node, forward: float, left: float, up: float) -> tuple[float, float, float]:
    """Order lengths along the axes of the node's version: x forward and z up, or x to the right and y up."""
    return (forward, left, up) if node.version.z_up else (-left, up, -forward)


def _box(node: Node, size: list[float] | tuple[float, float, float]) -> Node:
    return new_node(node, "Shape", {"geometry": new_node(node, "Box", {"size": [*size]})})
