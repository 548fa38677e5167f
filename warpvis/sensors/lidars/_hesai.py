# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Hesai lidars with the design values of their beams. The frame is that of Hesai's driver: x forward, y left, z up.

Sources: the angle and firing time correction files and the parsers of HesaiLidar_SDK_2.0 at ea7f86f, the default angles
of HesaiLidar_General_SDK at d7f39ee, and the ranges of TIER IV's Nebula at 606ac41. The angles of real sensors differ
by up to 0.2 degrees.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.rays import Rays
from warpvis.sensors.lidars._plain import directions_at
from warpvis.sensors.lidars._spinning import Lasers, spin

_PANDAR64_ELEVATION = (
    14.882, 11.032, 8.059, 5.057, 3.04, 2.028, 1.86, 1.688, 1.522, 1.351, 1.184, 1.013, 0.846, 0.675, 0.508, 0.337,
    0.169, 0, -0.169, -0.337, -0.508, -0.675, -0.845, -1.013, -1.184, -1.351, -1.522, -1.688, -1.86, -2.028, -2.198,
    -2.365, -2.536, -2.7, -2.873, -3.04, -3.21, -3.375, -3.548, -3.712, -3.884, -4.05, -4.221, -4.385, -4.558, -4.72,
    -4.892, -5.057, -5.229, -5.391, -5.565, -5.726, -5.898, -6.061, -7.063, -8.059, -9.06, -9.885, -11.032, -12.006,
    -12.974, -13.93, -18.889, -24.897,
)  # fmt: skip
"""Elevation of each channel [deg]: ``pandarGeneral_internal.cc``."""

_PANDAR64_AZIMUTH = (1.042, 3.125, 5.208, -5.208, -3.125, -1.042)
"""Azimuths of channels 7 to 53, repeated, to the right [deg]; those of the other channels are the last."""

_PANDAR64_ORDER = (
    12, 40, 18, 38, 11, 26, 17, 32, 8, 23, 14, 29, 20, 35, 13, 28, 19, 34, 10, 25, 16, 31, 22, 37, 15, 30, 21, 36, 27,
    42, 24, 33, 1, 44, 2, 46, 3, 52, 4, 50, 5, 48, 6, 54, 41, 58, 47, 62, 53, 64, 7, 56, 43, 59, 49, 63, 9, 55, 39, 57,
    45, 60, 51, 61,
)  # fmt: skip
"""Channels in firing order, in pairs that fire together: ``Pandar64_Firetime Correction File.csv``."""

_QT128 = (
    (-52.627, 10.108), (-51.028, 9.72), (-49.515, 9.384), (-48.074, 9.091), (-46.695, 8.833), (-45.369, 8.603),
    (-44.09, 8.396), (-42.852, 8.209), (-41.651, 8.04), (-40.482, 7.885), (-39.343, 7.743), (-38.231, 7.612),
    (-37.143, 7.492), (-36.076, 7.38), (-35.03, 7.277), (-34.002, 7.18), (-32.992, 7.09), (-31.996, 7.006),
    (-31.015, 6.928), (-30.048, 6.854), (-29.093, 6.785), (-28.149, 6.721), (-27.216, 6.66), (-26.292, 6.602),
    (-25.378, 6.549), (-24.473, 6.498), (-23.575, 6.45), (-22.685, 6.405), (-21.802, 6.363), (-20.926, 6.323),
    (-20.056, 6.285), (-19.191, 6.25), (-18.331, -6.217), (-17.477, -6.186), (-16.627, -6.157), (-15.781, -6.129),
    (-14.94, -6.104), (-14.102, -6.08), (-13.268, -6.057), (-12.436, -6.037), (-11.608, -6.018), (-10.783, -6),
    (-9.96, -5.984), (-9.139, -5.969), (-8.32, -5.955), (-7.503, -5.943), (-6.688, -5.927), (-5.874, -5.923),
    (-5.061, -5.915), (-4.25, -5.908), (-3.439, -5.902), (-2.63, -5.897), (-1.82, -5.894), (-1.012, -5.892),
    (-0.203, -5.891), (0.606, -5.891), (1.414, -5.893), (2.223, -5.896), (3.033, -5.899), (3.843, -5.905),
    (4.654, -5.911), (5.466, -5.919), (6.279, -5.927), (7.094, -5.938), (7.91, 5.949), (8.728, 5.962), (9.547, 5.976),
    (10.369, 5.992), (11.194, 6.008), (12.02, 6.027), (12.85, 6.047), (13.683, 6.068), (14.519, 6.091), (15.359, 6.116),
    (16.202, 6.143), (17.05, 6.171), (17.902, 6.201), (18.759, 6.233), (19.621, 6.267), (20.488, 6.304),
    (21.362, 6.343), (22.241, 6.384), (23.128, 6.427), (24.022, 6.474), (24.923, 6.523), (25.833, 6.575),
    (26.751, 6.631), (27.679, 6.69), (28.618, 6.752), (29.567, 6.819), (30.528, 6.89), (31.502, 6.966), (32.49, 7.047),
    (33.493, 7.134), (34.512, 7.227), (35.549, 7.327),
)  # fmt: skip
"""Elevation and azimuth, to the right, of channels 1 to 96 [deg]: ``QT128C2X_Angle Correction File.csv``. The last 32
channels are the first 32 turned upside down."""

_QT128_ORDER = (
    99, 65, 35, 102, 72, 38, 107, 73, 43, 110, 80, 46, 115, 81, 51, 118, 88, 54, 123, 89, 59, 126, 96, 62, 97, 67, 33,
    104, 70, 40, 105, 75, 41, 112, 78, 48, 113, 83, 49, 120, 86, 56, 121, 91, 57, 128, 94, 64, 98, 68, 34, 103, 69, 39,
    106, 76, 42, 111, 77, 47, 114, 84, 50, 119, 85, 55, 122, 92, 58, 127, 93, 63, 100, 66, 36, 101, 71, 37, 108, 74, 44,
    109, 79, 45, 116, 82, 52, 117, 87, 53, 124, 90, 60, 125, 95, 61,
)  # fmt: skip
"""Channels of the first sequence in firing order: ``QT128C2X_Firetime Correction File.csv``. In the second sequence,
the first two of every three trade places, and the third is the channel 64 below the new first."""

_AT128_TIMES = (
    0, 0, 8.24, 4.112, 4.114, 8.24, 0, 0, 12.424, 4.144, 4.112, 8.264, 12.376, 12.376, 8.264, 12.424, 0, 0, 4.112, 8.24,
    4.144, 0, 0, 4.144, 12.424, 8.264, 4.112, 12.376, 12.376, 12.424, 8.264, 0.848, 2.504, 4.976, 6.616, 6.616, 9.112,
    2.504, 0.848, 10.768, 13.28, 13.28, 4.976, 9.112, 14.928, 14.928, 10.768, 2.504, 0.848, 6.616, 4.976, 9.112, 6.616,
    0.848, 2.504, 13.28, 10.768, 4.976, 13.28, 13.28, 9.112, 10.768, 14.928, 13.28, 0.848, 9.112, 13.28, 2.504, 4.976,
    0.848, 2.504, 14.928, 10.768, 10.768, 14.928, 4.976, 6.616, 6.616, 9.112, 10.768, 13.28, 13.28, 9.112, 4.976, 2.504,
    2.504, 0.848, 10.768, 14.928, 14.928, 10.768, 6.616, 4.976, 9.112, 6.616, 4.112, 12.424, 0, 4.144, 0, 0, 12.424, 0,
    8.264, 12.424, 12.424, 8.24, 8.24, 8.264, 12.376, 12.376, 12.424, 4.112, 4.144, 0, 0, 0, 0, 0, 12.424, 8.264, 8.24,
    4.144, 8.264, 8.24, 12.376, 12.376, 8.264,
)  # fmt: skip
"""Firing time of each channel [us]: ``AT128E2X_Firetime Correction File.csv``. Those of five channels differ in
Nebula."""


def pandar64(rate: float = 10.0, *, near: float = 0.3, far: float = 200.0) -> Rays:
    """Return the rays of a revolution of a Pandar64: 64 lasers from -24.9 to 14.9 degrees, 0.17 degrees apart near 0.

    A firing cycle takes 55.56 us, 1800 cycles at 10 Hz, in which 32 pairs of lasers fire 1.968 us apart, and 1.304 us
    from the 17th pair on. Azimuths differ by up to 10.4 degrees. Beams start 40.5 mm from the axis, from which the
    sensor reports distances; the depth of these rays is measured from their origins.

    Args:
        rate: Revolutions per second, 5 to 20 Hz; the firing period does not depend on it.
        near: Minimum measured range [m].
        far: Maximum measured range [m].

    Returns:
        Rays of shape ``(64, firings)``, the highest laser first, x forward, y left, z up. The first firing points
        along y, where Hesai's azimuth is 0, and the sensor rotates clockwise. Rings are channel numbers minus 1, from
        the top, as in Hesai's driver.
    """
    azimuth = np.full(64, _PANDAR64_AZIMUTH[-1])
    azimuth[6:53] = np.resize(_PANDAR64_AZIMUTH, 47)
    pair = np.empty(64)
    pair[np.array(_PANDAR64_ORDER) - 1] = np.arange(64) // 2
    times = np.minimum(pair, 16) * 1.968e-6 + np.maximum(pair - 16, 0) * 1.304e-6
    lasers = _lasers(_PANDAR64_ELEVATION, azimuth, np.arange(64), (0.03873, 0.012))
    return spin(lasers, rate, 1 / 18_000, times, near, far, start=math.pi / 2)


def xt32(rate: float = 10.0, *, near: float = 0.05, far: float = 120.0) -> Rays:
    """Return the rays of a revolution of a PandarXT-32: 32 lasers from -16 to 15 degrees, 1 degree apart.

    A firing cycle takes 50 us, 2000 cycles at 10 Hz, and lasers fire 1.512 us apart. Beams start 34.1 mm from the axis.
    See `pandar64` for arguments, result and errors.
    """
    number = np.arange(32)
    lasers = _lasers(15 - number, np.zeros(32), number, (0.0315, 0.013))
    return spin(lasers, rate, 1 / 20_000, number * 1.512e-6, near, far, start=math.pi / 2)


def qt128(rate: float = 10.0, *, near: float = 0.05, far: float = 50.0) -> Rays:
    """Return the rays of a revolution of a QT128C2X: 128 lasers from -52.6 to 52.6 degrees, for short ranges.

    Two sequences of 96 lasers, 111.1 us each, alternate: channels 33 to 64 fire in the first, 1 to 32 in the second,
    and 65 to 128 in both. The rays of a channel that fires in both are two rows. Beams start 36.1 mm from the axis.
    See `pandar64` for arguments and errors.

    Returns:
        Rays of shape ``(192, firings)``, 450 firings at 10 Hz; otherwise as in `pandar64`.
    """
    elevation, azimuth = np.array(_QT128).T
    elevation = np.concatenate([elevation, -elevation[31::-1]])
    azimuth = np.concatenate([azimuth, -azimuth[31::-1]])
    first = np.array(_QT128_ORDER).reshape(32, 3)
    second = np.stack([first[:, 1], first[:, 0], first[:, 1] - 64], axis=1)
    position = np.arange(96)
    times = position * 0.856e-6 + position // 3 * 0.6e-6
    channel = np.concatenate([first.ravel(), second.ravel()]) - 1
    lasers = _lasers(elevation[channel], azimuth[channel], channel, (0.0354, -0.0072))
    return spin(lasers, rate, 1 / 4500, np.concatenate([times, times + 1 / 9000]), near, far, start=math.pi / 2)


def at128(*, near: float = 1.0, far: float = 180.0) -> Rays:
    """Return the rays of a frame of an AT128: 128 lasers, 120 by 25.4 degrees, 10 frames per second.

    A mirror moves all beams from the left to the right in 50 ms, 1200 firings 0.1 degrees apart; the second half of a
    frame is idle. Azimuths differ by up to 4.8 degrees between lasers. The corrections by azimuth, up to 0.9 degrees,
    which are in the file of a sensor, are not applied.

    Args:
        near: Minimum measured range [m].
        far: Maximum measured range [m].

    Returns:
        Rays of shape ``(128, 1200)``, the highest laser first, x forward, y left, z up. Rings are channel numbers
        minus 1, from the top, as in Hesai's driver.
    """
    elevation = np.radians(np.linspace(12.8834, -12.4227, 128))
    offset = np.tile([-2.4, 0.65] * 8 + [2.4, -0.65] * 8, 4)
    azimuth = np.radians(offset[:, None] + 59.95 - 0.1 * np.arange(1200))
    times = np.array(_AT128_TIMES)[:, None] * 1e-6 + np.arange(1200) * (0.05 / 1200)
    rings = np.broadcast_to(np.arange(128)[:, None], times.shape)
    directions = directions_at(azimuth, elevation[:, None])
    return Rays(directions, times=times, rings=rings, near=near, far=far, axes="ros_body")


def _lasers(elevation: ArrayLike, azimuth: ArrayLike, rings: NDArray[np.int64], origin: tuple[float, float]) -> Lasers:
    """Return lasers from their angles, azimuths to the right [deg], and the common origin, forward and left [m]."""
    offset = -np.radians(np.asarray(azimuth, dtype=np.float64))
    forward, left = origin
    return Lasers(
        np.radians(np.asarray(elevation, dtype=np.float64)),
        offset,
        forward * np.cos(offset) + left * np.sin(offset),
        left * np.cos(offset) - forward * np.sin(offset),
        np.zeros(len(offset)),
        rings,
    )
