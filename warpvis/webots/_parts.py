# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Node types, and the conversion of a Webots world's Solids to scene objects with triangles, names and labels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Label
from warpvis.scene import Part
from warpvis.webots._appearance import AppearanceFiles, Surface, join_appearances
from warpvis.webots._detection import Extent
from warpvis.webots._grammar import World
from warpvis.webots._joints import Link
from warpvis.webots._nodes import Names, Node, Transform, Value, Version, new_node, replaced
from warpvis.webots.shapes._geometry import GEOMETRIES
from warpvis.webots.shapes._polygons import join

GROUND_HEIGHT = 0.1
"""Maximum absolute height of a level surface that is labeled as ground [m]."""

_SCALAR_GRAVITY = Version(2020, 2)
_NEGATIVE_SCALES = Version(2022, 2)

ROBOTS = {"Robot", "Supervisor", "DifferentialWheels", "CustomRobot"}

DEVICES = {
    *("Accelerometer", "Altimeter", "Camera", "Compass", "Connector", "Display", "DistanceSensor", "Emitter", "GPS"),
    *("Gyro", "InertialUnit", "LED", "Lidar", "LightSensor", "Microphone", "Pen", "Radar", "Radio", "RangeFinder"),
    *("Receiver", "Speaker", "TouchSensor", "VacuumCup", "VacuumGripper"),
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


def corrected_scale(node: Node, notes: list[str]) -> NDArray[np.float64]:
    """Read a node's scale, with values that are invalid in Webots replaced by 1 and noted."""
    scale = node.vector("scale", (1.0, 1.0, 1.0))
    wrong = scale == 0 if node.version >= _NEGATIVE_SCALES else scale <= 0
    return replaced(node, "scale", scale, np.where(wrong, 1.0, scale), notes) if wrong.any() else scale


def is_human(name: str) -> bool:
    """Return whether a Solid's name is that of a person."""
    return any(word in name.lower() for word in ("human", "person", "pedestrian"))


@dataclass(eq=False)
class Solid:
    """A Solid with its shapes, or a shape outside of any Solid, which becomes an object."""

    preferred_name: str  # its name, if not taken
    robots: tuple[str, ...] = ()
    human: bool = False
    ground: bool = False
    recognized: bool = False
    arena: bool = False
    parent: Solid | None = None  # the Solid that contains it
    frame: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))  # its axes and origin in the world
    axes: tuple[int, int] = (2, 0)  # axes of the frame along which a person stands and looks
    eyes: NDArray[np.float64] | None = None  # OpenCV pose of the eyes of a person, ``(7,)``, if it has a node of them
    link: Link | None = None  # the link that it moves with
    parts: list[Surface] = field(default_factory=list)
    links: list[Link | None] = field(default_factory=list)  # the link of each surface; PROTO instances have several

    def chain(self) -> Iterator[Solid]:
        """Iterate over it and the Solids that contain it, innermost first."""
        solid: Solid | None = self
        while solid is not None:
            yield solid
            solid = solid.parent

    def label(self) -> Label:
        """Choose the label by the rules of `warpvis.webots.load_webots`."""
        name = self.preferred_name.lower()
        if self.human or is_human(name):
            return Label.HUMAN
        if self.robots:
            return Label.ROBOT
        is_ground_name = ("floor" in name or "ground" in name) and "light" not in name and "lamp" not in name
        if self.ground or is_ground_name or all(part.level for part in self.parts):
            return Label.GROUND
        return Label.OBJECT if self.recognized else Label.OBSTACLE


class Step(NamedTuple):
    """A node to visit, with its transform and context."""

    node: Node
    transform: Transform
    owner: Solid | None = None  # the Solid to which its shapes are added
    robots: tuple[str, ...] = ()
    recognized: tuple[str, ...] = ()
    human: bool = False
    called: str = ""  # the nearest DEF name, for shapes outside of any Solid
    instances: tuple[Node, ...] = ()  # the PROTO instances that expand to this node
    within: tuple[str, ...] = ()  # types of the PROTOs that contain it
    origin: str = ""  # the PROTO without a file whose fields contain it; then only devices are read
    extent: Extent | None = None  # the Solid that contains it
    link: Link | None = None  # the link that it moves with
    depth: int = 0

    @property
    def robot(self) -> str:
        """Name of the innermost robot that contains it; empty without a robot."""
        return self.robots[-1] if self.robots else ""

    @property
    def is_part(self) -> bool:
        """Whether a Solid is merged into its owner because it comes from the same PROTO file, like a table's legs."""
        node = self.node
        if self.owner is None or node.type in ROBOTS or len(node.numbers("recognitionColors")):
            return False
        return bool((self.instances or (node,))[0].protos)


def is_level(vertices: NDArray[np.float64], faces: NDArray[np.int32], up: int) -> bool:
    """Return whether a surface is level, visible from above, and near the ground."""
    if np.ptp(vertices[:, up]) > 1e-3 or abs(vertices[0, up]) > GROUND_HEIGHT:
        return False
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return bool((np.cross(b - a, c - a)[:, up] > 0).any())


def vertical_axis(world: World, notes: list[str]) -> Literal["z", "y"]:
    """Find the vertical axis from WorldInfo's `coordinateSystem` ("ENU": z) or `gravity`, a vector in old releases."""
    info = next((node for node in world.nodes if node.type == "WorldInfo"), None)
    system, gravity = "", np.zeros(0)
    if info is not None:
        system, gravity = info.text("coordinateSystem", ""), info.numbers("gravity")
    if info is not None and system not in ("", "ENU", "NUE", "EUN"):
        system = replaced(info, "coordinateSystem", system, "ENU", notes)
    if system:
        return "z" if system == "ENU" else "y"
    if len(gravity) == 3 and gravity.any():
        return "z" if abs(gravity[2]) > abs(gravity[1]) else "y"
    return "z" if world.version >= _SCALAR_GRAVITY else "y"


def names_of(names: Mapping[Solid, list[str]], solids: Iterable[Solid]) -> tuple[str, ...]:
    """List the names of the objects made from the given Solids."""
    return tuple(name for solid in solids for name in names.get(solid, ()))


class Objects(NamedTuple):
    """Objects, and their names by Solid."""

    parts: list[Part]
    names: dict[Solid, list[str]]

    def add(self, solid: Solid, part: Part) -> None:
        """Add an object of a Solid."""
        self.parts.append(part)
        self.names.setdefault(solid, []).append(part.name)


def make_objects(solids: Iterable[Solid], files: AppearanceFiles, links: Mapping[Link, str]) -> tuple[Objects, Objects]:
    """Build objects from all Solids with triangles; images are loaded lazily.

    Args:
        solids: The Solids.
        files: Finds the files of appearances.
        links: Names of the links that can move.

    Returns:
        An object for each Solid; and the same objects, split into one for each link.
    """
    whole, split = Objects([], {}), Objects([], {})
    taken = Names()
    rows = [(solid, *row) for solid in solids if solid.parts for row in _objects_of(solid)]
    names = [taken.take(preferred_name) for _, preferred_name, _, _ in rows]
    for name, (solid, _, label, parts) in zip(names, rows, strict=True):
        moved_by = {
            id(part): links.get(link) if link else None for part, link in zip(solid.parts, solid.links, strict=True)
        }
        by_link: dict[str | None, list[Surface]] = {}
        for part in parts:
            by_link.setdefault(moved_by[id(part)], []).append(part)
        link = next(iter(by_link)) if len(by_link) == 1 else None
        whole.add(solid, _part(name, label, parts, files, link))
        if len(by_link) == 1:
            split.add(solid, whole.parts[-1])
            continue
        own = links.get(solid.link) if solid.link else None
        for link, pieces in by_link.items():
            piece = name if link == own else taken.take(link or name)
            aliases = () if piece == name else (name,)
            split.add(solid, _part(piece, label, pieces, files, link, aliases))
    return whole, split


def _part(
    name: str,
    label: Label,
    surfaces: list[Surface],
    files: AppearanceFiles,
    link: str | None,
    aliases: tuple[str, ...] = (),
) -> Part:
    mesh, appearance = join([part.placed for part in surfaces]), join_appearances(surfaces, files)
    return Part(name, mesh, label, link=link, aliases=aliases, appearance=appearance)


def _objects_of(solid: Solid) -> list[tuple[str, Label, list[Surface]]]:
    """Return name, label and parts of each object made from a Solid; arenas are split into floor and walls."""
    floor, walls = ([part for part in solid.parts if part.level == level] for level in (True, False))
    if solid.arena and floor and walls:
        return [(f"{solid.preferred_name} floor", Label.GROUND, floor), (solid.preferred_name, Label.OBSTACLE, walls)]
    return [(solid.preferred_name, solid.label(), solid.parts)]


def parts_of(node: Node) -> list[Node]:
    """List the child nodes that are drawn with a node."""
    return [part for name in PARTS.get(node.type, ("children",)) for part in node.nodes(name)]


def expand_joint(node: Node) -> Node | None:
    """Build a joint with the visible parts of an instance of `JOINTS`, at rest; return None for other types.

    All of them are its end point: the play between start point and end point is left out.
    """
    if node.type not in JOINTS:
        return None
    pairs = [(node.nodes(points), node.number(play, _DEFAULT_BACKLASH)) for points, play in JOINTS[node.type]]
    parts: list[float | str | bool | Node] = [part for points, play in pairs if play != 0 for part in points]
    names = ("jointParameters", "jointParameters2", "device", "device2")
    fields: dict[str, Value] = {name: node.fields[name] for name in names if name in node.fields}
    fields["endPoint"] = [*parts, *node.nodes("endPoint")]
    return new_node(node, node.type.removesuffix("WithBacklash"), fields, node.name)


def missing_parts(
    body: Node, expand: Callable[[Node], Node | None], find_mesh: Callable[[str, Node], Path | None]
) -> tuple[list[str], int, bool]:
    """Find PROTOs and meshes that an expanded instance of a PROTO shows and whose files are missing.

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
