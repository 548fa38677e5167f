# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Solids as Webots' recognition knows them: their bounding objects, or spheres about what they show."""

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
# The physics has round shapes and endless planes; these come close.
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
    """Corners, shape ``(n, 3)``; of round geometry its middle, shape ``(1, 3)``."""
    radius: float = 0.0
    """Of round geometry."""
    height: float = 0.0
    """With the caps; 0 for a sphere."""
    axis: NDArray[np.float64] | None = None
    """Along the height, of length 1."""


@dataclass(eq=False)
class Extent:
    """Where a Solid is, and what bounds it."""

    origin: NDArray[np.float64]
    """Of its own axes [m], shape ``(3,)``."""
    robot: str = ""
    """The robot that it is part of."""
    level: int = 0
    """Number of Solids from the robot down to it; 0 for the robot itself."""
    bounding: list[tuple[Node, Transform]] = field(default_factory=list)
    """The geometry of its bounding object."""
    parts: list[Ball | Extent] = field(default_factory=list)
    """Spheres about its shapes, and the Solids in it, in the order of the file."""

    @property
    def solids(self) -> list[Extent]:
        """The Solids in it, without those in them."""
        return [part for part in self.parts if isinstance(part, Extent)]

    def family(self) -> Iterator[Extent]:
        """Go through it and all Solids in it."""
        waiting = [self]
        while waiting:
            extent = waiting.pop()
            yield extent
            waiting += reversed(extent.solids)

    def is_bounded(self) -> bool:
        """Tell whether it or a Solid in it has a bounding object."""
        return any(extent.bounding for extent in self.family())

    def sphere(self) -> Ball | None:
        """Compute the sphere about all that it shows, as Webots does: each sphere in turn enlarges the one before."""
        whole: Ball | None = None
        for extent in self.family():
            for part in extent.parts:
                if isinstance(part, Ball):
                    whole = part if whole is None else _enclose(whole, part)
        return whole


class Bounds(NamedTuple):
    """Solids of a world as its physics knows them."""

    recognised: dict[str, Extent]
    """Those with `recognitionColors`, by their keys in `WebotsWorld.recognisable`."""
    solids: list[Extent]
    """All of them."""
    resolve: Resolve
    """Finds the files of meshes."""


def _enclose(one: Ball, other: Ball) -> Ball:
    """Compute the smallest sphere about two (``WbBoundingSphere::enclose``)."""
    apart = other.center - one.center
    distance = float(np.linalg.norm(apart))
    if distance + other.radius <= one.radius:
        return one
    if distance + one.radius <= other.radius:
        return other
    radius = (one.radius + distance + other.radius) / 2
    return Ball(one.center + apart * ((radius - one.radius) / distance), radius)


def ball_about(vertices: NDArray[np.float64]) -> Ball:
    """Compute a sphere about the middle of points, shape ``(n, 3)``."""
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return Ball(middle, float(np.linalg.norm(vertices - middle, axis=1).max()))


def bounding_geometry(node: Node, transform: Transform) -> list[tuple[Node, Transform]]:
    """List the geometry nodes of a bounding object, and where each is."""
    if node.type == "Shape":
        geometry = node.node("geometry")
        return [(geometry, transform)] if geometry is not None else []
    if node.type not in _GROUPS:
        return [(node, transform)]
    if node.type != "Group":
        transform = transform.within(node, node.vector("scale", (1.0, 1.0, 1.0)))
    return [item for child in node.nodes("children") for item in bounding_geometry(child, transform)]


def bound_of(node: Node, transform: Transform, resolve: Resolve) -> Bound | None:
    """Read one geometry of a bounding object; None for what cannot be read."""
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
    """Make the triangles of one geometry of a bounding object, in the world; None for what cannot be read."""
    if fine:
        node = dataclasses.replace(node, fields={**node.fields, **_FINE.get(node.type, {})})
    try:
        triangles = tessellate(reset_fields(node)[0], resolve=resolve)
    except FileFormatError:
        return None
    return None if triangles is None else (triangles[0] @ transform.linear.T + transform.offset, triangles[1])
