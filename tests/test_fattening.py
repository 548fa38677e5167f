# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fattening of foreground surfaces against a double-precision reference and closed forms."""

import dataclasses
import re

import numpy as np
import pytest
import reference_fattening
import warp as wp
from gpu_code import gpu_code
from scipy import ndimage

import warpvis as wv
from warpvis.core.threads import WHOLE_ROW, launch_images
from warpvis.kernels.sensors.fattening import FatteningModel, fatten_surfaces
from warpvis.kernels.sensors.noise import SensorInputs
from warpvis.sensors import Reason, StereoDepth

from support.one_pixel import compute_one_pixel_at_a_time
from support.stereo import AHEAD, CAMERA, FULL, OUTPUTS, POSES, images, make_scene, wall_scene

PLAIN = StereoDepth(0.06, shadow=False, band=False)
SCALE = CAMERA.fx * 0.06
ENDLESS = dataclasses.replace(CAMERA, near=0.0, far=np.inf)


@pytest.mark.smoke("*-3-0.0", "*-1-1.0", "*-4-0.5")
@pytest.mark.parametrize(("reach", "step"), [(1, 1.0), (4, 0.5), (9, 2.0), (3, 0.0)])
def test_fattening_matches_the_reference(device, reach, step):
    """Without noise, depth is bit-identical to that of the pixel selected by the reference."""
    model = dataclasses.replace(PLAIN, fattening=reach, edge_step=step)
    views = wv.render(make_scene(device), ENDLESS, POSES, outputs=("depth", "true_depth"), frame=0, sensor=model)
    exact = views.true_depth.numpy()
    shown, margin = reference_fattening.fatten_surfaces(exact, SCALE, step, reach)
    expected = np.take_along_axis(exact.reshape(3, -1), shown.reshape(3, -1), axis=1).reshape(exact.shape)
    sure = margin > 1e-5
    if step == 0.0:  # no pixel is nearer than itself
        sure, expected = np.ones_like(sure), exact
    assert sure.mean() > 0.99
    assert ((expected != exact).mean() > 0.01) == (step > 0)
    np.testing.assert_array_equal(views.depth.numpy()[sure], expected[sure])


@pytest.mark.parametrize("width", [1, 7, 16, 17, 40])
@pytest.mark.parametrize("reach", [1, 5, 31])
def test_rows_of_any_length_match_the_reference(device, width, reach):
    """Random surfaces, and the index of the pixel that each pixel shows."""
    rng = np.random.default_rng(width)
    depth = rng.choice([0.5, 1.0, 2.0, np.inf], (2, 9, width), p=[0.05, 0.15, 0.5, 0.3]).astype(np.float32)
    model, inputs = FatteningModel(), SensorInputs()
    model.disparity_scale, model.step, model.reach = 10.0, 2.0, reach
    inputs.true_depth, inputs.draws = wp.array(depth, device=device), wp.zeros(2, dtype=wp.vec2ui, device=device)
    inputs.camera = wv.Camera(width, 9, 1.0, 1.0, 0.0, 0.0).device_struct()
    for along_columns in (False, True):
        model.along_columns = along_columns
        fattened = wp.zeros(depth.shape, dtype=wp.float32, device=device)
        shown = wp.zeros(depth.shape, dtype=wp.int32, device=device)
        span = WHOLE_ROW if inputs.true_depth.device.is_cpu else 1
        launch_images(
            fatten_surfaces,
            depth.shape,
            lambda window, to=(fattened, shown): [window, model, inputs, *to],
            device=inputs.true_depth.device,
            span=span,
        )
        inputs.true_depth, inputs.shown = fattened, shown
    expected, _ = reference_fattening.fatten_surfaces(depth, 10.0, 2.0, reach)
    np.testing.assert_array_equal(shown.numpy(), expected)
    taken = np.take_along_axis(depth.reshape(2, -1), expected.reshape(2, -1), axis=1).reshape(depth.shape)
    np.testing.assert_array_equal(fattened.numpy(), taken)


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("reach", [2, 5])
def test_plate_is_wider_and_its_shadow_narrower(device, side, reach):
    """Each edge of the plate and of its shadow moves by `reach` pixels."""
    near, far, baseline = 1.0, 2.5, 0.08
    scene = wall_scene((near, -0.2, 0.2), (far, -10, 10), device=device)
    camera = wv.Camera.from_fov(320, 24, hfov=1.2)
    sensor = StereoDepth(baseline, other_eye=side)
    plain, fat = (
        images(
            wv.render(scene, camera, AHEAD, outputs=("depth", "reasons"), frame=0, sensor=model), ("depth", "reasons")
        )
        for model in (sensor, dataclasses.replace(sensor, fattening=reach))
    )
    plate, wider = (seen["depth"][0] == np.float32(near) for seen in (plain, fat))
    assert plate.any()
    np.testing.assert_array_equal(wider, ndimage.binary_dilation(plate, np.ones((1, 2 * reach + 1))))
    shadow, narrower = (seen["reasons"][0] == Reason.SHADOW for seen in (plain, fat))
    np.testing.assert_array_equal(narrower, shadow & ~wider)
    width = camera.fx * baseline * (1 / near - 1 / far) - reach
    assert (np.abs(narrower.sum(axis=1) - width) <= 1).all()
    band = fat["reasons"][0] == Reason.BAND
    np.testing.assert_array_equal(band, plain["reasons"][0] == Reason.BAND)


def test_foreground_spreads_over_the_sky(device):
    scene = wall_scene((1.0, -0.2, 0.2), device=device)
    model = dataclasses.replace(PLAIN, fattening=3)
    seen = images(wv.render(scene, CAMERA, AHEAD, outputs=OUTPUTS, frame=0, sensor=model))
    exact = np.isfinite(seen["true_depth"][0])
    np.testing.assert_array_equal(seen["reasons"][0] == Reason.VALID, ndimage.binary_dilation(exact, np.ones((7, 7))))
    assert set(np.unique(seen["reasons"])) == {Reason.VALID, Reason.EMPTY}
    # Exact outputs are not shifted.
    np.testing.assert_array_equal(seen["segmentation"][0] >= 0, exact)


def test_fattened_pixels_use_the_foregrounds_reflectivity(device):
    """Normals and reflectivity are the foreground's, in its widened edge too."""
    scene = wall_scene((1.0, -0.2, 0.2), (2.5, -10, 10), device=device)
    for dark, lost in (("plate 1", False), ("plate 0", True)):
        model = StereoDepth(
            0.06,
            shadow=False,
            band=False,
            fattening=4,
            min_signal=0.1,
            full_signal=0.2,
            reflectivity={dark: 0.0},
        )
        outputs = ("depth", "reasons", "true_depth")
        seen = images(wv.render(scene, CAMERA, AHEAD, outputs=outputs, frame=0, sensor=model), outputs)
        plate = ndimage.binary_dilation(seen["true_depth"][0] < 2.0, np.ones((9, 9)))
        np.testing.assert_array_equal(seen["reasons"][0] == Reason.DROPOUT, plate == lost)


def test_batching_threads_and_order(device):
    model = dataclasses.replace(FULL, fattening=3)
    scene, options = make_scene(device), {"outputs": OUTPUTS, "sensor": model, "seed": 4}
    whole = images(wv.render(scene, CAMERA, POSES, threads=1, frame=0, **options))
    again = images(wv.render(scene, CAMERA, POSES, threads=5, frame=0, **options))
    alone = images(wv.render(scene, CAMERA, POSES[1], view_index=[1], frame=0, **options))
    without = images(wv.render(scene, CAMERA, POSES, frame=0, **(options | {"sensor": FULL})))
    for name in OUTPUTS:
        np.testing.assert_array_equal(again[name], whole[name])
        np.testing.assert_array_equal(alone[name][0], whole[name][1])
        assert (name in ("depth", "reasons")) == (without[name].tobytes() != whole[name].tobytes())
    assert model.bytes_per_pixel == FULL.bytes_per_pixel + 16


@pytest.mark.parametrize("width", [1, 15, 65, 160])
def test_rows_equal_single_pixels(monkeypatch, width):
    """Bit for bit, with normals and objects of the surfaces that spread: 16 pixels at a time, and one, as on a GPU."""
    camera = dataclasses.replace(CAMERA, width=width, cx=width / 2)
    options = {"outputs": OUTPUTS, "seed": 4, "frame": 0, "sensor": dataclasses.replace(FULL, fattening=3)}
    rows = images(wv.render(make_scene(), camera, POSES, **options))
    compute_one_pixel_at_a_time(monkeypatch, "fattening", "stereo")
    single = images(wv.render(make_scene(), camera, POSES, **options))
    for name in OUTPUTS:
        np.testing.assert_array_equal(rows[name], single[name], err_msg=name)


def test_edge_shift_is_that_of_the_inner_sensor():
    model = dataclasses.replace(PLAIN, fattening=3)
    assert PLAIN.edge_shift == 0 and model.edge_shift == 3
    assert wv.sensors.Corruptions(of=model).edge_shift == 3 and wv.sensors.Corruptions().edge_shift == 0
    assert wv.sensors.randomized(model, fattening=(1, 5)).edge_shift == 5


def test_invalid_parameters_raise():
    for value, message in ((-1, "fattening must be a whole number from 0 up"), (32, "fattening must be at most 31 px")):
        with pytest.raises(wv.errors.ArrayError, match=message):
            dataclasses.replace(PLAIN, fattening=value)


@pytest.mark.slow
def test_gpu_code_has_no_fused_operations(tmp_path):
    body = gpu_code("warpvis.kernels.sensors.fattening", tmp_path)
    assert re.search(r"\bdiv\.rn\.f32", body)
    assert not re.findall(r"\bfma\.\w+\.f32|\.approx\.|\.ftz\.", body)
