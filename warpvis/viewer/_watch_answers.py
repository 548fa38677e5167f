# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Picked points, turned eyes and meant places on the page of a depth camera."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import WarpvisError
from warpvis.viewer._answers import Angles, Answers, GazeSliders
from warpvis.viewer._picking import Picked
from warpvis.viewer._sight_marks import Point
from warpvis.visibility import DepthWatcher, Watched

if TYPE_CHECKING:
    from viser import ViserServer

# A point is clicked if it is nearer to the ray than this part of a voxel, or of its distance (some pixels).
_NEAR_VOXELS, _NEAR_ANGLE = 0.6, 0.004

_NO_POINTS = np.zeros((0, 3), dtype=np.float32)


class WatchAnswers:
    """The picked point of a `WatchPage`, the sliders for people's eyes, and the table of what people mean."""

    def __init__(
        self,
        server: ViserServer,
        watcher: DepthWatcher,
        changed: Callable[[Watched], None],
        say: Callable[[str], None],
        order: float,
    ) -> None:
        """Add the elements.

        Args:
            server: The page's server.
            watcher: The watcher.
            changed: Shows results of the watcher, which change if eyes turn.
            say: Shows a message, or hides it if it is empty.
            order: Order of the element before these in the panel, as in viser.
        """
        self._server, self._watcher, self._changed, self._say = server, watcher, changed, say
        self.lock = threading.RLock()
        """Held while the page changes: pages change while images arrive, and when the user clicks."""
        self.picked: Picked | None = None
        """The picked point and its answers."""
        self.shown: NDArray[np.float32] = _NO_POINTS
        """Points of the map that are shown, which can be clicked [m], ``(N, 3)``."""
        self._point: Point | None = None
        self._watched: Watched | None = None
        self.answers = Answers(server, self._pick, self._pick_along, self._attempt, order)
        self.gaze = GazeSliders(server.gui, self._turn, self._attempt, order)

    def show(self, watched: Watched) -> None:
        """Show the answers for the picked point after an image."""
        self._watched = watched
        self.gaze.set_names([person.name for person in watched.people])
        self._judge()

    def _judge(self) -> None:
        """Compute the answers and show them."""
        self.picked = None
        if self._point is not None:
            try:
                lines = self._watcher.lines_of_sight(self._point)
                reasons = {name: line.reason for name, line in lines.items()}
                self.picked = Picked(self._point, None, tuple(lines.values()), reasons)
            except WarpvisError as error:  # the point is at someone's eyes
                self._say(str(error))
        self.answers.show(self.picked, {} if self._watched is None else self._watched.candidates)

    def _pick(self, point: Point | None) -> None:
        self._point = point

    def _pick_along(self, origin: Point, direction: Point) -> bool:
        """Pick the first point that is shown close to a ray, and return whether there is one."""
        limit = _NEAR_VOXELS * self._watcher.cell_size
        found = nearest_along(self.shown, np.array(origin), np.array(direction), limit)
        if found is not None:
            x, y, z = found.tolist()
            self._point = (x, y, z)
        return found is not None

    def _turn(self, name: str, angles: Angles | None) -> None:
        watched = self._watcher.turn_eyes(name, angles)
        if watched is not None:
            self._watched = watched
            self._changed(watched)

    def _attempt(self, change: Callable[[], None]) -> None:
        with self.lock, self._server.atomic():
            try:
                self._say("")
                change()
                self._judge()
            except WarpvisError as error:
                self._say(str(error))


def nearest_along(
    points: NDArray[np.float32], origin: NDArray[np.float64], direction: NDArray[np.float64], limit: float
) -> NDArray[np.float64] | None:
    """Return the first of the points that are close to a ray, ``(3,)``: within `limit` [m], or some pixels."""
    offsets = points.astype(np.float64) - origin
    along = offsets @ (direction / np.linalg.norm(direction))
    across = np.sqrt(np.maximum((offsets**2).sum(axis=1) - along**2, 0.0))
    close = np.flatnonzero((along > 0) & (across < np.maximum(limit, _NEAR_ANGLE * along)))
    return None if not len(close) else points[close[along[close].argmin()]].astype(np.float64)
