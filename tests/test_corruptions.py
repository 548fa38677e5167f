# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth corruptions for learning against a double-precision reference and their statistics."""

import math

import numpy as np
import pytest
import reference_corruptions
from scipy import stats

import warpvis as wv
from warpvis.rendering import DepthSensor
from warpvis.sensors import Corruptions, NguyenNoise, Reason, StereoDepth

from support.kinect_noise import CAMERA, images, make_scene, wall
from support.stereo import AHEAD, POSES

OUTPUTS = ("depth", "reasons", "true_depth")
FULL = Corruptions(added=0.02, multiplied=0.03, dropout=0.05, rectangles=(1, 4), sides=(3, 20))


@pytest.mark.parametrize("inner", [None, NguyenNoise(), StereoDepth(0.06, sigma=0.1)], ids=str)
def test_corruptions_match_the_reference(device, inner):
    model = Corruptions(added=0.02, multiplied=0.03, dropout=0.05, rectangles=(1, 4), sides=(3, 20), of=inner)
    scene = make_scene(device)
    numbers = {"seed": 3, "frame": [1, 2, 3], "view_index": [5, 0, 1]}
    seen = images(wv.render(scene, CAMERA, POSES, outputs=OUTPUTS, sensor=model, **numbers), OUTPUTS)
    under = images(wv.render(scene, CAMERA, POSES, outputs=OUTPUTS, sensor=inner or Corruptions(), **numbers), OUTPUTS)
    draws = np.stack([numbers["view_index"], numbers["frame"]], axis=-1)
    said = reference_corruptions.corrupt_depth(model, CAMERA, under["depth"], under["reasons"], draws, 3)
    sure = said.margin > 1e-5
    assert sure.mean() > 0.99
    np.testing.assert_array_equal(seen["reasons"][sure], said.reasons[sure])
    np.testing.assert_allclose(seen["depth"][sure], said.depth[sure], rtol=1e-5)
    assert {Reason.VALID, Reason.EMPTY, Reason.RANGE, Reason.DROPOUT} <= set(np.unique(seen["reasons"]))


def test_default_corruptions_change_nothing(device):
    scene = make_scene(device)
    clean = wv.render(scene, CAMERA, POSES, outputs=("depth",)).depth.numpy()
    views = wv.render(scene, CAMERA, POSES, outputs=("depth", "reasons"), frame=0, sensor=Corruptions())
    np.testing.assert_array_equal(views.depth.numpy(), clean)
    reasons = np.where(np.isfinite(clean), Reason.VALID, Reason.RANGE)
    far = wv.Camera.from_fov(96, 72, hfov=1.0)
    empty = ~np.isfinite(wv.render(scene, far, POSES, outputs=("depth",)).depth.numpy())
    np.testing.assert_array_equal(views.reasons.numpy(), np.where(empty, Reason.EMPTY, reasons))
    inner = StereoDepth(0.06, sigma=0.1)
    over = wv.render(scene, CAMERA, POSES, outputs=("depth",), frame=0, sensor=Corruptions(of=inner)).depth.numpy()
    np.testing.assert_array_equal(
        over, wv.render(scene, CAMERA, POSES, outputs=("depth",), frame=0, sensor=inner).depth.numpy()
    )


def test_batching_threads_and_order(device):
    scene, options = make_scene(device), {"outputs": OUTPUTS, "sensor": FULL, "seed": 4}
    whole = images(wv.render(scene, CAMERA, POSES, threads=1, frame=0, **options), OUTPUTS)
    again = images(wv.render(scene, CAMERA, POSES, threads=3, frame=0, **options), OUTPUTS)
    alone = images(wv.render(scene, CAMERA, POSES[2], view_index=[2], frame=0, **options), OUTPUTS)
    for name in OUTPUTS:
        np.testing.assert_array_equal(again[name], whole[name])
        np.testing.assert_array_equal(alone[name][0], whole[name][2])


@pytest.mark.parametrize(("added", "multiplied"), [(0.01, 0.0), (0.0, 0.01), (0.01, 0.02)])
def test_noise_statistics_at_a_wall(device, added, multiplied):
    camera = wv.Camera.from_fov(160, 120, hfov=1.0)
    views = wv.render(
        wall(2.0, 0.0, device), camera, AHEAD, outputs=OUTPUTS, frame=0, sensor=Corruptions(added, multiplied), seed=8
    )
    error = (views.depth.numpy() - 2.0)[0] / math.hypot(added, 2.0 * multiplied)
    assert abs(error.mean()) < 4 / math.sqrt(error.size)
    assert abs(error.std() - 1) < 4 / math.sqrt(2 * error.size)
    assert stats.kstest(error.ravel(), "norm").pvalue > 1e-4
    assert abs((error[:, 1:] * error[:, :-1]).mean()) < 4 / math.sqrt(error.size)


def test_lost_pixels_and_rectangles_at_a_wall(device):
    """Checks the share of lost pixels, and count, side lengths and variation of rectangles between views."""
    camera = wv.Camera.from_fov(160, 120, hfov=1.0)
    scene, poses = wall(2.0, 0.0, device), np.stack([AHEAD] * 40)
    pixels = wv.render(
        scene, camera, poses, outputs=("reasons",), frame=0, sensor=Corruptions(dropout=0.1)
    ).reasons.numpy()
    lost = pixels == Reason.DROPOUT
    assert abs(lost.mean() - 0.1) < 4 * math.sqrt(0.09 / lost.size)
    model = Corruptions(rectangles=(1, 1), sides=(5, 9))
    found = (
        wv.render(scene, camera, poses, outputs=("reasons",), frame=0, sensor=model).reasons.numpy() == Reason.DROPOUT
    )
    sides = []
    for image in found:
        rows, columns = np.flatnonzero(image.any(axis=1)), np.flatnonzero(image.any(axis=0))
        assert image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].all()
        if 0 < rows[0] and rows[-1] < 119 and 0 < columns[0] and columns[-1] < 159:
            sides += [len(rows), len(columns)]
    assert set(sides) == {5, 6, 7, 8, 9}
    assert len(np.unique(found.reshape(40, -1), axis=0)) == 40


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"added": -1.0}, "added must be a finite number from 0 up"),
        ({"multiplied": np.inf}, "multiplied must be a finite number from 0 up"),
        ({"dropout": 1.5}, "dropout must be a number from 0 to 1"),
        ({"rectangles": 3}, "rectangles must be a list"),
        ({"rectangles": (3,)}, "rectangles must be two whole numbers"),
        ({"rectangles": (3, 2)}, "rectangles must be a minimum and a maximum of at most 256, got 3 and 2"),
        ({"rectangles": (0, 257)}, "at most 256"),
        ({"sides": (0, 4)}, "sides must be a whole number from 1 up"),
        ({"of": "stereo"}, "of must be a model of warpvis.sensors"),
        ({"of": FULL}, "of must not contain Corruptions, because both would use the same"),
    ],
)
def test_invalid_parameters_raise(arguments, message):
    with pytest.raises(wv.errors.ArrayError, match=message):
        Corruptions(**arguments)


def test_requirements_and_errors_of_the_inner_sensor():
    assert Corruptions(of=NguyenNoise()).needs == ("normals",)
    assert Corruptions(of=StereoDepth(0.1)).bytes_per_pixel == StereoDepth(0.1).bytes_per_pixel
    with pytest.raises(
        wv.errors.CameraError, match="near of the camera, or max_disparity, must limit disparities to 8192 px"
    ):
        wv.Renderer(
            make_scene(), wv.Camera.from_fov(9, 9, hfov=1.0), sensor=Corruptions(of=StereoDepth(0.1, band=False))
        )
    assert isinstance(FULL, DepthSensor)
