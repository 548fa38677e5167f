# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Questions about what would be: without an object, after a step, or from another place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices
from warpvis.planning import look_along
from warpvis.situations._balance import Pool
from warpvis.situations._kinds import about_pairs, ask, make_pool
from warpvis.situations._numbers import Numbers
from warpvis.situations._panel import HIDDEN, LIMIT, SEEN, Panel, is_clear
from warpvis.situations._situation import Question
from warpvis.situations._wording import LEFT, NO, RIGHT, YES, word_share

_MAX_TRIALS = 384
"""Maximum number of hypothetical situations of a kind that are observed per room."""
_MAX_CHOICES = 4
_STEP = 0.5
"""Length of a step to the side [m]."""
_MAIN_BLOCKER = 0.5
"""Minimum share of a silhouette that an object must hide so that questions suppose it away."""


@dataclass(frozen=True)
class Place:
    """A place where a participant can stand."""

    words: str
    """What it is next to: ``"the sofa"``."""
    position: tuple[float, float]
    """Where it is on the floor [m]."""


def _some(rows: tuple[NDArray[np.integer], ...], random: Numbers) -> tuple[NDArray[np.integer], ...]:
    """Return at most `_MAX_TRIALS` rows, in order."""
    count = len(rows[0])
    chosen = np.sort(random.order(count)[:_MAX_TRIALS])
    return tuple(column[chosen] for column in rows)


def without(panel: Panel, random: Numbers) -> Pool:
    """Ask whether a participant would see an object if something were taken away: what hides it, or something else."""
    hidden = about_pairs(panel) & (panel.fraction <= HIDDEN)
    blockers = panel.found.occluders[:, :-1, : len(panel.things), 0]
    named = np.array([item.name in panel.words for item in panel.scene.objects] + [False])
    main = named[blockers] & (panel.found.shares[:, :-1, : len(panel.things), 0] >= _MAIN_BLOCKER)
    rows = _some(np.nonzero(hidden & main), random)
    suspects = np.unique(blockers[rows])
    others = _some(np.nonzero(hidden), random)
    if not len(suspects):
        suspects, others = np.zeros(1, dtype=np.int64), tuple(column[:0] for column in others)
    blocker = np.concatenate([blockers[rows], suspects[random.below(len(suspects), len(others[0]))]])
    rows = tuple(np.concatenate(columns) for columns in zip(rows, others, strict=True))
    removed = np.zeros((len(blocker), len(panel.scene)), dtype=np.bool_)
    removed[np.arange(len(blocker)), blocker] = True
    for viewer in panel.participants:  # a body is taken away as a whole
        body = [panel.scene.index(name) for name in viewer.body]
        removed[np.flatnonzero(np.isin(blocker, body))[:, None], body] = True
        blocker = np.where(np.isin(blocker, body), body[0] if body else -1, blocker)
    own = [panel.scene.objects[b].name in panel.participants[a].body for a, b in zip(rows[1], blocker, strict=True)]
    shares = panel.shares(rows, removed=removed)
    clear = is_clear(shares) & ~np.array(own, dtype=np.bool_)
    rows, blocker, shares = tuple(c[clear] for c in rows), blocker[clear], shares[clear]

    def write(row: int) -> Question:
        _, agent, thing = (int(column[row]) for column in rows)
        who, what = panel.participants[agent], panel.things[thing]
        name = panel.scene.objects[int(blocker[row])].name
        share = float(shares[row])
        reason = f"without {panel.words[name]}, {word_share(share)} would be visible"
        words = {"agent": who.words, "thing": panel.words[what], "blocker": panel.words[name]}
        choice = YES if share >= LIMIT else NO
        asked = ask("without", (YES, NO), choice, reason, (abs(share - LIMIT), "share"), **words)
        return Question(**asked, about=(who.name, what, name))

    return make_pool(panel, "without", (*rows, blocker), (shares < LIMIT).astype(np.int64), write)


def step(panel: Panel, random: Numbers) -> Pool:
    """Ask whether a participant who does not see an object would see it after a step to a side."""
    hidden = about_pairs(panel) & (panel.fraction <= HIDDEN)
    states = panel.found.status[:, :-1, : len(panel.things)]
    near = (panel.found.centers[:, :-1, : len(panel.things), 2] > 0) & (states != 0)  # in the field of view
    world, agent, thing = _some(np.nonzero(hidden & near), random)
    side = random.below(2, len(world))
    eyes = panel.eyes(world, agent)
    right = poses_to_matrices(eyes)[:, :3, 0] * [1, 1, 0]
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-9)
    eyes[:, :3] += right * np.where(side == 0, -_STEP, _STEP)[:, None]
    rows: tuple[NDArray[np.integer], ...] = world, agent, thing, side
    shares = panel.shares(rows, eyes=eyes)
    clear = is_clear(shares)
    rows, shares = tuple(column[clear] for column in rows), shares[clear]

    def write(row: int) -> Question:
        _, agent, thing, side = (int(column[row]) for column in rows)
        who, what = panel.participants[agent], panel.things[thing]
        share = float(shares[row])
        words = {"agent": who.words, "thing": panel.words[what], "side": (LEFT, RIGHT)[side], "meters": f"{_STEP}"}
        reason = f"from there, {word_share(share)} would be visible"
        choice = YES if share >= LIMIT else NO
        asked = ask("step", (YES, NO), choice, reason, (abs(share - LIMIT), "share"), **words)
        return Question(**asked, about=(who.name, what))

    return make_pool(panel, "step", rows, (shares < LIMIT).astype(np.int64), write)


def stand(panel: Panel, random: Numbers, places: Sequence[Place], height: float) -> Pool:
    """Ask next to which of some pieces of furniture a person can stand to see an object.

    One of the offered places has a view of it. Eyes at a place are at `height` [m], and look at the object.
    """
    people = [number for number, viewer in enumerate(panel.participants) if viewer.kind == "person"]
    shown = about_pairs(panel) & (panel.fraction <= HIDDEN)
    shown[:, [number for number in range(len(panel.participants)) if number not in people]] = False
    rows = _some(np.nonzero(shown), random)
    if len(places) < 2 or not len(rows[0]):
        empty = np.zeros(0, dtype=np.int64)
        return make_pool(panel, "stand", (empty, empty, empty), empty, _nothing)
    targets = panel.eyes(rows[0], rows[1])[:, :3] + panel.offsets(rows)
    start = np.tile([(*place.position, height) for place in places], (len(targets), 1))
    eyes = look_along(start, np.repeat(targets, len(places), axis=0) - start, 2)
    repeated = tuple(np.repeat(column, len(places)) for column in rows)
    shares = panel.shares(repeated, eyes=eyes).reshape(-1, len(places))
    seen, unseen = shares >= SEEN, shares <= HIDDEN
    asked = seen.any(axis=1) & (unseen.sum(axis=1) >= 1)
    rows, shares, seen, unseen = tuple(column[asked] for column in rows), shares[asked], seen[asked], unseen[asked]
    order = np.argsort(random.unit(*shares.shape), axis=1)
    best = np.array([next(p for p in row if seen[i, p]) for i, row in enumerate(order)], dtype=np.int64)
    others = [[int(p) for p in row if unseen[i, p]][: _MAX_CHOICES - 1] for i, row in enumerate(order)]
    offered = [sorted([int(one), *rest]) for one, rest in zip(best, others, strict=True)]

    def write(row: int) -> Question:
        _, agent, thing = (int(column[row]) for column in rows)
        who, what = panel.participants[agent], panel.things[thing]
        choices, answer = [places[index].words for index in offered[row]], places[best[row]].words
        share = float(shares[row, best[row]])
        margin = float(np.abs(shares[row, offered[row]] - LIMIT).min())
        reason = f"from there, {word_share(share)} is visible, and from the other places, nothing"
        words = {"agent": who.words, "thing": panel.words[what]}
        fields = ask("stand", choices, answer, reason, (margin, "share"), **words)
        return Question(**fields, about=(who.name, what))

    return make_pool(panel, "stand", rows, best, write)


def _nothing(row: int) -> Question:
    raise IndexError(row)


HYPOTHETICALS: dict[str, Callable[[Panel, Numbers], Pool]] = {"without": without, "step": step}
"""The kinds that suppose a change; `stand` needs places, too."""
