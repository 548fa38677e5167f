# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Active stereo by matching rendered infrared images: errors and holes at walls and plates, and seeds."""

import dataclasses
import sys

import numpy as np
import pytest
import trimesh
from scipy import ndimage

import warpvis as wv
from warpvis.sensors import MatchedStereo, Reason, sensor_from_fields, sensor_to_fields

from support.stereo import AHEAD, box, images, wall_scene

CAMERA = wv.Camera.from_fov(320, 120, hfov=1.2, near=0.2, far=8.0)
SENSOR = MatchedStereo(0.05, max_disparity=64)
SCALE = CAMERA.fx * SENSOR.baseline
OUTPUTS = ("depth", "reasons", "true_depth")


def measure(scene, sensor=SENSOR, poses=AHEAD, **options):
    options = {"frame": 0, "seed": 3, "outputs": OUTPUTS} | options
    return images(wv.render(scene, CAMERA, poses, sensor=sensor, **options), options["outputs"])


def find_pattern(shape, dots):
    """Return the number of local maxima of the pattern."""
    from warpvis.sensors.depth._matched_stereo import _make_pattern

    pattern = _make_pattern(*shape, dots)
    return ((pattern == ndimage.maximum_filter(pattern, 3)) & (pattern > 0.1)).sum()


@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0])
def test_walls_are_measured_to_a_third_of_a_pixel(device, distance):
    seen = measure(wall_scene((distance, -10, 10), device=device))
    valid = seen["reasons"] == Reason.VALID
    errors = SCALE / seen["depth"][valid] - SCALE / distance
    assert abs(np.median(errors)) < 0.3 and np.quantile(np.abs(errors), 0.9) < 0.5
    band = np.arange(CAMERA.width) + 0.5 < SCALE / distance
    assert valid[..., ~band].mean() > 0.97
    assert (seen["reasons"][..., band] == Reason.BAND).mean() > 0.8
    np.testing.assert_array_equal(np.isfinite(seen["depth"]), valid)


def test_plates_spread_and_cast_shadows_to_their_left(device):
    near, far = 0.7, 2.5
    seen = measure(wall_scene((near, -0.1, 0.1), (far, -10, 10), device=device))
    depth, exact = seen["depth"][0], seen["true_depth"][0]
    plate = exact < 1.5
    shadow = np.zeros_like(plate)
    first = plate[60].argmax()
    width = SCALE * (1 / near - 1 / far)
    shadow[:, int(first - width) : first] = True
    lost = ~np.isfinite(depth)
    assert lost[shadow].mean() > 0.5
    assert set(np.unique(seen["reasons"][0][lost & shadow])) <= {Reason.SHADOW, Reason.DROPOUT}
    assert lost[:, plate[60].nonzero()[0][-1] + 10 :].mean() < 0.05
    # The plate is never narrower than half of its width, nor wider than by a window on either side.
    widths = (depth[10:-10] < 1.0).sum(axis=1)
    assert (widths > 0.5 * plate[60].sum()).all()
    assert np.median(widths) <= plate[60].sum() + 2 * SENSOR.window


def test_dark_surfaces_and_the_sky_are_lost(device):
    scene = wall_scene((1.0, -10, 0), (1.0, 0, 0.3), device=device)
    seen = measure(scene, dataclasses.replace(SENSOR, reflectivity={"plate 1": 0.0}))
    reasons, columns = seen["reasons"][0], seen["true_depth"][0][60]
    center = CAMERA.width // 2
    dark = reasons[:, center + 15 : center + 40]
    assert (dark == Reason.DROPOUT).mean() > 0.9
    assert np.isfinite(columns[center + 15 : center + 40]).all()
    assert (reasons[:, 40 : center - 10] == Reason.VALID).mean() > 0.97
    sky = np.isinf(seen["true_depth"][0])
    assert sky.any()
    assert set(np.unique(reasons[sky])) <= {Reason.EMPTY, Reason.VALID, Reason.RANGE}
    assert np.isposinf(seen["depth"][0][reasons == Reason.EMPTY]).all()


def test_near_surfaces_are_out_of_range(device):
    """Their disparity exceeds the maximum."""
    seen = measure(wall_scene((0.15, -10, 10), device=device))
    assert SCALE / 0.15 > SENSOR.max_disparity
    assert (seen["reasons"] == Reason.RANGE).mean() > 0.5
    assert np.isneginf(seen["depth"][seen["reasons"] == Reason.RANGE]).mean() > 0.9


def test_views_alone_and_seeds(device):
    scene = wall_scene((1.0, -0.2, 0.2), (2.0, -10, 10), device=device)
    poses = np.stack([AHEAD, wv.look_at((0.1, 0, 0), (0, 1, 0)), AHEAD])
    whole = measure(scene, poses=poses, frame=5)
    alone = measure(scene, poses=poses[1], frame=5, view_index=[1])
    other = measure(scene, poses=poses, frame=6)
    np.testing.assert_array_equal(whole["depth"][1], alone["depth"][0])
    np.testing.assert_array_equal(whole["reasons"][1], alone["reasons"][0])
    assert (whole["depth"] != other["depth"]).mean() > 0.1
    assert (whole["depth"][0] != whole["depth"][2]).mean() > 0.1  # another view number
    noiseless = dataclasses.replace(SENSOR, noise=0.0)
    pair = [measure(scene, noiseless, poses=poses, frame=frame)["depth"] for frame in (5, 6)]
    np.testing.assert_array_equal(*pair)


def test_objects_of_worlds_are_matched(device):
    scene = wall_scene((2.0, -10, 10), device=device)
    scene.add(trimesh.creation.box((0.3, 0.02, 8.0)), name="plate", pose=(0, 1.0, 0, 0, 0, 0, 1), movable=True)
    seen = measure(scene, poses=np.stack([AHEAD] * 2), object_poses=[[[x, 1.0, 0, 0, 0, 0, 1]] for x in (-0.3, 0.3)])
    for depth, exact in zip(seen["depth"], seen["true_depth"], strict=True):
        assert ((depth < 1.5) & (exact < 1.5)).sum() > 0.7 * (exact < 1.5).sum()


def test_pattern_has_one_dot_per_cell():
    count = find_pattern((320, 240), 2000)
    assert abs(count - 2000) < 0.15 * 2000


def test_fields_restore_the_sensor():
    sensor = dataclasses.replace(SENSOR, native_camera=CAMERA, reflectivity={"a": 0.5})
    assert sensor_from_fields(sensor_to_fields(sensor)) == sensor
    assert sensor.edge_shift == 3


def test_opencv_is_required(monkeypatch):
    scene = wv.Scene()
    box(scene, "box", (1, 1, 1), (0, 2, 0))
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(wv.errors.CameraError, match=r"MatchedStereo needs OpenCV, .* pip install 'warpvis\[stereo\]'"):
        wv.Renderer(scene, CAMERA, sensor=SENSOR)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"baseline": 0.0}, "baseline must be above 0 m"),
        ({"max_disparity": 0}, "max_disparity must be a whole number from 1 up"),
        ({"max_disparity": 2000}, "max_disparity must be at most 1024"),
        ({"window": 4}, "window must be odd, got 4"),
        ({"window": 33}, "window must be at most 31"),
        ({"dots": 0}, "dots must be a whole number from 1 up"),
        ({"dots": 2 * 10**6}, "dots must be at most 1000000"),
        ({"ambient": 0.0}, "ambient must be above 0"),
        ({"noise": 2.0}, "noise must be a number from 0 to 1"),
        ({"min_contrast": -0.1}, "min_contrast must be a number from 0 to 1"),
        ({"uniqueness": 101}, "uniqueness must be at most 100"),
    ],
)
def test_invalid_arguments_raise(arguments, message):
    with pytest.raises(wv.errors.WarpvisError, match=message):
        MatchedStereo(**{"baseline": 0.1, **arguments})
