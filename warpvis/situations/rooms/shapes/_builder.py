# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Meshes of boxes, cylinders and lofts, and the boxes that contain their parts."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.situations.rooms.shapes._colors import MAIN, color_of

_SMOOTH = math.cos(math.radians(50.0))
"""Cosine of the angle between triangles below which their edge is shaded smoothly."""

_BOX = np.array([[x, y, z] for z in (0.0, 1.0) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
_BOX_FACES = np.array(
    [
        [0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
        [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5],
    ]
)  # fmt: skip

OUTSIDE = "outside"
"""A part whose collision boxes are given separately."""

PartBox = tuple[float, float, float, float, float, float]
"""Center x, y, half sizes x, y, and minimum and maximum z of an upright box in the item's frame [m]."""

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Support:
    """A horizontal rectangle on which other items may stand, in the item's frame."""

    name: str
    """Name of the rectangle: ``top``, ``shelf 1``, ..."""
    center: tuple[float, float]
    half: tuple[float, float]
    """Half of its size along x and y [m]."""
    z: float
    """Its height [m]."""
    clearance: float = math.inf
    """Free height above it [m]."""


@dataclass(frozen=True)
class SeatSpot:
    """A place to sit, in the item's frame."""

    position: Point
    """Center of the seat's surface [m]."""
    heading: float = 0.0
    """Direction in which a sitting person looks, about z [degrees]; 0 is x."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh with its parts; x is the front, y the left, z up; z of its lowest point is 0."""

    category: str
    parameters: dict[str, Any]
    vertices: NDArray[np.float64] = field(repr=False)
    """Corners [m], shape ``(n, 3)``."""
    faces: NDArray[np.int32] = field(repr=False)
    """Corner indices, shape ``(m, 3)``."""
    normals: NDArray[np.float32] = field(repr=False)
    """Shading normals of the corners of the faces, shape ``(m, 3, 3)``."""
    materials: tuple[str, ...] = field(repr=False)
    """Names of materials."""
    face_materials: NDArray[np.int32] = field(repr=False)
    """Index of each face's material, shape ``(m,)``."""
    parts: tuple[PartBox, ...] = field(repr=False)
    """Boxes that together contain the mesh."""
    supports: tuple[Support, ...] = ()
    seats: tuple[SeatSpot, ...] = ()

    @cached_property
    def bounds(self) -> tuple[Point, Point]:
        """Minimum and maximum corner [m]."""
        low, high = self.vertices.min(axis=0).tolist(), self.vertices.max(axis=0).tolist()
        return (low[0], low[1], low[2]), (high[0], high[1], high[2])

    @cached_property
    def size(self) -> Point:
        """Size of the box around it [m]."""
        low, high = self.bounds
        return round(high[0] - low[0], 6), round(high[1] - low[1], 6), round(high[2] - low[2], 6)

    def face_colors(self, word: str) -> NDArray[np.uint8]:
        """Return the colors of the faces of an item of a color, shape ``(m, 4)``."""
        table = np.array([(*color_of(material, word), 255) for material in self.materials], dtype=np.uint8)
        return table[self.face_materials]


class ShapeBuilder:
    """Collects the pieces of a shape.

    The piece's position `at` is the center of its lowest face. Pieces with the same `part` share one collision box.
    """

    def __init__(self) -> None:
        """Start with an empty shape."""
        self._vertices: list[NDArray[np.float64]] = []
        self._faces: list[NDArray[np.int64]] = []
        self._normals: list[NDArray[np.float64]] = []
        self._materials: list[str] = []
        self._face_materials: list[NDArray[np.int32]] = []
        self._parts: dict[str, list[NDArray[np.float64]]] = {}
        self._count = 0
        self._supports: list[Support] = []
        self._seats: list[SeatSpot] = []

    def add(
        self, vertices: NDArray[np.float64], faces: NDArray[np.int64], material: str, part: str, *, smooth: bool
    ) -> None:
        """Add a piece: corners [m], shape ``(n, 3)``, and corner indices, shape ``(m, 3)``."""
        vertices = np.round(vertices, 6)
        if material not in self._materials:
            self._materials.append(material)
        index = self._materials.index(material)
        self._vertices.append(vertices)
        self._faces.append(faces + self._count)
        self._count += len(vertices)
        self._normals.append(_corner_normals(vertices, faces, smooth=smooth))
        self._face_materials.append(np.full(len(faces), index, dtype=np.int32))
        if part != OUTSIDE:
            self._parts.setdefault(part, []).append(vertices)

    def box(
        self, size: Sequence[float], at: Sequence[float], material: str = MAIN, part: str = "", yaw: float = 0
    ) -> None:
        """Add a box, rotated by `yaw` about its vertical axis [degrees]."""
        corners = _BOX * np.array(size)
        if yaw:
            corners = corners @ _rotation(yaw).T
        self.add(corners + np.array(at), _BOX_FACES, material, part, smooth=False)

    def cylinder(
        self,
        radius: float,
        height: float,
        at: Sequence[float],
        material: str = MAIN,
        part: str = "",
        *,
        top: float | None = None,
        sides: int = 12,
        axis: str = "z",
    ) -> None:
        """Add a cylinder, or a truncated cone of the upper radius `top`; `at` is the center of its first face."""
        rows = [(0.0, 0.0), (radius, 0.0), (radius if top is None else top, height), (0.0, height)]
        self.lathe(rows, at, material, part, sides=sides, axis=axis)

    def lathe(
        self,
        profile: Sequence[tuple[float, float]],
        at: Sequence[float],
        material: str = MAIN,
        part: str = "",
        *,
        sides: int = 12,
        axis: str = "z",
        scale: tuple[float, float] = (1.0, 1.0),
    ) -> None:
        """Add a solid of revolution of a `profile` of radii and heights, from the axis back to the axis."""
        turn = 2 * np.pi * (np.arange(sides) + 0.5) / sides
        circle = np.stack([np.cos(turn) * scale[0], np.sin(turn) * scale[1]], axis=1)
        self._rings([(radius * circle, z) for radius, z in profile], at, material, part, axis=axis, smooth=True)

    def cushion(
        self, size: Sequence[float], at: Sequence[float], material: str = MAIN, part: str = "", *, radius: float = 0.04
    ) -> None:
        """Add a box with rounded vertical and horizontal edges."""
        x, y, z = size
        radius = min(radius, x / 2.01, y / 2.01, z / 2.01)
        inset = radius * 0.6
        rows = [(inset, 0.0), (0.0, radius), (0.0, z - radius), (inset, z)]
        outline = [(_rounded(x - 2 * shrink, y - 2 * shrink, radius), height) for shrink, height in rows]
        ends = [(np.zeros_like(outline[0][0]), 0.0), *outline, (np.zeros_like(outline[0][0]), z)]
        self._rings(ends, at, material, part, axis="z", smooth=True)

    def loft(
        self,
        rings: Sequence[tuple[float, float, float, float, float]],
        material: str = MAIN,
        part: str = "",
        *,
        sides: int = 12,
    ) -> None:
        """Add a loft of ellipses ``(z, half x, half y, center x, center y)``, closed at both ends."""
        turn = 2 * np.pi * (np.arange(sides) + 0.5) / sides
        circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        rows = [(circle * (a, b) + (x, y), z) for z, a, b, x, y in rings]
        first, last = rings[0], rings[-1]
        ends = [(np.full((sides, 2), first[3:]), first[0]), *rows, (np.full((sides, 2), last[3:]), last[0])]
        self._rings(ends, (0, 0, 0), material, part, axis="z", smooth=True)

    def ball(
        self,
        radius: float | Sequence[float],
        center: Sequence[float],
        material: str = MAIN,
        part: str = "",
        *,
        sides: int = 10,
    ) -> None:
        """Add a sphere, or an ellipsoid of three radii, around its center."""
        a, b, c = (radius,) * 3 if isinstance(radius, int | float) else radius
        turn = np.linspace(-np.pi / 2, np.pi / 2, sides // 2 + 1)
        profile = [(float(np.cos(angle)) if abs(angle) < 1.57 else 0.0, c * float(np.sin(angle))) for angle in turn]
        self.lathe(profile, center, material, part, sides=sides, scale=(a, b))

    def disk_part(self, radius: float, low: float, high: float) -> None:
        """Add the boxes that contain a disk around the origin, for a piece of the part `OUTSIDE`."""
        for number, (inner, outer) in enumerate(((0.0, 0.5), (0.5, 0.8), (0.8, 1.0))):
            half = radius * math.sqrt(1 - inner * inner)
            for side in (-1, 1):
                y = np.array([inner, outer]) * radius * side
                corners = np.array([[half, y.min(), low], [-half, y.max(), high]])
                self._parts.setdefault(f"disk {number * (side if number else 1)}", []).append(corners)

    def support(
        self, center: Sequence[float], size: Sequence[float], z: float, clearance: float = math.inf, name: str = "top"
    ) -> None:
        """Add a rectangle of a size on which items may stand."""
        half = (round(size[0] / 2, 6), round(size[1] / 2, 6))
        self._supports.append(Support(name, (float(center[0]), float(center[1])), half, round(z, 6), clearance))

    def seat(self, position: Sequence[float], heading: float = 0.0) -> None:
        """Add a place to sit."""
        x, y, z = (round(float(value), 6) for value in position)
        self._seats.append(SeatSpot((x, y, z), heading))

    def finish(self, category: str, parameters: dict[str, Any]) -> Shape:
        """Return the shape, shifted up or down such that z of its lowest point is 0."""
        lowest = min(float(piece[:, 2].min()) for piece in self._vertices)
        for piece in self._vertices:
            piece[:, 2] = np.round(piece[:, 2] - lowest, 6)
        boxes = []
        for group in self._parts.values():
            low = np.min([piece.min(axis=0) for piece in group], axis=0)
            high = np.max([piece.max(axis=0) for piece in group], axis=0)
            (x, y, _), (a, b, _) = ((low + high) / 2).tolist(), ((high - low) / 2).tolist()
            boxes.append((x, y, a, b, float(low[2]), float(high[2])))
        return Shape(
            category,
            parameters,
            np.concatenate(self._vertices),
            np.concatenate(self._faces).astype(np.int32),
            np.concatenate(self._normals).astype(np.float32),
            tuple(self._materials),
            np.concatenate(self._face_materials),
            tuple(boxes),
            tuple(replace(support, z=round(support.z - lowest, 6)) for support in self._supports),
            tuple(
                replace(seat, position=(*seat.position[:2], round(seat.position[2] - lowest, 6)))
                for seat in self._seats
            ),
        )

    def _rings(
        self,
        rings: Sequence[tuple[NDArray[np.float64], float]],
        at: Sequence[float],
        material: str,
        part: str,
        *,
        axis: str,
        smooth: bool,
    ) -> None:
        """Add the surface between closed outlines of equal length at heights; all-equal outlines become one point."""
        points: list[NDArray[np.float64]] = []
        starts: list[tuple[int, bool]] = []
        count = 0
        is_closed = bool(
            np.ptp(rings[0][0]) > 0 and rings[0][1] == rings[-1][1] and np.array_equal(rings[0][0], rings[-1][0])
        )
        for outline, z in rings[:-1] if is_closed else rings:
            is_point = bool(np.ptp(outline, axis=0).max() < 1e-9)
            rows = outline[:1] if is_point else outline
            points.append(np.column_stack([rows, np.full(len(rows), z)]))
            starts.append((count, is_point))
            count += len(rows)
        if is_closed:  # a ring, such as a torus
            starts.append(starts[0])
        sides = len(rings[0][0])
        faces = []
        for (low, low_point), (high, high_point) in itertools.pairwise(starts):
            for side in range(sides):
                after = (side + 1) % sides
                a, b = (low, low) if low_point else (low + side, low + after)
                c, d = (high, high) if high_point else (high + side, high + after)
                if not low_point:
                    faces.append((a, b, d))
                if not high_point:
                    faces.append((a, d, c))
        vertices = np.concatenate(points)
        if axis == "x":
            vertices = vertices[:, [2, 0, 1]]
        elif axis == "y":
            vertices = vertices[:, [1, 2, 0]]
        self.add(vertices + np.array(at), np.array(faces), material, part, smooth=smooth)


def _rounded(x: float, y: float, radius: float) -> NDArray[np.float64]:
    """Return a rectangle with rounded corners, counterclockwise, shape ``(12, 2)``."""
    radius = min(radius, x / 2.001, y / 2.001)
    corners = [(x / 2 - radius, y / 2 - radius), (radius - x / 2, y / 2 - radius)]
    corners += [(radius - x / 2, radius - y / 2), (x / 2 - radius, radius - y / 2)]
    angles = [math.radians(90 * quarter + part) for quarter in range(4) for part in (0, 45, 90)]
    return np.array(
        [
            (corners[index // 3][0] + radius * math.cos(angle), corners[index // 3][1] + radius * math.sin(angle))
            for index, angle in enumerate(angles)
        ]
    )


def _rotation(yaw: float) -> NDArray[np.float64]:
    angle = math.radians(yaw)
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _corner_normals(vertices: NDArray[np.float64], faces: NDArray[np.int64], *, smooth: bool) -> NDArray[np.float64]:
    """Return normals of the corners of the faces, shape ``(m, 3, 3)``: smooth across edges of small angles."""
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    weighted = np.cross(b - a, c - a)
    lengths = np.linalg.norm(weighted, axis=1)
    unit = weighted / np.where(lengths > 0, lengths, 1)[:, None]
    unit[lengths == 0] = (0, 0, 1)
    if not smooth:
        return np.repeat(unit[:, None], 3, axis=1)
    corners = faces.ravel()
    owner = np.repeat(np.arange(len(faces)), 3)
    near = (corners[:, None] == corners[None]) & ((unit @ unit.T)[owner][:, owner] > _SMOOTH)
    summed = near @ weighted[owner]
    found = summed / np.maximum(np.linalg.norm(summed, axis=1), 1e-12)[:, None]
    return found.reshape(-1, 3, 3)
