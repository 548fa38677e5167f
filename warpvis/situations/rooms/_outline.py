# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Floor plans: rectangles and L-shapes, their walls, doors and windows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from warpvis.situations.rooms._boxes import Box, plans_overlap
from warpvis.situations.rooms._draws import Draws

DOOR_DEPTH = 0.9
"""Depth of the floor in front of a door that is kept free [m]."""
_DOOR_HEIGHT = 2.05
_CORNER = 0.25
"""Least distance from an opening to a corner [m]."""


@dataclass(frozen=True)
class Opening:
    """A door or a window in a wall."""

    kind: Literal["door", "window"]
    name: str
    wall: int
    """Index of its wall: that from corner `wall` of the floor to the next."""
    start: float
    """Distance along the wall from its first corner [m]."""
    width: float
    low: float
    """Height of its lower edge [m]."""
    high: float
    is_open: bool = True
    """Whether one can see through it: always for windows, and for doors that are not closed."""


@dataclass(frozen=True)
class Wall:
    """The inner face of a wall; the room is to its left."""

    x: float
    y: float
    dx: float
    """Unit direction, along an axis."""
    dy: float
    length: float

    @property
    def yaw(self) -> float:
        """Direction into the room [degrees]."""
        return {(1.0, 0.0): 90.0, (0.0, 1.0): 180.0, (-1.0, 0.0): 270.0, (0.0, -1.0): 0.0}[(self.dx, self.dy)]

    def point(self, along: float, inward: float) -> tuple[float, float]:
        """Return a point at a distance along the wall and one into the room [m]."""
        x, y = self.x + along * self.dx - inward * self.dy, self.y + along * self.dy + inward * self.dx
        return round(x, 4), round(y, 4)

    def strip(self, start: float, end: float, depth: float, low: float, high: float) -> Box:
        """Return the box in front of a part of the wall, or behind it for a negative depth."""
        along, inward = (start + end) / 2, depth / 2
        x, y = self.x + along * self.dx - inward * self.dy, self.y + along * self.dy + inward * self.dx
        return Box(x, y, self.dx, self.dy, (end - start) / 2, abs(depth) / 2, low, high)


@dataclass(frozen=True)
class Outline:
    """The floor of a room and its openings; its bounding box is centered at the origin."""

    floor: tuple[tuple[float, float], ...]
    """Corners of the floor, counterclockwise [m]; all edges are parallel to an axis."""
    height: float
    thickness: float
    """Thickness of the walls [m], outward from the edges of the floor."""
    openings: tuple[Opening, ...]

    @cached_property
    def walls(self) -> tuple[Wall, ...]:
        """The walls, from each corner to the next."""
        found = []
        for (x, y), (u, v) in zip(self.floor, (*self.floor[1:], self.floor[0]), strict=True):
            length = round(abs(u - x) + abs(v - y), 6)
            found.append(Wall(x, y, float((u > x) - (u < x)), float((v > y) - (v < y)), length))
        return tuple(found)

    @cached_property
    def rectangles(self) -> tuple[tuple[float, float, float, float], ...]:
        """Disjoint rectangles that cover the floor: minimum x, y, maximum x, y."""
        xs, ys = sorted({x for x, _ in self.floor}), sorted({y for _, y in self.floor})
        notch = self.notch
        if notch is None:
            return ((xs[0], ys[0], xs[-1], ys[-1]),)
        # The notch is at one corner of the bounding box: one full-width strip, and the rest beside the notch.
        low, high = notch.y - notch.half_y, notch.y + notch.half_y
        left, right = notch.x - notch.half_x, notch.x + notch.half_x
        strip = (xs[0], ys[0], xs[-1], low) if high >= ys[-1] - 1e-9 else (xs[0], high, xs[-1], ys[-1])
        bottom, top = (low, ys[-1]) if high >= ys[-1] - 1e-9 else (ys[0], high)
        rest = (xs[0], bottom, left, top) if right >= xs[-1] - 1e-9 else (right, bottom, xs[-1], top)
        return (tuple(round(value, 6) for value in strip), tuple(round(value, 6) for value in rest))  # type: ignore[return-value]

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """Minimum x, y, maximum x, y of the floor."""
        xs, ys = [x for x, _ in self.floor], [y for _, y in self.floor]
        return min(xs), min(ys), max(xs), max(ys)

    @cached_property
    def notch(self) -> Box | None:
        """The part of the bounding box that an L-shaped floor lacks; None for a rectangle."""
        if len(self.floor) == 4:
            return None
        x0, y0, x1, y1 = self.bounds
        inner = next(p for p in self.floor if x0 < p[0] < x1 and y0 < p[1] < y1)
        corner = next((x, y) for x in (x0, x1) for y in (y0, y1) if (x, y) not in self.floor)
        (a, b), (c, d) = inner, corner
        return Box((a + c) / 2, (b + d) / 2, 1.0, 0.0, abs(a - c) / 2, abs(b - d) / 2, 0.0, self.height)

    @cached_property
    def area(self) -> float:
        """Area of the floor [m2]."""
        return sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in self.rectangles)

    def contains_box(self, box: Box) -> bool:
        """Return whether the plan of a box is within the floor, and its top below the ceiling."""
        x0, y0, x1, y1 = self.bounds
        dx = abs(box.cos) * box.half_x + abs(box.sin) * box.half_y
        dy = abs(box.sin) * box.half_x + abs(box.cos) * box.half_y
        edge = 1e-9
        if box.x - dx < x0 - edge or box.x + dx > x1 + edge or box.y - dy < y0 - edge or box.y + dy > y1 + edge:
            return False
        return box.high <= self.height + edge and (self.notch is None or not plans_overlap(box, self.notch))

    def distance_to_wall(self, x: float, y: float) -> float:
        """Return the distance from a point to the nearest wall [m], negative outside of the floor."""
        x0, y0, x1, y1 = self.bounds
        inside = min(x - x0, x1 - x, y - y0, y1 - y)
        if self.notch is None:
            return inside
        dx, dy = abs(x - self.notch.x) - self.notch.half_x, abs(y - self.notch.y) - self.notch.half_y
        if dx <= 0 and dy <= 0:
            return max(dx, dy)
        return min(inside, (max(dx, 0.0) ** 2 + max(dy, 0.0) ** 2) ** 0.5)

    def door_zone(self, door: Opening) -> Box:
        """Return the floor in front of a door that is kept free."""
        return self.walls[door.wall].strip(
            door.start - 0.05, door.start + door.width + 0.05, DOOR_DEPTH, 0.0, door.high
        )


def draw_outline(draws: Draws, size: tuple[float, float], *, may_be_l: bool, windows: tuple[int, int]) -> Outline:
    """Draw the floor within a bounding box of a size [m], and doors and windows."""
    x, y = size[0] / 2, size[1] / 2
    floor = [(-x, -y), (x, -y), (x, y), (-x, y)]
    if may_be_l and min(size) >= 3.6 and draws.chance(0.35):
        cut_x = draws.step(size[0] * 0.25, size[0] * 0.4, 0.1)
        cut_y = draws.step(size[1] * 0.25, size[1] * 0.4, 0.1)
        cut_x, cut_y = round(cut_x, 1), round(cut_y, 1)
        sign_x, sign_y = draws.choice((-1, 1)), draws.choice((-1, 1))
        corner = floor.index((sign_x * x, sign_y * y))
        a, b = sign_x * x, sign_y * y
        inner = [(a - sign_x * cut_x, b), (a - sign_x * cut_x, b - sign_y * cut_y), (a, b - sign_y * cut_y)]
        # Counterclockwise, one enters the corner along x at the lower right and upper left, else along y.
        if sign_x * sign_y > 0:
            inner.reverse()
        floor = floor[:corner] + inner + floor[corner + 1 :]
    corners = tuple((round(a, 4), round(b, 4)) for a, b in floor)
    height = draws.step(2.5, 3.0, 0.1)
    bare = Outline(corners, height, draws.choice((0.12, 0.15, 0.2)), ())
    openings: list[Opening] = []
    doors = 2 if bare.area > 18 and draws.chance(0.45) else 1
    for number in range(doors):
        width = draws.choice((0.8, 0.9, 1.0))
        found = _free_spot(bare, draws, openings, width, others=number > 0)
        if found is not None:
            openings.append(Opening("door", f"door_{number + 1}", *found, width, 0.0, _DOOR_HEIGHT, draws.chance(0.35)))
    for number in range(draws.integer(*windows)):
        width = draws.step(0.8, 2.0, 0.2)
        found = _free_spot(bare, draws, openings, width, others=True)
        if found is not None:
            low = draws.choice((0.8, 0.9, 1.0))
            openings.append(
                Opening("window", f"window_{number + 1}", *found, width, low, round(min(height - 0.3, 2.2), 2))
            )
    return Outline(corners, height, bare.thickness, tuple(openings))


def _free_spot(
    outline: Outline, draws: Draws, openings: list[Opening], width: float, *, others: bool
) -> tuple[int, float] | None:
    """Draw a wall and a start for an opening that keeps a distance from others; if `others`, avoid walls with doors."""
    for attempt in range(30):
        index = draws.weighted([(number, wall.length) for number, wall in enumerate(outline.walls)])
        room = outline.walls[index].length - width - 2 * _CORNER
        if room < 0:
            continue
        start = draws.step(_CORNER, _CORNER + room, 0.05)
        on_wall = [opening for opening in openings if opening.wall == index]
        if others and attempt < 12 and any(opening.kind == "door" for opening in on_wall):
            continue
        if all(start > o.start + o.width + 0.4 or start + width < o.start - 0.4 for o in on_wall):
            return index, start
    return None
