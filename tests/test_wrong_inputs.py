# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What users do wrong with depth, cameras, poses and recordings: one sentence with the remedy, and no false alarms."""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import warpvis as wv
from warpvis.core.poses import poses_to_matrices

from support.recorded_warnings import recorded_warnings

CAMERA = wv.Camera(160, 120, 142.5, 142.5, 80, 60, near=0.3, far=8.0)
K = CAMERA.to_K()
EYES = [(0, 0.1, 1.5), (0.3, 1.2, 1.4), (0.1, -1.0, 1.6), (0.6, 0.4, 1.3)]
POSES = np.array([wv.look_at(eye, (2.2, 0, 0.6)) for eye in EYES])
MATRICES = poses_to_matrices(POSES)
INVERSE = np.linalg.inv(MATRICES)
OPENGL = MATRICES @ np.diag([1.0, -1, -1, 1])
WXYZ = POSES[:, [0, 1, 2, 6, 3, 4, 5]]
MILLIMETERS = POSES * [1000, 1000, 1000, 1, 1, 1, 1]
Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]) @ MATRICES
SCENE = wv.Scene(device="cpu")
for name, label, size, center in (
    ("floor", "ground", (9, 9, 0.1), (1, 0, -0.05)),
    ("wall", "obstacle", (0.1, 9, 6), (4, 0, 2)),
    ("side", "obstacle", (9, 0.1, 6), (1, 3, 2)),
    ("table", "obstacle", (1.0, 1.6, 0.1), (2.2, 0, 0.75)),
    ("box", "object", (0.2, 0.25, 0.3), (2.2, 0.4, 0.95)),
):
    SCENE.add(trimesh.creation.box(size), name=name, label=label, pose=(*center, 0, 0, 0, 1))
DEPTH = wv.render(SCENE, CAMERA, POSES, outputs="depth").depth.numpy()
UNITS = np.rint(1000 * DEPTH).astype(np.uint16)
COLOR = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
GRAY = COLOR[..., 0].astype(np.float32)


def classify(depth=DEPTH, poses=POSES, camera=CAMERA, **options):
    return wv.classify(depth, camera, poses, **options)


def voxel_map(depth=DEPTH, poses=POSES):
    return wv.voxel_map(depth, CAMERA, poses, bounds=[[0, -2, 0], [4, 2, 2]], cell_size=0.1)


def compare(depth=DEPTH, poses=POSES, **options):
    return wv.compare_depth(SCENE, CAMERA, poses, depth, **{"sigma": 0.01} | options)


def agents(pose):
    return [wv.Agent("robot", CAMERA, pose), wv.Agent("person", CAMERA, POSES[1])]


def scaled(factor):
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.creation.box((800.0, 800.0, 100.0)), pose=(factor, 0, 50, 0, 0, 0, 1))
    return scene


def moved(offset):
    return POSES + np.array([*offset, 0, 0, 0, 0])


def recording(folder, *, units=UNITS, color=COLOR, poses=MATRICES, camera=CAMERA, **options):
    """Write 7-Scenes files, and read all of them."""
    for index, image in enumerate(units):
        Image.fromarray(image).save(folder / f"frame-{index:06d}.depth.png")
        if color is not None:
            Image.fromarray(color).save(folder / f"frame-{index:06d}.color.png")
        np.savetxt(folder / f"frame-{index:06d}.pose.txt", poses[index])
    return read(folder, camera=camera, **options)


def images(folder, rows, *, names=None, camera=CAMERA):
    """Write a folder of images with a trajectory, and read all of them."""
    (folder / "depth").mkdir()
    for index, image in enumerate(UNITS):
        Image.fromarray(image).save(folder / "depth" / f"{names[index] if names else index}.png")
    np.savetxt(folder / "poses.txt", rows, fmt="%.6f")
    return read(folder, camera=camera)


def read(path, **options):
    found = wv.open_recording(path, **options)
    for frame in found:
        frame.depth, frame.color  # noqa: B018
    return found.posed().stack()


TIMES = 1.7e9 + np.arange(4.0)[:, None]
TRAJECTORY = np.concatenate([TIMES, POSES], axis=1)
SECONDS = [f"{time:.6f}" for time in TIMES[:, 0]]

# name: (what a user does, words of the refusal or warning)
WRONG = {
    # Units and kinds of depth.
    "float millimeters": (lambda: classify(1000 * DEPTH), "pass depth / 1000"),
    "integer millimeters": (lambda: classify(UNITS), "divide millimeters by 1000"),
    "millimeters of the floor": (lambda: wv.fit_floor(1000 * DEPTH[0], CAMERA), "pass measured / 1000"),
    "millimeters in a map": (lambda: voxel_map(1000 * DEPTH), "pass depth / 1000"),
    "millimeters compared": (lambda: compare(1000 * DEPTH), "pass depth / 1000"),
    "color": (lambda: classify(COLOR, POSES[0]), "got color images .* pass the depth"),
    "float color": (lambda: compare(COLOR[None] / np.float32(255), POSES[0]), "got color images .* pass the depth"),
    "gray of 8 bits": (lambda: classify(COLOR[..., 0], POSES[0]), "got uint8; it may be a color image"),
    "gray as floats": (lambda: voxel_map(GRAY, POSES[0]), "up to 25., as gray images .* not their pictures"),
    "color of the floor": (lambda: wv.fit_floor(COLOR, CAMERA), "got color images .* pass the depth"),
    "disparity": (
        lambda: compare(np.float32(7) / DEPTH),
        "only .* agree with the scene: .* that depth is not disparity",
    ),
    "disparity of the floor": (lambda: wv.fit_floor(50 / DEPTH[0], CAMERA), "got 0; check the units and the range"),
    "other size": (lambda: classify(DEPTH[:, ::2, ::2]), r"depth must have shape \(V, 120, 160\), got \(4, 60, 80\)"),
    "transposed images": (
        lambda: classify(DEPTH.swapaxes(1, 2)),
        r"must have shape \(V, 120, 160\), got \(4, 160, 120\)",
    ),
    "sigma in millimeters": (lambda: compare(sigma=8), "divide millimeters by 1000"),
    # Cameras.
    "K transposed": (lambda: wv.Camera.from_K(K.T, 160, 120), "got its transpose, .*; pass K.T"),
    "K normalized": (lambda: wv.Camera.from_K(K / [[160], [120], [1]], 160, 120), "multiply fx and cx by 160"),
    "K of a larger image": (
        lambda: wv.Camera.from_K(K * [[4], [4], [1]], 160, 120),
        "640 x 480 .* fy, cx and cy by 0.25",
    ),
    "K of a smaller image": (lambda: wv.Camera.from_K(K / [[2], [2], [1]], 160, 120), "80 x 60 .* fy, cx and cy by 2"),
    "K as a row": (lambda: wv.Camera.from_K(K.ravel(), 160, 120), r"got \(9,\); pass K.reshape\(3, 3\)"),
    "P as K": (lambda: wv.Camera.from_K(np.eye(3, 4), 160, 120), r"got \(3, 4\); pass K\[:, :3\]"),
    "4 x 4 as K": (lambda: wv.Camera.from_K(np.eye(4), 160, 120), r"got \(4, 4\); pass K\[:3, :3\]"),
    "fy negative": (
        lambda: wv.Camera(160, 120, 142, -142, 80, 60),
        'absolute values, .* poses with convention="opengl"',
    ),
    "focal length in millimeters": (
        lambda: wv.Camera(1920, 1080, 4.2, 4.2, 960, 540),
        r"in millimeters, multiply .*\[mm\]",
    ),
    "width and height swapped": (lambda: wv.Camera.from_K(K, 120, 160), "width comes before height"),
    "principal point first": (lambda: wv.Camera(160, 120, 80, 60, 142.5, 142.5), "principal point .* is outside"),
    "degrees": (lambda: wv.Camera.from_fov(160, 120, hfov=58), r"pass math.radians\(58\)"),
    # Poses.
    "world to camera, mapped": (lambda: voxel_map(poses=INVERSE), "if they are world to camera: pass their inverses"),
    "world to camera, compared": (lambda: compare(poses=INVERSE), "if they are world to camera: pass their inverses"),
    "OpenGL axes, mapped": (lambda: voxel_map(poses=OPENGL), 'pass convention="opengl"'),
    "OpenGL axes, compared": (lambda: compare(poses=OPENGL), 'pass convention="opengl"'),
    "OpenCV axes as OpenGL": (lambda: compare(convention="opengl"), 'pass convention="opencv"'),
    "w first, mapped": (lambda: voxel_map(poses=WXYZ), 'pass quaternion="wxyz"'),
    "w first, compared": (lambda: compare(poses=WXYZ), 'pass quaternion="wxyz"'),
    "floor upright, classified": (lambda: classify(poses=Y_UP), 'vertical axis of their world is y: pass up="y"'),
    "floor upright, compared": (lambda: compare(poses=Y_UP), "vertical axis of their world is y: .* or rotate them"),
    "floor upright as z": (lambda: classify(up="y"), 'vertical axis of their world is z: pass up="z"'),
    "the camera as the world": (
        lambda: classify(convention="ros_body", poses=np.repeat([[0, 0, 0, 0, 0.13, 0, 0.9915]], 4, axis=0)),
        "below the floor: .* FloorFit.camera_to_world",
    ),
    "millimeters, mapped": (lambda: voxel_map(poses=MILLIMETERS), "in millimeters: divide them by 1000"),
    "millimeters, compared": (lambda: compare(poses=MILLIMETERS), "in millimeters: divide them by 1000"),
    "millimeters, rendered": (lambda: wv.render(SCENE, CAMERA, MILLIMETERS), "in millimeters, divide them by 1000"),
    "millimeters, agents": (
        lambda: wv.perspective(SCENE, agents(MILLIMETERS[0])),
        "in millimeters, divide them by 1000",
    ),
    "transposed matrices": (
        lambda: classify(poses=MATRICES.swapaxes(1, 2)),
        "are transposed: swap their last two axes",
    ),
    "matrices with scale": (lambda: classify(poses=MATRICES @ np.diag([2.0, 2, 2, 1])), "divide the 3 x 3 parts by it"),
    "left-handed": (lambda: classify(poses=np.diag([1.0, -1, 1, 1]) @ MATRICES), "not mirrors: .* negate an axis"),
    "3 x 4 matrices": (lambda: classify(poses=MATRICES[:, :3]), "append the row 0 0 0 1 to each matrix"),
    "with times": (lambda: classify(poses=TRAJECTORY), "omit the column of times"),
    "Euler angles": (lambda: classify(poses=POSES[:, :6]), "convert angles to quaternions"),
    "NaN": (lambda: classify(poses=np.where(np.arange(4)[:, None] == 1, np.nan, POSES)), "at index 1; leave out views"),
    "one too few": (lambda: classify(poses=POSES[:3]), "one pose for each view of depth, 4, got 3"),
    # Scenes and agents.
    "scene in millimeters": (lambda: wv.render(scaled(2000), CAMERA, POSES[0]), "load it with scale=0.001"),
    "below the floor, agents": (
        lambda: wv.perspective(SCENE, agents(moved((0, 0, -3))[0])),
        "'robot' is below the floor",
    ),
    "below the floor, classified": (
        lambda: classify(poses=moved((0, 0, -3))),
        "below the floor: pass poses in a world",
    ),
    "inside a wall, agents": (
        lambda: wv.perspective(SCENE, agents(moved((4, 0, 0))[0])),
        "inside 'wall'. Move the camera",
    ),
    "inside a wall, rendered": (
        lambda: wv.render(SCENE, CAMERA, moved((4, 0, 0))[0]),
        "inside 'wall'. Move the camera",
    ),
    "inside a wall, objects": (
        lambda: wv.object_visibility(SCENE, CAMERA, moved((4, 0, 0))[0]),
        "inside 'wall'. Move the camera",
    ),
    "inside a wall, compared": (
        lambda: compare(DEPTH[0], moved((4, 0, 0))[0]),
        "that no camera is inside of an object",
    ),
}

# name: (function of a folder, words of the refusal or warning)
WRONG_RECORDINGS = {
    "no folder": (lambda folder: read(folder / "missing"), "no such file or folder"),
    "a file": (lambda folder: read(Path(__file__)), r"must be the folder of a recording, or a bag \("),
    "empty": (lambda folder: read(folder, camera=CAMERA), "has no depth images, .png, "),
    "no camera": (lambda folder: recording(folder, camera=None), "pass that of the depth images as camera="),
    "camera of other images": (
        lambda folder: recording(folder, camera=wv.Camera(320, 240, 285, 285, 160, 120)),
        "must have the pixels of the camera, 320 x 240, got 160 x 120; give the camera",
    ),
    "color as depth": (lambda folder: recording(folder, units=[COLOR] * 4), "got mode RGB; pass the depth images"),
    "8 bits as depth": (
        lambda folder: recording(folder, units=(UNITS // 32).astype(np.uint8)),
        "got mode L; pass the depth images, not pictures of them",
    ),
    "larger color": (
        lambda folder: recording(folder, color=COLOR.repeat(2, axis=0).repeat(2, axis=1)),
        "160 x 120, got 320 x 240; register the color images",
    ),
    "unit 1": (lambda folder: recording(folder, unit=1.0), "pass unit=0.001"),
    "unit 1000": (lambda folder: recording(folder, unit=1000), "for 1000 units per meter, pass 1 / 1000"),
    "world to camera": (lambda folder: recording(folder, poses=INVERSE), "world to camera: pass their inverses"),
    "OpenGL axes": (lambda folder: recording(folder, poses=OPENGL), 'pass convention="opengl"'),
    "transposed": (lambda folder: recording(folder, poses=MATRICES.swapaxes(1, 2)), "swap their last two axes"),
    "unknown poses": (lambda folder: recording(folder, poses=MATRICES * np.nan), "pass poses=, a file of poses"),
    "one pose too few": (lambda folder: images(folder, TRAJECTORY[:3]), "a pose for each of the 4 .*, got 3 poses"),
    "names in milliseconds": (
        lambda folder: images(folder, TRAJECTORY, names=[f"{1000 * time:.0f}" for time in TIMES[:, 0]]),
        "must be in seconds .* got milliseconds; rename them",
    ),
    "poses in nanoseconds": (
        lambda folder: images(folder, TRAJECTORY * ([1e9] + [1] * 7), names=SECONDS),
        r"must be in seconds .* got nanoseconds; divide them by 1e\+09",
    ),
    "poses with w first": (
        lambda folder: images(folder, np.concatenate([TIMES, WXYZ], axis=1), names=SECONDS),
        'quaternions have w first: pass quaternion="wxyz"',
    ),
    "poses without times": (lambda folder: images(folder, POSES), "expected the 8 numbers 'timestamp tx ty tz"),
}


def outcome(call):
    """Return the message of the error or of the warnings of a call."""
    with recorded_warnings() as caught:
        try:
            call()
        except wv.WarpvisError as error:
            return str(error)
    return "\n".join(str(warning.message) for warning in caught)


@pytest.mark.parametrize("name", WRONG)
def test_remedy(name):
    call, words = WRONG[name]
    message = outcome(call)
    assert message.count("\n") == 0
    assert re.search(words, message), message


@pytest.mark.parametrize("name", WRONG_RECORDINGS)
def test_remedy_of_a_recording(name, tmp_path):
    call, words = WRONG_RECORDINGS[name]
    message = outcome(lambda: call(tmp_path))
    assert message.count("\n") == 0
    assert re.search(words, message), message


VALID = {
    "classify": classify,
    "classify one view": lambda: classify(DEPTH[0], POSES[0]),
    "voxel_map": voxel_map,
    "compare_depth": compare,
    "an upright camera in a world with y up": lambda: classify(poses=Y_UP, up="y"),
    "poses with other axes": lambda: compare(poses=OPENGL, convention="opengl"),
    "other order": lambda: voxel_map_of(quaternion="wxyz"),
    "render": lambda: wv.render(SCENE, CAMERA, POSES),
    "perspective": lambda: wv.perspective(SCENE, agents(POSES[0])),
    "a person in a house with two floors": lambda: wv.perspective(SCENE, agents(moved((0, 0, 3))[0])),
    "a stair down": lambda: classify(ground_height=0.6, below_label=9),
    "cropped images": lambda: wv.Camera(160, 120, 142, 142, 20, 30),
    "resized images": lambda: wv.Camera(224, 224, 199, 266, 112, 112),
    "a calibrated camera": lambda: wv.Camera.from_K([[617, 0, 317.4], [0, 617.5, 246], [0, 0, 1]], 640, 480),
    "a wide camera": lambda: wv.Camera.from_fov(640, 480, hfov=2.6),
}


def voxel_map_of(**options):
    return wv.voxel_map(DEPTH, CAMERA, WXYZ, bounds=[[0, -2, 0], [4, 2, 2]], cell_size=0.1, **options)


@pytest.mark.parametrize("name", VALID)
def test_no_false_alarm(name):
    assert outcome(VALID[name]) == ""


def test_valid_recordings(tmp_path):
    for name in "ab":
        (tmp_path / name).mkdir()
    assert outcome(lambda: recording(tmp_path / "a")) == ""
    depth, poses = recording(tmp_path / "a")
    assert outcome(lambda: images(tmp_path / "b", TRAJECTORY, names=SECONDS)) == ""
    np.testing.assert_allclose(depth, np.where(np.isfinite(DEPTH), DEPTH, np.nan), atol=6e-4)
    np.testing.assert_allclose(poses_to_matrices(poses), MATRICES, atol=1e-6)


def test_40_cases():
    assert len(WRONG) + len(WRONG_RECORDINGS) >= 75
