# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Extents of Solids in Webots' recognition: bounding objects, or bounding spheres of shapes."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import FileFormatError
from warpvis.webots._nodes import Node, Value
from warpvis.webots._transforms import Transform
from warpvis.webots.shapes._geometry import Resolve, tessellate
from warpvis.webots.shapes._polygons import Triangles
from warpvis.webots.shapes._resets import reset_fields

_ROUND = {"Sphere", "Cylinder", "Capsule"}
_GROUPS = {"Group", "Pose", "Transform"}
# Fields of fine tessellations, which approximate the exact round shapes and infinite planes of Webots' physics.
_FINE: dict[str, dict[str, Value]] = {
    "Sphere": {"subdivision": [4.0], "ico": [True]},
    "Cylinder": {"subdivision": [72.0]},
    "Capsule": {"subdivision": [72.0]},
    "Plane": {"size": [2000.0, 2000.0]},
}


class Ball(NamedTuple):
    """A sphere in the world [m]."""

    center: NDArray[np.float64]
    radius: float


class Bound(NamedTuple):
    """A geometry of a bounding object, in the world [m]."""

    points: NDArray[np.float64]
    """Vertices, shape ``(n, 3)``; for round geometry its center, shape ``(1, 3)``."""
    radius: float = 0.0
    """Radius of round geometry; 0 for other geometry."""
    height: float = 0.0
    """Height including the caps; 0 for a sphere."""
    axis: NDArray[np.float64] | None = None
    """Unit vector along the height."""


@dataclass(eq=False)
class Extent:
    """A Solid with its position and bounds."""

    origin: NDArray[np.float64]
    """Origin of its frame in the world [m], shape ``(3,)``."""
    robot: str = ""
    """Name of its robot; empty without a robot."""
    level: int = 0
    """Depth below the robot, counted in Solids; 0 for the robot itself."""
    bounding: list[tuple[Node, Transform]] = field(default_factory=list)
    """Geometry nodes of its bounding object, with their transforms."""
    parts: list[Ball | Extent] = field(default_factory=list)
    """Bounding spheres of its shapes, and its child Solids, in the order of the file."""

    @property
    def solids(self) -> list[Extent]:
        """Its direct child Solids."""
        return [part for part in self.parts if isinstance(part, Extent)]

    def family(self) -> Iterator[Extent]:
        """Iterate over it and all its descendants, depth first."""
        waiting = [self]
        while waiting:
            extent = waiting.pop()
            yield extent
            waiting += reversed(extent.solids)

    def is_bounded(self) -> bool:
        """Return whether it or a descendant has a bounding object."""
        return any(extent.bounding for extent in self.family())

    def sphere(self) -> Ball | None:
        """Compute the bounding sphere of all its shapes as Webots does, by merging one sphere after the other."""
        enclosing: Ball | None = None
        for extent in self.family():
            for part in extent.parts:
                if isinstance(part, Ball):
                    enclosing = part if enclosing is None else _enclose(enclosing, part)
        return enclosing


class Bounds(NamedTuple):
    """Extents of all Solids of a world."""

    recognized: dict[str, Extent]
    """Solids with `recognitionColors`, by their keys in `WebotsWorld.recognizable`."""
    solids: list[Extent]
    """All Solids."""
    resolve: Resolve
    """Finds the files of meshes."""


def _enclose(one: Ball, other: Ball) -> Ball:
    """Compute the smallest sphere that encloses two (``WbBoundingSphere::enclose``)."""
    offset = other.center - one.center
    distance = float(np.linalg.norm(offset))
    if distance + other.radius <= one.radius:
        return one
    if distance + one.radius <= other.radius:
        return other
    radius = (one.radius + distance + other.radius) / 2
    return Ball(one.center + offset * ((radius - one.radius) / distance), radius)


def ball_about(vertices: NDArray[np.float64]) -> Ball:
    """Compute the sphere around points, shape ``(n, 3)``, centered on their bounding box."""
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return Ball(middle, float(np.linalg.norm(vertices - middle, axis=1).max()))


def bounding_geometry(node: Node, transform: Transform) -> list[tuple[Node, Transform]]:
    """List the geometry nodes of a bounding object with their transforms."""
    if node.type == "Shape":
        geometry = node.node("geometry")
        return [(geometry, transform)] if geometry is not None else []
    if node.type not in _GROUPS:
        return [(node, transform)]
    if node.type != "Group":
        transform = transform.within(node, node.vector("scale", (1.0, 1.0, 1.0)))
    return [item for child in node.nodes("children") for item in bounding_geometry(child, transform)]


def bound_of(node: Node, transform: Transform, resolve: Resolve) -> Bound | None:
    """Read one geometry of a bounding object; return None if it cannot be read."""
    if node.type not in _ROUND:
        triangles = triangles_of(node, transform, resolve, fine=False)
        return None if triangles is None else Bound(triangles[0])
    try:
        fixed, _ = reset_fields(node)
        radius, height = fixed.number("radius", 1.0), fixed.number("height", 2.0)
    except FileFormatError:
        return None
    scale = np.linalg.norm(transform.linear, axis=0)
    upright = 2 if node.version.z_up else 1
    across = float(np.delete(scale, upright).max())
    middle = transform.offset[None]
    if node.type == "Sphere":
        return Bound(middle, radius * float(scale.max()))
    radius, height = radius * across, height * float(scale[upright])
    return Bound(middle, radius, height + 2 * radius * (node.type == "Capsule"), transform.rotation[:, upright])


def triangles_of(node: Node, transform: Transform, resolve: Resolve, *, fine: bool = True) -> Triangles | None:
    """Tessellate one geometry of a bounding object in world coordinates; return None if it cannot be read."""
    if fine:
        node = dataclasses.replace(node, fields={**node.fields, **_FINE.get(node.type, {})})
    try:
        triangles = tessellate(reset_fields(node)[0], resolve=resolve)
    except FileFormatError:
        return None
    return None if triangles is None else (triangles[0] @ transform.linear.T + transform.offset, triangles[1])
