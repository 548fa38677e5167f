# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Where further people and objects have space in a room."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_items, check_number, check_whole
from warpvis.errors import SceneError
from warpvis.situations.rooms._boxes import Box, boxes_overlap, direction, extent_of, extents_meet, plan_distance
from warpvis.situations.rooms._items import RoomItem, Seat, SupportPlace
from warpvis.situations.rooms._outline import Outline
from warpvis.situations.rooms._walkable import BODY_HEIGHT, CELL, STEP_HEIGHT, WalkGrid, reached_area
from warpvis.situations.rooms.shapes import CATEGORIES

WALK_RADIUS = 0.3
"""Radius of a walking person [m]."""
_ROUNDS = 40
_MAX_COUNT = 1_000_000


class FreeFloor:
    """The floor where a body of a radius can stand, and that it can reach from the doors."""

    def __init__(self, outline: Outline, items: Sequence[RoomItem], radius: float = WALK_RADIUS) -> None:
        """Find the free cells of the floor."""
        self.radius = radius
        """Radius of the body [m]."""
        self.cell = CELL
        """Size of a cell of `mask` [m]."""
        self._outline = outline
        grid = WalkGrid(outline, radius)
        boxes = [box for item in items for box in item.boxes if box.low < BODY_HEIGHT and box.high > STEP_HEIGHT]
        grid.block(boxes)
        self.mask, self.joins_doors = reached_area(grid, outline)
        """Cells whose center is free, shape ``(rows, columns)``: rows along y, columns along x; and whether all doors
        are connected."""
        self.origin = outline.bounds[:2]
        """Lower corner of the first cell [m]."""
        self._obstacles = np.array([box[:6] for box in boxes]).reshape(-1, 6)
        rugs = [item.boxes[0] for item in items if item.category == "rug"]
        self._rugs = np.array([rug[:6] for rug in rugs]).reshape(-1, 6)
        self._rug_heights = np.array([rug.high for rug in rugs])

    @property
    def area(self) -> float:
        """Its area, the positions of the body's center [m2]."""
        return float(self.mask.sum()) * CELL * CELL

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether the body fits at positions, shape ``(n, 2)``, in cells that it can reach; shape ``(n,)``."""
        rows, columns = self.mask.shape
        cells = np.floor((points - self.origin) / CELL).astype(int)
        inside = ((cells >= 0) & (cells < (columns, rows))).all(axis=1)
        found = np.zeros(len(points), dtype=bool)
        found[inside] = self.mask[cells[inside, 1], cells[inside, 0]]
        walls = np.array([self._outline.distance_to_wall(x, y) for x, y in points.tolist()])
        return found & (walls >= self.radius) & (_distances(points, self._obstacles) >= self.radius)

    def sample(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Draw positions uniformly, on the floor or on a rug [m]: ``(count, 3)``, or ``(0, 3)`` if there are none."""
        check_generator(rng)
        count = check_whole(count, "count", minimum=0, error=SceneError)
        if count > _MAX_COUNT:
            raise SceneError(f"count must be at most {_MAX_COUNT:,}, got {count:,}")
        cells = np.argwhere(self.mask)[:, ::-1]
        found = np.empty((0, 2))
        for _ in range(_ROUNDS if len(cells) else 0):
            if len(found) >= count:
                break
            wanted = 2 * (count - len(found)) + 8
            chosen = cells[rng.integers(0, len(cells), wanted)]
            points = self.origin + (chosen + rng.random((wanted, 2))) * CELL
            found = np.concatenate([found, points[self.contains(points)]])
        if len(found) < count:
            found = found[:0]
        found = found[:count]
        near = _gaps(found, self._rugs) < self.radius
        heights = np.where(near, self._rug_heights, 0.0).max(axis=1, initial=0.0)
        return np.column_stack([found, heights])


class FreeSpace:
    """The space for further objects."""

    def __init__(self, outline: Outline, items: Sequence[RoomItem]) -> None:
        """Collect the boxes of the items."""
        self._outline = outline
        self._boxes = [box for item in items for box in item.boxes]

    def holds(self, boxes: Sequence[Box], overhang: float) -> bool:
        """Return whether the boxes of an object overlap nothing, and its lowest ones stand on the floor or an item.

        Args:
            boxes: The boxes.
            overhang: Length by which they may project over the item [m].
        """
        if not all(self._outline.contains_box(box) for box in boxes):
            return False
        lifted = [box._replace(low=box.low + 1e-4) for box in boxes]
        if any(boxes_overlap(a, b) for a in lifted for b in self._boxes):
            return False
        z = min(box.low for box in boxes)
        corners = [corner for box in boxes if box.low < z + 1e-3 for corner in box.corners]
        supports = [box for box in self._boxes if abs(box.high - z) < 1e-3]
        return z <= 1e-3 or any(all(plan_distance(*corner, box) <= overhang for corner in corners) for box in supports)


def _gaps(points: NDArray[np.float64], boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return distances in the plan from points to boxes, shape ``(points, boxes)``."""
    offsets = points[:, None] - boxes[None, :, :2]
    c, s = boxes[:, 2], boxes[:, 3]
    along = np.abs(offsets[..., 0] * c + offsets[..., 1] * s) - boxes[:, 4]
    across = np.abs(offsets[..., 1] * c - offsets[..., 0] * s) - boxes[:, 5]
    gaps: NDArray[np.float64] = np.hypot(np.maximum(along, 0), np.maximum(across, 0))
    return gaps


def _distances(points: NDArray[np.float64], boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return distances in the plan from points to the nearest box, shape ``(points,)``."""
    found: NDArray[np.float64] = _gaps(points, boxes).min(axis=1, initial=math.inf)
    return found


def check_generator(rng: object) -> None:
    """Raise a `SceneError` unless `rng` is a NumPy generator."""
    if not isinstance(rng, np.random.Generator):
        raise SceneError(f"rng must be a numpy.random.Generator, such as numpy.random.default_rng(0), got {rng!r}")


def free_seats(items: Sequence[RoomItem]) -> Iterator[Seat]:
    """Yield the seats where the upper body and the lap of a sitting person overlap no item."""
    for item in items:
        x, y, z = item.pose[:3]
        yaw = math.degrees(item.yaw)
        c, s = direction(round(yaw, 6))
        for spot in item.shape.seats:
            u, v, w = spot.position
            at = (round(x + c * u - s * v, 6), round(y + s * u + c * v, 6), round(z + w, 6))
            heading = math.radians(yaw + spot.heading)
            cos, sin = math.cos(heading), math.sin(heading)
            torso = Box(at[0] - 0.06 * cos, at[1] - 0.06 * sin, cos, sin, 0.1, 0.18, at[2] + 0.01, at[2] + 0.8)
            lap = Box(at[0] + 0.14 * cos, at[1] + 0.14 * sin, cos, sin, 0.1, 0.18, at[2] + 0.01, at[2] + 0.16)
            if not any(_meets(box, other) for box in (torso, lap) for other in items if other is not item):
                yield Seat(item.name, at, math.remainder(heading, 2 * math.pi))


def _meets(box: Box, item: RoomItem) -> bool:
    return extents_meet(extent_of([box]), item.extent) and any(boxes_overlap(box, other) for other in item.boxes)


def support_places(
    items: Sequence[RoomItem],
    outline: Outline,
    rng: np.random.Generator,
    size: tuple[float, float, float],
    count: int,
    categories: Sequence[str] | None,
) -> list[SupportPlace]:
    """Draw free places on supports; see `Room.support_places`."""
    check_generator(rng)
    count = check_whole(count, "count", minimum=0, error=SceneError)
    numbers = as_items(size, "size", SceneError)
    if len(numbers) != 3:
        raise SceneError(f"size must be three numbers, the sides of a box [m], got {size!r}")
    x, y, z = (check_number(value, "size", minimum=0.001, maximum=5.0, error=SceneError) for value in numbers)
    if categories is not None:
        for name in as_items(categories, "categories", SceneError):
            if not isinstance(name, str) or name not in CATEGORIES:
                raise SceneError(f"categories must be names of categories of items, got {name!r}")
    levels = [
        (item, level, level.half[0] * level.half[1])
        for item in items
        if categories is None or item.category in categories
        for level in item.shape.supports
        if z < level.clearance and min(x, y) <= 2 * min(level.half) and max(x, y) <= 2 * math.hypot(*level.half)
    ]
    if not levels or count == 0:
        return []
    shares = np.cumsum([area for _, _, area in levels])
    found: list[SupportPlace] = []
    for _ in range(_ROUNDS * min(count, 1000)):
        item, level, _ = levels[int(np.searchsorted(shares, rng.random() * shares[-1], side="right"))]
        yaw = 360 * rng.random()
        c, s = direction(yaw)
        a, b = (abs(c) * x + abs(s) * y) / 2, (abs(s) * x + abs(c) * y) / 2
        if a > level.half[0] or b > level.half[1]:
            continue
        u = level.center[0] + rng.uniform(a - level.half[0], level.half[0] - a)
        v = level.center[1] + rng.uniform(b - level.half[1], level.half[1] - b)
        ic, is_ = direction(round(math.degrees(item.yaw), 6))
        at = (item.pose[0] + ic * u - is_ * v, item.pose[1] + is_ * u + ic * v, round(item.pose[2] + level.z, 6))
        turn = math.degrees(item.yaw) + yaw
        box = Box(at[0], at[1], *direction(turn), x / 2 + 0.002, y / 2 + 0.002, at[2] + 1e-6, at[2] + z)
        if outline.contains_box(box) and not any(_meets(box, other) for other in items):
            half = math.radians(turn) / 2
            found.append(SupportPlace((*at, 0.0, 0.0, math.sin(half), math.cos(half)), item.name, level.name))
            if len(found) == count:
                break
    return found
