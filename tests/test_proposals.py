# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Proposed robot poses that show objects only the person sees: they are free, and the objects are visible."""

import json

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import scenes
from warpvis.planning import propose_view, standing_room
from warpvis.visibility import Agent, perspective


def ask(scene, robot, human, **options):
    found = perspective(scene, (robot, human)).candidates("human", "robot")
    return propose_view(scene, robot, found, **options)


def second_experiment():
    experiment = scenes.EXPERIMENTS[1]
    return experiment.build(), *experiment.agents()


def test_proposed_pose_is_free_and_shows_the_ball():
    scene, robot, human = second_experiment()
    proposal = ask(scene, robot, human)
    assert proposal.pose[2] == pytest.approx(0.7)
    way = np.linalg.norm(proposal.pose[:2] - robot.poses[0, :2])
    assert proposal.distance == pytest.approx(way, abs=1e-6)
    assert 0 < way <= 2
    assert standing_room(scene, proposal.pose, radius=0.2, exclude=["robot"]).all()
    seen = wv.object_visibility(scene, robot.camera, proposal.pose, objects=["ball"], exclude=["robot"])
    assert proposal.fractions == {"ball": pytest.approx(seen.fraction.numpy()[0, 0], abs=1e-6)}
    assert proposal.fractions["ball"] > 0.9
    pixels = robot.camera.project(
        np.linalg.inv(wv.core.poses.poses_to_matrices(proposal.pose))[:3] @ [0.5, 0.6, 0.1, 1]
    )
    np.testing.assert_allclose(pixels, (160, 120), atol=0.01)
    assert json.loads(json.dumps(proposal.report())) == proposal.report()


@pytest.mark.slow
def test_proposed_pose_is_nearest_of_equal_visibility():
    """Compare the visible fraction of the ball at all positions of a finer grid."""
    scene, robot, human = second_experiment()
    proposal = ask(scene, robot, human, step=0.05)
    places = wv.planning.pose_grid(robot.poses[0, :3], radius=2, step=0.05, height=0.7, look_at=(0.5, 0.6, 0.1))
    places = places[standing_room(scene, places, radius=0.2, exclude=["robot"])]
    seen = wv.object_visibility(scene, robot.camera, places, objects=["ball"], exclude=["robot"]).fraction.numpy()[:, 0]
    ways = np.linalg.norm(places[:, :2] - robot.poses[0, :2], axis=1)
    assert seen.max() - proposal.fractions["ball"] < 0.05
    assert (seen[ways < proposal.distance - 1e-6] < proposal.fractions["ball"]).all()


@pytest.mark.parametrize("number", [1, 3, 4])
def test_no_proposal_if_nothing_is_missed(number):
    experiment = scenes.EXPERIMENTS[number - 1]
    assert ask(experiment.build(), *experiment.agents()) is None


@pytest.mark.parametrize("options", [{"max_distance": 0.0}, {"max_distance": 0.3}, {"radius": 5.0}])
def test_no_proposal_if_no_pose_helps(options):
    assert ask(*second_experiment(), **options) is None


def test_proposal_prefers_most_likely_object():
    """Two balls are behind separate walls: the proposal shows the one that the person looks at."""
    scene = wv.Scene()
    for name, y in (("left", 1.5), ("right", -1.5)):
        scene.add(trimesh.creation.box((0.1, 1.2, 1.2)), name=f"{name} wall", pose=(1, y, 0.6, 0, 0, 0, 1))
        scene.add(trimesh.creation.icosphere(3, radius=0.1), name=name, label="object", pose=(1.5, y, 0.1, 0, 0, 0, 1))
    robot = Agent.kinect("robot", wv.look_at((-1, 0, 0.7), (1, 0, 0.7)))
    for name, y in (("left", 1.5), ("right", -1.5)):
        human = Agent.human("human", wv.look_at((3, 0, 1.6), (1.5, y, 0.1)))
        proposal = ask(scene, robot, human, max_distance=3.0, step=0.25)
        assert set(proposal.fractions) == {"left", "right"}
        assert max(proposal.fractions, key=proposal.fractions.get) == name
        assert proposal.fractions[name] > 0.5


def moving_scene(places=None):
    """Return experiment 2 with a movable ball and a movable robot-sized box, both far away or at `places`."""
    experiment, scene = scenes.EXPERIMENTS[1].build(), wv.Scene()
    movable = {"ball": (0, 0, 0), "crate": (-3, -3, 0.25)}
    movable = movable if places is None else dict(zip(movable, places, strict=True))
    for item in experiment:
        if item.name != "ball":
            scene.add((item.vertices, item.faces), name=item.name, label=item.label)
    middle = experiment["ball"].bounds.mean(axis=0)
    ball = (experiment["ball"].vertices - middle, experiment["ball"].faces)
    options = {"movable": True}
    scene.add(ball, name="ball", label="object", pose=(*movable["ball"], 0, 0, 0, 1), **options)
    scene.add(trimesh.creation.box((0.5, 0.5, 0.5)), name="crate", pose=(*movable["crate"], 0, 0, 0, 1), **options)
    return scene


@pytest.mark.slow
def test_proposal_uses_object_poses_of_perspective():
    """In the first world the ball is as in experiment 2; in the second a crate also blocks the first proposal."""
    _, robot, human = second_experiment()
    ball = tuple(map(float, scenes.EXPERIMENTS[1].build()["ball"].bounds.mean(axis=0)))
    away = (-3.0, -3.0, 0.25)
    first = ask(moving_scene([ball, away]), robot, human)
    crate = (float(first.pose[0]), float(first.pose[1]), 0.25)
    second = ask(moving_scene([ball, crate]), robot, human)
    assert np.abs(first.pose[:2] - second.pose[:2]).max() > 0.2

    scene = moving_scene()
    worlds = np.zeros((2, 2, 7))
    worlds[..., 6] = 1
    worlds[:, 0, :3], worlds[:, 1, :3] = ball, [away, crate]
    seen = perspective(scene, (robot, human), object_poses=worlds)
    for view, expected in enumerate((first, second)):
        found = seen.candidates("human", "robot", view=view)
        proposal = propose_view(scene, robot, found)
        np.testing.assert_allclose(proposal.pose, expected.pose, atol=1e-6)
        assert proposal.fractions == pytest.approx(expected.fractions, abs=1e-3)
    other = propose_view(scene, robot, seen.candidates("human", "robot", view=0), object_poses=worlds[1])
    np.testing.assert_allclose(other.pose, second.pose, atol=1e-6)


def test_y_up_proposal_matches_z_up():
    """A scene rotated to y-up yields the same proposal, rotated."""
    scene, robot, human = second_experiment()
    turned = wv.Scene(up="y")
    for item in scene:
        turned.add((item.vertices[:, [1, 2, 0]], item.faces), name=item.name, label=item.label)
    turn = np.eye(4)[[1, 2, 0, 3]]
    others = [
        Agent(agent.name, agent.camera, turn @ wv.core.poses.poses_to_matrices(agent.poses), body=agent.body)
        for agent in (robot, human)
    ]
    there, other = ask(scene, robot, human), ask(turned, *others)
    np.testing.assert_allclose(other.pose[:3], there.pose[[1, 2, 0]], atol=1e-5)
    assert other.distance == pytest.approx(there.distance, abs=1e-5)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"robot": Agent.human("robot", wv.look_at((0, 0, 1), (1, 0, 1)))},
            "camera of 'robot' must be a warpvis.Camera",
        ),
        ({"robot": Agent.kinect("robot", scenes.EXPERIMENTS[0].poses(2))}, "'robot' must have one pose, got"),
        ({"max_distance": -1}, "max_distance must be a number of meters"),
        ({"step": 0}, "step must be a positive number of meters"),
        ({"radius": 0}, "radius must be a positive number of meters"),
        ({"floor": float("nan")}, "floor must be a finite number of meters"),
    ],
)
def test_invalid_arguments_are_rejected(change, said):
    scene, robot, human = second_experiment()
    found = perspective(scene, (robot, human)).candidates("human", "robot")
    with pytest.raises(wv.WarpvisError) as error:
        propose_view(scene, change.pop("robot", robot), found, **change)
    assert str(error.value).startswith(said)
