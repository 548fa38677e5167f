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

PROFILES = {
    **{
        name: getattr(wv.sensors, name)(64, 48)
        for name in ("realsense_d415", "realsense_d435", "realsense_d455", "oak_d", "kinect_v1", "structure")
    },
    "azure_kinect": wv.sensors.azure_kinect("nfov_binned"),
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


@pytest.mark.parametrize("name", list(PROFILES)[:6])
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
