# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Back-projection and the paper's classes against references, on rendered and damaged depth images."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis import Label, scenes
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import ArrayError
from warpvis.maps import Sphere

import reference

EXPERIMENT = scenes.EXPERIMENTS[0]
CAMERA = EXPERIMENT.camera


@pytest.fixture(scope="module")
def depth():
    """Return a sensor-like depth image: noisy, with holes in every encoding of missing depth."""
    rng = np.random.default_rng(0)
    image = wv.render(EXPERIMENT.build(), CAMERA, EXPERIMENT.poses()).depth.numpy().copy()
    image += np.where(np.isfinite(image), rng.normal(0, 0.005, image.shape), 0).astype(np.float32)
    for value in (np.nan, np.inf, -np.inf, 0.0, -1.0, 4.6, 100.0):
        image[0, rng.integers(0, 240, 50), rng.integers(0, 320, 50)] = value
    return image


def test_back_projection_matches_its_reference(depth, device):
    points = wv.back_project(depth, CAMERA, EXPERIMENT.poses(), device=device).numpy()[0]
    expected = reference.back_project(CAMERA, EXPERIMENT.poses()[0], depth[0])
    assert (np.isnan(points) == np.isnan(expected)).all()
    hit = np.isfinite(expected)
    np.testing.assert_allclose(points[hit], expected[hit], rtol=2e-7, atol=2e-7)


def test_back_projected_depth_equals_rendered_points(device):
    views = wv.render(EXPERIMENT.build(device), CAMERA, EXPERIMENT.poses())
    points = wv.back_project(views.depth, CAMERA, EXPERIMENT.poses())
    np.testing.assert_allclose(points.numpy(), views.points.numpy(), atol=1e-6)


@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.3])
@pytest.mark.parametrize("max_range", [None, 2.5])
def test_classes_match_their_reference(depth, sigma, max_range, device):
    spheres = (*EXPERIMENT.spheres, Sphere((1.3, 0.35, 1.0), 0.9, Label.ROBOT))  # overlapping spheres
    owner = wp.empty(depth.shape, dtype=wp.int32, device=device)
    labels = wv.classify(
        depth, CAMERA, EXPERIMENT.poses(), spheres=spheres, ground_tolerance=sigma, max_range=max_range, device=device,
        spheres_out=owner,
    )  # fmt: skip
    expected, sphere, margin = reference.classify_depth(
        CAMERA, EXPERIMENT.poses()[0], depth[0], spheres, sigma=sigma, max_range=max_range
    )
    clear = margin > 1e-5
    assert clear.mean() > 0.99
    np.testing.assert_array_equal(labels.numpy()[0][clear], expected[clear])
    apart = clear & (labels.numpy()[0] == expected)
    assert (owner.numpy()[0][apart] == sphere[apart]).mean() > 0.9999
    assert labels.dtype == wp.uint8


def test_every_encoding_of_missing_depth_is_empty(device):
    camera = wv.Camera(7, 1, 10, 10, 3.5, 0.5, near=0.3, far=4.5)
    depth = np.array([[[np.nan, np.inf, -np.inf, 0.0, -1.0, 4.51, 4.5]]], dtype=np.float32)
    pose = wv.look_at((0, 0, 1), (1, 0, 1))
    labels = wv.classify(depth, camera, pose, device=device).numpy()[0, 0]
    assert labels.tolist() == [Label.EMPTY] * 6 + [Label.OBSTACLE]


@pytest.mark.parametrize(("near", "far"), [(0.5, 2.0), (0.0, np.inf), (1e-3, np.inf)])
def test_range_includes_its_limits(near, far, device):
    camera = wv.Camera(20, 1, 10, 10, 10, 0.5, near=near, far=far)
    edges = np.array([near, far, 0.0, 1.0], dtype=np.float32)
    with np.errstate(under="ignore"):
        around = [np.nextafter(edges, np.float32(-np.inf)), edges, np.nextafter(edges, np.float32(np.inf))]
    depth = np.concatenate([*around, [1e-40, 3e38, -np.inf, np.inf, np.nan, -1e-40, 2.5, 0.5]]).astype(np.float32)
    points = wv.back_project(depth[None, None], camera, wv.look_at((0, 0, 1), (1, 0, 1)), device=device).numpy()[0, 0]
    labels = wv.classify(depth[None, None], camera, wv.look_at((0, 0, 1), (1, 0, 1)), device=device).numpy()[0, 0]
    inside = np.isfinite(depth) & (depth > 0) & (depth >= np.float32(near)) & (depth <= np.float32(far))
    np.testing.assert_array_equal(labels != Label.EMPTY, inside)
    np.testing.assert_array_equal(~np.isnan(points).any(axis=-1), inside)


def test_ground_is_within_the_tolerance_of_the_floor(device):
    """A camera 1 m above the floor looks down at points of given heights."""
    camera = wv.Camera(4, 1, 1e6, 1e6, 2, 0.5)
    down = wv.look_at((0, 0, 1), (0, 0, 0), up=(1, 0, 0))
    depth = np.array([[1.2, 0.995, 0.985, 0.2]], dtype=np.float32)
    ground, obstacle = Label.GROUND, Label.OBSTACLE
    assert wv.classify(depth, camera, down, device=device).numpy()[0, 0].tolist() == [
        ground,
        ground,
        obstacle,
        obstacle,
    ]
    wider = wv.classify(depth, camera, down, ground_tolerance=0.02, device=device).numpy()[0, 0]
    assert wider.tolist() == [ground, ground, ground, obstacle]
    higher = wv.classify(depth, camera, down, ground_height=0.7, device=device).numpy()[0, 0]
    assert higher.tolist() == [ground] * 3 + [obstacle]


def test_y_up(device):
    camera = wv.Camera(1, 1, 1e6, 1e6, 0.5, 0.5)
    down = wv.look_at((0, 1, 0), (0, 0, 0), up=(1, 0, 0))
    depth = np.array([[1.0]], dtype=np.float32)
    assert wv.classify(depth, camera, down, up="y", device=device).numpy().item() == Label.GROUND
    assert wv.classify(depth, camera, down, up="z", device=device).numpy().item() == Label.GROUND
    low = np.array([[0.5]], dtype=np.float32)
    assert wv.classify(low, camera, down, up="y", device=device).numpy().item() == Label.OBSTACLE
    assert wv.classify(low, camera, down, up="z", device=device).numpy().item() == Label.GROUND


def test_spheres_from_rows_or_objects():
    depth = wv.render(EXPERIMENT.build(), CAMERA, EXPERIMENT.poses()).depth
    ball = EXPERIMENT.spheres[0]
    one = wv.classify(depth, CAMERA, EXPERIMENT.poses(), spheres=[ball]).numpy()
    other = wv.classify(depth, CAMERA, EXPERIMENT.poses(), spheres=np.array([[*ball.center, ball.diameter]])).numpy()
    np.testing.assert_array_equal(one, other)
    assert (one == Label.OBJECT).any()


def test_rendered_images_are_labeled_by_their_objects(device):
    scene = EXPERIMENT.build(device)
    views = wv.render(scene, CAMERA, EXPERIMENT.poses())
    labels = wv.maps.classify_rendered(views.depth, views.segmentation, scene)
    np.testing.assert_array_equal(labels.numpy(), views.labels.numpy())

    near = wv.maps.classify_rendered(views.depth, views.segmentation, scene, max_range=2.0).numpy()[0]
    label_of = np.array([item.label for item in scene])
    expected = reference.label_objects(label_of, views.depth.numpy()[0], views.segmentation.numpy()[0], 2.0)
    np.testing.assert_array_equal(near, expected)
    assert (near != labels.numpy()[0]).any()


def test_spheres_agree_with_exact_objects():
    """Spheres fitted to the depth image alone label ball and person where the renderer sees them."""
    for experiment in scenes.EXPERIMENTS:
        scene = experiment.build()
        views = wv.render(scene, CAMERA, experiment.poses())
        labels = wv.classify(views.depth, CAMERA, experiment.poses(), spheres=experiment.spheres).numpy()
        exact = views.labels.numpy()
        for label in (Label.OBJECT, Label.HUMAN):
            found, there = labels == label, exact == label
            assert found.any() == there.any()
            # Feet and the bottom of the ball are below sigma; the rest agrees.
            assert (found & there).sum() >= 0.95 * there.sum()
            assert (found & ~there).sum() <= 0.02 * max(there.sum(), 1)


def test_out_arrays_are_used(device):
    views = wv.render(EXPERIMENT.build(device), CAMERA, EXPERIMENT.poses())
    labels = wp.zeros(views.depth.shape, dtype=wp.uint8, device=device)
    points = wp.zeros(views.depth.shape, dtype=wp.vec3, device=device)
    assert wv.classify(views.depth, CAMERA, EXPERIMENT.poses(), out=labels) is labels
    assert wv.back_project(views.depth, CAMERA, EXPERIMENT.poses(), out=points) is points
    assert wv.maps.classify_rendered(views.depth, views.segmentation, EXPERIMENT.build(device), out=labels) is labels


@pytest.mark.parametrize("width", [1, 15, 16, 37])
@pytest.mark.parametrize("up", ["z", "y"])
def test_rows_of_any_width_match_the_reference(width, up, device):
    """On the CPU, sixteen pixels of a row are computed at once; the last group is partly unused."""
    rng = np.random.default_rng(width)
    camera = wv.Camera(width, 9, 30.0, 34.0, width / 3, 5.0, near=0.4, far=3.5)
    poses = np.stack([wv.look_at((0, 0.2, 1), (1, 0.3, 0.4)), wv.look_at((0.5, 0, 0.8), (-1, 0.4, 0.2))])
    depth = rng.uniform(0.3, 3.7, (2, 9, width)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.1] = np.nan
    depth[rng.random(depth.shape) < 0.1] = -np.inf
    spheres = (Sphere((1.0, 0.3, 0.4), 0.9), Sphere((1.1, 0.3, 0.5), 1.1, Label.ROBOT), Sphere((-1, 0.4, 0.2), 0.7))
    owner = wp.empty(depth.shape, dtype=wp.int32, device=device)
    for balls in ((), spheres):
        labels = wv.classify(
            depth, camera, poses, spheres=balls, ground_height=0.1, up=up, device=device, spheres_out=owner
        ).numpy()
        points = wv.back_project(depth, camera, poses, device=device).numpy()
        for view, pose in enumerate(poses):
            expected, sphere, margin = reference.classify_depth(
                camera, pose, depth[view], balls, ground_height=0.1, up={"z": 2, "y": 1}[up]
            )
            clear = margin > 1e-5
            np.testing.assert_array_equal(labels[view][clear], expected[clear])
            np.testing.assert_array_equal(owner.numpy()[view][clear], sphere[clear])
            np.testing.assert_allclose(
                points[view], reference.back_project(camera, pose, depth[view]), rtol=2e-7, atol=2e-7
            )


def test_cpu_row_kernels_match_cuda_pixel_kernels(depth):
    """CUDA kernels run on the CPU return the same labels, and the same points up to rounding."""
    from warpvis.kernels.maps import classify as kernels
    from warpvis.kernels.pinhole import Window

    ground = kernels.Ground()
    ground.axis, ground.normal, ground.height, ground.tolerance = 2, wp.vec3d(0.0, 0.0, 1.0), 0.0, 0.01
    ground.below_label = Label.GROUND
    poses = wp.array(EXPERIMENT.poses().astype(np.float32), dtype=wp.transform, device="cpu")
    image = wp.array(depth, dtype=float, device="cpu")
    labels, owner = (wp.empty(depth.shape, dtype=dtype, device="cpu") for dtype in (wp.uint8, wp.int32))
    points = wp.empty(depth.shape, dtype=wp.vec3, device="cpu")
    balls, spheres = kernels.Spheres(), EXPERIMENT.spheres
    balls.center = wp.array([sphere.center for sphere in spheres], dtype=wp.vec3, device="cpu")
    balls.size = wp.array([sphere.diameter for sphere in spheres], dtype=wp.float32, device="cpu")
    balls.label = wp.array([int(sphere.label) for sphere in spheres], dtype=wp.uint8, device="cpu")
    camera, images = CAMERA.device_struct(), [image, CAMERA.far, ground, balls, labels, owner]
    wp.launch(kernels.classify_depth, depth.shape, [camera, poses, Window(), *images], device="cpu")
    wp.launch(kernels.back_project, depth.shape, [camera, poses, Window(), image, points], device="cpu")

    found = wp.empty(depth.shape, dtype=wp.int32, device="cpu")
    rows = wv.classify(depth, CAMERA, EXPERIMENT.poses(), spheres=EXPERIMENT.spheres, device="cpu", spheres_out=found)
    np.testing.assert_array_equal(rows.numpy(), labels.numpy())
    np.testing.assert_array_equal(found.numpy(), owner.numpy())
    found = wv.back_project(depth, CAMERA, EXPERIMENT.poses(), device="cpu").numpy()
    np.testing.assert_allclose(found, points.numpy(), rtol=2e-7, atol=1e-12)


PLANE = (0.3, -0.2, 2.0, -0.5)


def noise_of(depth):
    return 0.002 + 0.003 * depth + 0.004 * depth**2


@pytest.mark.parametrize("width", [1, 16, 37])
@pytest.mark.parametrize("below_label", [Label.GROUND, 9])
@pytest.mark.parametrize("sigma", [None, noise_of])
def test_any_plane_matches_the_reference(width, below_label, sigma, device):
    """A tilted plane whose coefficients are not normalized, with points on it, above and below."""
    rng = np.random.default_rng(width)
    camera = wv.Camera(width, 31, 30.0, 34.0, width / 3, 15.0, near=0.4, far=3.5)
    poses = np.stack([wv.look_at((0, 0.2, 1), (1, 0.3, 0.0)), wv.look_at((0.5, 0, 0.8), (-1, 0.4, 0.2))])
    depth = rng.uniform(0.3, 3.7, (2, 31, width)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.1] = np.nan
    spheres = (Sphere((1.0, 0.3, 0.4), 0.9, Label.ROBOT),)
    labels = wv.classify(
        depth, camera, poses, spheres=spheres, floor=PLANE, sigma=sigma, threshold=2.0, below_label=below_label,
        ground_tolerance=0.03, device=device,
    ).numpy()  # fmt: skip
    growth = (0.0, 0.0, 0.0) if sigma is None else (0.004, 0.006, 0.008)
    options = {"sigma": 0.03, "plane": PLANE, "noise": growth, "below_label": below_label}
    for view, pose in enumerate(poses):
        expected, _, margin = reference.classify_depth(camera, pose, depth[view], spheres, **options)
        clear = margin > 1e-5
        np.testing.assert_array_equal(labels[view][clear], expected[clear])
    if width > 1:
        assert {0, Label.GROUND, Label.OBSTACLE, below_label} <= set(np.unique(labels))


@pytest.mark.parametrize("kind", ["z", "range"])
def test_any_plane_with_a_lens_matches_the_reference(kind, device):
    lens = wv.cameras.lenses.OpenCVPinhole(24, 24, 16, 12, (-0.2, 0.02, 0, 0))
    camera = wv.cameras.LensCamera(lens, 33, 24, near=0.3, far=5.0, kind=kind)
    pose = wv.look_at((0, 0.2, 1), (1, 0.3, 0.0))
    depth = np.random.default_rng(1).uniform(0.2, 5.5, (1, 24, 33)).astype(np.float32)
    labels = wv.classify(depth, camera, pose, floor=PLANE, sigma=noise_of, below_label=9, device=device).numpy()[0]
    growth = tuple(3 * value for value in (0.002, 0.003, 0.004))
    expected, _, margin = reference.classify_rays(
        camera, pose, depth[0], plane=PLANE, noise=growth, below_label=9
    )  # fmt: skip
    clear = margin > 1e-5
    assert clear.mean() > 0.9 and {Label.GROUND, Label.OBSTACLE, 9} <= set(np.unique(labels))
    np.testing.assert_array_equal(labels[clear], expected[clear])


def test_horizontal_plane_is_the_default_floor(depth, device):
    poses = EXPERIMENT.poses()
    for up, plane in (("z", (0, 0, 1, 0)), ("z", (0, 0, 3, -0.3))):
        other = wv.classify(depth, CAMERA, poses, floor=plane, device=device).numpy()
        same = wv.classify(depth, CAMERA, poses, up=up, ground_height=-plane[3] / 3, device=device).numpy()
        assert (other == same).mean() > 0.9999


def test_fitted_floor_is_the_ground(device):
    """A tilted camera with an unknown pose: its fitted plane labels the floor as the true pose does."""
    scene = wv.Scene(device="cpu")
    for size, center in (((6, 6, 0.1), (0, 2, -0.05)), ((0.5, 0.5, 0.5), (0.2, 2.0, 0.25)), ((6, 0.1, 3), (0, 4, 1.5))):
        mesh = trimesh.creation.box(size)
        mesh.apply_translation(center)
        scene.add(mesh)
    camera = wv.Camera(160, 120, 130, 130, 80, 60, near=0.3, far=6.0)
    pose = wv.look_at((0, 0, 1.2), (0.1, 2, 0.4))
    depth = wv.render(scene, camera, pose).depth
    expected = wv.classify(depth, camera, pose, ground_tolerance=0.02).numpy()
    fit = wv.fit_floor(depth, camera, pose, up=(0, 0, 1))
    labels = wv.classify(depth.numpy(), camera, pose, floor=fit, ground_tolerance=0.02, device=device).numpy()
    assert (labels == expected).mean() > 0.995 and (labels == Label.GROUND).mean() > 0.2
    own = wv.fit_floor(depth, camera)
    identity = (0, 0, 0, 0, 0, 0, 1)
    labels = wv.classify(depth.numpy(), camera, identity, floor=own, ground_tolerance=0.02, device=device).numpy()
    assert (labels == expected).mean() > 0.995
    with pytest.raises(ArrayError, match="floor must be in the world frame"):
        wv.classify(depth, camera, own.camera_to_world, floor=own)


def test_noise_of_a_sensor_keeps_the_floor_ground(device):
    """A tolerance of 3 mm is not enough for a floor measured by a Kinect; three standard deviations more are."""
    scene = wv.Scene(device="cpu")
    for size, center in (((9, 9, 0.1), (0, 2, -0.05)), ((0.6, 0.6, 0.5), (0.3, 2.5, 0.25))):
        mesh = trimesh.creation.box(size)
        mesh.apply_translation(center)
        scene.add(mesh)
    sensor = wv.sensors.NguyenNoise()
    camera = wv.Camera.kinect()
    pose = wv.look_at((0, 0, 1.2), (0, 2.5, 0.1))
    views = wv.render(scene, camera, pose, sensor=sensor, outputs=("depth", "segmentation"))
    depth = views.depth.numpy()
    truth = wv.render(scene, camera, pose, outputs=("segmentation",)).segmentation.numpy()
    floor, box = ((truth == index) & np.isfinite(depth) for index in range(2))
    options = {"ground_tolerance": 0.003, "device": device}
    fixed = wv.classify(depth, camera, pose, **options).numpy()
    grown = wv.classify(depth, camera, pose, sigma=sensor, **options).numpy()
    assert (fixed[floor] == Label.GROUND).mean() < 0.9
    assert (grown[floor] == Label.GROUND).mean() > 0.99
    assert (grown[box] == Label.OBSTACLE).mean() > 0.9


@pytest.mark.parametrize(("ground_height", "above", "target"), [(19.0, 1.3, 0.0), (-1.0, 1.3, 0.0), (0.0, 0.001, 0.2)])
def test_heights_next_to_the_limit_are_exact(ground_height, above, target):
    """Depths whose points are within roundings of the limit, which single precision would confuse."""
    camera = wv.Camera(64, 48, 60.0, 60.0, 32.0, 24.0, near=0.1, far=100.0)
    pose = np.array(wv.look_at((5, 3, ground_height + above), (6, 4, ground_height + target)), dtype=np.float32)
    slope = (reference.pixel_rays(camera) @ poses_to_matrices(pose)[:3, :3].T)[..., 2]
    limit, height = np.float32(0.03), np.float32(ground_height)
    start = np.float64(pose[2])
    with np.errstate(divide="ignore"):
        depth = ((np.float64(limit) + height - start) / slope).astype(np.float32)
    depth = np.where(depth > 0, depth, 1.0).astype(np.float32)
    ulps = np.random.default_rng(0).integers(-6, 7, depth.shape).astype(np.int32)
    depth = (depth.view(np.int32) + ulps).view(np.float32)
    exact = (depth.astype(np.float64) * slope + start).astype(np.float32) - height < limit
    rough = depth * slope.astype(np.float32) + np.float32(start) - height < limit
    labels = wv.classify(depth, camera, pose, ground_tolerance=0.03, ground_height=ground_height, device="cpu")
    labels = labels.numpy()[0]
    assert (rough != exact).sum() > 20
    # Rotations are rounded in another way, which changes single results.
    assert ((labels == Label.GROUND) != exact)[labels != Label.EMPTY].sum() <= 2
    assert (labels != Label.EMPTY).mean() > 0.5


def test_labels_of_rendered_images_skip_unknown_objects(device):
    scene = EXPERIMENT.build(device)
    rng = np.random.default_rng(1)
    depth = rng.choice([0.5, 1.0, 3.0, np.nan, np.inf, -np.inf, 0.0, -1.0], (2, 5, 37)).astype(np.float32)
    objects = rng.integers(-1, len(scene), depth.shape).astype(np.int32)
    labels = wv.maps.classify_rendered(depth, objects, scene, max_range=2.0).numpy()
    label_of = np.array([item.label for item in scene])
    for view in range(2):
        expected = reference.label_objects(label_of, depth[view], objects[view], 2.0)
        np.testing.assert_array_equal(labels[view], expected)
    assert len(np.unique(labels)) > 2
