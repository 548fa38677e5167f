# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of scenes of files in which situations take place, like rooms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.core.types import DeviceLike
from warpvis.errors import SceneError
from warpvis.scene import Scene
from warpvis.situations._file_scenes import LIFT, STAND_HEIGHT, WALK_RADIUS, FileScene
from warpvis.situations._numbers import Numbers
from warpvis.situations.rooms import Seat, SupportPlace
from warpvis.situations.rooms._boxes import Box

Floats = NDArray[np.float64]

MIN_PLACES = 4
"""Least number of free places on supports."""
_RADIUS = 3.5
"""Distance from the middle of the places that are used [m]."""
_MIN_STANDING = 20
"""Least number of standing places, of which there are 100 per square meter."""
_ZONES = 12
"""Parts of a scene that are tried."""
_TEST_SIZE = (0.1, 0.1, 0.15)
"""Size of an object for which there must be free places [m]."""
_ROUNDS = 6
_TRIED = 128
"""Places that are tried per round."""
_WIDE = 3.0
"""Objects that are longer, or taller, are no furniture that one stands next to [m]: walls, floors."""


@dataclass(frozen=True)
class FileItem:
    """An object of a file."""

    name: str
    category: str
    support: str
    pose: tuple[float, ...]
    size: tuple[float, float, float]

    @property
    def words(self) -> str:
        """Its category: nothing else is known that distinguishes it."""
        return self.category


class FileRoom:
    """A part of the scene of a file, whose middle is the origin, at the height of the floor."""

    seats: tuple[Seat, ...] = ()

    def __init__(self, file: FileScene, numbers: Numbers) -> None:
        """Choose a part of the scene.

        Raises:
            SceneError: If no part has enough places on supports.
        """
        self._file = file
        most = 0
        for _ in range(_ZONES if len(file.supports) else 0):
            center = file.supports[int(numbers.below(len(file.supports), 1)[0])].copy()
            center[2] = file.floor
            self.origin = center.round(3)
            """The origin in the frame of the file [m], shape ``(3,)``."""
            self._standing, self._supports = (
                np.flatnonzero(np.hypot(*(points - self.origin)[:, :2].T) <= _RADIUS)
                for points in (file.standing, file.supports)
            )
            if len(self._standing) < _MIN_STANDING:
                continue
            rng = np.random.default_rng(int(numbers.below(1 << 31, 1)[0]))
            most = max(most, len(self.support_places(rng, _TEST_SIZE, MIN_PLACES)))
            if most == MIN_PLACES:
                self.items = self._list_items()
                return
        raise SceneError(
            f"{file.path}: must have at least {MIN_PLACES} free places for objects on supports 0.3 to 1.6 m above the "
            f"floor, next to places where a person can stand, got {most}"
        )

    @property
    def free_space(self) -> FileRoom:
        """Space for further objects."""
        return self

    def build(self, device: DeviceLike = "cpu", *, movable: bool = False) -> Scene:
        """Return a new scene of the file, all of it static."""
        return self._file.build(device, -self.origin)

    def standing_places(self, rng: np.random.Generator, count: int, radius: float = WALK_RADIUS) -> Floats:
        """Draw positions where a body of a radius [m] can stand, shape ``(count, 3)``; ``(0, 3)`` if there are none."""
        found = np.empty((0, 3))
        for _ in range(_ROUNDS):
            rows = self._file.standing[rng.choice(self._standing, 2 * count)]
            rows[:, :2] += rng.uniform(-0.05, 0.05, (len(rows), 2))
            rows = rows[self._file.on_floor(rows)]
            found = np.concatenate([found, rows[self._file.has_room(rows, radius, STAND_HEIGHT)]])
            if len(found) >= count:
                return (found[:count] - self.origin) * (1, 1, 0)
        return np.empty((0, 3))

    def support_places(
        self, rng: np.random.Generator, size: tuple[float, float, float], count: int
    ) -> list[SupportPlace]:
        """Draw free places of a box [m] on supports: at most `count`, which may overlap each other."""
        sides, found = np.array(size, dtype=np.float64), list[SupportPlace]()
        for _ in range(_ROUNDS):
            chosen = rng.choice(self._supports, _TRIED)
            low = self._file.supports[chosen] + [0, 0, LIFT]
            low[:, :2] += rng.uniform(-0.025, 0.025, (_TRIED, 2))
            yaw = rng.uniform(0, 2 * math.pi, _TRIED)
            fits = np.flatnonzero(self._file.is_supported(low, yaw, sides))
            fits = fits[~self._file.overlaps(low[fits], yaw[fits], sides)]
            for row in fits.tolist():
                x, y, z = (low[row] - self.origin).tolist()
                half = yaw[row] / 2
                name = self._file.scene.objects[self._file.support_items[chosen[row]]].name
                found.append(SupportPlace((x, y, z, 0.0, 0.0, math.sin(half), math.cos(half)), name, ""))
            if len(found) >= count:
                break
        return found[:count]

    def holds(self, boxes: Sequence[Box], overhang: float) -> bool:
        """Return whether the boxes of an object overlap nothing, and its lowest ones stand on a surface.

        Args:
            boxes: The boxes.
            overhang: Length by which they may project over the surface [m].
        """
        bottom = min(box.low for box in boxes)
        for box in boxes:
            low = np.array([[box.x, box.y, box.low]]) + self.origin
            yaw = np.array([math.atan2(box.sin, box.cos)])
            size = np.array([2 * box.half_x, 2 * box.half_y, box.high - box.low])
            stands = np.maximum(size - 2 * overhang, 0)
            if box.low < bottom + 1e-3 and not self._file.is_supported(low, yaw, stands).all():
                return False
            if self._file.overlaps(low, yaw, size).any():
                return False
        return True

    def _list_items(self) -> tuple[FileItem, ...]:
        """Return the objects around the middle."""
        found = []
        for index, item in enumerate(self._file.scene.objects):
            low, high = item.bounds.astype(np.float64) - self.origin
            if np.hypot(*np.maximum(np.maximum(low, -high), 0)[:2]) > _RADIUS:
                continue
            x, y = ((low + high) / 2)[:2].tolist()
            width, depth, height = (high - low).tolist()
            stands = low[2] < 0.1 and 0.1 < height and max(width, depth, height) <= _WIDE
            support = "floor" if stands and index not in self._file.floor_items else ""
            pose = (x, y, float(low[2]), 0.0, 0.0, 0.0, 1.0)
            category = item.category.lower().replace("_", " ").strip()
            found.append(FileItem(item.name, category, support, pose, (width, depth, height)))
        return tuple(found)
