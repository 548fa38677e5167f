# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of warnings about likely mistakes: wxyz quaternions, scenes in millimeters, cameras inside of objects."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.rendering import seen_objects
from warpvis.scenes import EXPERIMENTS
from warpvis.scenes.shapes import floor

from support.recorded_warnings import recorded_warnings

KINECT = wv.Camera.from_fov(32, 24, hfov=1.0, near=0.3, far=4.5)
ENDLESS = wv.Camera.from_fov(32, 24, hfov=1.0)
CALLS = {"render": wv.render, "object_visibility": wv.object_visibility}


@pytest.fixture(params=CALLS)
def call(request):
    return CALLS[request.param]


def w_first(rows):
    return np.asarray(rows)[:, [0, 1, 2, 6, 3, 4, 5]]


def orbit(count, radius=2.0, height=1.0, target=(0, 0, 0.4)):
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([wv.look_at((radius * np.cos(a), radius * np.sin(a), height), target) for a in angles])


def drive(count):
    """Return random poses of a robot that looks slightly down."""
    rng = np.random.default_rng(1)
    eyes, angles = rng.uniform((-3, -3, 0.2), (3, 3, 2), (count, 3)), rng.uniform(0, 2 * np.pi, count)
    ahead = np.stack([np.cos(angles), np.sin(angles), np.full(count, -0.3)], axis=1)
    return np.stack([wv.look_at(eye, eye + step) for eye, step in zip(eyes, ahead, strict=True)])


def turned(poses, rotation):
    """Return the poses for a camera with a rotated frame."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    return poses_to_opencv(poses_to_matrices(poses) @ matrix, "opencv")


def boxes(size=0.5, at=(0, 0, 0.4)):
    scene = wv.Scene()
    scene.add(floor(8, 8), name="floor", label="ground")
    scene.add(trimesh.creation.box((size,) * 3), name="box", pose=(*at, 0, 0, 0, 1))
    return scene


def table(scale=1.0):
    """Return a table in millimeters."""
    parts = [trimesh.creation.box((1200, 800, 30), trimesh.transformations.translation_matrix((0, 0, 735)))]
    parts += [
        trimesh.creation.box((50, 50, 720), trimesh.transformations.translation_matrix((x, y, 360)))
        for x in (-550, 550)
        for y in (-350, 350)
    ]
    mesh = trimesh.util.concatenate(parts).apply_scale(scale)
    scene = wv.Scene()
    scene.add(mesh, name="table")
    return scene


def said(work):
    with recorded_warnings() as caught:
        work()
    return [str(item.message) for item in caught]


@pytest.mark.parametrize("poses", [orbit(3), orbit(12), orbit(60, height=0.4), drive(20)])
def test_wxyz_quaternions_warn(call, poses):
    scene = boxes()
    for work in (
        lambda: call(scene, ENDLESS, w_first(poses)),
        lambda: wv.Frames.from_poses(w_first(poses)),
        lambda: wv.Frames.from_poses(w_first(poses).tolist()),
    ):
        (message,) = said(work)
        assert "of the cameras are upside down" in message and 'pass quaternion="wxyz"' in message
    assert not said(lambda: call(scene, ENDLESS, w_first(poses), quaternion="wxyz"))
    assert not said(lambda: wv.Frames.from_poses(w_first(poses), quaternion="wxyz"))


def test_warning_names_the_caller():
    with recorded_warnings("upside down") as caught:
        wv.render(boxes(), ENDLESS, w_first(orbit(5)))
    assert caught[0].filename == __file__


@pytest.mark.parametrize("convention", ["opencv", "opengl", "ros_body"])
def test_wxyz_quaternions_warn_in_any_convention(convention):
    axes = {"opencv": np.eye(3), "opengl": np.diag([1, -1, -1]), "ros_body": [[0, -1, 0], [0, 0, -1], [1, 0, 0]]}
    poses = turned(drive(30), axes[convention])
    assert len(said(lambda: wv.Frames.from_poses(w_first(poses), convention=convention))) == 1
    assert not said(lambda: wv.Frames.from_poses(poses, convention=convention))


RANDOM = np.random.default_rng(2).normal(size=(500, 4))
LEGITIMATE = {
    "orbit": orbit(60),
    "robot": drive(200),
    "one": orbit(1),
    "upside down": turned(drive(100), np.diag([-1, -1, 1])),
    "on its side": turned(drive(100), [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "any rotation": np.concatenate([np.zeros((500, 3)), RANDOM / np.linalg.norm(RANDOM, axis=1)[:, None]], axis=1),
    "from above": np.tile([0.0, 0, 3, 1, 0, 0, 0], (5, 1)),
    "identity": np.tile([0.0, 0, -3, 0, 0, 0, 1], (5, 1)),
    "cube": np.stack([wv.look_at((0, 0, 1), np.add((0, 0, 1), d), up=u) for d, u in [
        ((1, 0, 0), (0, 0, 1)), ((-1, 0, 0), (0, 0, 1)), ((0, 1, 0), (0, 0, 1)), ((0, -1, 0), (0, 0, 1)),
        ((0, 0, 1), (-1, 0, 0)), ((0, 0, -1), (1, 0, 0)),
    ]]),
    "y is up": np.stack([wv.look_at((np.cos(a), 0.5, np.sin(a)), (0, 0, 0), up=(0, 1, 0)) for a in range(7)]),
    "y is down": np.stack([wv.look_at((0, 0, k), (0.1 * k, 0, k + 1), up=(0, -1, 0)) for k in range(9)]),
}  # fmt: skip


@pytest.mark.parametrize("name", LEGITIMATE)
def test_valid_poses_do_not_warn(name):
    assert not said(lambda: wv.Frames.from_poses(LEGITIMATE[name]))


def test_scene_in_millimeters_warns(call):
    (message,) = said(lambda: call(table(), KINECT, orbit(4)))
    assert "the scene spans 1200 x 800 x 750 m, and the camera's far is 4.5 m" in message
    assert "scale=0.001" in message
    assert not said(lambda: call(table(0.001), KINECT, orbit(4)))


def terrain(side):
    """Return hills, open below."""
    x, y = np.meshgrid(np.linspace(-side / 2, side / 2, 65), np.linspace(-side / 2, side / 2, 65), indexing="ij")
    places = np.stack([x, y, side / 50 * np.sin(9 * x / side) * np.cos(7 * y / side)], axis=-1).reshape(-1, 3)
    corner = (np.arange(64)[:, None] * 65 + np.arange(64)).reshape(-1, 1)
    return places, np.concatenate([corner + [0, 65, 66], corner + [0, 66, 1]])


def large_scene(kind):
    scene = wv.Scene()
    if kind == "terrain":
        scene.add(terrain(5000.0), name="hills")
        scene.add(trimesh.creation.box((4.5, 1.8, 1.5)), name="car", pose=(0, 0, 2, 0, 0, 0, 1))
        return scene, wv.Camera.from_fov(32, 24, hfov=1.0, near=0.5, far=10_000.0), orbit(4, 300, 400)
    if kind == "rover":  # a short-range camera on a large terrain
        scene.add(terrain(5000.0), name="hills")
        return scene, KINECT, orbit(4, 1.0, 1.0, (0, 0, 0))
    if kind == "planet":
        scene.add(trimesh.creation.icosphere(subdivisions=3, radius=6.4e6), name="planet")
        return scene, ENDLESS, orbit(4, 7e6, 1e6)
    if kind == "microscope":
        scene.add(trimesh.creation.box((0.001, 0.001, 0.0005)), name="chip")
        return scene, wv.Camera.from_fov(32, 24, hfov=0.2, near=0.001, far=0.05), orbit(4, 0.01, 0.01, (0, 0, 0))
    if kind == "sky":
        scene.add(floor(8, 8), name="floor", label="ground")
        return scene, KINECT, np.stack([wv.look_at((0, 0, 1), (1, k, 3)) for k in range(4)])
    scene.add(trimesh.creation.box((200, 100, 20)), name="hall")  # its faces point outward
    return scene, KINECT, np.stack([wv.look_at((99.9, 0, -9), (101, 0, -9)), wv.look_at((90, 0, -9), (91, 0, -9.9))])


@pytest.mark.parametrize("kind", ["terrain", "rover", "planet", "microscope", "sky", "hall"])
def test_scenes_of_other_sizes_do_not_warn(kind, call):
    assert not said(lambda: call(*large_scene(kind)))


@pytest.mark.parametrize("solid", ["box", "ball"])
def test_camera_inside_an_object_warns(solid, call):
    scene = boxes() if solid == "box" else wv.Scene()
    if solid == "ball":
        scene.add(floor(8, 8), name="floor", label="ground")
        scene.add(trimesh.creation.icosphere(radius=0.25), name="ball", pose=(0, 0, 0.4, 0, 0, 0, 1))
    poses = np.stack([wv.look_at((0.01, 0, 0.4), (1, 0, 0.4)), wv.look_at((0, 0.01, 0.4), (0, 1, 0.3))])
    (message,) = said(lambda: call(scene, KINECT, poses))
    assert message == (
        f"2 of 2 views see almost nothing: the camera is inside '{solid}'. Move the camera, or exclude the object that "
        "carries it"
    )
    assert not said(lambda: call(scene, KINECT, poses, exclude=[solid]))


def test_camera_inside_the_floor_warns(call):
    scene = wv.Scene()
    scene.add(trimesh.creation.box((8, 8, 0.2)), name="floor", label="ground", pose=(0, 0, -0.1, 0, 0, 0, 1))
    scene.add(trimesh.creation.box(), name="box", pose=(2, 0, 0.5, 0, 0, 0, 1))
    (message,) = said(lambda: wv.render(scene, KINECT, wv.look_at((0, 0, -0.1), (1, 0, -0.8))))
    assert "1 of 1 views see almost nothing: the camera is inside 'floor'" in message
    assert not said(lambda: call(scene, KINECT, wv.look_at((0, 0, 0.1), (1, 0, 0.1))))
    assert not said(lambda: call(scene, KINECT, wv.look_at((0, 0, 0.1), (0, 0, -1), up=(1, 0, 0))))  # too near


@pytest.mark.parametrize("experiment", EXPERIMENTS, ids=lambda item: item.name)
def test_experiments_do_not_warn(experiment, call):
    assert not said(lambda: call(experiment.build(), experiment.camera, experiment.poses()))


def test_objects_excluded_from_a_view_are_not_seen():
    scene = wv.scenes.PRESETS["room"].build("cpu")
    excluded = np.zeros((2, len(scene)), dtype=np.uint8)
    excluded[1, 1] = 1
    seen = seen_objects(scene, wp.array(excluded, device="cpu"))
    assert seen.tolist() == [index != 1 for index in range(len(scene))]
    assert seen_objects(scene, None).all()
