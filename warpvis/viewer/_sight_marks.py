# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of sight to a picked point: in the 3D view, and as answers in the panel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from warpvis.core.checks import format_fraction
from warpvis.core.labels import Visibility
from warpvis.viewer._page_parts import CELL, STYLE, color_dot
from warpvis.visibility import LineOfSight

if TYPE_CHECKING:
    from viser import SceneApi

Point = tuple[float, float, float]

# Colors of lines of sight (Okabe and Ito's palette, for all kinds of color vision), and of the border of unknown space.
SIGHT_COLORS: dict[Visibility, tuple[int, int, int]] = {
    Visibility.VISIBLE: (0, 158, 115),
    Visibility.OCCLUDED: (213, 94, 0),
    Visibility.UNKNOWN: (204, 121, 167),
    Visibility.OUT_OF_VIEW: (150, 150, 150),
    Visibility.TOO_NEAR: (150, 150, 150),
    Visibility.TOO_FAR: (150, 150, 150),
}
_POINT_COLOR = (240, 228, 66)
_MARK_RADIUS, _THICKNESS, _HANDLE = 0.03, 0.016, 0.25

# Smallest probability in the table of what is meant.
_MIN_PROBABILITY = 0.005


class SightMarks:
    """A picked point with a handle, the lines of sight to it, and a mark where each is blocked."""

    def __init__(self, scene: SceneApi, dragged: Callable[[Point], None]) -> None:
        """Start without a point. `dragged` is called with the position of the handle."""
        self._scene, self._nodes = scene, list[Any]()
        self._shown: tuple[Any, ...] = ()
        self.handle = scene.add_transform_controls(
            "/picked/handle",
            scale=_HANDLE,
            depth_test=False,
            disable_rotations=True,
            disable_sliders=True,
            visible=False,
        )

        @self.handle.on_update
        def moved(event: Any) -> None:
            if event.phase in ("start", "end"):  # the handle is pressed or released
                return
            x, y, z = map(float, self.handle.position)
            dragged((x, y, z))

    def show(self, point: Point | None, lines: Sequence[LineOfSight], *, follow: bool) -> None:
        """Show a point and the lines to it, or remove them; `follow` moves the handle to the point."""
        if self.handle.visible != (point is not None):
            self.handle.visible = point is not None
        if point is not None and follow and tuple(self.handle.position) != tuple(point):
            self.handle.position = point
        if (point, *lines) == self._shown:
            return
        self._shown = (point, *lines)
        for node in self._nodes:
            node.remove()
        self._nodes = []
        if point is None:
            return
        self._mark("point", _POINT_COLOR, point)
        segments, colors = [], []
        for number, line in enumerate(lines):
            color, seen = SIGHT_COLORS[line.status], SIGHT_COLORS[Visibility.VISIBLE]
            if line.stop is None:
                segments.append((line.eye, line.point))
                colors.append([color] * 2)
            else:
                segments += [(line.eye, line.stop), (line.stop, line.point)]
                colors += [[seen] * 2, [color] * 2]
                self._mark(f"stop {number}", color, line.stop)
        if segments:
            node = self._scene.add_line_segments(
                "/picked/lines", np.array(segments, np.float32), np.array(colors, np.uint8), thickness=_THICKNESS
            )
            self._nodes.append(node)

    def _mark(self, name: str, color: tuple[int, int, int], place: Point) -> None:
        node = self._scene.add_icosphere(
            f"/picked/{name}", _MARK_RADIUS, color, position=place, cast_shadow=False, receive_shadow=False
        )
        self._nodes.append(node)


def answers_html(title: str, lines: Sequence[LineOfSight], reasons: Mapping[str, str]) -> str:
    """Return the reasons for a point: a row per agent, with a dot in the color of its line of sight."""
    states = {line.agent: line.status for line in lines}
    rows = "".join(
        f"<div>{dot(states.get(name, Visibility.OUT_OF_VIEW))}<b>{escape(name)}</b>: {escape(reason)}</div>"
        for name, reason in reasons.items()
    )
    return f'<div style="{STYLE}" class="warpvis-answers"><div>{escape(title)}</div>{rows}</div>'


def hint_html(text: str) -> str:
    """Return a hint in the place of answers."""
    return f'<div style="{STYLE};opacity:0.7" class="warpvis-answers">{escape(text)}</div>'


def meant_html(meant: Mapping[str, Mapping[str, float]]) -> str:
    """Return the table of what people mean: a row per object, the likeliest first, and a column per person."""
    people = list(meant)
    best = {name: max(found.get(name, 0.0) for found in meant.values()) for one in meant.values() for name in one}
    names = sorted((name for name in best if best[name] >= _MIN_PROBABILITY), key=lambda name: -best[name])
    if not names:
        return ""
    head = "".join(f'<th style="text-align:left">{escape(word)}</th>' for word in ["meant object", *people])
    rows = "".join(
        f'<tr><td style="{CELL}">{escape(name)}</td>{"".join(_bar(meant[person].get(name)) for person in people)}</tr>'
        for name in names
    )
    return (
        f'<div style="{STYLE};max-height:10em;overflow:auto"><table class="warpvis-meant" '
        f'style="border-collapse:collapse;width:100%"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'
    )


def _bar(probability: float | None) -> str:
    """Return a cell with a probability and a bar of its length."""
    if probability is None:
        return f'<td style="{CELL}"></td>'
    share = f"rgba(0,114,178,0.25) {100 * probability:.0f}%"
    style = f"{CELL};background:linear-gradient(to right,{share},transparent 0)"
    return f'<td style="{style}">{format_fraction(probability)}</td>'


def dot(status: Visibility) -> str:
    """Return a dot in the color of a status."""
    return color_dot(SIGHT_COLORS[status])
