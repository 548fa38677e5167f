# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Kinect models of simkinect and Redwood, compared with double-precision references and closed forms."""

import dataclasses
import json
import math
import pickle

import numpy as np
import pytest
import reference_redwood
import reference_simkinect
import trimesh
from scipy import ndimage

import warpvis as wv
from warpvis.sensors import Reason, RedwoodNoise, SimKinect, sensor_from_fields, sensor_to_fields
from warpvis.sensors.depth._kinect_models import make_pattern

from support.kinect_noise import CAMERA, images, make_scene, wall
from support.stereo import AHEAD, POSES

OUTPUTS = ("depth", "reasons", "true_depth")
TABLE = reference_redwood.make_table()
SPARSE = (np.random.default_rng(3).random((50, 80)) < 0.2) * np.random.default_rng(4).integers(40, 256, (50, 80))
MODELS = {
    "simkinect": SimKinect(),
    "simkinect, own pattern": SimKinect(0.2, 0.1, 400.0, units=200.0, sigma=0.5, pattern=SPARSE),
    "redwood": RedwoodNoise(TABLE),
    "redwood, louder": RedwoodNoise(TABLE[::-1], multiplier=3.0),
}


def say(model, camera, true_depth, draws, seed):
    """Return the results of the references."""
    if isinstance(model, RedwoodNoise):
        return reference_redwood.measure_redwood(model, camera, true_depth, draws, seed)
    dots = make_pattern(camera.height, camera.width) if model.pattern is None else model.pattern
    levels = reference_simkinect.shift_to_levels(model, camera, true_depth, draws, seed)
    found = reference_simkinect.detect_dots(dots, *levels)
    return reference_simkinect.fill_from_dots(model, camera, true_depth, found, draws, seed)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_simulators_match_reference(device, model):
    frames, numbers = [3, 4, 0], [0, 7, 2]
    options = {"outputs": OUTPUTS, "sensor": model, "seed": 11, "frame": frames, "view_index": numbers}
    seen = images(wv.render(make_scene(device), CAMERA, POSES, **options), OUTPUTS)
    said = say(model, CAMERA, seen["true_depth"], np.stack([numbers, frames], axis=-1), 11)
    sure = said.margin > 1e-4
    assert sure.mean() > 0.9
    np.testing.assert_array_equal(seen["reasons"][sure], said.reasons[sure])
    np.testing.assert_allclose(seen["depth"][sure], said.depth[sure], rtol=1e-6)
    lost = Reason.EDGE if isinstance(model, SimKinect) else Reason.DROPOUT
    assert {Reason.VALID, Reason.EMPTY, lost} == set(np.unique(seen["reasons"])) - {Reason.RANGE}
    np.testing.assert_array_equal(np.isnan(seen["depth"]), seen["reasons"] > Reason.RANGE)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_noise_depends_only_on_view_and_frame(device, model):
    scene, options = make_scene(device), {"outputs": OUTPUTS, "sensor": model, "seed": 4}
    whole = images(wv.render(scene, CAMERA, POSES, threads=1, frame=0, **options), OUTPUTS)
    again = images(wv.render(scene, CAMERA, POSES, threads=3, frame=0, **options), OUTPUTS)
    for view in (2, 0):
        alone = images(wv.render(scene, CAMERA, POSES[view], view_index=[view], frame=0, **options), OUTPUTS)
        for name in OUTPUTS:
            np.testing.assert_array_equal(again[name], whole[name])
            np.testing.assert_array_equal(alone[name][0], whole[name][view])
    other = images(wv.render(scene, CAMERA, POSES, frame=1, **options), OUTPUTS)
    assert (other["depth"] != whole["depth"]).mean() > 0.05


def test_pattern_has_one_dot_per_cell():
    dots = make_pattern(480, 640) > 0
    cells = dots[:480, :639].reshape(160, 3, 213, 3)
    assert (cells.sum(axis=(1, 3)) == 1).all()
    assert (np.abs(cells.mean(axis=(0, 2)) - 1 / 9) < 0.01).all()  # 34,080 dots: standard deviation 0.0017
    np.testing.assert_array_equal(make_pattern(100, 200), make_pattern(480, 640)[:100, :200])


def test_simkinect_quantization_at_wall(device):
    """Disparity in 1/8 px, depth in whole centimeters, half a step of 35130 units nearer; no depth at image edges."""
    camera = wv.Camera.from_fov(160, 120, hfov=1.0)
    scale = camera.fx * 0.075
    for distance, units in ((0.7, 100), (1.5, 100), (2.0, 200), (3.2, 100)):
        model = SimKinect(shift=0.0, sigma=0.0, units=units)
        views = wv.render(
            wall(distance, 0.0, device), camera, AHEAD, outputs=("depth", "reasons"), frame=0, sensor=model
        )
        depth, reasons = views.depth.numpy()[0].astype(np.float64), views.reasons.numpy()[0]
        level = np.rint(8 * scale / distance)
        whole = np.rint(8 * scale / level * units)
        expected = 35130 / np.rint(35130 / whole + 0.5) / units
        seen = reasons == Reason.VALID
        np.testing.assert_allclose(depth[seen], expected, rtol=1e-6)
        assert set(np.unique(reasons[~seen])) == {Reason.EDGE}
        # A pixel takes the depth of a dot up to 3 px away; dots lie between column and row 4 and the sixth last ones.
        assert seen[8:-9, 8:-9].all() and not seen[0].any() and not seen[:, -2:].any()
        assert distance - expected < whole**2 / 35130 / units * 1.1 + 0.1 / scale * distance**2


def test_simkinect_shift_samples_neighboring_depth(device):
    """Depths across a tilted wall change with the random shifts."""
    scene = wall(3.0, 0.0, device)
    model = SimKinect(shift=0.5, sigma=0.0, focal_length=580.0)
    camera = wv.Camera.from_fov(60, 48, hfov=0.2)
    flat = wv.render(scene, camera, AHEAD, outputs=("depth",), frame=0, sensor=model).depth.numpy()
    inside = flat[np.isfinite(flat)]
    assert len(np.unique(inside)) == 1  # a fronto-parallel wall has the same depth at adjacent pixels
    tilted = wv.render(wall(3.0, 60.0, device), camera, AHEAD, outputs=OUTPUTS, frame=0, sensor=model, seed=1)
    still = dataclasses.replace(model, shift=0.0)
    clean = wv.render(wall(3.0, 60.0, device), camera, AHEAD, outputs=OUTPUTS, frame=0, sensor=still)
    there = (tilted.reasons.numpy() == Reason.VALID) & (clean.reasons.numpy() == Reason.VALID)
    moved = (580 * 0.075 / tilted.depth.numpy() - 580 * 0.075 / clean.depth.numpy())[there]
    # One pixel across changes 1 / z by tan(60) / fx of the wall's value: 0.5 px of shift, quantized.
    slope = 580 * 0.075 / 3.0 * math.tan(math.radians(60)) / camera.fx
    assert 0 < np.abs(moved).mean() < 2 * slope


def test_simkinect_loses_dots_at_depth_steps(device):
    """Dots are lost on both sides of a depth step, as far as windows get a sixth of their light from across it."""
    scene = wall(3.0, 0.0, device)
    scene.add(trimesh.creation.box((4, 0.01, 8)), name="plate", pose=(-2, 1.5, 0, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(90, 240, hfov=0.3)
    views = wv.render(
        scene, camera, AHEAD, outputs=OUTPUTS, frame=0, sensor=SimKinect(shift=0.0, sigma=0.0, focal_length=580.0)
    )
    lost = (views.reasons.numpy()[0] == Reason.EDGE)[10:-12]
    share = lost.mean(axis=0)
    assert share[20:35].max() == 0 and share[55:70].max() == 0
    assert share[43:47].min() > 0.3
    there = np.isfinite(views.depth.numpy()[0])
    for surface in (1.5, 3.0):
        assert (np.abs(views.depth.numpy()[0][there] - surface) < 0.06).any()


def test_redwood_quantization_at_wall(device, tmp_path):
    """Disparity is 35.13 / (z / factor) in eighths, with each pixel's factor; there is no depth from 10 m on."""
    camera = wv.Camera.from_fov(160, 120, hfov=1.0)
    model = RedwoodNoise(reference_redwood.write_table(tmp_path / "dist-model.txt", TABLE), multiplier=0.0)
    row, column = np.floor(np.arange(120) / 119 * 479 + 0.5) // 6, np.floor(np.arange(160) / 159 * 639 + 0.5) // 8
    cells = TABLE.astype(np.float64)[row.astype(int)[:, None], column.astype(int)]
    for distance, places in ((0.6, (1, 0, 0)), (3.0, (0, 1, 0)), (4.5, (0, 0.25, 0.75)), (9.5, None)):
        views = wv.render(
            wall(distance, 0.0, device), camera, AHEAD, outputs=("depth", "reasons"), frame=0, sensor=model
        )
        depth, reasons = views.depth.numpy()[0], views.reasons.numpy()[0]
        factor = cells[..., 4] if places is None else cells[..., :3] @ places
        levels = 8 * 35.130 * factor / distance
        blind = factor < 1e-5
        assert blind.any()
        np.testing.assert_array_equal(reasons, np.where(blind, Reason.DROPOUT, Reason.VALID))
        sure = ~blind & (np.abs(levels % 1 - 0.5) > 1e-3)
        np.testing.assert_allclose(depth[sure], 8 * 35.130 / np.rint(levels[sure]), rtol=1e-6)
    views = wv.render(wall(10.1, 0.0, device), camera, AHEAD, outputs=("depth", "reasons"), frame=0, sensor=model)
    assert (views.depth.numpy() == np.inf).all() and (views.reasons.numpy() == Reason.RANGE).all()


def test_redwood_samples_every_second_pixel(device):
    model = RedwoodNoise(np.ones((80, 80, 5)), multiplier=0.0)
    views = wv.render(make_scene(device), CAMERA, POSES, outputs=OUTPUTS, frame=0, sensor=model)
    every = np.repeat(np.repeat(views.true_depth.numpy()[:, ::2, ::2], 2, axis=1), 2, axis=2)
    seen = views.reasons.numpy() == Reason.VALID
    levels = 8 * 35.130 / every[seen]
    assert np.abs(8 * 35.130 / views.depth.numpy()[seen] - levels).max() < 0.5 + 1e-3


def test_distortion_tables_are_read(tmp_path):
    """The data set's text file, Habitat's array, and an array argument yield the same table."""
    text = reference_redwood.write_table(tmp_path / "dist-model.txt", TABLE)
    np.save(tmp_path / "dist.npy", TABLE.reshape(80, 400))
    given = RedwoodNoise(TABLE)
    for path in (text, str(tmp_path / "dist.npy")):
        read = RedwoodNoise(path)
        np.testing.assert_array_equal(read.distortion, TABLE)
        assert read == given and hash(read) == hash(given)
    assert given != RedwoodNoise(TABLE, multiplier=2.0) and given != SimKinect()


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_models_round_trip_through_fields_and_pickle(model):
    assert sensor_from_fields(json.loads(json.dumps(sensor_to_fields(model), allow_nan=False))) == model
    assert pickle.loads(pickle.dumps(model)) == model
    assert wv.sensors.Corruptions(of=model) == wv.sensors.Corruptions(of=dataclasses.replace(model))


def test_packed_tables_are_compact_and_validated():
    """Datasets embed tables in shards and manifests; damaged tables raise a one-line error."""
    fields = sensor_to_fields(RedwoodNoise(TABLE))
    assert len(json.dumps(fields)) < 200_000
    assert sensor_from_fields(fields).distortion.dtype == np.float32
    packed = fields["distortion"]
    for key, wrong in (
        ("base64", packed["base64"][:1000]),
        ("base64", "?" + packed["base64"]),
        ("base64", "AAAA" + packed["base64"]),
        ("base64", 3),
        ("shape", [80, 80, 4]),
        ("shape", [80, 80, 6]),
        ("shape", [2**20, 2**20]),
        ("shape", [-80, -80, 5]),
        ("shape", "wide"),
        ("dtype", "object"),
        ("dtype", "<f9"),
        ("dtype", 7),
        ("dtype", "<i4"),
    ):
        with pytest.raises(wv.errors.CameraError, match="the fields of a RedwoodNoise are invalid"):
            sensor_from_fields(fields | {"distortion": packed | {key: wrong}})


def test_damaged_tables_raise_one_line_errors(tmp_path):
    whole = reference_redwood.write_table(tmp_path / "whole.txt", TABLE).read_text()
    np.save(tmp_path / "small.npy", TABLE[:40])
    np.save(tmp_path / "objects.npy", np.array([None]), allow_pickle=True)
    np.save(tmp_path / "endless.npy", np.full((80, 80, 5), np.inf))
    for name, text, said in (
        ("short.txt", whole[: len(whole) // 2], "must have 147203 numbers"),
        ("words.txt", whole.replace("9000.0", "many", 1), "is not a table of distortion factors"),
        ("empty.txt", "", "must have 147203 numbers"),
        ("two.txt", "1\n2\n3\n4\n5\n" + "1 2\n" * 147203, "one per line"),
        ("nan.txt", whole.replace(repr(float(TABLE[1, 1, 0])), "nan", 1), "finite"),
        ("gone.txt", None, "cannot be read: No such file"),
        ("small.npy", None, "must have shape"),
        ("objects.npy", None, "cannot be read as NPY: Object arrays"),
        ("endless.npy", None, "finite factors"),
        ("broken.npy", "no array", "is not a table of distortion factors|cannot be read"),
    ):
        if text is not None:
            (tmp_path / name).write_text(text)
        with pytest.raises(wv.errors.FileFormatError, match=said) as caught:
            RedwoodNoise(tmp_path / name)
        assert name in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SimKinect(shift=-1.0), "shift must be a finite number from 0 up"),
        (lambda: SimKinect(sigma=np.nan), "sigma must be a finite number"),
        (lambda: SimKinect(baseline=0.0), "baseline must be above 0 m"),
        (lambda: SimKinect(focal_length=0.0), "focal_length must be above 0 px"),
        (lambda: SimKinect(units=0), "units must be above 0 per meter"),
        (
            lambda: SimKinect(pattern=np.ones((9, 20), dtype=np.uint8)),
            "pattern must be an image .* 10x10 .*\\(9, 20\\)",
        ),
        (lambda: SimKinect(pattern=np.ones((20, 20))), "pattern must be an image .* float64"),
        (lambda: SimKinect(pattern=np.full((20, 20), 256)), "pattern must be from 0 to 255, got 256 to 256"),
        (lambda: SimKinect(pattern=np.zeros((20, 20), dtype=bool)), "pattern must have dots"),
        (lambda: RedwoodNoise(np.ones((80, 80, 4))), "distortion must have shape .*\\(80, 80, 4\\)"),
        (lambda: RedwoodNoise(np.full((80, 80, 5), np.nan)), "distortion must contain finite factors"),
        (lambda: RedwoodNoise(3), "distortion"),
        (lambda: RedwoodNoise(TABLE, multiplier=-1), "multiplier must be a finite number from 0 up"),
    ],
)
def test_invalid_parameters_are_rejected(make, message):
    with pytest.raises(wv.errors.ArrayError, match=message):
        make()


def test_dots_fill_discs_of_three_pixels(device):
    """A single dot in a window fills the disc around it, and the nearer of two dots wins."""
    dots = np.zeros((48, 60), dtype=np.uint8)
    dots[20, 20] = dots[20, 24] = 255
    camera = wv.Camera.from_fov(60, 48, hfov=0.2)
    model = SimKinect(0.0, focal_length=580.0, sigma=0.0, pattern=dots)
    seen = (
        wv.render(wall(2.0, 0.0, device), camera, AHEAD, outputs=("reasons",), frame=0, sensor=model).reasons.numpy()[0]
        == 0
    )
    distance = ndimage.distance_transform_edt(dots == 0)
    np.testing.assert_array_equal(seen, distance <= 3)
