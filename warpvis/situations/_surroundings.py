# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a stage needs of the place around it: a room, or a part of the scene of a file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from warpvis.core.types import DeviceLike
from warpvis.scene import Scene
from warpvis.situations.rooms import Seat, SupportPlace
from warpvis.situations.rooms._boxes import Box


class Piece(Protocol):
    """A piece of furniture, or a part of the building."""

    @property
    def name(self) -> str:
        """Its unique name."""

    @property
    def category(self) -> str:
        """Its class in words; empty if it is not known."""

    @property
    def words(self) -> str:
        """Words that distinguish it from others of its category, if there are any."""

    @property
    def support(self) -> str:
        """``"floor"`` if it stands on the floor."""

    @property
    def pose(self) -> tuple[float, ...]:
        """Its pose in the room, ``x y z qx qy qz qw``."""

    @property
    def size(self) -> tuple[float, float, float]:
        """Sides of its box [m]."""


class FreeSpace(Protocol):
    """Space for further objects."""

    def holds(self, boxes: Sequence[Box], overhang: float) -> bool:
        """Return whether the boxes of an object overlap nothing, and its lowest ones stand on a surface.

        The lowest ones may project over it by an overhang [m].
        """


class Surroundings(Protocol):
    """A furnished place: the floor is z = 0, and the middle is near the origin."""

    @property
    def items(self) -> Sequence[Piece]:
        """The furniture."""

    @property
    def seats(self) -> Sequence[Seat]:
        """Places to sit."""

    @property
    def free_space(self) -> FreeSpace:
        """Space for further objects."""

    def build(self, device: DeviceLike = "cpu", *, movable: bool = True) -> Scene:
        """Return a new scene."""

    def standing_places(self, rng: np.random.Generator, count: int, radius: float = 0.3) -> NDArray[np.float64]:
        """Draw positions where a body can stand [m], shape ``(count, 3)``."""

    def support_places(
        self, rng: np.random.Generator, size: tuple[float, float, float], count: int
    ) -> list[SupportPlace]:
        """Draw at most `count` free places of a box on supports."""
