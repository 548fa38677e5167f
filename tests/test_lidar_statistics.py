# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of lidar noise in a sphere and at a wall, compared with the formulas of `LidarNoise`."""

import math

import numpy as np
import pytest
import trimesh
from scipy import stats
from scipy.optimize import brentq
from scipy.special import ndtr

import warpvis as wv
from warpvis.sensors import LidarNoise, Reason, lidars

HERE = [[0.0, 0, 0, 0, 0, 0, 1]]
RAYS = lidars.even(64, (-0.6, 0.6), increment=math.radians(0.5))


def ball(radius, device="cpu"):
    """Return a sphere around the lidar."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.icosphere(5, radius=radius), name="ball")
    return scene


def measure(scene, model, rays=RAYS, views=1, **options):
    """Return measured and exact range, and reasons, (V, H, W)."""
    numbers = {"frame": 0, "view_index": np.arange(views), "outputs": ("depth", "true_depth", "reasons")}
    seen = wv.render(scene, rays, HERE * views, sensor=model, **(numbers | options))
    return seen.depth.numpy().astype(float), seen.true_depth.numpy().astype(float), seen.reasons.numpy()


def assert_rate(found, expected):
    """Check a mean of independent events against their probabilities, within 4 standard deviations."""
    expected = np.broadcast_to(expected, found.shape)
    spread = math.sqrt((expected * (1 - expected)).sum()) / found.size
    assert abs(found.mean() - expected.mean()) < 4 * spread + 1e-9


@pytest.mark.parametrize("radius", [1.0, 8.0, 50.0])
@pytest.mark.parametrize(("sigma", "growth"), [(0.02, 0.0), (0.0, 0.003), (0.01, 0.001)])
def test_range_noise_is_normal_and_white(device, radius, sigma, growth):
    model = LidarNoise(sigma=sigma, sigma_growth=growth)
    depth, exact, reasons = measure(ball(radius, device), model)
    expected = np.sqrt(sigma**2 + (growth * exact) ** 2)
    error = ((depth - exact) / expected)[0]
    assert (reasons == Reason.VALID).all()
    assert abs(error.mean()) < 4 / math.sqrt(error.size)
    assert abs(error.std() - 1) < 4 / math.sqrt(2 * error.size)
    assert stats.kstest(error.ravel(), "norm").pvalue > 1e-4
    for axis in (0, 1):
        pairs = np.moveaxis(error, axis, 0)
        assert abs((pairs[1:] * pairs[:-1]).mean()) < 4 / math.sqrt(error.size)
    other = measure(ball(radius, device), model, frame=1)[0]
    assert abs(((other - exact) * (depth - exact) / expected**2).mean()) < 4 / math.sqrt(error.size)
    np.testing.assert_allclose(model.depth_sigma(exact, RAYS), expected, rtol=1e-6)


def test_ranges_are_multiples_of_the_resolution(device):
    depth, exact, _ = measure(ball(3.0, device), LidarNoise(sigma=0.01, resolution=0.004))
    steps = depth / 0.004
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    levels = np.unique(np.round(steps))
    assert (np.diff(levels[5:-5]) == 1).all() and len(levels) > 10
    expected = LidarNoise(sigma=0.01, resolution=0.004).depth_sigma([3.0], RAYS)[0]
    assert abs((depth - exact).std() / expected - 1) < 4 / math.sqrt(2 * depth.size)
    exact_steps = measure(ball(3.0, device), LidarNoise(resolution=0.5))[0]
    assert set(np.unique(exact_steps)) == {3.0}


def test_ring_errors_are_constant_for_a_seed(device):
    rays = lidars.even(2000, (-0.3, 0.3), (0.0, 0.1), 0.01)
    scene, model = ball(5.0, device), LidarNoise(ring_sigma=0.03)
    depth, exact, _ = measure(scene, model, rays, views=2)
    error = depth - exact
    np.testing.assert_allclose(np.ptp(error, axis=(0, 2)), 0.0, atol=2e-6)
    offsets = error[0, :, 0] / 0.03
    assert stats.kstest(offsets, "norm").pvalue > 1e-4
    later, other = (measure(scene, model, rays, **options)[0] for options in ({"frame": 9}, {"seed": 1}))
    np.testing.assert_allclose(later - exact[:1], error[:1], atol=2e-6)
    assert abs(np.corrcoef((other - exact[:1])[0, :, 0], offsets)[0, 1]) < 4 / math.sqrt(2000)
    given = LidarNoise(ring_offsets=np.linspace(-0.1, 0.1, 64))
    depth, exact, _ = measure(scene, given)
    wanted = np.linspace(-0.1, 0.1, 64)[RAYS.rings]
    np.testing.assert_allclose(depth - exact, wanted[None], atol=2e-6)
    assert given.depth_sigma([1.0], RAYS)[0] == pytest.approx(np.sqrt((wanted**2).mean()))


@pytest.mark.parametrize("dropout", [0.01, 0.4])
def test_dropout_is_independent_of_range(device, dropout):
    for radius in (1.0, 30.0):
        depth, _, reasons = measure(ball(radius, device), LidarNoise(dropout=dropout))
        lost = reasons == Reason.DROPOUT
        assert_rate(lost, dropout)
        assert np.isnan(depth[lost]).all() and np.isfinite(depth[~lost]).all()
        assert_rate(lost[:, :, 1:] & lost[:, :, :-1], dropout**2)


@pytest.mark.parametrize(("reflectivity", "reach"), [(0.1, 12.0), (0.8, 12.0 * math.sqrt(8)), (0.025, 6.0)])
def test_detection_range_follows_from_reflectivity(device, reflectivity, reach):
    """A data sheet's "12 m at 10 %" means that a surface of 80 % is seen to 34 m."""
    model = LidarNoise(detection_range=12.0, detection_reflectivity=0.1, reflectivity={"ball": reflectivity})
    for radius, seen in ((0.98 * reach, True), (1.03 * reach, False)):
        reasons = measure(ball(radius, device), model)[2]
        assert (reasons == (Reason.VALID if seen else Reason.DROPOUT)).all()


def wall(device, distance=4.0):
    """Return a wall ahead of the lidar, and the cosine of incidence of `RAYS`."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.1, 400, 400)), name="wall", pose=(distance + 0.05, 0, 0, 0, 0, 0, 1))
    return scene, np.abs(RAYS.directions[..., 0])


def test_grazing_and_dark_surfaces_disappear(device):
    scene, cosine = wall(device)
    _, exact, reasons = measure(scene, LidarNoise(detection_range=20.0, reflectivity=0.2))
    hit = np.isfinite(exact)
    power = 0.2 * cosine / exact**2 / (0.1 / 20.0**2)
    straight = power / cosine
    sure = hit & (np.abs(power - 1) > 1e-3) & (np.abs(straight - 1) > 1e-3)
    dark = np.where(straight >= 1, Reason.GRAZING, Reason.DROPOUT)
    expected = np.where(hit, np.where(power >= 1, Reason.VALID, dark), Reason.EMPTY)
    np.testing.assert_array_equal(reasons[sure], expected[sure])
    assert {Reason.VALID, Reason.GRAZING, Reason.DROPOUT} <= set(np.unique(reasons[sure]))


def test_detection_rate_falls_gradually_with_noise_of_power(device):
    model = LidarNoise(detection_range=20.0, power_sigma=0.3, reflectivity=0.2)
    scene, cosine = wall(device)
    _, exact, reasons = measure(scene, model, views=4)
    with np.errstate(invalid="ignore"):
        power = 0.2 * cosine / exact**2 / (0.1 / 20.0**2)
    for low, high in ((0.3, 0.7), (0.7, 1.0), (1.0, 1.4), (1.4, 2.0)):
        chosen = np.isfinite(exact) & (power > low) & (power < high)
        assert chosen.sum() > 300
        assert_rate(reasons[chosen] == Reason.VALID, ndtr((power[chosen] - 1) / 0.3))


@np.errstate(invalid="ignore", divide="ignore")
def test_weak_returns_have_more_noise(device):
    model = LidarNoise(detection_range=40.0, weak_sigma=0.05, reflectivity=0.1)
    scene, cosine = wall(device)
    depth, exact, reasons = measure(scene, model, views=4)
    valid = reasons == Reason.VALID
    sigma = 0.05 * np.sqrt(exact**2 / (40.0**2 * cosine))[valid]
    error = (depth - exact)[valid] / sigma
    assert sigma.max() > 0.045 and sigma.min() < 0.006
    assert stats.kstest(error, "norm").pvalue > 1e-4
    ahead = model.depth_sigma([20.0], RAYS)[0]
    assert ahead == pytest.approx(0.05 / 2)


def test_rain_and_fog_shorten_the_range(device):
    assert LidarNoise(detection_range=9.0, visibility=100.0).attenuation == pytest.approx(0.03912, rel=1e-4)
    heavy = LidarNoise(detection_range=9.0, rain=25.0).attenuation
    assert 4342.94 * heavy == pytest.approx(1.076 * 25**0.67, rel=1e-5)  # dB/km
    for weather in ({"visibility": 30.0}, {"rain": 150.0}, {"visibility": 50.0, "rain": 80.0}):
        model = LidarNoise(detection_range=20.0, **weather)
        # A white surface is seen while exp(-2 a r) / r^2 > 0.1 / 20^2.
        reach = brentq(lambda r, a=model.attenuation: math.exp(-2 * a * r) / r**2 - 0.1 / 20.0**2, 1.0, 100.0)
        assert reach < 0.8 * math.sqrt(10) * 20.0
        for radius, seen in ((0.98 * reach, True), (1.03 * reach, False)):
            assert ((measure(ball(radius, device), model)[2] == Reason.VALID) == seen).all()


@pytest.mark.parametrize("radius", [2.0, None], ids=["surface", "sky"])
def test_false_returns_are_exponential(device, radius):
    model = LidarNoise(false_returns=0.3, false_range=1.5)
    rays = lidars.even(64, (-0.6, 0.6), increment=math.radians(0.5), near=0.5)
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), pose=(0, 0, 500, 0, 0, 0, 1))
    if radius is not None:
        scene = ball(radius, device)
    depth, exact, reasons = measure(scene, model, rays)
    false = np.isfinite(depth) & (depth != exact)
    assert_rate(false, 0.3 * (np.exp(-rays.near / 1.5) - np.exp(-exact / 1.5)))
    assert (reasons[false] == Reason.VALID).all()
    assert (reasons[~false] == (Reason.VALID if radius else Reason.EMPTY)).all()
    assert depth[false].min() >= 0.5
    start, end = np.exp(-0.5 / 1.5), np.exp(-exact[false] / 1.5)
    shares = (start - np.exp(-depth[false] / 1.5)) / (start - end)
    assert stats.kstest(shares, "uniform").pvalue > 1e-4
