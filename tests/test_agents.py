# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Agents: wide fields of view split into adjoining faces, presets, and poses."""

import itertools
import math

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings, strategies as st

import warpvis as wv
from warpvis.core.poses import poses_to_matrices, quaternion_product
from warpvis.visibility import Agent, FieldOfView

DEGREE = math.pi / 180
POSE = wv.look_at((1, 2, 1.5), (3, 0, 1))

fields = st.builds(
    FieldOfView,
    hfov=st.floats(10 * DEGREE, 2 * math.pi),
    up=st.floats(5 * DEGREE, 80 * DEGREE),
    down=st.floats(5 * DEGREE, 80 * DEGREE),
    resolution=st.floats(3, 200),
)


def rotation(face):
    return poses_to_matrices([0, 0, 0, *face.rotation])[:3, :3]


def in_image(face, directions):
    """Return whether directions in the agent's frame project into a face's image."""
    x, y = np.moveaxis(face.camera.project(directions @ rotation(face)), -1, 0)
    with np.errstate(invalid="ignore"):
        return (x >= 0) & (x < face.camera.width) & (y >= 0) & (y < face.camera.height)


@settings(deadline=None, max_examples=100)
@given(fields, st.integers(0, 2**32 - 1))
def test_every_direction_of_a_field_is_in_exactly_one_face(field, seed):
    rng, faces = np.random.default_rng(seed), field.faces()
    step = field.hfov / len(faces)
    azimuth = rng.uniform(-math.pi, math.pi, 2000)
    height = rng.uniform(-6, 6, 2000)  # on a vertical line at a distance of 1
    directions = np.stack([np.sin(azimuth), -height, np.cos(azimuth)], axis=-1)
    number = np.floor((azimuth + field.hfov / 2) / step)
    from_axis = azimuth - ((number + 0.5) * step - field.hfov / 2)
    elevation = np.arctan(height / np.cos(from_axis))  # on the center plane
    # Directions within rounding of a border may be on either side.
    inside = (np.abs(azimuth) < field.hfov / 2) & (elevation < field.up) & (elevation > -field.down)
    sideways = np.abs(np.abs(from_axis) - step / 2)
    near = (sideways < 1e-6) | (np.abs(elevation - field.up) < 1e-6) | (np.abs(elevation + field.down) < 1e-6)
    shown = np.sum([in_image(face, directions) for face in faces], axis=0)
    assert (shown[~near] == inside[~near]).all()


@settings(deadline=None, max_examples=100)
@given(fields)
def test_canvases_do_not_overlap(field):
    faces = field.faces()
    for before, after in itertools.pairwise(faces):
        assert before.canvas[2] == after.canvas[0] == 0
    cameras = {face.camera for face in faces}
    assert len(cameras) == 1
    camera = cameras.pop()
    assert camera.hfov <= 80 * DEGREE + 1e-9
    assert all(face.canvas[1] == face.canvas[3] == camera.height for face in faces)
    angles = [
        math.atan((camera.cx + face.canvas[0]) / camera.fx)
        + math.atan((camera.width - camera.cx + face.canvas[2]) / camera.fx)
        for face in faces
    ]
    assert sum(angles) <= 2 * math.pi + 1e-9
    assert 0 <= faces[0].canvas[0] == faces[-1].canvas[2] <= camera.width


def test_faces_have_exact_angles():
    field = FieldOfView(200 * DEGREE, 60 * DEGREE, 75 * DEGREE, near=0.1, far=9.0, resolution=120)
    faces = field.faces()
    assert len(faces) == 3
    for face, degrees in zip(faces, (-200 / 3, 0, 200 / 3), strict=True):
        camera = face.camera
        assert camera.hfov == pytest.approx(200 / 3 * DEGREE)
        assert math.atan(camera.cy / camera.fy) == pytest.approx(60 * DEGREE)
        assert math.atan((camera.height - camera.cy) / camera.fy) == pytest.approx(75 * DEGREE)
        assert camera.fx == pytest.approx(120, rel=0.01)
        assert camera.fy == pytest.approx(120, rel=0.01)
        assert (camera.near, camera.far) == (0.1, 9.0)
        axis = rotation(face)[:, 2]
        assert axis == pytest.approx([math.sin(degrees * DEGREE), 0, math.cos(degrees * DEGREE)])
    width = faces[0].camera.width
    assert [face.canvas[0] for face in faces] == [width, 0, 0]
    assert [face.canvas[2] for face in faces] == [0, 0, width]


def test_narrow_field_has_one_face():
    assert len(FieldOfView(1e-9, 0.3, 0.3).faces()) == 1
    (face,) = FieldOfView(80 * DEGREE, 0.3, 0.3).faces()
    assert face.canvas == (face.camera.width, face.camera.height) * 2
    assert len(FieldOfView(80.1 * DEGREE, 0.3, 0.3).faces()) == 2


def test_kinect_preset():
    robot = Agent.kinect("robot", POSE, body="shell")
    assert robot.camera == wv.Camera.kinect()
    assert robot.body == ("shell",)
    assert robot.attention is None
    (face,) = robot.faces
    assert face.canvas == (320, 240, 320, 240)
    assert np.allclose(robot.face_poses(face), POSE)


def test_human_preset():
    human = Agent.human("human", POSE, body=["head", "trunk"], far=20.0, resolution=60)
    assert human.camera == FieldOfView(200 * DEGREE, 60 * DEGREE, 75 * DEGREE, far=20.0, resolution=60)
    assert human.attention.hfov == human.attention.vfov == pytest.approx(60 * DEGREE)
    assert human.attention.far == 20.0
    assert human.body == ("head", "trunk")


def test_pose_formats_are_equivalent():
    ros = np.concatenate([POSE[:3], quaternion_product(POSE[3:], np.array([0.5, -0.5, 0.5, 0.5]))])
    given = [POSE, [POSE], poses_to_matrices(POSE), wp.array([POSE], dtype=wp.transform, device="cpu")]
    for pose in given:
        assert np.allclose(Agent.human("human", pose).poses, POSE[None])
    assert np.allclose(Agent.kinect("robot", ros, convention="ros_body").poses, POSE[None])
    assert Agent.kinect("robot", np.tile(POSE, (4, 1))).poses.shape == (4, 7)


def test_faces_rotate_with_the_agent():
    human = Agent.human("human", np.stack([POSE, wv.look_at((0, 0, 2), (0, 1, 0))]))
    for face in human.faces:
        poses = human.face_poses(face)
        assert (poses[:, :3] == human.poses[:, :3]).all()
        expected = poses_to_matrices(human.poses)[:, :3, :3] @ rotation(face)
        assert np.allclose(poses_to_matrices(poses)[:, :3, :3], expected)
    right_of_the_first = poses_to_matrices(human.face_poses(human.faces[2]))[0, :3, 2]
    assert right_of_the_first @ poses_to_matrices(POSE)[:3, 0] > 0.9


def test_angles_to_points():
    agent = Agent.kinect("robot", [wv.look_at((0, 0, 0), (1, 0, 0)), wv.look_at((0, 0, 1), (0, 0, 0), up="y")])
    points = np.array([[[2, 0, 0], [0, 0, 3], [-1, 0, 0], [0, 0, 0], [1, 1, 0]]], dtype=float)
    down = [math.degrees(math.acos(cosine)) for cosine in (5**-0.5, -1, 2**-0.5, 1, 3**-0.5)]
    expected = [[0, 90, 180, 0, 45], down]
    assert np.degrees(agent.angles_to(points)) == pytest.approx(np.array(expected), abs=1e-5)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: FieldOfView(0, 1, 1), "hfov of a field must be above 0 and up to 2 pi radians, got 0"),
        (lambda: FieldOfView(200, 1, 1), "hfov of a field must be above 0 and up to 2 pi radians, got 200"),
        (lambda: FieldOfView(1, 1.5, 1), "up of a field must be from 0 to below 1.484 radians (85 degrees), got 1.5"),
        (lambda: FieldOfView(1, 1, -1), "down of a field must be from 0 to below 1.484 radians (85 degrees), got -1"),
        (lambda: FieldOfView(1, 0, 0), "up and down of a field must not both be 0"),
        (
            lambda: FieldOfView(1, 0.5, 0.5, resolution=1e9),
            "resolution must give images of at most 524288 px per side, got 1000000000.0 px/rad",
        ),
        (
            lambda: FieldOfView(1, 1, 1, resolution=0),
            "resolution must be a positive number of pixels per radian, got 0",
        ),
        (lambda: FieldOfView(1, 1, 1, near=2, far=1), "the depth range needs 0 <= near < far, got near=2.0, far=1.0"),
        (lambda: Agent.human("", POSE), "name of an agent must be a non-empty string, got ''"),
        (lambda: Agent("robot", 3, POSE), "camera of 'robot' must be a warpvis.Camera, a warpvis.cameras.Lens"),
        (
            lambda: Agent("robot", wv.Camera.kinect(), POSE, attention=1.0),
            "attention of 'robot' must be a warpvis.Camera, a warpvis.cameras.LensCamera or None, got float",
        ),
        (lambda: Agent.kinect("robot", POSE, body=[3]), "body of 'robot' must be names of objects, got (3,)"),
        (lambda: Agent.kinect("robot", np.zeros(7)), "pose of 'robot' must have quaternions of length 1, got 0"),
        (lambda: Agent.kinect("robot", np.zeros(6)), "pose of 'robot' must have shape (V, 7)"),
        (lambda: Agent.kinect("robot", POSE, convention="unity"), "convention must be one of"),
    ],
)  # fmt: skip
def test_invalid_arguments_raise(call, said):
    with pytest.raises(wv.WarpvisError) as error:
        call()
    assert str(error.value).startswith(said)
    assert "\n" not in str(error.value)
