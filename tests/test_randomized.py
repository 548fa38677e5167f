# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of sensors with randomized parameters: drawn values, and equality with the drawn sensor."""

import dataclasses
import json

import mujoco
import numpy as np
import pytest
import reference_random
import trimesh
from scipy import stats

import warpvis as wv
from warpvis.kernels.constants import STREAM_PARAMETERS
from warpvis.sensors import (
    Corruptions,
    KhoshelhamNoise,
    StereoDepth,
    TimeOfFlight,
    randomized,
    sensor_from_fields,
    sensor_to_fields,
)

CAMERA = wv.Camera.from_fov(45, 30, hfov=1.2, near=0.5, far=3.0)
OUTPUTS = ("depth", "reasons", "true_depth", "points")
POSES = np.stack([wv.look_at((x, 1.5, 1.2), (0, 0, 0.2)) for x in np.linspace(-1, 1, 6)])
STEREO = StereoDepth(0.06, sigma=0.1, noise_spacing=3, subpixel=16, full_signal=0.4, min_signal=0.1)
STEREO_RANGES = {"baseline": (0.05, 0.07), "sigma": (0.0, 0.3), "noise_spacing": (1, 4), "reflectivity": (0.3, 1.0)}
FLIGHT = TimeOfFlight((80e6, 60e6), signal=1e4, min_coherence=0.9)
SENSORS = {
    "stereo": randomized(STEREO, **STEREO_RANGES),
    "each image": randomized(STEREO, per="image", **STEREO_RANGES),
    "two kinds": randomized(STEREO, kinds=2, **STEREO_RANGES),
    "kinds of images": randomized(STEREO, kinds=3, per="image", dropout=(0.0, 0.5)),
    "flight": randomized(FLIGHT, signal=(1e2, 1e5), offset=(-0.02, 0.02)),
    "noise": randomized(KhoshelhamNoise(), sigma=(0.1, 1.0)),
    "corrupted": Corruptions(dropout=0.1, of=randomized(STEREO, baseline=(0.05, 0.07))),
    "corruptions": randomized(Corruptions(of=STEREO), multiplied=(0.0, 0.05), kinds=2),
}


def make_scene(device="cpu"):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((8, 8, 0.1)), name="floor", pose=(0, 0, -0.05, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.5, 0.5, 0.5)), name="box", pose=(0, 0, 0.25, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.5, 0.5, 0.5)), name="cart", pose=(0, 0.7, 0.25, 0, 0, 0, 1), movable=True)
    return scene


def images(views):
    return {name: getattr(views, name).numpy() for name in OUTPUTS}


def assert_same(found, wanted):
    for name, image in wanted.items():
        np.testing.assert_array_equal(found[name], image, err_msg=name)


def sensor_alone(sensor, **numbers):
    """Return the sensor drawn for one view, also where it is wrapped in `Corruptions`."""
    if isinstance(sensor, Corruptions):
        return dataclasses.replace(sensor, of=sensor.of.drawn(**numbers))
    return sensor.drawn(**numbers)


@pytest.mark.parametrize("name", SENSORS)
def test_view_equals_render_with_drawn_sensor(device, name):
    """With object poses and exclusions per view: bit for bit, in any subset and order of views."""
    scene, sensor = make_scene(device), SENSORS[name]
    places = np.tile([0, 0.7, 0.25, 0, 0, 0, 1], (6, 1, 1)).astype(np.float32)
    places[:, 0, 0] = np.linspace(-0.5, 0.5, 6)
    hidden = np.zeros((6, 3), dtype=np.uint8)
    hidden[4:, 1] = 1
    options = {"outputs": OUTPUTS, "seed": 9}
    whole = images(
        wv.render(scene, CAMERA, POSES, object_poses=places, exclude=hidden, sensor=sensor, frame=4, **options)
    )
    order, given = [5, 0, 2], {"sensor": sensor, "frame": 4, "view_index": [5, 0, 2]}
    some = wv.render(scene, CAMERA, POSES[order], object_poses=places[order], exclude=hidden[order], **given, **options)
    assert_same(images(some), {name: image[order] for name, image in whole.items()})
    for view in (0, 3, 5):
        own = sensor_alone(sensor, seed=9, view_index=view, frame=4)
        world = {"object_poses": places[[view]], "exclude": hidden[[view]]}
        alone = wv.render(scene, CAMERA, POSES[[view]], sensor=own, frame=4, view_index=[view], **world, **options)
        assert_same(images(alone), {name: image[[view]] for name, image in whole.items()})


def test_parameters_match_reference_draws():
    """Parameters depend on seed, view and name, and, with `per="image"`, on the frame."""
    sensor = SENSORS["each image"]
    places = [(np_crc("StereoDepth"), np_crc(name)) for name in STEREO_RANGES]
    wanted = reference_random.draw_uniforms([3, 8], [1, 2], places, 5, STREAM_PARAMETERS)
    for row, view, frame in zip(wanted, (3, 8), (1, 2), strict=True):
        drawn = sensor.drawn(seed=5, view_index=view, frame=frame)
        assert drawn.baseline == pytest.approx(0.05 + 0.02 * row[0]) and drawn.sigma == pytest.approx(0.3 * row[1])
        assert drawn.noise_spacing == 1 + int(4 * row[2]) and type(drawn.noise_spacing) is int
    assert sensor.drawn(view_index=1) != sensor.drawn(view_index=1, frame=1) != sensor.drawn(view_index=1, seed=1)
    still = SENSORS["stereo"]
    assert still.drawn(view_index=1) == still.drawn(view_index=1, frame=1) != still.drawn(view_index=1, seed=1)
    # Ranges of other parameters change nothing.
    assert randomized(STEREO, sigma=(0.0, 0.3)).drawn(view_index=1).sigma == still.drawn(view_index=1).sigma


def np_crc(name):
    import zlib

    return zlib.crc32(name.encode()) >> 1


def test_parameters_are_uniformly_distributed():
    sensor = randomized(STEREO, sigma=(0.1, 0.3), noise_spacing=(2, 5), dropout=(0.0, 1.0))
    drawn = [sensor.drawn(view_index=view) for view in range(800)]
    sigma, spacing, dropout = (np.array([getattr(one, name) for one in drawn]) for name in sensor.ranges)
    assert stats.kstest((sigma - 0.1) / 0.2, "uniform").pvalue > 1e-3
    counts = np.bincount(spacing)
    assert counts[:2].sum() == 0 and len(counts) == 6 and stats.chisquare(counts[2:]).pvalue > 1e-3
    assert abs(np.corrcoef(sigma, dropout)[0, 1]) < 0.12


def test_kinds_are_the_first_drawn_sensors():
    each, three = (randomized(STEREO, sigma=(0.1, 0.3), kinds=kinds) for kinds in (None, 3))
    known = [each.drawn(view_index=view).sigma for view in range(3)]
    found = [three.drawn(view_index=view).sigma for view in range(150)]
    assert {*found} == {*known}
    assert stats.chisquare([found.count(sigma) for sigma in known]).pvalue > 1e-3


def test_mujoco_worlds_have_distinct_sensors(device):
    xml = """<mujoco><worldbody><geom type="plane" size="3 3 .1"/><geom type="box" size=".3 .3 .3" pos="2 0 .3"/>
    <body><joint type="slide" axis="0 1 0"/><geom size=".2" pos="1 0 .2"/></body>
    <camera name="left" pos="-.5 .3 .6" xyaxes="0 -1 0 .2 0 1"/>
    <camera name="right" pos="-.5 -.3 .6" xyaxes="0 -1 0 .2 0 1"/></worldbody></mujoco>"""
    model, qpos = mujoco.MjModel.from_xml_string(xml), np.linspace(-0.5, 0.5, 4)[:, None]
    sensor = randomized(StereoDepth(0.06, shadow=False), sigma=(0.1, 0.5), subpixel=(0, 16))
    batch = wv.mujoco.BatchRenderer(model, height=24, width=32, sensor=sensor, seed=3, device=device)
    depth = batch.render(qpos, frame=2).by_world().depth.numpy()
    some = batch.render(qpos, worlds=[3, 1], frame=2).by_world().depth.numpy()
    np.testing.assert_array_equal(some, depth[[3, 1]])
    own = sensor.drawn(seed=3, view_index=2 * 3 + 1)
    alone = wv.mujoco.BatchRenderer(model, height=24, width=32, sensor=own, seed=3, device=device)
    np.testing.assert_array_equal(alone.render(qpos, frame=2).by_world().depth.numpy()[3, 1], depth[3, 1])


@pytest.mark.parametrize("name", SENSORS)
def test_fields_round_trip(name):
    sensor = SENSORS[name]
    assert sensor_from_fields(json.loads(json.dumps(sensor_to_fields(sensor), allow_nan=False))) == sensor


def test_camera_is_that_of_the_device():
    device = wv.sensors.realsense_d435(64, 48)
    assert randomized(device, sigma=(0.05, 0.1)).camera() == device.camera()
    assert randomized(device, focal_length=(30.0, 34.0)).drawn().focal_length > 30
    assert randomized(STEREO, sigma=(0.1, 0.1)).drawn(view_index=7) == STEREO


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: randomized("d435", sigma=(0, 1)), "of must be a model of warpvis.sensors"),
        (lambda: randomized(STEREO), "ranges must be a mapping of 1 to 8 parameters"),
        (lambda: randomized(STEREO, noise=(0, 1)), "StereoDepth has no parameter 'noise'; it has .*baseline, .*sigma"),
        (lambda: randomized(STEREO, sigma=0.1), "sigma must be two numbers, minimum and maximum, got 0.1"),
        (lambda: randomized(STEREO, sigma=(0.1, np.nan)), "sigma must be two numbers"),
        (lambda: randomized(STEREO, sigma=(0.2, 0.1)), "sigma must be a minimum and a maximum, got 0.2 and 0.1"),
        (lambda: randomized(STEREO, noise_spacing=(1, 2.5)), "noise_spacing must be two whole numbers"),
        (lambda: randomized(STEREO, shadow=(0, 1)), "shadow of StereoDepth must be a number to have a range"),
        (
            lambda: randomized(STEREO, native_camera=(0, 1)),
            "native_camera of StereoDepth must be a number to have a range",
        ),
        (
            lambda: randomized(FLIGHT, frequencies=(1e6, 2e6)),
            "frequencies of TimeOfFlight must be a number to have a range",
        ),
        (
            lambda: randomized(STEREO, sigma=(-0.1, 0.1)),
            "ranges have sigma -0.1: sigma must be a finite number from 0 up",
        ),
        (
            lambda: randomized(STEREO, min_signal=(0.0, 0.5), full_signal=(0.4, 0.9)),
            "ranges have min_signal 0.5, full_signal 0.4: full_signal must be above min_signal",
        ),
        (lambda: randomized(STEREO, per="frame", sigma=(0, 1)), "per must be"),
        (lambda: randomized(STEREO, kinds=0, sigma=(0, 1)), "kinds must be"),
        (lambda: randomized(STEREO, sigma=(0, 1)).drawn(view_index=-1), "view_index must be"),
        (lambda: Corruptions(of=randomized(Corruptions(), dropout=(0, 1))), "of must not contain Corruptions"),
    ],
)
def test_invalid_arguments_raise(make, message):
    with pytest.raises(wv.errors.ArrayError, match=message):
        make()


def test_camera_incompatible_with_a_range_raises():
    sensor = randomized(StereoDepth(0.05, band=False), max_disparity=(100.0, 1e9))
    endless = dataclasses.replace(CAMERA, near=0.0)
    with pytest.raises(wv.errors.CameraError, match="must limit disparities to 8192 px if band=False"):
        wv.Renderer(make_scene(), endless, sensor=sensor)
    fits = randomized(sensor.of, max_disparity=(100.0, 200.0))
    wv.Renderer(make_scene(), endless, sensor=fits)  # checks the ranges, not the parameters of `sensor.of`
