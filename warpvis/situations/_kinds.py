# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Questions about what is: who sees what, how much of it, why not, and where it is for whom."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Visibility
from warpvis.situations._balance import Pool
from warpvis.situations._panel import HIDDEN, LIMIT, SEEN, Panel, is_clear
from warpvis.situations._situation import Question
from warpvis.situations._wording import (
    AMOUNTS,
    BOTH,
    LEFT,
    NEITHER,
    NO,
    RIGHT,
    YES,
    word_questions,
    word_share,
    word_state,
)

_AMOUNT_LIMITS = ((0.0, 0.01), (0.1, 0.4), (0.6, 1.0))
"""Visible shares of the answers on amounts; objects between them are not asked about."""
_AMOUNT_BORDERS = (0.05, 0.5)
_MIN_ANGLE = math.radians(6)
_MAX_ANGLE = math.radians(70)
_MIN_NEARER = 0.25
"""Minimum difference of distances [m]."""
_MIN_AWAY = 10
_MAIN_BLOCKER = 0.7
"""Minimum share of a silhouette that an object must hide to be the reason."""


def ask(kind: str, choices: Sequence[str], answer: str, reason: str, margin: tuple[float, str], **words: str) -> dict:
    """Return the fields of a question that follow from its words."""
    text, *paraphrases = word_questions(kind, **words)
    return {
        "kind": kind,
        "text": text,
        "paraphrases": tuple(paraphrases),
        "choices": tuple(choices),
        "answer": answer,
        "reason": reason[:1].upper() + reason[1:] + ".",
        "margin": round(float(margin[0]), 4),
        "unit": margin[1],
    }


def yes_or_no(panel: Panel, world: int, agent: int, thing: int) -> tuple[str, str, float]:
    """Return whether an agent sees an object, why, and the margin of its visible share."""
    share = float(panel.fraction[world, agent, thing])
    if share >= LIMIT:
        return YES, f"{word_share(share)} is visible", share - LIMIT
    return NO, why_not(panel, world, agent, thing), LIMIT - share


def why_not(panel: Panel, world: int, agent: int, thing: int) -> str:
    """Return in words why an agent does not see an object."""
    blocker, _ = panel.blocker(world, agent, thing)
    state = panel.state(world, agent, thing)
    state = "occluded" if state == "visible" else state
    return word_state(state, panel.participants[agent].words, panel.words.get(blocker, ""))


def make_pool(
    panel: Panel,
    kind: str,
    rows: Sequence[NDArray[np.integer]],
    answer: NDArray[np.integer],
    write: Callable[[int], Question],
    *,
    stratum: NDArray[np.integer] | None = None,
) -> Pool:
    """Return the pool of questions with columns ``world, agent, thing`` and others, which determine the words."""
    world, agent, thing = rows[:3]
    columns = np.stack(rows[1:], axis=1) if len(world) else np.zeros((0, len(rows) - 1), dtype=np.int64)
    _, words = np.unique(columns, axis=0, return_inverse=True)
    distance = panel.found.distance[world, agent, thing][:, None]
    features = np.concatenate([panel.picture_features(world, thing), distance], axis=1)
    levels = np.zeros(len(world), dtype=np.int64) if stratum is None else stratum
    world, words, answer, levels = (one.astype(np.int64) for one in (world, words.reshape(-1), answer, levels))
    return Pool(kind, world, words, answer, levels, features, write)


def about_pairs(panel: Panel) -> NDArray[np.bool_]:
    """Return which participants and objects are both well visible in the picture, shape ``(W, P, T)``."""
    return panel.participant_in_picture[:, :, None] & panel.in_picture[:, None, :]


def sees(panel: Panel) -> Pool:
    """Ask whether a participant sees an object."""
    share = panel.fraction
    rows = np.nonzero(about_pairs(panel) & is_clear(share))
    rows = tuple(column[_without_excess(panel, rows)] for column in rows)
    answer = (share[rows] < LIMIT).astype(np.int64)

    def write(row: int) -> Question:
        world, agent, thing = (int(column[row]) for column in rows)
        choice, reason, margin = yes_or_no(panel, world, agent, thing)
        who, what = panel.participants[agent], panel.things[thing]
        words = {"agent": who.words, "thing": panel.words[what]}
        return Question(**ask("sees", (YES, NO), choice, reason, (margin, "share"), **words), about=(who.name, what))

    return make_pool(panel, "sees", rows, answer, write)


def _without_excess(panel: Panel, rows: tuple[NDArray[np.integer], ...]) -> NDArray[np.bool_]:
    """Return which rows to keep so that objects out of view are not more frequent than hidden ones, shape ``(n,)``.

    Otherwise, almost everything that is not seen would be behind a person's back.
    """
    away = panel.found.status[rows] == Visibility.OUT_OF_VIEW
    hidden = (panel.fraction[rows] <= HIDDEN) & ~away
    count = max(int(hidden.sum()), _MIN_AWAY)
    kept = ~away
    kept[np.flatnonzero(away)[:: max(1, math.ceil(away.sum() / count))]] = True
    return kept


def how_much(panel: Panel) -> Pool:
    """Ask how much of an object a participant sees."""
    share = panel.fraction
    answer = np.full(share.shape, -1, dtype=np.int64)
    for number, (low, high) in enumerate(_AMOUNT_LIMITS):
        answer[(share >= low) & (share <= high)] = number
    rows = np.nonzero(about_pairs(panel) & (answer >= 0))

    def write(row: int) -> Question:
        world, agent, thing = (int(column[row]) for column in rows)
        fraction = float(share[world, agent, thing])
        margin = min(abs(fraction - border) for border in _AMOUNT_BORDERS)
        who, what = panel.participants[agent], panel.things[thing]
        words = {"agent": who.words, "thing": panel.words[what]}
        reason = f"{word_share(fraction)} is visible"
        choice = AMOUNTS[int(answer[world, agent, thing])]
        asked = ask("how_much", AMOUNTS, choice, reason, (margin, "share"), **words)
        return Question(**asked, about=(who.name, what))

    return make_pool(panel, "how_much", rows, answer[rows], write)


def reasons(panel: Panel) -> Pool:
    """Ask why a participant does not see an object: what hides it, or that it is out of the field of view."""
    rows = np.nonzero(about_pairs(panel) & (panel.fraction <= HIDDEN))
    found: list[str] = []
    for world, agent, thing in zip(*(column.tolist() for column in rows), strict=True):
        state = panel.state(world, agent, thing)
        blocker, hidden = panel.blocker(world, agent, thing)
        if state in ("occluded", "visible"):
            found.append(panel.words.get(blocker, "") if hidden >= _MAIN_BLOCKER else "")
        else:
            found.append(state)
    used = np.array([bool(word) for word in found], dtype=np.bool_)
    rows = tuple(column[used] for column in rows)
    kept = [word for word in found if word]
    numbers = {word: number for number, word in enumerate(sorted(set(kept)))}
    answer = np.array([numbers[word] for word in kept], dtype=np.int64)
    pool_words = np.unique(np.stack(rows[1:], axis=1), axis=0, return_inverse=True)[1].reshape(-1) if kept else answer
    alternatives = {
        int(number): sorted({kept[index] for index in np.flatnonzero(pool_words == number)})
        for number in np.unique(pool_words)
    }

    def write(row: int) -> Question:
        world, agent, thing = (int(column[row]) for column in rows)
        who, what = panel.participants[agent], panel.things[thing]
        state = {"out_of_view", "too_far", "too_near"}
        choices = [
            word_state(word, who.words) if word in state else word_state("occluded", who.words, word)
            for word in alternatives[int(pool_words[row])]
        ]
        choice = choices[alternatives[int(pool_words[row])].index(kept[row])]
        margin = LIMIT - float(panel.fraction[world, agent, thing])
        words = {"agent": who.words, "thing": panel.words[what]}
        asked = ask("why_not", choices, choice, choice, (margin, "share"), **words)
        return Question(**asked, about=(who.name, what))

    return make_pool(panel, "why_not", rows, answer, write)


def _pairs(panel: Panel, valid: NDArray[np.bool_]) -> tuple[NDArray[np.integer], ...]:
    """Return worlds, agents, things and other things of pairs that both are valid, shape of `valid` ``(W, P, T)``."""
    both = valid[:, :, :, None] & valid[:, :, None, :]
    both &= ~np.eye(len(panel.things), dtype=np.bool_)
    return np.nonzero(both)


def left_right(panel: Panel) -> Pool:
    """Ask which of two objects is left of the other for a participant, who may see them mirrored to the picture."""
    angle = panel.found.azimuth[:, :-1, : len(panel.things)]
    valid = about_pairs(panel) & (panel.fraction >= SEEN) & (np.abs(angle) <= _MAX_ANGLE)
    world, agent, thing, other = _pairs(panel, valid)
    apart = angle[world, agent, thing] - angle[world, agent, other]
    in_picture = panel.found.azimuth[:, -1]
    shown = in_picture[world, thing] - in_picture[world, other]
    clear = (np.abs(apart) >= _MIN_ANGLE) & (np.abs(shown) >= _MIN_ANGLE)
    rows, apart, shown = tuple(c[clear] for c in (world, agent, thing, other)), apart[clear], shown[clear]

    def write(row: int) -> Question:
        _, agent, thing, other = (int(column[row]) for column in rows)
        who, what, second = panel.participants[agent], panel.things[thing], panel.things[other]
        degrees = math.degrees(apart[row])
        choice = LEFT if degrees < 0 else RIGHT
        reason = f"it is {abs(degrees):.0f} degrees to the {choice} for {who.words}"
        words = {"agent": who.words, "thing": panel.words[what], "other": panel.words[second]}
        asked = ask("left_right", (LEFT, RIGHT), choice, reason, (abs(degrees), "degrees"), **words)
        return Question(**asked, about=(who.name, what, second))

    same = ((apart < 0) == (shown < 0)).astype(np.int64)
    return make_pool(panel, "left_right", rows, (apart > 0).astype(np.int64), write, stratum=same)


def nearer(panel: Panel) -> Pool:
    """Ask which of two objects is nearer to a participant, to whom it may be the one that is farther in the picture."""
    distance = panel.found.distance[:, :-1, : len(panel.things)]
    world, agent, thing, other = _pairs(panel, about_pairs(panel) & (panel.fraction >= SEEN))
    apart = distance[world, agent, thing] - distance[world, agent, other]
    shown = panel.found.distance[world, -1, thing] - panel.found.distance[world, -1, other]
    clear = (np.abs(apart) >= _MIN_NEARER) & (np.abs(shown) >= _MIN_NEARER)
    rows, apart, shown = tuple(c[clear] for c in (world, agent, thing, other)), apart[clear], shown[clear]

    def write(row: int) -> Question:
        world, agent, thing, other = (int(column[row]) for column in rows)
        who, what, second = panel.participants[agent], panel.things[thing], panel.things[other]
        names = panel.words[what], panel.words[second]
        choice = names[0] if apart[row] < 0 else names[1]
        far = [f"{distance[world, agent, index]:.1f} m" for index in (thing, other)]
        reason = f"{names[0]} is at {far[0]}, and {names[1]} at {far[1]}"
        words = {"agent": who.words, "thing": names[0], "other": names[1]}
        asked = ask("nearer", names, choice, reason, (abs(apart[row]), "meters"), **words)
        return Question(**asked, about=(who.name, what, second))

    same = ((apart < 0) == (shown < 0)).astype(np.int64)
    return make_pool(panel, "nearer", rows, (apart > 0).astype(np.int64), write, stratum=same)


def meant(panel: Panel) -> Pool:
    """Ask which of two objects of one class a participant means, who sees only one of them."""
    categories = [panel.categories[name] for name in panel.things]
    alike = np.array([[a == b and i < j for j, b in enumerate(categories)] for i, a in enumerate(categories)])
    seen, hidden, shown = panel.fraction >= SEEN, panel.fraction <= HIDDEN, about_pairs(panel)
    one = (seen[..., :, None] & hidden[..., None, :]) | (hidden[..., :, None] & seen[..., None, :])
    rows = np.nonzero(one & alike & shown[..., :, None] & shown[..., None, :])
    first = seen[rows[0], rows[1], rows[2]]

    def write(row: int) -> Question:
        world, agent, thing, other = (int(column[row]) for column in rows)
        who = panel.participants[agent]
        names = [panel.words[panel.things[index]] for index in (thing, other)]
        unseen = other if first[row] else thing
        shares = panel.fraction[world, agent, [thing, other]]
        margin = float(np.abs(shares - LIMIT).min())
        reason = f"the other one is not in sight: {why_not(panel, world, agent, unseen)}"
        words = {"agent": who.words, "category": categories[thing]}
        choice = names[0] if first[row] else names[1]
        asked = ask("meant", names, choice, reason, (margin, "share"), **words)
        return Question(**asked, about=(who.name, panel.things[thing], panel.things[other]))

    return make_pool(panel, "meant", rows, (~first).astype(np.int64), write)


def who_sees(panel: Panel) -> Pool:
    """Ask which of two participants see an object."""
    pairs = list(itertools.combinations(range(len(panel.participants)), 2))
    share, shown = panel.fraction, about_pairs(panel)
    clear = shown & is_clear(share)
    parts = [np.nonzero(clear[:, first] & clear[:, second]) for first, second in pairs]
    none = np.zeros(0, dtype=np.int64)
    world = np.concatenate([none, *(part[0] for part in parts)])
    thing = np.concatenate([none, *(part[1] for part in parts)])
    agents = np.repeat(np.array(pairs, dtype=np.int64).reshape(-1, 2), [len(part[0]) for part in parts], axis=0)
    by_first = share[world, agents[:, 0], thing] >= LIMIT
    by_second = share[world, agents[:, 1], thing] >= LIMIT
    answer = np.where(by_first & by_second, 2, np.where(by_first, 0, np.where(by_second, 1, 3)))
    rows = world, agents[:, 0], thing, agents[:, 1]

    def write(row: int) -> Question:
        first, second = (panel.participants[int(index)] for index in agents[row])
        choices = first.words, second.words, BOTH, NEITHER
        shares = [float(share[world[row], agent, thing[row]]) for agent in agents[row]]
        margin = min(abs(value - LIMIT) for value in shares)
        what = panel.things[int(thing[row])]
        told = [yes_or_no(panel, int(world[row]), int(agent), int(thing[row]))[1] for agent in agents[row]]
        reason = f"for {first.words}, {told[0]}; for {second.words}, {told[1]}"
        words = {"agent": first.words, "second": second.words, "thing": panel.words[what]}
        asked = ask("who", choices, choices[int(answer[row])], reason, (margin, "share"), **words)
        return Question(**asked, about=(first.name, second.name, what))

    return make_pool(panel, "who", rows, answer.astype(np.int64), write)


KINDS: dict[str, Callable[[Panel], Pool]] = {
    "sees": sees,
    "how_much": how_much,
    "why_not": reasons,
    "left_right": left_right,
    "nearer": nearer,
    "meant": meant,
    "who": who_sees,
}
"""The kinds of questions that need no further observations."""
