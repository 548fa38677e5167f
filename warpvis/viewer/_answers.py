# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Elements of both pages: answers for a picked point, sliders for eyes, and the table of what people mean."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from warpvis.viewer._picking import Picked
from warpvis.viewer._sight_marks import Point, SightMarks, answers_html, hint_html, meant_html
from warpvis.visibility import MAX_EYE_ANGLE

if TYPE_CHECKING:
    from viser import GuiApi, ViserServer

Angles = tuple[float, float]

_HINT = "Click a surface: who sees this point, and why not?"
_NOTHING = "Nothing is there: click a surface."
_MAX_DEGREES = math.floor(math.degrees(MAX_EYE_ANGLE))


class Answers:
    """The picked point with its answers, and what people mean; `update` changes the page after a change."""

    def __init__(
        self,
        server: ViserServer,
        pick: Callable[[Point | None], None],
        pick_along: Callable[[Point, Point], bool],
        attempt: Callable[[Callable[[], None]], None],
        order: float,
    ) -> None:
        """Add the elements and react to clicks.

        Args:
            server: The page's server.
            pick: Picks a point in the world [m], or none.
            pick_along: Picks a point along a ray, and returns whether there is one.
            attempt: Calls its argument, shows its error, and updates the page.
            order: Order of the element before these in the panel, as in viser.
        """
        self._attempt, self._pick, self._pick_along = attempt, pick, pick_along
        self._follow, self._hint = True, _HINT
        self.meant = server.gui.add_html("", order=order + 0.1)
        self.text = server.gui.add_html(hint_html(_HINT), order=order + 0.2)
        self._clear = server.gui.add_button("Forget point", color="gray", visible=False, order=order + 0.3)
        self.marks = SightMarks(server.scene, self._drag)
        server.scene.on_click()(self._click)

        @self._clear.on_click
        def _(_: object) -> None:
            attempt(lambda: pick(None))

    def show(self, picked: Picked | None, meant: Mapping[str, Mapping[str, float]]) -> None:
        """Show answers."""
        self.meant.content = meant_html(meant)
        self._clear.visible = picked is not None
        if picked is None:
            self.text.content = hint_html(self._hint)
            self.marks.show(None, (), follow=False)
        else:
            self.text.content = answers_html(picked.title, picked.lines, picked.reasons)
            self.marks.show(picked.point, picked.lines, follow=self._follow)

    def pick_behind(self, handles: Iterable[Any]) -> None:
        """Pick the surface behind the center of a handle that is clicked: it hides the surface from the pointer."""
        for handle in handles:
            handle.on_update(_HandleClicks(self._pick_ray))

    def _click(self, event: Any) -> None:
        self._pick_ray(event.ray_origin, event.ray_direction)

    def _pick_ray(self, origin: Point, direction: Point) -> None:
        def change() -> None:
            self._follow, self._hint = True, _HINT
            if not self._pick_along(origin, direction):
                self._hint = _NOTHING
                self._pick(None)

        self._attempt(change)

    def _drag(self, position: Point) -> None:
        """Pick the point to which the handle was dragged, and leave the handle to the user."""
        self._follow = False
        self._attempt(lambda: self._pick(position))


class _HandleClicks:
    """Calls a function with a ray to a handle that is pressed and released without a drag."""

    def __init__(self, clicked: Callable[[Point, Point], None]) -> None:
        self._clicked, self._moved = clicked, False

    def __call__(self, event: Any) -> None:
        if event.phase == "start":
            self._moved = False
        elif event.phase != "end":
            self._moved = True
        elif not self._moved and event.client is not None:
            eye, center = event.client.camera.position, event.target.position
            x, y, z = map(float, eye)
            self._clicked((x, y, z), (float(center[0]) - x, float(center[1]) - y, float(center[2]) - z))


class GazeSliders:
    """Two sliders that turn the eyes of an agent, and a button that turns them back."""

    def __init__(
        self,
        gui: GuiApi,
        turn: Callable[[str, Angles | None], None],
        attempt: Callable[[Callable[[], None]], None],
        order: float,
        names: Sequence[str] = (),
    ) -> None:
        """Add the elements.

        Args:
            gui: The page's panel.
            turn: Turns the eyes of an agent to the right and up [rad]; None turns them back.
            attempt: Calls its argument, shows its error, and updates the page.
            order: Order of the element before these in the panel, as in viser.
            names: Names of the agents; the elements are not shown without any.
        """
        self._turn, self._attempt = turn, attempt
        self._angles: dict[str, Angles] = {}
        self._folder = gui.add_folder("gaze", expand_by_default=False, order=order + 0.4, visible=False)
        with self._folder:
            self.agent: Any = gui.add_dropdown("agent", [""])
            limits: dict[str, Any] = {"min": -_MAX_DEGREES, "max": _MAX_DEGREES, "step": 1, "initial_value": 0}
            self.right: Any = gui.add_slider("right [deg]", **limits)
            self.up: Any = gui.add_slider("up [deg]", **limits)
            back = gui.add_button("Look ahead")
        self.agent.on_update(lambda _: self._follow())
        for slider in (self.right, self.up):
            slider.on_update(self._moved)
        back.on_click(lambda _: self._release())
        self.set_names(names)

    def set_names(self, names: Sequence[str]) -> None:
        """Set the names of the agents. The second one is chosen at first: the first one is a robot where there are two.

        Angles of agents that are absent are kept.
        """
        if not names:
            self._folder.visible = False
        elif tuple(names) != tuple(self.agent.options):
            chosen = self.agent.value if self.agent.value in names else names[min(1, len(names) - 1)]
            self.agent.options = tuple(names)
            self.agent.value = chosen
            self._folder.visible = True

    @property
    def angles(self) -> dict[str, Angles]:
        """Angles by which eyes are turned to the right and up [rad], by name of the agent."""
        return dict(self._angles)

    def reset(self) -> None:
        """Set all sliders back, after all eyes were turned back."""
        self._angles = {}
        self._follow()

    def _moved(self, event: Any) -> None:
        if event.client_id is None:  # the program set the slider
            return
        name, angles = self.agent.value, (math.radians(self.right.value), math.radians(self.up.value))

        def change() -> None:
            self._turn(name, angles)
            self._angles[name] = angles

        self._attempt(change)

    def _release(self) -> None:
        name = self.agent.value
        self._angles.pop(name, None)
        self._follow()
        self._attempt(lambda: self._turn(name, None))

    def _follow(self) -> None:
        """Set the sliders to the angles of the chosen agent."""
        right, up = self._angles.get(self.agent.value, (0.0, 0.0))
        self.right.value, self.up.value = round(math.degrees(right)), round(math.degrees(up))
