# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Items of a room, seats, and places on supports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.scene.materials import Appearance
from warpvis.situations.rooms._boxes import Box, Extent, boxes_of, extent_of
from warpvis.situations.rooms.shapes import CATEGORIES, Shape, get_appearance, get_shape

Pose = tuple[float, float, float, float, float, float, float]


@dataclass(frozen=True)
class RoomItem:
    """An item of a room: a piece of furniture or an object."""

    name: str
    """Its unique name: category and number, with underscores: ``"coffee_table_1"``."""
    category: str
    """Its class in words: ``"coffee table"``."""
    color: str
    """The word for its color: ``"red"``."""
    pose: Pose
    """Item to room, ``x y z qx qy qz qw``; the item's x points to its front, z up, and z = 0 is its lowest point."""
    support: str
    """Name of the item it stands on, or ``"floor"``, ``"ceiling"``, or that of the wall it hangs on: ``"wall_2"``."""
    level: str = ""
    """Name of the support's surface: ``"top"``, ``"shelf 2"``; empty for floor, walls and ceiling."""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    """Parameters of its shape."""

    @cached_property
    def shape(self) -> Shape:
        """Its shape, which items with equal category and parameters share."""
        return get_shape(self.category, self.parameters)

    @property
    def mesh(self) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Vertices in its frame [m], shape ``(n, 3)``, and faces, ``(m, 3)``; the same arrays for equal shapes."""
        return self.shape.vertices, self.shape.faces

    @property
    def appearance(self) -> Appearance:
        """Its colors; the same object for equal shapes and colors."""
        return get_appearance(self.shape, self.color)

    @property
    def size(self) -> tuple[float, float, float]:
        """Sides of its box in its own frame [m]."""
        return self.shape.size

    @property
    def movable(self) -> bool:
        """Whether it is movable: objects, and furniture that one person moves."""
        return CATEGORIES[self.category].movable

    @property
    def words(self) -> str:
        """Color and category: ``"red mug"``."""
        return f"{self.color} {self.category}"

    @property
    def yaw(self) -> float:
        """Direction of its front, about z [rad]."""
        return 2 * float(np.arctan2(self.pose[5], self.pose[6]))

    @cached_property
    def boxes(self) -> tuple[Box, ...]:
        """Upright boxes that contain its parts, in the room."""
        x, y, z = self.pose[:3]
        return tuple(boxes_of(self.shape, x, y, z, round(float(np.degrees(self.yaw)), 6)))

    @cached_property
    def extent(self) -> Extent:
        """Axis-aligned box around it in the room: minimum x, y, z, maximum x, y, z [m]."""
        return extent_of(self.boxes)


@dataclass(frozen=True)
class Seat:
    """A place to sit."""

    item: str
    """Name of the chair, sofa or bed."""
    position: tuple[float, float, float]
    """Center of the seat's surface in the room [m]."""
    heading: float
    """Direction in which a sitting person looks, about z [rad]; 0 is the room's x."""

    @property
    def height(self) -> float:
        """Height of the seat's surface above the floor [m]."""
        return self.position[2]


@dataclass(frozen=True)
class SupportPlace:
    """A free place for a further object."""

    pose: Pose
    """Object to room, ``x y z qx qy qz qw``, of an object whose box is centered at x and y, and begins at z = 0."""
    support: str
    """Name of the item that it stands on."""
    level: str
    """Name of the support's surface."""


@dataclass(frozen=True)
class RoomLight:
    """A lamp at the ceiling."""

    position: tuple[float, float, float]
    """Position [m]."""
    color: tuple[float, float, float]
    """Color and brightness, linear."""
