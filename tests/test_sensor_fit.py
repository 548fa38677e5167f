# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of `fit`: parameters of a depth camera recovered from images of walls."""

import json
import math
import sys

import numpy as np
import pytest
import trimesh
from PIL import Image

import warpvis as wv
from warpvis.cli import main
from warpvis.errors import ArrayError, FileFormatError
from warpvis.sensors import StereoDepth, fit

CAMERA = wv.Camera.from_fov(320, 200, hfov=1.4, near=0.1, far=20.0)
BASELINE = 0.05
WALLS = ((0.6, 0), (1.0, 10), (1.5, 20), (2.0, 0), (3.0, 15), (4.0, 25))  # meters, degrees


def wall(distance, angle):
    """Return a wall at `distance` along the camera's axis (y), rotated by `angle` degrees about the vertical."""
    scene, half = wv.Scene(), math.radians(angle) / 2
    turned = (0.0, distance + 0.01, 0.0, 0.0, 0.0, math.sin(half), math.cos(half))
    scene.add(trimesh.creation.box((60, 0.02 * math.cos(2 * half), 60)), name="wall", pose=turned)
    return scene


def pictures(sensor, walls=WALLS, seed=3, camera=CAMERA):
    pose = wv.look_at((0, 0, 0), (0, 1, 0))
    views = [
        wv.render(wall(*place), camera, pose, sensor=sensor, seed=seed, frame=number, outputs="depth")
        for number, place in enumerate(walls)
    ]
    return np.concatenate([view.depth.numpy() for view in views])


def millimeters(depth):
    return np.rint(np.where(np.isfinite(depth), depth, 0) * 1000) / 1000


@pytest.mark.smoke("smooth-meters-baseline", "without steps-meters-baseline")
@pytest.mark.parametrize(
    "given", [{"baseline": BASELINE}, {"subpixel": "own"}, {}], ids=["baseline", "subpixel", "band"]
)
@pytest.mark.parametrize("rounded", [False, True], ids=["meters", "millimeters"])
@pytest.mark.parametrize(
    "numbers",
    [
        {"sigma": 0.08, "subpixel": 32, "dropout": 0.02},
        {"sigma": 0.05, "subpixel": 32, "noise_spacing": 4, "dropout": 0.05},
        {"sigma": 0.2, "subpixel": 16, "noise_spacing": 2, "dropout": 0.01},
        {"sigma": 0.1, "noise_spacing": 6, "dropout": 0.1},
    ],
    ids=["white", "smooth", "coarse", "without steps"],
)
def test_fit_recovers_sensor_parameters(numbers, rounded, given):
    sensor = StereoDepth(BASELINE, **numbers)
    if given.get("subpixel"):
        if not sensor.subpixel:
            pytest.skip("no steps to tell f b by")
        given = {"subpixel": sensor.subpixel}
    images = pictures(sensor)
    found = fit(millimeters(images) if rounded else images, CAMERA, depth_step=0.001 if rounded else 0.0, **given)
    assert found.focal_baseline == pytest.approx(CAMERA.fx * BASELINE, rel=0.02)
    assert found.sigma == pytest.approx(sensor.sigma, rel=0.05)
    assert found.noise_spacing == sensor.noise_spacing
    assert found.dropout == pytest.approx(sensor.dropout, abs=0.003)
    if sensor.subpixel:
        assert found.step == pytest.approx(1 / sensor.subpixel, rel=0.02)
    else:
        assert found.step == 0
    again = found.sensor()
    assert (again.subpixel, again.noise_spacing) == (sensor.subpixel, sensor.noise_spacing)
    assert again.baseline == pytest.approx(BASELINE, rel=0.02) and again.camera() == CAMERA
    for report, (distance, angle) in zip(found.walls, WALLS, strict=True):
        assert report.distance == pytest.approx(distance, rel=0.01)
        assert math.degrees(report.angle) == pytest.approx(angle, abs=1.0)
        assert report.fill_rate == pytest.approx(1 - sensor.dropout, abs=0.01)
        total = math.hypot(sensor.sigma, 1 / sensor.subpixel / 12**0.5 if sensor.subpixel else 0)
        assert report.subpixel_rms == pytest.approx(total, rel=0.1)


def test_fit_recovers_noise_below_a_step():
    """A sixth of a step: the rounding error dominates the mean square."""
    images = pictures(StereoDepth(BASELINE, sigma=0.02, subpixel=8))
    found = fit(images, CAMERA, baseline=BASELINE)
    assert found.step == pytest.approx(0.125, rel=1e-3)
    assert found.sigma == pytest.approx(0.02, rel=0.05)


def test_noise_free_wall_has_zero_sigma():
    found = fit(pictures(StereoDepth(BASELINE)), CAMERA, baseline=BASELINE)
    assert found.sigma < 1e-4 and found.step == 0 and found.dropout == 0


def test_left_eye_and_foreground_objects():
    sensor = StereoDepth(BASELINE, other_eye="left", sigma=0.05, subpixel=32)
    images = pictures(sensor)
    images[:, 80:130, 140:180] *= 0.7  # a foreground object
    found = fit(images, CAMERA)
    assert found.found_by == "band" and found.focal_baseline == pytest.approx(CAMERA.fx * BASELINE, rel=0.02)
    assert found.sigma == pytest.approx(0.05, rel=0.05)
    assert np.isnan(found.errors[0]).mean() > 0.03


def test_correlations_match_the_model():
    """Each pixel is the sum of the nodes before and after it with weights cos and sin."""
    for spacing in (1, 2, 5, 9):
        sensor = StereoDepth(BASELINE, sigma=0.1, noise_spacing=spacing, band=False, shadow=False)
        found = fit(pictures(sensor, WALLS[:3], camera=CAMERA), CAMERA, baseline=BASELINE)
        assert found.noise_spacing == spacing
        pixels = np.arange(spacing + 20)
        node, angle = pixels // spacing, pixels % spacing / spacing * np.pi / 2
        weights = np.zeros((len(pixels), node[-1] + 2))
        weights[pixels, node], weights[pixels, node + 1] = np.cos(angle), np.sin(angle)
        products = weights @ weights.T
        expected = [np.diagonal(products, lag)[:spacing].mean() for lag in range(20)]
        np.testing.assert_allclose(found.correlation[:20], expected, atol=0.06)


@pytest.mark.slow
def test_report_and_figure(tmp_path):
    found = fit(pictures(StereoDepth(BASELINE, sigma=0.08, subpixel=32)), CAMERA, subpixel=32)
    lines = found.report().splitlines()
    assert lines[0].startswith("6 walls; f b ") and lines[0].endswith("by the subpixel")
    assert "step of disparity   0.03125 px (1/32)" in lines
    assert len(lines) == 7 + 6
    wv.viz.save_sensor_fit(found, tmp_path / "fit.png")
    with Image.open(tmp_path / "fit.png") as picture:
        assert np.asarray(picture.convert("L")).std() > 20


@pytest.mark.smoke("png")
@pytest.mark.parametrize("kind", ["png", "npy", "npy of millimeters"])
def test_command_line_fits(tmp_path, monkeypatch, capsys, kind):
    images = pictures(StereoDepth(BASELINE, sigma=0.08, subpixel=32))
    folder = tmp_path / "walls"
    folder.mkdir()
    for number, image in enumerate(images):
        if kind == "png":
            wv.io.save_depth_png(image, folder / f"{number}.png")
        else:
            units = np.where(np.isfinite(image), image * 1000, 0)
            np.save(folder / f"{number}.npy", image if kind == "npy" else np.rint(units).astype(np.uint16))
    (folder / "notes.txt").write_text("walls of the corridor")
    fields = {"width": CAMERA.width, "height": CAMERA.height, "hfov": 1.4, "near": 0.1, "far": 20.0}
    (tmp_path / "camera.json").write_text(json.dumps(fields))
    monkeypatch.chdir(tmp_path)
    words = ["warpvis", "sensor-fit", "walls", "--camera", "camera.json", "--baseline", "0.05", "--out", "fit.png"]
    monkeypatch.setattr(sys, "argv", words)
    main()
    said = capsys.readouterr().out
    assert "6 walls; f b 9.498 px m, by the baseline" in said and "fit.png: errors" in said
    sigma = float(next(line for line in said.splitlines() if line.startswith("sigma")).split()[3])
    assert sigma == pytest.approx(0.08, rel=0.05)
    assert (tmp_path / "fit.png").is_file()


# ----------------------------------------------------------------------------------------------------------- errors


NOISY = np.full((200, 320), 2.0, dtype=np.float32)


@pytest.mark.parametrize(
    ("images", "options", "message"),
    [
        ([], {}, r"depth_images must contain at least one image, got none"),
        ([np.ones((3, 4))], {}, r"depth_images\[0\] must have the shape \(200, 320\) of the camera, got \(3, 4\)"),
        (
            [NOISY.astype(np.uint16)],
            {},
            r"depth_images\[0\] must be in meters, a float array, got uint16; divide millimeters by 1000",
        ),
        ([np.full((200, 320), np.nan)], {}, r"depth_images\[0\] must have depth at 400 or more pixels, got 0"),
        (
            [NOISY],
            {},
            "f b cannot be determined because no image has an invalid band at a side. Pass baseline or subpixel.",
        ),
        ([NOISY], {"subpixel": 8}, "no steps of disparity were found"),
        ([NOISY], {"baseline": 0}, "baseline must be above 0 m"),
        ([NOISY], {"baseline": -1}, "baseline must be"),
        ([NOISY], {"subpixel": 0}, "subpixel must be"),
        ([NOISY], {"region": 2.0}, "region must be"),
        ([NOISY], {"depth_step": -1.0}, "depth_step must be"),
        (
            [np.random.default_rng(0).uniform(0.5, 5, (200, 320))],
            {"baseline": 0.05},
            r"depth_images\[0\] must show a flat wall",
        ),
    ],
)
def test_invalid_input_raises(images, options, message):
    with pytest.raises(ArrayError, match=message):
        fit(images, CAMERA, **options)


def test_step_that_is_no_unit_fraction_raises():
    found = fit(pictures(StereoDepth(BASELINE, sigma=0.08, subpixel=32)), CAMERA, baseline=BASELINE * 20)
    with pytest.raises(
        ArrayError, match=r"step of disparity must be 1/n px, got .* px. Pass the correct baseline or subpixel."
    ):
        found.sensor()


def test_invalid_depth_files_raise(tmp_path):
    for name, message in (("none.png", "no such file"), ("none.npy", "no such file")):
        with pytest.raises(FileFormatError, match=message):
            wv.io.read_depth(tmp_path / name)
    (tmp_path / "bad.png").write_bytes(b"PNG")
    (tmp_path / "bad.npy").write_bytes(b"NUMPY")
    Image.fromarray(np.zeros((4, 5, 3), dtype=np.uint8)).save(tmp_path / "color.png")
    np.save(tmp_path / "cube.npy", np.zeros((2, 3, 4)))
    expected = {
        "bad.png": "not a PNG image",
        "bad.npy": "cannot be read as NPY",
        "color.png": "expected a gray PNG of 16 bits, as depth cameras' programs write, got mode RGB",
        "cube.npy": r"expected a depth image of shape \(H, W\), got float64 of \(2, 3, 4\)",
    }
    for name, message in expected.items():
        with pytest.raises(FileFormatError, match=message):
            wv.io.read_depth(tmp_path / name)
    with pytest.raises(ArrayError, match="unit must be above 0 m"):
        wv.io.read_depth(tmp_path / "cube.npy", unit=0)
    with pytest.raises(FileFormatError, match="no such folder"):
        wv.io.find_depth_images(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileFormatError, match="has no depth images"):
        wv.io.find_depth_images(tmp_path / "empty")


def test_depth_files_round_trip(tmp_path):
    depth = np.array([[1.234, 0.0, 60.0], [0.001, np.inf, 2.5]])
    wv.io.save_depth_png(depth, tmp_path / "a.png")
    expected = np.array([[1.234, np.nan, 60.0], [0.001, np.nan, 2.5]], dtype=np.float32)
    np.testing.assert_allclose(wv.io.read_depth(tmp_path / "a.png"), expected, rtol=1e-6)
    np.testing.assert_allclose(wv.io.read_depth(tmp_path / "a.png", unit=0.0002), expected / 5, rtol=1e-6)
    np.save(tmp_path / "b.npy", depth.astype(np.float32))
    np.testing.assert_allclose(wv.io.read_depth(tmp_path / "b.npy")[0], expected[0], rtol=1e-6)
