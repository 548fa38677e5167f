# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Evidence for the object that a person means in the frames of a sequence, and smooth pursuit between frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import as_items
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, SceneError
from warpvis.visibility._candidates import Candidate, Query
from warpvis.visibility._reference_model import Floats


@dataclass(frozen=True, eq=False)
class Sequences:
    """Evidence in V frames."""

    times: Floats
    """Time of each frame [s], ``(V,)``."""
    gaze: Floats | None
    """Direction of the eyes, of any length, NaN where it is unknown, ``(V, 3)``; None if never known."""
    rays: Floats | None
    """Pointing rays, NaN for missing ones, ``(V, R, 6)``; None without any."""
    others: tuple[Sequence[Sequence[Candidate]], ...]
    """Candidates of each of the other people in each frame."""

    @classmethod
    def parse(
        cls,
        count: int,
        times: ArrayInput,
        gaze: ArrayInput | None,
        pointing: ArrayInput | None,
        others: Sequence[Sequence[Sequence[Candidate]]],
    ) -> Sequences:
        """Check the arguments of `Perspective.track` for `count` frames."""
        clock = as_numpy(times, name="times").astype(np.float64)
        if clock.shape != (count,) or not np.isfinite(clock).all() or (np.diff(clock) < 0).any():
            got = clock.tolist() if clock.size <= 8 else f"an array of shape {clock.shape}"
            raise ArrayError(f"times must be {count} finite numbers of seconds that do not decrease, got {got}")
        directions = None if gaze is None else as_numpy(gaze, name="gaze").astype(np.float64)
        if directions is not None and directions.shape != (count, 3):
            raise ArrayError(f"gaze must be a direction for each situation, shape ({count}, 3), got {directions.shape}")
        rays = None if pointing is None else as_numpy(pointing, name="pointing").astype(np.float64)
        if rays is not None:
            shape, rays = rays.shape, rays[:, None] if rays.ndim == 2 else rays
            if rays.ndim != 3 or rays.shape[::2] != (count, 6):
                expected = f"shape ({count}, 6) or ({count}, R, 6)"
                raise ArrayError(f"pointing must be rays x y z dx dy dz for each situation, {expected}, got {shape}")
        people = [as_items(one, "others", SceneError) for one in as_items(others, "others", SceneError)]
        wrong = [len(one) for one in people if len(one) != count]
        if wrong:
            raise SceneError(f"others must be results of track for {count} situations, got {wrong[0]}")
        return cls(clock, directions, rays, tuple(people))

    def gaze_at(self, view: int) -> Floats | None:
        """Return the direction of the eyes in a frame; None if it is unknown."""
        return None if self.gaze is None or np.isnan(self.gaze[view]).any() else self.gaze[view]

    def rays_at(self, view: int) -> Floats | None:
        """Return the rays of a frame, ``(R, 6)``; None without any."""
        if self.rays is None:
            return None
        found = self.rays[view][~np.isnan(self.rays[view]).any(axis=1)]
        return found if len(found) else None

    def others_at(self, view: int) -> list[Sequence[Candidate]]:
        """Return the candidates of each of the other people in a frame."""
        return [one[view] for one in self.others]

    def pursuit(self, directions: Floats, window: float) -> Floats | None:
        """Return changes of the gaze minus changes of the directions to K objects, ``(V, K, 3)``.

        The change in a frame is that since the first frame within `window` [s]; NaN if there is none, or if the gaze is
        unknown in one of them.

        Args:
            directions: Unit vectors from the eyes to the objects, ``(V, K, 3)``.
            window: Maximum time between the frames [s].
        """
        if self.gaze is None:
            return None
        with np.errstate(invalid="ignore", divide="ignore"):
            gaze = self.gaze / np.linalg.norm(self.gaze, axis=1, keepdims=True)
        count = len(self.times)
        first = np.searchsorted(self.times, self.times - window * (1 + 1e-9))
        changes = (gaze - gaze[first])[:, None] - (directions - directions[first])
        changes[first == np.arange(count)] = np.nan
        return changes


def track_candidates(query: Query, frames: Sequences) -> list[list[Candidate]]:
    """Return the candidates of every frame, each updated from the one before; see `Perspective.track`."""
    offsets = query.boxes.centers(query.object_poses) - query.person.poses[:, None, :3]
    with np.errstate(invalid="ignore", divide="ignore"):
        directions = offsets / np.linalg.norm(offsets, axis=2, keepdims=True)
    directions = np.broadcast_to(directions, (*query.seen.shape, 3))
    pursuit = frames.pursuit(directions, query.model.fixation)
    results: list[list[Candidate]] = []
    for view in range(len(frames.times)):
        previous, elapsed = None, None
        if view:
            previous, elapsed = results[-1], float(frames.times[view] - frames.times[view - 1])
        evidence = frames.gaze_at(view), frames.rays_at(view), frames.others_at(view)
        motion = None if pursuit is None else pursuit[view]
        try:
            results.append(query.candidates(view, *evidence, previous, elapsed, motion))
        except ArrayError as error:
            raise ArrayError(f"{error}; this is situation {view}") from None
    return results
