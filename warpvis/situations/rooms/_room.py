# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rooms: their geometry, items and lights, and where there is space for more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import check_flag, check_number, check_text
from warpvis.core.poses import check_up
from warpvis.core.types import DeviceLike, Json
from warpvis.errors import SceneError
from warpvis.scene import Scene
from warpvis.situations.rooms import _places
from warpvis.situations.rooms._build import build_scene
from warpvis.situations.rooms._items import RoomItem, RoomLight, Seat, SupportPlace
from warpvis.situations.rooms._json import describe, restore
from warpvis.situations.rooms._outline import Opening, Outline


@dataclass(frozen=True, eq=False)
class Room:
    """A furnished room; z is up, the floor is z = 0, and the floor's bounding box is centered at the origin."""

    kind: str
    """``"living room"``, ``"office"``, ``"kitchen"``, ``"workshop"``, ``"bedroom"`` or ``"lab"``."""
    seed: int
    """The seed it was generated with."""
    outline: Outline
    """Floor, walls, doors and windows."""
    items: tuple[RoomItem, ...]
    """Furniture and objects."""
    lamps: tuple[RoomLight, ...]
    """Lamps at the ceiling."""
    wall_color: str = "white"
    floor_material: str = "oak"

    @property
    def floor(self) -> tuple[tuple[float, float], ...]:
        """Corners of the floor, counterclockwise [m]: a rectangle, or an L-shape."""
        return self.outline.floor

    @property
    def height(self) -> float:
        """Height of the ceiling [m]."""
        return self.outline.height

    @property
    def area(self) -> float:
        """Area of the floor [m2]."""
        return self.outline.area

    @property
    def doors(self) -> tuple[Opening, ...]:
        """The doors."""
        return tuple(opening for opening in self.outline.openings if opening.kind == "door")

    @property
    def windows(self) -> tuple[Opening, ...]:
        """The windows, which have no panes."""
        return tuple(opening for opening in self.outline.openings if opening.kind == "window")

    @cached_property
    def seats(self) -> tuple[Seat, ...]:
        """Places to sit: on chairs, stools, sofas and beds, if no object lies there."""
        return tuple(_places.free_seats(self.items))

    @cached_property
    def free_floor(self) -> _places.FreeFloor:
        """The floor that a person of a radius of 0.3 m can reach from the doors."""
        return _places.FreeFloor(self.outline, self.items)

    @cached_property
    def free_space(self) -> _places.FreeSpace:
        """The space for further objects."""
        return _places.FreeSpace(self.outline, self.items)

    def item(self, name: str) -> RoomItem:
        """Return the item with a name."""
        check_text(name, "name", SceneError)
        for item in self.items:
            if item.name == name:
                return item
        raise SceneError(f"the room has no item {name!r}; Room.items lists all")

    def standing_places(self, rng: np.random.Generator, count: int, radius: float = 0.3) -> NDArray[np.float64]:
        """Draw positions where a person or a robot can stand, uniformly over the free floor.

        Args:
            rng: Source of random numbers.
            count: Number of positions.
            radius: Radius of the standing body [m], at least 0.05: a disk of this radius is at no item and no wall, and
                such a body can reach it from a door.

        Returns:
            Positions on the floor or on a rug [m], shape ``(count, 3)``; shape ``(0, 3)`` if there is no such place.
        """
        radius = check_number(radius, "radius", minimum=0.05, maximum=5.0, error=SceneError)
        floor = (
            self.free_floor if radius == self.free_floor.radius else _places.FreeFloor(self.outline, self.items, radius)
        )
        return floor.sample(rng, count)

    def support_places(
        self,
        rng: np.random.Generator,
        size: tuple[float, float, float],
        count: int,
        *,
        categories: Sequence[str] | None = None,
    ) -> list[SupportPlace]:
        """Draw free places for a further object, on tables, shelves and other supports.

        Args:
            rng: Source of random numbers.
            size: Sides of the object's box [m].
            count: Number of places, which may overlap each other.
            categories: Categories of supports; all by default.

        Returns:
            At most `count` places: fewer if there is little space.
        """
        return _places.support_places(self.items, self.outline, rng, size, count, categories)

    def build(
        self,
        device: DeviceLike = "cpu",
        *,
        up: Literal["z", "y"] = "z",
        ceiling: bool = True,
        movable: bool = True,
    ) -> Scene:
        """Return the scene of the room: movable items are movable, and all else is static.

        Args:
            device: Device that renders the scene.
            up: The scene's vertical axis; with ``"y"``, the room's z is y, and its y is -z.
            ceiling: Whether it has a ceiling. Without one, it is seen from above.
            movable: Whether movable items are movable. Static ones render faster.
        """
        check_up(up)
        ceiling = check_flag(ceiling, "ceiling", SceneError)
        movable = check_flag(movable, "movable", SceneError)
        colors = self.wall_color, self.floor_material
        return build_scene(self.outline, self.items, self.lamps, colors, device, up, ceiling=ceiling, movable=movable)

    def to_dict(self) -> dict[str, Json]:
        """Return a description for JSON, from which `from_dict` restores the room."""
        names = ("kind", "seed", "wall_color", "floor_material")
        return describe({name: getattr(self, name) for name in names}, self.outline, self.items, self.lamps)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Room:
        """Restore a room from `to_dict`.

        Raises:
            SceneError: If a value is missing or invalid.
        """
        return cls(**restore(data))
