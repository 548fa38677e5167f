# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Patterns by rule: scanners of one plane, even lidars, grids of parallel rays, and the RS-Bpearl."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_point
from warpvis.core.checks import as_items, check_angle, check_number, check_whole, degrees_hint
from warpvis.errors import CameraError
from warpvis.sensors._rays import Rays
from warpvis.sensors.lidars._angles import check_increment, check_span, directions_at

_MAX_RAYS = 2**26
_TURN = 2.0 * math.pi


def laser_scan(
    angle_min: float = -math.pi,
    angle_max: float = math.pi,
    angle_increment: float = math.pi / 180.0,
    *,
    time_increment: float = 0.0,
    near: float = 0.0,
    far: float = math.inf,
) -> Rays:
    """Make the rays of a scanner of one plane, by the words of ROS's ``sensor_msgs/LaserScan``.

    Args:
        angle_min: Where the first ray looks, from x towards y, so to the left [rad].
        angle_max: Where the last one looks, or up to where, if increments do not end there [rad].
        angle_increment: From ray to ray [rad]; less than 0 for a scanner that turns clockwise, with `angle_max` below
            `angle_min`.
        time_increment: From ray to ray [s].
        near: Least range that it measures [m].
        far: Greatest [m].

    Returns:
        Rays of shape ``(rays,)`` in the plane z = 0, with times; `warpvis.io.to_laserscan` makes the message.

    Raises:
        CameraError: A number is not what it has to be.
    """
    first, last = (
        check_angle(angle, name, least=-_TURN - 1e-6, most=_TURN + 1e-6, error=CameraError)
        for angle, name in ((angle_min, "angle_min"), (angle_max, "angle_max"))
    )
    step = check_increment(angle_increment, "angle_increment")
    wait = check_number(time_increment, "time_increment", least=0.0, error=CameraError)
    azimuth = _steps(first, last, step, "angle_increment")
    directions = directions_at(azimuth, 0.0)
    return Rays(directions, times=np.arange(len(azimuth)) * wait, near=near, far=far, axes="ros_body")


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
    """Make the rays of a lidar whose beams are evenly spread, as Isaac Lab's ``LidarPatternCfg`` and Genesis' do.

    Args:
        channels: Number of beams above each other.
        elevation: Elevation of the lowest and the highest beam [rad].
        azimuth: Where the first column looks, and the last, or up to where [rad]; of a whole turn, the last is left
            out, since it is the first.
        increment: From column to column, to the left [rad].
        rate: Turns in a second, for times of columns; by default rays have no times.
        near: Least range that it measures [m].
        far: Greatest [m].

    Returns:
        Rays of shape ``(channels, columns)``, the highest beam first; rings are counted from below.

    Raises:
        CameraError: A number is not what it has to be.
    """
    channels = check_whole(channels, "channels", error=CameraError)
    lowest, highest = check_span(elevation, "elevation", math.pi / 2)
    first, last = check_span(azimuth, "azimuth")
    step = check_increment(increment, "increment")
    if step <= 0:
        raise CameraError(f"increment must be more than 0 radians, got {step:g}")
    if channels == 1 and lowest != highest:
        raise CameraError("elevation must be one angle twice, of a lidar with one channel")
    columns = _around(first, last, step, channels)
    return _turning(np.linspace(highest, lowest, channels), columns, rate, near, far)


def bpearl(
    increment: float = math.radians(0.2),
    *,
    rate: float | None = None,
    near: float = 0.0,
    far: float = math.inf,
) -> Rays:
    """Make the rays of a RoboSense RS-Bpearl: a hemisphere about z, 32 beams from 2.3125 to 89.5 degrees above.

    Angles are those of Isaac Lab's ``BpearlPatternCfg`` (``patterns_cfg.py`` at 11cfcd98): 2.8125 degrees apart.

    Args:
        increment: From column to column, to the left [rad]: 0.2 degrees, the device's at 10 turns in a second. Isaac
            Lab's own default is 10 degrees.
        rate: Turns in a second, for times of columns; by default rays have no times.
        near: Least range that it measures [m].
        far: Greatest [m].

    Returns:
        Rays of shape ``(32, columns)``, the highest beam first; rings are counted from below.

    Raises:
        CameraError: A number is not what it has to be.
    """
    step = check_increment(increment, "increment")
    if step <= 0:
        raise CameraError(f"increment must be more than 0 radians, got {step:g}")
    up = np.radians(89.5 - 2.8125 * np.arange(32))
    return _turning(up, _around(-math.pi, math.pi, step, 32), rate, near, far)


def grid(
    size: tuple[float, float],
    resolution: float,
    direction: ArrayLike = (0.0, 0.0, -1.0),
    *,
    near: float = 0.0,
    far: float = math.inf,
) -> Rays:
    """Make parallel rays that begin on a grid of the plane z = 0, for scans of heights, as Isaac Lab's grid pattern.

    Args:
        size: Length along x and width along y [m]; the grid is about the origin, edges included.
        resolution: Distance of its points [m].
        direction: Where all rays look, shape ``(3,)``, of any length.
        near: Least range that they measure [m].
        far: Greatest [m].

    Returns:
        Rays of shape ``(points along y, points along x)``, in the order of Isaac Lab's ``ordering="xy"``.

    Raises:
        CameraError: A number is not what it has to be.
    """
    step = check_number(resolution, "resolution", error=CameraError)
    if step <= 0:
        raise CameraError(f"resolution must be more than 0 m, got {step:g}")
    sides = as_items(size, "size", CameraError)
    if len(sides) != 2:
        raise CameraError(f"size must be a length and a width in metres, got {size!r}")
    length, width = (
        check_number(side, f"size[{place}]", least=0.0, error=CameraError) for place, side in enumerate(sides)
    )
    along = as_point(direction, "direction", CameraError)
    norm = float(np.linalg.norm(along))
    if norm == 0:
        raise CameraError("direction must have a length, got 0")
    if (length / step + 1) * (width / step + 1) > _MAX_RAYS:
        raise CameraError(f"a grid may have {_MAX_RAYS} rays, and {length:g} x {width:g} m by {step:g} m has more")
    x = _steps(-length / 2, length / 2, step, "resolution")
    y = _steps(-width / 2, width / 2, step, "resolution")
    origins = np.zeros((len(y), len(x), 3))
    origins[..., 0], origins[..., 1] = x, y[:, None]
    directions = np.broadcast_to(along / norm, origins.shape)
    return Rays(directions, origins=origins, near=near, far=far, axes="ros_body")


def _turning(
    elevation: NDArray[np.float64], azimuth: NDArray[np.float64], rate: float | None, near: float, far: float
) -> Rays:
    """Make rays of beams above each other [rad], the highest first, at each azimuth [rad]."""
    shape = (len(elevation), len(azimuth))
    times = None
    if rate is not None:
        rate = check_number(rate, "rate", error=CameraError)
        if rate <= 0:
            raise CameraError(f"rate must be more than 0 turns in a second, got {rate:g}")
        times = np.broadcast_to(np.arange(shape[1]) / (shape[1] * rate), shape)
    rings = np.broadcast_to(np.arange(shape[0])[::-1, None], shape)
    directions = directions_at(azimuth, elevation[:, None])
    return Rays(directions, times=times, rings=rings, near=near, far=far, axes="ros_body")


def _around(first: float, last: float, step: float, channels: int) -> NDArray[np.float64]:
    """Return azimuths of columns [rad]; of a whole turn the last is left out."""
    if last - first > _TURN + 1e-9:
        raise CameraError(f"azimuth must be within one turn, got {last - first:g} radians{degrees_hint(last)}")
    if channels > _MAX_RAYS or (last - first) / step * channels > _MAX_RAYS:
        raise CameraError(
            f"a lidar may have {_MAX_RAYS} rays, and {channels} channels {step:g} radians apart have more"
        )
    azimuth = _steps(first, last, step, "increment")
    whole = len(azimuth) > 1 and azimuth[-1] - azimuth[0] > _TURN - 1e-9
    return azimuth[:-1] if whole else azimuth


def _steps(first: float, last: float, step: float, name: str) -> NDArray[np.float64]:
    """Return numbers from the first to the last, which is among them if steps end there but for rounding."""
    if step == 0 or (last - first) / step < 0:
        raise CameraError(f"{name} must lead from {first:g} to {last:g}, got {step:g}")
    count = (last - first) / step
    if count > _MAX_RAYS:
        raise CameraError(f"a pattern may have {_MAX_RAYS} rays, and {name} {step:g} makes more")
    return first + np.arange(math.floor(count + 1e-9) + 1, dtype=np.float64) * step
