# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The viewer with a robot and several people: states, colors, texts and proposals."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.scenes.shapes import floor
from warpvis.viewer import Viewer, ViewerState
from warpvis.viewer._panel import propose
from warpvis.viewer._pictures import legend_html, state_text
from warpvis.visibility import Agent, State, perspective
from warpvis.viz import STATE_COLORS

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
        assert colors["Ada"] == colors["Bo"] == STATE_COLORS[State.SECOND]
