# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of range values for all Webots releases, noise, resolution and lenses, against values computed by hand."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.webots import Version, add_noise, distort_pixels, quantize, range_values

INF = np.inf
KINECT = {"near": 0.01, "min_range": 0.3, "max_range": 4.5}


def below(value):
    return np.nextafter(np.float32(value), np.float32(0))


def image(*row):
    return np.array(row, dtype=np.float32).reshape(1, 1, -1)


def values_of(row, version, **changed):
    return range_values(image(*row), **(KINECT | {"version": version} | changed))[0, 0]


# Too near, the smallest and largest measured values, slightly too far, too far, nothing.
EDGES = (0.0, 0.1, below(0.3), 0.3, 2.0, below(4.5), 4.5, 9.0, INF)


@pytest.mark.parametrize(
    ("version", "too_near", "too_far"),
    [
        ("V6.0", 4.5, 4.5),
        ("V8.6", 4.5, 4.5),
        ("R2018a", 4.5, 4.5),
        ("R2019b", 4.5, 4.5),
        ("R2020b", 4.5, 4.5),
        ("R2021a", INF, 4.5),
        ("R2021b", INF, 4.5),
        ("R2022a", INF, INF),
        ("R2022b", INF, INF),
        ("R2023b", INF, INF),
        ("R2025a", INF, INF),
    ],
)
@pytest.mark.parametrize("parsed", [False, True])
def test_limits_by_release(version, too_near, too_far, parsed):
    expected = [*[too_near] * 3, 0.3, 2.0, below(4.5), *[too_far] * 3]
    values = values_of(EDGES, Version.parse(version) if parsed else version)
    assert values.dtype == np.float32
    np.testing.assert_array_equal(values, np.array(expected, dtype=np.float32))


@pytest.mark.parametrize("projection", ["cylindrical", "spherical"])
@pytest.mark.parametrize(("version", "beyond"), [("R2020b", 4.5), ("R2021a", INF), ("R2021b", INF), ("R2023b", INF)])
def test_limits_of_stitched_projections(projection, version, beyond):
    values = values_of(EDGES, version, projection=projection)
    expected = [*[beyond] * 3, 0.3, 2.0, below(4.5), *[beyond] * 3]
    np.testing.assert_array_equal(values, np.array(expected, dtype=np.float32))


@pytest.mark.parametrize("version", ["V8.5", "R2018b", "R2021b", "R2022a"])
def test_near_plane_bias(version):
    """f = 4.5: up to 9 mm too low with n = 0.01, a quarter of a meter with n = 0.3."""
    depth = (0.5, 1.0, 2.0, 3.0, 4.0)
    biased = values_of(depth, version, near_bias=True)
    np.testing.assert_allclose(biased, [0.49109, 0.99220, 1.99443, 2.99666, 3.99889], atol=5e-6)
    biased = values_of(depth[1:4], version, near=0.3, near_bias=True)
    np.testing.assert_allclose(biased, [0.75, 1.82143, 2.89286], atol=5e-6)
    # 0.3 is read where z = 0.01 + 0.3 (4.5 - 0.01) / 4.5 = 0.3093.
    too_near = INF if version >= "R2021a" and version.startswith("R") else 4.5
    np.testing.assert_allclose(values_of((0.3092, 0.3094), version, near_bias=True), [too_near, 0.3001], atol=5e-5)
    np.testing.assert_array_equal(values_of((4.5, INF), version, near_bias=True), values_of((4.5, INF), version))


@pytest.mark.parametrize("version", ["R2022b", "R2023a", "R2025a"])
def test_later_releases_have_no_bias(version):
    np.testing.assert_array_equal(values_of(EDGES, version, near_bias=True), values_of(EDGES, version))


def test_bias_is_off_by_default():
    np.testing.assert_array_equal(values_of((0.5, 1.0, 4.0), "R2019a"), image(0.5, 1, 4)[0, 0])


def test_rendered_depth_is_accepted_and_unchanged(device):
    """A plate at 0.2 m in front of a wall at 2 m, with empty space around."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((1, 1, 0.1)), pose=(0, 0, 2.05, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.02, 0.02, 0.1)), pose=(0, 0, 0.25, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(33, 33, hfov=1.0)
    depth = wv.render(scene, camera, (0, 0, 0, 0, 0, 0, 1), outputs=("depth",)).depth
    assert isinstance(depth, wp.array)
    before = depth.numpy().copy()
    values = range_values(depth, **KINECT, version="R2021b")[0]
    assert np.isposinf(values[16, 16])
    assert values[16, 20] == pytest.approx(2.0, rel=1e-6)
    assert values[0, 0] == 4.5
    np.testing.assert_array_equal(depth.numpy(), before)


def test_noise_is_seeded_and_gaussian():
    values = np.full((4, 100, 100), 2.0, dtype=np.float32)
    noisy = add_noise(values, 0.05, 4.5, "R2023b", 7)
    assert noisy.dtype == np.float32 and noisy.shape == values.shape
    np.testing.assert_array_equal(noisy, add_noise(values, 0.05, 4.5, "R2023b", 7))
    assert (noisy != add_noise(values, 0.05, 4.5, "R2023b", 8)).mean() > 0.99
    error = noisy.astype(np.float64) - 2.0
    # 40,000 numbers: bounds are six standard errors.
    assert abs(error.mean()) < 6 * 0.05 / 200
    assert error.std() == pytest.approx(0.05, abs=6 * 0.05 / np.sqrt(80_000))
    assert (np.abs(error) < 0.05).mean() == pytest.approx(0.6827, abs=0.015)


@pytest.mark.parametrize("version", ["V8.6", "R2019a", "R2021b", "R2022a", "R2025a"])
def test_noise_is_in_meters_in_all_releases(version):
    noisy = add_noise(np.full(40_000, 2.0), 0.05, 10.0, version, 0)
    assert noisy.std() == pytest.approx(0.05, rel=0.03)


def test_noise_of_values_out_of_range():
    values = np.array([INF, 4.5, 1.0], dtype=np.float32)
    late, early = (add_noise(values, 0.1, 4.5, version, 3) for version in ("R2022a", "R2021b"))
    assert np.isposinf(late[:2]).all() and np.isfinite(late[2]) and late[2] != 1
    assert np.isposinf(early[0]) and np.isfinite(early[1]) and early[1] != 4.5
    assert early[2] == late[2]
    for version in ("R2020a", "R2023b"):
        np.testing.assert_array_equal(add_noise(values, 0.0, 4.5, version, 3), values)


def test_resolution_rounds_half_up():
    """Infinity is kept."""
    values = np.array([0.0, 0.124, 0.125, 0.374, 0.375, 1.0, 2.26, INF], dtype=np.float32)
    steps = quantize(values, 0.25)
    assert steps.dtype == np.float32
    np.testing.assert_array_equal(steps, np.array([0, 0, 0.25, 0.25, 0.5, 1.0, 2.25, INF], dtype=np.float32))
    np.testing.assert_array_equal(quantize(values, -1), values)


def test_lens_without_distortion_samples_pixel_centers():
    pixels = distort_pixels(5, 3, (0.5, 0.5), (0, 0), (0, 0))
    assert pixels.shape == (3, 5, 2) and pixels.dtype == np.float32
    y, x = np.mgrid[:3, :5] + 0.5
    np.testing.assert_allclose(pixels, np.stack([x, y], axis=-1), rtol=1e-6)


def test_lens_values_computed_by_hand():
    """The pixel at (0.75, 0.25) of 2x2: x = 0.25, y = -0.25 from the center, r2 = 1/8."""
    # k1 = 0.8: bent = 0.1, 1 / c = 1.4.
    pixels = distort_pixels(2, 2, (0.5, 0.5), (0.8, 0), (0, 0))
    shift = 0.1 * 0.25 / 1.4
    np.testing.assert_allclose(pixels[0, 1], [2 * (0.75 - shift), 2 * (0.25 + shift)], rtol=1e-6)
    # k2 = 0.64: bent = 0.01, 1 / c = 1.06.
    pixels = distort_pixels(2, 2, (0.5, 0.5), (0, 0.64), (0, 0))
    shift = 0.01 * 0.25 / 1.06
    np.testing.assert_allclose(pixels[0, 1], [2 * (0.75 - shift), 2 * (0.25 + shift)], rtol=1e-6)
    # p1 = 0.1: x: 0.2 x y = -0.0125; y: 0.1 (r2 + 2 y^2) = 0.025; 1 / c = 0.8.
    pixels = distort_pixels(2, 2, (0.5, 0.5), (0, 0), (0.1, 0))
    np.testing.assert_allclose(pixels[0, 1], [2 * (0.75 + 0.0125 / 0.8), 2 * (0.25 - 0.025 / 0.8)], rtol=1e-6)
    # p2 = 0.1: x: 0.1 (r2 + 2 x^2) = 0.025; y: 0.2 x y = -0.0125; 1 / c = 1.2.
    pixels = distort_pixels(2, 2, (0.5, 0.5), (0, 0), (0, 0.1))
    np.testing.assert_allclose(pixels[0, 1], [2 * (0.75 - 0.025 / 1.2), 2 * (0.25 + 0.0125 / 1.2)], rtol=1e-6)
    # With another center: this pixel is the center.
    pixels = distort_pixels(2, 2, (0.75, 0.25), (0.8, 0.3), (0.1, 0.2))
    np.testing.assert_allclose(pixels[0, 1], [1.5, 0.5], rtol=1e-6)


def test_lens_inverts_browns_model():
    """Brown's model maps the sampled position to the pixel, up to terms of second order."""
    (k1, k2), (p1, p2) = (0.02, -0.01), (0.003, -0.002)
    pixels = distort_pixels(40, 40, (0.5, 0.5), (k1, k2), (p1, p2)).astype(np.float64) / 40 - 0.5
    x, y = pixels[..., 0], pixels[..., 1]
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2 * r2
    back = np.stack(
        [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)], -1
    )
    at = np.stack(np.meshgrid(*[(np.arange(40) + 0.5) / 40 - 0.5] * 2), axis=-1)
    moved, error = np.abs(at - pixels).max(), np.abs(back - at).max()
    assert moved > 5e-3 and error < 0.05 * moved


def test_lens_without_inverse_gives_nan_and_empty_depth(device):
    """k1 = -2 at r2 = 1/8: 1 / c is 0."""
    pixels = distort_pixels(2, 2, (0.5, 0.5), (-2, 0), (0, 0))
    assert np.isnan(pixels).all()
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((9, 9, 1)), pose=(0, 0, 3, 0, 0, 0, 1))
    renderer = wv.Renderer(scene, wv.Camera.from_fov(2, 2, hfov=1.0), outputs=("depth",))
    seen = renderer.render_at((0, 0, 0, 0, 0, 0, 1), pixels.reshape(1, -1, 2)).depth.numpy()
    assert np.isposinf(seen).all()


ONE = np.ones((1, 1, 1), dtype=np.float32)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: values_of([1.0], "R23"), "R23"),
        (lambda: values_of([1.0], 2023), 'version must be a Version or a text like "R2023b", got 2023'),
        (
            lambda: range_values(np.ones((2, 2)), **KINECT, version="R2023b"),
            "depth must have shape (V, H, W), got (2, 2)",
        ),
        (lambda: values_of([1.0, -INF], "R2023b"), "got 1 other of 2 values, the first -inf at (0, 0, 1)"),
        (lambda: values_of([np.nan], "R2023b"), "depth must be from 0 up or +inf, rendered with near 0 and far inf"),
        (lambda: values_of([1.0], "R2023b", near=0), "near must be a positive number of meters, got 0"),
        (lambda: values_of([1.0], "R2023b", min_range=-1), "min_range must be a number of meters from 0 up, got -1"),
        (lambda: values_of([1.0], "R2023b", max_range=INF), "max_range must be a positive number of meters, got inf"),
        (lambda: values_of([1.0], "R2023b", max_range=0.2), "max_range must be beyond near and min_range, got 0.2"),
        (lambda: values_of([1.0], "R2023b", projection="fisheye"), 'projection must be "planar", "cyl'),
        (lambda: values_of([1.0], "R2019a", projection="spherical", near_bias=True), "near_bias is known for planar"),
        (lambda: add_noise(ONE, -1, 4.5, "R2023b", 0), "noise must be a number of meters from 0 up, got -1"),
        (lambda: add_noise(ONE, 1, 0, "R2023b", 0), "max_range must be a positive number of meters, got 0"),
        (lambda: add_noise(ONE, 1, 4.5, "R2023b", 0.5), "seed must be a whole number from 0 up, got 0.5"),
        (lambda: add_noise("far", 1, 4.5, "R2023b", 0), "values must be an array of numbers"),
        (lambda: quantize(ONE, 0), "resolution must be a positive number of meters, got 0"),
        (lambda: quantize(ONE, -2), "resolution must be a positive number of meters, got -2"),
        (lambda: distort_pixels(0, 2, (0, 0), (0, 0), (0, 0)), "width must be a whole number of pixels from 1 up"),
        (lambda: distort_pixels(2, 2, (0, 0, 0), (0, 0), (0, 0)), "center must be two finite numbers"),
        (lambda: distort_pixels(2, 2, (0, 0), (np.nan, 0), (0, 0)), "radial must be two finite numbers"),
        (lambda: distort_pixels(2, 2, (0, 0), (0, 0), 1), "tangential must be two finite numbers, got 1.0"),
    ],
)
def test_invalid_input_raises(call, said):
    with pytest.raises(wv.WarpvisError) as error:
        call()
    assert said in str(error.value)
    assert "\n" not in str(error.value)
