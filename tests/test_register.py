# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Registration of poses to measured depth: sums and steps of the reference, known poses, noise, outliers, bad input."""

import math

import numpy as np
import pytest
import trimesh
import warp as wp
from scipy.spatial.transform import Rotation

import warpvis as wv
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.gradients import normal_equations, normal_rows
from warpvis.scenes import PRESETS

import reference

CAMERA = wv.Camera(96, 72, 84.0, 84.0, 48, 36, near=0.1, far=15)
TRUTH = np.array(wv.look_at((0.2, -1.0, 1.5), (2, 0, 0.7)))
# Three faces of the mug, a box, are visible: its corner points toward the camera.
MUG = np.array([1.6, 0.1, 1.0, *Rotation.align_vectors([TRUTH[:3] - (1.6, 0.1, 1.0)], [(1, 1, 1)])[0].as_quat()])
SIGMA = 0.01
LENS = wv.cameras.lenses.KannalaBrandt(60.0, 60.0, 48, 36, (0.02, 0, 0, 0))


def lidar():
    azimuth, elevation = np.meshgrid(np.linspace(-1.2, 1.2, 90), np.linspace(-0.6, 0.5, 40))
    parts = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    rays = np.stack(parts, axis=-1)
    return wv.cameras.Rays(rays, 0.03 * rays, near=0.1, far=20, axes="ros_body")


CAMERAS = {
    "pinhole": CAMERA,
    "lens": wv.cameras.LensCamera(LENS, 96, 72, 0.1, 15, kind="z"),
    "range": wv.cameras.LensCamera(LENS, 96, 72, 0.1, 15, kind="range"),
    "orthographic": wv.cameras.OrthographicCamera(96, 72, 30.0, 30.0, 48, 36, far=15),
    "panorama": wv.cameras.WideCamera(96, 48, 3.0, far=15),
    "lidar": lidar(),
}


def room(device="cpu"):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((9, 9, 0.1)), name="floor", pose=(1, 0, -0.05, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.1, 9, 6)), name="wall", pose=(4, 0, 2, 0, 0, 0.1, 0.995))
    scene.add(trimesh.creation.box((9, 0.1, 6)), name="side", pose=(1, 3, 2, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((1.0, 1.6, 0.1)), name="table", pose=(2.2, 0, 0.75, 0, 0, 0, 1))
    mug = trimesh.creation.box((0.3, 0.2, 0.4))
    scene.add(mug, name="mug", pose=MUG, movable=True)
    scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="cart", pose=(2, 0.6, 0.9, 0, 0, 0, 1), movable=True)
    return scene


def perturbed(pose, random, angle=0.0873, distance=0.05):
    axis, offset = (vector / np.linalg.norm(vector) for vector in random.normal(size=(2, 3)))
    turned = Rotation.from_rotvec(angle * axis) * Rotation.from_quat(pose[3:])
    return np.concatenate([pose[:3] + distance * offset, turned.as_quat()])


def difference(found, truth):
    """Return the largest distance [m] and angle [rad] between poses."""
    turn = Rotation.from_quat(found[..., 3:].reshape(-1, 4)).inv() * Rotation.from_quat(truth[..., 3:].reshape(-1, 4))
    return np.abs(found[..., :3] - truth[..., :3]).max(), turn.magnitude().max()


def measure(scene, camera=CAMERA, poses=TRUTH, **options):
    return wv.render(scene, camera, poses, outputs="depth", **options).depth.numpy()


def sums(found, view=0):
    return [getattr(found, name).numpy()[view] for name in ("H", "b", "e", "num_inliers", "num_measured")]


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("moving", ["camera", "mug"])
@pytest.mark.parametrize("max_jump", [None, 0.2])
def test_twins_in_double_precision(device, name, moving, max_jump):
    """Sums at the initial pose; invalid pixels of all kinds, and residuals of all sizes."""
    scene, camera, random = room(device), CAMERAS[name], np.random.default_rng(3)
    views = wv.render(scene, camera, TRUTH, outputs=("depth", "normals", "segmentation"), convention="opencv")
    rendered = views.depth.numpy()
    depth = np.where(np.isfinite(rendered), rendered, 3) + random.choice([0.005, 0.03, 0.5], rendered.shape) * (
        random.normal(size=rendered.shape)
    )
    lost = random.choice([np.nan, 0, -1, np.inf, -np.inf, 0.05, 40], depth.shape)
    depth = np.where(random.uniform(size=depth.shape) < 0.1, lost, depth).astype(np.float32)
    options = {"sigma": SIGMA, "huber": 2.0, "max_distance": 0.3, "min_cosine": 0.2}
    # A tolerance above all steps ends the iterations at the initial pose.
    arguments = {**options, "moving": moving, "max_jump": max_jump, "convention": "opencv", "tolerance": 100.0}
    found = wv.register(scene, camera, depth, TRUTH, **arguments)
    on_object = views.segmentation.numpy()[0] == scene.index("mug")
    more = {} if moving == "camera" else {"moving": on_object, "center": MUG[:3]}
    wanted = reference.sum_terms(
        camera,
        TRUTH,
        rendered[0],
        views.normals.numpy()[0],
        depth[0],
        **options,
        max_jump=max_jump or math.inf,
        **more,
    )
    got = sums(found)
    assert abs(int(got[3]) - wanted[3]) <= (0 if max_jump is None else 3)  # second differences in single precision
    assert got[4] == wanted[4]
    assert got[2] == pytest.approx(wanted[2], rel=1e-5)
    if got[3] == wanted[3]:
        np.testing.assert_allclose(got[0], wanted[0], rtol=1e-4, atol=1e-4 * np.abs(wanted[0]).max())
        np.testing.assert_allclose(got[1], wanted[1], rtol=1e-4, atol=1e-3 * np.abs(wanted[1]).max())
    start = TRUTH if moving == "camera" else MUG
    if wanted[3] > 50:
        stepped = reference.step_poses(start, got[0], got[1])
        if difference(stepped, start)[0] < 0.5 and difference(stepped, start)[1] < 0.35:
            assert max(difference(found.poses.numpy()[0].astype(float), stepped)) < 1e-5
        np.testing.assert_allclose(found.covariance.numpy()[0], reference.write_results(got[0]), rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("name", ["pinhole", "panorama", "lidar"])
@pytest.mark.parametrize("moving", ["camera", "mug"])
@pytest.mark.parametrize("options", [{}, {"max_jump": 0.2}, {"sigma": lambda depth: 0.002 + 0.01 * depth**2}])
def test_kernels_of_cpu_and_cuda_agree(monkeypatch, name, moving, options):
    """The kernel of CUDA, here with one thread for each strip, and the native one differ by rounding."""
    scene, camera, random = room(), CAMERAS[name], np.random.default_rng(5)
    depth = measure(scene, camera, convention="opencv")
    depth += random.choice([0.005, 0.2], depth.shape) * random.normal(size=depth.shape).astype(np.float32)
    depth[random.uniform(size=depth.shape) < 0.1] = np.nan
    arguments = {"sigma": SIGMA, "moving": moving, "convention": "opencv", "tolerance": 100.0, **options}
    native = sums(wv.register(scene, camera, depth, TRUTH, **arguments))
    monkeypatch.setattr(normal_rows, "sum_terms_rows", normal_equations.sum_terms)
    plain = sums(wv.register(scene, camera, depth, TRUTH, **arguments))
    assert native[3:] == plain[3:] and native[3] > 20
    for mine, other in zip(native[:3], plain[:3], strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-6, atol=1e-8 * np.abs(plain[0]).max())


@pytest.mark.parametrize("strips", [1, 7, 40, 600])
def test_strips_are_added(device, strips):
    numbers = np.random.default_rng(strips).normal(size=(3, strips, 45))
    views, found = (wp.array([4, 0, 2], dtype=int, device=device), wp.zeros((5, 45), dtype=wp.float64, device=device))
    lanes = 1 if device == "cpu" else 32
    inputs = [views, lanes, wp.array(numbers, device=device)]
    wp.launch(normal_equations.add_strips, (3, 45, lanes), inputs=inputs, outputs=[found], device=device)
    np.testing.assert_allclose(found.numpy()[[4, 0, 2]], reference.add_strips(numbers), rtol=1e-12, atol=1e-12)
    assert not found.numpy()[[1, 3]].any()


@pytest.mark.parametrize("world", [None, [2, 0, 1, 1]])
@pytest.mark.parametrize("rows", [1, 4])
def test_object_poses_of_views(device, rows, world):
    poses = np.random.default_rng(rows).normal(size=(rows, 2, 7)).astype(np.float32)
    worlds, found = Worlds(), wp.empty((4, 2), dtype=wp.transform, device=device)
    worlds.object_poses = wp.array(poses, dtype=wp.transform, device=device)
    if world is not None:
        worlds.world = wp.array(world, dtype=wp.int32, device=device)
    inputs = [worlds]
    wp.launch(normal_equations.spread_object_poses, (4, 2), inputs=inputs, outputs=[found], device=device)
    np.testing.assert_array_equal(found.numpy(), reference.spread_object_poses(poses, world, 4))


@pytest.mark.parametrize("name", ["room", "blobs_77k"])
def test_noisy_views_converge(device, name):
    """Depth with noise, from 3 degrees and 5 cm away: pixels that change sides do not prevent convergence."""
    preset, random = PRESETS[name], np.random.default_rng(1)
    scene, truth = preset.build(device), np.asarray(preset.poses(1)[0], dtype=np.float64)
    depth = np.repeat(measure(scene, poses=truth), 40, axis=0)
    depth += random.normal(0, SIGMA, depth.shape).astype(np.float32)
    start = np.array([perturbed(truth, random, 0.05, 0.05) for _ in range(40)])
    found = wv.register(scene, CAMERA, depth, start, sigma=SIGMA)
    assert found.converged.numpy().all() and found.iterations.numpy().max() < 20
    assert difference(found.poses.numpy().astype(float), np.tile(truth, (40, 1)))[0] < 0.01


@pytest.mark.parametrize("name", ["room", "blobs_77k"])
def test_cameras_return_in_presets(device, name):
    """Ten views of each scene, from 5 degrees and 5 cm away."""
    preset, random = PRESETS[name], np.random.default_rng(0)
    scene, truth = preset.build(device), np.asarray(preset.poses(10), dtype=np.float64)
    start = np.array([perturbed(pose, random) for pose in truth])
    found = wv.register(scene, CAMERA, measure(scene, poses=truth), start, sigma=SIGMA)
    distance, angle = difference(found.poses.numpy().astype(float), truth)
    assert distance < 1e-4 and angle < 1e-4
    assert found.converged.numpy().all() and (found.inlier_ratio > 0.9).all()


@pytest.mark.parametrize("name", CAMERAS)
def test_every_camera_returns(device, name):
    scene, camera, random = room(device), CAMERAS[name], np.random.default_rng(1)
    start = np.array([perturbed(TRUTH, random, math.radians(3), 0.04) for _ in range(5)])
    depth = measure(scene, camera, convention="opencv")[0]
    found = wv.register(scene, camera, depth, start, sigma=SIGMA, convention="opencv")
    assert found.converged.numpy().all()
    distance, angle = difference(found.poses.numpy().astype(float), np.broadcast_to(TRUTH, (5, 7)))
    assert distance < 1e-4 and angle < 1e-4
    assert found.best() in range(5)


def test_convention_of_results(device):
    scene, camera = room(device), CAMERAS["lidar"]
    pose = np.array([0.5, 0, 1.2, 0, 0, 0, 1])
    start = perturbed(pose, np.random.default_rng(4), 0.03, 0.03)
    found = wv.register(scene, camera, measure(scene, camera, pose), start, sigma=SIGMA)
    assert max(difference(found.poses.numpy()[0].astype(float), pose)) < 1e-4


def test_objects_return(device):
    """Hypotheses of the mug's pose in one image; the other object and the camera stay."""
    scene, random = room(device), np.random.default_rng(2)
    initial = np.array([item.place for item in (scene.objects[index] for index in scene.movable)], dtype=np.float64)
    start = np.tile(initial, (6, 1, 1))
    start[:, 0] = [perturbed(MUG, random, math.radians(8), 0.03) for _ in range(6)]
    depth = measure(scene)[0]
    found = wv.register(scene, CAMERA, depth, TRUTH, sigma=SIGMA, moving="mug", object_poses=start, max_distance=0.1)
    assert found.converged.numpy().all()
    distance, angle = difference(found.poses.numpy().astype(float), np.tile(MUG, (6, 1)))
    assert distance < 1e-3 and angle < 5e-3
    poses = found.object_poses.numpy()
    np.testing.assert_array_equal(poses[:, 0], found.poses.numpy())
    np.testing.assert_array_equal(poses[:, 1], np.float32(start[:, 1]))


def test_covariance_is_that_of_repeated_measurements(device):
    """The mean of the squared Mahalanobis distances of 200 results is 6, within 30 % for Huber's cost."""
    scene, random, count = room(device), np.random.default_rng(6), 200
    depth = np.repeat(measure(scene), count, axis=0)
    depth += random.normal(0, 0.004, depth.shape).astype(np.float32)
    found = wv.register(scene, CAMERA, depth, TRUTH, sigma=0.004)
    poses = found.poses.numpy().astype(float)
    turns = Rotation.from_quat(poses[:, 3:]) * Rotation.from_quat(TRUTH[3:]).inv()
    errors = np.hstack([turns.as_rotvec(), poses[:, :3] - TRUTH[:3]])
    squares = np.einsum("vi,vij,vj->v", errors, found.H.numpy(), errors)
    assert found.converged.numpy().all()  # also those of which pixels at silhouettes change sides in every step
    assert squares.mean() == pytest.approx(6, rel=0.3)
    scatter = errors.std(axis=0) / np.sqrt(np.diagonal(found.covariance.numpy(), axis1=1, axis2=2)).mean(axis=0)
    np.testing.assert_allclose(scatter, 1, atol=0.25)


def test_outliers_have_little_influence(device):
    """A fifth of the pixels is 0.1 to 0.4 m too near; Huber's cost reduces the error at least fourfold."""
    scene, random = room(device), np.random.default_rng(8)
    depth = measure(scene)
    depth -= np.where(random.uniform(size=depth.shape) < 0.2, random.uniform(0.1, 0.4, depth.shape), 0)
    depth = depth.astype(np.float32)
    start = perturbed(TRUTH, random, math.radians(2), 0.03)
    robust, plain = (
        wv.register(scene, CAMERA, depth, start, sigma=SIGMA, huber=huber).poses.numpy()[0].astype(float)
        for huber in (1.345, math.inf)
    )
    assert difference(robust, TRUTH)[0] < 0.01
    assert 4 * difference(robust, TRUTH)[0] < difference(plain, TRUTH)[0]


def test_views_that_see_nothing_keep_their_poses(device):
    """One looks at the sky, one has no measurement, one is valid."""
    scene = room(device)
    up = np.array(wv.look_at((0, -2, 8), (0, -2, 20), up="y"))
    poses = np.float32([up, TRUTH, TRUTH])
    depth = np.repeat(measure(scene), 3, axis=0)
    depth[1] = np.nan
    found = wv.register(scene, CAMERA, depth, poses, sigma=SIGMA)
    assert found.converged.numpy().tolist() == [0, 0, 1]
    np.testing.assert_array_equal(found.poses.numpy()[:2], poses[:2])
    assert np.isfinite(found.poses.numpy()).all() and np.isinf(found.covariance.numpy()[:2]).all()
    assert found.num_inliers.numpy()[:2].tolist() == [0, 0] and found.best() == 2
    with pytest.raises(wv.errors.ArrayError, match="no view has inliers"):
        wv.register(scene, CAMERA, depth[1], poses[1], sigma=SIGMA).best()


def test_one_wall_moves_determined_directions_only(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.1, 40, 40)), pose=(3, 0, 0, 0, 0, 0, 1))
    truth = np.array(wv.look_at((0, 0, 0), (1, 0, 0)))
    start = truth + [0.05, 0.02, 0.01, 0, 0, 0, 0]
    found = wv.register(scene, CAMERA, measure(scene, poses=truth), start, sigma=SIGMA)
    np.testing.assert_allclose(found.poses.numpy()[0, :3], [0, 0.02, 0.01], atol=1e-3)


def test_same_bits_for_threads_and_batches():
    """Views have the same result for any number of threads, and in parts of the batch."""
    scene, random = room(), np.random.default_rng(9)
    start = np.array([perturbed(TRUTH, random, 0.05, 0.05) for _ in range(7)])
    depth = np.repeat(measure(scene), 7, axis=0) + random.normal(0, SIGMA, (7, 72, 96)).astype(np.float32)

    def bits(part, threads):
        found = wv.register(scene, CAMERA, depth[part], start[part], sigma=SIGMA, threads=threads)
        return [getattr(found, name).numpy() for name in ("poses", "H", "b", "e", "covariance", "iterations")]

    whole = bits(slice(None), 1)
    for other in (
        bits(slice(None), 2),
        [np.concatenate(pair) for pair in zip(bits(slice(3), 2), bits(slice(3, 7), 1), strict=True)],
    ):
        for mine, same in zip(whole, other, strict=True):
            np.testing.assert_array_equal(mine, same)


def test_inputs_are_not_changed():
    scene, start = room(), np.float32(perturbed(TRUTH, np.random.default_rng(1)))[None]
    before, depth = start.copy(), measure(scene)
    wv.register(scene, CAMERA, depth, start, sigma=SIGMA)
    np.testing.assert_array_equal(start, before)


BAD = {
    "shape": ({"depth": np.ones((2, 10, 10), np.float32)}, "depth must have shape .V, 72, 96., got"),
    "views": ({"depth": np.ones((2, 72, 96), np.float32), "camera_to_world": [TRUTH] * 3}, "of one view or of 3 views"),
    "nothing": ({"depth": np.ones((0, 72, 96), np.float32)}, "must be of one view, got 0 and 1"),
    "unknown": ({"moving": "ghost"}, "ghost"),
    "static": ({"moving": "table"}, "moving must be .* a movable object, got 'table', which is static"),
    "no name": ({"moving": 3}, "moving must be .* got 3"),
    "nan": ({"camera_to_world": TRUTH * np.nan}, "camera_to_world"),
    "iterations": ({"iterations": 0}, "iterations must be a whole number from 1 up, got 0"),
    "sigma": ({"sigma": -0.01}, "sigma must be a positive number of meters, got -0.01"),
    "huber": ({"huber": 0}, "huber must be a positive number of standard deviations, got 0"),
    "distance": ({"max_distance": math.inf}, "max_distance must be a positive number of meters, got inf"),
    "cosine": ({"min_cosine": 2}, "min_cosine must be a number from 0 to 1, got 2"),
    "camera": ({"camera": "kinect"}, "camera must be a warpvis.Camera or another camera, got str"),
    "both": ({"joint_positions": {}, "object_poses": [[MUG, MUG]]}, "joint_positions must be None"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input(name):
    changed, message = BAD[name]
    arguments = {"scene": room(), "camera": CAMERA, "depth": np.ones((72, 96), np.float32), "camera_to_world": TRUTH}
    with pytest.raises(wv.WarpvisError, match=message):
        wv.register(**{**arguments, "sigma": SIGMA, **changed})
