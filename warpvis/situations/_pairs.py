# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Matched pairs: a thing moves by a few centimeters, and the answer flips, while the picture is almost the same."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.situations._kinds import about_pairs
from warpvis.situations._numbers import Numbers
from warpvis.situations._panel import HIDDEN, SEEN
from warpvis.situations._stage import Arrangements, Stage
from warpvis.situations._stage_items import TALL

MAX_MOVE = 0.05
"""Maximum distance by which the blocker of a pair moves [m]."""
_STEP = 0.0125
_REACH = 0.25
"""Movements from the arrangement that are tried, to both sides [m]."""
_MAX_TRIALS = 48
_GAPS = (0.04, 0.25)
"""Distances between the blocker and the object [m]."""
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
    """Movement from the arrangement with which the object is hidden, in the room [m], shape ``(3,)``."""
    visible: NDArray[np.float64]
    """Movement with which it is visible [m], shape ``(3,)``."""

    @property
    def distance(self) -> float:
        """Distance between both places of the blocker [m]."""
        return float(np.linalg.norm(self.visible - self.hidden))


def find_pairs(stage: Stage, arranged: Arrangements, count: int, numbers: Numbers) -> list[Pair]:
    """Find at most `count` pairs, each in a different arrangement."""
    rows, blocked, starts = _candidates(stage, arranged, numbers)
    if not len(rows) or not count:
        return []
    offsets = np.arange(-_REACH, _REACH + _STEP / 2, _STEP)
    along = arranged.panel.offsets(tuple(rows.T))
    sideways = np.column_stack([-along[:, 1], along[:, 0], np.zeros(len(along))])
    sideways /= np.maximum(np.linalg.norm(sideways, axis=1, keepdims=True), 1e-9)
    moves = starts[:, None] + offsets[None, :, None] * sideways[:, None]
    shares = _shares(stage, arranged, rows, blocked, moves)
    found: list[Pair] = []
    for row, blocker, move, share in zip(rows.tolist(), blocked, moves, shares, strict=True):
        pair = _nearest_flip(share, round(MAX_MOVE / _STEP))
        if pair is None:
            continue
        world, agent, thing = row
        one = Pair(world, agent, thing, blocker, move[pair[0]], move[pair[1]])
        if all(stage.fits(arranged, world, blocker, end) for end in (one.hidden, one.visible)):
            found.append(one)
        if len(found) == count:
            break
    return found


def _candidates(
    stage: Stage, arranged: Arrangements, numbers: Numbers
) -> tuple[NDArray[np.int64], list[str], NDArray[np.float64]]:
    """Put blockers in front of objects, on the same support.

    Returns:
        Rows ``world, agent, thing``, one per arrangement; the blockers' names; and their movements from the arrangement
        [m], shape ``(n, 3)``.
    """
    panel, items = arranged.panel, [item for item in stage.blockers if not item.name.startswith(TALL)]
    ahead = np.abs(panel.found.azimuth[:, :-1, : len(panel.things)]) < _MAX_ANGLE
    every = np.stack(np.nonzero(about_pairs(panel) & ahead), axis=1)
    every = every[numbers.order(len(every))]
    which, gaps = numbers.below(max(len(items), 1), len(every)), numbers.uniform(*_GAPS, len(every))
    rows, names, starts, used = list[list[int]](), list[str](), list[NDArray[np.float64]](), set[int]()
    for row, item_number, gap in zip(every.tolist(), which.tolist(), gaps.tolist(), strict=True):
        if len(rows) == _MAX_TRIALS or not items:
            break
        world, agent, thing = row
        if world in used:
            continue
        item, number = items[item_number], stage.bodies().index(panel.things[thing])
        place = arranged.placing.center(arranged.kept[world], number)
        toward = panel.participants[agent].eyes[world, :2] - place[:2]
        toward /= max(float(np.linalg.norm(toward)), 1e-9)
        reach = 0.5 * (math.hypot(*item.size[:2]) + math.hypot(*stage.item(panel.things[thing]).size[:2])) + gap
        goal = place + np.array([*toward * reach, 0.0])
        start = goal - arranged.placing.center(arranged.kept[world], stage.bodies().index(item.name))
        if stage.fits(arranged, world, item.name, start):
            used.add(world)
            rows.append(row)
            names.append(item.name)
            starts.append(start)
    return np.array(rows, dtype=np.int64).reshape(-1, 3), names, np.array(starts).reshape(-1, 3)


def _shares(
    stage: Stage,
    arranged: Arrangements,
    rows: NDArray[np.integer],
    blocked: list[str],
    moves: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the visible share of each row's object after each movement of its blocker, shape ``(n, offsets)``."""
    steps = moves.shape[1]
    repeated = np.repeat(rows, steps, axis=0)
    poses = arranged.panel.object_poses[repeated[:, 0]]
    for index, (blocker, offsets) in enumerate(zip(blocked, moves, strict=True)):
        stage.move(poses[index * steps : (index + 1) * steps], blocker, offsets)
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
