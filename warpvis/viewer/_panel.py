# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The page's panel: the table, the agents' images, sliders, and buttons with their results."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import format_percent
from warpvis.core.poses import check_up
from warpvis.errors import WarpvisError
from warpvis.maps import floor_map
from warpvis.planning import propose_view
from warpvis.viewer._pictures import kinect_noise, with_view
from warpvis.viewer._tables import legend_html, status_html, table_html
from warpvis.visibility import Agent, choose_likeliest

if TYPE_CHECKING:
    from viser import GuiApi

    from warpvis.planning import Proposal
    from warpvis.viewer._pictures import Seen
    from warpvis.viewer._state import Snapshot, ViewerState

Act = Callable[[Callable[[], None]], None]
"""Function that calls its argument, which changes the state, and updates the page."""

_MAP_CELLS = 160
"""Number of cells along a floor map's longer side."""


_PICTURES = {"depth": "depth", "visibility": "objects"}
_COLOR_PICTURES = {"color and depth": "both", "color": "color", **_PICTURES}
_OBJECTS = {"materials": "materials", "visibility": "visibility"}
_CLOUDS = {"visibility": "visibility", "labels of the depth image": "labels", "none": "none"}
_MAX_HEIGHT, _MIN_FAR, _MAX_FAR = 3.0, 0.5, 20.0
_JPEG = 85
_STEP = (0.05, 1.0)
"""Minimum and maximum time between two played frames [s]."""


class Panel:
    """The elements of the panel next to the 3D view, created in their order on the page."""

    def __init__(
        self,
        gui: GuiApi,
        state: ViewerState,
        update: Callable[[], None],
        act: Act,
        shown: Mapping[str, Any],
        propose: Callable[[], tuple[str, bool]],
        go_there: Callable[[], None],
    ) -> None:
        """Add the elements; `shown` are nodes of the 3D view that can be hidden by their attribute `visible`."""
        self._gui, self._state, self._update, self._act = gui, state, update, act
        self._propose, self._go_there = propose, go_there
        names = list(state.agents)
        self.message = gui.add_markdown("", visible=False)
        self.table = gui.add_html("")
        self.legend = gui.add_html(legend_html(names))
        blank = np.full((3, 4, 3), 128, dtype=np.uint8)
        self.images = {name: gui.add_image(blank, label=f"{name} sees", jpeg_quality=_JPEG) for name in names}
        self.map = gui.add_image(blank, label=f"floor seen by {names[0]}", visible=False)
        self.sliders: dict[str, Any] = {}
        self._add_buttons()
        self._add_choices(shown)
        for name in names:
            self._add_agent(state.agents[name])
        self._add_frames()
        self._add_joints()
        self.status = gui.add_html("")

    def show(self, snapshot: Snapshot, rate: float) -> None:
        self.table.content = table_html(snapshot.rows, [agent.name for agent in snapshot.agents])
        self.status.content = status_html(snapshot.seconds, rate)
        for agent, picture in zip(snapshot.agents, snapshot.pictures, strict=True):
            self.images[agent.name].image = picture
        if self._with_map.value:
            self.map.image = map_picture(self._state, snapshot.views[0])

    def show_message(self, text: str) -> None:
        """Show a message at the top; hide it if it is empty."""
        self.message.content, self.message.visible = text, bool(text)

    def attempt(self, change: Callable[[], None]) -> None:
        """Change the state, and show the error message if that fails."""
        try:
            self._act(change)
            self.show_message("")
        except WarpvisError as error:
            self.show_message(str(error))

    def _add_buttons(self) -> None:
        gui = self._gui
        if len(self._state.agents) > 1:
            robot = next(iter(self._state.agents))
            propose_button = gui.add_button(f"Where should {robot} go?")
            self.answer = gui.add_markdown("", visible=False)
            go_button = gui.add_button("Go there", visible=False)

            @propose_button.on_click
            def asked(_: object) -> None:
                self.answer.content, go_button.visible = self._propose()
                self.answer.visible = True

            @go_button.on_click
            def gone(_: object) -> None:
                self._go_there()
                self.answer.visible = go_button.visible = False

        self.reset = gui.add_button("Reset scene")

        @self.reset.on_click
        def _(_: object) -> None:
            self.attempt(self._state.reset)
            for name in self._state.agents:
                self._follow(name)
            model = self._state.model
            for joint in [] if model is None else model.joints:
                assert model is not None  # implied by the loop over its joints
                self.sliders[f"joint {joint.name}"].value = model.value(joint.name)

    def _add_choices(self, shown: Mapping[str, Any]) -> None:
        gui, state = self._gui, self._state
        with gui.add_folder("Show", expand_by_default=False):
            cloud = gui.add_dropdown("points", list(_CLOUDS), initial_value=next(iter(_CLOUDS)))
            pictures = _COLOR_PICTURES if state.has_colors else _PICTURES
            picture = gui.add_dropdown("images", list(pictures), initial_value=next(iter(pictures)))
            if state.has_colors:
                look = gui.add_dropdown("objects", list(_OBJECTS), initial_value=shown["meshes"].kind)
                self._bind(look, shown["meshes"], "kind", _OBJECTS)
            for name, nodes in shown.items():
                self._bind(gui.add_checkbox(name, True), nodes, "visible")
            self._with_map = gui.add_checkbox("floor map", False)
            noise = gui.add_slider("Kinect noise factor", min=0, max=4, step=0.5, initial_value=0)

        @noise.on_update
        def _(_: object) -> None:
            self.attempt(lambda: state.set_sensor(kinect_noise(float(noise.value))))

        self._bind(self._with_map, self.map, "visible")
        self._bind(cloud, state, "cloud_kind", _CLOUDS)
        self._bind(picture, state, "picture_kind", pictures)

    def _bind(self, box: Any, target: Any, name: str, values: Mapping[str, str] | None = None) -> None:
        """Set an attribute to a box's value, or to that of `values`, and update the page whenever it changes."""

        @box.on_update
        def _(_: object) -> None:
            setattr(target, name, box.value if values is None else values[box.value])
            self._update()

    def _add_agent(self, agent: Agent) -> None:
        """Add an agent's sliders."""
        name, values = agent.name, self._values(agent)
        with self._gui.add_folder(f"{name}'s eyes", expand_by_default=len(self.sliders) == 0):
            height = values["height"]
            limits = (min(0.0, height), max(_MAX_HEIGHT, 2 * height), 0.01)
            self._slider(f"{name} height", "height [m]", limits, height, partial(self._state.raise_agent, name))
            if (camera := agent.pinhole) is not None:
                wide, far = values["hfov"], values["far"]
                limits = (min(20.0, wide), max(120.0, wide), 1.0)
                self._slider(
                    f"{name} hfov",
                    "field of view [deg]",
                    limits,
                    wide,
                    lambda v: self._set_view(name, hfov=math.radians(v)),
                )
                limits = (max(_MIN_FAR, camera.near + 0.1), max(_MAX_FAR, far), 0.1)
                self._slider(f"{name} far", "range [m]", limits, far, lambda v: self._set_view(name, far=v))

    def _values(self, agent: Agent) -> dict[str, float]:
        """Return the values of an agent's sliders: height [m]; for a pinhole, field of view [degrees] and range [m]."""
        values = {"height": self._state.height(agent.name)}
        if (camera := agent.pinhole) is not None:
            values["hfov"] = math.degrees(camera.hfov)
            values["far"] = camera.far if math.isfinite(camera.far) else _MAX_FAR
        return values

    def _add_frames(self) -> None:
        """Add a slider and a checkbox to play frames."""
        frames = self._state.frames
        if frames is None or len(frames) < 2:
            return
        last = len(frames) - 1
        with self._gui.add_folder("frames"):
            self._slider("frame", "frame", (0, last, 1), 0, lambda value: self._state.show_frame(round(value)))
            play = self._gui.add_checkbox("play", False)

        @play.on_update
        def _(_: object) -> None:
            if play.value:
                threading.Thread(target=run, name="warpvis player", daemon=True).start()

        def run() -> None:
            steps = np.clip(np.diff(frames.timestamps), *_STEP)
            while play.value:
                number = self._state.frame + 1 if self._state.frame < last else 0
                self.attempt(lambda number=number: self._state.show_frame(number))  # type: ignore[misc]
                self.sliders["frame"].value = number
                time.sleep(float(steps[number - 1]))

    def _add_joints(self) -> None:
        """Add a slider for each joint of a MuJoCo model."""
        model = self._state.model
        if model is None or not model.joints:
            return
        with self._gui.add_folder("joints", expand_by_default=False):
            for joint in model.joints:
                value = model.value(joint.name)
                low, high = min(joint.low, value), max(joint.high, value)
                limits, change = (low, high, (high - low) / 200), partial(self._state.set_joint, joint.name)
                self._slider(f"joint {joint.name}", joint.name, limits, value, change)

    def _set_view(self, name: str, **view: float) -> None:
        camera = self._state.agents[name].pinhole
        assert camera is not None  # only pinhole cameras have sliders
        self._state.set_camera(name, with_view(camera, **view))

    def _slider(
        self,
        key: str,
        label: str,
        limits: tuple[float, float, float],
        value: float,
        change: Callable[[float], None],
    ) -> None:
        low, high, step = limits
        slider = self._gui.add_slider(label, min=low, max=high, step=step, initial_value=value)
        self.sliders[key] = slider

        @slider.on_update
        def _(event: Any) -> None:
            if event.client_id is not None:  # None if the program set the slider to match the state
                self.attempt(lambda: change(float(slider.value)))

    def _follow(self, name: str) -> None:
        """Set an agent's sliders to match the state."""
        for key, value in self._values(self._state.agents[name]).items():
            slider = self.sliders.get(f"{name} {key}")
            if slider is not None:
                slider.value = min(max(value, slider.min), slider.max)


def propose(state: ViewerState, snapshot: Snapshot, *, max_distance: float, radius: float) -> Proposal | str:
    """Propose a pose of the first agent, within `max_distance` [m], to see objects that only others see.

    Without one, return the reason.
    """
    if len(snapshot.agents) < 2:
        return "There is no second agent."
    robot, *others = snapshot.agents
    names = " or ".join(agent.name for agent in others)
    if robot.pinhole is None:
        return f"{robot.name} has no pinhole camera."
    found = choose_likeliest(item for agent in others for item in snapshot.meant[agent.name])
    if not found:
        return f"{names} sees no object."
    object_poses = snapshot.object_poses if len(snapshot.object_poses) else None
    floor = _floor(state)
    proposal = propose_view(
        state.scene, robot, found, max_distance=max_distance, radius=radius, floor=floor, object_poses=object_poses
    )
    if proposal is not None:
        return proposal
    if all(item.state is not None and item.state.name == "BOTH" for item in found):
        return f"{robot.name} sees every object that {names} sees."
    return f"No free place within {max_distance:g} m shows {robot.name} any of these objects."


def describe_proposal(proposal: Proposal) -> str:
    """Describe a proposal in a sentence."""
    fractions = ", ".join(f"{name} {format_percent(share)}" for name, share in proposal.fractions.items())
    return f"{proposal.distance:.2f} m away it would see: {fractions}."


def map_picture(state: ViewerState, seen: Seen) -> NDArray[np.uint8]:
    """Return a floor map of an agent's image, from above, second axis upwards, 2 x 2 pixels per cell, ``(h, w, 3)``."""
    bounds = state.scene.bounds.astype(np.float64)
    sides = np.delete(bounds[1] - bounds[0], check_up(state.scene.up))
    found = floor_map(
        np.ascontiguousarray(seen.points)[None],
        np.ascontiguousarray(seen.labels)[None],
        bounds=bounds,
        cell_size=max(float(sides.max()) / _MAP_CELLS, 0.005),
        up=state.scene.up,
        label_names=state.scene.label_names,
        ground_labels=state.scene.ground_labels,
    )
    return found.rgb()[0, ::-1].repeat(2, axis=0).repeat(2, axis=1)


def _floor(state: ViewerState) -> float:
    """Return the height of the ground [m]: its highest point, or the scene's lowest one without a ground."""
    vertical = check_up(state.scene.up)
    tops = [item.bounds[1, vertical] for item in state.scene.objects if item.label in state.scene.ground_labels]
    return float(max(tops)) if tops else float(state.scene.bounds[0, vertical])
