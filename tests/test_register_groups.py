# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Registration of poses that move together: cameras on a hand, objects in a hand, offsets of joints."""

import numpy as np
import pytest
import trimesh
from test_register import CAMERA, MUG, SIGMA, TRUTH, difference, measure, perturbed, room
from test_register_joints import ARM, CAMERA as ARM_CAMERA, TRUTH as ARM_TRUTH, VIEW, file, robot  # noqa: F401

import warpvis as wv

import reference

VIEWS = np.array([TRUTH, wv.look_at((1.0, -1.5, 1.2), (2.5, 0.5, 0.6)), wv.look_at((0, 0.5, 1.8), (2, 0, 0.7))])
IDENTITY = np.array([0, 0, 0, 0, 0, 0, 1.0])


def after(poses, motions):
    """Return poses after a motion in their own frames, or after one for each of them."""
    return reference.move_views(np.arange(len(poses)), poses, np.broadcast_to(motions, poses.shape))


def test_twins_in_double_precision(device):
    """Sums at the initial poses, of groups that are not in the order of views."""
    scene, random = room(device), np.random.default_rng(5)
    start = after(VIEWS[[0, 1, 2, 0]], perturbed(IDENTITY, random))
    depth, groups = measure(scene, poses=VIEWS[[0, 1, 2, 0]]), np.array([7, 2, 7, 2])
    options = {"sigma": SIGMA, "tolerance": 100.0}
    alone = wv.register(scene, CAMERA, depth, start, **options)
    found = wv.register(scene, CAMERA, depth, start, groups=groups, **options)
    members, initial = groups // 7, np.float32(start).astype(float)
    H, b = reference.add_groups(members, initial, alone.H.numpy(), alone.b.numpy())
    matrices, sides = reference.spread_sums(members, initial, H, b)
    np.testing.assert_allclose(found.H.numpy(), matrices, rtol=1e-9, atol=1e-9 * np.abs(matrices).max())
    np.testing.assert_allclose(found.b.numpy(), sides, rtol=1e-9, atol=1e-9 * np.abs(sides).max())
    for name in ("e", "num_inliers", "num_measured"):
        values = getattr(alone, name).numpy().astype(float)
        np.testing.assert_allclose(getattr(found, name).numpy(), (values[[2, 3, 0, 1]] + values), rtol=1e-12)
    np.testing.assert_allclose(found.covariance.numpy() @ matrices, np.tile(np.eye(6), (4, 1, 1)), atol=1e-9)
    motions = np.array([reference.step_poses(IDENTITY, *sums) for sums in zip(H, b, strict=True)])
    assert max(difference(found.poses.numpy().astype(float), reference.move_views(members, initial, motions))) < 1e-6


def test_camera_on_a_hand_returns(device):
    """The mounting of a camera is found from three images, for several hypotheses at once, each as if alone."""
    scene, random = room(device), np.random.default_rng(6)
    errors = np.array([perturbed(IDENTITY, random) for _ in range(4)])
    start = np.concatenate([after(VIEWS, error) for error in errors])
    depth = measure(scene, poses=VIEWS)
    found = wv.register(scene, CAMERA, np.tile(depth, (4, 1, 1)), start, sigma=SIGMA, groups=np.repeat(np.arange(4), 3))
    assert max(difference(found.poses.numpy(), np.tile(VIEWS, (4, 1)))) < 1e-5
    assert found.converged.numpy().all() and found.iterations.numpy().max() < 15
    alone = wv.register(scene, CAMERA, depth, start[3:6], sigma=SIGMA, groups=[0, 0, 0])
    for name in ("poses", "H", "covariance", "e", "iterations"):
        np.testing.assert_array_equal(getattr(alone, name).numpy(), getattr(found, name).numpy()[3:6])


def test_groups_of_one_view_change_nothing(device):
    scene, random = room(device), np.random.default_rng(7)
    start = np.array([perturbed(pose, random) for pose in VIEWS])
    depth = measure(scene, poses=VIEWS)
    found = wv.register(scene, CAMERA, depth, start, sigma=SIGMA, groups=np.arange(3))
    wanted = wv.register(scene, CAMERA, depth, start, sigma=SIGMA)
    assert max(difference(found.poses.numpy(), wanted.poses.numpy())) < 1e-6
    np.testing.assert_array_equal(found.iterations.numpy(), wanted.iterations.numpy())


def test_images_together_determine_a_pose(device):
    """Each image shows one plane, which leaves three degrees of freedom open."""
    scene = wv.Scene(device=device)
    for k, normal in enumerate(np.eye(3)):
        scene.add(trimesh.creation.box(np.where(normal, 0.1, 3)), name=str(k), pose=(*(-1.5 * normal), 0, 0, 0, 1))
    poses = np.array([wv.look_at((0.5, 0.4, 0.3), target) for target in 0.2 - 1.7 * np.eye(3)])
    depth = measure(scene, poses=poses, camera=wv.Camera(32, 24, 60.0, 60.0, 16, 12))
    start = after(poses, perturbed(IDENTITY, np.random.default_rng(8), 0.03, 0.03))
    camera = wv.Camera(32, 24, 60.0, 60.0, 16, 12)
    alone = wv.register(scene, camera, depth, start, sigma=0.01)
    assert np.isinf(alone.covariance.numpy()).all()
    found = wv.register(scene, camera, depth, start, sigma=0.01, groups=[0, 0, 0])
    assert np.isfinite(found.covariance.numpy()).all() and found.converged.numpy().all()
    assert max(difference(found.poses.numpy(), poses)) < 1e-5


def test_object_in_a_hand_returns(device):
    """One grasp in several worlds; the hand's poses are known."""
    scene, random = room(device), np.random.default_rng(9)
    hands = np.array([after(MUG[None], perturbed(IDENTITY, random, 0.4, 0.1))[0] for _ in range(3)])
    cart = np.tile([2, 0.6, 0.9, 0, 0, 0, 1.0], (3, 1))
    truth, start = (
        np.stack([rows, cart], axis=1) for rows in (hands, after(hands, perturbed(IDENTITY, random, 0.06, 0.02)))
    )
    depth = measure(scene, poses=np.tile(TRUTH, (3, 1)), object_poses=truth)
    found = wv.register(
        scene, CAMERA, depth, TRUTH, sigma=SIGMA, moving="mug", object_poses=start, groups=[1, 1, 1], max_distance=0.1
    )
    assert found.converged.numpy().all()
    assert max(difference(found.object_poses.numpy(), np.float32(truth))) < 1e-4
    assert max(difference(found.poses.numpy(), hands)) < 1e-4


def test_offsets_of_joints_return(device, file):
    """Encoders with constant errors, from images of two postures."""
    scene = robot(file, device)
    postures = {**ARM_TRUTH, "pan": np.array([0.4, -0.3]), "shoulder": np.array([0.5, 0.9])}
    poses = scene.joints.poses(postures)
    depth = wv.render(scene, ARM_CAMERA, [VIEW] * 2, outputs="depth", object_poses=poses).depth.numpy()
    errors = np.radians([4.0, -3.0, 3.0])
    start = {name: np.broadcast_to(postures[name], 2) + error for name, error in zip(ARM, errors, strict=True)}
    options = {"sigma": 0.01, "max_distance": 0.3, "moving": ARM}
    found = wv.register(scene, ARM_CAMERA, depth, VIEW, joint_positions={**postures, **start}, groups=[0, 0], **options)
    wanted = np.stack([np.broadcast_to(postures[name], 2) for name in ARM], axis=-1)
    np.testing.assert_allclose(found.joint_positions.numpy(), wanted, atol=1e-3)
    np.testing.assert_allclose(np.diff(found.joint_positions.numpy(), axis=0), np.diff(wanted, axis=0), atol=1e-12)
    np.testing.assert_array_equal(*found.H.numpy())
    np.testing.assert_allclose(found.object_poses.numpy(), poses, atol=2e-3)

    # A reading near the limit of 2 does not stop the offset of the others.
    postures = {**ARM_TRUTH, "elbow": np.array([1.98, 0.9]) + 0.05}
    poses = scene.joints.poses(postures, check_limits=False)
    depth = wv.render(scene, ARM_CAMERA, [VIEW] * 2, outputs="depth", object_poses=poses).depth.numpy()
    readings = {**postures, "elbow": postures["elbow"] - 0.05}
    options["moving"] = ["elbow"]
    found = wv.register(scene, ARM_CAMERA, depth, VIEW, joint_positions=readings, groups=[0, 0], **options)
    np.testing.assert_allclose(found.joint_positions.numpy()[:, 0], postures["elbow"], atol=1e-3)


@pytest.mark.parametrize(
    ("groups", "got"),
    [
        ([0, 0], r"int64 \(2,\)"),
        ([0, 0, -1], "-1"),
        ([0.0, 1.0, 1.0], r"float64 \(3,\)"),
        ([[0], [0], [0]], r"int64 \(3, 1\)"),
        (0, r"int64 \(\)"),
        ([0, 0, 0, 0], r"int64 \(4,\)"),
    ],
)
def test_bad_groups(groups, got):
    with pytest.raises(wv.errors.ArrayError, match=f"groups must be .* 3 integers from 0, got {got}"):
        wv.register(room(), CAMERA, np.ones((3, 72, 96), np.float32), VIEWS, sigma=SIGMA, groups=groups)


def test_images_of_one_pose_need_no_copies_of_it():
    scene = room()
    depth = np.repeat(measure(scene), 3, axis=0)
    found = wv.register(scene, CAMERA, depth, perturbed(TRUTH, np.random.default_rng(0)), sigma=SIGMA, groups=[0, 0, 0])
    assert max(difference(found.poses.numpy(), np.tile(TRUTH, (3, 1)))) < 1e-5
