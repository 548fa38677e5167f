# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Matched pairs: a thing moves by a few centimeters, and the answer flips, while the picture is almost the same."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices
from warpvis.situations._kinds import about_pairs
from warpvis.situations._numbers import Numbers
from warpvis.situations._panel import HIDDEN, SEEN
from warpvis.situations._stage import Arrangements, Stage

MAX_MOVE = 0.05
"""Maximum distance by which the blocker of a pair moves [m]."""
_STEP = 0.01
_REACH = 0.3
"""Movements from the arrangement that are tried, to both sides [m]."""
_MAX_TRIALS = 64
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
    """Find at most `count` pairs, each in an arrangement of its own."""
    rows, blocked = _candidates(stage, arranged, numbers)
    if not len(rows):
        return []
    offsets = np.arange(-_REACH, _REACH + _STEP / 2, _STEP)
    sideways = np.array([_sideways(arranged, row) for row in rows])
    moves = offsets[None, :, None] * sideways[:, None]
    shares = _shares(stage, arranged, rows, blocked, moves)
    found: list[Pair] = []
    reach = round(MAX_MOVE / _STEP)
    for row, blocker, move, share in zip(rows.tolist(), blocked, moves, shares, strict=True):
        pair = _nearest_flip(share, reach)
        if pair is None:
            continue
        world, agent, thing = row
        one = Pair(world, agent, thing, blocker, move[pair[0]], move[pair[1]])
        if all(stage.fits(arranged, world, blocker, end) for end in (one.hidden, one.visible)):
            found.append(one)
        if len(found) == count:
            break
    return found


def _candidates(stage: Stage, arranged: Arrangements, numbers: Numbers) -> tuple[NDArray[np.integer], list[str]]:
    """Return rows ``world, agent, thing`` with a blocker near the line of sight, one per arrangement, and its names."""
    panel, bodies = arranged.panel, stage.bodies()
    ahead = np.abs(panel.found.azimuth[:, :-1, : len(panel.things)]) < _MAX_ANGLE
    rows = np.stack(np.nonzero(about_pairs(panel) & ahead), axis=1)
    eyes = np.stack([viewer.eyes for viewer in panel.participants], axis=1)[rows[:, 0], rows[:, 1]]
    along = np.einsum("nij,nj->ni", poses_to_matrices(eyes)[:, :3, :3], panel.found.centers[tuple(rows.T)])
    squared = np.maximum((along * along).sum(axis=1), 1e-9)
    found, names = [], np.array([item.name for item in stage.blockers])
    for item in stage.blockers:
        number = bodies.index(item.name)
        centers = np.array([arranged.placing.center(world, number) for world in arranged.kept]).reshape(-1, 3)
        offset = centers[rows[:, 0]] + [0, 0, item.size[2] / 2] - eyes[:, :3]
        share = (offset * along).sum(axis=1) / squared
        apart = np.linalg.norm((offset - share[:, None] * along)[:, :2], axis=1)
        found.append(np.where((share > 0.2) & (share < 0.95), apart - max(item.size[:2]) / 2, np.inf))
    if not found or not len(rows):
        return rows[:0], []
    near = np.min(found, axis=0) < _REACH
    rows, names = rows[near], names[np.argmin(found, axis=0)[near]]
    order = numbers.order(len(rows))
    _, first = np.unique(rows[order, 0], return_index=True)  # one per arrangement
    chosen = order[np.sort(first)][:_MAX_TRIALS]
    return rows[chosen], names[chosen].tolist()


def _sideways(arranged: Arrangements, row: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return the horizontal direction across the line of sight of a row ``world, agent, thing``, shape ``(3,)``."""
    world, agent, thing = row
    viewer = arranged.panel.participants[agent]
    along = poses_to_matrices(viewer.eyes[world])[:3, :3] @ arranged.panel.found.centers[world, agent, thing]
    across = np.array([-along[1], along[0], 0.0])
    return across / max(float(np.linalg.norm(across)), 1e-9)


def _shares(
    stage: Stage,
    arranged: Arrangements,
    rows: NDArray[np.integer],
    blocked: list[str],
    moves: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the visible share of each row's object after each movement of its blocker, shape ``(n, offsets)``."""
    panel, (count, steps) = arranged.panel, moves.shape[:2]
    shares = np.zeros((count, steps))
    for number, viewer in enumerate(panel.participants):
        chosen = np.flatnonzero(rows[:, 1] == number)
        if not len(chosen):
            continue
        worlds = np.repeat(rows[chosen, 0], steps)
        poses = panel.object_poses[worlds]
        for place, index in enumerate(chosen):
            part = slice(place * steps, (place + 1) * steps)
            stage.move(poses[part], blocked[index], moves[index])
        found = panel.watch.observe([viewer.at(worlds)], poses)
        things = np.repeat(rows[chosen, 2], steps)
        shares[chosen] = found.fraction[np.arange(len(worlds)), 0, things].reshape(-1, steps)
    return shares


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
