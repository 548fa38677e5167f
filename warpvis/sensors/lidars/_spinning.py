# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Columns of lasers that rotate clockwise and fire one after another, as in lidars of Velodyne and Hesai."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.rays import Rays
from warpvis.core.checks import check_number
from warpvis.errors import CameraError
from warpvis.sensors.lidars._plain import directions_at


@dataclass(frozen=True)
class Lasers:
    """The lasers of a sensor in the order of their numbers; arrays of shape ``(lasers,)``."""

    elevation: NDArray[np.float64]
    """Angles above the horizontal plane [rad]."""
    azimuth_offset: NDArray[np.float64]
    """Angles relative to the heading of the sensor, to the left [rad]."""
    radial: NDArray[np.float64]
    """Offset of the ray origin from the axis along the heading of the laser [m]."""
    side: NDArray[np.float64]
    """Offset of the ray origin from the axis to the left of the heading [m]."""
    height: NDArray[np.float64]
    """Height of the ray origin [m]."""
    rings: NDArray[np.int64] | None = None
    """Channel numbers of the sensor's driver; by default counted from the lowest laser."""

    @classmethod
    def calibrated(
        cls,
        elevation: NDArray[np.float64],
        azimuth_offset: NDArray[np.float64],
        vertical: NDArray[np.float64],
        side: NDArray[np.float64],
    ) -> Lasers:
        """Return lasers from calibrated angles [rad] and offsets of the beams [m].

        `vertical` is perpendicular to the beam, not along z, as in velodyne_pointcloud: ``xy_distance = distance *
        cos_vert_angle - vert_offset * sin_vert_angle`` and ``z = distance * sin_vert_angle + vert_offset *
        cos_vert_angle`` (``RawData::unpack`` in ros-drivers/velodyne, ``velodyne_pointcloud/src/lib/rawdata.cpp`` at
        06c274d).
        """
        return cls(elevation, azimuth_offset, -vertical * np.sin(elevation), side, vertical * np.cos(elevation))


def spin(
    lasers: Lasers,
    rate: float,
    cycle: float,
    firing_times: NDArray[np.floating],
    near: float,
    far: float,
    *,
    start: float = 0.0,
) -> Rays:
    """Return the rays of one clockwise revolution.

    Args:
        lasers: The lasers; their highest is the first row of the rays.
        rate: Revolutions per second, 5 to 20 Hz.
        cycle: Duration of a firing cycle of all lasers [s]. A revolution has as many cycles as fit.
        firing_times: Time of each laser within a cycle, shape ``(lasers,)`` [s].
        near: Minimum measured range [m].
        far: Maximum measured range [m].
        start: Heading of the sensor at time 0, from x toward y [rad].
    """
    rate = check_number(rate, "rate", minimum=5.0, maximum=20.0, error=CameraError)
    columns = math.floor(1.0 / (rate * cycle) + 1e-9)
    rows = np.argsort(-lasers.elevation, kind="stable")
    times = (np.arange(columns) * cycle + firing_times[:, None])[rows]
    heading = start + lasers.azimuth_offset[rows, None] - 2.0 * math.pi * rate * times
    directions = directions_at(heading, lasers.elevation[rows, None])
    radial, side = lasers.radial[rows, None], lasers.side[rows, None]
    height = np.broadcast_to(lasers.height[rows, None], heading.shape)
    x, y = radial * np.cos(heading) - side * np.sin(heading), radial * np.sin(heading) + side * np.cos(heading)
    origins = np.stack([x, y, height], axis=-1)
    numbers = np.arange(len(rows))[::-1] if lasers.rings is None else lasers.rings[rows]
    rings = np.broadcast_to(numbers[:, None], heading.shape)
    return Rays(directions, origins=origins, times=times, rings=rings, near=near, far=far, axes="ros_body")
