# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Upright boxes that are rotated about z: overlap tests and distances."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from warpvis.situations.rooms.shapes import Shape


class Box(NamedTuple):
    """An upright box in the room's frame."""

    x: float
    y: float
    cos: float
    sin: float
    """Direction of its first axis."""
    half_x: float
    half_y: float
    low: float
    """Its minimum z [m]."""
    high: float

    @property
    def corners(self) -> list[tuple[float, float]]:
        """Its four corners in the plan, counterclockwise."""
        ax, ay, bx, by = self.cos * self.half_x, self.sin * self.half_x, -self.sin * self.half_y, self.cos * self.half_y
        x, y = self.x, self.y
        return [
            (x + ax + bx, y + ay + by),
            (x - ax + bx, y - ay + by),
            (x - ax - bx, y - ay - by),
            (x + ax - bx, y + ay - by),
        ]


Extent = tuple[float, float, float, float, float, float]
"""Minimum x, y, z, and maximum x, y, z."""


def direction(yaw: float) -> tuple[float, float]:
    """Return cosine and sine of an angle [degrees]; exact for multiples of 90 degrees."""
    quarter = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}.get(yaw % 360)
    return quarter or (math.cos(math.radians(yaw)), math.sin(math.radians(yaw)))


def boxes_of(shape: Shape, x: float, y: float, z: float, yaw: float) -> list[Box]:
    """Return the boxes of the parts of a shape at a position, rotated about z [degrees]."""
    c, s = direction(yaw)
    return [
        Box(x + c * px - s * py, y + s * px + c * py, c, s, a, b, z + low, z + high)
        for px, py, a, b, low, high in shape.parts
    ]


def extent_of(boxes: Iterable[Box]) -> Extent:
    """Return the axis-aligned box around boxes."""
    xs: list[float] = []
    ys: list[float] = []
    lows, highs = [], []
    for x, y, c, s, a, b, low, high in boxes:
        dx, dy = abs(c) * a + abs(s) * b, abs(s) * a + abs(c) * b
        xs += (x - dx, x + dx)
        ys += (y - dy, y + dy)
        lows.append(low)
        highs.append(high)
    return min(xs), min(ys), min(lows), max(xs), max(ys), max(highs)


def extents_meet(a: Extent, b: Extent) -> bool:
    """Return whether two axis-aligned boxes overlap; touching is no overlap."""
    return a[0] < b[3] and b[0] < a[3] and a[1] < b[4] and b[1] < a[4] and a[2] < b[5] and b[2] < a[5]


def plans_overlap(a: Box, b: Box) -> bool:
    """Return whether the plans of two boxes overlap, by the separating-axis theorem; touching is no overlap."""
    dx, dy = b.x - a.x, b.y - a.y
    c, s = a.cos * b.cos + a.sin * b.sin, a.cos * b.sin - a.sin * b.cos  # of the angle between them
    c, s = abs(c), abs(s)
    if abs(dx * a.cos + dy * a.sin) >= a.half_x + c * b.half_x + s * b.half_y - 1e-9:
        return False
    if abs(dy * a.cos - dx * a.sin) >= a.half_y + s * b.half_x + c * b.half_y - 1e-9:
        return False
    if abs(dx * b.cos + dy * b.sin) >= b.half_x + c * a.half_x + s * a.half_y - 1e-9:
        return False
    return abs(dy * b.cos - dx * b.sin) < b.half_y + s * a.half_x + c * a.half_y - 1e-9


def boxes_overlap(a: Box, b: Box) -> bool:
    """Return whether two boxes overlap; touching is no overlap."""
    return a.low < b.high - 1e-9 and b.low < a.high - 1e-9 and plans_overlap(a, b)


def grown(box: Box, gap: float) -> Box:
    """Return a box with a larger plan."""
    return box._replace(half_x=box.half_x + gap, half_y=box.half_y + gap)


def plan_distance(x: float, y: float, box: Box) -> float:
    """Return the distance in the plan from a point to a box [m]; 0 inside."""
    dx, dy = x - box.x, y - box.y
    u = abs(dx * box.cos + dy * box.sin) - box.half_x
    v = abs(dy * box.cos - dx * box.sin) - box.half_y
    return math.hypot(max(u, 0.0), max(v, 0.0))
