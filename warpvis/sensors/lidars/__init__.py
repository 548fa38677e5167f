# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ray patterns of lidars by Velodyne, Hesai, Ouster, Livox and RoboSense, of planar scanners, and regular patterns.

Each function returns `warpvis.cameras.Rays` in the sensor frame: x forward, y left, z up (REP 103).
"""

from __future__ import annotations

from warpvis.sensors.lidars._hesai import at128, pandar64, qt128, xt32
from warpvis.sensors.lidars._livox import Livox, livox
from warpvis.sensors.lidars._ouster import ouster
from warpvis.sensors.lidars._plain import (
    bpearl,
    directions_at as directions_at,
    even,
    grid,
    laser_scan,
    rplidar,
)
from warpvis.sensors.lidars._velodyne import hdl32e, hdl64e, vlp16, vlp32c, vls128

__all__ = [
    "Livox", "at128", "bpearl", "even", "grid", "hdl32e", "hdl64e", "laser_scan", "livox", "ouster", "pandar64",
    "qt128", "rplidar", "vlp16", "vlp32c", "vls128", "xt32",
]  # fmt: skip
