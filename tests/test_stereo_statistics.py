# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the statistics of stereo sensors at walls, in disparities, where noise is drawn."""

import dataclasses

import numpy as np
import pytest
import trimesh
from reference_stereo import noise_correlation, noise_correlations
from scipy import ndimage, stats

import warpvis as wv
from warpvis.sensors import Reason, StereoDepth

CAMERA = wv.Camera.from_fov(320, 240, hfov=1.0, near=0.05, far=100.0)
BASELINE = 0.06
SCALE = CAMERA.fx * BASELINE
_NAMES = (
    "realsense_d405", "realsense_d415", "realsense_d435", "realsense_d455", "gemini_335", "zed_2i", "oak_d",
    "kinect_v1", "structure",
)  # fmt: skip
PROFILES = [getattr(wv.sensors, name) for name in _NAMES]
AHEAD = wv.look_at((0, 0, 0), (0, 1, 0))


def wall(distance, angle=0.0):
    """Return a wall in front of a camera that looks along y, rotated about the vertical by `angle` [deg]."""
    turned = trimesh.creation.box((60, 0.02, 60))
    turned.apply_translation((0, 0.01, 0))
    turned.apply_transform(trimesh.transformations.rotation_matrix(np.radians(angle), (0, 0, 1)))
    scene = wv.Scene()
    scene.add(turned, name="wall", pose=(0, distance, 0, 0, 0, 0, 1))
    return scene


def measured(scene, sensor, camera=CAMERA, frames=1, seed=0):
    """Return measured and true disparities, (frames, H, W) with NaN where invalid, and reasons."""
    poses = np.tile(AHEAD, (frames, 1))
    views = wv.render(
        scene,
        camera,
        poses,
        outputs=("depth", "true_depth", "reasons"),
        sensor=sensor,
        seed=seed,
        view_index=[0] * frames,
        frame=np.arange(frames),
    )
    scale = (sensor.focal_length or camera.fx) * sensor.baseline
    depth, true, reasons = (image.numpy() for image in (views.depth, views.true_depth, views.reasons))
    valid = reasons == Reason.VALID
    with np.errstate(divide="ignore", invalid="ignore"):
        found, exact = (np.where(valid, scale / image.astype(np.float64), np.nan) for image in (depth, true))
    return found, exact, reasons


def only(values):
    return values[np.isfinite(values)]


@pytest.mark.parametrize("angle", [0, 40, 80])
@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0, 5.0])
def test_disparity_noise_is_normal_at_all_angles(distance, angle):
    """Mean, deviation and distribution of disparities; noise is independent of the surface."""
    sensor = StereoDepth(BASELINE, sigma=0.08, shadow=False, band=False)
    found, exact, _ = measured(wall(distance, angle), sensor, seed=7)
    errors = only(found - exact)
    count = errors.size
    assert count > 30_000
    assert abs(errors.mean()) < 4 * 0.08 / np.sqrt(count)
    assert abs(errors.std() - 0.08) < 4 * 0.08 / np.sqrt(2 * count)
    # The rounding of depth, 1e-7 relative, is negligible.
    assert stats.kstest(errors / 0.08, "norm").pvalue > 1e-4


def test_depth_noise_grows_quadratically_and_is_skewed():
    """z = f b / (d + n): deviation z^2 sigma / (f b); the mean is farther by z^3 sigma^2 / (f b)^2."""
    for distance in (1.0, 2.0, 4.0):
        sensor = StereoDepth(BASELINE, sigma=0.1, shadow=False, band=False)
        found, _, _ = measured(wall(distance), sensor, frames=10)
        depth = SCALE / only(found)
        deviation = distance**2 * 0.1 / SCALE
        assert abs(depth.std() / deviation - 1) < 0.01 + (distance * 0.1 / SCALE) ** 2 * 10
        farther = distance**3 * 0.01 / SCALE**2
        assert abs(depth.mean() - distance - farther) < 4 * deviation / np.sqrt(depth.size) + 0.1 * farther


@pytest.mark.parametrize("subpixel", [1, 8, 32])
def test_disparities_are_quantized(subpixel):
    """All multiples of the step between the extremes occur, no others; each has one exact depth."""
    sensor = StereoDepth(BASELINE, subpixel=subpixel, shadow=False, band=False)
    found, exact, _ = measured(wall(1.5, 60), sensor)
    assert np.abs(only(found - exact)).max() <= 0.5 / subpixel + 1e-4
    found, _, _ = measured(wall(1.5, 60), dataclasses.replace(sensor, sigma=0.5 / subpixel))
    levels = only(found) * subpixel
    assert np.abs(levels - np.rint(levels)).max() < 1e-3
    taken = np.unique(np.rint(levels))
    np.testing.assert_array_equal(taken, np.arange(taken[0], taken[-1] + 1))
    assert len(taken) > 5
    assert len(np.unique(only(found))) == len(taken)


def test_pixel_locking_has_a_period_of_one_pixel():
    sensor = StereoDepth(BASELINE, locking=0.07, shadow=False, band=False)
    found, exact, _ = measured(wall(1.5, 60), sensor)
    errors, true = only(found - exact), only(exact)
    np.testing.assert_allclose(errors, 0.07 * np.sin(2 * np.pi * true), atol=2e-5)


@pytest.mark.smoke("2")
@pytest.mark.parametrize("spacing", [1, 2, 3, 8])
def test_noise_correlation_matches_spacing(spacing):
    """Equal deviation at every pixel, correlation by the closed form along x and y, none between frames."""
    sensor = StereoDepth(BASELINE, sigma=0.08, noise_spacing=spacing, shadow=False, band=False)
    found, exact, _ = measured(wall(1.0), sensor, frames=60)
    noise = (found - exact) / 0.08
    frames, height, width = noise.shape
    apart = frames * height * width / spacing**2  # number of independent draws
    assert abs(noise.mean()) < 4 / np.sqrt(apart)
    assert abs(noise.var() - 1) < 4 * np.sqrt(2 / apart)
    of_places = (noise**2).mean(axis=0)
    for place in range(spacing):
        there = of_places[place::spacing, place::spacing].mean()
        assert abs(there - 1) < 5 * np.sqrt(2 / apart)
    for lag in range(1, 2 * spacing + 2):
        expected = noise_correlation(spacing, lag)
        across = (noise[:, :, lag:] * noise[:, :, :-lag]).mean()
        down = (noise[:, lag:] * noise[:, :-lag]).mean()
        assert abs(across - expected) < 5 / np.sqrt(apart)
        assert abs(down - expected) < 5 / np.sqrt(apart)
        assert lag < 2 * spacing or expected == 0
    between = (noise[1:] * noise[:-1]).mean()
    assert abs(between) < 4 / np.sqrt(apart)


@pytest.mark.parametrize("angle", [0, 60, 70, 80])
def test_dropout_by_angle_and_reflectivity(angle):
    """The lost share follows the signal; the reason is the angle or the reflectivity."""
    options = {"min_signal": 0.1, "full_signal": 0.6, "shadow": False, "band": False}
    camera = wv.Camera.from_fov(320, 240, hfov=0.02)  # rays are nearly parallel
    for reflectivity in (1.0, 0.4):
        sensor = StereoDepth(BASELINE, reflectivity={"wall": reflectivity}, dropout=0.1, **options)
        _, _, reasons = measured(wall(2.0, angle), sensor, camera, frames=5)
        cosine = np.cos(np.radians(angle))
        plain, dark = (np.clip((signal - 0.1) / 0.5, 0, 1) for signal in (cosine, cosine * reflectivity))
        expected = {Reason.VALID: 0.9 * dark, Reason.GRAZING: 1 - plain, Reason.DROPOUT: plain - 0.9 * dark}
        for reason, share in expected.items():
            # The cosine varies by up to 0.01 within the field of view.
            slack = 4 * np.sqrt(share * (1 - share) / reasons.size) + 0.002
            assert abs((reasons == reason).mean() - share) < slack, reason


@pytest.mark.smoke("*-0.02-4")
@pytest.mark.parametrize("spacing", [2, 4, 5, 16])
@pytest.mark.parametrize("dropout", [0.02, 0.3, 0.97])
def test_clumps_have_the_rate_of_independent_pixels(dropout, spacing):
    """At every position between nodes. `apart` is the number of independent clumps."""
    sensor = StereoDepth(BASELINE, dropout=dropout, hole_spacing=spacing, shadow=False, band=False)
    _, _, reasons = measured(wall(1.0), sensor, frames=60, seed=3)
    lost = reasons == Reason.DROPOUT
    apart = lost.size / (2 * spacing) ** 2
    deviation = np.sqrt(dropout * (1 - dropout) / apart)
    assert abs(lost.mean() - dropout) < 4 * deviation
    for place in range(spacing):
        assert abs(lost[:, place::spacing, place::spacing].mean() - dropout) < 5 * deviation * np.sqrt(2)


@pytest.mark.parametrize("spacing", [2, 4, 5])
def test_correlation_of_holes_matches_spacing(spacing):
    """If half of the pixels are lost, both of two pixels are with probability 1/4 + asin(correlation) / 2 pi."""
    sensor = StereoDepth(BASELINE, dropout=0.5, hole_spacing=spacing, shadow=False, band=False)
    _, _, reasons = measured(wall(1.0), sensor, frames=60, seed=1)
    lost = reasons == Reason.DROPOUT
    apart = lost.size / (2 * spacing) ** 2
    for lag in range(1, 2 * spacing + 2):
        expected = np.mean(0.25 + np.arcsin(noise_correlations(spacing, lag)) / (2 * np.pi))
        assert abs((lost[:, :, lag:] & lost[:, :, :-lag]).mean() - expected) < 5 * 0.5 / np.sqrt(apart)
        assert abs((lost[:, lag:] & lost[:, :-lag]).mean() - expected) < 5 * 0.5 / np.sqrt(apart)
    between = (lost[1:] & lost[:-1]).mean()
    assert abs(between - 0.25) < 4 * 0.5 / np.sqrt(apart)


def test_holes_are_clumps_of_the_spacing():
    """The mean area of connected holes grows with the square of the spacing; independent holes have about one pixel."""
    areas = {}
    for spacing in (1, 4, 8):
        sensor = StereoDepth(BASELINE, dropout=0.1, hole_spacing=spacing, shadow=False, band=False)
        _, _, reasons = measured(wall(1.0), sensor, frames=20)
        lost = reasons == Reason.DROPOUT
        count = sum(ndimage.label(image)[1] for image in lost)
        areas[spacing] = lost.sum() / count
    assert 1.0 < areas[1] < 1.5
    assert 10.0 < areas[4] < 20.0
    assert 3.0 < areas[8] / areas[4] < 5.0


@pytest.mark.parametrize("profile", PROFILES[:-2], ids=lambda profile: profile.__name__)
def test_floor_is_kept_to_the_maximum_range(profile):
    """Seen from 1.2 m, at up to 81 degrees; recordings lose 0.1 % of floors and tables at 60 to 80 degrees."""
    sensor, floor = profile(), wv.Scene()
    floor.add(trimesh.creation.box((60, 60, 0.1)), pose=(0, 0, -1.25, 0, 0, 0, 1))
    down = wv.look_at((0, 0, 0), (0, 4, -1.0))
    views = wv.render(floor, sensor.camera(), down, outputs=("true_depth", "reasons"), frame=0, sensor=sensor, seed=1)
    depth, reasons = views.true_depth.numpy()[0], views.reasons.numpy()[0]
    for distance in (2, 3, 4, 5, 8):
        there = (np.abs(depth - distance) < 0.1) & (reasons != Reason.BAND) & (reasons != Reason.RANGE)
        assert (reasons[there] == Reason.VALID).mean() > 0.995


@pytest.mark.parametrize("angle", [80.0, 82.0, 84.0, 86.0])
def test_steep_surfaces_are_lost_from_a_disparity_gradient_of_one(angle):
    """A wall through (0, 0, z) has the gradient b tan(angle) / z along rows."""
    sensor = StereoDepth(BASELINE, shadow=False, band=False, edge_window=5, min_support=0.6)
    distance = 0.5
    _, _, reasons = measured(wall(distance, angle), sensor, wv.Camera.from_fov(320, 240, hfov=0.05))
    gradient = BASELINE * np.tan(np.radians(angle)) / distance
    middle = reasons[0, 10:-10, 10:-10]
    assert (middle == (Reason.EDGE if gradient > 1 else Reason.VALID)).all()


def test_white_surfaces_need_no_normals_if_hardly_any_signal_is_enough():
    """`full_signal` up to 0.05 is checked only with another reflectivity."""
    sensor = StereoDepth(BASELINE, full_signal=0.05, shadow=False, band=False)
    assert sensor.needs == ()
    assert dataclasses.replace(sensor, full_signal=0.06).needs == ("normals",)
    _, _, reasons = measured(wall(1.0), sensor)
    assert (reasons == Reason.VALID).all()
    dark = dataclasses.replace(sensor, reflectivity=0.02)
    assert dark.needs == ("normals", "segmentation")
    _, _, reasons = measured(wall(1.0), dark)
    assert abs((reasons == Reason.DROPOUT).mean() - 0.6) < 0.05


@pytest.mark.parametrize("profile", PROFILES, ids=lambda profile: profile.__name__)
def test_profiles_at_a_wall(profile):
    """Intel's metrics on the middle 80 %: Z accuracy, subpixel RMS of the plane, and fill rate."""
    sensor = profile()
    camera = sensor.camera()
    distance = max(1.0, 1.5 * camera.near)
    found, exact, reasons = measured(wall(distance), sensor, camera, frames=2)
    middle = (
        slice(None),
        slice(camera.height // 10, -camera.height // 10),
        slice(camera.width // 10, -camera.width // 10),
    )
    errors = (found - exact)[middle]
    assert (reasons[middle] == Reason.VALID).mean() > 0.95  # a wall at angles of up to 36 degrees
    errors = only(errors)
    scale = camera.fx * sensor.baseline
    assert abs(errors.mean()) < (0.5 / sensor.subpixel if sensor.subpixel else 0) + 0.01
    expected = sensor.sigma
    if sensor.subpixel:
        # Rounding adds the offset of the wall's level, up to half a step, and a random part.
        offset = (scale / distance * sensor.subpixel + 0.5) % 1 - 0.5
        expected = expected_rms(offset, sensor.sigma, 1 / sensor.subpixel)
    assert abs(np.sqrt((errors**2).mean()) / expected - 1) < 0.05
    if sensor.band:
        width = scale / distance
        beside = (reasons[0, camera.height // 2] == Reason.BAND).sum()
        assert abs(beside - width) <= 1
    else:
        assert not (reasons == Reason.BAND).any()


def expected_rms(offset, sigma, step):
    """Return the RMS of normal disparities about `offset` steps from a level, rounded to levels."""
    levels = np.arange(-60, 61)
    edges = (np.append(levels - 0.5, levels[-1] + 0.5) - offset) * step / sigma
    share = np.diff(stats.norm.cdf(edges))
    return np.sqrt((share * ((levels - offset) * step) ** 2).sum())


@pytest.mark.parametrize("profile", PROFILES, ids=lambda profile: profile.__name__)
def test_profiles_limit_depth_to_their_range(profile):
    sensor = profile()
    camera = sensor.camera()
    assert sensor.max_disparity == np.inf or camera.near == pytest.approx(
        camera.fx * sensor.baseline / sensor.max_disparity
    )
    scale = camera.fx * sensor.baseline
    farther = scale / min(scale / camera.far - 5 * sensor.sigma, scale / (1.2 * camera.far))
    for distance, sign in ((0.9 * camera.near, -1), (farther, 1)):
        plain = dataclasses.replace(sensor, shadow=False, band=False, full_signal=0.0, min_signal=0.0)
        views = wv.render(wall(distance), camera, AHEAD, outputs=("depth", "reasons"), frame=0, sensor=plain)
        assert (views.reasons.numpy() == Reason.RANGE).mean() > 0.99
        assert (views.depth.numpy() == sign * np.inf).mean() > 0.99
    smaller = profile(width=320, height=240).camera()
    assert (smaller.width, smaller.height) == (320, 240)
    assert smaller.fx == pytest.approx(camera.fx * 320 / camera.width)


def test_kinect_noise_matches_khoshelham():
    """Khoshelham and Elberink 2012: 1.425e-3 z^2 m, with steps of 2.85e-3 z^2 m; averaged over several distances."""
    sensor = wv.sensors.kinect_v1(320, 240)
    whole = dataclasses.replace(sensor, focal_length=580.0)
    for distance in (1.0, 2.0, 3.0, 4.0):
        errors = []
        for share in np.linspace(-0.5, 0.5, 8, endpoint=False):
            disparity = 580 * 0.075 / distance + share / 8
            found, exact, _ = measured(wall(580 * 0.075 / disparity), whole, sensor.camera())
            errors.append(only(43.5 / found - 43.5 / exact))
        rms = np.sqrt(np.mean([np.mean(part**2) for part in errors]))
        assert rms == pytest.approx(1.425e-3 * distance**2, rel=0.1)
        assert 43.5 / (43.5 / distance) ** 2 / 8 == pytest.approx(2.85e-3 * distance**2, rel=0.01)
