# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Metadata files of Ouster's lidars."""

import json

import numpy as np

from warpvis.sensors import lidars


def ouster_metadata(**changes):
    """Return metadata of an OS1-64 in the format of `SensorInfo.from_default`, shortened."""
    known = json.loads(
        '{"lidar_data_format": {"columns_per_frame": 1024, "column_window": [0, 1023], "pixels_per_column": 64},'
        '"lidar_intrinsics": {"lidar_to_sensor_transform": [-1,0,0,0, 0,-1,0,0, 0,0,1,36.18, 0,0,0,1]},'
        '"config_params": {"lidar_mode": "1024x10"}, "sensor_info": {"prod_line": "OS-1-64"}}'
    )
    altitude, azimuth = lidars._ouster._nominal("OS1-64").altitude, [3.164, 1.055, -1.055, -3.164] * 16
    known["beam_intrinsics"] = {
        "beam_altitude_angles": np.degrees(altitude).tolist(),
        "beam_azimuth_angles": azimuth,
        "beam_to_lidar_transform": [1, 0, 0, 15.806, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
    }
    for name, values in changes.items():
        known[name] = {**known[name], **values}
    return known


def old_ouster_metadata():
    """Return the same metadata in the format of firmware before 2.4."""
    new = ouster_metadata()
    beams, lidar = new["beam_intrinsics"], new["lidar_intrinsics"]
    return {
        **{name: beams[name] for name in ("beam_altitude_angles", "beam_azimuth_angles")},
        **lidar,
        "data_format": new["lidar_data_format"],
        "lidar_mode": "1024x10",
        "prod_line": "OS-1-64",
    }
