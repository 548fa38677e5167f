# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses: conventions, matrices and quaternions, on the host and on devices."""

import numpy as np
import pytest
import warp as wp
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

import warpvis as wv
from warpvis.core.poses import host_poses, parse_poses, poses_to_matrices, poses_to_opencv

import reference


def with_unit_quaternions(poses):
    return np.c_[poses[:, :3], poses[:, 3:] / np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)]


rows = (
    arrays(np.float64, (3, 7), elements=st.floats(-10, 10))
    .filter(lambda poses: (np.linalg.norm(poses[:, 3:], axis=1) > 0.1).all())
    .map(with_unit_quaternions)
)

# Axes of each camera frame, in OpenCV's: x right, y down, z forward.
AXES = {
    "opencv": np.eye(3),
    "opengl": np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1]]),  # right, up, backward
    "ros_body": np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]),  # forward, left, up
    "ros_optical": np.eye(3),
}


@pytest.mark.smoke("ros_body", "opengl")
@pytest.mark.parametrize("convention", AXES)
@given(rows)
def test_conventions_are_converted_to_opencv(convention, poses):
    given_frame = poses_to_matrices(poses)[:, :3, :3]
    opencv = poses_to_matrices(poses_to_opencv(poses, convention))[:, :3, :3]
    # Column k of a rotation is axis k of the camera in the world.
    np.testing.assert_allclose(given_frame, opencv @ AXES[convention].T, atol=1e-12)


@given(rows)
def test_matrices_and_rows_are_equivalent(poses):
    matrices = poses_to_matrices(poses)
    np.testing.assert_allclose(poses_to_matrices(poses_to_opencv(matrices)), matrices, atol=1e-12)


@pytest.mark.parametrize("quaternion", [*np.eye(4), *(np.eye(4)[[0, 1, 2, 3]] + np.eye(4)[[1, 2, 3, 0]])])
def test_half_revolutions_round_trip_through_matrices(quaternion):
    """Rotations whose quaternions contain zeros, where a naive conversion divides by zero."""
    pose = np.array([1.0, 2, 3, *quaternion / np.linalg.norm(quaternion)])
    matrix = poses_to_matrices(pose)
    np.testing.assert_allclose(poses_to_matrices(poses_to_opencv(matrix)[0]), matrix, atol=1e-15)


def test_single_pose_is_one_view():
    pose = wv.look_at((0, 0, 1), (1, 0, 1))
    assert wv.core.poses.parse_poses(pose).shape == (1,)
    assert wv.core.poses.parse_poses(poses_to_matrices(pose)).shape == (1,)


def test_quaternions_are_normalized():
    stored = wv.core.poses.parse_poses([[0, 0, 0, 0, 0, 0, 1.0009]]).numpy()
    np.testing.assert_array_equal(stored, [[0, 0, 0, 0, 0, 0, 1]])


def test_look_at_is_upright():
    rotation = poses_to_matrices(wv.look_at((1, 2, 3), (4, 1, 2)))[:3, :3]
    forward = np.array([3.0, -1, -1]) / np.sqrt(11)
    np.testing.assert_allclose(rotation[:, 2], forward, atol=1e-12)
    assert rotation[2, 0] == pytest.approx(0)  # the image's x axis is level
    assert rotation[2, 1] < 0  # its y axis points down


def test_look_at_straight_down_with_another_up():
    rotation = poses_to_matrices(wv.look_at((0, 0, 2), (0, 0, 0), up=(1, 0, 0)))[:3, :3]
    np.testing.assert_allclose(rotation.T, [[0, -1, 0], [-1, 0, 0], [0, 0, -1]], atol=1e-12)


@pytest.mark.parametrize("convention", AXES)
def test_kernels_match_reference(convention, device):
    """Kernels that convert poses on a device, compared with NumPy."""
    from warpvis.kernels import poses as kernels

    rng = np.random.default_rng(0)
    poses = rng.normal(size=(20, 7)).astype(np.float32)
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    matrices = poses_to_matrices(poses).astype(np.float32)
    turn = Rotation.from_matrix(AXES[convention]).as_quat()
    out = wp.empty(20, dtype=wp.transform, device=device)

    given_poses = wp.array(poses, dtype=wp.transform, device=device)
    wp.launch(kernels.poses_to_opencv, dim=20, inputs=[given_poses, wp.quat(*turn), out], device=device)
    expected = poses_to_matrices(reference.poses_to_opencv(poses, turn))
    np.testing.assert_allclose(poses_to_matrices(out.numpy()), expected, atol=2e-6)

    given_matrices = wp.array(matrices, dtype=wp.mat44, device=device)
    wp.launch(kernels.poses_from_matrices, dim=20, inputs=[given_matrices, wp.quat(*turn), out], device=device)
    expected = reference.poses_from_matrices(matrices, turn)
    np.testing.assert_allclose(poses_to_matrices(out.numpy()), expected, atol=2e-6)


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("convention", AXES)
def test_poses_are_converted_between_all_conventions(convention, axes, device):
    """A pose relative to other axes maps points as the given pose does after conversion to its convention."""
    poses = np.random.default_rng(2).normal(size=(4, 7))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    given, wanted = np.eye(4), np.eye(4)
    given[:3, :3], wanted[:3, :3] = AXES[convention], AXES[axes]
    expected = poses_to_matrices(poses) @ given @ np.linalg.inv(wanted)
    arguments = {"convention": convention, "axes": axes}
    rows = [host_poses(poses.astype(np.float32), **arguments), host_poses(poses_to_matrices(poses), **arguments)]
    rows += [parse_poses(poses, device=device, **arguments).numpy()]
    there = wp.array(poses.astype(np.float32), device=device)
    rows += [parse_poses(there, device=device, **arguments).numpy()]
    for found in rows:
        np.testing.assert_allclose(poses_to_matrices(found), expected, atol=2e-6)
    if convention == axes:
        np.testing.assert_array_equal(rows[0], poses.astype(np.float32))


@pytest.mark.parametrize("convention", AXES)
@pytest.mark.parametrize("form", ["rows", "transforms", "matrices"])
def test_device_arrays_match_host_arrays(convention, form, device):
    """Warp arrays of every form yield the same poses as host arrays."""
    poses = np.random.default_rng(1).normal(size=(5, 7)).astype(np.float32)
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    expected = poses_to_matrices(wv.core.poses.parse_poses(poses, convention=convention).numpy())
    given = {
        "rows": lambda: wp.array(poses, dtype=wp.float32, device=device),
        "transforms": lambda: wp.array(poses, dtype=wp.transform, device=device),
        "matrices": lambda: wp.array(poses_to_matrices(poses).astype(np.float32), dtype=wp.mat44, device=device),
    }[form]()
    parsed = wv.core.poses.parse_poses(given, convention=convention, device=device)
    assert parsed.device == wp.get_device(device)
    np.testing.assert_allclose(poses_to_matrices(parsed.numpy()), expected, atol=2e-6)


SCENE = wv.Scene()
SCENE.add(([[0, 0, 1], [1, 0, 1], [0, 1, 1]], [[0, 1, 2]]), name="flag", movable=True)
CAMERA = wv.Camera.from_fov(8, 6, hfov=1.0)
IDENTITY = [0, 0, 0, 0, 0, 0, 1]

# Functions that take poses of 7 numbers, by the argument name in their messages.
TAKERS = {
    "camera_to_world": lambda rows: wv.render(SCENE, CAMERA, rows),
    "camera_to_world of floats": lambda rows: wv.render(SCENE, CAMERA, np.asarray(rows, dtype=np.float32)),
    "object_poses": lambda rows: wv.render(SCENE, CAMERA, IDENTITY, object_poses=rows),
    "object_poses of frames": lambda rows: wv.Frames.from_poses(IDENTITY, object_poses=rows),
    "poses": wv.Frames.from_poses,
    "pose of 'box'": lambda rows: wv.Scene().add(
        ([[0, 0, 1], [1, 0, 1], [0, 1, 1]], [[0, 1, 2]]), name="box", pose=rows
    ),
    "pose of 'eye'": lambda rows: wv.Agent("eye", CAMERA, rows),
    "candidates": lambda rows: wv.planning.best_views(SCENE, CAMERA, rows, objects=["flag"]),
}


@pytest.mark.parametrize("taker", TAKERS)
@pytest.mark.parametrize("length", [0.0, 0.5, 0.9985, 1.0015, 2.0, 1e6])
def test_non_unit_quaternions_are_rejected(taker, length):
    row = np.array([[0, 0, 0, 0, 0.6 * length, 0, 0.8 * length]])
    with pytest.raises(wv.errors.PoseError) as error:
        TAKERS[taker](row)
    assert f"{taker.split(' of f')[0]} must have quaternions of length 1, got {length:.6g}" in str(error.value)


@pytest.mark.parametrize("taker", TAKERS)
@pytest.mark.parametrize("length", [0.9992, 1.0008])
def test_nearly_unit_quaternions_are_accepted(taker, length):
    TAKERS[taker](np.array([[0, 0, 0, 0, 0.6 * length, 0, 0.8 * length]]))


def test_quaternion_first_rows_raise_an_explanatory_error():
    swapped = np.array([[0.5, 0.5, 0.5, 0.5, 3.0, 4.0, 1.0]])
    for take in TAKERS.values():
        with pytest.raises(wv.errors.PoseError, match="rows are x y z qx qy qz qw, position first"):
            take(swapped)


def test_ambiguous_ros_convention_is_rejected():
    for take in (
        lambda axes: wv.render(SCENE, CAMERA, IDENTITY, convention=axes),
        lambda axes: wv.Frames.from_poses([IDENTITY], convention=axes),
        lambda axes: wv.Agent("eye", CAMERA, IDENTITY, convention=axes),
        lambda axes: wv.read_frames("walk.txt", convention=axes),
        lambda axes: wv.maps.plan_visibility(SCENE, CAMERA, wv.look_at((0, 0, 0), (1, 0, 0)), convention=axes),
    ):
        with pytest.raises(
            wv.errors.PoseError, match=r'convention must be "ros_body" \(x forward.*"ros_optical" \(x right'
        ):
            take("ros")
        with pytest.raises(wv.errors.PoseError, match="must be one of 'opencv', 'opengl', 'ros_body', 'ros_optical'"):
            take("blender")
