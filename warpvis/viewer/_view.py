# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The live page of a scene: a viser server that recomputes a state whenever something moves, and its export to HTML."""

from __future__ import annotations

import base64
import io
import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.frames import Frames
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import as_path, check_flag, check_text
from warpvis.core.file_content import writing
from warpvis.core.poses import check_up
from warpvis.errors import FileFormatError, WarpvisError
from warpvis.scene import Scene, require_scene
from warpvis.viewer._answers import Answers, GazeSliders
from warpvis.viewer._first_view import FirstView, fold_on_phones, scene_corners
from warpvis.viewer._meshes import Meshes
from warpvis.viewer._nodes import (
    AgentMark,
    CloudNode,
    Gizmos,
    ProposalMark,
    SightNode,
    agent_colors,
    mark_scale,
)
from warpvis.viewer._page_parts import serve, stop
from warpvis.viewer._panel import Panel, describe_proposal, propose
from warpvis.viewer._picking import probabilities
from warpvis.viewer._sight_marks import answers_html, meant_html
from warpvis.viewer._stage import as_mujoco_stage
from warpvis.viewer._state import Snapshot, ViewerState
from warpvis.viewer._tables import legend_html, table_html
from warpvis.visibility import Agent

if TYPE_CHECKING:
    import mujoco
    from viser import ViserServer

    from warpvis.planning import Proposal

_PORT = 8080

_RATE_OVER = 20
_MAX_DISTANCE, _RADIUS = 2.0, 0.2
_BRAND = (0, 114, 178)

_WIDE = 700
"""On pages narrower than this, the panel is initially closed [px]."""


class Viewer:
    """A live page, served until `close`; `wait` blocks to keep the program running.

    Example:
        >>> viewer = wv.view(scene, agents=[robot, human])
        >>> print(viewer.url)
        >>> viewer.wait()
    """

    def __init__(self, state: ViewerState, *, host: str = "localhost", port: int = _PORT, dark: bool = False) -> None:
        """Serve the page of a state.

        Args:
            state: The state to show.
            host: Address to listen on. By default, only this machine can open the page; ``"0.0.0.0"`` allows all
                machines that can reach this one.
            port: Port to listen on; if it is in use, the next free one.
            dark: Whether the page is dark.

        Raises:
            WarpvisError: If viser is missing.
        """
        if not isinstance(state, ViewerState):
            raise WarpvisError(f"state must be a warpvis.viewer.ViewerState, got {type(state).__name__}")
        dark = check_flag(dark, "dark")
        self.state = state
        self.server = serve(host, port)
        self.page = Page(self.server, state, dark=dark)
        self._closed = threading.Event()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def update(self) -> None:
        """Show changes that the program made to the state, and wait until they are shown."""
        self.page.gizmos.follow()
        self.page.update(wait=True)

    def save_html(self, path: str | os.PathLike[str], *, title: str = "warpvis") -> None:
        """Write the page and its table to one ``.html`` file that a browser opens without a server or a network.

        Raises:
            FileFormatError: If the file cannot be written.
        """
        write_page(self.page, path, title)

    def wait(self) -> None:
        """Wait until the page is closed or Ctrl-C is pressed."""
        while not self._closed.wait(1.0):
            pass

    def close(self) -> None:
        """Stop serving the page."""
        if not self._closed.is_set():
            self._closed.set()
            self.page.close()
            stop(self.server)

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def view(
    scene: Scene | mujoco.MjModel,
    agents: Sequence[Agent] | None = None,
    camera: Camera | None = None,
    *,
    movable: Sequence[str] | None = None,
    objects: Sequence[str] | None = None,
    frames: Frames | None = None,
    host: str = "localhost",
    port: int = _PORT,
    dark: bool = False,
) -> Viewer:
    """Serve a live page of a scene for a browser, where users move agents and objects and see what each agent sees.

    Args:
        scene: The scene; objects move in a copy. For a MuJoCo model, which starts at its first keyframe, the geoms of
            each body form one object, and joints have sliders.
        agents: One or more agents: a robot, then people. By default, a robot with `camera` that sees the whole scene.
        camera: Camera of the default robot; by default `Camera.kinect` with unlimited range.
        movable: As for `ViewerState`, like `objects` and `frames`, which are played with a slider.
        objects: Names of the objects in the table.
        frames: Frames to play.
        host: As for `Viewer`, like `port` and `dark`.
        port: Port to listen on.
        dark: Whether the page is dark.

    Returns:
        The page, which is served until `Viewer.close` or the end of the program.

    Raises:
        WarpvisError: If viser is missing.
    """
    if agents is not None and camera is not None:
        raise WarpvisError("camera must be None if agents are given, since agents have cameras")
    model = as_mujoco_stage(scene)
    if agents is None:
        agents = [framing_agent(scene if model is None else model.stage.scene, camera)]
    state = ViewerState(scene if model is None else model, agents, movable=movable, objects=objects, frames=frames)
    return Viewer(state, host=host, port=port, dark=dark)


def framing_agent(scene: Scene, camera: Camera | None = None) -> Agent:
    """Create a robot that sees the whole scene, with a camera, by default `Camera.kinect` with unlimited range."""
    from warpvis.pose_generators import framing

    require_scene(scene).require_objects()
    if camera is None:
        camera = replace(Camera.kinect(), near=0.0, far=math.inf)
    return Agent("robot", camera, framing(scene, camera))


class Page:
    """All elements of a browser page for one state."""

    def __init__(self, server: ViserServer, state: ViewerState, *, dark: bool = False) -> None:
        """Create the elements and start the thread that updates them."""
        self.server, self.state, self.dark = server, state, dark
        self.snapshot: Snapshot | None = None
        """The snapshot that is shown."""
        self.updates = 0
        """Number of updates since the start."""
        self.proposed: Proposal | None = None
        """Current proposal for the first agent's pose."""
        self._times: deque[float] = deque(maxlen=_RATE_OVER)
        self._update_event, self._updated = threading.Event(), threading.Condition()
        self._requested, self._completed, self._closed = 0, 0, False
        server.gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False, brand_color=_BRAND)
        server.gui.set_panel_label("warpvis")
        self.first_view = self._set_view()
        """The view with which browsers start."""
        self.meshes = Meshes(server.scene, state, dark=dark)
        scale = mark_scale(state.scene)
        self.marks = {
            name: AgentMark(server.scene, state.agents[name], color, scale)
            for name, color in agent_colors(state.agents).items()
        }
        self.cloud = CloudNode(server.scene, state)
        self.sight = SightNode(server.scene, list(state.agents), scale)
        self.proposal = ProposalMark(server.scene, scale)
        self.gizmos = Gizmos(server.scene, state, self.update)
        shown = {"handles": self.gizmos, "meshes": self.meshes, "lines of sight": self.sight}
        fold_on_phones(server.gui)
        self.panel = Panel(server.gui, state, self.update, self.act, shown, self.propose, self.go_there)
        order, attempt = self.panel.legend.order, self.panel.attempt
        self.answers = Answers(server, state.pick, state.pick_along, attempt, order)
        self.answers.pick_behind(self.gizmos.objects.values())
        self.gaze = GazeSliders(server.gui, self._turn_eyes, attempt, order, list(state.agents))
        self.panel.reset.on_click(lambda _: self.gaze.reset())
        self._worker = threading.Thread(target=self._work, name="warpvis viewer", daemon=True)
        self._worker.start()
        self.update(wait=True)

    def update(self, *, wait: bool = False) -> None:
        """Request an update, and optionally wait until it is shown; requests during an update are merged into one."""
        with self._updated:
            self._requested += 1
            request = self._requested
        self._update_event.set()
        if wait:
            with self._updated:
                self._updated.wait_for(lambda: self._completed >= request or self._closed)

    def act(self, change: Callable[[], None]) -> None:
        """Change the state, move the handles accordingly, and update the page."""
        change()
        self.gizmos.follow()
        self.update()

    def propose(self) -> tuple[str, bool]:
        """Show the proposed pose of the first agent; return its description and whether there is a proposal."""
        assert self.snapshot is not None  # set by the constructor
        result = propose(self.state, self.snapshot, max_distance=_MAX_DISTANCE, radius=_RADIUS)
        self.proposed = None if isinstance(result, str) else result
        if isinstance(result, str):
            self.proposal.clear()
            return result, False
        camera = self.snapshot.agents[0].pinhole
        assert camera is not None  # required for a proposal
        self.proposal.show(camera, result.pose)
        return describe_proposal(result), True

    def go_there(self) -> None:
        """Move the first agent to the proposed pose."""
        if self.proposed is not None:
            name, pose = next(iter(self.state.agents)), self.proposed.pose
            self.act(lambda: self.state.move_agent(name, pose))
            self.proposal.clear()
            self.proposed = None

    def _turn_eyes(self, name: str, angles: tuple[float, float] | None) -> None:
        if angles is None:
            self.state.release_eyes(name)
        else:
            self.state.turn_eyes(name, *angles)

    def close(self) -> None:
        """Stop the thread that updates the page."""
        self._closed = True
        self._update_event.set()
        self._worker.join()
        with self._updated:
            self._updated.notify_all()

    def _work(self) -> None:
        while True:
            self._update_event.wait()
            self._update_event.clear()
            if self._closed:
                return
            with self._updated:
                request = self._requested
            try:
                self._show(self.state.snapshot())
            except Exception as error:
                self.panel.show_message(f"{type(error).__name__}: {error}")
            with self._updated:
                self._completed = request
                self._updated.notify_all()

    def _show(self, snapshot: Snapshot) -> None:
        self._times.append(time.perf_counter())
        with self.server.atomic():
            self.meshes.show(snapshot)
            for agent, picture, seen in zip(snapshot.agents, snapshot.pictures, snapshot.views, strict=True):
                has_both = picture.shape[:2] != seen.depth.shape and seen.color is not None
                self.marks[agent.name].show(agent, seen.color if has_both else picture)  # type: ignore[arg-type]
            self.cloud.show(snapshot)
            self.sight.show(snapshot)
            self.panel.show(snapshot, self._rate())
            self.answers.show(snapshot.picked, probabilities(snapshot.meant))
        self.snapshot = snapshot
        self.updates += 1

    def _rate(self) -> float:
        """Return the rate of updates during motion [1/s]; 0 if unknown."""
        recent = [later - earlier for earlier, later in zip(self._times, list(self._times)[1:], strict=False)]
        recent = [step for step in recent if step < 1]
        return len(recent) / sum(recent) if recent else 0.0

    def _set_view(self) -> FirstView:
        """Set the first view, from above and behind the first agent, of all objects and agents."""
        scene, vertical = self.state.scene, check_up(self.state.scene.up)
        up = np.eye(3)[vertical]
        self.server.scene.set_up_direction("+z" if vertical == 2 else "+y")
        eyes = np.array([agent.poses[0, :3] for agent in self.state.agents.values()], dtype=np.float64)
        points = scene_corners(scene, eyes)
        center = (points.min(axis=0) + points.max(axis=0)) / 2
        behind = eyes[0] - center
        behind[vertical] = 0
        behind = behind / np.linalg.norm(behind) if np.linalg.norm(behind) > 1e-6 else np.eye(3)[(vertical + 1) % 3]
        direction = 0.5 * behind + 0.5 * np.cross(up, behind) + 0.65 * up
        view = FirstView(self.server, up, math.radians(50))
        view.show(points, direction)
        return view


def write_page(page: Page, path: str | os.PathLike[str], title: str) -> None:
    """Write the current page to a file, without handles, which have no effect there."""
    check_text(title, "title")
    file = as_path(path)
    assert page.snapshot is not None  # set by the constructor of `Page`
    shown, handle = page.gizmos.visible, page.answers.marks.handle.visible
    page.gizmos.visible = page.answers.marks.handle.visible = False
    try:
        document = page.server.scene.as_html(dark_mode=page.dark)
    finally:
        page.gizmos.visible, page.answers.marks.handle.visible = shown, handle
    if "</body>" not in document or "<head>" not in document:
        raise FileFormatError(f"{file}: the page exported by this version of viser has no <head> or <body>")
    head, _, tail = document.rpartition("</body>")
    document = f"{head}{_panel(page.snapshot, title, page.dark)}</body>{tail}"
    start = f"<head><title>{escape(title)}</title><script>{page.first_view.phone_script()}</script>"
    document = document.replace("<head>", start, 1)
    with writing(file):
        file.write_text(document, encoding="utf-8")


def _panel(snapshot: Snapshot, title: str, dark: bool) -> str:
    """Return the HTML of a collapsible panel with the table and the images, at the page's right border."""
    paper, ink = ("#1b1b1b", "#ddd") if dark else ("#fff", "#111")
    images = "".join(
        f'<figure style="margin:0.6em"><figcaption style="font-size:0.8em">{escape(agent.name)} sees</figcaption>'
        f'<img alt="what {escape(agent.name)} sees" style="width:100%" src="{_data_url(picture)}"></figure>'
        for agent, picture in zip(snapshot.agents, snapshot.pictures, strict=True)
    )
    style = (
        f"position:fixed;top:0.5em;right:0.5em;width:min(20em,85vw);max-height:calc(100vh - 1em);overflow:auto;"
        f"background:{paper};color:{ink};border-radius:0.4em;box-shadow:0 0 0.6em rgba(0,0,0,0.3);z-index:1000;"
        f"font-family:system-ui,sans-serif"
    )
    summary = f'<summary style="padding:0.5em 0.6em;font-weight:600;cursor:pointer">{escape(title)}</summary>'
    names = [agent.name for agent in snapshot.agents]
    table, legend = table_html(snapshot.rows, names), legend_html(names)
    legend += meant_html(probabilities(snapshot.meant))
    if (picked := snapshot.picked) is not None:
        legend += answers_html(picked.title, picked.lines, picked.reasons)
    closing = f"if(innerWidth<{_WIDE})document.getElementById('warpvis').open=false"
    return (
        f'<details id="warpvis" open style="{style}">{summary}{table}{legend}{images}</details>'
        f"<script>{closing}</script>"
    )


def _data_url(picture: NDArray[np.uint8]) -> str:
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(picture).save(data, "PNG", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(data.getvalue()).decode()}"
