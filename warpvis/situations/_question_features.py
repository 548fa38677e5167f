# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Simple measures of the objects and people of a question, from which a shortcut could guess its answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.motion import rotate
from warpvis.situations._situation import Pose, Question, Situation

SHORTCUTS = ("distance", "image_height", "image_size", "image_column")
"""Measures of the camera's picture: distance from the camera, and row, size and column in the picture."""
DIAGNOSTICS = ("agent_distance", "gaze_angle")
"""Measures from the eyes of a participant, which are part of the geometry that a question is about."""

_SLOTS = 2
_PERSON = 0.25
"""Size of a head, as that of a participant in the picture [m]."""


@dataclass(frozen=True, eq=False)
class Measures:
    """Measures of all objects and participants of a situation, at its first moment."""

    places: dict[str, int]
    """Row of an object or a participant by its name."""
    things: frozenset[str]
    """Names of the objects."""
    words: dict[str, str]
    """Name of an object or a participant by the words of questions; empty if several have the same words."""
    picture: NDArray[np.float64]
    """`SHORTCUTS` of each, ``(n, 4)``."""
    agents: dict[str, NDArray[np.float64]]
    """`DIAGNOSTICS` of each from the eyes of each participant, ``(n, 2)``."""


def measure(situation: Situation) -> Measures:
    """Measure the objects and participants of a situation."""
    moment = situation.moments[0]
    items = [(thing.name, thing.words, thing.pose, max(thing.size)) for thing in moment.things]
    items += [(agent.name, agent.words or agent.name, agent.eyes, _PERSON) for agent in moment.participants]
    positions = np.array([pose[:3] for _, _, pose, _ in items], dtype=np.float64).reshape(-1, 3)
    sizes = np.array([size for *_, size in items], dtype=np.float64)
    words: dict[str, str] = {}
    for name, text, _, _ in items:
        for key in {plain_words(text), plain_words(name)}:
            words[key] = "" if words.get(key, name) != name else name
    pose: Any = situation.camera.get("pose")
    picture = np.zeros((len(items), len(SHORTCUTS)))
    if isinstance(pose, Sequence) and len(items):
        seen = _in_frame(tuple(pose), positions)
        distance = np.linalg.norm(seen, axis=1)
        height = np.arctan2(seen[:, 1], np.hypot(seen[:, 0], seen[:, 2]))
        picture = np.stack(
            [distance, height, sizes / np.maximum(distance, 1e-6), np.arctan2(seen[:, 0], seen[:, 2])], axis=1
        )
    agents = {}
    for agent in moment.participants:
        seen = _in_frame(agent.eyes, positions)
        distance = np.linalg.norm(seen, axis=1)
        gaze = np.degrees(np.arctan2(np.hypot(seen[:, 0], seen[:, 1]), seen[:, 2]))
        agents[agent.name] = np.stack([distance, gaze], axis=1)
    places = {name: row for row, (name, *_) in enumerate(items)}
    return Measures(places, frozenset(thing.name for thing in moment.things), words, picture, agents)


def _in_frame(pose: Pose, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return positions in a frame with OpenCV's axes."""
    inverse = np.array([-pose[3], -pose[4], -pose[5], pose[6]], dtype=np.float64)
    offsets = positions - np.array(pose[:3], dtype=np.float64)
    return rotate(np.broadcast_to(inverse, (len(offsets), 4)), offsets)


def plain_words(text: str) -> str:
    """Return words of an answer without case, article and period."""
    return text.lower().rstrip(".").removeprefix("the ").removeprefix("a ").strip()


def subject_features(measures: Measures, question: Question) -> dict[str, NDArray[np.float64]]:
    """Return a row of features by measure, from the objects and participants that a question is about."""
    known = [name for name in question.about if name in measures.places]
    things = [measures.places[name] for name in known if name in measures.things][:_SLOTS]
    agents = [name for name in known if name not in measures.things][:_SLOTS]
    features = {}
    for column, name in enumerate(SHORTCUTS):
        values = measures.picture[:, column]
        slots = _slots(values[things]) + _slots(values[[measures.places[agent] for agent in agents]])
        rank = [float(np.mean(values < values[things[0]])) if things else 0.0]
        features[name] = np.array([*slots, slots[0] - slots[1], slots[0] - slots[2], *rank])
    for column, name in enumerate(DIAGNOSTICS):
        slots = [value for agent in agents for value in _slots(measures.agents[agent][things, column])]
        slots += [0.0] * (_SLOTS * _SLOTS - len(slots))
        features[name] = np.array([*slots, slots[0] - slots[1], slots[0] - slots[2]])
    return features


def choice_features(measures: Measures, question: Question) -> dict[str, NDArray[np.float64]] | None:
    """Return rows of features of the choices by measure; None unless each choice names an object or a participant."""
    names = [measures.words.get(plain_words(choice)) for choice in question.choices]
    rows = [measures.places[name] for name in names if name]
    if len(rows) < len(names):
        return None
    agents = [name for name in question.about if name in measures.agents]
    features = {name: _compared(measures.picture[rows, column]) for column, name in enumerate(SHORTCUTS)}
    for column, name in enumerate(DIAGNOSTICS):
        values = measures.agents[agents[0]][rows, column] if agents else np.zeros(len(rows))
        features[name] = _compared(values)
    return features


def _slots(values: NDArray[np.float64]) -> list[float]:
    return [*values.tolist(), *[0.0] * (_SLOTS - len(values))]


def _compared(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each value, its rank from 0 to 1, and its difference from the mean."""
    rank = values.argsort(kind="stable").argsort(kind="stable") / max(len(values) - 1, 1)
    return np.stack([values, rank, values - values.mean()], axis=1)
