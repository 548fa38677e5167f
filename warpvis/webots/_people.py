# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""People of Webots worlds, as agents."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Label
from warpvis.core.poses import check_up, look_at
from warpvis.errors import PoseError
from warpvis.scene import Scene
from warpvis.visibility import Agent
from warpvis.webots._parts import Solid, names_of

# Heights of the eyes and the chin, relative to the stature (Drillis and Contini, Body Segment Parameters, 1966).
_EYES, _CHIN = 0.936, 0.870
_UPRIGHT = math.cos(math.radians(45))
"""Minimum cosine of the angle between a person's axis and the vertical."""


def find_people(solids: Iterable[Solid], names: Mapping[Solid, list[str]], scene: Scene) -> dict[str, Agent]:
    """Return the people of a world by name: outermost Solids with an object of the class human, or named so."""
    groups: dict[Solid, list[Solid]] = {}
    for solid in solids:
        chain = [step for step in solid.chain() if _is_person(step, names, scene)]
        if chain and chain[0] is solid:
            groups.setdefault(chain[-1], []).append(solid)
    people: dict[str, Agent] = {}
    for person, parts in groups.items():
        body = names_of(names, parts)
        eyes = next((part.eyes for part in [person, *parts] if part.eyes is not None), None)
        if eyes is None and body:
            eyes = _guess_eyes(person, np.concatenate([scene[name].vertices for name in body]), scene)
        if eyes is not None and body:
            name = body[0] if person not in names else names[person][0]
            people[name] = Agent.human(name, eyes, body=body)
    return people


def _is_person(solid: Solid, names: Mapping[Solid, list[str]], scene: Scene) -> bool:
    if solid in names:
        return any(scene[name].label == Label.HUMAN for name in names[solid])
    return solid.label() == Label.HUMAN


def _guess_eyes(person: Solid, vertices: NDArray[np.floating], scene: Scene) -> NDArray[np.float64] | None:
    """Return the pose of a standing person's eyes by the proportions of adults; None for one who does not stand."""
    vertical = check_up(scene.up)
    upright, forward = person.frame[:3, person.axes[0]], person.frame[:3, person.axes[1]]
    if upright[vertical] < _UPRIGHT:
        return None
    heights = vertices[:, vertical].astype(np.float64)
    low, stature = heights.min(), np.ptp(heights)
    head = vertices[heights >= low + _CHIN * stature].astype(np.float64)
    eyes = (head.min(axis=0) + head.max(axis=0)) / 2
    eyes[vertical] = low + _EYES * stature
    level = forward - forward[vertical] * np.eye(3)[vertical]
    try:
        return look_at(eyes, eyes + level, up=scene.up)
    except PoseError:
        return None
