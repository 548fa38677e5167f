# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A room while it is furnished: it places items where they fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from warpvis.situations.rooms._boxes import (
    Box,
    Extent,
    boxes_of,
    boxes_overlap,
    direction,
    extent_of,
    extents_meet,
    grown,
    plan_distance,
    plans_overlap,
)
from warpvis.situations.rooms._draws import Draws
from warpvis.situations.rooms._outline import Outline
from warpvis.situations.rooms._walkable import STEP_HEIGHT, WalkGrid, reached_area
from warpvis.situations.rooms.shapes import CATEGORIES, Shape, get_shape

_WINDOW_DEPTH = 0.3
"""Items that are higher than a window's lower edge stay this far away from it [m]."""
_MIN_REACHED = 0.22
"""Least share of the floor that a person can reach."""
WALK_RADIUS = 0.3
"""Radius of a walking person [m]."""
GAP = 0.015
"""Distance between furniture [m]."""


@dataclass(eq=False)
class Placed:
    """An item at its place."""

    shape: Shape
    color: str
    x: float
    y: float
    z: float
    yaw: float
    """Direction of its front [degrees]."""
    support: Placed | str | None
    """The item it stands on, or "floor", "ceiling" or the name of a wall."""
    level: str = ""
    """Name of the support's rectangle."""
    boxes: list[Box] = field(default_factory=list)
    extent: Extent = (0.0,) * 6
    name: str = ""

    def __post_init__(self) -> None:
        self.boxes = boxes_of(self.shape, self.x, self.y, self.z, self.yaw)
        self.extent = extent_of(self.boxes)

    def point(self, forward: float, left: float) -> tuple[float, float]:
        """Return a point of its frame in the room."""
        c, s = direction(self.yaw)
        return round(self.x + c * forward - s * left, 4), round(self.y + s * forward + c * left, 4)

    def front_zone(self, depth: float) -> Box:
        """Return the floor in front of it."""
        (low, high) = self.shape.bounds
        x, y = self.point(high[0] + depth / 2, (low[1] + high[1]) / 2)
        c, s = direction(self.yaw)
        return Box(x, y, c, s, depth / 2 - 0.005, (high[1] - low[1]) / 2, 0.0, 1.9)


class Plan:
    """A room that is furnished item by item."""

    def __init__(self, draws: Draws, outline: Outline, clutter: float) -> None:
        """Start with an empty room."""
        self.draws, self.outline, self.clutter = draws, outline, clutter
        self.items: list[Placed] = []
        self.zones: list[tuple[Box, Placed | None]] = []
        """Parts of the floor that furniture leaves free, and the item they belong to."""
        self.keep_clear: list[Box] = []
        """Doors and windows, which items on the floor and on walls leave free."""
        self.grid = WalkGrid(outline, WALK_RADIUS)
        for opening in outline.openings:
            wall = outline.walls[opening.wall]
            if opening.kind == "door":
                self.zones.append((outline.door_zone(opening), None))
                self.keep_clear.append(outline.door_zone(opening))
            else:
                self.keep_clear.append(
                    wall.strip(opening.start, opening.start + opening.width, _WINDOW_DEPTH, opening.low, opening.high)
                )

    def shape(self, category: str, **parameters: Any) -> Shape:
        """Return a shape of a category: a random variant, or that of the parameters."""
        variants = CATEGORIES[category].variants
        return get_shape(category, parameters) if parameters else get_shape(category, self.draws.choice(variants))

    def color(self, category: str) -> str:
        """Return a random color of a category."""
        return self.draws.choice(CATEGORIES[category].colors)

    def fits(self, item: Placed, *, group: Sequence[Placed] = (), gap: float = GAP, zones: bool = True) -> bool:
        """Return whether an item overlaps neither walls, openings nor other items; `group` may use its zones."""
        if not all(self.outline.contains_box(box) for box in item.boxes):
            return False
        boxes = [grown(box, gap) for box in item.boxes] if gap else item.boxes
        extent = extent_of(boxes) if gap else item.extent
        for other in self.items:
            if extents_meet(extent, other.extent) and any(boxes_overlap(a, b) for a in boxes for b in other.boxes):
                return False
        for clear in self.keep_clear:
            if any(boxes_overlap(box, clear) for box in item.boxes):
                return False
        if zones:
            low = [box for box in item.boxes if box.low < 1.9 and box.high > STEP_HEIGHT]
            for zone, owner in self.zones:
                if owner not in group and any(plans_overlap(box, zone) for box in low):
                    return False
        return True

    def keeps_paths(self, item: Placed) -> bool:
        """Block the floor below an item; undo this and return False if doors or too much of the floor are cut off."""
        if item.extent[5] <= STEP_HEIGHT or item.extent[2] >= 1.9:
            return True
        grid = self.grid.copy()
        grid.block(item.boxes)
        found, joined = reached_area(grid, self.outline)
        if not joined or found.sum() * 0.01 < _MIN_REACHED * self.outline.area:
            return False
        self.grid = grid
        return True

    def add(self, item: Placed, *, access: float | None = None) -> Placed:
        """Add an item without checks, and reserve the floor in front of it."""
        self.items.append(item)
        depth = CATEGORIES[item.shape.category].access if access is None else access
        if depth > 0:
            self.zones.append((item.front_zone(depth), item))
        return item

    def put(
        self,
        shape: Shape,
        at: tuple[float, float],
        yaw: float,
        *,
        color: str | None = None,
        z: float = 0.0,
        support: Placed | str = "floor",
        group: Sequence[Placed] = (),
        gap: float = GAP,
        access: float | None = None,
    ) -> Placed | None:
        """Place an item if it fits and people can still walk; return None otherwise."""
        word = color or self.color(shape.category)
        item = Placed(shape, word, *at, z, round(yaw % 360, 1), support)
        rug = self._rug_below(item) if support == "floor" else None
        if rug is not None:
            item = Placed(shape, word, *at, rug.extent[5], item.yaw, rug)
        if not self.fits(item, group=group, gap=gap):
            return None
        depth = CATEGORIES[shape.category].access if access is None else access
        if depth > 0 and support == "floor" and not self._has_access(item, depth, group):
            return None
        if isinstance(support, str) and not self.keeps_paths(item):
            return None
        return self.add(item, access=access)

    def _rug_below(self, item: Placed) -> Placed | None:
        """Return the rug on which an item stands with its whole plan."""
        for rug in self.items:
            if rug.shape.category == "rug" and extents_meet(item.extent, rug.extent):
                floor = rug.boxes[0]
                corners = [corner for box in item.boxes for corner in box.corners]
                if all(plan_distance(x, y, floor) == 0 for x, y in corners):
                    return rug
        return None

    def _has_access(self, item: Placed, depth: float, group: Sequence[Placed]) -> bool:
        """Return whether the floor in front of an item is free."""
        zone = item.front_zone(depth)
        if not self.outline.contains_box(zone):
            return False
        extent = extent_of([zone])
        return not any(
            other not in group
            and other.extent[5] > STEP_HEIGHT
            and extents_meet(extent, other.extent)
            and any(boxes_overlap(zone, box) for box in other.boxes)
            for other in self.items
        )

    def against_wall(
        self,
        shape: Shape,
        *,
        color: str | None = None,
        gap: float = 0.02,
        tries: int = 14,
        walls: Sequence[int] | None = None,
        below_window: bool = False,
        in_corner: bool = False,
        access: float | None = None,
        group: Sequence[Placed] = (),
    ) -> Placed | None:
        """Place an item with its back against a wall; first below windows or in corners, if requested."""
        low, high = shape.bounds
        width = high[1] - low[1]
        windows = [o for o in self.outline.openings if o.kind == "window"]
        for attempt in range(tries):
            if below_window and windows and attempt < tries // 2:
                window = self.draws.choice(windows)
                index, along = window.wall, window.start + window.width / 2 + self.draws.uniform(-0.2, 0.2)
            else:
                allowed = range(len(self.outline.walls)) if walls is None else walls
                index = self.draws.weighted([(i, max(self.outline.walls[i].length - width, 0.01)) for i in allowed])
                room = self.outline.walls[index].length - width - 0.04
                if room < 0:
                    continue
                share = self.draws.choice((0.0, 1.0)) if in_corner and attempt < 2 * tries // 3 else self.draws.unit()
                along = 0.02 + width / 2 + share * room
            wall = self.outline.walls[index]
            found = self.put(
                shape,
                wall.point(round(along, 3), round(gap - low[0], 4)),
                wall.yaw,
                color=color,
                access=access,
                group=group,
            )
            if found is not None:
                return found
        return None

    def on_wall(
        self, shape: Shape, low: float, *, color: str | None = None, tries: int = 10, above: Placed | None = None
    ) -> Placed | None:
        """Hang an item on a wall at a height, or above another item."""
        width = shape.size[1]
        for _ in range(tries):
            index = self.draws.weighted([(i, wall.length) for i, wall in enumerate(self.outline.walls)])
            if above is not None:
                index = next(
                    i for i, wall in enumerate(self.outline.walls) if wall.yaw == above.yaw and self._near(i, above)
                )
            wall = self.outline.walls[index]
            room = wall.length - width - 0.1
            if room < 0:
                return None
            along = 0.05 + width / 2 + self.draws.unit() * room
            if above is not None:
                along = (above.x - wall.x) * wall.dx + (above.y - wall.y) * wall.dy + self.draws.uniform(-0.1, 0.1)
            at = wall.point(round(along, 3), 0.0)
            found = self.put(shape, at, wall.yaw, z=low, support=f"wall_{index + 1}", color=color)
            if found is not None:
                return found
        return None

    def _near(self, index: int, item: Placed) -> bool:
        """Return whether an item's back is near a wall."""
        wall = self.outline.walls[index]
        inward = (item.y - wall.y) * wall.dx - (item.x - wall.x) * wall.dy
        along = (item.x - wall.x) * wall.dx + (item.y - wall.y) * wall.dy
        return 0 <= inward < item.shape.size[0] / 2 + 0.2 and 0 <= along <= wall.length

    def on_floor(
        self,
        shape: Shape,
        *,
        tries: int = 12,
        color: str | None = None,
        yaw: float | None = None,
        quarter: bool = False,
    ) -> Placed | None:
        """Place an item anywhere on the floor."""
        for _ in range(tries):
            x0, y0, x1, y1 = self.draws.choice(self.outline.rectangles)
            at = round(self.draws.uniform(x0, x1), 3), round(self.draws.uniform(y0, y1), 3)
            angle = yaw if yaw is not None else (90.0 * self.draws.below(4) if quarter else self.draws.uniform(0, 360))
            found = self.put(shape, at, angle, color=color)
            if found is not None:
                return found
        return None

    def clear_spot(self, size: tuple[float, float], yaw: float, tries: int = 12) -> tuple[float, float] | None:
        """Draw the center of a rectangle of the floor without furniture, of a size along the axes of an item."""
        for _ in range(tries):
            x0, y0, x1, y1 = self.draws.choice(self.outline.rectangles)
            at = round(self.draws.uniform(x0, x1), 3), round(self.draws.uniform(y0, y1), 3)
            box = Box(*at, *direction(yaw), size[0] / 2, size[1] / 2, STEP_HEIGHT, 1.0)
            extent = extent_of([box])
            if (
                self.outline.contains_box(box)
                and not any(boxes_overlap(box, clear) for clear in self.keep_clear)
                and not any(
                    extents_meet(extent, item.extent) and any(boxes_overlap(box, other) for other in item.boxes)
                    for item in self.items
                )
            ):
                return at
        return None

    def in_front(
        self,
        shape: Shape,
        target: Placed,
        distance: float,
        *,
        aside: float = 0.0,
        turn: float = 180.0,
        color: str | None = None,
        access: float | None = None,
        group: Sequence[Placed] = (),
    ) -> Placed | None:
        """Place an item in front of another one, at a distance between their edges, by default facing it."""
        reach = -shape.bounds[0][0] if turn == 0 else (shape.bounds[1][0] if turn == 180 else shape.size[1] / 2)
        at = target.point(target.shape.bounds[1][0] + distance + reach, aside)
        return self.put(shape, at, target.yaw + turn, color=color, access=access, group=(target, *group))

    def beside(
        self,
        shape: Shape,
        target: Placed,
        side: int,
        *,
        gap: float = 0.04,
        turn: float = 0.0,
        color: str | None = None,
        align_back: bool = True,
        access: float | None = None,
    ) -> Placed | None:
        """Place an item to the left (1) or right (-1) of another one, with the backs aligned."""
        low, high = target.shape.bounds
        left = side * (max(abs(low[1]), abs(high[1])) + gap + shape.size[1] / 2)
        forward = low[0] - shape.bounds[0][0] if align_back else 0.0
        return self.put(
            shape, target.point(forward, left), target.yaw + turn, color=color, access=access, group=(target,)
        )
