# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of sensor models with lens cameras: models of depth alone accept them, others raise."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.cameras import LensCamera
from warpvis.cameras.lenses import KannalaBrandt, OpenCVPinhole
from warpvis.sensors import Corruptions, KhoshelhamNoise, NguyenNoise, StereoDepth, TimeOfFlight, randomized

PINHOLE = wv.Camera.from_fov(64, 48, hfov=1.2, near=0.2, far=3.0)
K = (PINHOLE.fx, PINHOLE.fy, PINHOLE.cx, PINHOLE.cy)
LIMITS = {"near": 0.2, "far": 3.0}
BENT = LensCamera(OpenCVPinhole(*K, (0.1, 0.02, 0.001, 0.0)), 64, 48, **LIMITS)
FISHEYE = LensCamera(KannalaBrandt(30.0, 30.0, 32.0, 24.0, (0.01, 0.0, 0.0, 0.0)), 64, 48, kind="range", **LIMITS)
POSES = np.stack([wv.look_at((1.5, y, 1.2), (0, 0, 0.2)) for y in (-0.4, 0.3)])
OUTPUTS = ("depth", "reasons", "true_depth", "points", "segmentation")
CORRUPTED = Corruptions(multiplied=0.02, dropout=0.05, rectangles=(2, 3), sides=(5, 9))


def make_scene(device="cpu"):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((8, 8, 0.1)), name="floor")
    scene.add(trimesh.creation.box((0.5, 0.5, 0.5)), name="box", pose=(0, 0, 0.3, 0, 0, 0, 1))
    return scene


def render(camera, sensor, device="cpu", **options):
    numbers = {"seed": 3, "frame": 0}
    views = wv.render(make_scene(device), camera, POSES, outputs=OUTPUTS, sensor=sensor, **numbers, **options)
    return {name: getattr(views, name).numpy() for name in OUTPUTS}


@pytest.mark.parametrize("sensor", [KhoshelhamNoise(sigma=0.2), CORRUPTED], ids=["Khoshelham", "corruptions"])
def test_lens_without_distortion_equals_pinhole(device, sensor):
    straight = LensCamera(OpenCVPinhole(*K, (0.0, 0.0, 0.0, 0.0)), 64, 48, **LIMITS)
    found, wanted = render(straight, sensor, device), render(PINHOLE, sensor, device)
    same = found["reasons"] == wanted["reasons"]
    assert same.mean() > 0.999 and {0, 1, 2} <= {*np.unique(found["reasons"])}
    for name in ("depth", "true_depth"):
        close = np.isclose(found[name], wanted[name], rtol=1e-5, equal_nan=True)
        assert close[same].mean() > 0.998, name  # values on the border of two quantization steps may differ


@pytest.mark.parametrize("camera", [BENT, FISHEYE], ids=["z", "range"])
@pytest.mark.parametrize("near_plane", ["occlude", "clip"])
def test_corruptions_apply_through_a_lens(device, camera, near_plane):
    """Exact depth is that of the lens, and errors depend on the pixel, not on its ray."""
    found = render(camera, CORRUPTED, device, near_plane=near_plane)
    near = {"near": camera.near} if near_plane == "clip" else {}
    endless = LensCamera(camera.lens, 64, 48, kind=camera.kind, **near)
    exact = wv.render(make_scene(device), endless, POSES, near_plane=near_plane)
    np.testing.assert_array_equal(found["true_depth"], exact.depth.numpy())
    np.testing.assert_array_equal(found["segmentation"], exact.segmentation.numpy())
    pinhole = render(PINHOLE, CORRUPTED, device)
    both = np.isfinite(found["depth"]) & np.isfinite(pinhole["depth"])
    errors, wanted = (image["depth"][both] / image["true_depth"][both] for image in (found, pinhole))
    assert both.mean() > 0.3 and 0.015 < errors.std() < 0.025
    np.testing.assert_allclose(errors, wanted, rtol=1e-6)
    points = wv.back_project(found["depth"], camera, POSES).numpy()
    np.testing.assert_array_equal(found["points"], points)


def test_depth_steps_match_khoshelham(device):
    found = render(BENT, KhoshelhamNoise(), device)
    seen = found["reasons"] == 0
    steps = 1 / found["depth"][seen].astype(np.float64) / 2.85e-3
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    assert (found["depth"] != found["true_depth"])[seen].mean() > 0.9


def test_dataset_round_trips_lens_and_sensor(tmp_path):
    options = {"outputs": ("depth", "reasons"), "sensor": randomized(CORRUPTED, multiplied=(0.0, 0.1)), "seed": 3}
    wv.render_batch(make_scene(), BENT, POSES, tmp_path / "out", **options)
    dataset = wv.open_dataset(tmp_path / "out")
    assert dataset.camera == BENT and dataset.sensor == options["sensor"]
    views = wv.render(make_scene(), BENT, POSES[1], frame=1, **options)
    np.testing.assert_array_equal(dataset["depth"][1], views.depth.numpy()[0])


RAYS = wv.sensors.lidars.laser_scan(-1.0, 1.0, 0.1)
FLAT = wv.cameras.OrthographicCamera(64, 48, 10.0, 10.0, 32.0, 24.0)
SHUTTER = wv.sensors.RollingShutter(PINHOLE, 0.03)


@pytest.mark.parametrize(
    ("sensor", "camera", "message"),
    [
        (StereoDepth(0.05), BENT, r'^camera of StereoDepth must be a warpvis\.Camera, got LensCamera of kind "z"$'),
        (TimeOfFlight(2e7), BENT, r"^camera of TimeOfFlight must be a warpvis\.Camera, got LensCamera"),
        (NguyenNoise(), BENT, r"^camera of NguyenNoise must be a warpvis\.Camera, got LensCamera"),
        (KhoshelhamNoise(), FISHEYE, 'or a LensCamera of kind "z", got LensCamera of kind "range"'),
        (Corruptions(of=StereoDepth(0.05)), BENT, "camera of StereoDepth must be"),
        (CORRUPTED, RAYS, "or a LensCamera, got Rays"),
        (CORRUPTED, SHUTTER, "or a LensCamera, got RollingShutter"),
        (CORRUPTED, FLAT, "or a LensCamera, got OrthographicCamera"),
        (randomized(StereoDepth(0.05), sigma=(0, 1)), BENT, "camera of StereoDepth must be"),
    ],
)
def test_incompatible_cameras_raise(sensor, camera, message):
    with pytest.raises(wv.errors.CameraError, match=message):
        wv.Renderer(make_scene(), camera, sensor=sensor)
