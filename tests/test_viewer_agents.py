# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The viewer with a robot and several people: states, colors, texts and proposals."""

import numpy as np
import pytest
import trimesh
from color_blindness import nearest_pair
from matplotlib.colors import to_hex

import warpvis as wv
from warpvis.scenes.shapes import floor
from warpvis.viewer import Viewer, ViewerState
from warpvis.viewer._panel import propose
from warpvis.viewer._tables import legend_html, state_text
from warpvis.visibility import Agent, State, perspective
from warpvis.viz import STATE_COLORS, agent_colors, save_perspective

PORT = 8396


def corners():
    """Return four cups in the corners of a cross of walls, and agents in three of them."""
    scene = wv.Scene()
    scene.add(floor(8, 8), name="floor", label="ground")
    for name, size in (("wall x", (6, 0.1, 2)), ("wall y", (0.1, 6, 2))):
        scene.add(trimesh.creation.box(size), name=name, pose=(0, 0, 1, 0, 0, 0, 1))
    places = {"first": (1, 1), "second": (-1, 1), "third": (-1, -1), "fourth": (1, -1)}
    for name, place in places.items():
        scene.add(trimesh.creation.icosphere(radius=0.1), name=name, label="object", pose=(*place, 0.1, 0, 0, 0, 1))
    eyes = {name: wv.look_at((2.5 * x, 2.5 * y, 1.5), (x, y, 0.1)) for name, (x, y) in places.items()}
    robot = Agent("robot", wv.Camera.from_fov(320, 240, hfov=1.2), eyes["first"])
    return scene, [robot, Agent.human("Ada", eyes["second"]), Agent.human("Bo", eyes["third"])]


def test_states_compare_an_agent_with_several_others():
    scene, agents = corners()
    seen = perspective(scene, agents, objects=["first", "second", "third", "fourth"])
    expected = [State.FIRST, State.SECOND, State.SECOND, State.NEITHER]
    assert seen.states("robot", ["Ada", "Bo"])[0].tolist() == expected
    assert seen.states("Ada", ("robot", "Bo"))[0].tolist() == [State.SECOND, State.FIRST, State.SECOND, State.NEITHER]
    assert seen.states("robot", "Ada")[0].tolist() == [State.FIRST, State.SECOND, State.NEITHER, State.NEITHER]
    assert seen.states("robot", ["Ada", "robot"])[0, 0] == State.BOTH
    for wrong in (["Ada", "Cy"], "Cy", 3, [3]):
        with pytest.raises(wv.WarpvisError):
            seen.states("robot", wrong)
    assert [row.count("only") for row in seen.table().splitlines()[2:]] == [2, 2, 2, 0]


def test_three_agents_in_the_viewer():
    scene, agents = corners()
    state = ViewerState(scene, agents, points=4000)
    snapshot = state.snapshot()
    states = {"first": State.FIRST, "second": State.SECOND, "third": State.SECOND, "fourth": State.NEITHER}
    assert {name: snapshot.object_states[name] for name in states} == states
    for name, expected in states.items():
        points = snapshot.states[state.cloud.objects == state.scene.index(name)]
        assert (points & ~np.uint8(expected) == 0).all() and (expected == State.NEITHER or (points == expected).any())
    assert len(snapshot.pictures) == len(snapshot.views) == len(snapshot.rows[0].cells) == 3
    assert {line.agent for line in snapshot.lines} == {"robot", "Ada", "Bo"}
    found = propose(state, snapshot, max_distance=6.0, radius=0.1)
    assert set(found.fractions) == {"second", "third"} and max(found.fractions.values()) > 0.5
    # Bo goes to the robot's corner: only Ada sees something that the robot does not.
    state.move_agent("Bo", agents[0].poses[0])
    assert state.snapshot().object_states["first"] == State.BOTH
    assert set(propose(state, state.snapshot(), max_distance=6.0, radius=0.1).fractions) == {"second"}


def test_page_names_three_agents():
    scene, agents = corners()
    names = [agent.name for agent in agents]
    assert [state_text(item, names) for item in State] == ["nobody", "robot only", "others only", "robot and others"]
    assert [state_text(item, names[:2]) for item in State] == ["neither", "robot only", "Ada only", "both see it"]
    assert "others only" in legend_html(names)
    with Viewer(ViewerState(scene, agents, points=1000), port=PORT) as viewer:
        page = viewer.page
        assert set(page.marks) == set(page.gizmos.agents) == set(page.panel.images) == set(names)
        assert "others only" in page.panel.table.content and "Bo" in page.panel.table.content
        colors = {name: page.sight._colors[name] for name in names}
        assert colors["robot"] == STATE_COLORS[State.FIRST]
        assert len({*colors.values(), *STATE_COLORS.values()}) == 6  # orange is what only others see
        for name, mark in page.marks.items():
            assert mark._frustum.color == colors[name]
            assert "solid rgb({},{},{})".format(*colors[name]) in page.panel.table.content


@pytest.mark.parametrize(("side", "scale"), [(0.6, 0.2 * 3**0.5), (8, 1)])
def test_frusta_and_handles_are_smaller_in_small_scenes(side, scale):
    scene = wv.Scene()
    scene.add(trimesh.creation.box((side, side, side)), name="box", label="object")
    eyes = wv.look_at((2 * side, 0, 0), (0, 0, 0))
    agents = [Agent("robot", wv.Camera.kinect(), eyes), Agent.human("Ada", eyes)]
    with Viewer(ViewerState(scene, agents, points=100), port=PORT) as viewer:
        marks, gizmos = viewer.page.marks, viewer.page.gizmos
        assert [mark._frustum.scale for mark in marks.values()] == pytest.approx([0.28 * scale] * 2)
        assert [gizmo.scale for gizmo in gizmos.agents.values()] == pytest.approx([0.4 * scale] * 2)
        assert gizmos.objects["box"].scale == pytest.approx(scale * (0.45 if side < 1 else 0.6))


@pytest.mark.parametrize("count", range(1, 7))
def test_colors_of_agents_are_distinct(count):
    colors = agent_colors(count)
    assert len(colors) == count and len(set(colors)) == min(count, 4)
    if count > 2:
        shown = {
            **{state.name: color for state, color in STATE_COLORS.items() if state != State.FIRST},
            "page": "white",
        }
        assert nearest_pair({**shown, **{str(k): color for k, color in enumerate(colors[:4])}}) > (20.0,)
    else:
        assert colors == [STATE_COLORS[State.FIRST], STATE_COLORS[State.SECOND]][:count]


def test_picture_of_three_agents(tmp_path, monkeypatch):
    """Each agent has its panels, a frustum and markers in its color, and a line of the legend with what it sees."""
    scene, agents = corners()
    figures = []
    monkeypatch.setattr("warpvis.viz._perspective.save_figure", lambda figure, path: figures.append(figure))
    save_perspective(scene, agents, perspective(scene, agents), tmp_path / "three.png")
    (figure,) = figures
    outside, *_ = panels = figure.axes
    titles = [panel.get_title() for panel in panels]
    for name, article in (("robot", "the "), ("Ada", ""), ("Bo", "")):
        assert any(title.startswith(f"What {article}{name} sees") for title in titles)
        assert f"Floor that {article}{name} sees" in titles
    legend = next(panel.get_legend() for panel in panels if "robot sees: first" in str(_texts(panel.get_legend())))
    assert {"robot sees: first", "Ada sees: second", "Bo sees: third"} <= set(_texts(legend))
    assert {"only others see: second, third", "no agent sees: fourth"} <= set(_texts(legend))
    lines = {to_hex(line.get_color()) for line in outside.lines}
    assert lines == {to_hex(np.array(color) / 255) for color in agent_colors(3)}
    floor = panels[titles.index("Floor that Bo sees")]
    markers = {to_hex(line.get_markerfacecolor()) for line in floor.lines if line.get_marker() == "o"}
    assert markers == lines
    assert {text.get_text() for text in floor.texts} >= {"robot", "Ada", "Bo"}


def test_names_of_close_agents_are_apart(tmp_path, monkeypatch):
    """Five agents have two rows of panels; the names of two of them, half a meter apart, do not overlap."""
    scene, agents = corners()
    agents += [
        Agent.human(name, wv.look_at((x, y, 1.5), (1, -1, 0.1))) for name, x, y in (("Cy", 2, -2), ("Di", 2.3, -2.5))
    ]
    figures = []
    monkeypatch.setattr("warpvis.viz._perspective.save_figure", lambda figure, path: figures.append(figure))
    save_perspective(scene, agents, perspective(scene, agents), tmp_path / "five.png")
    (figure,) = figures
    figure.canvas.draw()
    for panel in figure.axes:
        boxes = {text.get_text(): text.get_window_extent() for text in panel.texts if text.get_text() in ("Cy", "Di")}
        if boxes:
            assert not boxes["Cy"].overlaps(boxes["Di"]), panel.get_title()
    assert sum(panel.get_title().startswith("Floor that") for panel in figure.axes) == 5


def _texts(legend):
    return [] if legend is None else [text.get_text() for text in legend.get_texts()]
