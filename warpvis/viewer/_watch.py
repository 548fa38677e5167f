# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The live page of a depth camera: the map that grows, unknown space, people, and the table of who sees what."""

from __future__ import annotations

import math
import threading
import time
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import check_flag, check_number, format_percent
from warpvis.core.labels import Visibility
from warpvis.errors import WarpvisError
from warpvis.maps import label_colors
from warpvis.viewer._first_view import FirstView, fold_on_phones, spread, without_outliers
from warpvis.viewer._nodes import AgentMark, agent_colors
from warpvis.viewer._page_parts import CELL, STYLE, serve, stop
from warpvis.viewer._sight_marks import SIGHT_COLORS, dot
from warpvis.viewer._watch_answers import WatchAnswers
from warpvis.visibility import DepthWatcher, Sight, Watched, map_points
from warpvis.viz import depth_colors

_WORDS = {
    Visibility.VISIBLE: "seen",
    Visibility.OCCLUDED: "hidden",
    Visibility.UNKNOWN: "unknown",
    Visibility.OUT_OF_VIEW: "out of view",
}
_LINES = (Visibility.VISIBLE, Visibility.OCCLUDED, Visibility.UNKNOWN)

# Points sent at a time; height up to which the map is shown [m]; time between two updates of the map [s].
_MAX_POINTS, _MAX_HEIGHT, _MAP_INTERVAL = 80_000, 2.2, 1.0

# Sizes of points relative to voxels: free space shows between those of unknown space.
_SURFACE_SIZE, _UNKNOWN_SIZE = 0.95, 0.3

# Which border of unknown space is shown, and the distance from a line of sight up to which it is near [m].
_UNKNOWN_CHOICES, _NEAR_LINE = ("near lines of sight", "all", "none"), 0.2

Floats = NDArray[np.float64]

_WIDTH, _MAX_SPEED = 320, 4.0


class WatchPage:
    """A page that shows what a `DepthWatcher` reports, served until `close`."""

    def __init__(
        self,
        watcher: DepthWatcher,
        *,
        host: str = "localhost",
        port: int = 8080,
        dark: bool = False,
        speed: float = 1.0,
    ) -> None:
        """Serve an empty page, which `show` fills.

        Args:
            watcher: The watcher whose results are shown.
            host: As for `Viewer`, like `port` and `dark`.
            port: Port to listen on; if it is in use, the next free one.
            dark: Whether the page is dark.
            speed: Initial position of the slider for the speed of a recording, from 0 to 4; 0 is as fast as possible.

        Raises:
            WarpvisError: If viser is missing.
        """
        if not isinstance(watcher, DepthWatcher):
            raise WarpvisError(f"watcher must be a warpvis.visibility.DepthWatcher, got {type(watcher).__name__}")
        self._watcher = watcher
        self._initial_speed = check_number(speed, "speed", minimum=0.0, maximum=_MAX_SPEED)
        dark = check_flag(dark, "dark")
        self.server = serve(host, port)
        self.server.gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False)
        self.server.gui.set_panel_label("warpvis")
        self.server.scene.set_up_direction("+z")
        self._marks: dict[str, AgentMark] = {}
        self._clouds: dict[str, Any] = {}
        self._nodes: dict[str, Any] = {}
        self._map_time = -math.inf
        self._view, self._framed = FirstView(self.server, np.eye(3)[2], math.radians(60)), False
        self._closed = threading.Event()
        self.frames = 0
        """Number of frames shown."""
        self._add_panel()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def wait_for(self, due: float, step: float) -> float:
        """Wait until a frame is due, and while the user pauses the recording.

        Args:
            due: When the last frame was due, in the time of `time.perf_counter` [s].
            step: Time between the two frames in the recording [s].

        Returns:
            When this frame was due, or now if that is later: delays do not accumulate.
        """
        while self._pause.value and not self._closed.wait(0.05):
            due = time.perf_counter()
        speed = float(self._speed.value)
        due += step / speed if speed > 0 else 0.0
        now = time.perf_counter()
        if speed > 0 and due > now:
            self._closed.wait(due - now)
            return due
        return now

    def show(self, watched: Watched, progress: str = "") -> None:
        """Show a result of the watcher, and the map at most once a second."""
        with self.answers.lock, self.server.atomic():
            self._show_judged(watched)
            self.answers.show(watched)
            self._images["depth"].image = _depth_picture(watched.depth)
            self._images["labels"].image = label_colors()[_smaller(watched.labels)]
            if time.perf_counter() - self._map_time > _MAP_INTERVAL:
                self._show_map(watched)
                self._map_time = time.perf_counter()
        self.frames += 1
        self._status.content = f'<div style="{STYLE};opacity:0.7" class="warpvis-status">{escape(progress)}</div>'

    def _show_judged(self, watched: Watched) -> None:
        """Show what depends on people's eyes."""
        self._show_agents(watched)
        self._show_sights(watched)
        self._table.content = table_html(watched)

    def say(self, text: str) -> None:
        """Show a message at the top, or hide it if it is empty."""
        self._message.content, self._message.visible = text, bool(text)

    def wait(self) -> None:
        """Wait until the page is closed or Ctrl-C is pressed."""
        while not self._closed.wait(1.0):
            pass

    def close(self) -> None:
        """Stop serving the page."""
        if not self._closed.is_set():
            self._closed.set()
            stop(self.server)

    def __enter__(self) -> WatchPage:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _add_panel(self) -> None:
        gui = self.server.gui
        fold_on_phones(gui)
        self._message = gui.add_markdown("", visible=False)
        self._table, self._legend = gui.add_html(""), gui.add_html(_legend_html())
        self.answers = WatchAnswers(self.server, self._watcher, self._show_judged, self.say, self._legend.order)
        blank = np.full((3, 4, 3), 128, dtype=np.uint8)
        self._images = {
            "depth": gui.add_image(blank, label="depth", jpeg_quality=85),
            "labels": gui.add_image(blank, label="labels", format="png"),
            "floor": gui.add_image(blank, label="floor map", format="png"),
        }
        self._pause = gui.add_checkbox("pause", False)
        self._speed = gui.add_slider("speed", min=0.0, max=_MAX_SPEED, step=0.1, initial_value=self._initial_speed)
        with gui.add_folder("Show", expand_by_default=False):
            self._shown = gui.add_dropdown("unknown space", list(_UNKNOWN_CHOICES), initial_value=_UNKNOWN_CHOICES[0])
            surfaces = gui.add_checkbox("surfaces", True)
        for name in ("surface", "unknown"):
            self._add_cloud(name)

        @surfaces.on_update
        def _(_: object) -> None:
            self._clouds["surface"].visible = surfaces.value

        self._status = gui.add_html("")

    def _add_cloud(self, name: str) -> None:
        size = _SURFACE_SIZE if name == "surface" else _UNKNOWN_SIZE
        none = np.zeros((0, 3), dtype=np.float32)
        self._clouds[name] = self.server.scene.add_point_cloud(
            f"/map/{name}", none, (0, 0, 0), point_size=size * self._watcher.cell_size, precision="float32"
        )

    def _show_agents(self, watched: Watched) -> None:
        agents = [watched.robot, *watched.people]
        colors = agent_colors([agent.name for agent in agents])
        for agent in agents:
            if agent.name not in self._marks:
                self._marks[agent.name] = AgentMark(self.server.scene, agent, colors[agent.name])
            mark = self._marks[agent.name]
            mark.show(agent, _depth_picture(watched.depth) if agent is watched.robot else _NOTHING)
        present = {agent.name for agent in agents}
        for name, mark in self._marks.items():
            mark.frame.visible = name in present

    def _show_sights(self, watched: Watched) -> None:
        segments, colors = [], []
        for agent in (watched.robot, *watched.people):
            eye = agent.poses[0, :3]
            for name, sight in watched.sights[agent.name].items():
                if sight.status not in _LINES:
                    continue
                target = watched.places[name][:3]
                stop = eye if sight.stop is None else np.array(sight.stop)
                segments += [(eye, stop), (stop, target)]
                colors += [[SIGHT_COLORS[kind]] * 2 for kind in (Visibility.VISIBLE, sight.status)]
        self._replace("sights", segments, colors)
        for name, place in watched.places.items():
            path = f"/places/{name}"
            if path not in self._nodes:
                radius = max(place[3] / 2, 0.02)
                self._nodes[path] = self.server.scene.add_icosphere(
                    path, radius, (239, 87, 0), position=place[:3], opacity=0.6, cast_shadow=False
                )
                self.server.scene.add_label(f"{path}/name", name, position=(0, 0, radius + 0.03))

    def _replace(self, name: str, segments: list[Any], colors: list[Any]) -> None:
        """Replace a node of line segments."""
        old = self._nodes.pop(name, None)
        if old is not None:
            old.remove()
        if segments:
            points = np.array(segments, dtype=np.float32)
            self._nodes[name] = self.server.scene.add_line_segments(
                f"/{name}", points, np.array(colors, dtype=np.uint8), thickness=0.012
            )

    def _show_map(self, watched: Watched) -> None:
        voxels = self._watcher.voxel_map()
        points = map_points(voxels, max_height=_MAX_HEIGHT, max_points=_MAX_POINTS)
        heights = depth_colors(points.surface[None, :, 2], (-0.1, _MAX_HEIGHT))[0]
        border = points.unknown[self._is_shown(points.unknown, watched)]
        unknown = np.broadcast_to(np.array(SIGHT_COLORS[Visibility.UNKNOWN], dtype=np.uint8), border.shape)
        for name, cloud, colors in (("surface", points.surface, heights), ("unknown", border, unknown)):
            node = self._clouds[name]
            node.points = cloud
            if len(cloud):  # browsers report an error for an empty array of colors
                node.colors = np.ascontiguousarray(colors)
        self._frame(watched, points.surface)
        self.answers.shown = np.concatenate([node.points for node in self._clouds.values() if node.visible])
        self._images["floor"].image = _fit(_crop(voxels.floor_map().rgb()[0, ::-1]))

    def _is_shown(self, points: NDArray[np.float32], watched: Watched) -> NDArray[np.bool_]:
        """Return which points of the border of unknown space are shown, by default near people's lines of sight."""
        if self._shown.value != _UNKNOWN_CHOICES[0]:
            return np.full(len(points), self._shown.value == _UNKNOWN_CHOICES[1])
        shown = np.zeros(len(points), dtype=bool)
        for person in watched.people:
            for name, sight in watched.sights[person.name].items():
                if sight.unknown > 0:
                    shown |= _distance_to_line(points, person.poses[0, :3], watched.places[name][:3]) < _NEAR_LINE
        return shown

    def _frame(self, watched: Watched, surface: NDArray[np.float32]) -> None:
        """Set what the first view shows: the map, agents and places, from above and behind the camera."""
        measured = watched.points[np.isfinite(watched.points).all(axis=-1)]
        eyes = np.array([agent.poses[0, :3] for agent in (watched.robot, *watched.people)])
        places = np.array([place[:3] for place in watched.places.values()]).reshape(-1, 3)
        points = np.concatenate([without_outliers(surface if len(surface) else measured), spread(eyes), places])
        if self._framed:
            self._view.extend(points)
            return
        self._framed = True
        back = eyes[0] - points.mean(axis=0)
        back[2] = 0
        self._view.show(points, 1.9 * back + (0, 0, 0.6 * max(float(np.linalg.norm(back)), 0.5) + 0.8))


def _distance_to_line(points: NDArray[np.float32], start: NDArray[np.float64], end: NDArray[np.float64]) -> Floats:
    """Return the distances of points from a line segment [m]."""
    offset = end - start
    along = np.clip((points - start) @ offset / max(float(offset @ offset), 1e-12), 0.0, 1.0)
    return np.linalg.norm(points - (start + along[:, None] * offset), axis=1)


def _crop(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the part of a map that is not black."""
    known = picture.any(axis=-1)
    if not known.any():
        return picture
    rows, columns = np.nonzero(known)
    return picture[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]


def _fit(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture of about `_WIDTH` columns, without interpolation."""
    factor = max(1, _WIDTH // picture.shape[1])
    return _smaller(picture.repeat(factor, axis=0).repeat(factor, axis=1))


_NOTHING = np.zeros((1, 1, 3), dtype=np.uint8)


def _smaller(image: NDArray[Any]) -> NDArray[Any]:
    """Return an image of at most `_WIDTH` columns."""
    step = math.ceil(image.shape[1] / _WIDTH)
    return np.ascontiguousarray(image[::step, ::step])


def _depth_picture(depth: NDArray[np.float32]) -> NDArray[np.uint8]:
    image = _smaller(depth)
    with np.errstate(invalid="ignore"):
        image = np.where(image > 0, image, np.nan)
    known = image[np.isfinite(image)]
    low, high = np.percentile(known, (2, 98)) if len(known) else (0.0, 1.0)
    return depth_colors(image[None], (float(low), float(max(high, low + 0.1))))[0]


def sight_text(sight: Sight) -> str:
    """Return a cell of the table: the fraction of the lines of sight that have the status, whose color is its dot."""
    share = {
        Visibility.VISIBLE: sight.visible,
        Visibility.OCCLUDED: sight.hidden,
        Visibility.UNKNOWN: sight.unknown,
    }.get(sight.status)
    return "out of view" if share is None else format_percent(share)


def table_html(watched: Watched) -> str:
    """Return the table: a row per place, a column per agent."""
    names = list(watched.sights)
    head = "".join(f'<th style="text-align:left;padding-right:0.5em">{escape(word)}</th>' for word in ["", *names])
    rows = ""
    for place in watched.places:
        cells = "".join(_cell(watched.sights[name][place]) for name in names)
        rows += f'<tr><td style="{CELL};white-space:nowrap">{escape(place)}</td>{cells}</tr>'
    return (
        f'<div style="{STYLE};max-height:17em;overflow:auto"><table class="warpvis-table" '
        f'style="border-collapse:collapse;width:100%"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'
    )


def _cell(sight: Sight) -> str:
    length = "" if math.isnan(sight.unknown_length) else f", {sight.unknown_length:.2f} m of unmeasured space"
    title = f"{_WORDS.get(sight.status, 'out of view')}{length}"
    return f'<td style="{CELL}" title="{title}">{dot(sight.status)}{escape(sight_text(sight))}</td>'


def _legend_html() -> str:
    items = "".join(
        f'<span style="white-space:nowrap;margin-right:0.9em">{dot(kind)}{word}</span>' for kind, word in _WORDS.items()
    )
    return f'<div style="{STYLE}">{items}</div>'
