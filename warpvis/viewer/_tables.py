# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The table of objects and the legend of a page, as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from warpvis.core.checks import format_percent
from warpvis.viewer._page_parts import CELL, STYLE, color_dot
from warpvis.visibility import Perspective, State
from warpvis.viz import STATE_COLORS, agent_colors

_MAX_HEIGHT = "17em"


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
    """Whether the first agent and any other see the object."""


def table_rows(seen: Perspective) -> tuple[Row, ...]:
    """Return the table of the first situation."""
    first, *others = seen.agents
    states = seen.states(first, others)[0]
    rows = []
    for k, name in enumerate(seen.objects):
        cells = tuple(seen.cell(agent, 0, k, format_percent) for agent in range(len(seen.agents)))
        fractions = tuple(float(value) for value in seen.fraction[:, 0, k])
        label = seen.label_names.name(seen.labels[k])
        rows.append(Row(name, label, cells, fractions, State(int(states[k]))))
    return tuple(rows)


def table_html(rows: Sequence[Row], agents: Sequence[str]) -> str:
    """Return the table: a row per object, with a dot in the color of its `State`, and a column per agent.

    The head of a column is underlined in the color of the agent.
    """
    lines = ["transparent", *("rgb({},{},{})".format(*color) for color in agent_colors(len(agents)))]
    head = "".join(
        f'<th style="text-align:left;padding-right:0.5em"><span style="border-bottom:3px solid {line}">{escape(word)}'
        "</span></th>"
        for word, line in zip(["object", *agents], lines, strict=True)
    )
    body = "".join(_row(row, agents) for row in rows)
    return (
        f'<div style="{STYLE};max-height:{_MAX_HEIGHT};overflow:auto">'
        f'<table class="warpvis-table" style="border-collapse:collapse;width:100%">'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def legend_html(agents: Sequence[str]) -> str:
    """Return the legend of the colors."""
    states = (State.BOTH, State.FIRST, State.SECOND, State.NEITHER) if len(agents) > 1 else (State.FIRST, State.NEITHER)
    entries = "".join(
        f'<span style="white-space:nowrap;margin-right:0.9em">{_dot(state)}{escape(state_text(state, agents))}</span>'
        for state in states
    )
    return f'<div style="{STYLE}">{entries}</div>'


def state_text(state: State, agents: Sequence[str]) -> str:
    """Return the text of a `State`."""
    if len(agents) < 2:
        return f"{agents[0]} sees it" if state == State.FIRST else "not seen"
    first, others = agents[0], agents[1] if len(agents) == 2 else "others"
    both, neither = ("both see it", "neither") if len(agents) == 2 else (f"{first} and others", "nobody")
    return (neither, f"{first} only", f"{others} only", both)[state]


def status_html(seconds: float, updates: float) -> str:
    """Return the duration of the last update and the update rate."""
    rate = f", {updates:.0f} updates/s" if updates else ""
    return f'<div style="{STYLE};opacity:0.7" class="warpvis-status">{1e3 * seconds:.0f} ms{rate}</div>'


def _row(row: Row, agents: Sequence[str]) -> str:
    title = escape(f"{row.label}; {state_text(row.state, agents)}")
    cells = "".join(
        f'<td style="{CELL}{";white-space:nowrap" if cell.endswith("%") else ""}">{escape(cell)}</td>'
        for cell in row.cells
    )
    name = f'<td style="{CELL};white-space:nowrap" title="{title}">{_dot(row.state)}{escape(row.name)}</td>'
    return f"<tr>{name}{cells}</tr>"


def _dot(state: State) -> str:
    return color_dot(STATE_COLORS[state])
