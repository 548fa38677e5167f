# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""`DepthSensor.depth_sigma` is the root mean square error that a wall facing the sensor is measured with."""

import dataclasses

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import sensors

CAMERA = wv.Camera.from_fov(160, 120, hfov=1.0, near=0.1, far=20.0)
STEREO = sensors.StereoDepth(0.05, sigma=0.1, shadow=False, band=False, max_disparity=200.0)
FLIGHT = sensors.TimeOfFlight(40e6, signal=2e4, background=1e3, mixing=False)
TABLE = np.ones((80, 80, 5), dtype=np.float32)
SENSORS = {
    "stereo": STEREO,
    "stereo, smooth and rounded": dataclasses.replace(STEREO, noise_spacing=4, subpixel=8, sigma=0.05),
    "time of flight": FLIGHT,
    "dark": dataclasses.replace(FLIGHT, reflectivity={"wall": 0.2}),
    "dark by order": dataclasses.replace(FLIGHT, reflectivity=[0.5]),
    "no noise": dataclasses.replace(FLIGHT, signal=np.inf, offset=0.01),
    "Nguyen": sensors.NguyenNoise(),
    "Khoshelham": sensors.KhoshelhamNoise(),
    "Khoshelham without rounding": sensors.KhoshelhamNoise(rounds=False),
    "Redwood": sensors.RedwoodNoise(TABLE),
    "simkinect": sensors.SimKinect(),
    "corruptions": sensors.Corruptions(added=0.01, multiplied=0.02, of=sensors.KhoshelhamNoise()),
}


def measure(sensor, distances):
    """Return measured depth of walls at many distances, so that errors of rounding are averaged."""
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.creation.box((0.01, 60.0, 60.0)), name="wall", movable=True)
    poses = np.array([[distance + 0.005, 0, 0, 0, 0, 0, 1] for distance in distances])
    pose = wv.look_at((0, 0, 0), (1, 0, 0))
    views = wv.render(
        scene, CAMERA, pose[None].repeat(len(poses), 0), object_poses=poses[:, None], sensor=sensor, frame=0
    )
    return views.depth.numpy()


@pytest.mark.parametrize("distance", [1.0, 3.0])
@pytest.mark.parametrize("name", SENSORS)
def test_root_mean_square_error(name, distance):
    distances = distance * np.linspace(0.9, 1.1, 41)
    depth = measure(SENSORS[name], distances)
    middle = depth[:, 45:75, 60:100]  # angles to the axis are small, as the model assumes
    error = np.sqrt(np.nanmean((middle - distances[:, None, None]) ** 2))
    expected = SENSORS[name].depth_sigma([distance], CAMERA)
    assert expected.shape == (1,)
    np.testing.assert_allclose(expected[0], error, rtol=0.08)


def test_maximum_of_random_sensors():
    sensor = sensors.randomized(STEREO, sigma=(0.05, 0.2))
    expected = dataclasses.replace(STEREO, sigma=0.2).depth_sigma([[1.0, 2.0]], CAMERA)
    np.testing.assert_array_equal(sensor.depth_sigma([[1.0, 2.0]], CAMERA), expected)


def test_models_without_it_raise():
    class Plain(wv.rendering.DepthSensor):
        def measure(self, exposure):
            pass

    with pytest.raises(wv.errors.ArrayError, match="got Plain, which does not; override depth_sigma, or pass a number"):
        Plain().depth_sigma([1.0], CAMERA)
