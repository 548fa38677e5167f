# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of agents' views of one situation, with objects colored by the agents that see them."""

from __future__ import annotations

import itertools
import math
import os
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import as_point
from warpvis.core.checks import check_text, pluralize, with_article
from warpvis.core.labels import Label
from warpvis.core.poses import QuaternionOrder, check_up, look_at, poses_to_matrices, to_xyzw
from warpvis.core.types import ObjectPoses
from warpvis.maps import floor_map
from warpvis.planning import best_views
from warpvis.pose_generators import fitting_distance
from warpvis.scene import Scene
from warpvis.visibility import Agent, FieldOfView, Perspective, State
from warpvis.viz._drawing import (
    GRAYS,
    OUTSIDE_CAMERA,
    STATE_COLORS,
    AgentView,
    PanelData,
    agent_colors,
    agent_view,
    draw_arrow,
    draw_lines,
    draw_name,
    drawn_label,
    frustum,
    light_on,
    neighbor,
    one_pose,
    shaded_picture,
    to_picture,
    views_of_faces,
    white_edge,
)
from warpvis.viz._figures import Bounds, draw_map, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_Color: TypeAlias = "tuple[float, ...] | str"

_UNSEEN = 0.25

# Priority of states in cells of a map, lowest first.
_MAP_ORDER = (State.NEITHER, State.BOTH, State.FIRST, State.SECOND)

_CELLS = 250
# Agents in a row, width and height of an agent's panels [inches], and relative width of the first column.
_MAX_COLUMNS, _PANEL_SIZE, _FIRST_COLUMN = 3, (13.5 / 3.1, 8.2), 1.1
_MIN_CELL = 0.02
# Maximum numbers of characters in a line.
_LEGEND_WIDTH, _PANEL_WIDTH, _TITLE_WIDTH = 40, 40, 100

_OUTSIDE_AZIMUTHS, _OUTSIDE_HEIGHTS = 12, (0.6, 0.9)
_MARGIN_SHARE = 0.03
# Distance of agents whose names would overlap [px].
_NEAR = 60
# Margins around the drawn content [px]; agents' names need space above it.
_MARGIN, _MARGIN_ABOVE = 12, 45


def save_perspective(
    scene: Scene,
    agents: Sequence[Agent],
    seen: Perspective,
    path: str | os.PathLike[str],
    *,
    view: int = 0,
    title: str = "Who sees what",
    labels: Sequence[Label | int | str] | None = (Label.OBJECT,),
    eye: ArrayLike | None = None,
    target: ArrayLike | None = None,
    proposed: ArrayLike | None = None,
    object_poses: ObjectPoses = None,
    quaternion: QuaternionOrder = "xyzw",
) -> None:
    """Write one picture of agents' views: the scene from outside, each agent's view, and the floor that each sees.

    Objects are colored by the agents that see them, with `STATE_COLORS`; the rest is gray. Of three and more agents,
    colors compare the first one with all others, agents are drawn with `agent_colors`, and the legend lists what each
    of them sees.

    Args:
        scene: The scene.
        agents: Two or more agents, usually a robot and people.
        seen: Result of `perspective` for these agents.
        path: Picture to write.
        view: Index of the situation.
        title: Title of the picture.
        labels: Labels of the colored objects; None for all but the ground. The agents' bodies are never colored.
        eye: Viewpoint of the picture from outside [m], shape ``(3,)``; by default one from which most of the objects
            and agents are visible.
        target: Point at the center of the picture from outside [m]; by default the center of the scene.
        proposed: A proposed pose of the first agent, row ``x y z qx qy qz qw``, to draw on its map.
        object_poses: Poses of the movable objects in the situation, ``(M, 7)``; those of `seen` by default.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
    """
    proposed = to_xyzw(proposed, quaternion, "proposed")
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    figure = draw_perspective(scene, agents, seen, view, title, labels, eye, target, proposed, object_poses)
    save_figure(figure, path)


def draw_perspective(
    scene: Scene,
    agents: Sequence[Agent],
    seen: Perspective,
    view: int,
    title: str,
    labels: Sequence[Label | int | str] | None,
    eye: ArrayLike | None,
    target: ArrayLike | None,
    proposed: ArrayLike | None,
    object_poses: ObjectPoses,
) -> Figure:
    """Draw the figure that `save_perspective` writes."""
    check_text(title, "title")
    if proposed is not None:
        proposed = one_pose(proposed, "proposed")[0]
    data = PanelData.from_perspective(scene, agents, seen, view, labels, object_poses)
    count = len(data.agents)
    columns = min(count, _MAX_COLUMNS)
    rows = math.ceil(count / columns)
    figure = new_figure(_PANEL_SIZE[0] * (_FIRST_COLUMN + columns), _PANEL_SIZE[1] * rows, gap=0.11)
    panels = figure.subplots(
        2 * rows, 1 + columns, width_ratios=(_FIRST_COLUMN, *[1.0] * columns), height_ratios=(0.8, 1.0) * rows
    )
    draw_outside(panels[0, 0], data, eye, target)
    _draw_legend(panels[1, 0], data, proposed is not None)
    for panel in [*panels[2:, 0], *panels[-2:, 1 + columns - (rows * columns - count) :].ravel()]:
        panel.set_axis_off()
    for number, agent in enumerate(data.agents):
        row, column = 2 * (number // columns), 1 + number % columns
        _draw_view(panels[row, column], data, agent)
        floor = _floor_map(data, agent)
        heading = textwrap.fill(f"Floor that {with_article(agent.name)} sees", _PANEL_WIDTH)
        draw_map(panels[row + 1, column], floor.colors, floor.bounds, floor.axes, heading)
        _draw_poses(panels[row + 1, column], data, floor, None if number else proposed)
    figure.suptitle(textwrap.fill(title, _TITLE_WIDTH), fontsize=14, fontweight="bold")
    return figure


def _draw_view(axes: Axes, data: PanelData, agent: Agent) -> None:
    seen = agent_view(data.scene, agent, data.view, object_poses=data.object_poses)
    axes.imshow(_depth_shaded(data, seen), extent=seen.extent)
    if isinstance(agent.camera, FieldOfView):
        axes.set(xlabel="azimuth [degrees]", ylabel="elevation [degrees]")
    else:
        axes.set(xlabel="x [px]", ylabel="y [px]")
    title = f"What {with_article(agent.name)} sees"
    wide = agent.camera if isinstance(agent.camera, FieldOfView) else agent.pinhole
    if wide is not None:
        title += f" ({math.degrees(wide.hfov):.0f} degrees wide)"
    axes.set(title=textwrap.fill(title, _PANEL_WIDTH))
    if len(seen.attention):
        axes.plot(*seen.attention.T, color="black", linewidth=1.0, linestyle="--", label="field of attention")
        axes.legend(loc="upper left", fontsize=8)
    axes.set(xlim=seen.extent[:2], ylim=seen.extent[2:])


def _depth_shaded(data: PanelData, seen: AgentView) -> NDArray[np.float64]:
    """Return an image with objects in the colors of their states, and gray that fades with distance, ``(h, w, 3)``."""
    has_depth = np.isfinite(seen.distance)
    near, far = (seen.distance[has_depth].min(), seen.distance[has_depth].max()) if has_depth.any() else (0.0, 1.0)
    fade = np.clip((np.where(has_depth, seen.distance, far) - near) / max(far - near, 1e-9), 0, 1)
    light = np.nan_to_num(light_on(seen.normals, data.scene.up), nan=1.0)
    gray = (0.30 + 0.55 * fade) * (0.55 + 0.45 * light)
    picture = np.where(has_depth, gray, 1.0)[..., None].repeat(3, axis=-1)
    colored = np.isin(seen.objects, list(data.states))
    picture[colored] = data.colors[seen.objects[colored]] * (0.45 + 0.55 * light[colored])[:, None]
    return picture


class _Floor(NamedTuple):
    """A colored floor map."""

    colors: NDArray[np.float64]
    """RGB colors from 0 to 1, shape ``(rows, columns, 3)``, row 0 at the bottom."""
    bounds: Bounds
    axes: tuple[str, str]
    """Names of the horizontal and the vertical axis."""
    cell_size: float
    """Side of a cell [m]."""


def _floor_map(data: PanelData, agent: Agent) -> _Floor:
    """Return a map of the floor that an agent sees through all its faces."""
    scene, bounds = data.scene, data.bounds
    margin = 0.03 * np.linalg.norm(bounds[1] - bounds[0])
    bounds = bounds + [[-margin], [margin]]
    cell_size = max(_MIN_CELL, float((bounds[1] - bounds[0]).max()) / _CELLS)
    # In a cell, higher numbers take precedence: number states after all labels without one.
    state_ranks = range(len(Label), len(Label) + len(GRAYS) - 1 + len(_MAP_ORDER))
    ranks = [int(Label.EMPTY), int(Label.GROUND), *state_ranks]
    grays = [_UNSEEN, *GRAYS.values()]
    codes = np.array([*(ranks[drawn_label(scene, item.label)] for item in scene), Label.EMPTY], dtype=np.uint8)
    codes[list(data.bodies)] = ranks[Label.HUMAN]
    for index, state in data.states.items():
        codes[index] = ranks[len(grays) + _MAP_ORDER.index(state)]
    cells = []
    for face in views_of_faces(scene, agent, data.view, object_poses=data.object_poses):
        numbers = wp.array(codes[face.segmentation.numpy()], dtype=wp.uint8, device=scene.device)
        seen_floor = floor_map(face.points, numbers, bounds=bounds, cell_size=cell_size, up=scene.up)
        cells.append(seen_floor.cells.numpy())
    palette = np.zeros((ranks[-1] + 1, 3))
    palette[ranks] = [[gray] * 3 for gray in grays] + [np.array(STATE_COLORS[state]) / 255 for state in _MAP_ORDER]
    colors = palette[np.max(cells, axis=0)[0]]
    return _Floor(colors, seen_floor.bounds, seen_floor.axes, seen_floor.cell_size)


def _draw_poses(axes: Axes, data: PanelData, floor_map: _Floor, proposed: ArrayLike | None) -> None:
    """Draw the agents with arrows for their headings on a map, and the proposed pose of the first agent."""
    floor = ["xyz".index(axis) for axis in floor_map.axes]
    left, right, bottom, top = floor_map.bounds
    length = 0.12 * max(right - left, top - bottom)
    places = data.poses[:, :3][:, floor]
    for number, (agent, pose, color) in enumerate(zip(data.agents, data.poses, _colors(data), strict=True)):
        _draw_pose(axes, pose, floor, length, "-", color)
        position, heading = pose[:3][floor], poses_to_matrices(pose)[floor, 2]
        # Write the name away from an agent nearby, or opposite the arrow; near the map's border, toward its center.
        x, y = (position - [left, bottom]) / [right - left, top - bottom]
        above = heading[1] < 0 if abs(heading[1]) > 0.2 and 0.15 < y < 0.85 else y < 0.5
        near = neighbor(places, number, length)
        above = above if near is None else near[1] < 0
        side = "left" if x < 0.15 else "right" if x > 0.85 else "center"
        draw_name(axes, agent.name, position, (0, 9 if above else -9), side, "bottom" if above else "top")
    if proposed is not None:
        proposed_pose = np.asarray(proposed, dtype=np.float64)
        path = np.stack([data.poses[0, :3], proposed_pose[:3]])[:, floor]
        axes.plot(*path.T, color="black", linewidth=1.4, linestyle=":", path_effects=white_edge())
        _draw_pose(axes, proposed_pose, floor, length, "--", "white")
    axes.set(xlim=(left, right), ylim=(bottom, top))


def _colors(data: PanelData) -> list[_Color]:
    """Return the colors with which agents are drawn: black for two, which differ by the colors of what they see."""
    count = len(data.agents)
    return ["black"] * count if count == 2 else [tuple(part / 255 for part in color) for color in agent_colors(count)]


def _draw_pose(
    axes: Axes, pose: NDArray[np.float64], floor: list[int], length: float, linestyle: str, color: _Color
) -> None:
    position, heading = pose[:3][floor], poses_to_matrices(pose)[floor, 2]
    size = np.linalg.norm(heading)
    if size > 1e-6:
        draw_arrow(axes, position, position + length * heading / size, linestyle)
    axes.plot(*position, marker="o", markersize=8, markerfacecolor=color, markeredgecolor="black", zorder=4)


def _draw_legend(axes: Axes, data: PanelData, proposed: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    axes.set_axis_off()
    first, *others = (with_article(agent.name) for agent in data.agents)
    several = len(others) > 1
    state_texts = {
        State.BOTH: f"{first} and others see" if several else "both see",
        State.FIRST: f"only {first} sees",
        State.SECOND: "only others see" if several else f"only {others[0]} sees",
        State.NEITHER: "no agent sees" if several else "neither sees",
    }
    handles: list[Patch | Line2D] = []
    for state, state_text in state_texts.items():
        names = [data.scene.objects[index].name for index, object_state in data.states.items() if object_state == state]
        handles.append(
            Patch(facecolor=np.array(STATE_COLORS[state]) / 255, edgecolor="black", label=_list(state_text, names))
        )
    grays = {
        "seen ground": GRAYS[Label.GROUND],
        "seen obstacle": GRAYS[Label.OBSTACLE],
        "people and robots": GRAYS[Label.HUMAN],
        "not seen (maps)": _UNSEEN,
    }
    handles += [Patch(facecolor=str(gray), edgecolor="black", label=state_text) for state_text, gray in grays.items()]
    style: dict[str, Any] = {"color": "black", "marker": "o", "markersize": 8}
    if several:
        for agent, color, seen in zip(data.agents, _colors(data), data.seen, strict=True):
            label = _list(f"{agent.name} sees", seen)
            handles.append(Line2D([], [], **style, markerfacecolor=color, label=label))
    else:
        handles.append(Line2D([], [], color="black", marker="o", label="position and gaze of an agent"))
    if proposed:
        label = f"proposed pose of {first}"
        handles.append(Line2D([], [], color="black", marker="o", markerfacecolor="white", linestyle="--", label=label))
    axes.legend(handles=handles, loc="upper center", fontsize=12, frameon=False, labelspacing=0.8)


def _list(text: str, names: Sequence[str]) -> str:
    """Return a text with names, or with their number if the line would be too long."""
    line = f"{text}: {', '.join(names) or 'nothing'}"
    if len(line) <= _LEGEND_WIDTH:
        return line
    return textwrap.shorten(f"{text}: {pluralize(len(names), 'object')}", _LEGEND_WIDTH, placeholder=" ...")


def draw_outside(axes: Axes, data: PanelData, eye: ArrayLike | None, target: ArrayLike | None) -> None:
    """Draw the scene, the agents' gazes and the frustums of their cameras or fields of attention."""
    pose = _outside_pose(data, eye, target)
    camera, scene = OUTSIDE_CAMERA, data.scene
    picture = shaded_picture(
        scene, camera, pose, lambda points, objects, labels: data.colors[objects], object_poses=data.object_poses
    )
    axes.imshow(picture)
    reach = 0.17 * float(np.linalg.norm(np.subtract(*data.bounds)))
    rows, columns = np.nonzero((picture < 1).any(axis=2))
    drawn = [np.stack([columns, rows], axis=1).astype(np.float64)]
    starts = to_picture(camera, pose, data.poses[:, :3])
    for k, (agent, agent_pose, color) in enumerate(zip(data.agents, data.poses, _colors(data), strict=True)):
        narrow = agent.attention if isinstance(agent.camera, FieldOfView) else agent.camera
        matrix = poses_to_matrices(agent_pose)
        gaze = matrix[:3, 3] + [[0, 0, 0], 1.25 * reach * matrix[:3, 2]]
        lines = [] if narrow is None else frustum(narrow, agent_pose, reach)
        style: dict[str, Any] = {} if len(data.agents) == 2 else {"color": color, "linewidth": 1.4}
        draw_lines(axes, camera, pose, lines, **style)
        start, end = to_picture(camera, pose, gaze)
        if np.isfinite([start, end]).all():
            draw_arrow(axes, start, end)
        drawn += [to_picture(camera, pose, line) for line in [gaze, *lines]]
        is_left = starts[k, 0] <= np.delete(starts[:, 0], k).mean()
        near = neighbor(starts, k, _NEAR)
        if near is None:
            draw_name(axes, agent.name, starts[k], (-9 if is_left else 9, 9), "right" if is_left else "left")
        else:  # away from an agent nearby; rows of the picture count downwards
            above = near[1] > 0
            draw_name(axes, agent.name, starts[k], (0, 12 if above else -12), "center", "bottom" if above else "top")
    _crop(axes, np.concatenate(drawn), camera)
    axes.set(title="From outside")
    axes.set_axis_off()


def _crop(axes: Axes, drawn: NDArray[np.float64], camera: Camera) -> None:
    """Crop the picture to the positions of drawn content, ``(n, 2)``."""
    size = np.array([camera.width, camera.height])
    inside = drawn[np.isfinite(drawn).all(axis=1) & ((drawn >= 0) & (drawn <= size)).all(axis=1)]
    if len(inside):
        low, high = inside.min(axis=0) - [_MARGIN, _MARGIN_ABOVE], inside.max(axis=0) + _MARGIN
        axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]))


def _outside_pose(data: PanelData, eye: ArrayLike | None, target: ArrayLike | None) -> NDArray[np.float64]:
    """Return the pose of the picture from outside: at `eye`, or one from which most objects of interest are visible."""
    scene = data.scene
    low, high = data.bounds
    center = (low + high) / 2 if target is None else as_point(target, "target")
    if eye is not None:
        return look_at(eye, center, up=scene.up)
    poses, distances = [], []
    for direction in _directions(check_up(scene.up)):
        pose = look_at(center + direction, center, up=scene.up)
        pose[:3] = center + direction * fitting_distance(OUTSIDE_CAMERA, pose, center, low, high, margin=_MARGIN_SHARE)
        poses.append(pose)
        places = to_picture(OUTSIDE_CAMERA, pose, data.poses[:, :3])
        distances.append(min(np.linalg.norm(one - other) for one, other in itertools.combinations(places, 2)))
    interesting = sorted({*data.states, *data.bodies}) or list(range(len(scene)))
    small = Camera.from_fov(160, 120, hfov=OUTSIDE_CAMERA.hfov)
    # Among poses that show about as much, prefer the one with the agents farthest apart in the picture.
    weights = 1 / np.maximum(distances, 1.0)
    order = best_views(
        scene, small, poses, objects=interesting, object_poses=data.object_poses, path_lengths=weights, tie=0.1
    )
    return order.pose()


def _directions(vertical: int) -> list[NDArray[np.float64]]:
    """Return unit vectors from the center of the scene to the candidate viewpoints."""
    found = []
    for height in _OUTSIDE_HEIGHTS:
        for angle in (np.arange(_OUTSIDE_AZIMUTHS) + 0.5) * (2 * math.pi / _OUTSIDE_AZIMUTHS):
            horizontal = math.cos(height)
            # Components along the floor's axes and up; rolled to x, y and z.
            found.append(
                np.roll([horizontal * math.cos(angle), horizontal * math.sin(angle), math.sin(height)], vertical + 1)
            )
    return found
