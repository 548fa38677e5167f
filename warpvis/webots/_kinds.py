# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Which nodes of Webots have shapes, places and parts, and whether all that an instance of a PROTO shows is at hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from warpvis.webots._nodes import Node, Value, new_node
from warpvis.webots._parts import ROBOTS
from warpvis.webots.shapes._geometry import GEOMETRIES

DEVICES = {
    *("Accelerometer", "Altimeter", "Camera", "Compass", "Connector", "Display", "DistanceSensor", "Emitter", "GPS"),
    *("Gyro", "InertialUnit", "LED", "Lidar", "LightSensor", "Microphone", "Pen", "Radar", "Radio", "RangeFinder"),
    *("Receiver", "Speaker", "TouchSensor", "VacuumGripper"),
}
SOLIDS = {"Solid", "Charger", "Servo", "Track", *ROBOTS, *DEVICES}
TRANSFORMS = {"Transform", "Pose", "TrackWheel", "Fluid", *SOLIDS}
# The fields in which a node's parts are. A joint's end point is saved where the joint's position puts it.
PARTS = {
    "Group": ("children",),
    "Lidar": ("children", "rotatingHead"),
    "Propeller": ("slowHelix",),  # what is shown of it at rest
    **dict.fromkeys(("HingeJoint", "SliderJoint", "Hinge2Joint", "BallJoint", "Slot"), ("endPoint",)),
}
# PROTOs of Webots (projects/joints/protos): a joint's end point behind start points, each with the field that gives the
# play before it. Without play there is no start point; Webots takes the default for a play below zero.
JOINTS = {
    "HingeJointWithBacklash": (("startPoint", "backlash"),),
    "Hinge2JointWithBacklash": (("startPoint", "backlash"), ("startPoint2", "backlash2")),
}
_DEFAULT_BACKLASH = 0.01  # [rad]
# Not in any image of a range finder; the list's last ones are PROTOs.
UNSEEN = {
    *("WorldInfo", "Viewpoint", "Background", "Fog", "DirectionalLight", "PointLight", "SpotLight", "Billboard"),
    *("SolidReference", "Muscle", "ContactProperties", "TexturedBackground", "TexturedBackgroundLight"),
}
LINES = {"IndexedLineSet", "PointSet"}  # geometry without triangles
MAX_LOOKED_AT = 10_000
"""Nodes of an instance that are looked at for missing parts."""


def parts_of(node: Node) -> list[Node]:
    """List the nodes in a node that are drawn with it."""
    return [part for name in PARTS.get(node.type, ("children",)) for part in node.nodes(name)]


def expand_joint(node: Node) -> Node | None:
    """Make a Group of what an instance of `JOINTS` draws: all at rest, as Webots saves end points; None for others.

    Raises:
        FileFormatError: A field is not what it has to be.
    """
    if node.type not in JOINTS:
        return None
    pairs = [(node.nodes(points), node.number(play, _DEFAULT_BACKLASH)) for points, play in JOINTS[node.type]]
    parts: list[float | str | bool | Node] = [part for points, play in pairs if play != 0 for part in points]
    fields: dict[str, Value] = {"children": [*parts, *node.nodes("endPoint")]}
    return new_node(node, "Group", fields, node.name)


def missing_parts(
    body: Node, expand: Callable[[Node], Node | None], find_mesh: Callable[[str, Node], Path | None]
) -> tuple[list[str], int, bool]:
    """Look for what an instance of a PROTO shows and is not at hand.

    Args:
        body: What its file makes of it.
        expand: Expands an instance of a PROTO; None for one without a file.
        find_mesh: Finds the file of a url that a node names.

    Returns:
        What is missing, PROTOs and meshes; how many shapes there are; and whether there are cameras or range finders.

    Raises:
        FileFormatError: A field is not what it has to be.
    """
    missing: list[str] = []
    shapes, eyes, seen, nodes = 0, False, {id(body)}, [body]
    while nodes and len(seen) <= MAX_LOOKED_AT:
        node = nodes.pop()
        inside: list[Node] = []
        eyes = eyes or node.type in ("Camera", "RangeFinder", "Lidar")
        if node.type in ("Shape", "CadShape"):
            geometry = node if node.type == "CadShape" else node.node("geometry")
            if geometry is None or geometry.type in LINES:
                continue
            lacks = _lacking(geometry, expand, find_mesh)
            missing += [lacks] if lacks else []
            shapes += not lacks
        elif node.type in TRANSFORMS or node.type in PARTS:
            inside = parts_of(node)
        elif node.type not in UNSEEN:
            whole = expand(node)
            missing += [node.type] if whole is None else []
            inside = [] if whole is None else [whole]
        nodes += [part for part in inside if id(part) not in seen]
        seen.update(map(id, inside))
    return missing, shapes, eyes


def _lacking(
    geometry: Node, expand: Callable[[Node], Node | None], find_mesh: Callable[[str, Node], Path | None]
) -> str:
    """Say what a geometry node needs and is not at hand; nothing if it is."""
    if geometry.type not in GEOMETRIES:
        found = expand(geometry)
        return geometry.type if found is None else ""
    urls = geometry.texts("url") if geometry.type in ("Mesh", "CadShape") else []
    return f"{geometry.type} {urls[0]}" if urls and urls[0] and find_mesh(urls[0], geometry) is None else ""
