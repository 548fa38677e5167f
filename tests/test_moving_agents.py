# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sequences of three moving agents in one call, and agents whose own bodies hide things from them."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Visibility
from warpvis.visibility import Agent, State, perspective

IDENTITY = (0, 0, 0, 1)
FRAMES = 12
ARRAYS = ("fraction", "status", "visible_pixels", "silhouette_pixels", "occluder", "attended", "gaze_angle")
BOARD = (0.001, 0.4, 0.4)


def street(device="cpu"):
    """Return a board that a robot looks at while two people, boxes, pass in between; and poses of FRAMES frames."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box(BOARD), name="board", label="object", pose=(4, 0, 1, *IDENTITY))
    scene.add(trimesh.creation.box((0.2, 0.5, 1.7)), name="Ada's body", label="human", movable=True)
    scene.add(trimesh.creation.box((0.2, 0.5, 1.7)), name="Bo's body", label="human", movable=True)
    steps = np.linspace(-1.5, 1.5, FRAMES)
    height = np.full(FRAMES, 0.85)
    ada = np.stack([np.full(FRAMES, 1.0), steps, height], axis=1)
    bo = np.stack([np.full(FRAMES, 2.0), -0.9 - steps, height], axis=1)  # passes earlier, in the other direction
    bodies = np.concatenate([np.stack([ada, bo], axis=1), np.tile(IDENTITY, (FRAMES, 2, 1))], axis=2)
    eyes = [np.stack([wv.look_at((*place[:2], 1.6), (4, 0, 1)) for place in places]) for places in (ada, bo)]
    agents = [
        Agent.kinect("robot", wv.look_at((0, 0, 1), (4, 0, 1))),
        Agent.human("Ada", eyes[0], body="Ada's body"),
        Agent.human("Bo", eyes[1], body="Bo's body"),
    ]
    return scene, agents, bodies


def at_frame(agents, frame):
    return [replace(agent, pose=agent.poses[min(frame, len(agent.poses) - 1)]) for agent in agents]


def test_sequence_of_three_agents_equals_single_calls(device):
    scene, agents, bodies = street(device)
    seen = perspective(scene, agents, object_poses=bodies)
    assert len(seen) == FRAMES and seen.status.shape == (3, FRAMES, 3)
    for frame, now in enumerate(seen):
        alone = perspective(scene, at_frame(agents, frame), object_poses=bodies[frame][None])
        for name in ARRAYS:
            assert np.array_equal(getattr(now, name), getattr(alone, name)), (frame, name)
        assert now.candidates("Ada", "robot") == alone.candidates("Ada", "robot")
        assert now.candidates("Ada", "robot") == seen.candidates("Ada", "robot", view=frame)
        assert np.array_equal(now.objects_at(0), alone.objects_at(0))
        assert now.table() == alone.table() and now.report() == alone.report()
    part = seen[3:7]
    assert len(part) == 4 and np.array_equal(part.status, seen.status[:, 3:7])
    assert part.candidates("Bo", view=1) == seen.candidates("Bo", view=4)
    assert np.array_equal(seen[-1].status, seen.status[:, -1:])


def test_bodies_of_others_hide_what_geometry_says():
    """The board's visible fraction for the robot, from the intersection of the bodies' shadows in its plane."""
    scene, agents, bodies = street()
    seen = perspective(scene, agents, object_poses=bodies, objects=["board"])
    line = np.linspace(-0.2, 0.2, 40001)  # the bodies reach above and below the board
    for frame in range(FRAMES):
        hidden = np.zeros(len(line), dtype=bool)
        for x, y in bodies[frame, :, :2]:
            shadow = [
                side * (4 - 0.0005) / distance for side in (y - 0.25, y + 0.25) for distance in (x - 0.1, x + 0.1)
            ]
            hidden |= (line > min(shadow)) & (line < max(shadow))
        assert seen.fraction[0, frame, 0] == pytest.approx(1 - hidden.mean(), abs=0.02)
    assert 0 in seen.fraction[0] and 1 in seen.fraction[0]
    states = seen.states("robot", "Bo")[:, 0]
    assert set(states.tolist()) == {State.SECOND, State.BOTH}  # Bo stands in front of Ada
    assert {scene.objects[index].name for index in seen.occluder[0, :, 0] if index >= 0} == {"Ada's body", "Bo's body"}


def test_one_agent_may_stand_still_and_objects_may_move():
    scene, agents, bodies = street()
    still = perspective(scene, agents, object_poses=bodies)
    repeated = [Agent.kinect("robot", np.tile(agents[0].poses, (FRAMES, 1))), *agents[1:]]
    assert np.array_equal(perspective(scene, repeated, object_poses=bodies).visible_pixels, still.visible_pixels)


@pytest.mark.parametrize("view", [FRAMES, -FRAMES - 1, 0.5, "1", True])
def test_invalid_index_is_rejected(view):
    scene, agents, bodies = street()
    seen = perspective(scene, agents, object_poses=bodies, objects=["board"])
    with pytest.raises(wv.WarpvisError, match="a Perspective must be indexed by a slice or a number below 12, got"):
        seen[view]


def robot_with_arm(device="cpu"):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.3, 0.3, 0.3)), name="camera head", label="robot")
    scene.add(trimesh.creation.box((0.001, 0.1, 0.4)), name="arm", label="robot", pose=(1, 0.05, 0, *IDENTITY))
    scene.add(trimesh.creation.box(BOARD), name="board", label="object", pose=(2, 0, 0, *IDENTITY))
    scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="cup", label="object", pose=(3, 0.15, 0, *IDENTITY))
    return scene


def test_own_body_hides_things_except_for_the_head(device):
    scene, eyes = robot_with_arm(device), wv.look_at((0, 0, 0), (2, 0, 0))
    parts = ("camera head", "arm")
    seen = perspective(
        scene,
        [
            Agent.kinect("with arm", eyes, body=parts, head="camera head"),
            Agent.kinect("without", eyes, body=parts),
            Agent.human("person", wv.look_at((0, 2, 0), (2, 0, 0))),
        ],
    )
    board = seen.objects.index("board")
    # The arm is 0.1 m wide from the axis: its shadow on the board, at twice the distance, is 0.2 m of 0.4 m.
    assert seen.fraction[0, 0, board] == pytest.approx(1 - 0.2 / 0.4, abs=0.01)
    assert seen.fraction[1, 0, board] == 1
    cup = seen.objects.index("cup")
    assert seen.status[0, 0, cup] == seen.status[1, 0, cup] == Visibility.OCCLUDED
    assert seen.scene_objects[seen.occluder[0, 0, board]] == "arm"
    cells = {name: [seen.cell(a, 0, k) for a in (0, 1)] for k, name in enumerate(seen.objects)}
    assert cells["camera head"] == ["own body", "own body"]
    assert cells["arm"] == ["1.00", "own body"]
    assert seen.body[:2].tolist() == [[True, True, False, False]] * 2
    assert {item.object for item in seen.candidates("with arm", labels=None)} == {"board"}
    assert seen.visible[2, 0, :2].all()


def test_moving_arm_hides_what_geometry_says():
    """An arm sweeps past a robot's camera; the board's visible fraction follows from the arm's shadow on it."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((0.001, 0.1, 0.4)), name="arm", label="robot", movable=True)
    scene.add(trimesh.creation.box(BOARD), name="board", label="object", pose=(2, 0, 0, *IDENTITY))
    offsets = np.linspace(-0.2, 0.2, 9)
    poses = np.array([[(1, y, 0, *IDENTITY)] for y in offsets])
    robot = Agent.kinect("robot", wv.look_at((0, 0, 0), (2, 0, 0)), body="arm", head=())
    seen = perspective(scene, robot, object_poses=poses, objects=["board"])
    front, back = (2 - 0.0005) / (1 + 0.0005), (2 - 0.0005) / (1 - 0.0005)
    for frame, y in enumerate(offsets):
        edges = [scale * (y + side) for scale in (front, back) for side in (-0.05, 0.05)]
        covered = max(0.0, min(0.2, max(edges)) - max(-0.2, min(edges)))
        assert seen.fraction[0, frame, 0] == pytest.approx(1 - covered / 0.4, abs=0.02)
    assert seen.fraction.min() == pytest.approx(0.5, abs=0.02) and seen.fraction.max() == 1


def test_head_must_be_part_of_the_body():
    with pytest.raises(wv.WarpvisError) as error:
        Agent.kinect("robot", wv.look_at((0, 0, 0), (1, 0, 0)), body="arm", head="neck")
    assert str(error.value) == "head of 'robot' must be names of objects of its body, ('arm',), got 'neck'"
    nothing = Agent.human("me", wv.look_at((0, 0, 0), (1, 0, 0)), body="arm", head=())
    assert nothing.excluded == () and nothing.body == ("arm",)
