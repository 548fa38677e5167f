# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The fitted floor against the floor of rendered rooms, measured by exact and noisy cameras."""

import math

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.core.poses import poses_to_matrices, quaternion_product
from warpvis.errors import ArrayError, CameraError, PoseError

CAMERA = wv.Camera(320, 240, 262.5, 262.5, 160, 120, near=0.3, far=8.0)
# The table is the largest plane of the image of a camera that looks down at it.
TABLE = (1.4, 0.9, 0.04), (0.1, 1.35, 0.73)
WALLS = [((8, 0.1, 3), (0, 4.5, 1.0)), ((0.1, 8, 3), (-3, 2, 1.0))]
FLOOR = (8, 8, 0.1), (0, 2, -0.05)
# A landing of 2 m in front of the camera, four steps, and the lower floor.
STAIR = [
    ((6, 4, 0.1), (0, 0, -0.05)),
    *(((6, 0.28, 0.1), (0, 2.14 + 0.28 * k, -0.22 - 0.17 * k)) for k in range(4)),
    ((6, 4, 0.1), (0, 5.12, -0.9)),
]


def room(*boxes):
    scene = wv.Scene(device="cpu")
    for size, center in boxes:
        mesh = trimesh.creation.box(size)
        mesh.apply_translation(center)
        scene.add(mesh)
    return scene


def camera_pose(height, tilt, roll=0.0):
    """Return the pose of a camera above the origin that looks along y, tilted down and rolled [degrees]."""
    tilt, half = math.radians(tilt), math.radians(roll) / 2
    pose = np.array(wv.look_at((0, 0, height), (0, math.cos(tilt), height - math.sin(tilt))))
    pose[3:] = quaternion_product(pose[3:], np.array([0, 0, math.sin(half), math.cos(half)]))
    return pose


def measure(scene, pose, sensor=None):
    return wv.render(scene, CAMERA, pose, sensor=sensor).depth.numpy()[0]


def errors(fit, pose):
    """Return the angle to the true normal [degrees], and the error of the height [m]; the input is the camera frame."""
    up = poses_to_matrices(pose)[2, :3]
    return math.degrees(math.acos(min(1.0, float(fit.plane[:3] @ up)))), abs(fit.camera_height - pose[2])


KITCHEN = room(FLOOR, *WALLS, TABLE)
TILTED = camera_pose(1.3, 18)
SENSORS = {
    "exact": None,
    "kinect": wv.sensors.kinect_v1(width=320, height=240),
    "d435": wv.sensors.realsense_d435(width=320, height=240),
}


@pytest.mark.filterwarnings("ignore:fx of the camera")
@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize(("tilt", "roll"), [(25, 0), (30, 20), (30, -30), (45, 10), (60, 0)])
def test_floor_below_a_table_is_found(tilt, roll, sensor):
    pose = camera_pose(1.3, tilt, roll)
    fit = wv.fit_floor(measure(KITCHEN, pose, SENSORS[sensor]), CAMERA)
    angle, offset = errors(fit, pose)
    assert angle < 1.0 and offset < max(0.01, 2 * fit.height_sigma)
    assert angle < max(0.05, 2 * math.degrees(fit.tilt_sigma))
    assert 0 < fit.inlier_fraction <= 1 and fit.sigma < 0.02
    # The errors of a D435 at 5 m have a standard deviation of some 2 cm, which reduces the confidence.
    if tilt < 50:
        assert fit.confidence > (0.35 if sensor == "d435" else 0.5)


def test_plane_matches_a_fit_to_the_true_floor():
    """An independent fit by SVD, in double precision, to the pixels that are on the floor."""
    pose = camera_pose(1.3, 30)
    depth = measure(KITCHEN, pose).astype(np.float64)
    depth += np.random.default_rng(3).normal(0, 0.002, depth.shape) * depth**2
    truth = wv.render(KITCHEN, CAMERA, pose, outputs=("depth", "segmentation"))
    on_floor = (truth.segmentation.numpy()[0] == 0) & np.isfinite(depth)
    y, x = np.nonzero(on_floor)
    rays = np.stack([(x + 0.5 - 160) / 262.5, (y + 0.5 - 120) / 262.5, np.ones(len(x))], axis=1)
    points = rays * depth[on_floor][:, None]
    weights = 1 / (0.004 + 0.003 * np.linalg.norm(points, axis=1) * 1.3)
    mean = weights**2 @ points / (weights**2).sum()
    normal = np.linalg.svd((points - mean) * weights[:, None], full_matrices=False)[2][2]
    fit = wv.fit_floor(depth.astype(np.float32), CAMERA)
    assert abs(float(normal @ fit.plane[:3])) > math.cos(math.radians(0.1))
    assert abs(abs(float(normal @ mean)) - fit.camera_height) < 0.002
    assert fit.inlier_fraction == pytest.approx(on_floor.sum() / np.isfinite(depth).sum(), abs=0.05)


def test_transforms_put_the_floor_at_zero():
    truth = camera_pose(1.3, 35, 8)
    # A world that is turned, tilted and shifted against the room's.
    world = np.array([3.0, -2.0, 5.0, 0.1, 0.2, 0.3, math.sqrt(1 - 0.14)])
    matrix = poses_to_matrices(world)
    given = matrix @ poses_to_matrices(truth)
    fit = wv.fit_floor(measure(KITCHEN, truth), CAMERA, given, up=matrix[:3, 2])
    corners = np.array([[0, 1, 0], [1, 3, 0], [-1, 2, 0], [0, 1, 0.7]]) @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(fit.heights(corners), [0, 0, 0, 0.7], atol=2e-3)
    turn = poses_to_matrices(fit.world_from_input)
    moved = corners @ turn[:3, :3].T + turn[:3, 3]
    np.testing.assert_allclose(moved[:, 2], fit.heights(corners), atol=1e-9)
    np.testing.assert_allclose(turn @ given, poses_to_matrices(fit.camera_to_world), atol=1e-9)
    assert fit.camera_to_world[2] == pytest.approx(fit.camera_height, abs=1e-9)
    assert np.linalg.norm(fit.plane[:3]) == pytest.approx(1)
    # The smallest rotation has no vertical axis: it keeps the yaw.
    assert fit.world_from_input[5] == 0


def test_result_is_the_floor_of_other_functions():
    pose = camera_pose(1.3, 35)
    depth = measure(KITCHEN, pose)
    fit = wv.fit_floor(depth, CAMERA)
    labels = wv.classify(depth, CAMERA, fit.camera_to_world, ground_tolerance=0.02).numpy()
    expected = wv.classify(depth, CAMERA, pose, ground_tolerance=0.02).numpy()
    assert (labels == expected).mean() > 0.99


def test_points_and_depth_have_the_same_floor():
    pose = camera_pose(1.3, 30)
    depth = measure(KITCHEN, pose)
    points = wv.back_project(depth[None], CAMERA, pose)
    fit = wv.fit_floor(points, camera_to_world=pose, up=(0, 0, 1))
    assert np.degrees(np.arccos(fit.plane[2])) < 0.1 and abs(fit.plane[3]) < 0.003
    other = wv.fit_floor(depth, CAMERA, pose, up=(0, 0, 1))
    np.testing.assert_allclose(fit.plane, other.plane, atol=2e-3)


def test_result_is_the_same_in_every_run():
    depth = measure(KITCHEN, camera_pose(1.3, 30), SENSORS["exact"])
    first, second = wv.fit_floor(depth, CAMERA), wv.fit_floor(depth, CAMERA)
    assert (first.plane == second.plane).all() and first.confidence == second.confidence


@pytest.mark.parametrize("tilt", [20, 40])
def test_stair_down_is_reported(tilt):
    pose = camera_pose(1.0, tilt)
    depth = measure(room(*STAIR), pose)
    fit = wv.fit_floor(depth, CAMERA)
    assert fit.confidence < 0.5 and any("stair" in problem and "1.00 m below" in problem for problem in fit.problems)
    known = wv.fit_floor(depth, CAMERA, camera_height=1.0)
    angle, offset = errors(known, pose)
    assert angle < 1 and offset < 0.01 and known.confidence > 0.5


def test_stair_up_is_not_a_ramp():
    """Far away, a plane through the edges of stairs is within the tolerance of their points, but not parallel."""
    steps = [((3, 0.28, 0.17), (0, 2.14 + 0.28 * k, 0.085 + 0.17 * k)) for k in range(10)]
    pose = camera_pose(1.3, 15)
    fit = wv.fit_floor(measure(room(FLOOR, *steps), pose, SENSORS["kinect"]), CAMERA)
    angle, offset = errors(fit, pose)
    assert (angle < 1 and offset < 0.02) or (fit.confidence < 0.5 and fit.problems)


def add_noise(depth, noise):
    """Add independent normal errors whose standard deviation is `noise` at 1 m, and grows with the square of depth."""
    return depth + np.random.default_rng(1).normal(0, noise, depth.shape) * depth**2


@pytest.mark.parametrize("noise", [0.0008, 0.0014])
@pytest.mark.parametrize("count", [6, 9])
def test_floor_in_front_of_a_stair_is_found(count, noise):
    """The steps between walls fill the image but for 25 rows: they are no ramp, and their edges are no noise."""
    steps = [((2, 0.28, 0.17), (0, 2.34 + 0.28 * k, 0.085 + 0.17 * k)) for k in range(count)]
    end, top = 2.2 + 0.28 * count, 0.17 * count
    landing = (2, 3, 0.1), (0, end + 1.5, top - 0.05)
    walls = [((0.1, 12, 4), (-1.15, 3, 2)), ((0.1, 12, 4), (1.15, 3, 2)), ((4, 0.1, 5), (0, end + 2.5, 2.5))]
    camera, pose = wv.Camera(320, 180, 176, 176, 160, 86, near=0.3, far=8.0), camera_pose(1.6, 14)
    depth = wv.render(room(FLOOR, *steps, landing, *walls), camera, pose).depth.numpy()[0]
    angle, offset = errors(wv.fit_floor(add_noise(depth, noise), camera), pose)
    assert angle < 0.5 and offset < 0.01


@pytest.mark.parametrize(("height", "x"), [(0.05, 1.4), (0.06, 1.1), (0.06, 1.4), (0.06, 1.7)])
def test_low_object_is_not_a_part_of_the_floor(height, x):
    """A plane between a low object and the floor has more points than the floor within 4 cm."""
    depth = measure(room(FLOOR, ((8, 0.1, 3), (0, 2.35, 1.5)), ((1.6, 0.9, height), (x, 1.9, height / 2))), TILTED)
    fit = wv.fit_floor(add_noise(depth, 0.0014), CAMERA)
    angle, offset = errors(fit, TILTED)
    assert angle < 0.2 and offset < 0.005 and fit.confidence > 0.5


@pytest.mark.parametrize("direction", [0, 1])
def test_curved_depth_reduces_the_confidence(direction):
    """Uncalibrated cameras bend planes: here, 6 cm at the border of the image at 2 m."""
    pose = camera_pose(1.3, 35)
    depth = measure(room(FLOOR, *WALLS), pose).astype(np.float64)
    position = (np.indices(depth.shape)[direction] + 0.5) / depth.shape[direction] - 0.5
    straight = wv.fit_floor(depth, CAMERA)
    bent = wv.fit_floor(depth * (1 + 0.12 * position**2), CAMERA)
    assert straight.confidence > 0.9 and not straight.problems
    assert math.degrees(bent.tilt_sigma) > 0.5 > math.degrees(straight.tilt_sigma)
    assert bent.confidence < 0.8 and any("parts of the floor differ" in problem for problem in bent.problems)
    assert errors(bent, pose)[0] < 3 * math.degrees(bent.tilt_sigma)


def test_errors_of_curved_depth_are_those_expected():
    """The root mean square of errors in units of their standard deviations is near 1."""
    random, scene = np.random.default_rng(4), room(FLOOR, *WALLS)
    y, x = ((np.indices((240, 320)) + 0.5) - np.array([120, 160])[:, None, None]) / 160
    angles, offsets = [], []
    for _ in range(24):
        pose = camera_pose(random.uniform(0.8, 1.7), random.uniform(15, 40))
        depth = measure(scene, pose).astype(np.float64)
        curve = np.tensordot(random.normal(0, 0.015, 3), np.stack([x * x, y * y, x * y]), 1)
        fit = wv.fit_floor(add_noise(depth * (1 + depth / 2 * curve), 0.001), CAMERA)
        angle, offset = errors(fit, pose)
        angles.append(math.radians(angle) / fit.tilt_sigma)
        offsets.append(offset / fit.height_sigma)
    assert 0.5 < np.sqrt(np.mean(np.square(angles))) < 1.5
    assert 0.5 < np.sqrt(np.mean(np.square(offsets))) < 1.5


def test_inliers_are_the_pixels_of_the_floor():
    pose = camera_pose(1.3, 35)
    depth = measure(KITCHEN, pose, SENSORS["kinect"])
    on_floor = wv.render(KITCHEN, CAMERA, pose, outputs="segmentation").segmentation.numpy()[0] == 0
    for image in (depth, depth[None]):
        fit = wv.fit_floor(image, CAMERA)
        assert fit.inliers.shape == image.shape and fit.inliers.dtype == bool and not fit.inliers.flags.writeable
        measured = np.isfinite(image)
        assert not fit.inliers[~measured].any()
        assert (fit.inliers == on_floor)[measured].mean() > 0.97
    points = wv.back_project(depth[None], CAMERA, pose).numpy()[0]
    fit = wv.fit_floor(points.reshape(-1, 3), camera_to_world=pose, up=(0, 0, 1))
    assert fit.inliers.shape == (depth.size,)
    assert (fit.inliers == on_floor.ravel())[np.isfinite(points[..., 0]).ravel()].mean() > 0.97


def test_step_is_reported():
    pose = camera_pose(1.3, 35)
    fit = wv.fit_floor(measure(room(FLOOR, ((8, 2, 0.15), (0, 3.2, 0.075))), pose), CAMERA)
    angle, offset = errors(fit, pose)
    assert angle < 1 and offset < 0.01
    assert any("0.15 m above" in problem for problem in fit.problems)


def test_wall_is_not_a_floor():
    scene = room(FLOOR, *WALLS)
    fit = wv.fit_floor(measure(scene, camera_pose(1.3, -30)), CAMERA)
    assert fit.confidence < 0.5 and any("wall" in problem for problem in fit.problems)
    with pytest.raises(ArrayError, match="measured must show a floor"):
        wv.fit_floor(measure(scene, camera_pose(1.3, -30)), CAMERA, up=(0, -0.87, 0.5))


def test_table_alone_is_not_a_floor():
    pose = camera_pose(1.3, 50)
    depth = measure(room(TABLE), pose)
    fit = wv.fit_floor(depth, CAMERA)
    assert fit.confidence < 0.5 and any("table" in problem for problem in fit.problems)
    with pytest.raises(ArrayError, match=r"camera_height must be within 0\.15 m"):
        wv.fit_floor(depth, CAMERA, camera_height=1.3)


def test_slope_is_reported():
    pose = camera_pose(1.3, 30)
    up = poses_to_matrices(camera_pose(1.3, 37))[2, :3]
    fit = wv.fit_floor(measure(KITCHEN, pose), CAMERA, up=up)
    assert errors(fit, pose)[0] < 1
    assert any("slopes by 7.0 degrees" in problem for problem in fit.problems)


def test_reflections_below_the_floor_are_ignored():
    pose = camera_pose(1.3, 40)
    depth = measure(room(FLOOR), pose)
    depth[60:90, 100:220:3] *= 1.4
    fit = wv.fit_floor(depth, CAMERA)
    angle, offset = errors(fit, pose)
    assert angle < 0.2 and offset < 0.005 and fit.confidence > 0.5
    assert not any("below the plane" in problem for problem in fit.problems)


DEPTH = np.full((240, 320), 2.0, np.float32)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"camera": None}, ArrayError, r"measured must be points of shape \(..., 3\)"),
        ({"measured": DEPTH[:100], "camera": CAMERA}, ArrayError, "measured must have shape"),
        ({"measured": DEPTH * 1000, "camera": CAMERA}, ArrayError, "measured must be in meters"),
        ({"measured": DEPTH * 0, "camera": CAMERA}, ArrayError, "measured must have 100 points"),
        ({"measured": DEPTH, "camera": 3}, CameraError, "camera must be"),
        ({"up": (0, 0, 0)}, ArrayError, "up must be a direction"),
        ({"up_tolerance": 30}, ArrayError, "up_tolerance must be"),
        ({"camera_height": -1}, ArrayError, "camera_height must be"),
        ({"height_tolerance": 0}, ArrayError, "height_tolerance must be"),
        ({"noise": 3.0}, ArrayError, "noise must be"),
        ({"seed": -1}, ArrayError, "seed must be"),
        ({"convention": "ros"}, PoseError, "convention must be"),
        ({"camera_to_world": np.tile(camera_pose(1, 0), (2, 1))}, PoseError, "camera_to_world must be one pose"),
    ],
)
def test_bad_arguments_raise(arguments, error, message):
    with pytest.raises(error, match=message):
        wv.fit_floor(**{"measured": DEPTH, "camera": CAMERA, **arguments})


def test_heights_need_points():
    fit = wv.fit_floor(measure(KITCHEN, camera_pose(1.3, 30)), CAMERA)
    with pytest.raises(ArrayError, match=r"points must have shape \(..., 3\)"):
        fit.heights([1.0, 2.0])
