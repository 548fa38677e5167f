# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Matched pairs: a thing moves by a few centimeters, and the answer flips, while the picture is almost the same."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices
from warpvis.situations._kinds import about_pairs
from warpvis.situations._numbers import Numbers
from warpvis.situations._panel import HIDDEN, SEEN
from warpvis.situations._stage import Arrangements, Stage
from warpvis.situations.rooms import RoomItem

MAX_MOVE = 0.05
"""Maximum distance by which the blocker of a pair moves [m]."""
_STEP = 0.0125
_REACH = 0.1
"""Movements of a blocker to both sides of its place that are tried [m]."""
_MAX_TRIALS = 160
_MIN_SHARE = 0.3
"""Nearest place of a blocker between the eyes, 0, and the object, 1."""
_GAP = 0.03
"""Minimum distance between the boxes of the blocker and the object, along the line of sight [m]."""
_MAX_ANGLE = math.radians(50)


class Pair(NamedTuple):
    """An object that is hidden from a participant, and visible after another object has moved."""

    world: int
    """The arrangement that both are made from."""
    agent: int
    thing: int
    blocker: str
    """Name of the object that moves."""
    hidden: NDArray[np.float64]
    """Pose of the blocker with which the object is hidden, shape ``(7,)``."""
    visible: NDArray[np.float64]
    """Pose with which it is visible, shape ``(7,)``."""

    @property
    def distance(self) -> float:
        """Distance between both places of the blocker [m]."""
        return float(np.linalg.norm(self.visible[:3] - self.hidden[:3]))


def find_pairs(stage: Stage, arranged: Arrangements, numbers: Numbers) -> Iterator[Pair]:
    """Find pairs, each in a different arrangement."""
    rows, blockers, places = _candidates(stage, arranged, numbers)
    offsets = np.arange(-_REACH, _REACH + _STEP / 2, _STEP)
    ends = np.repeat(places[:, None], len(offsets), axis=1)
    ends[..., :3] += offsets[:, None] * _sideways(arranged.panel.offsets(tuple(rows.T)))[:, None]
    shares = _shares(stage, arranged, rows, blockers, ends)
    for row, blocker, poses, share in zip(rows.tolist(), blockers, ends, shares, strict=True):
        flip = _nearest_flip(share, round(MAX_MOVE / _STEP))
        world, agent, thing = row
        if flip is not None and all(stage.fits(arranged, world, blocker, poses[step]) for step in flip):
            yield Pair(world, agent, thing, blocker, poses[flip[0]], poses[flip[1]])


def _candidates(
    stage: Stage, arranged: Arrangements, numbers: Numbers
) -> tuple[NDArray[np.int64], list[str], NDArray[np.float64]]:
    """Choose free places of blockers, one per arrangement, where an edge of them is in the line of sight to an object.

    Returns:
        Rows ``world, agent, thing``; the blockers' names; and their poses, shape ``(n, 7)``.
    """
    panel = arranged.panel
    ahead = np.abs(panel.found.azimuth[:, :-1, : len(panel.things)]) < _MAX_ANGLE
    every = np.stack(np.nonzero(about_pairs(panel) & ahead), axis=1)
    every = every[numbers.order(len(every))]
    found = [np.zeros((0, 3), dtype=np.int64)]
    for number, item in enumerate(stage.blockers):
        row, place = np.nonzero(_hides(stage, arranged, item, every))
        centers = stage.floor_centers(item, stage.places(item.name)[place])
        free = arranged.placing.is_free(arranged.kept[every[row, 0]], centers, stage.bodies().index(item.name))
        found.append(np.column_stack([row, np.full(len(row), number), place])[free])
    tried = np.concatenate(found)
    tried = tried[numbers.order(len(tried))]
    first = np.sort(np.unique(every[tried[:, 0], 0], return_index=True)[1])[:_MAX_TRIALS]
    chosen = [(row, stage.blockers[number].name, place) for row, number, place in tried[first].tolist()]
    poses = np.array([stage.places(name)[place] for _, name, place in chosen], dtype=np.float64).reshape(-1, 7)
    return every[tried[first, 0]], [name for _, name, _ in chosen], poses


def _hides(stage: Stage, arranged: Arrangements, item: RoomItem, rows: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return whether a blocker at each of its m places has an edge near the line of sight, shape ``(n, m)``."""
    panel, places = arranged.panel, stage.places(item.name)
    along, eyes = panel.offsets(tuple(rows.T)), panel.eyes(rows[:, 0], rows[:, 1])[:, None, :3]
    sizes = np.array([stage.item(name).size for name in panel.things]).reshape(-1, 3)[rows[:, 2], None]
    length, sideways = np.hypot(along[:, 0], along[:, 1])[:, None], _sideways(along)
    forward = np.column_stack([sideways[:, 1], -sideways[:, 0], np.zeros(len(rows))])
    offsets = stage.floor_centers(item, places)[None] - eyes
    ahead, aside = (np.einsum("nmk,nk->nm", offsets, axis) for axis in (forward, sideways))
    axes = poses_to_matrices(places)[:, :3, :2] * np.array(item.size[:2]) / 2
    depth, half = (np.abs(np.einsum("mkj,nk->nmj", axes, axis)).sum(axis=-1) for axis in (forward, sideways))
    share = ahead / np.maximum(length, 1e-9)
    between = (share >= _MIN_SHARE) & (ahead + depth + np.hypot(sizes[..., 0], sizes[..., 1]) / 2 + _GAP <= length)
    # Seen from the eyes, the blocker covers the object from below its lower end to above its upper end.
    low, high = ((along[:, None, 2] + sign * sizes[..., 2] / 2) * share for sign in (-1, 1))
    covers = (offsets[..., 2] <= low) & (offsets[..., 2] + item.size[2] >= high)
    return between & covers & (np.abs(np.abs(aside) - half) <= _REACH / 2)


def _sideways(along: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return horizontal unit vectors at right angles to directions, shape ``(n, 3)``."""
    sideways = np.column_stack([-along[:, 1], along[:, 0], np.zeros(len(along))])
    return sideways / np.maximum(np.linalg.norm(sideways, axis=1, keepdims=True), 1e-9)


def _shares(
    stage: Stage,
    arranged: Arrangements,
    rows: NDArray[np.integer],
    blockers: list[str],
    places: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the visible share of each row's object with its blocker at each of some places, ``(n, places)``."""
    steps = places.shape[1]
    repeated = np.repeat(rows, steps, axis=0)
    poses = arranged.panel.object_poses[repeated[:, 0]]
    for index, (blocker, ends) in enumerate(zip(blockers, places, strict=True)):
        poses[index * steps : (index + 1) * steps, stage.column(blocker)] = ends
    return arranged.panel.shares(tuple(repeated.T), object_poses=poses).reshape(-1, steps)


def _nearest_flip(share: NDArray[np.float64], reach: int) -> tuple[int, int] | None:
    """Return the two nearest steps, at most `reach` apart, with the object hidden and visible; None if there are none.

    Of equally near ones, the nearest to the middle is returned.
    """
    hidden, visible = np.flatnonzero(share <= HIDDEN), np.flatnonzero(share >= SEEN)
    if not len(hidden) or not len(visible):
        return None
    apart = np.abs(hidden[:, None] - visible[None])
    middle = np.abs(hidden - len(share) // 2)[:, None]
    i, j = np.unravel_index((apart * len(share) + middle).argmin(), apart.shape)
    return (int(hidden[i]), int(visible[j])) if apart[i, j] <= reach else None
