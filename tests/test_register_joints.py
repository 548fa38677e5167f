# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Registration of joint positions, and of a camera by a robot with known joints."""

import math

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.scene.joints import Joint, JointTree, SceneJoints
from warpvis.scene.moving_joints import MovingJoints

CAMERA = wv.Camera(128, 96, 120.0, 120.0, 64, 48, near=0.1, far=8)
VIEW = np.array(wv.look_at((0.9, -1.3, 1.0), (0.1, 0, 0.5)))
ARM = ("pan", "shoulder", "elbow")
TRUTH = {"pan": 0.4, "shoulder": 0.5, "elbow": 0.9, "grip": 0.06, "wrist": 0.3}
OFFSET = math.radians(5)

# The right finger follows the left one, and is moved by `grip` in the opposite direction. The pose of the camera is
# determined by the asymmetric boxes of the links.
URDF = """<robot name="arm">
  <link name="base"><visual><geometry><box size=".3 .4 .1"/></geometry></visual></link>
  <link name="column"><visual><origin xyz="0 .02 .2"/><geometry><box size=".14 .2 .3"/></geometry></visual></link>
  <link name="upper"><visual><origin xyz="0 0 .2"/><geometry><box size=".1 .12 .4"/></geometry></visual>
    <visual><origin xyz=".06 0 .2"/><geometry><box size=".06 .06 .2"/></geometry></visual></link>
  <link name="lower"><visual><origin xyz="0 0 .15"/><geometry><box size=".08 .1 .3"/></geometry></visual></link>
  <link name="hand"><visual><geometry><box size=".1 .3 .04"/></geometry></visual></link>
  <link name="left"><visual><origin xyz="0 0 .06"/><geometry><box size=".06 .03 .1"/></geometry></visual></link>
  <link name="right"><visual><origin xyz="0 0 .06"/><geometry><box size=".06 .03 .1"/></geometry></visual></link>
  <link name="tool"/>
  <joint name="pan" type="continuous"><parent link="base"/><child link="column"/><axis xyz="0 0 1"/></joint>
  <joint name="shoulder" type="revolute"><parent link="column"/><child link="upper"/><origin xyz="0 0 .35"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 .4"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="wrist" type="continuous"><parent link="lower"/><child link="hand"/><origin xyz="0 0 .32"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="grip" type="prismatic"><parent link="hand"/><child link="left"/><axis xyz="0 1 0"/>
    <limit lower="0" upper=".12" effort="1" velocity="1"/></joint>
  <joint name="follower" type="prismatic"><parent link="hand"/><child link="right"/><axis xyz="0 -1 0"/>
    <limit lower="0" upper=".12" effort="1" velocity="1"/><mimic joint="grip"/></joint>
  <joint name="flange" type="revolute"><parent link="hand"/><child link="tool"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="weld" type="fixed"><parent link="hand"/><child link="cap"/></joint><link name="cap"/>
</robot>"""


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(URDF)
    return path


def robot(file, device="cpu", movable=True):
    scene = wv.Scene.load(file, movable=movable, device=device)
    scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", pose=(0, 0, -0.1, 0, 0, 0, 1))
    return scene


def measure(scene, values=TRUTH):
    poses = scene.joints.poses(values)
    return wv.render(scene, CAMERA, [VIEW] * len(poses), outputs="depth", object_poses=poses).depth.numpy()


def register(scene, depth, start, moving=ARM, **options):
    options = {"sigma": 0.003, "max_distance": 0.1, **options}
    return wv.register(scene, CAMERA, depth, VIEW, moving=moving, joint_positions=start, **options)


def test_arm_returns(device, file):
    """Hypotheses that are 5 degrees off, in one image.

    Errors of one sign add up to 15 degrees at the hand: with Huber's cost, that hypothesis ends in another minimum.
    """
    scene = robot(file, device)
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1)
    start = {**TRUTH, **{name: TRUTH[name] + OFFSET * row for name, row in zip(ARM, signs, strict=True)}}
    robust = register(scene, measure(scene)[0], start)
    wanted = np.array([TRUTH[name] for name in ARM])
    returned = np.abs(robust.joint_positions.numpy() - wanted).max(axis=1) < 1e-3
    assert returned[1:].all() and returned[robust.best()] and robust.converged.numpy()[1:].all()
    found = register(scene, measure(scene)[0], start, sigma=0.01, huber=math.inf, max_distance=0.3)
    positions = found.joint_positions.numpy()
    assert positions.shape == (8, 3) and found.converged.numpy().all()
    np.testing.assert_allclose(positions, np.tile(wanted, (8, 1)), atol=1e-3)
    assert found.covariance.shape == found.H.shape == (8, 3, 3) and found.b.shape == (8, 3)
    np.testing.assert_allclose(found.covariance.numpy() @ found.H.numpy(), np.tile(np.eye(3), (8, 1, 1)), atol=1e-9)
    values = {**TRUTH, **dict(zip(ARM, positions.T, strict=True))}
    np.testing.assert_allclose(found.object_poses.numpy(), scene.joints.poses(values), atol=1e-6)
    np.testing.assert_allclose(found.poses.numpy(), np.tile(np.float32(VIEW), (8, 1)), atol=1e-6)
    assert (found.inlier_ratio > 0.1).all() and found.best() in range(8)


def test_gripper_returns_with_its_follower(file):
    """Prismatic joint with a joint that follows it, and a wrist."""
    scene = robot(file)
    start = {**TRUTH, "grip": 0.04, "wrist": TRUTH["wrist"] - OFFSET}
    found = register(scene, measure(scene), start, ["wrist", "grip"])
    np.testing.assert_allclose(found.joint_positions.numpy(), [[TRUTH["wrist"], TRUTH["grip"]]], atol=1e-3)


def test_positions_stay_within_limits(file):
    scene = robot(file)
    depth = measure(scene, {**TRUTH, "grip": 0.12})
    depth -= 0.01  # the whole robot is nearer than the model
    found = register(scene, depth, {**TRUTH, "grip": 0.11}, ["grip", "elbow"])
    assert 0 <= found.joint_positions.numpy()[0, 0] <= 0.12


def test_worlds_of_views(file):
    """Views of two worlds, in which other joints have different values, and measured images of both."""
    scene = robot(file)
    worlds = {"pan": [0.4, -0.3], "shoulder": [0.5, 0.2], "elbow": 0.9}
    depth = measure(scene, worlds)[[1, 0, 1]]
    start = {**worlds, "elbow": 0.9 - OFFSET}
    found = register(scene, depth, start, ["elbow"], world_index=[1, 0, 1])
    np.testing.assert_allclose(found.joint_positions.numpy(), np.full((3, 1), 0.9), atol=1e-3)
    poses = scene.joints.poses({**worlds, "elbow": 0.9})
    np.testing.assert_allclose(found.object_poses.numpy(), poses[[1, 0, 1]], atol=2e-3)


def test_sensor_as_sigma(file):
    scene = robot(file)
    start = {**TRUTH, "elbow": TRUTH["elbow"] + OFFSET}
    found = register(scene, measure(scene), start, ["elbow"], sigma=wv.sensors.realsense_d435())
    np.testing.assert_allclose(found.joint_positions.numpy(), [[TRUTH["elbow"]]], atol=1e-3)


def test_invisible_joints_keep_their_positions(file):
    """The camera sees the base and the column only: other joints have infinite variances."""
    scene = robot(file)
    view, values = np.array(wv.look_at((0.0, -1.2, 0.1), (0, 0, 0.05))), {"pan": 0.3}
    camera = wv.Camera(96, 24, 120.0, 120.0, 48, 12, near=0.1, far=8)
    poses = scene.joints.poses(values)
    depth = wv.render(scene, camera, view, outputs="depth", object_poses=poses).depth.numpy()
    options = {"sigma": 0.003, "max_distance": 0.1, "moving": ("pan", "elbow")}
    found = wv.register(scene, camera, depth, view, joint_positions={"pan": 0.3 + OFFSET, "elbow": 0.1}, **options)
    np.testing.assert_allclose(found.joint_positions.numpy(), [[0.3, 0.1]], atol=1e-3)
    variances = np.diagonal(found.covariance.numpy()[0])
    assert 0 < variances[0] < 1 and variances[1] == math.inf


def test_jacobians_are_central_differences(file):
    joints, random = robot(file).joints, np.random.default_rng(0)
    names = ("pan", "shoulder", "elbow", "wrist", "grip")
    moving = MovingJoints(joints, names, TRUTH)
    positions = np.array([TRUTH[name] for name in names]) + random.uniform(-0.05, 0.05, (4, 5))
    worlds, step = np.zeros(4, dtype=int), 1e-6
    poses, jacobians = moving.evaluate(positions, worlds)
    links = joints.column_links
    rest = joints.link_poses()
    for k, name in enumerate(names):
        ahead, behind = (
            joints.link_poses({n: positions[:, i] + sign * step * (n == name) for i, n in enumerate(names)})
            for sign in (1, -1)
        )
        for column, link in enumerate(links):
            if not link:
                continue
            turn = Rotation.from_matrix(ahead[link][:, :3, :3] @ behind[link][:, :3, :3].swapaxes(1, 2)).as_rotvec()
            place = np.linalg.inv(rest[link][0]) @ [*joints.poses()[0, column, :3], 1]
            shift = ((ahead[link] - behind[link]) @ place)[:, :3]
            wanted = np.hstack([turn, shift]) / (2 * step)
            np.testing.assert_allclose(jacobians[:, column, :, k], wanted, atol=1e-6)
    assert np.abs(jacobians).max() > 0.5 and poses.shape == (4, len(links), 7)


@pytest.mark.parametrize("quaternion", ["xyzw", "wxyz"])
def test_camera_is_calibrated_by_the_robot(device, file, quaternion):
    """The camera's pose returns from 5 degrees and 5 cm off, by images of the robot in ten known postures."""
    scene = robot(file, device)
    values = {**TRUTH, "pan": np.linspace(-0.5, 0.8, 10)}
    random = np.random.default_rng(1)
    turn = Rotation.from_rotvec(OFFSET * np.array([0.6, 0, 0.8])) * Rotation.from_quat(VIEW[3:])
    start = np.concatenate([VIEW[:3] + 0.05 * np.array([0, 0.6, -0.8]), turn.as_quat()])
    if quaternion == "wxyz":
        start = start[[0, 1, 2, 6, 3, 4, 5]]
    depth = measure(scene, values) + random.normal(0, 1e-4, (10, *CAMERA.shape)).astype(np.float32)
    found = wv.register(
        scene, CAMERA, depth, start, sigma=0.003, joint_positions=values, max_distance=0.2, quaternion=quaternion
    )
    poses = found.poses.numpy().astype(float)
    np.testing.assert_allclose(poses[:, :3], np.tile(VIEW[:3], (10, 1)), atol=1e-3)
    turns = Rotation.from_quat(poses[:, 3:]) * Rotation.from_quat(VIEW[3:]).inv()
    assert turns.magnitude().max() < 1e-3 and found.joint_positions is None


BAD = {
    "empty": ((), {}, "moving must be .* or a list of names of joints, got \\(\\)"),
    "number": ((3,), {}, "moving must be .* or a list of names of joints, got .3,."),
    "unknown": (("ghost",), {}, "moving must be joints of the scene, got 'ghost'; the joints are 'pan', 'shoulder'"),
    "twice": (("pan", "pan"), {}, "moving must be one or more different joints, got 'pan' twice"),
    "follower": (("follower",), {}, "moving must be joints that follow no other joint, got 'follower', which follows"),
    "fixed": (("weld",), {}, "moving must be revolute, continuous or prismatic joints, got 'weld', which is fixed"),
    "empty link": (("flange",), {}, "moving must be joints that move movable objects, got 'flange'"),
    "limits": (("elbow",), {"joint_positions": {"elbow": 3}}, "values of 'elbow' must be from -2 to 2 rad, got 3"),
    "values": (("elbow",), {"joint_positions": [1]}, "values must be a mapping"),
    "string": ("elbow", {}, r"moving must be a list to move joints, \['elbow'\], got 'elbow'"),
    "worlds": (
        ("elbow",),
        {"joint_positions": {"elbow": [0.1, 0.2, 0.3]}, "camera_to_world": [VIEW] * 4},
        "joint_positions must be of one view or of 4 views, got 3",
    ),
    "poses": (("elbow",), {"object_poses": [[VIEW]]}, "object_poses must be None if joints move; give joint_positions"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input(name, file):
    moving, options, message = BAD[name]
    options = {"camera_to_world": VIEW, **options}
    with pytest.raises(wv.WarpvisError, match=message) as caught:
        wv.register(robot(file), CAMERA, np.ones(CAMERA.shape, np.float32), sigma=0.01, moving=moving, **options)
    assert "\n" not in str(caught.value)


def test_static_robots_and_scenes_without_joints(file):
    depth = np.ones(CAMERA.shape, np.float32)
    with pytest.raises(wv.WarpvisError, match="got 'pan', whose links are static or have no geometry; load"):
        wv.register(robot(file, movable=False), CAMERA, depth, VIEW, sigma=0.01, moving=["pan"])
    scene = wv.Scene()
    scene.add(trimesh.creation.box((1, 1, 1)), name="cup", movable=True)
    with pytest.raises(wv.WarpvisError, match="moving must be joints of the scene, got 'pan' for a scene without joi"):
        wv.register(scene, CAMERA, depth, VIEW, sigma=0.01, moving=["pan"])


def test_covariance_is_that_of_repeated_measurements(file):
    """The mean of the squared Mahalanobis distances of 150 results is 3, within 30 % for Huber's cost."""
    scene, random, count = robot(file), np.random.default_rng(6), 150
    depth = np.repeat(measure(scene), count, axis=0)
    depth += random.normal(0, 0.003, depth.shape).astype(np.float32)
    found = register(scene, depth, TRUTH, huber=3.0)
    errors = found.joint_positions.numpy() - [TRUTH[name] for name in ARM]
    squares = np.einsum("vi,vij,vj->v", errors, found.H.numpy(), errors)
    assert found.converged.numpy().mean() > 0.9
    assert squares.mean() == pytest.approx(3, rel=0.3)


def test_other_joints_keep_their_values():
    """A floating base of two worlds, given as rows or matrices, and a planar joint below it."""
    shared = {"origin": np.eye(4), "axis": (0, 0, 1)}
    tree = JointTree(
        [
            Joint("base", "floating", "world", "body"),
            Joint("drift", "planar", "body", "plate", **shared),
            Joint("turn", "continuous", "plate", "arm", **shared),
        ]
    )
    joints = SceneJoints(tree, ["body", "arm", None], np.tile([0, 0, 0, 0, 0, 0, 1.0], (3, 1)).astype(np.float32))
    rows = np.array([[1, 2, 3, 0, 0, 0, 1], [4, 5, 6, 0.6, 0, 0, 0.8]])
    for base in (rows, poses_to_matrices(rows)):
        moving = MovingJoints(joints, ["turn"], {"base": base, "drift": (0.1, 0.2, 0.3), "turn": 0.5})
        assert moving.bodies().tolist() == [-1, 1, -1] and moving.positions.tolist() == [[0.5], [0.5]]
        poses, jacobians = moving.evaluate(np.array([[0.5], [0.7], [0.9]]), np.array([1, 0, 1]))
        values = {"base": rows[[1, 0, 1]], "drift": (0.1, 0.2, 0.3), "turn": [0.5, 0.7, 0.9]}
        np.testing.assert_array_equal(poses, joints.poses(values))
        axis = poses_to_matrices(rows)[[1, 0, 1], :3, 2]
        np.testing.assert_allclose(jacobians[:, 1, :3, 0], axis, atol=1e-12)
        assert not jacobians[:, [0, 2]].any()
