# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Classification of Webots' node types, and a check for missing files of PROTO instances."""

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
# Fields that contain a node's parts. A joint's end point is saved at the joint's current position.
PARTS = {
    "Group": ("children",),
    "Lidar": ("children", "rotatingHead"),
    "Propeller": ("slowHelix",),  # the part that is visible at rest
    **dict.fromkeys(("HingeJoint", "SliderJoint", "Hinge2Joint", "BallJoint", "Slot"), ("endPoint",)),
}
# Webots' joint PROTOs with backlash (projects/joints/protos): start points between joint and end point, each with the
# field of its backlash. Without backlash there is no start point; Webots replaces a negative one by the default.
JOINTS = {
    "HingeJointWithBacklash": (("startPoint", "backlash"),),
    "Hinge2JointWithBacklash": (("startPoint", "backlash"), ("startPoint2", "backlash2")),
}
_DEFAULT_BACKLASH = 0.01  # [rad]
# Not visible to range finders; the last two types are PROTOs.
UNSEEN = {
    *("WorldInfo", "Viewpoint", "Background", "Fog", "DirectionalLight", "PointLight", "SpotLight", "Billboard"),
    *("SolidReference", "Muscle", "ContactProperties", "TexturedBackground", "TexturedBackgroundLight"),
}
LINES = {"IndexedLineSet", "PointSet"}  # geometry without triangles
MAX_LOOKED_AT = 10_000
"""Maximum number of nodes of an instance that are searched for missing parts."""


def parts_of(node: Node) -> list[Node]:
    """List the child nodes that are drawn with a node."""
    return [part for name in PARTS.get(node.type, ("children",)) for part in node.nodes(name)]


def expand_joint(node: Node) -> Node | None:
    """Build a Group of the visible parts of an instance of `JOINTS`, at rest; return None for other types."""
    if node.type not in JOINTS:
        return None
    pairs = [(node.nodes(points), node.number(play, _DEFAULT_BACKLASH)) for points, play in JOINTS[node.type]]
    parts: list[float | str | bool | Node] = [part for points, play in pairs if play != 0 for part in points]
    fields: dict[str, Value] = {"children": [*parts, *node.nodes("endPoint")]}
    return new_node(node, "Group", fields, node.name)


def missing_parts(
    body: Node, expand: Callable[[Node], Node | None], find_mesh: Callable[[str, Node], Path | None]
) -> tuple[list[str], int, bool]:
    """Find PROTOs and meshes that an instance of a PROTO shows and whose files are missing.

    Args:
        body: The expanded instance.
        expand: Expands an instance of a PROTO; returns None for one without a file.
        find_mesh: Finds the file of a node's URL.

    Returns:
        The missing PROTOs and meshes; the number of other shapes; and whether there are cameras, range finders or
        lidars.
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
            expanded = expand(node)
            missing += [node.type] if expanded is None else []
            inside = [] if expanded is None else [expanded]
        nodes += [part for part in inside if id(part) not in seen]
        seen.update(map(id, inside))
    return missing, shapes, eyes


def _lacking(
    geometry: Node, expand: Callable[[Node], Node | None], find_mesh: Callable[[str, Node], Path | None]
) -> str:
    """Describe the missing PROTO or mesh of a geometry node; return an empty text if none is missing."""
    if geometry.type not in GEOMETRIES:
        found = expand(geometry)
        return geometry.type if found is None else ""
    urls = geometry.texts("url") if geometry.type in ("Mesh", "CadShape") else []
    return f"{geometry.type} {urls[0]}" if urls and urls[0] and find_mesh(urls[0], geometry) is None else ""
