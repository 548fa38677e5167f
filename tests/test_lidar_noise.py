# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lidar noise against a double-precision reference, and invariance to batches, threads and formats."""

import dataclasses
import math

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis import cameras, sensors
from warpvis.errors import ArrayError
from warpvis.sensors import LidarNoise, Reason, _glare, lidars

import reference
from support.kinect_noise import images

OUTPUTS = ("depth", "reasons", "true_depth", "normals", "segmentation")


def turned(yaw, place=(0.0, 0.0, 0.0)):
    return np.array([*place, 0, 0, math.sin(yaw / 2), math.cos(yaw / 2)])


POSES = np.stack([turned(0.0), turned(0.7, (-1, 0.5, 0.2)), turned(2.5, (0.5, 0.3, -0.4))])
DARK = {"ball": 0.05, "room": 0.4}
BRIGHT = {"ball": 300.0, "room": 0.1}
FULL = LidarNoise(
    sigma=0.02,
    sigma_growth=0.004,
    weak_sigma=0.03,
    resolution=0.004,
    ring_sigma=0.02,
    ring_offsets=[0.01 * ring for ring in range(16)],
    dropout=0.05,
    detection_range=2.5,
    detection_reflectivity=0.2,
    power_sigma=0.2,
    reflectivity=DARK,
    rain=20.0,
    visibility=60.0,
    false_returns=0.1,
    false_range=1.5,
)
NUMBERS = {"seed": 3, "frame": [1, 2, 3], "view_index": [5, 0, 1]}
DRAWS = np.stack([NUMBERS["view_index"], NUMBERS["frame"]], axis=-1)


def room(device="cpu"):
    """Return a room without a ceiling, around the origin, with a movable ball in it."""
    scene = wv.Scene(device=device)
    parts = [
        ((8, 6, 0.1), (0, 0, -1)),
        ((0.1, 6, 3), (4, 0, 0.5)),
        ((0.1, 6, 3), (-4, 0, 0.5)),
        ((8, 0.1, 3), (0, 3, 0.5)),
    ]
    walls = [trimesh.creation.box(size, trimesh.transformations.translation_matrix(place)) for size, place in parts]
    scene.add(trimesh.util.concatenate(walls), name="room")
    ball = trimesh.creation.icosphere(3, radius=0.5)
    scene.add(ball, name="ball", pose=(1.5, -0.5, 0, 0, 0, 0, 1), movable=True)
    return scene


def lidar():
    return lidars.even(16, (-0.5, 0.3), increment=math.radians(2.5), near=0.4, far=3.4)


def planar(near=0.4, far=3.4):
    """Return forward rays whose depth is along z, with rings."""
    y, x = np.mgrid[:16, :40]
    rays = np.stack([(x - 19.5) / 20, (y - 7.5) / 20, np.ones_like(x)], axis=-1)
    directions = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    return cameras.Rays(directions, rings=y, near=near, far=far, kind="z", axes="opencv")


@pytest.mark.parametrize(
    "model",
    [
        LidarNoise(),
        LidarNoise(sigma=0.03, resolution=0.01),
        LidarNoise(false_returns=0.3, dropout=0.1),
        dataclasses.replace(FULL, power_sigma=0.0, reflectivity=1.0, detection_range=3.0, ring_offsets=None),
        dataclasses.replace(
            FULL, power_sigma=0.0, ring_offsets=None, reflectivity=BRIGHT, glare=0.01, glare_angle=0.03
        ),
        FULL,
    ],
    ids=["none", "range", "random", "power", "glare", "full"],
)
@pytest.mark.parametrize("kind", ["range", "z"])
def test_model_matches_the_reference(device, model, kind):
    scene, rays, poses = room(device), lidar(), POSES
    if kind == "z":
        rays, poses = planar(), np.stack([wv.look_at((0, 0, 0), at) for at in [(1, -0.2, 0), (1, 1, 0), (-1, 0, -0.5)]])
    seen = images(wv.render(scene, rays, poses, outputs=OUTPUTS, sensor=model, **NUMBERS), OUTPUTS)
    shares = np.ones(2)
    if isinstance(model.reflectivity, dict):
        shares = [model.reflectivity[name] for name in ("room", "ball")]
    said = reference.measure_lidar(model, rays, poses, seen, shares, DRAWS, 3)
    sure = said.margin > 1e-4
    assert sure.mean() > 0.95
    np.testing.assert_array_equal(seen["reasons"][sure], said.reasons[sure])
    np.testing.assert_allclose(seen["depth"][sure], said.depth[sure], rtol=1e-4)
    if model is FULL:
        found = {Reason.VALID, Reason.EMPTY, Reason.RANGE, Reason.GRAZING, Reason.DROPOUT}
        assert found <= set(np.unique(seen["reasons"]))


def test_default_noise_changes_nothing(device):
    scene = room(device)
    for rays in (lidar(), planar(), lidars.ouster("OS1-64", "512x10", near=0.4, far=4.0), lidars.laser_scan()):
        clean = wv.render(scene, rays, POSES, outputs=("depth", "points"))
        views = wv.render(scene, rays, POSES, outputs=("depth", "points"), sensor=LidarNoise(), frame=0)
        assert views.depth.shape == (3, *rays.shape)
        np.testing.assert_array_equal(views.depth.numpy(), clean.depth.numpy())
        np.testing.assert_allclose(views.points.numpy(), clean.points.numpy(), atol=1e-6)


def test_glare_widens_retro_reflectors(device):
    """Rays around the ball report its range, up to three standard deviations away, the more the brighter it is."""
    rays, counts = lidars.even(32, (-0.5, 0.3), increment=math.radians(0.5), near=0.4, far=30.0), []
    units = rays.directions.reshape(-1, 3)
    for glare in (0.0, 1e-4, 1e-3):
        model = LidarNoise(detection_range=10.0, reflectivity=BRIGHT, glare=glare, glare_angle=0.02)
        seen = images(wv.render(room(device), rays, POSES[:1], outputs=OUTPUTS, sensor=model, frame=0), OUTPUTS)
        seen = {name: image.reshape(-1) for name, image in seen.items()}
        is_ball = seen["segmentation"] == 1
        wrong = (seen["reasons"] == Reason.VALID) & (np.abs(seen["depth"] - seen["true_depth"]) > 1e-3)
        angles = np.arccos(np.clip(units[wrong] @ units[is_ball].T, -1.0, 1.0)).min(axis=1, initial=math.inf)
        assert (angles <= 0.06 + 1e-6).all()
        found = seen["depth"][wrong]
        assert ((found > seen["true_depth"][is_ball].min() - 1e-4) & (found < 1.6)).all()
        counts.append(wrong.sum())
    assert counts[0] == 0 < counts[1] < counts[2]


def test_glare_of_lists_is_that_of_images():
    rays, model = lidar(), LidarNoise(detection_range=10.0, reflectivity=BRIGHT, glare=0.01, glare_angle=0.03)
    order = np.random.default_rng(0).permutation(rays.height * rays.width)
    mixed = cameras.Rays(rays.directions.reshape(-1, 3)[order], near=0.4, far=3.4, axes="ros_body")
    of_image, of_list = (
        wv.render(room(), pattern, POSES, outputs="depth", sensor=model, frame=0).depth.numpy().reshape(3, -1)
        for pattern in (rays, mixed)
    )
    np.testing.assert_allclose(of_list, of_image[:, order], rtol=1e-6)


def test_glare_of_too_many_neighbors_is_refused(monkeypatch):
    """Memory would run out: 256 rays have 255 neighbors each."""
    monkeypatch.setattr(_glare, "_MAX_NEIGHBORS", 256 * 255)
    directions = np.random.default_rng(0).normal(size=(257, 3)) * 0.01 + [1, 0, 0]
    assert len(_glare.find_neighbors(directions[1:], 0.6)[1]) == 256 * 255
    with pytest.raises(ArrayError, match=r"glare_angle must be smaller for 257 rays: .* got 65792"):
        _glare.find_neighbors(directions, 0.6)


def test_points_of_rays_with_origins_match_their_reference(device):
    rays = lidars.ouster("OS1-64", "512x10", near=0.4, far=4.0)
    views = wv.render(room(device), rays, POSES, outputs=("depth", "points"), sensor=LidarNoise(sigma=0.1), seed=2)
    for pose, depth, points in zip(POSES, views.depth.numpy(), views.points.numpy(), strict=True):
        np.testing.assert_allclose(points, reference.back_project_bundle(rays, pose, depth), atol=2e-6)


def test_batches_threads_worlds_and_lists_have_the_same_noise(device):
    scene, rays = room(device), lidar()
    options = {"outputs": OUTPUTS[:3], "sensor": FULL, "seed": 4}
    renderer = wv.Renderer(scene, rays, **options, threads=1)
    whole = renderer.render(POSES, frame=7)
    expected = images(whole, OUTPUTS[:3])
    again = images(wv.render(scene, rays, POSES, frame=7, **options, threads=3), OUTPUTS[:3])
    alone = images(wv.render(scene, rays, POSES[2], view_index=[2], frame=7, **options), OUTPUTS[:3])
    ball = np.array([[1.5, -0.5, 0, 0, 0, 0, 1], [1.5, 2.0, 0, 0, 0, 0, 1]])
    worlds = wv.render(scene, rays, POSES, object_poses=ball[:, None], world_index=[0, 1, 0], frame=7, **options)
    parts = wv.Renderer(scene, rays, **options, device_bytes=1).render(POSES, frame=7)
    for name in OUTPUTS[:3]:
        np.testing.assert_array_equal(again[name], expected[name])
        np.testing.assert_array_equal(alone[name][0], expected[name][2])
        np.testing.assert_array_equal(getattr(worlds, name).numpy()[::2], expected[name][::2])
        np.testing.assert_array_equal(getattr(parts, name).numpy(), expected[name])
    assert (worlds.depth.numpy()[1] != expected["depth"][1]).any()
    assert renderer.render(POSES, frame=8, out=whole) is whole
    assert (whole.depth.numpy() != expected["depth"]).any()
    # A list of rays has the noise of an image of one row.
    row = rays.directions[8:9]
    plain = dataclasses.replace(FULL, ring_sigma=0.0, ring_offsets=None)
    of_row, of_list = (
        wv.render(scene, cameras.Rays(directions, axes="ros_body"), POSES, sensor=plain, frame=0, outputs="depth")
        for directions in (row, row[0])
    )
    np.testing.assert_array_equal(of_row.depth.numpy()[:, 0], of_list.depth.numpy())


def test_fill_random_parameters_and_corruptions(device):
    scene, rays = room(device), lidar()
    filled = wv.render(scene, rays, POSES, sensor=FULL, frame=0, fill=-1.0, outputs=("depth", "reasons"))
    lost = filled.reasons.numpy() != Reason.VALID
    assert lost.any() and (filled.depth.numpy()[lost] == -1.0).all()
    varied = sensors.randomized(FULL, sigma=(0.0, 0.1), rain=(0.0, 50.0))
    numbers = {"frame": 0, "seed": 5, "outputs": ("depth", "reasons")}
    views = wv.render(scene, rays, POSES, sensor=varied, **numbers)
    second = wv.render(scene, rays, POSES[1], view_index=[1], sensor=varied.drawn(seed=5, view_index=1), **numbers)
    np.testing.assert_array_equal(views.depth.numpy()[1], second.depth.numpy()[0])
    holes = sensors.Corruptions(dropout=0.5, of=LidarNoise())
    lost = wv.render(scene, rays, POSES, sensor=holes, **numbers).reasons.numpy() == Reason.DROPOUT
    exact = np.isfinite(wv.render(scene, rays, POSES, outputs="depth").depth.numpy())
    assert abs(lost[exact].mean() - 0.5) < 4 * math.sqrt(0.25 / exact.sum())


@pytest.mark.parametrize("name", ["sigma", "sigma_growth", "weak_sigma", "resolution", "power_sigma", "rain"])
def test_extreme_parameters_leave_depth_and_reasons_consistent(name):
    for value in (5e-324, 1e-30, 1e30, 1.7e308):
        model = LidarNoise(**{"detection_range": 3.0, "weak_sigma": 0.1, "power_sigma": 0.1, name: value})
        views = wv.render(room(), lidar(), POSES, outputs=("depth", "reasons"), sensor=model, frame=0)
        depth, reasons = views.depth.numpy(), views.reasons.numpy()
        np.testing.assert_array_equal(np.isfinite(depth), reasons == Reason.VALID)
        np.testing.assert_array_equal(np.isnan(depth), reasons > Reason.RANGE)
        assert (model.depth_sigma([1.0], lidar()) >= 0).all()


@pytest.mark.parametrize("falls_off", [False, True])
@pytest.mark.parametrize("out", ["new", "given", "same"])
def test_returns_match_the_reference(device, falls_off, out):
    scene, rays = room(device), lidar()
    beams = sensors.spread_beams(rays, 0.1, 7)
    views = wv.render(scene, beams, POSES, outputs=("depth", "normals", "segmentation"))
    incidence = sensors.measure_incidence(views, beams, POSES)
    strength = sensors.reflect(scene, views, incidence, DARK, falls_off=falls_off)
    dual = sensors.gather_returns(views.depth, strength, 7, keep="dual", separation=0.2)
    exact = dual.range.numpy().copy(), dual.intensity.numpy().copy()
    said = reference.measure_returns(FULL, rays, *exact, DRAWS, 3, falls_off=falls_off)
    target = {"new": None, "given": sensors.gather_returns(views.depth, strength, 7, keep="dual"), "same": dual}[out]
    found = FULL.apply(dual, rays, falls_off=falls_off, out=target, **NUMBERS)
    assert target is None or found is target
    sure = said[2] > 1e-4
    assert sure.mean() > 0.95 and np.isfinite(exact[0][:, 1]).any()
    np.testing.assert_allclose(found.range.numpy()[sure], said[0][sure], rtol=1e-4)
    np.testing.assert_allclose(found.intensity.numpy()[sure], said[1][sure], rtol=1e-4)
    assert np.isinf(found.range.numpy()[found.intensity.numpy() == 0]).all()


def test_single_returns_have_the_noise_of_images(device):
    """With one ray in a beam, `apply` measures what the sensor does, also for a moving lidar."""
    scene, rays = room(device), lidars.even(16, (-0.5, 0.3), increment=math.radians(2.5), rate=10.0)
    model = dataclasses.replace(FULL, reflectivity=1.0)
    for poses in (POSES, sensors.Motion.from_twist(POSES, (3.0, 1.0, 0.0), (0.0, 0.0, 2.0))):
        seen = wv.render(scene, rays, poses, outputs=("depth", "reasons"), sensor=model, **NUMBERS)
        expected = np.where(seen.reasons.numpy() == Reason.VALID, seen.depth.numpy(), np.inf)
        exact = wv.render(scene, rays, poses, outputs=("depth", "normals", "segmentation"))
        strength = sensors.reflect(scene, exact, sensors.measure_incidence(exact, rays, poses))
        found = model.apply(sensors.gather_returns(exact.depth, strength, 1), rays, **NUMBERS)
        agree = np.isclose(found.range.numpy()[:, 0], expected, rtol=1e-4)
        assert agree.mean() > 0.998


@pytest.mark.parametrize("kind", ["range", "origins", "z"])
def test_moving_lidar_matches_the_reference(device, kind):
    scene, times = room(device), np.broadcast_to(np.linspace(0, 0.1, 144), (16, 144))
    even, starts = lidar(), POSES
    options = {"times": times, "rings": even.rings, "near": 0.4, "far": 3.4, "axes": "ros_body"}
    rays = cameras.Rays(even.directions, **options)
    if kind == "origins":
        rays = cameras.Rays(even.directions, 0.05 * even.directions, **options)
    if kind == "z":
        flat = planar()
        rays = cameras.Rays(flat.directions, times=times[:, :40], rings=flat.rings, near=0.4, far=3.4, kind="z")
        starts = np.stack([wv.look_at((0, 0, 0), at) for at in [(1, -0.2, 0), (1, 1, 0), (-1, 0, -0.5)]])
    motion = sensors.Motion.from_twist(starts, (2.0, 1.0, 0.0), (0.0, 0.0, 2.0))
    views = wv.render(scene, rays, motion, outputs=(*OUTPUTS, "points"), sensor=FULL, **NUMBERS)
    seen = images(views, (*OUTPUTS, "points"))
    poses = np.moveaxis(motion.at(rays.times), 2, 0)
    shares = [DARK[name] for name in ("room", "ball")]
    said = reference.measure_lidar(FULL, rays, poses, seen, shares, DRAWS, 3)
    sure = said.margin > 1e-3
    assert sure.mean() > 0.95
    np.testing.assert_array_equal(seen["reasons"][sure], said.reasons[sure])
    np.testing.assert_allclose(seen["depth"][sure], said.depth[sure], rtol=1e-4)
    origins = 0.0 if rays.origins is None else rays.origins
    for view in range(3):
        points = reference.back_project_moving(poses[view], rays.rays, origins, seen["depth"][view])
        np.testing.assert_allclose(seen["points"][view], points, atol=2e-6)
    still = wv.render(scene, rays, starts, outputs=OUTPUTS, sensor=FULL, **NUMBERS)
    stopped = wv.render(scene, rays, sensors.Motion([starts] * 2, [0.0, 0.1]), outputs=OUTPUTS, sensor=FULL, **NUMBERS)
    ball = [[1.5, -0.5, 0, 0, 0, 0, 1]]
    rest = sensors.Motion([ball, ball], [0.0, 0.1])
    at_rest = wv.render(scene, rays, starts, object_poses=rest, outputs=OUTPUTS, sensor=FULL, **NUMBERS)
    for found in (stopped, at_rest):
        same = np.isclose(still.depth.numpy(), found.depth.numpy(), atol=1e-5, equal_nan=True)
        assert same.mean() > 0.998


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sigma": -1.0}, "sigma must be a finite number of m from 0 up, got -1.0"),
        ({"resolution": np.inf}, "resolution must be a finite number of m from 0 up, got inf"),
        ({"rain": "heavy"}, "rain must be a finite number of mm/h from 0 up, got 'heavy'"),
        ({"power_sigma": -0.1}, "power_sigma must be a finite number from 0 up"),
        ({"dropout": 1.5}, "dropout must be a number from 0 to 1"),
        ({"false_returns": "often"}, "false_returns must be a number from 0 to 1"),
        ({"false_range": 0.0}, "false_range must be above 0 m"),
        ({"detection_range": 0.0}, "detection_range must be above 0 m, got 0.0"),
        ({"detection_range": 50, "detection_reflectivity": 0}, "detection_reflectivity must be above 0"),
        ({"visibility": math.nan}, "visibility must be above 0 m, got nan"),
        ({"rain": 5.0}, "detection_range must be a number of m if rain is given, got inf"),
        ({"visibility": 50.0}, "detection_range must be a number of m if visibility is given"),
        ({"weak_sigma": 0.1}, "detection_range must be a number of m if weak_sigma is given"),
        ({"ring_offsets": 0.1}, "ring_offsets must be a list"),
        ({"ring_offsets": [0.1, "a"]}, r"ring_offsets\[1\] must be a finite number, got 'a'"),
    ],
)
def test_invalid_parameters_raise(arguments, message):
    with pytest.raises(wv.errors.ArrayError, match=message):
        LidarNoise(**arguments)


def test_unsupported_rays_and_scenes_raise():
    scene = room()
    with pytest.raises(wv.errors.CameraError, match=r"camera of LidarNoise must be warpvis\.cameras\.Rays, .* Camera"):
        wv.render(scene, wv.Camera.kinect(), POSES, sensor=LidarNoise())
    with pytest.raises(wv.errors.CameraError, match=r"camera of NguyenNoise must be a warpvis\.Camera, got Rays"):
        wv.render(scene, lidar(), POSES, sensor=sensors.NguyenNoise())
    with pytest.raises(wv.errors.CameraError, match="camera must be rays with rings for ring_sigma, got rays without"):
        wv.render(scene, lidars.laser_scan(), POSES, sensor=LidarNoise(ring_sigma=0.1))
    with pytest.raises(wv.errors.ArrayError, match="ring_offsets must have a number of m for each ring from 0 to 15"):
        wv.render(scene, lidar(), POSES, sensor=LidarNoise(ring_offsets=[0.1]))
    with pytest.raises(wv.errors.SceneError, match="the scene has no object 'cat', given in reflectivity"):
        wv.render(scene, lidar(), POSES, sensor=LidarNoise(reflectivity={"cat": 0.1}))
    motion = sensors.Motion([POSES[0]] * 2, [0.0, 0.1])
    with pytest.raises(wv.errors.CameraError, match="sensor must be a LidarNoise or None for a Motion"):
        wv.render(scene, lidars.vlp16(), motion, sensor=sensors.randomized(LidarNoise(), sigma=(0.0, 0.1)))


def test_invalid_returns_raise():
    rays, empty = lidar(), wp.zeros((1, 1, 16, 144), dtype=wp.float32, device="cpu")
    returns = sensors.Returns(empty, empty)
    with pytest.raises(wv.errors.ArrayError, match="returns must be Returns, got array"):
        FULL.apply(empty, rays)
    with pytest.raises(wv.errors.ArrayError, match=r"returns must have shape \(V, R, 361\), got \(1, 1, 16, 144\)"):
        LidarNoise().apply(returns, lidars.laser_scan())
    with pytest.raises(wv.errors.ArrayError, match=r"returns\.range must be a wp\.array of float32"):
        FULL.apply(sensors.Returns(None, None), rays)
    with pytest.raises(wv.errors.ArrayError, match=r"out\.range must have shape \(1, 1, 16, 144\)"):
        FULL.apply(returns, rays, out=sensors.Returns(empty[0], empty[0]))
    with pytest.raises(wv.errors.ArrayError, match="frame must be"):
        FULL.apply(returns, rays, frame=-1)


def test_rays_with_another_range_share_prepared_data():
    rays = lidar()
    rays.prepared("key", lambda: 5)
    other = rays.with_range(1.0, 2.0)
    assert (other.near, other.far, rays.near, rays.far) == (1.0, 2.0, 0.4, 3.4)
    assert other.prepared("key", lambda: 6) == 5
    with pytest.raises(wv.errors.CameraError, match="0 <= near < far"):
        rays.with_range(2.0, 1.0)
