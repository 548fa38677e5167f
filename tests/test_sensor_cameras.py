# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of device models with other cameras: the range is the device's, and another focal length warns."""

import dataclasses
import warnings

import numpy as np
import pytest
import trimesh

import warpvis as wv

from support.recorded_warnings import recorded_warnings

STEREO = (
    "realsense_d405", "realsense_d415", "realsense_d435", "realsense_d455", "gemini_335", "zed_2i", "oak_d",
    "kinect_v1", "structure",
)  # fmt: skip
PROFILES = {
    # A D435 and a Gemini 335 of the same size have the same focal length.
    **{name: getattr(wv.sensors, name)(68 if name == "gemini_335" else 64, 48) for name in STEREO},
    "azure_kinect": wv.sensors.azure_kinect("nfov_binned"),
    "femto_bolt": wv.sensors.femto_bolt("nfov_binned"),
    "realsense_l515": dataclasses.replace(
        wv.sensors.realsense_l515(), native_camera=wv.Camera(64, 48, 46, 46, 32, 24, 0.25, 9)
    ),
    "kinect_v2": wv.sensors.kinect_v2(),
    "pmd_flexx2": wv.sensors.pmd_flexx2(),
}
D435 = dataclasses.replace(PROFILES["realsense_d435"], sigma=0.0, subpixel=0)
AHEAD = wv.look_at((0, 0, 0), (1, 0, 0))


def depth_of(sensor, camera, distance, **options):
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.creation.box((0.01, 900, 900)), name="wall", pose=(distance + 0.005, 0, 0, 0, 0, 0, 1))
    views = wv.render(scene, camera, AHEAD, outputs=("depth", "reasons"), sensor=sensor, seed=2, frame=0, **options)
    return views.depth.numpy()[0], views.reasons.numpy()[0]


@pytest.mark.smoke("oak_d", "kinect_v2")
@pytest.mark.parametrize("name", PROFILES)
def test_range_is_the_devices_with_any_camera(name):
    sensor = PROFILES[name]
    native = sensor.camera()
    for camera in (dataclasses.replace(native, near=0.0, far=np.inf), dataclasses.replace(native, near=1e-3, far=99.0)):
        with warnings.catch_warnings():
            warnings.filterwarnings("error", message="the device")
            for distance in (1.2 * native.far, 0.9 * native.far, 0.9 * native.near):
                depth, reasons = depth_of(sensor, camera, distance)
                found = depth[np.isfinite(depth)]  # noise and phase wrapping may return depth to the range
                assert ((found >= native.near) & (found <= native.far)).all()
                for image, its_own in zip((depth, reasons), depth_of(sensor, native, distance), strict=True):
                    np.testing.assert_array_equal(image, its_own)


def test_corruptions_and_randomized_sensors_keep_the_range():
    camera = dataclasses.replace(D435.camera(), near=0.0, far=np.inf)
    for other in (D435, wv.sensors.Corruptions(of=D435), wv.sensors.randomized(D435, baseline=(0.049, 0.051))):
        assert not np.isfinite(depth_of(other, camera, 11.5)[0]).any()
        assert np.isfinite(depth_of(other, camera, 3.0)[0]).any()


def test_narrower_camera_range_applies():
    camera = dataclasses.replace(D435.camera(), near=1.0, far=2.0)
    assert not np.isfinite(depth_of(D435, camera, 2.5)[0]).any()
    assert not np.isfinite(depth_of(D435, camera, 0.8)[0]).any()
    with pytest.raises(wv.errors.CameraError, match=r"within the device's range, .* to 10 m, got near=11, far=12"):
        depth_of(D435, dataclasses.replace(camera, near=11.0, far=12.0), 11.5)


def test_surfaces_nearer_than_the_device_range_are_not_clipped():
    """The camera's near plane clips, as in MuJoCo; a surface between it and the device's range occludes and is too
    near."""
    sensor = dataclasses.replace(PROFILES["kinect_v1"], shadow=False)
    camera = dataclasses.replace(sensor.camera(), near=0.05, far=np.inf)
    depth, _ = depth_of(sensor, camera, 0.2, near_plane="clip")
    assert np.isneginf(depth).all()


@pytest.mark.parametrize("name", STEREO)
def test_other_focal_length_warns(name):
    sensor = PROFILES[name]
    fx = sensor.camera().fx
    for factor, is_told in ((1.04, False), (1.5, True), (0.7, True)):
        camera = dataclasses.replace(sensor.camera(), fx=factor * fx, fy=factor * fx)
        with recorded_warnings() as told:
            depth_of(sensor, camera, 2.0)
            depth_of(sensor, camera, 3.0)
        told = [one for one in told if str(one.message).startswith("fx of the camera is ")]
        assert [one.filename for one in told] == [__file__] * is_told


# Of data sheets, the manufacturers' pages and drivers (docstrings of the profiles): image size, horizontal and vertical
# field of view [deg], minimum and maximum depth [m], baseline [m]. None where not specified.
SHEETS = {
    "d405@1280x720": ((1280, 720), (84, 58), (0.1, None), 0.018),
    "d405": ((848, 480), (84, 58), (0.07, None), 0.018),
    "d415": ((1280, 720), (65, 40), (0.45, None), 0.055),
    "d435": ((848, 480), (90, 58), (0.17, None), 0.05),
    "d455@1280x720": ((1280, 720), (87, 58), (0.52, None), 0.095),
    "d457@1280x720": ((1280, 720), (87, 58), (0.52, None), 0.095),
    "gemini-335": ((1280, 800), (90, 65), (0.17, 20), 0.05),
    "zed-2i": ((1280, 720), (110, 70), (0.3, 20), 0.12),
    "oak-d": ((1280, 800), (80, 55), (0.64, 12), 0.075),
    "kinect-v1": ((640, 480), (58, 45), (0.5, 5), 0.075),
    "structure": ((640, 480), (58, 45), (0.4, 3.5), 0.065),
    "azure-kinect": ((640, 576), (75, 65), (0.5, 3.86), None),
    "femto-bolt": ((640, 576), (75, 65), (0.5, 3.86), None),
    "femto-bolt-wide-binned": ((512, 512), (120, 120), (0.25, 2.88), None),
    "l515": ((1024, 768), (70, 55), (0.25, 9), None),
    "kinect-v2": ((512, 424), (70.6, 60), (0.5, 4.5), None),
    "flexx2": ((224, 172), (56, 44), (0.1, 7), None),
}


@pytest.mark.parametrize("name", SHEETS)
def test_profiles_match_data_sheets(name):
    sensor = wv.sensors.sensor_by_name(name)
    camera = sensor.camera()
    size, fields, depths, baseline = SHEETS[name]
    assert (camera.width, camera.height) == size
    rectified = 10 if name == "zed-2i" else 5  # the specified field of view of a ZED is that of images with distortion
    for pixels, focal, field in zip(size, (camera.fx, camera.fy), fields, strict=True):
        assert 2 * np.degrees(np.arctan(pixels / 2 / focal)) == pytest.approx(field, abs=rectified)
    assert camera.near == pytest.approx(depths[0], rel=0.05) and 0 < camera.near < camera.far < np.inf
    assert depths[1] is None or camera.far == depths[1]
    if baseline is not None:
        assert sensor.baseline == baseline
        assert camera.near >= camera.fx * baseline / sensor.max_disparity * (1 - 1e-9)


def test_all_sensor_names_have_a_data_sheet():
    known = {name.partition("@")[0] for name in SHEETS}
    for name in wv.sensors.depth.SENSOR_NAMES:
        assert any(name.startswith(model) for model in known)
        camera = wv.sensors.sensor_by_name(name).camera()
        assert 0 < camera.near < camera.far < np.inf


def test_femto_bolt_and_d457_are_alike():
    assert wv.sensors.femto_bolt("wfov") == wv.sensors.azure_kinect("wfov")
    assert wv.sensors.realsense_d457(640, 480) == wv.sensors.realsense_d455(640, 480)
