# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of depth-camera models on the CPU, for 16 pixels at a time, against the same formulas for one pixel."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from reference_redwood import make_table

import warpvis as wv
from warpvis.sensors import Corruptions, KhoshelhamNoise, NguyenNoise, Reason, RedwoodNoise, SimKinect, TimeOfFlight
from warpvis.sensors.depth import _base, _kinect_models

import reference
from support.one_pixel import compute_one_pixel_at_a_time

# The width is a multiple of neither the register width nor the number of pixels that share random words.
CAMERA = wv.Camera.from_fov(149, 37, hfov=1.2, near=0.9, far=2.5)
FLIGHT = TimeOfFlight((80e6, 60e6), signal=4000.0, background=20.0, offset=0.01, wiggle=0.02, min_signal=0.05)
MODELS = {
    "nguyen": NguyenNoise(lateral=3.0, max_angle=1.3),
    "khoshelham": KhoshelhamNoise(),
    "khoshelham, beyond the last step": KhoshelhamNoise(step=0.3, sigma=3.0),
    "khoshelham, smooth": KhoshelhamNoise(rounds=False),
    "corruptions": Corruptions(added=0.05, multiplied=0.02, dropout=0.1, rectangles=(2, 5)),
    "corruptions of a sensor": Corruptions(added=0.05, dropout=0.1, of=KhoshelhamNoise()),
    "simkinect": SimKinect(),
    "redwood": RedwoodNoise(make_table()),
    "flight": FLIGHT,
    "flight, of dark things": dataclasses.replace(FLIGHT, reflectivity=0.4, mixing=False, max_signal=0.15),
}


@pytest.fixture(scope="module")
def room():
    preset = wv.scenes.PRESETS["room"]
    return preset.build(), np.asarray(preset.poses(3), dtype=np.float32)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_rows_equal_single_pixels(room, model, monkeypatch):
    scene, poses = room

    def render(threads):
        options = {"outputs": ("depth", "reasons"), "sensor": model, "seed": 5, "frame": 2, "threads": threads}
        views = wv.render(scene, CAMERA, poses, **options)
        return views.depth.numpy().view(np.uint32), views.reasons.numpy()

    rows = render(2)
    names = "noise", "kinect_noise", "corruptions", "simkinect", "redwood", "sub_rays", "time_of_flight"
    compute_one_pixel_at_a_time(monkeypatch, *names)
    pixels = render(1)
    for mine, theirs in zip(rows, pixels, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert {Reason.VALID, Reason.RANGE} <= set(np.unique(pixels[1]))


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_zero_views(room, model):
    views = wv.render(room[0], CAMERA, np.zeros((0, 7)), outputs=("depth", "reasons", "points"), sensor=model)
    assert views.depth.shape == views.reasons.shape == views.points.shape == (0, 37, 149)


@pytest.mark.parametrize("pattern", [None, (60, 200), (30, 90)])
def test_listed_dots_of_simkinect_equal_rows(room, pattern, monkeypatch):
    """As on a GPU; patterns may be larger or smaller than the image."""
    scene, poses = room
    dots = None if pattern is None else (np.random.default_rng(0).random(pattern) < 0.15).astype(np.uint8) * 200
    options = {"outputs": ("depth", "reasons"), "sensor": SimKinect(pattern=dots), "seed": 5, "frame": 2}
    rows = wv.render(scene, CAMERA, poses, **options)
    compute_one_pixel_at_a_time(monkeypatch, "noise", "simkinect")
    lay_out = _kinect_models._lay_out_dots.__wrapped__
    monkeypatch.setattr(_kinect_models, "_lay_out_dots", lambda *given, listed: lay_out(*given, listed=True))
    listed = wv.render(scene, CAMERA, poses, **options)
    np.testing.assert_array_equal(listed.depth.numpy(), rows.depth.numpy())
    np.testing.assert_array_equal(listed.reasons.numpy(), rows.reasons.numpy())
    assert (rows.reasons.numpy() == Reason.VALID).mean() > 0.01


def test_slopes_of_a_gpu_are_those_of_a_cpu(monkeypatch):
    """A GPU computes them in memory of the call, as one that a captured graph reads must not be freed."""
    camera, made = wv.Camera(149, 37, 101.3, 99.7, 70.1, 20.3), {}

    def scratch(name, shape, dtype):
        return made.setdefault(name, wp.zeros(shape, dtype=dtype, device="cpu"))

    monkeypatch.setattr(_base, "launch", lambda kernel, dim, inputs, _: wp.launch(kernel, dim, inputs, device="cpu"))
    found, cached = (
        _base._slopes_of(camera, SimpleNamespace(scratch=scratch, scene=SimpleNamespace(device=device)))
        for device in (SimpleNamespace(is_cpu=False), wp.get_device("cpu"))
    )
    for one, other, said in zip(found, cached, reference.measure_slopes(camera), strict=True):
        np.testing.assert_array_equal(one.numpy(), said)
        np.testing.assert_array_equal(other.numpy(), said)
    assert list(made.values()) == list(found)
