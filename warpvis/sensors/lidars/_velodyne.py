# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Velodyne lidars: columns of lasers that rotate clockwise and fire one after another."""

from __future__ import annotations

import math
import os
import sys

import numpy as np

from warpvis.cameras.rays import Rays
from warpvis.core.checks import as_path, is_number, truncate
from warpvis.core.file_content import load_yaml
from warpvis.errors import FileFormatError
from warpvis.sensors.lidars._spinning import Lasers, spin

# Default calibrations. The tables of the VLP-16 and VLP-32C are from the driver velodyne_decoder (``calib_db.cpp`` at
# 08ddf97), which uses the values of the user manuals. The table of the HDL-64E is that of one calibrated S3:
# ``HDL-64.xml`` of LidarView, as in the same driver.
_VLP16_ELEVATION = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)
"""Elevation of each laser, in firing order [deg]."""

_HDL32E_ELEVATION = (
    -30.67, -9.33, -29.33, -8.0, -28.0, -6.67, -26.67, -5.33, -25.33, -4.0, -24.0, -2.67, -22.67, -1.33, -21.33, 0.0,
    -20.0, 1.33, -18.67, 2.67, -17.33, 4.0, -16.0, 5.33, -14.67, 6.67, -13.33, 8.0, -12.0, 9.33, -10.67, 10.67,
)  # fmt: skip
"""Elevation of each laser, in firing order [deg]: ``32db.yaml`` of ros-drivers/velodyne at 4c5309f."""

_VLP32C = (
    (-25, -1.4), (-1, 4.2), (-1.667, -1.4), (-15.639, 1.4), (-11.31, -1.4), (0, 1.4), (-0.667, -4.2), (-8.843, 1.4),
    (-7.254, -1.4), (0.333, 4.2), (-0.333, -1.4), (-6.148, 1.4), (-5.333, -4.2), (1.333, 1.4), (0.667, -4.2), (-4, 1.4),
    (-4.667, -1.4), (1.667, 4.2), (1, -1.4), (-3.667, 4.2), (-3.333, -4.2), (3.333, 1.4), (2.333, -1.4), (-2.667, 1.4),
    (-3, -1.4), (7, 1.4), (4.667, -1.4), (-2.333, 4.2), (-2, -4.2), (15, 1.4), (10.333, -1.4), (-1.333, 1.4),
)  # fmt: skip
"""Elevation and correction of the azimuth, to the left, of each laser [deg]."""

_VLS128_ELEVATION = (
    -11.742, -1.99, 3.4, -5.29, -0.78, 4.61, -4.08, 1.31, -6.5, -1.11, 4.28, -4.41, 0.1, 6.48, -3.2, 2.19, -3.86, 1.53,
    -9.244, -1.77, 2.74, -5.95, -0.56, 4.83, -2.98, 2.41, -6.28, -0.89, 3.62, -5.07, 0.32, 7.58, -0.34, 5.18, -3.64,
    1.75, -25, -2.43, 2.96, -5.73, 0.54, 9.7, -2.76, 2.63, -7.65, -1.55, 3.84, -4.85, 3.18, -5.51, -0.12, 5.73, -4.3,
    1.09, -16.042, -2.21, 4.06, -4.63, 0.76, 15, -3.42, 1.97, -6.85, -1.33, -5.62, -0.23, 5.43, -3.53, 0.98, -19.582,
    -2.32, 3.07, -4.74, 0.65, 11.75, -2.65, 1.86, -7.15, -1.44, 3.95, -2.1, 3.29, -5.4, -0.01, 4.5, -4.19, 1.2, -13.565,
    -1.22, 4.17, -4.52, 0.87, 6.08, -3.31, 2.08, -6.65, 1.42, -10.346, -1.88, 3.51, -6.06, -0.67, 4.72, -3.97, 2.3,
    -6.39, -1, 4.39, -5.18, 0.21, 6.98, -3.09, 4.98, -3.75, 1.64, -8.352, -2.54, 2.85, -5.84, -0.45, 8.43, -2.87, 2.52,
    -6.17, -1.66, 3.73, -4.96, 0.43,
)  # fmt: skip
"""Elevation of each laser, in firing order [deg]: ``VLS128.yaml`` of ros-drivers/velodyne at 29abd0e."""

_VLS128_AZIMUTH = (-6.354, -4.548, -2.732, -0.911, 0.911, 2.732, 4.548, 6.354)
"""Correction of the azimuth, to the left, of the eight lasers that fire together [deg]."""

_VLP16_FOCAL = 0.04191
_VLP32C_FOCAL = 0.0424
_VLS128_FOCAL = 0.05863
"""Distance from the axis at which all beams intersect [m]. Beams start on the axis, at -focal * tan(elevation)."""

_HDL64E_S3 = (
    (-6.29, -4.55, 215), (-5.89, -2.46, 214), (1.15, 3.3, 205), (1.52, 5.52, 205),
    (-5.61, -0.23, 214), (-5.29, 2.05, 213), (-7.63, -1.01, 216), (-7.26, 1.22, 216),
    (-4.96, 4.05, 213), (-4.57, 6.29, 212), (-7, 3.26, 215), (-6.64, 5.54, 215),
    (-2.22, -4.55, 209), (-1.84, -2.28, 209), (-4.26, -5.31, 212), (-3.84, -3.09, 211),
    (-1.55, -0.26, 209), (-1.18, 2.01, 208), (-3.58, -1.04, 211), (-3.2, 1.21, 211),
    (-0.88, 4.01, 208), (-0.52, 6.23, 207), (-2.91, 3.23, 210), (-2.53, 5.46, 210),
    (1.86, -4.58, 204), (2.19, -2.32, 204), (-0.15, -5.35, 207), (0.23, -3.09, 206),
    (2.51, -0.28, 203), (2.81, 1.95, 203), (0.48, -1.1, 206), (0.89, 1.18, 205),
    (-21.77, -7.45, 159), (-21.28, -3.99, 158), (-10.67, 5.01, 146), (-9.99, 8.21, 145),
    (-20.91, -0.51, 158), (-20.34, 2.96, 157), (-23.95, -1.82, 162), (-23.44, 1.69, 161),
    (-19.74, 6.43, 156), (-19.14, 9.79, 156), (-22.82, 5.23, 160), (-22.27, 8.7, 160),
    (-15.58, -7.27, 151), (-15.15, -3.8, 151), (-18.72, -8.63, 155), (-18.19, -5.1, 155),
    (-14.72, -0.46, 150), (-14.16, 2.86, 150), (-17.77, -1.75, 154), (-17.3, 1.69, 153),
    (-13.73, 6.13, 149), (-13.13, 9.49, 149), (-16.71, 5.01, 153), (-16.2, 8.43, 152),
    (-9.37, -7, 144), (-9.15, -3.76, 144), (-12.37, -8.3, 148), (-12.05, -4.98, 147),
    (-8.65, -0.45, 144), (-8.11, 2.65, 143), (-11.59, -1.71, 147), (-11.12, 1.54, 146),
)  # fmt: skip
"""Elevation and azimuth correction, to the left [deg], and vertical offset, perpendicular to the beam [mm]. The first
32 lasers are the upper block."""

_HDL64E_SIDE = 0.026
"""Distance at which beams pass the axis [m]: to the left for lasers with even numbers, to the right for the others."""

_ANGLES = ("vert_correction", "rot_correction")
_OFFSETS = ("vert_offset_correction", "horiz_offset_correction")


def vlp16(
    rate: float = 10.0,
    *,
    near: float = 0.0,
    far: float = 100.0,
    calibration: str | os.PathLike[str] | None = None,
) -> Rays:
    """Return the rays of a revolution of a VLP-16 (Puck): 16 lasers from -15 to 15 degrees.

    A firing cycle of all lasers takes 55.296 us, 2.304 us per laser (user manual, as in ros-drivers/velodyne,
    ``rawdata.h`` at 29abd0e). A revolution has as many cycles as fit: 1808 at 10 Hz. All beams intersect 41.91 mm from
    the axis. They start on the axis, at heights of up to 11.2 mm that differ between lasers.

    Args:
        rate: Revolutions per second, 5 to 20 Hz.
        near: Minimum measured range [m].
        far: Maximum measured range [m]; the default is from the data sheet.
        calibration: The calibration of a sensor, YAML, as written by velodyne_pointcloud's ``gen_calibration.py``.

    Returns:
        Rays of shape ``(16, firings)``, the highest laser first, x forward, y left, z up. The first firing points
        along x, and the sensor rotates clockwise. Rings are counted from the lowest laser, as in the drivers.

    Raises:
        FileFormatError: If the file is not the calibration of a sensor with 16 lasers.
    """
    lasers = _read_lasers(calibration, 16)
    if lasers is None:
        lasers = _lasers(_VLP16_ELEVATION, np.zeros(16), focal=_VLP16_FOCAL)
    return spin(lasers, rate, 55.296e-6, np.arange(16) * 2.304e-6, near, far)


def hdl32e(
    rate: float = 10.0,
    *,
    near: float = 0.0,
    far: float = 100.0,
    calibration: str | os.PathLike[str] | None = None,
) -> Rays:
    """Return the rays of a revolution of an HDL-32E: 32 lasers from -30.67 to 10.67 degrees, 1.33 degrees apart.

    A firing cycle of all lasers takes 46.08 us, 1.152 us per laser and 9.216 us to recharge (application note 63-9277,
    as in velodyne_decoder, ``packet_decoder.cpp`` at 043ca71). All beams start at the origin. See `vlp16` for
    arguments, result and errors.
    """
    lasers = _read_lasers(calibration, 32)
    if lasers is None:
        lasers = _lasers(_HDL32E_ELEVATION, np.zeros(32), focal=0.0)
    return spin(lasers, rate, 46.08e-6, np.arange(32) * 1.152e-6, near, far)


def vlp32c(
    rate: float = 10.0,
    *,
    near: float = 0.0,
    far: float = 200.0,
    calibration: str | os.PathLike[str] | None = None,
) -> Rays:
    """Return the rays of a revolution of a VLP-32C (Ultra Puck): 32 lasers from -25 to 15 degrees, denser near 0.

    Lasers fire in pairs, 2.304 us after the previous pair. Azimuths differ by up to 8.4 degrees between lasers. Beams
    intersect 42.4 mm from the axis. See `vlp16` for arguments, result and errors.
    """
    lasers = _read_lasers(calibration, 32)
    if lasers is None:
        elevation, azimuth_offset = np.array(_VLP32C).T
        lasers = _lasers(elevation, azimuth_offset, focal=_VLP32C_FOCAL)
    return spin(lasers, rate, 55.296e-6, np.arange(32) // 2 * 2.304e-6, near, far)


def hdl64e(
    rate: float = 10.0,
    *,
    near: float = 0.0,
    far: float = 120.0,
    calibration: str | os.PathLike[str] | None = None,
) -> Rays:
    """Return the rays of a revolution of an HDL-64E S3: two blocks of 32 lasers that fire in parallel, 57.6 us a cycle.

    The default lasers are those of one calibrated sensor (-23.95 to 2.81 degrees, denser in the upper block). Its beams
    pass the axis at 26 mm to the left or right, and the origin, at the base, 143 to 216 mm above, measured
    perpendicular to the beam. Calibrations differ between sensors: pass the file of yours. Its
    ``vert_offset_correction`` is perpendicular to the beam and its ``horiz_offset_correction`` is to the left, as
    velodyne_pointcloud applies them. Firing times are from the manual (velodyne_decoder, ``packet_decoder.cpp``). See
    `vlp16` for arguments, result and errors.
    """
    lasers = _read_lasers(calibration, 64)
    if lasers is None:
        elevation, azimuth_offset, vertical = np.array(_HDL64E_S3, dtype=np.float64).T
        side = np.where(np.arange(64) % 2 == 0, _HDL64E_SIDE, -_HDL64E_SIDE)
        lasers = Lasers.calibrated(np.radians(elevation), np.radians(azimuth_offset), vertical / 1000, side)
    number = np.arange(64) % 32
    firing_times = (number // 4) * 7.2e-6 + np.array([0.0, 1.3e-6, 2.5e-6, 3.7e-6])[number % 4]
    return spin(lasers, rate, 57.6e-6, firing_times, near, far)


def vls128(
    rate: float = 10.0,
    *,
    near: float = 0.0,
    far: float = 262.14,
    calibration: str | os.PathLike[str] | None = None,
) -> Rays:
    """Return the rays of a revolution of a VLS-128 (Alpha Prime): 128 lasers from -25 to 15 degrees, denser near 0.

    Lasers fire in 16 groups of eight, 2.665 us each. There is a pause of one group after the eighth group and of three
    after the last: 53.3 us a cycle, 1876 cycles at 10 Hz (VLS-128 user manual, draft, pages 49 and 61, and ros-drivers;
    velodyne_decoder assumes two groups in both places, and 2.89 us since firmware 5.2.3). Azimuths differ by up to 12.7
    degrees within a group. Beams intersect 58.63 mm from the axis (velodyne_decoder). The maximum range is the largest
    distance that a packet can hold. See `vlp16` for arguments, result and errors.
    """
    lasers = _read_lasers(calibration, 128)
    if lasers is None:
        lasers = _lasers(_VLS128_ELEVATION, np.tile(_VLS128_AZIMUTH, 16), focal=_VLS128_FOCAL)
    number = np.arange(128)
    return spin(lasers, rate, 53.3e-6, (number // 8 + number // 64) * 2.665e-6, near, far)


def _lasers(elevation: object, azimuth_offset: object, *, focal: float) -> Lasers:
    """Return lasers from their angles [deg]; all beams intersect at a distance `focal` from the axis [m]."""
    angles = np.radians(np.asarray(elevation, dtype=np.float64))
    offsets = np.radians(np.asarray(azimuth_offset, dtype=np.float64))
    on_axis = np.zeros(len(angles))
    return Lasers(angles, offsets, on_axis, on_axis, -focal * np.tan(angles))


def _read_lasers(calibration: str | os.PathLike[str] | None, count: int) -> Lasers | None:
    """Read the lasers from a YAML file of velodyne_pointcloud, with a key ``lasers``; return None without a file."""
    if calibration is None:
        return None
    path = as_path(calibration, "calibration")
    read = load_yaml(path)
    rows = read.get("lasers") if isinstance(read, dict) else None
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise FileFormatError(f"{path}: is not a calibration of velodyne_pointcloud: it has no list of lasers")
    if len(rows) != count:
        raise FileFormatError(f"{path}: must have the {count} lasers of the sensor, got {len(rows)}")
    numbers = np.array([[_number(row, name, path) for name in (*_ANGLES, *_OFFSETS, "laser_id")] for row in rows])
    if sorted(numbers[:, 4]) != list(range(count)):
        raise FileFormatError(f"{path}: laser_id of its lasers must be 0 to {count - 1}, each once")
    elevation, azimuth_offset, vertical, side, _ = numbers[np.argsort(numbers[:, 4])].T
    for name, angles, limit in (("vert", elevation, math.pi / 2), ("rot", azimuth_offset, 2.0 * math.pi)):
        widest = float(angles[np.argmax(np.abs(angles))])
        if abs(widest) > limit:
            raise FileFormatError(
                f"{path}: {name}_correction of a laser must be in radians, up to {limit:.6g}, got {widest:g}. "
                "velodyne_pointcloud's gen_calibration.py converts Velodyne's db.xml, which is in degrees."
            )
    return Lasers.calibrated(elevation, azimuth_offset, vertical, side)


def _number(row: dict[str, object], name: str, path: object) -> float:
    """Return a field of a laser; offsets default to 0."""
    value = row.get(name, 0.0 if name in _OFFSETS else None)
    # The comparison rejects integers that exceed the range of float.
    if not is_number(value) or not abs(value) <= sys.float_info.max:
        raise FileFormatError(f"{path}: {name} of a laser must be a finite number, got {truncate(repr(value))}")
    return float(value)
