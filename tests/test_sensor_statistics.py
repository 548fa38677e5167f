# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the noise of all depth-camera models and profiles at walls against their formulas."""

import dataclasses
import math
import sys
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from reference_stereo import noise_correlation
from scipy import ndimage, stats
from sensor_laws import scores, see_dots, spacing_of, steps_of

import warpvis as wv
from warpvis.sensors import (
    Corruptions,
    KhoshelhamNoise,
    NguyenNoise,
    Reason,
    RedwoodNoise,
    SimKinect,
    StereoDepth,
    TimeOfFlight,
)

from support.kinect_noise import make_scene, wall
from support.stereo import AHEAD, POSES

sys.path.append(str(Path(__file__).resolve().parent.parent / "bench"))

CAMERA = wv.Camera(64, 48, 300.0, 300.0, 32.0, 24.0, near=0.05, far=100.0)
OUTPUTS = ("depth", "reasons", "true_depth")
# Each window contains at most one dot.
DOTS = np.zeros((48, 64), dtype=np.uint8)
DOTS[5:43:10, 5:59:10] = 255  # not at the edges, where no dot is found
# Devices without their cameras: their noise formulas hold with any camera and at any depth.
PROFILES = ("realsense_d415", "realsense_d435", "realsense_d455", "oak_d", "kinect_v1", "structure")
STEREO = {name: dataclasses.replace(getattr(wv.sensors, name)(), native_camera=None) for name in PROFILES}
MODELS = {
    "stereo": StereoDepth(0.06, sigma=0.08, noise_spacing=3, locking=0.05, shadow=False, band=False),
    **STEREO,
    "time of flight": TimeOfFlight(10e6, signal=1e6, background=5e3, contrast=0.5),
    "azure_kinect": dataclasses.replace(wv.sensors.azure_kinect(), native_camera=None),
    "azure_kinect, wide": dataclasses.replace(wv.sensors.azure_kinect("wfov_binned"), native_camera=None),
    "kinect_v2": dataclasses.replace(wv.sensors.kinect_v2(), native_camera=None),
    "pmd_flexx2": dataclasses.replace(wv.sensors.pmd_flexx2(), native_camera=None),
    "nguyen": NguyenNoise(),
    "khoshelham": KhoshelhamNoise(),
    "simkinect": SimKinect(focal_length=480.0, pattern=DOTS),
    "simkinect, louder": SimKinect(shift=0.25, focal_length=480.0, sigma=0.6, pattern=DOTS),
    "redwood": RedwoodNoise(np.ones((80, 80, 5))),
    "corruptions": Corruptions(added=0.01, multiplied=0.02),
}


@cache
def tilted(distance, angle, device):
    return wall(distance, angle, device)


def look(model, distance, angle, device, frames=8, camera=CAMERA, threads=None):
    views = wv.render(
        tilted(distance, angle, device),
        camera,
        np.tile(AHEAD, (frames, 1)),
        outputs=OUTPUTS,
        sensor=model,
        seed=3,
        view_index=[0] * frames,
        frame=np.arange(frames),
        threads=threads,
    )
    return {name: getattr(views, name).numpy() for name in OUTPUTS}


def assert_normal(found):
    """Assert that independent samples have the mean, deviation and distribution of a standard normal."""
    assert abs(found.mean()) < 4 / math.sqrt(found.size)
    assert abs(found.std() - 1) < 4 / math.sqrt(2 * found.size)
    assert stats.kstest(found, "norm").pvalue > 1e-4


def independent(model, found):
    """Return finite samples of pixels far enough apart to be independent."""
    apart = spacing_of(model)
    found = found[:, ::apart, ::apart]
    return found[np.isfinite(found)]


def frames_for(model):
    if isinstance(model, SimKinect):
        return 60  # only a few pixels per frame count
    return 60 if spacing_of(model) > 1 else 10


WALLS = [(distance, angle) for distance in (0.5, 1.0, 2.0, 3.5, 5.0) for angle in (0, 20, 40, 61, 80)]
QUICK = {(0.5, 0), (2.0, 40), (3.5, 80)}


@pytest.mark.smoke("*-some-stereo", "*-some-realsense_d415", "*-some-realsense_d435")
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize(
    "walls",
    [sorted(QUICK), pytest.param([one for one in WALLS if one not in QUICK], marks=pytest.mark.slow)],
    ids=["some", "all others"],
)
def test_wall_noise_matches_the_formula(device, name, walls):
    """Scores of the measured value follow the standard normal distribution at each distance and angle."""
    model, judged = MODELS[name], 0
    for distance, angle in walls:
        seen = look(model, distance, angle, device, frames_for(model))
        found = independent(model, scores(model, CAMERA, math.radians(angle), seen))
        if found.size > 200:
            assert_normal(found)
            judged += 1
    # Devices lose walls that are too near or at grazing angles.
    assert judged >= 0.6 * len(walls)


@pytest.mark.parametrize("name", [name for name, model in MODELS.items() if steps_of(model, CAMERA)])
def test_depths_lie_on_all_disparity_levels(device, name):
    """Disparities are whole to a thousandth of a step, and every level between the extremes occurs."""
    model = MODELS[name]
    if isinstance(model, SimKinect):  # below 44 px m, 1/8 px exceeds its steps
        model = dataclasses.replace(model, focal_length=640.0, sigma=0.5)
    seen = look(model, 3.5, 40, device, 40)
    levels = steps_of(model, CAMERA) / seen["depth"][seen["reasons"] == Reason.VALID].astype(np.float64)
    assert np.abs(levels - np.rint(levels)).max() < 1e-3
    taken, counts = np.unique(np.rint(levels), return_counts=True)
    common = taken[counts > 5]
    np.testing.assert_array_equal(common, np.arange(common[0], common[-1] + 1))
    assert len(common) > 8
    assert len(np.unique(levels)) == len(taken)  # one exact depth per level


@pytest.mark.parametrize("name", STEREO)
def test_profile_shadow_and_band_widths(device, name):
    """f b (1 / z1 - 1 / z2) and f b / z px, within 1 px, both on the left; a projector's image has no band.

    The plate spreads over a part of its shadow.
    """
    sensor = getattr(wv.sensors, name)(320, 240)
    camera = dataclasses.replace(sensor.camera(), height=16, cy=8.0)
    near, far = 0.9, 2.8
    scene = wall(far, 0.0, device)
    scene.add(trimesh.creation.box((0.3, 0.02, 8.0)), name="plate", pose=(0, near + 0.01, 0, 0, 0, 0, 1))
    rows = wv.render(scene, camera, AHEAD, outputs=("reasons",), frame=0, sensor=sensor).reasons.numpy()[0]
    for row in rows:
        band, shadow = (np.flatnonzero(row == reason) for reason in (Reason.BAND, Reason.SHADOW))
        assert abs(len(band) - sensor.band * camera.fx * sensor.baseline / far) <= 1
        np.testing.assert_array_equal(band, np.arange(len(band)))
        assert abs(len(shadow) + sensor.fattening - camera.fx * sensor.baseline * (1 / near - 1 / far)) <= 1
        assert abs(shadow[-1] + 1 + sensor.fattening - (camera.cx - camera.fx * 0.15 / near)) <= 1
        np.testing.assert_array_equal(shadow, shadow[0] + np.arange(len(shadow)))


@pytest.mark.parametrize("multiplier", [1.0, 2.5])
def test_redwood_edge_jitter_is_normal(device, multiplier):
    """Over 2,000 draws, a column is foreground as often as a normal shift of 0.25 px predicts."""
    scene = wall(4.0, 0.0, device)
    scene.add(trimesh.creation.box((18, 1e-4, 18)), name="plate", pose=(-9, 2.0, 0, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(24, 20, hfov=0.05)
    model = RedwoodNoise(np.ones((80, 80, 5)), multiplier)
    depth = wv.render(
        scene, camera, np.tile(AHEAD, (100, 1)), outputs=("depth",), frame=0, sensor=model, seed=5
    ).depth.numpy()
    share = (depth < 3.0).mean(axis=(0, 1))
    expected = stats.norm.cdf((11.5 - np.arange(24)) / (0.25 * multiplier))
    deviation = np.sqrt(expected * (1 - expected) / (depth.size / 24))
    assert (np.abs(share - expected) <= 4.5 * deviation + 1e-4).all()


@pytest.mark.parametrize("shift", [0.25, 0.5])
def test_simkinect_lateral_deviation(device, shift):
    """On a slope, dots are found as often as normal shifts leave them within 0.1 px of their window's mean."""
    model = SimKinect(shift, focal_length=480.0, sigma=0.0, pattern=DOTS)
    rows, columns = np.nonzero(DOTS)
    for distance, angle in ((1.0, 61), (2.0, 75)):
        seen = look(model, distance, angle, device, 100)
        _, _, kept = see_dots(model, CAMERA, seen["true_depth"].astype(np.float64))
        expected = kept.mean()
        found = (seen["reasons"][:, rows, columns] == Reason.VALID).mean()
        assert abs(found - expected) < 4 * math.sqrt(expected * (1 - expected) / (100 * len(rows)))
        assert 0.1 < expected < 0.98


@pytest.mark.parametrize("name", MODELS)
def test_noise_correlation_between_pixels_and_frames(device, name):
    """White noise is uncorrelated, smooth noise follows its closed form; frames are uncorrelated."""
    model, frames = MODELS[name], 24
    if isinstance(model, StereoDepth):
        model = dataclasses.replace(model, subpixel=0)  # its rounding error is white
    if isinstance(model, SimKinect):
        model = SimKinect(focal_length=480.0, sigma=1.0)  # large enough to survive rounding
    depth = look(model, 2.0, 0, device, frames)["depth"][:, 8:-8, 16:-8].astype(np.float64)
    assert np.isfinite(depth).all()  # without the band and pixels that simkinect omits
    # A frontal wall, where range and angle vary little; white in 1 / z, approximately.
    noise = 1 / depth - (1 / depth).mean(axis=0)
    noise /= noise.std(axis=0)
    spacing = getattr(model, "noise_spacing", 1)
    apart = noise.size * (1 - 1 / frames) / spacing**2
    for lag in (1, 2, 3, 5, 8):
        expected = noise_correlation(spacing, lag)
        assert abs((noise[:, :, lag:] * noise[:, :, :-lag]).mean() - expected) < 5 / math.sqrt(apart)
        assert abs((noise[:, lag:] * noise[:, :-lag]).mean() - expected) < 5 / math.sqrt(apart)
    # Subtracting the mean of all frames correlates them slightly.
    assert abs((noise[1:] * noise[:-1]).mean() + 1 / (frames - 1)) < 5 / math.sqrt(apart)


@pytest.mark.parametrize("name", MODELS)
def test_results_are_independent_of_batches_threads_and_order(device, name):
    options = {"outputs": OUTPUTS, "sensor": MODELS[name], "seed": 9}
    scene, camera = make_scene(device), dataclasses.replace(CAMERA, fx=60.0, fy=60.0, near=0.5, far=3.0)
    whole = wv.render(scene, camera, POSES, threads=1, frame=[4, 0, 2], **options)
    again = wv.render(scene, camera, POSES, threads=3, frame=[4, 0, 2], **options)
    back = wv.render(scene, camera, POSES[::-1], frame=[2, 0, 4], view_index=[2, 1, 0], **options)
    alone = wv.render(scene, camera, POSES[1], frame=0, view_index=[1], **options)
    for output in OUTPUTS:
        first, second, third, one = (getattr(views, output).numpy() for views in (whole, again, back, alone))
        np.testing.assert_array_equal(second, first)
        np.testing.assert_array_equal(third[::-1], first)
        np.testing.assert_array_equal(one[0], first[1])


@pytest.mark.parametrize("name", MODELS)
def test_gpu_results_equal_cpu_bits(cuda, name):
    """Where the exact images are equal within the reach of a pixel's window."""
    on_cpu, on_gpu = (look(MODELS[name], 2.0, 20, device, 2) for device in ("cpu", cuda))
    same = ndimage.minimum_filter(on_cpu["true_depth"] == on_gpu["true_depth"], size=(1, 15, 15))
    assert same.mean() > 0.1
    for output in OUTPUTS:
        np.testing.assert_array_equal(on_gpu[output][same], on_cpu[output][same])


@pytest.mark.parametrize(("name", "bias"), [("khoshelham", 0.0), ("redwood", 0.0), ("simkinect", 0.5)])
def test_mean_disparity_bias(device, name, bias):
    """Over walls within one step; simkinect's disparities are half a step too large, as in its reference program."""
    model, errors = MODELS[name], []
    for distance in np.linspace(2.0, 2.02, 8):
        seen = look(model, float(distance), 0, device, 4)
        there = np.isfinite(seen["depth"])
        steps = steps_of(model, CAMERA)
        errors.append((steps / seen["depth"].astype(np.float64) - steps / seen["true_depth"])[there].mean())
    assert np.mean(errors) == pytest.approx(bias, abs=0.2)


@pytest.mark.slow  # whole images of a room
def test_depth_errors_match_icl_nuim_formula():
    """Kinect models have the formula's error at every depth; simkinect is biased by half a disparity step."""
    import depth_errors

    exact, errors = depth_errors.measure(16)
    for low, high in pairwise(depth_errors.BANDS):
        there = (exact >= low) & (exact < high)
        found = {name: depth_errors.middle_of(all_of[there & np.isfinite(all_of)]) for name, all_of in errors.items()}
        formula = found[depth_errors.FORMULA]
        half_step = (2.85e-3 / 2 * exact[there].astype(np.float64) ** 2).mean()
        assert abs(formula.mean()) < 0.05 * half_step
        for name in ("KhoshelhamNoise", "kinect_v1"):
            assert found[name].std() == pytest.approx(formula.std(), rel=0.15)
            assert abs(found[name].mean()) < 0.1 * half_step
        assert found["SimKinect"].mean() == pytest.approx(-half_step, rel=0.3)
        assert 1.5 < found["SimKinect"].std() / formula.std() < 2.5
