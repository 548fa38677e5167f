# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Velodyne's lidars: lasers above each other that turn clockwise, each fired at a time of its own."""

from __future__ import annotations

import math
import os
import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_path, is_number, truncate
from warpvis.core.yaml_files import load_yaml
from warpvis.errors import FileFormatError
from warpvis.sensors._rays import Rays
from warpvis.sensors.lidars._angles import check_rate, directions_at
from warpvis.sensors.lidars._velodyne_tables import (
    HDL64E_S3,
    HDL64E_SIDE,
    VLP16_ELEVATION,
    VLP16_FOCAL,
    VLP32C,
    VLP32C_FOCAL,
)

_ANGLES = ("vert_correction", "rot_correction")
_OFFSETS = ("vert_offset_correction", "horiz_offset_correction")


@dataclass(frozen=True)
class _Lasers:
    """The lasers of a sensor, by their numbers, each an array of shape ``(lasers,)``."""

    elevation: NDArray[np.float64]
    """Angles above the horizontal plane [rad]."""
    left: NDArray[np.float64]
    """Angles that are added to the left of where the sensor looks [rad]."""
    ahead: NDArray[np.float64]
    """Distance of the ray's origin from the axis along the laser's heading [m]."""
    side: NDArray[np.float64]
    """Distance of the ray's origin from the axis to the left of that [m]."""
    height: NDArray[np.float64]
    """Height of the ray's origin [m]."""

    @classmethod
    def calibrated(
        cls,
        elevation: NDArray[np.float64],
        left: NDArray[np.float64],
        vertical: NDArray[np.float64],
        side: NDArray[np.float64],
    ) -> _Lasers:
        """Return lasers by the numbers of a calibration: angles [rad], and offsets of the beams [m].

        `vertical` is perpendicular to the beam and not along z, as in velodyne_pointcloud: ``xy_distance = distance *
        cos_vert_angle - vert_offset * sin_vert_angle`` and ``z = distance * sin_vert_angle + vert_offset *
        cos_vert_angle`` (``RawData::unpack`` in ros-drivers/velodyne, ``velodyne_pointcloud/src/lib/rawdata.cpp`` at
        06c274d).
        """
        return cls(elevation, left, -vertical * np.sin(elevation), side, vertical * np.cos(elevation))


def vlp16(
    rate: float = 10.0,
    *,
    near: float = 0.0,
    far: float = 100.0,
    calibration: str | os.PathLike[str] | None = None,
) -> Rays:
    """Make the rays of a turn of a VLP-16 (Puck): 16 lasers from -15 to 15 degrees.

    A firing of all lasers takes 55.296 us, one laser 2.304 us of it (user manual, as in ros-drivers/velodyne,
    ``rawdata.h`` at 29abd0e); a turn has as many firings as fit: 1808 at 10 Hz. Beams meet 41.91 mm from the axis, so
    each leaves it at a height of its own, up to 11.2 mm, and has an origin.

    Args:
        rate: Turns in a second, 5 to 20.
        near: Least range that it measures [m].
        far: Greatest [m]; 100 is the data sheet's.
        calibration: The sensor's own file, YAML, as velodyne_pointcloud's ``gen_calibration.py`` makes it.

    Returns:
        Rays of shape ``(16, firings)``, the highest laser first, x forward, y left, z up. The first firing looks
        along x, and the sensor turns clockwise. Rings are counted from below, as the drivers do.

    Raises:
        CameraError: A number is not what it has to be.
        FileFormatError: The file is none of a sensor of 16 lasers.
    """
    lasers = _read_lasers(calibration, 16)
    if lasers is None:
        lasers = _lasers(VLP16_ELEVATION, np.zeros(16), focal=VLP16_FOCAL)
    return _spin(lasers, rate, 55.296e-6, np.arange(16) * 2.304e-6, near, far)


def vlp32c(
    rate: float = 10.0,
    *,
    near: float = 0.0,
    far: float = 200.0,
    calibration: str | os.PathLike[str] | None = None,
) -> Rays:
    """Make the rays of a turn of a VLP-32C (Ultra Puck): 32 lasers from -25 to 15 degrees, closest to the horizon.

    Two lasers are fired together, 2.304 us after the two before; azimuths differ by up to 8.4 degrees between lasers.
    Beams meet 42.4 mm from the axis. See `vlp16` for the rest, and for arguments, result and errors.
    """
    lasers = _read_lasers(calibration, 32)
    if lasers is None:
        elevation, left = np.array(VLP32C).T
        lasers = _lasers(elevation, left, focal=VLP32C_FOCAL)
    return _spin(lasers, rate, 55.296e-6, np.arange(32) // 2 * 2.304e-6, near, far)


def hdl64e(
    rate: float = 10.0,
    *,
    near: float = 0.0,
    far: float = 120.0,
    calibration: str | os.PathLike[str] | None = None,
) -> Rays:
    """Make the rays of a turn of an HDL-64E S3: two blocks of 32 lasers, at the same times, 57.6 us a firing.

    Lasers are those of one calibrated sensor (-23.95 to 2.81 degrees, closer to each other in the upper block): beams
    pass the axis 26 mm to the left or right, and the origin, at the base, 143 to 216 mm above, perpendicular to the
    beam. Each of these sensors has others: give its file. Its ``vert_offset_correction`` is perpendicular to the beam,
    too, and its ``horiz_offset_correction`` to the left, as velodyne_pointcloud applies them. Times are the manual's
    (velodyne_decoder, ``packet_decoder.cpp``). See `vlp16` for the rest, and for arguments, result and errors.
    """
    lasers = _read_lasers(calibration, 64)
    if lasers is None:
        elevation, left, vertical = np.array(HDL64E_S3, dtype=np.float64).T
        side = np.where(np.arange(64) % 2 == 0, HDL64E_SIDE, -HDL64E_SIDE)
        lasers = _Lasers.calibrated(np.radians(elevation), np.radians(left), vertical / 1000, side)
    number = np.arange(64) % 32
    fired = (number // 4) * 7.2e-6 + np.array([0.0, 1.3e-6, 2.5e-6, 3.7e-6])[number % 4]
    return _spin(lasers, rate, 57.6e-6, fired, near, far)


def _lasers(elevation: object, left: object, *, focal: float) -> _Lasers:
    """Return lasers by their angles [deg] whose beams all meet so far from the axis [m]."""
    up = np.radians(np.asarray(elevation, dtype=np.float64))
    on_axis = np.zeros(len(up))
    return _Lasers(up, np.radians(np.asarray(left, dtype=np.float64)), on_axis, on_axis, -focal * np.tan(up))


def _spin(lasers: _Lasers, rate: float, cycle: float, fired: NDArray[np.floating], near: float, far: float) -> Rays:
    """Make the rays of one turn.

    Args:
        lasers: The lasers.
        rate: Turns in a second.
        cycle: How long a firing of all lasers takes [s].
        fired: When each is fired in it [s].
        near: Least range [m].
        far: Greatest range [m].
    """
    rate = check_rate(rate, 5.0, 20.0)
    columns = math.floor(1.0 / (rate * cycle))
    rows = np.argsort(-lasers.elevation, kind="stable")
    times = (np.arange(columns) * cycle + fired[:, None])[rows]
    heading = lasers.left[rows, None] - 2.0 * math.pi * rate * times
    directions = directions_at(heading, lasers.elevation[rows, None])
    ahead, side = lasers.ahead[rows, None], lasers.side[rows, None]
    height = np.broadcast_to(lasers.height[rows, None], heading.shape)
    x, y = ahead * np.cos(heading) - side * np.sin(heading), ahead * np.sin(heading) + side * np.cos(heading)
    origins = np.stack([x, y, height], axis=-1)
    rings = np.broadcast_to(np.arange(len(rows))[::-1, None], heading.shape)
    return Rays(directions, origins=origins, times=times, rings=rings, near=near, far=far, axes="ros_body")


def _read_lasers(calibration: str | os.PathLike[str] | None, count: int) -> _Lasers | None:
    """Read lasers of velodyne_pointcloud's YAML, with a key ``lasers``; None if there is no file.

    Raises:
        FileFormatError: The file is another, or not of so many lasers.
    """
    if calibration is None:
        return None
    path = as_path(calibration, "calibration")
    read = load_yaml(path)
    rows = read.get("lasers") if isinstance(read, dict) else None
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise FileFormatError(f"{path}: is no calibration of velodyne_pointcloud, which has a list of lasers")
    if len(rows) != count:
        raise FileFormatError(f"{path}: is of {len(rows)} lasers, and the sensor has {count}")
    numbers = np.array([[_number(row, name, path) for name in (*_ANGLES, *_OFFSETS, "laser_id")] for row in rows])
    if sorted(numbers[:, 4]) != list(range(count)):
        raise FileFormatError(f"{path}: laser_id of its lasers must be 0 to {count - 1}, each once")
    elevation, left, vertical, side, _ = numbers[np.argsort(numbers[:, 4])].T
    for name, angles, most in (("vert", elevation, math.pi / 2), ("rot", left, 2.0 * math.pi)):
        widest = float(angles[np.argmax(np.abs(angles))])
        if abs(widest) > most:
            raise FileFormatError(
                f"{path}: {name}_correction of a laser must be in radians, up to {most:.6g}, got {widest:g}; "
                "velodyne_pointcloud's gen_calibration.py converts Velodyne's db.xml, which is in degrees"
            )
    return _Lasers.calibrated(elevation, left, vertical, side)


def _number(row: dict[str, object], name: str, path: object) -> float:
    """Return a number of a laser; offsets are 0 where they are not said."""
    value = row.get(name, 0.0 if name in _OFFSETS else None)
    # Compared, since whole numbers of a file may be longer than any float.
    if not is_number(value) or not abs(value) <= sys.float_info.max:
        raise FileFormatError(f"{path}: {name} of a laser must be a finite number, got {truncate(repr(value))}")
    return float(value)
