# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sensor models: depth cameras, lidars and the returns of their beams, and motion during a frame."""

from __future__ import annotations

from warpvis.core.motion import Motion
from warpvis.sensors import lidars
from warpvis.sensors._clouds import deskew, point_clouds
from warpvis.sensors._echoes import Returns, gather_returns, measure_incidence, reflect, spread_beams
from warpvis.sensors._lidar_noise import LidarNoise
from warpvis.sensors._rolling_shutter import RollingShutter
from warpvis.sensors.depth import (
    Corruptions,
    KhoshelhamNoise,
    Latency,
    NguyenNoise,
    Randomized,
    Reason,
    RedwoodNoise,
    SimKinect,
    StereoDepth,
    StereoFit as StereoFit,
    TimeOfFlight,
    WallReport as WallReport,
    azure_kinect,
    femto_bolt,
    fit,
    gemini_335,
    kinect_v1,
    kinect_v2,
    oak_d,
    pmd_flexx2,
    randomized,
    realsense_d405,
    realsense_d415,
    realsense_d435,
    realsense_d455,
    realsense_d457,
    realsense_l515,
    sensor_by_name,
    sensor_from_fields as sensor_from_fields,
    sensor_to_fields as sensor_to_fields,
    structure,
    zed_2i,
)

__all__ = [
    "Corruptions",
    "KhoshelhamNoise",
    "Latency",
    "LidarNoise",
    "Motion",
    "NguyenNoise",
    "Randomized",
    "Reason",
    "RedwoodNoise",
    "Returns",
    "RollingShutter",
    "SimKinect",
    "StereoDepth",
    "TimeOfFlight",
    "azure_kinect",
    "deskew",
    "femto_bolt",
    "fit",
    "gather_returns",
    "gemini_335",
    "kinect_v1",
    "kinect_v2",
    "lidars",
    "measure_incidence",
    "oak_d",
    "pmd_flexx2",
    "point_clouds",
    "randomized",
    "realsense_d405",
    "realsense_d415",
    "realsense_d435",
    "realsense_d455",
    "realsense_d457",
    "realsense_l515",
    "reflect",
    "sensor_by_name",
    "spread_beams",
    "structure",
    "zed_2i",
]
