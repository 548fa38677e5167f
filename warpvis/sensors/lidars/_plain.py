# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Regular patterns: planar scanners, RPLIDAR, evenly spaced lidars, grids of parallel rays, and the RS-Bpearl."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.rays import Rays
from warpvis.core.arrays import as_point
from warpvis.core.checks import as_items, check_angle, check_choice, check_number, check_whole, degrees_hint
from warpvis.errors import CameraError

_MAX_RAYS = 2**26
_TURN = 2.0 * math.pi

# Samples per second; minimum, typical and maximum scan rate [Hz]; minimum and maximum range [m]. Sources: Slamtec's
# data sheets of the A1M8 (2016, page 7), the A2M8 (revision 2.5, page 3) and the A3M1 (enhanced mode); and range_min of
# rplidar_ros (src/node.cpp at 3cd94fe) for the A2. Those of the S2 are of Slamtec's page slamtec.com/en/s2/spec (90 %
# reflectivity) and its data sheet 2.0 (rates), which were read as others cite them, not in the original.
_RPLIDARS = {
    "A1": (8000, (1.0, 5.5, 10.0), (0.15, 12.0)),
    "A2": (8000, (5.0, 10.0, 15.0), (0.15, 12.0)),
    "A3": (16_000, (5.0, 10.0, 15.0), (0.2, 25.0)),
    "S2": (32_000, (8.0, 10.0, 15.0), (0.05, 30.0)),
}


def directions_at(azimuth: ArrayLike, elevation: ArrayLike) -> NDArray[np.float64]:
    """Return unit vectors of the sensor frame (x forward, y left, z up), shape ``(..., 3)``.

    The azimuth is counted from x toward y, the elevation from the horizontal plane [rad]. They are broadcast.
    """
    azimuth, elevation = np.broadcast_arrays(*(np.asarray(angles, dtype=np.float64) for angles in (azimuth, elevation)))
    horizontal = np.cos(elevation)
    return np.stack([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), np.sin(elevation)], axis=-1)


def check_positive(value: object, name: str, unit: str) -> float:
    """Check that `value` is a finite number above 0, and return it."""
    number = check_number(value, name, error=CameraError)
    if number <= 0:
        raise CameraError(f"{name} must be more than 0 {unit}, got {number:g}")
    return number


def _check_span(span: object, name: str, maximum: float = math.inf) -> tuple[float, float]:
    """Check that `span` is two angles in ascending order [rad], and return them."""
    ends = as_items(span, name, CameraError)
    if len(ends) != 2:
        raise CameraError(f"{name} must be two angles in radians, got {span!r}")
    low, high = (
        check_angle(end, f"{name}[{index}]", minimum=-maximum, maximum=maximum, error=CameraError)
        for index, end in enumerate(ends)
    )
    if low > high:
        raise CameraError(f"{name} must be two angles, the lower one first, got {low:g} and {high:g}")
    return low, high


def laser_scan(
    angle_min: float = -math.pi,
    angle_max: float = math.pi,
    angle_increment: float = math.pi / 180.0,
    *,
    time_increment: float = 0.0,
    near: float = 0.0,
    far: float = math.inf,
) -> Rays:
    """Return the rays of a planar scanner, defined like ROS's ``sensor_msgs/LaserScan``.

    Args:
        angle_min: Angle of the first ray, from x toward y, that is to the left [rad].
        angle_max: Angle of the last ray, or an upper bound if it is not a multiple of the increment away [rad].
        angle_increment: Angle between consecutive rays [rad]; negative for a scanner that rotates clockwise, with
            `angle_max` below `angle_min`.
        time_increment: Time between consecutive rays [s].
        near: Minimum measured range [m].
        far: Maximum measured range [m].

    Returns:
        Rays of shape ``(rays,)`` in the plane z = 0, with times; `warpvis.io.to_laserscan` creates the message.
    """
    first, last = (
        check_angle(angle, name, minimum=-_TURN - 1e-6, maximum=_TURN + 1e-6, error=CameraError)
        for angle, name in ((angle_min, "angle_min"), (angle_max, "angle_max"))
    )
    step = check_angle(angle_increment, "angle_increment", minimum=-_TURN, maximum=_TURN, error=CameraError)
    interval = check_number(time_increment, "time_increment", minimum=0.0, error=CameraError)
    azimuth = _steps(first, last, step, "angle_increment")
    directions = directions_at(azimuth, 0.0)
    return Rays(directions, times=np.arange(len(azimuth)) * interval, near=near, far=far, axes="ros_body")


def rplidar(model: str, rate: float | None = None, *, near: float | None = None, far: float | None = None) -> Rays:
    """Return the rays of a revolution of a Slamtec RPLIDAR, a planar scanner that rotates clockwise.

    Args:
        model: ``"A1"``, ``"A2"``, ``"A3"`` or ``"S2"``: 8000, 8000, 16,000 and 32,000 samples per second, at most.
        rate: Revolutions per second, 1 to 10 Hz for an A1, 5 to 15 Hz for an A2 or A3, 8 to 15 Hz for an S2; by
            default the typical rate, 5.5 Hz for an A1, 10 Hz for the others.
        near: Minimum measured range [m]; by default that of the model, 0.15, 0.15, 0.2 or 0.05 m.
        far: Maximum measured range [m]; by default that of the model for white objects, 12, 12, 25 or 30 m.

    Returns:
        Rays of shape ``(rays,)`` in the plane z = 0, the first one along x, with times, as from `laser_scan`.
    """
    name = check_choice(model.upper() if isinstance(model, str) else model, "model", tuple(_RPLIDARS), CameraError)
    samples, (slowest, typical, fastest), (nearest, farthest) = _RPLIDARS[name]
    rate = check_number(typical if rate is None else rate, "rate", minimum=slowest, maximum=fastest, error=CameraError)
    count = math.floor(samples / rate + 1e-9)
    step = _TURN * rate / samples
    return laser_scan(
        0.0,
        -(count - 1) * step,
        -step,
        time_increment=1 / samples,
        near=nearest if near is None else near,
        far=farthest if far is None else far,
    )


def even(
    channels: int,
    elevation: tuple[float, float] = (-math.pi / 12, math.pi / 12),
    azimuth: tuple[float, float] = (-math.pi, math.pi),
    increment: float = math.pi / 180.0,
    *,
    rate: float | None = None,
    near: float = 0.0,
    far: float = math.inf,
) -> Rays:
    """Return the rays of a lidar with evenly spaced beams, like Isaac Lab's ``LidarPatternCfg`` and Genesis' lidar.

    Args:
        channels: Number of beams per column.
        elevation: Elevation of the lowest and the highest beam [rad].
        azimuth: Azimuth of the first column, and upper bound of the azimuth of the last [rad]. For a full turn, the
            last column is left out because it is the same as the first.
        increment: Angle between consecutive columns, to the left [rad].
        rate: Revolutions per second, for the times of columns; by default rays have no times.
        near: Minimum measured range [m].
        far: Maximum measured range [m].

    Returns:
        Rays of shape ``(channels, columns)``, the highest beam first; rings are counted from the lowest.
    """
    channels = check_whole(channels, "channels", error=CameraError)
    lowest, highest = _check_span(elevation, "elevation", math.pi / 2)
    first, last = _check_span(azimuth, "azimuth")
    if channels == 1 and lowest != highest:
        raise CameraError(
            f"elevation must be two equal angles for a lidar with one channel, got {lowest:g} and {highest:g}"
        )
    columns = _columns(first, last, increment, channels)
    return _rotate_beams(np.linspace(highest, lowest, channels), columns, rate, near, far)


def bpearl(
    increment: float = math.radians(0.2),
    *,
    rate: float | None = None,
    near: float = 0.0,
    far: float = math.inf,
) -> Rays:
    """Return the rays of a RoboSense RS-Bpearl: a hemisphere about z, 32 beams at elevations of 2.3125 to 89.5 degrees.

    The elevations are those of Isaac Lab's ``BpearlPatternCfg`` (``patterns_cfg.py`` at 11cfcd98), in steps of 2.8125
    degrees. The default increment of 0.2 degrees is the device's at 10 Hz; Isaac Lab's is 10 degrees. See `even` for
    arguments, result and errors.
    """
    elevation = np.radians(89.5 - 2.8125 * np.arange(32))
    return _rotate_beams(elevation, _columns(-math.pi, math.pi, increment, 32), rate, near, far)


def grid(
    size: tuple[float, float],
    resolution: float,
    direction: ArrayLike = (0.0, 0.0, -1.0),
    *,
    near: float = 0.0,
    far: float = math.inf,
) -> Rays:
    """Return parallel rays from a grid in the plane z = 0, for height scans, like Isaac Lab's grid pattern.

    Args:
        size: Length along x and width along y [m]; the grid is centered at the origin and includes the edges.
        resolution: Spacing of the points [m].
        direction: Direction of all rays, shape ``(3,)``; it need not have length 1.
        near: Minimum measured range [m].
        far: Maximum measured range [m].

    Returns:
        Rays of shape ``(points along y, points along x)``, in the order of Isaac Lab's ``ordering="xy"``.
    """
    step = check_positive(resolution, "resolution", "m")
    sides = as_items(size, "size", CameraError)
    if len(sides) != 2:
        raise CameraError(f"size must be a length and a width in meters, got {size!r}")
    length, width = (
        check_number(side, f"size[{index}]", minimum=0.0, error=CameraError) for index, side in enumerate(sides)
    )
    along = as_point(direction, "direction", CameraError)
    norm = float(np.linalg.norm(along))
    if norm == 0:
        raise CameraError("direction must not be zero")
    if (length / step + 1) * (width / step + 1) > _MAX_RAYS:
        raise CameraError(
            f"a grid may have at most {_MAX_RAYS} rays; {length:g} x {width:g} m with resolution {step:g} m has more"
        )
    x = _steps(-length / 2, length / 2, step, "resolution")
    y = _steps(-width / 2, width / 2, step, "resolution")
    origins = np.zeros((len(y), len(x), 3))
    origins[..., 0], origins[..., 1] = x, y[:, None]
    directions = np.broadcast_to(along / norm, origins.shape)
    return Rays(directions, origins=origins, near=near, far=far, axes="ros_body")


def _rotate_beams(
    elevation: NDArray[np.float64], azimuth: NDArray[np.float64], rate: float | None, near: float, far: float
) -> Rays:
    """Return rays for all pairs of an elevation, the highest first, and an azimuth [rad]."""
    shape = (len(elevation), len(azimuth))
    times = None
    if rate is not None:
        rate = check_positive(rate, "rate", "Hz")
        times = np.broadcast_to(np.arange(shape[1]) / (shape[1] * rate), shape)
    rings = np.broadcast_to(np.arange(shape[0])[::-1, None], shape)
    directions = directions_at(azimuth, elevation[:, None])
    return Rays(directions, times=times, rings=rings, near=near, far=far, axes="ros_body")


def _columns(first: float, last: float, increment: object, channels: int) -> NDArray[np.float64]:
    """Return azimuths of columns [rad], without the last one if it is a full turn from the first."""
    step = check_angle(increment, "increment", minimum=-_TURN, maximum=_TURN, error=CameraError)
    if step <= 0:
        raise CameraError(f"increment must be more than 0 radians, got {step:g}")
    if last - first > _TURN + 1e-9:
        raise CameraError(f"azimuth must be within one turn, got {last - first:g} radians{degrees_hint(last)}")
    if channels > _MAX_RAYS or (last - first) / step * channels > _MAX_RAYS:
        raise CameraError(
            f"a lidar may have at most {_MAX_RAYS} rays; {channels} channels with an increment of {step:g} radians "
            "have more"
        )
    azimuth = _steps(first, last, step, "increment")
    is_closed = len(azimuth) > 1 and azimuth[-1] - azimuth[0] > _TURN - 1e-9
    return azimuth[:-1] if is_closed else azimuth


def _steps(first: float, last: float, step: float, name: str) -> NDArray[np.float64]:
    """Return numbers from `first` to `last`, including `last` if it is a whole number of steps away up to rounding."""
    if step == 0 or (last - first) / step < 0:
        raise CameraError(f"{name} must lead from {first:g} to {last:g}, got {step:g}")
    count = (last - first) / step
    if count > _MAX_RAYS:
        raise CameraError(f"a pattern may have at most {_MAX_RAYS} rays; with {name} = {step:g} it has more")
    return first + np.arange(math.floor(count + 1e-9) + 1, dtype=np.float64) * step
