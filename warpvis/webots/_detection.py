# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Webots' rules for recognizing a Solid (``src/webots/nodes/utils/WbObjectDetection.cpp`` and ``WbCamera.cpp``).

The extent of a Solid is that of its bounding objects, or of the bounding spheres of its shapes. Vectors of `Box` and
`Frustum` are in the camera frame: x forward, y to the left, z up.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices
from warpvis.errors import FileFormatError
from warpvis.webots._devices import Device
from warpvis.webots._nodes import Node, Transform, Value
from warpvis.webots.shapes._geometry import Resolve, reset_fields, tessellate
from warpvis.webots.shapes._polygons import Triangles

_RIGHT, _BOTTOM, _LEFT, _TOP = range(4)

# Up to this vertical field of view [rad], Webots renders a wide image by cameras side by side, whose vertical field of
# view is enlarged by this factor (`WbWrenCamera::setupSphericalSubCameras`).
_ONE_CAMERA_HIGH, _HIGHER = 1.230959417, 1.27

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

    points: NDArray[np.float64]  # vertices, shape ``(n, 3)``; for round geometry its center, shape ``(1, 3)``
    radius: float = 0.0  # radius of round geometry; 0 for other geometry
    height: float = 0.0  # height including the caps; 0 for a sphere
    axis: NDArray[np.float64] | None = None  # unit vector along the height


@dataclass(eq=False)
class Extent:
    """A Solid with its position and bounds."""

    origin: NDArray[np.float64]  # origin of its frame in the world [m], shape ``(3,)``
    robot: str = ""  # name of its robot; empty without a robot
    level: int = 0  # depth below the robot, counted in Solids; 0 for the robot itself
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

    recognized: dict[str, Extent]  # solids with `recognitionColors`, by their keys in `WebotsWorld.recognizable`
    solids: list[Extent]  # all Solids
    resolve: Resolve  # finds the files of meshes


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
    middle = _box_around(vertices).middle
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


class Box(NamedTuple):
    """Bounding box, along the camera's axes, of the part of a Solid within the frustum [m]."""

    middle: NDArray[np.float64]
    size: NDArray[np.float64]
    round: bool  # whether it bounds spheres only

    def corners(self) -> NDArray[np.float64]:
        """List the targets of rays in occlusion mode 2, relative to the middle: corners, or a sphere's axis ends."""
        if self.round:
            ends = np.kron(np.eye(3), [[1.0], [-1.0]])
        else:
            ends = np.array([(x, y, z) for z in (1.0, -1.0) for y in (1.0, -1.0) for x in (1.0, -1.0)])
        return ends * self.size / 2


@dataclass(frozen=True)
class Frustum:
    """The four side planes of a camera's frustum, through its origin."""

    device: Device
    inwards: NDArray[np.float64]
    """Unit normals of the right, bottom, left and top planes, shape ``(4, 3)``: inward, but outward for a camera whose
    field of view exceeds a hemisphere."""
    eye: NDArray[np.float64]  # position of the camera in the world [m]
    axes: NDArray[np.float64]  # axes of the camera in the world, one per row

    @classmethod
    def of(cls, device: Device) -> Frustum:
        """Compute the side planes of a device."""
        x, y, z = _corner(device)
        right, left = np.array([(x, -y, z), (x, -y, -z)]), np.array([(x, y, z), (x, y, -z)])
        sides = ((right[0], right[1]), (right[1], left[1]), (left[1], left[0]), (left[0], right[0]))
        inwards = np.array([np.cross(one, other) for one, other in sides])
        matrix = poses_to_matrices(device.pose)
        right, down, forward = matrix[:3, :3].T
        axes = np.stack([forward, -right, -down])
        return cls(device, inwards / np.linalg.norm(inwards, axis=1, keepdims=True), matrix[:3, 3], axes)

    @property
    def sees_around(self) -> bool:
        """Whether the field of view exceeds a hemisphere."""
        return self.device.fov > math.pi

    def box(self, extent: Extent, resolve: Resolve) -> Box | None:
        """Compute the box of the part of a Solid within the frustum; None if no part is. `resolve` finds mesh files."""
        found: Box | None = None
        for solid in extent.family():
            read = [bound_of(node, transform, resolve) for node, transform in solid.bounding]
            bounds = [bound for bound in read if bound is not None]
            is_bounded = found is not None or any(below.bounding for below in solid.family())
            sphere = None if is_bounded else solid.sphere()
            if sphere is not None:
                bounds.append(Bound(sphere.center[None], sphere.radius))
            for bound in bounds:
                points = (bound.points - self.eye) @ self.axes.T
                box = self._of_round(points[0], bound) if bound.radius else self._of_points(points)
                if box is not None and found is not None:
                    ends = [each.middle + sign * each.size / 2 for each in (found, box) for sign in (-1, 1)]
                    box = _box_around(np.array(ends), is_round=found.round and box.round)
                found = box or found
        return found

    def _of_points(self, points: NDArray[np.float64]) -> Box | None:
        """Project outside points onto the side planes, one after the other; points behind the camera are not moved."""
        if self.sees_around:
            return self._of_points_around(points)
        ahead, behind = points[points[:, 0] > 0], points[points[:, 0] <= 0]
        if not len(ahead):
            return None
        inside = np.ones(len(ahead), dtype=bool)
        beyond, within = np.zeros(4, dtype=bool), np.zeros(4, dtype=bool)
        for side, normal in enumerate(self.inwards):
            outside = ahead @ normal < 0
            ahead = np.where(outside[:, None], ahead - np.outer(ahead @ normal, normal), ahead)
            beyond[side], within[side] = outside.any(), (~outside).any()
            inside &= ~outside
        if not inside.any():  # no point is inside, but the hull may still cross the frustum
            across = beyond[[_RIGHT, _LEFT]].all() and within[[_BOTTOM, _TOP]].all()
            upright = beyond[[_BOTTOM, _TOP]].all() and within[[_RIGHT, _LEFT]].all()
            if not (across or upright):
                return None
        return _box_around(np.concatenate([ahead, behind]))

    def _of_points_around(self, points: NDArray[np.float64]) -> Box | None:
        """Project points behind the camera and outside all side planes onto the farthest of these planes."""
        distances = points @ self.inwards.T
        outside = (points[:, 0] <= 0) & (distances >= 0).all(axis=1)
        if outside.all():
            return None
        side = distances.argmin(axis=1)
        off = distances[np.arange(len(points)), side][:, None] * self.inwards[side]
        return _box_around(np.where(outside[:, None], points - off, points))

    def _of_round(self, middle: NDArray[np.float64], bound: Bound) -> Box | None:
        """Cut off the part outside each side plane, by the distance of the middle from the plane."""
        size = np.full(3, 2 * bound.radius)
        if bound.axis is not None:
            along = np.abs(self.axes @ bound.axis)
            size = along * bound.height + 2 * bound.radius * np.sqrt(np.maximum(0.0, 1 - along**2))
        half = size[[1, 2, 1, 2]] / 2
        distances = self.inwards @ middle
        if self.sees_around:
            seen = middle[0] >= 0 or (distances < -half).any()
            return Box(middle, size, bound.axis is None) if seen else None
        if (distances < -half).any():
            return None
        cut = np.where(distances < half, half - distances, 0.0)
        if self.device.fov <= math.pi / 2:
            size = size - (0, cut[_RIGHT] + cut[_LEFT], cut[_BOTTOM] + cut[_TOP])
            middle = middle + 0.5 * np.array([0, cut[_RIGHT] - cut[_LEFT], cut[_BOTTOM] - cut[_TOP]])
        return Box(middle, size, bound.axis is None)

    def on_image(self, box: Box) -> tuple[tuple[int, int], tuple[int, int]]:
        """Compute the middle and the size of a box in the image [px], without lens distortion."""
        points = box.middle + box.corners()
        if self.device.projection == "planar":
            place = self._planar(points)
        else:
            place = self._wide(np.concatenate([points, box.middle[None]]))
        limits = np.array([self.device.width - 1, self.device.height - 1])
        pixels = (limits * np.clip(0.5 + place, 0.0, 1.0)).astype(np.int64)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        middle = np.floor((low + high) / 2 + 0.5).astype(np.int64)
        return (int(middle[0]), int(middle[1])), (int(high[0] - low[0]), int(high[1] - low[1]))

    def _planar(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Project points to image coordinates from -1/2 to 1/2, right and down, shape ``(n, 2)``."""
        ahead = np.where(np.abs(points[:, :1]) > 0, np.abs(points[:, :1]), 1e-300)
        sideways, slopes = -points[:, 1:], _slopes(self.device)
        return np.where(points[:, :1] < 0, np.where(sideways < 0, -0.5, 0.5), 0.5 * sideways / ahead / slopes)

    def _wide(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Project points to the same coordinates of a cylindrical or spherical image.

        On the forward axis, where Webots divides 0 by 0, the result is the limit.
        """
        device, (x, y, z) = self.device, points.T
        if device.projection == "spherical":
            aside = np.hypot(y, z)
            away = np.arctan2(aside, x) / np.where(aside > 0, aside, 1.0)
            place = -away[:, None] * points[:, 1:] / device.fov
        else:
            down = -np.arctan2(z, np.hypot(x, y)) * device.width / device.height
            place = np.stack([-np.arctan2(y, x), down], axis=1) / device.fov
        if device.fov < math.pi / 2:
            place[:, 0] *= math.pi / 2 / device.fov
        return place


def _slopes(device: Device) -> NDArray[np.float64]:
    """Compute the tangents of half the horizontal and vertical fields of view, for square pixels."""
    return math.tan(device.fov / 2) * np.array([1.0, device.height / device.width])


def _corner(device: Device) -> tuple[float, float, float]:
    """Compute the upper left corner of the frustum as Webots does: for wide images, too, by planar formulas."""
    half = device.fov / 2
    if device.projection == "planar":
        return (1.0, *_slopes(device).tolist())
    if device.fov > math.pi:
        upright = math.atan(_slopes(device)[1])
        across = math.cos(upright + math.pi / 2) if abs(upright) > math.pi / 4 else math.cos(upright)
        return math.cos(upright) * math.cos(half), across * math.sin(half), math.sin(upright)
    upright = device.fov * device.height / device.width
    if upright <= _ONE_CAMERA_HIGH:
        upright *= _HIGHER
    return 1.0, math.tan(half), math.tan(upright / 2)


def _box_around(points: NDArray[np.float64], *, is_round: bool = False) -> Box:
    low, high = points.min(axis=0), points.max(axis=0)
    return Box((low + high) / 2, high - low, is_round)
