# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Angles are in radians: obvious degrees raise an error with the remedy."""

import json
import math

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import pose_generators, sensors
from warpvis.sensors import lidars

CAMERA = wv.Camera.from_fov(8, 6, hfov=1.0)


def box():
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.creation.box((1, 1, 1)), name="box")
    return scene


# For each parameter: rejected degrees, and accepted radians.
CALLS = {
    "laser_scan": (lidars.laser_scan, (-180, 180, 1), (-math.pi, math.pi, math.pi / 180)),
    "laser_scan, a quarter": (lidars.laser_scan, (-45.0, 45.0, 0.5), (-0.8, 0.8, 0.01)),
    "laser_scan, increment": (lidars.laser_scan, (0.0, 3.0, 10), (0.0, 3.0, 1.0)),
    "even, elevation": (lidars.even, (4, (-15, 15)), (4, (-0.3, 0.3))),
    "even, azimuth": (lambda *ends: lidars.even(2, azimuth=ends), (-60, 60), (-6.0, 0.25)),
    "even, narrow azimuth": (lambda *ends: lidars.even(2, azimuth=ends), (90, 95), (1.5, 1.7)),
    "even, increment": (lambda step: lidars.even(2, increment=step), (10,), (0.2,)),
    "bpearl": (lidars.bpearl, (10.0,), (0.2,)),
    "spread_beams": (lambda angle: sensors.spread_beams(lidars.even(2), angle), (10.0,), (0.003,)),
    "hfov": (lambda fov: wv.Camera.from_fov(8, 6, hfov=fov), (60,), (1.0,)),
    "vfov": (lambda fov: wv.Camera.from_fov(8, 6, vfov=fov), (45.0,), (0.8,)),
    "wide camera": (
        lambda fov: wv.cameras.WideCamera(8, 6, fov, "cylindrical"),
        (180,),
        (math.pi,),
    ),
    "field of view": (lambda fov: wv.FieldOfView(fov, 0.5, 0.5), (200,), (3.5,)),
    "field of view, up": (lambda up: wv.FieldOfView(2.0, up, 0.5), (60,), (1.0,)),
    "orbit": (
        lambda start: pose_generators.orbit((0, 0, 0), radius=1, height=1, count=3, start=start),
        (90,),
        (20.5,),
    ),
    "sphere": (
        lambda least: pose_generators.sphere((0, 0, 0), radius=1, count=3, min_elevation=least),
        (-30,),
        (-0.5,),
    ),
    "framing, azimuth": (lambda angle: pose_generators.framing(box(), CAMERA, azimuth=angle), (-45,), (12.3,)),
    "framing, elevation": (lambda angle: pose_generators.framing(box(), CAMERA, elevation=angle), (30,), (0.5,)),
    "Nguyen": (lambda angle: sensors.NguyenNoise(grazing_angle=angle), (60,), (1.0,)),
    "wiggle": (lambda angle: sensors.TimeOfFlight((20e6,), wiggle_phase=angle), (90,), (1.5,)),
}


@pytest.mark.parametrize("name", CALLS)
def test_degrees_raise_and_radians_are_accepted(name):
    make, degrees, radians = CALLS[name]
    make(*radians)
    with pytest.raises(
        wv.WarpvisError, match=r"radians.*, got .*angles are in radians: pass math\.radians\("
    ) as caught:
        make(*degrees)
    assert len(str(caught.value)) < 200


def test_degrees_in_a_velodyne_calibration_raise(tmp_path):
    """Velodyne's db.xml has degrees; velodyne_pointcloud's gen_calibration.py writes radians."""
    rows = [{"laser_id": n, "vert_correction": float(n), "rot_correction": 0.0} for n in range(-15, 17, 2)]
    rows = [row | {"laser_id": place} for place, row in enumerate(rows)]
    path = tmp_path / "calibration.yaml"
    path.write_text(json.dumps({"lasers": rows, "num_lasers": 16}))
    with pytest.raises(wv.errors.FileFormatError, match=r"vert_correction of a laser must be in radians, .* got -15"):
        lidars.vlp16(calibration=path)
    rows = [row | {"vert_correction": math.radians(row["vert_correction"])} for row in rows]
    path.write_text(json.dumps({"lasers": rows, "num_lasers": 16}))
    np.testing.assert_allclose(lidars.vlp16(calibration=path).directions[0, 0, 2], math.sin(math.radians(15)))
    path.write_text(json.dumps({"lasers": [row | {"rot_correction": 8.7} for row in rows], "num_lasers": 16}))
    with pytest.raises(wv.errors.FileFormatError, match=r"rot_correction of a laser must be in radians, .* got 8\.7"):
        lidars.vlp16(calibration=path)
