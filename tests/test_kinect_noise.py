# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Published Kinect noise models, compared with double-precision references and figures of the papers."""

import dataclasses
import math
import re

import numpy as np
import pytest
import reference_kinect_noise as twins
import trimesh
from gpu_code import gpu_code
from scipy import stats

import warpvis as wv
from warpvis.sensors import KhoshelhamNoise, NguyenNoise, Reason

from support.kinect_noise import CAMERA, OUTPUTS, images, make_scene, wall
from support.stereo import AHEAD, POSES

MODELS = {
    "nguyen": NguyenNoise(),
    "nguyen, wide": NguyenNoise(lateral=2.5, min_axial=0.03, max_angle=math.radians(70.0)),
    "khoshelham": KhoshelhamNoise(),
    "khoshelham, smooth": KhoshelhamNoise(rounds=False, sigma=3.0),
}


def say(model, camera, clean, draws, seed):
    """Return the results of the reference."""
    if isinstance(model, NguyenNoise):
        return twins.measure_nguyen(model, camera, POSES, clean, draws, seed)
    return twins.measure_khoshelham(model, camera, clean["true_depth"], draws, seed)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_noise_matches_reference(device, model):
    frames, numbers = [3, 4, 0], [0, 7, 2]
    seen = images(
        wv.render(
            make_scene(device),
            CAMERA,
            POSES,
            outputs=OUTPUTS,
            sensor=model,
            seed=11,
            frame=frames,
            view_index=numbers,
        )
    )
    said = say(model, CAMERA, seen, np.stack([numbers, frames], axis=-1), 11)
    sure = said.margin > 1e-3
    assert sure.mean() > 0.9
    np.testing.assert_array_equal(seen["reasons"][sure], said.reasons[sure])
    np.testing.assert_allclose(seen["depth"][sure], said.depth[sure], rtol=2e-5)
    assert {Reason.VALID, Reason.EMPTY, Reason.RANGE} <= set(np.unique(seen["reasons"]))
    assert (Reason.GRAZING in seen["reasons"]) == isinstance(model, NguyenNoise)
    np.testing.assert_array_equal(np.isnan(seen["depth"]), seen["reasons"] > Reason.RANGE)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_noise_depends_only_on_view_and_frame(device, model):
    scene, options = make_scene(device), {"outputs": OUTPUTS, "sensor": model, "seed": 4}
    whole = images(wv.render(scene, CAMERA, POSES, threads=1, frame=0, **options))
    again = images(wv.render(scene, CAMERA, POSES, threads=3, frame=0, **options))
    for view in (2, 0):
        alone = images(wv.render(scene, CAMERA, POSES[view], view_index=[view], frame=0, **options))
        for name in OUTPUTS:
            np.testing.assert_array_equal(again[name], whole[name])
            np.testing.assert_array_equal(alone[name][0], whole[name][view])
    other = images(wv.render(scene, CAMERA, POSES, frame=1, **options))
    assert (other["depth"] != whole["depth"]).mean() > 0.1


@pytest.mark.parametrize(
    "model",
    [NguyenNoise(0.0, 0.0, 0.4, 0.0, lateral=0.0, lateral_growth=0.0), KhoshelhamNoise(sigma=0.0, rounds=False)],
    ids=["nguyen", "khoshelham"],
)
def test_zero_noise_leaves_depth_unchanged(device, model):
    scene = make_scene(device)
    views = wv.render(scene, CAMERA, POSES, outputs=("depth", "reasons"), frame=0, sensor=model)
    clean = wv.render(scene, CAMERA, POSES, outputs=("depth",)).depth.numpy()
    kept = views.reasons.numpy() <= Reason.RANGE
    assert kept.mean() > 0.9
    np.testing.assert_array_equal(views.depth.numpy()[kept], clean[kept])


@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0, 3.0, 5.0])
@pytest.mark.parametrize("angle", [0.0, 30.0, 60.5, 80.0])
def test_nguyen_error_at_walls_is_white_and_normal(device, distance, angle):
    """The error is white and normal with the paper's deviation at its depth and angle."""
    camera = wv.Camera.from_fov(96, 72, hfov=0.1)
    views = wv.render(
        wall(distance, angle, device), camera, AHEAD, outputs=OUTPUTS, frame=0, sensor=NguyenNoise(), seed=2
    )
    seen = images(views)
    assert (seen["reasons"] == Reason.VALID).all()
    clean = seen["true_depth"].astype(np.float64)
    sigma = twins.nguyen_axial(NguyenNoise(), clean, math.radians(angle))
    error = ((seen["depth"] - clean) / sigma)[0]
    assert abs(error.mean()) < 4 / math.sqrt(error.size)
    assert abs(error.std() - 1) < 4 / math.sqrt(2 * error.size)
    assert stats.kstest(error.ravel(), "norm").pvalue > 1e-4
    for lag in (1, 2, 5):
        assert abs((error[:, lag:] * error[:, :-lag]).mean()) < 4 / math.sqrt(error.size)
        assert abs((error[lag:] * error[:-lag]).mean()) < 4 / math.sqrt(error.size)


def test_nguyen_published_figures():
    """Expected values are computed by hand from equations (2) to (4)."""
    model = NguyenNoise()
    for depth, angle, millimeters in [(0.4, 30, 1.2), (1.0, 10, 1.884), (2.0, 60, 6.34684271), (3.0, 45, 14.044)]:
        assert 1000 * twins.nguyen_axial(model, depth, math.radians(angle)) == pytest.approx(millimeters, rel=1e-6)
    assert 1000 * twins.nguyen_axial(model, 1.0, math.radians(80)) == pytest.approx(1.884 + 6.4)
    for angle, pixels in [(0, 0.8), (45, 0.835), (60, 0.87), (80, 1.08)]:
        assert twins.nguyen_lateral(model, math.radians(angle)) == pytest.approx(pixels)


@pytest.mark.parametrize("angle", [0.0, 60.0])
def test_nguyen_lateral_noise_at_edge(device, angle):
    """A pixel shows the far side of a straight edge as often as normal shifts of the paper's deviation predict."""
    scene = wall(4.0, angle, device)
    half = math.radians(angle) / 2
    scene.add(trimesh.Trimesh([[-9, 0, -9], [0, 0, -9], [0, 0, 9], [-9, 0, 9]], [[0, 1, 2], [0, 2, 3]]),
              name="plate", pose=(0, 2.0, 0, 0, 0, math.sin(half), math.cos(half)))  # fmt: skip
    camera = wv.Camera.from_fov(24, 20, hfov=0.05)
    views = wv.render(scene, camera, np.stack([AHEAD] * 100), outputs=("depth",), frame=0, sensor=NguyenNoise(), seed=5)
    depth = views.depth.numpy()
    share = (depth < 3.0).mean(axis=(0, 1))
    away = (12 - (np.arange(24) + 0.5)) / twins.nguyen_lateral(NguyenNoise(), math.radians(angle))
    expected = stats.norm.cdf(away)
    deviation = np.sqrt(expected * (1 - expected) / (depth.size / 24))
    assert (np.abs(share - expected) <= 4.5 * deviation + 1e-3).all()


@pytest.mark.parametrize(
    ("distance", "sigma", "step"), [(1.0, 1.425, 2.85), (2.0, 5.7, 11.4), (4.0, 22.8, 45.6), (5.0, 35.6, 71.25)]
)
def test_khoshelham_published_figures(device, distance, sigma, step):
    """Deviations and quantization steps [mm] at walls, with no depth between levels."""
    camera = wv.Camera.from_fov(160, 120, hfov=1.0)
    scenes = [wall(distance + shift * step / 4000, 0.0, device) for shift in (-2, -1, 0, 1)]
    errors, found = [], []
    for scene in scenes:
        views = wv.render(
            scene, camera, AHEAD, outputs=("depth", "true_depth"), frame=0, sensor=KhoshelhamNoise(), seed=1
        )
        depth = views.depth.numpy().astype(np.float64)
        errors.append(depth - views.true_depth.numpy())
        found.append(np.unique(depth))
    levels = 1 / (2.85e-3 * np.unique(np.concatenate(found)))
    np.testing.assert_allclose(levels, np.round(levels), atol=1e-3)
    assert (np.diff(np.round(levels)[::-1]) == 1).all()
    assert len(levels) >= 4
    steps = 1000 * np.diff(np.unique(found[2]))
    assert np.abs(steps - step).min() < 0.03 * step
    assert 1000 * np.std(errors) == pytest.approx(sigma, rel=0.03)


def test_khoshelham_disparity_error_is_normal(device):
    """The disparity error is white and normal."""
    camera = wv.Camera.from_fov(160, 120, hfov=1.0)
    model = KhoshelhamNoise(rounds=False, sigma=0.5)
    views = wv.render(wall(3.0, 40.0, device), camera, AHEAD, outputs=("depth", "true_depth"), frame=0, sensor=model)
    error = (1 / views.depth.numpy().astype(np.float64) - 1 / views.true_depth.numpy()) / 2.85e-3 / 0.5
    error = error[np.isfinite(error)]
    assert stats.kstest(error, "norm").pvalue > 1e-4
    assert abs((error[1:] * error[:-1]).mean()) < 4 / math.sqrt(error.size)


@pytest.mark.parametrize(
    ("model", "arguments", "message"),
    [
        (NguyenNoise, {"lateral": -1.0}, "lateral must be a finite number from 0 up"),
        (NguyenNoise, {"min_axial": "big"}, "min_axial must be a finite number from 0 up"),
        (NguyenNoise, {"best_depth": np.nan}, "best_depth must be a finite number"),
        (NguyenNoise, {"grazing_angle": 60.0}, "grazing_angle must be from 0 to 1.57"),
        (NguyenNoise, {"max_angle": math.pi / 2}, "max_angle must be from 0 to 1.56"),
        (KhoshelhamNoise, {"step": 0.0}, "step must be above 0 per meter"),
        (KhoshelhamNoise, {"sigma": -0.5}, "sigma must be a finite number from 0 up"),
        (KhoshelhamNoise, {"rounds": "no"}, "rounds must be True or False"),
    ],
)
def test_invalid_parameters_are_rejected(model, arguments, message):
    with pytest.raises(wv.errors.ArrayError, match=message):
        dataclasses.replace(model(), **arguments)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kinect_noise", "corruptions", "simkinect", "redwood", "lidar_noise"])
def test_gpu_code_has_no_fused_or_approximate_operations(tmp_path, name):
    """NVRTC's code contains neither fused single-precision multiply-adds nor approximate instructions."""
    body = gpu_code(f"warpvis.kernels.sensors.{name}", tmp_path)
    assert len(re.findall(r"\bmul\.(?:rn\.)?f32", body)) > 10
    assert not re.findall(r"\bfma\.\w+\.f32|\.approx\.|\.ftz\.", body)
