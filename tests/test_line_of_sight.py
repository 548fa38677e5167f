# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of `line_of_sight`: reasons, angles and places, compared with geometry in double precision."""

import math

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.visibility import line_of_sight
from warpvis.visibility._line_of_sight import cast_ray, line_of_sight_in_depth

from support.watching import BALL, CAMERA, FLOOR, depths, person, raised, room, trajectory

HFOV = 1.0
ROBOT = wv.Agent(
    "robot",
    wv.Camera.from_fov(320, 240, hfov=HFOV, near=0.3, far=4.5),
    wv.look_at((0, 0, 1), (1, 0, 1)),
    body=("cart",),
)
VFOV = 2 * math.atan(math.tan(HFOV / 2) * 240 / 320)


def box_scene():
    scene = wv.Scene()
    scene.add(trimesh.creation.box((0.2, 1, 1)), name="board", pose=(2, 0, 1, 0, 0, 0, 1), movable=True)
    scene.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="cart", pose=(0.5, 0, 1, 0, 0, 0, 1))
    return scene


def toward(azimuth, elevation=0.0, distance=2.0):
    """Return a point in a direction from the robot's eyes [rad], to the left and up."""
    x, y = math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth)
    return np.array([0, 0, 1]) + distance * np.array([x, y, math.sin(elevation)])


@pytest.mark.parametrize(
    ("azimuth", "elevation", "side", "outside"),
    [
        (0.9, 0.0, "left", 0.9 - HFOV / 2),
        (-1.4, 0.0, "right", 1.4 - HFOV / 2),
        (0.0, 0.8, "above", 0.8 - VFOV / 2),
        (0.0, -0.5, "below", 0.5 - VFOV / 2),
        (2.0, 0.0, "behind", 2.0 - HFOV / 2),
        (0.9, 0.7, None, None),
        (2.9, -0.4, "behind", None),
    ],
)
def test_angle_outside_the_field_of_view(azimuth, elevation, side, outside):
    line = line_of_sight(box_scene(), ROBOT, toward(azimuth, elevation))
    assert line.status == wv.Visibility.OUT_OF_VIEW and line.stop is None and math.isnan(line.depth)
    # The nearest of many points of the border, tan(angle) = (x, y) in the plane z = 1.
    across = np.linspace(-1, 1, 200_001)
    wide, high = math.tan(HFOV / 2), math.tan(VFOV / 2)
    one = np.ones_like(across)
    border = [(across * wide, sign * high * one, one) for sign in (-1, 1)]
    border += [(sign * wide * one, across * high, one) for sign in (-1, 1)]
    border = np.concatenate(border, axis=1).T
    forward, left, up = (toward(azimuth, elevation) - (0, 0, 1)) / 2
    angles = np.arccos(border @ (-left, -up, forward) / np.linalg.norm(border, axis=1))
    assert line.outside == pytest.approx(angles.min(), abs=1e-5)
    assert outside is None or line.outside == pytest.approx(outside, abs=1e-6)
    assert side is None or line.side == side
    said = line.reason.removeprefix("out of view: ").split(" degrees outside the field of view, ")
    assert float(said[0]) == pytest.approx(math.degrees(angles.min()), abs=0.5) and said[1].endswith(line.side)


def test_field_of_view_of_a_person():
    human = wv.Agent.human("human", wv.look_at((0, 0, 1), (1, 0, 1)))
    line = line_of_sight(box_scene(), human, toward(math.radians(130)))
    assert math.degrees(line.outside) == pytest.approx(30, abs=1e-4)
    assert line.reason == "out of view: 30 degrees outside the field of view, behind"
    assert line_of_sight(box_scene(), human, toward(math.radians(99))).status == wv.Visibility.VISIBLE


def test_lens_has_the_angles_of_its_pinhole():
    lens = wv.cameras.lenses.OpenCVPinhole(300, 300, 160, 120, (0.0, 0, 0, 0))
    bent = wv.cameras.lenses.OpenCVPinhole(300, 300, 160, 120, (-0.05, 0, 0, 0))
    plain = wv.Camera(320, 240, 300, 300, 160, 120)
    pose = ROBOT.poses[0]
    found = [
        line_of_sight(box_scene(), wv.Agent("eye", camera, pose), toward(0.8, 0.7))
        for camera in (plain, wv.cameras.LensCamera(lens, 320, 240), wv.cameras.LensCamera(bent, 320, 240))
    ]
    assert found[1].outside == pytest.approx(found[0].outside, abs=1e-5)
    assert found[2].outside < found[0].outside - 0.001  # negative distortion widens the field
    assert found[2].reason.endswith(("to the left", "above"))


def test_hidden_point_is_blocked_where_the_line_meets_the_board():
    target = np.array([3.0, 0.3, 1.2])
    line = line_of_sight(box_scene(), ROBOT, target)
    assert line.status == wv.Visibility.OCCLUDED and line.occluder == "board"
    eye = np.array([0, 0, 1.0])
    stop = eye + (target - eye) * (1.9 / 3.0)  # the board's front is at x = 1.9; the cart is the robot's body
    np.testing.assert_allclose(line.stop, stop, atol=1e-5)
    reached, whole = np.linalg.norm(stop - eye), np.linalg.norm(target - eye)
    assert line.reason == f"hidden by board at {reached:.2f} m, {whole - reached:.2f} m before the point"
    assert line.depth == pytest.approx(3.0, abs=1e-6) and line.distance == pytest.approx(whole)
    moved = line_of_sight(box_scene(), ROBOT, target, object_poses=[[2, 3, 1, 0, 0, 0, 1]])
    assert moved == line_of_sight(box_scene(), ROBOT, target, object_poses=[[2, 3, 1, 1, 0, 0, 0]], quaternion="wxyz")
    assert moved.status == wv.Visibility.VISIBLE and moved.reason == "visible" and moved.stop is None
    front = line_of_sight(box_scene(), ROBOT, (1.9, 0.1, 1.1))
    assert front.status == wv.Visibility.VISIBLE


def test_range_of_the_camera():
    near = line_of_sight(box_scene(), ROBOT, (0.2, 0, 1))
    assert near.status == wv.Visibility.TOO_NEAR
    assert near.reason == "too near: its depth is 0.20 m, and the camera sees from 0.3 m"
    far = line_of_sight(box_scene(), ROBOT, (5, 2, 1))
    assert far.status == wv.Visibility.TOO_FAR
    assert far.reason == "too far: its depth is 5.00 m, and the camera sees up to 4.5 m"


@pytest.fixture(scope="module")
def measured():
    """Return a map of the room above `FLOOR`."""
    found = wv.OccupancyMap(0.04, bounds=[(-1, -4, 0), (6, 4, 3)])
    for pose, depth in zip(trajectory(), depths(trajectory()), strict=True):
        found.integrate(depth, CAMERA, pose)
    return found


def test_measured_surface_hides(measured):
    anna = person()
    target = np.array(raised(BALL)[:3])
    line = line_of_sight(measured, anna, target)
    assert line.status == wv.Visibility.OCCLUDED and line.occluder is None
    eye = anna.poses[0, :3]
    front = eye + (target - eye) * (2.63 - eye[0]) / (target[0] - eye[0])  # the board's side towards anna
    np.testing.assert_allclose(line.stop, front, atol=0.1)  # the camera saw its other side, 0.06 m behind
    assert line.reason.startswith("hidden by a measured surface at ")


def test_unmeasured_space_is_told_with_its_length(measured):
    bob = person("bob", eyes=(0.5, 3.4, 1.4))
    target = np.array(raised((0.5, 0.0, 0.6)))
    line = line_of_sight(measured, bob, target)
    assert line.status == wv.Visibility.UNKNOWN
    eye = bob.poses[0, :3]
    # Sample the states of voxels along the examined part of the line: 0.5 m from the eyes to 2 voxels from the target.
    length = np.linalg.norm(target - eye)
    distances = np.linspace(0.5, length - 0.08, 20_000)
    states = measured.states(eye + distances[:, None] * (target - eye) / length).numpy()
    unknown = states < 2
    assert line.unknown_fraction == pytest.approx(unknown.mean(), abs=0.01)
    assert line.unknown_length == pytest.approx(unknown.mean() * (length - 0.58), abs=0.02)
    assert math.dist(line.stop, eye) == pytest.approx(distances[unknown.argmax()], abs=0.03)
    assert line.reason.startswith(f"unknown: {line.unknown_length:.2f} m (")
    both = line_of_sight(room(), bob, target, occupancy=measured)
    assert both.status == wv.Visibility.UNKNOWN and both.unknown_length == pytest.approx(line.unknown_length)


def test_depth_image_hides_what_is_behind_its_surfaces():
    pose = trajectory()[4]
    robot = wv.Agent("robot", CAMERA, pose)
    (depth,) = depths(pose[None])
    hidden = line_of_sight_in_depth(robot, depth, (3.5, 0.6, FLOOR + 0.4), 0.02)
    assert hidden.status == wv.Visibility.OCCLUDED
    hit = cast_ray(room(), pose[:3], np.array([3.5, 0.6, FLOOR + 0.4]) - pose[:3])
    np.testing.assert_allclose(hidden.stop, hit[0], atol=0.02)
    assert room().objects[hit[1]].name == "board" and hidden.stop[0] == pytest.approx(2.57, abs=0.02)
    depth[:] = 0
    blind = line_of_sight_in_depth(robot, depth, (3.5, 0.6, FLOOR + 0.4), 0.02)
    assert blind.reason == "unknown: the depth image has no measurement there"


def test_ray_that_meets_nothing():
    assert cast_ray(box_scene(), np.zeros(3), np.array([0, 0, -1.0])) is None
    point, index = cast_ray(box_scene(), np.array([0.0, 0, 1]), np.array([2.0, 0, 0]), exclude=["cart"])
    np.testing.assert_allclose(point, (1.9, 0, 1), atol=1e-6)
    assert box_scene().objects[index].name == "board"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"agent": "robot"}, "agent must be a warpvis.Agent, got str"),
        ({"agent": wv.Agent("two", ROBOT.camera, np.tile(ROBOT.poses, (2, 1)))}, "'two' must have one pose, got 2"),
        ({"point": (0, 0, 1)}, "point must not be at the eyes of 'robot'"),
        ({"point": (0, 0)}, "point must be three finite numbers"),
        ({"occupancy": 3}, "occupancy must be a warpvis.OccupancyMap"),
        ({"scene": 3}, "scene must be a warpvis.Scene"),
    ],
)
def test_invalid_arguments_raise(arguments, words):
    given = {"scene": box_scene(), "agent": ROBOT, "point": (2, 0, 1), **arguments}
    with pytest.raises(wv.WarpvisError, match=words):
        line_of_sight(**given)
