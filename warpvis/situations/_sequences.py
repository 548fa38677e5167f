# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Situations over time: a person turns, or an object is moved while a person sees it, or does not."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.situations._balance import Pool
from warpvis.situations._kinds import ask, make_pool
from warpvis.situations._numbers import Numbers
from warpvis.situations._panel import HIDDEN, LIMIT, SEEN, is_clear
from warpvis.situations._situation import Question
from warpvis.situations._stage import Arrangements, Stage
from warpvis.situations._wording import NEVER

MOMENTS = 4
"""Number of moments of a person who turns."""
_TURN = math.radians(40)
_DIRECTIONS = 9
"""Directions of a full rotation by `_TURN`."""
_MAX_TRIALS = 40
_ORDINALS = ("the first", "the second", "the third", "the fourth")


class Sequence(NamedTuple):
    """The moments of a situation over time."""

    world: int
    """The arrangement that it begins with."""
    agent: int
    thing: int
    eyes: NDArray[np.float64]
    """Eyes of the participant at each moment, shape ``(moments, 7)``."""
    poses: NDArray[np.float32]
    """Poses of all movable objects at each moment, shape ``(moments, M, 7)``."""


class _Rotation(NamedTuple):
    """What a person sees of an object in all directions of a rotation, at its place and at another one."""

    world: int
    agent: int
    thing: int
    eyes: NDArray[np.float64]
    poses: NDArray[np.float32]
    shares: NDArray[np.float64]
    """Visible shares, shape ``(2, directions)``; both rows are equal without another place."""
    moved: NDArray[np.float32] | None
    """Pose of the object at another place; None without one."""
    supports: tuple[str, str]
    """Words for what it stands on at both places."""


def find_sequences(stage: Stage, arranged: Arrangements, numbers: Numbers) -> list[tuple[Pool, list[Sequence]]]:
    """Return pools of questions about moments, and the moments of each row."""
    rotations = _rotations(stage, arranged, numbers)
    return [_first_sight(arranged, rotations), _beliefs(stage, arranged, rotations)]


def _rotations(stage: Stage, arranged: Arrangements, numbers: Numbers) -> list[_Rotation]:
    """Let people rotate where they stand, and observe an object of interest of each."""
    panel = arranged.panel
    people = [number for number, viewer in enumerate(panel.participants) if viewer.kind == "person"]
    shown = panel.in_picture[:, None, :] & panel.participant_in_picture[:, people, None]
    shown &= ~arranged.postures[:, :, None]
    rows = np.stack(np.nonzero(shown), axis=1)
    rows = rows[numbers.order(len(rows))][:_MAX_TRIALS]
    found = []
    for person, agent in enumerate(people):
        chosen = [(world, thing) for world, one, thing in rows.tolist() if one == person]
        found += _rotate(stage, arranged, agent, chosen, numbers)
    return found


def _rotate(
    stage: Stage, arranged: Arrangements, agent: int, rows: list[tuple[int, int]], numbers: Numbers
) -> list[_Rotation]:
    """Let a person rotate in arrangements, and observe an object in each: rows ``world, thing``."""
    panel, count = arranged.panel, len(rows)
    if not count:
        return []
    viewer = panel.participants[agent]
    worlds = np.repeat([world for world, _ in rows], _DIRECTIONS)
    headings = numbers.uniform(0, 2 * math.pi, count)[:, None] + _TURN * np.arange(_DIRECTIONS)
    eyes, poses = stage.turn_person(arranged, worlds, viewer.name, headings.reshape(-1))
    eyes = eyes.reshape(count, _DIRECTIONS, 7)
    poses = poses.reshape(count, _DIRECTIONS, *poses.shape[1:])
    others = [stage.other_places(arranged, world, panel.things[thing], numbers) for world, thing in rows]
    elsewhere = poses.copy()
    for index, ((_, thing), other) in enumerate(zip(rows, others, strict=True)):
        if other is not None:
            elsewhere[index, :, stage.column(panel.things[thing])] = other[0]
    both = np.concatenate([poses, elsewhere]).reshape(-1, *poses.shape[2:])
    turned = np.tile(eyes.reshape(-1, 7), (2, 1))
    things = np.tile(np.repeat([thing for _, thing in rows], _DIRECTIONS), 2)
    seen = panel.watch.shares(panel.participants, np.full(len(things), agent), things, turned, both)
    seen = seen.reshape(2, count, _DIRECTIONS)
    found = []
    for index, ((world, thing), other) in enumerate(zip(rows, others, strict=True)):
        now = stage.support(arranged, world, panel.things[thing])
        supports = now, "" if other is None else stage.words[other[1]]
        moved = None if other is None else other[0]
        found.append(_Rotation(world, agent, thing, eyes[index], poses[index], seen[:, index], moved, supports))
    return found


def _first_sight(arranged: Arrangements, rotations: list[_Rotation]) -> tuple[Pool, list[Sequence]]:
    """Ask in which of several pictures a person who turns sees an object for the first time."""
    panel = arranged.panel
    rows: list[tuple[_Rotation, NDArray[np.int64], int]] = []
    for one in rotations:
        clear = is_clear(one.shares[0])
        for first in range(_DIRECTIONS):
            chosen = (first + np.arange(MOMENTS)) % _DIRECTIONS
            if clear[chosen].all():
                seen = np.flatnonzero(one.shares[0, chosen] >= SEEN)
                rows.append((one, chosen, int(seen[0]) if len(seen) else MOMENTS))

    def write(row: int) -> Question:
        one, chosen, first = rows[row]
        who, what = panel.participants[one.agent], panel.things[one.thing]
        choices = (*_ORDINALS, NEVER)
        shares = one.shares[0, chosen]
        margin = float(np.abs(shares - LIMIT).min())
        told = "it is in sight in none" if first == MOMENTS else f"it is first in sight in {_ORDINALS[first]}"
        words = {"agent": who.words, "thing": panel.words[what]}
        return Question(
            **ask("when", choices, choices[first], told, (margin, "share"), **words), about=(who.name, what)
        )

    sequences = [
        Sequence(one.world, one.agent, one.thing, one.eyes[chosen], one.poses[chosen]) for one, chosen, _ in rows
    ]
    return _pool(arranged, "when", [one for one, _, _ in rows], [first for *_, first in rows], write), sequences


def _beliefs(stage: Stage, arranged: Arrangements, rotations: list[_Rotation]) -> tuple[Pool, list[Sequence]]:
    """Ask where a person expects an object that was moved while they looked away, and may have seen again."""
    panel = arranged.panel
    rows: list[tuple[_Rotation, NDArray[np.int64], bool]] = []
    for one in rotations:
        if one.moved is None or not all(one.supports) or one.supports[0] == one.supports[1]:
            continue
        here, there = one.shares
        knows = np.flatnonzero(here >= SEEN)
        away = np.flatnonzero((here <= HIDDEN) & (there <= HIDDEN))
        again = np.flatnonzero(there >= SEEN)
        if not len(knows) or not len(away):
            continue
        rows.append((one, np.array([knows[0], away[0], away[-1]]), False))
        if len(again):
            rows.append((one, np.array([knows[0], away[0], again[0]]), True))

    def write(row: int) -> Question:
        one, chosen, sees_again = rows[row]
        who, what = panel.participants[one.agent], panel.things[one.thing]
        choices = tuple(sorted(one.supports))
        answer = one.supports[1] if sees_again else one.supports[0]
        last = float(one.shares[1, chosen[2]])
        margin = min(abs(last - LIMIT), abs(float(one.shares[0, chosen[0]]) - LIMIT))
        reason = f"{who.words} saw it at {answer}" + ("" if sees_again else ", and did not see that it was moved")
        words = {"agent": who.words, "thing": panel.words[what]}
        return Question(**ask("belief", choices, answer, reason, (margin, "share"), **words), about=(who.name, what))

    sequences = []
    for one, chosen, _ in rows:
        poses = one.poses[chosen].copy()
        assert one.moved is not None
        poses[2, stage.column(panel.things[one.thing])] = one.moved
        sequences.append(Sequence(one.world, one.agent, one.thing, one.eyes[chosen], poses))
    answers = [int(sees_again) for *_, sees_again in rows]
    return _pool(arranged, "belief", [one for one, _, _ in rows], answers, write), sequences


def _pool(
    arranged: Arrangements,
    kind: str,
    rotations: list[_Rotation],
    answers: list[int],
    write: Callable[[int], Question],
) -> Pool:
    """Return the pool of questions about rotations, whose words are determined by the participant and the object."""
    columns = np.array([(one.world, one.agent, one.thing) for one in rotations], dtype=np.int64).reshape(-1, 3)
    return make_pool(arranged.panel, kind, tuple(columns.T), np.array(answers, dtype=np.int64), write)
