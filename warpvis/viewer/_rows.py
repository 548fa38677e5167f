# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of the page's table."""

from __future__ import annotations

from dataclasses import dataclass

from warpvis.core.checks import format_percent
from warpvis.core.labels import Visibility
from warpvis.visibility import Perspective, State


@dataclass(frozen=True)
class Row:
    """A row of the table: an object and its visibility to each agent."""

    name: str
    label: str
    """Name of the object's label."""
    cells: tuple[str, ...]
    """For each agent, the visible percentage, or the reason why the agent does not see the object."""
    fractions: tuple[float, ...]
    """For each agent, the visible fraction of the silhouette, 0 to 1."""
    state: State
    """Which of the agents see the object."""


def table_rows(seen: Perspective) -> tuple[Row, ...]:
    """Return the table of the first situation."""
    flags = seen.visible[:, 0]
    states = sum(State(1 + number) * flags[number] for number in range(len(flags)))
    rows = []
    for k, name in enumerate(seen.objects):
        cells = tuple(_cell(seen, agent, k) for agent in range(len(seen.agents)))
        fractions = tuple(float(value) for value in seen.fraction[:, 0, k])
        label = seen.label_names.name(seen.labels[k])
        rows.append(Row(name, label, cells, fractions, State(int(states[k]))))
    return tuple(rows)


def _cell(seen: Perspective, agent: int, k: int) -> str:
    """Return the visible percentage of an object for an agent, or the reason why the agent does not see it."""
    index = (agent, 0, k)
    if seen.body[agent, k]:
        return "own body"
    status = Visibility(seen.status[index])
    if status == Visibility.VISIBLE:
        share = format_percent(float(seen.fraction[index]))
        return f"{share} ({int(seen.visible_pixels[index])} px)" if share.startswith("<") else share
    if status == Visibility.OCCLUDED and seen.occluder[index] >= 0:
        return f"hidden by {seen.scene_objects[seen.occluder[index]]}"
    return status.name.lower().replace("_", " ")
