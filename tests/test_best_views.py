# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Candidate poses and their ranking: visibility, path length, clearance, and a robot that moves to see a ball."""

import math

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.core.poses import poses_to_matrices, quaternion_product
from warpvis.planning import _best_views as module, best_views, pose_grid
from warpvis.scenes.shapes import ball, floor, robot, standing_box
from warpvis.visibility import Agent, object_visibility, perspective

CAMERA = wv.Camera.from_fov(160, 120, hfov=1.0, near=0.3, far=4.5)
NOWHERE = np.array([0.0, 0, 50, 0, 0, 0, 1])
"""A pose that sees no object."""


def walled_scene(device="cpu"):
    """Return a scene with a ball on either side of a wall."""
    scene = wv.Scene(device=device)
    scene.add(floor(8, 8), name="floor", label="ground")
    scene.add(standing_box((0.1, 1.6, 0.8), 0, 0), name="wall")
    scene.add(ball(0.2, 0.3, 0.2), name="ball", label="object")
    scene.add(ball(0.2, -0.5, 0.2), name="other", label="object")
    return scene


# Pose grids


def test_grid_over_a_disc():
    poses = pose_grid((1, 2, 9), radius=0.5, step=0.2, height=0.6, headings=3, pitch=-0.3)
    places = np.unique(poses[:, :3], axis=0)
    offsets = [(0.2 * i, 0.2 * j) for i in range(-2, 3) for j in range(-2, 3) if math.hypot(0.2 * i, 0.2 * j) <= 0.5]
    expected = np.array([(1 + x, 2 + y, 0.6) for x, y in offsets])
    assert len(poses) == 3 * len(expected)
    assert places == pytest.approx(np.unique(expected, axis=0))
    axes = poses_to_matrices(poses)[:, :3, 2].reshape(-1, 3, 3)
    assert np.degrees(np.arctan2(axes[..., 1], axes[..., 0])) % 360 == pytest.approx(
        np.tile([0, 120, 240], (21, 1)), abs=1e-6
    )
    assert np.arcsin(axes[..., 2]) == pytest.approx(np.full((21, 3), -0.3))
    assert (poses_to_matrices(poses)[:, 2, 1] < 0).all()  # the image's down axis points down in the world


def test_grid_that_looks_at_a_point():
    target = (0.4, 0.0, 0.2)
    poses = pose_grid((0, 0, 0), radius=1, step=0.2, height=0.6, look_at=target)
    count = sum(math.hypot(i, j) <= 5 for i in range(-5, 6) for j in range(-5, 6))
    assert len(poses) == count - 1  # none from directly above
    for pose in poses:
        expected = wv.look_at(pose[:3], target)
        assert min(np.abs(pose - expected).max(), np.abs(pose - [*expected[:3], *-expected[3:]]).max()) < 1e-9


def test_grid_with_y_up():
    poses = pose_grid((1, 7, 2), radius=0.1, step=0.5, height=0.6, headings=4, up="y")
    assert poses[:, :3] == pytest.approx(np.tile([1, 0.6, 2], (4, 1)))
    axes = poses_to_matrices(poses)[:, :3, 2]
    assert axes == pytest.approx(np.array([[0, 0, 1], [1, 0, 0], [0, 0, -1], [-1, 0, 0]]), abs=1e-9)
    assert poses_to_matrices(poses)[:, 1, 1] == pytest.approx(-np.ones(4))
    looking = pose_grid((1, 7, 2), radius=0, step=0.5, height=0.6, look_at=(3, 0.6, 2), up="y")
    assert poses_to_matrices(looking)[0, :3, 2] == pytest.approx([1, 0, 0], abs=1e-9)


# Best views


def test_robot_moves_to_see_what_the_person_sees(device):
    scene = walled_scene(device)
    scene.add(robot(0.5, -2, 0), name="robot body", label="robot")
    start = wv.look_at((-2, 0, 0.5), (0.3, 0.2, 0.1))
    agents = [
        Agent.kinect("robot", start, body="robot body"),
        Agent.human("human", wv.look_at((2, 0, 1.5), (0.3, 0.2, 0.1))),
    ]
    missing = perspective(scene, agents).to_see("robot", "human")
    assert missing == ["ball"]
    target = scene.index("ball")
    options = {"outputs": "segmentation", "exclude": ["robot body"]}
    assert not (wv.render(scene, CAMERA, start, **options).segmentation.numpy() == target).any()

    grid = pose_grid((0, 0, 0), radius=2.5, step=0.5, height=0.5, look_at=(0.3, 0.2, 0.1))
    views = best_views(scene, CAMERA, grid, objects=missing, start=start, radius=0.25, exclude="robot body", count=3)
    assert views.objects == ("ball",)
    assert len(views.order) == 3
    best = views.pose()
    assert (wv.render(scene, CAMERA, best, **options).segmentation.numpy() == target).any()
    assert views.scores[views.order[0]] == 1
    # No shorter path leads to a view with a full score.
    nearer = views.path_lengths < views.path_lengths[views.order[0]] - 1e-9
    assert (views.scores[nearer] < 1).all()
    there = perspective(scene, [Agent("robot", CAMERA, best, body=("robot body",)), agents[1]])
    assert there.to_see("robot", "human") == []


@pytest.mark.parametrize("measure", ["fraction", "pixels"])
def test_scores_are_weighted_means(measure, device, monkeypatch):
    scene, grid = walled_scene(device), pose_grid((0, 0, 0), radius=2, step=1, height=0.5)
    options = {"objects": ["other", "ball"], "weights": [3, 1], "measure": measure, "delta": 0.01}
    views = best_views(scene, CAMERA, grid, **options)
    expected = object_visibility(scene, CAMERA, grid, objects=["other", "ball"], delta=0.01)
    expected = (expected.fraction if measure == "fraction" else expected.visible_pixels).numpy()
    assert (views.values == expected).all()
    assert views.scores == pytest.approx(0.75 * expected[:, 0] + 0.25 * expected[:, 1])
    assert (np.sort(views.order) == np.arange(len(grid))).all()
    assert views.path_lengths is None
    assert (np.diff(views.scores[views.order]) <= 0).all()
    assert views.scores.dtype == views.values.dtype == np.float32
    monkeypatch.setattr(module, "_AT_A_TIME", 10)  # five candidates per chunk
    parts = best_views(scene, CAMERA, grid, **options)
    assert (parts.values == views.values).all()
    assert (parts.order == views.order).all()


def seen_by(fractions):
    """Return a scene with a ball and poses that see about these fractions of it past occluding cards."""
    scene, poses = wv.Scene(), []
    scene.add(trimesh.creation.icosphere(subdivisions=4, radius=0.1), name="ball")
    for k, fraction in enumerate(fractions):
        angle = 2 * math.pi * k / len(fractions)
        turn = (0, 0, math.sin(angle / 2), math.cos(angle / 2))
        # 1 m in front of the ball; only the part above the card's edge is visible
        edge = 0.0875 - 0.15 * fraction if fraction < 1 else -1
        card = trimesh.creation.box((0.001, 0.2, 0.5))
        card.apply_translation((1.0, 0, edge / 2 - 0.25))
        scene.add(card, name=f"card {k}", pose=(0, 0, 0, *turn))
        poses.append(wv.look_at((2 * math.cos(angle), 2 * math.sin(angle), 0), (0, 0, 0)))
    return scene, np.array(poses)


def test_ties_are_broken_by_path_length():
    scene, poses = seen_by([1, 0.5, 1, 1, 1])
    poses = np.concatenate([poses, NOWHERE[None]])  # the last one is above the ball

    def order(**options):
        return best_views(scene, CAMERA, poses, objects=["ball"], **options).order.tolist()

    scores = best_views(scene, CAMERA, poses, objects=["ball"]).scores
    assert scores[[0, 2, 3, 4]].tolist() == [1] * 4
    assert 0.2 < scores[1] < 0.8
    assert scores[5] == 0
    assert order() == [0, 2, 3, 4, 1, 5]
    assert order(path_lengths=[4, 0, 3, 3, 1, 0]) == [4, 2, 3, 0, 1, 5]
    assert order(path_lengths=[4, 0, np.inf, 3, 1, np.inf]) == [4, 3, 0, 1]
    assert order(path_lengths=[4, 0, 3, 3, 1, 0], tie=1.5) == [1, 5, 4, 2, 3, 0]
    assert order(path_lengths=[4, 0, 3, 3, 1, 0], count=2) == [4, 2]
    for start in (poses[3], poses[3, :3], poses_to_matrices(poses[3])):
        nearest = best_views(scene, CAMERA, poses, objects=["ball"], start=start)
        assert nearest.order.tolist() == [3, 2, 4, 0, 1, 5]
        assert nearest.path_lengths[[3, 5]] == pytest.approx([0, 2], abs=1e-6)  # horizontal distance


def test_ties_are_score_intervals():
    scene, poses = seen_by([1, 0.9, 0.6, 0.4, 0.2])
    scores = best_views(scene, CAMERA, poses, objects=["ball"]).scores
    lengths = [5, 4, 3, 2, 1]
    for tie in (0.001, 0.1, 0.25, 0.5, 2.0):
        order = best_views(scene, CAMERA, poses, objects=["ball"], tie=tie, path_lengths=lengths).order
        levels = np.floor(scores / tie + 1e-4).astype(int)
        assert order.tolist() == sorted(range(5), key=lambda k: (-levels[k], lengths[k]))
    assert best_views(scene, CAMERA, poses, objects=["ball"], tie=0, path_lengths=lengths).order.tolist() == [*range(5)]


def test_without_paths_the_score_decides_within_a_tie():
    scene, poses = seen_by([0.2, 0.4, 0.6, 0.9, 1])
    assert best_views(scene, CAMERA, poses, objects=["ball"], tie=2.0).order.tolist() == [4, 3, 2, 1, 0]


def test_candidates_without_clearance_are_excluded(device):
    scene = walled_scene(device)
    grid = pose_grid((0, 0, 0), radius=1, step=0.5, height=0.5, look_at=(0.3, 0.2, 0.1))
    views = best_views(scene, CAMERA, grid, objects=["ball"], radius=0.25)
    room = np.isfinite(views.scores)
    # The wall is 0.1 m thick and 1.6 m long; balls at (0.3, 0.2) and (-0.5, 0.2) have a diameter of 0.2 m.
    x, y = grid[:, 0], grid[:, 1]
    in_wall = np.hypot(np.maximum(np.abs(x) - 0.05, 0), np.maximum(np.abs(y) - 0.8, 0)) < 0.25
    at_balls = (np.hypot(x - 0.3, y - 0.2) < 0.35) | (np.hypot(x + 0.5, y - 0.2) < 0.35)
    assert (room == ~(in_wall | at_balls)).all()
    assert 0 < room.sum() < len(grid)
    assert sorted(views.order) == np.flatnonzero(room).tolist()
    assert (views.scores[~room] == -np.inf).all()
    assert np.isnan(views.values[~room]).all()
    assert not np.isnan(views.values[room]).any()
    through = best_views(scene, CAMERA, grid, objects=["ball"], radius=0.25, exclude=["wall", "ball", "other"])
    assert np.isfinite(through.scores).all()


def test_movable_objects_in_one_world(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.icosphere(radius=0.1), name="ball", movable=True)
    grid = pose_grid((0, 0, 0), radius=0, step=1, height=0, headings=4)
    for angle in range(4):
        place = [round(math.cos(angle * math.pi / 2)) * 2, round(math.sin(angle * math.pi / 2)) * 2, 0, 0, 0, 0, 1]
        for poses in ([place], [[place]]):
            assert best_views(scene, CAMERA, grid, objects="ball", object_poses=poses, count=1).order == [angle]


def test_candidate_formats_are_equivalent(device):
    scene, grid = walled_scene(device), pose_grid((0, 0, 0), radius=2, step=1, height=0.5)
    ros = np.concatenate([grid[:, :3], quaternion_product(grid[:, 3:], np.array([0.5, -0.5, 0.5, 0.5]))], axis=1)
    expected = best_views(scene, CAMERA, grid, objects=["ball"])
    on_device = wp.array(grid, dtype=wp.transform, device=device)
    for given, convention in ((on_device, "opencv"), (poses_to_matrices(grid), "opencv"), (ros, "ros_body")):
        views = best_views(scene, CAMERA, given, objects=["ball"], convention=convention)
        assert views.values == pytest.approx(expected.values, abs=0.02)  # rounding may move a pixel at an edge
        assert np.allclose(poses_to_matrices(views.candidates), poses_to_matrices(grid), atol=1e-5)


GRID = pose_grid((0, 0, 0), radius=1, step=1, height=0.5, headings=1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scene": 3}, "scene must be a warpvis.Scene, got int"),
        ({"scene": wv.Scene()}, "the scene has no objects; add() one first"),
        ({"camera": 3}, "camera must be a warpvis.Camera or a warpvis.cameras.LensCamera, got int"),
        ({"candidates": []}, "candidates must be one or more poses, got none"),
        ({"candidates": np.zeros((0, 7))}, "candidates must be one or more poses, got none"),
        ({"candidates": np.zeros((2, 6))}, "candidates must have shape (V, 7)"),
        ({"convention": "unity"}, "convention must be one of"),
        ({"objects": ["cup"]}, "the scene has no object 'cup'"),
        ({"objects": []}, "objects must be one or more"),
        ({"weights": [1, 2]}, "weights must be 1 numbers from 0 up, one for each object and not all 0, got [1.0, 2.0]"),
        ({"weights": [0]}, "weights must be 1 numbers from 0 up, one for each object and not all 0, got [0.0]"),
        ({"measure": "volume"}, 'measure must be "fraction" or "pixels", got \'volume\''),
        ({"count": 0}, "count must be a whole number from 1 up, got 0"),
        ({"tie": -0.1}, "tie must be a finite number from 0 up, got -0.1"),
        ({"tie": np.nan}, "tie must be a finite number from 0 up, got nan"),
        ({"start": (0, 0, 0), "path_lengths": [0] * 5}, "give either start or path_lengths, not both"),
        ({"start": (0, 0)}, "start must have shape (V, 7)"),
        ({"path_lengths": [1, 2]}, "path_lengths must be 5 lengths from 0 up, one for each candidate, got shape (2,)"),
        (
            {"path_lengths": [1, 2, 3, np.nan, 0]},
            "path_lengths must be 5 lengths from 0 up, one for each candidate, got a negative one or NaN",
        ),
        (
            {"path_lengths": [np.inf] * 5},
            "at least one candidate must have a path to it, got 5 without",
        ),
        ({"radius": 5.0}, "at least one candidate must have a path to it and room for the robot, got 5 without"),
        ({"exclude": np.zeros((5, 4))}, "exclude must be names or indices of objects, the same for all views"),
        ({"exclude": "cup"}, "the scene has no object 'cup'"),
        ({"object_poses": np.zeros((2, 1, 7))}, "object_poses were given, but no object of the scene is movable"),
    ],
)
def test_invalid_arguments_raise(change, said):
    given = {"scene": walled_scene(), "camera": CAMERA, "candidates": GRID, "objects": ["ball"], **change}
    with pytest.raises(wv.WarpvisError) as error:
        best_views(given.pop("scene"), given.pop("camera"), given.pop("candidates"), **given)
    assert str(error.value).startswith(said)
    assert "\n" not in str(error.value)


def test_object_poses_of_several_worlds_raise():
    scene = wv.Scene()
    scene.add(trimesh.creation.icosphere(radius=0.1), name="ball", movable=True)
    worlds = np.tile([0, 0, 0, 0, 0, 0, 1.0], (2, 1, 1))
    with pytest.raises(wv.errors.ArrayError, match="object_poses must be of one world, got 2"):
        best_views(scene, CAMERA, GRID, objects=["ball"], object_poses=worlds)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"center": (0, 0)}, "center must be three finite numbers, got [0.0, 0.0]"),
        ({"radius": -1}, "radius must be a number of meters from 0 up, got -1"),
        ({"radius": np.nan}, "radius must be a number of meters from 0 up, got nan"),
        ({"step": 0}, "step must be a positive number of meters, got 0"),
        ({"height": np.inf}, "height must be a finite number of meters, got inf"),
        ({"look_at": (0, np.nan, 0)}, "look_at must be three finite numbers, got "),
        (
            {"step": 1e-6},
            "a pose grid must have at most 10000000 poses, got a radius of 1.0 m with a step of 1e-06 m; "
            "use a larger step or fewer headings",
        ),
        (
            {"radius": 0.001, "step": 1e-6},
            "a pose grid must have at most 10000000 poses, got a radius of 0.001 m with a step of 1e-06 m",
        ),
        ({"radius": 1e300}, "a pose grid must have at most 10000000 poses, got a radius of 1e+300 m"),
        ({"headings": 10**400}, "a pose grid must have at most 10000000 poses, got a radius of 1.0 m"),
        ({"headings": 0}, "headings must be a whole number from 1 up, got 0"),
        ({"pitch": 2}, "pitch must be between -pi/2 and pi/2 radians, got 2"),
        ({"up": "x"}, 'up must be "z" or "y", got \'x\''),
    ],
)
def test_invalid_grids_raise(change, said):
    given = {"center": (0, 0, 0), "radius": 1, "step": 0.5, "height": 0.5, **change}
    with pytest.raises(wv.WarpvisError) as error:
        pose_grid(given.pop("center"), **given)
    assert str(error.value).startswith(said)
