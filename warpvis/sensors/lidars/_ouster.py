# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ouster lidars, from their metadata or from the nominal beams of a model."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.rays import Rays
from warpvis.core.checks import as_path, check_choice, is_whole, truncate
from warpvis.core.file_content import read_json
from warpvis.core.poses import is_orthonormal
from warpvis.core.types import Json
from warpvis.errors import CameraError, FileFormatError
from warpvis.sensors.lidars._plain import directions_at

MODES = ("512x10", "512x20", "1024x10", "1024x20", "2048x10", "4096x5")
"""Columns per revolution, and revolutions per second."""

# Distance of the beam origins from the axis [mm], by prefix of the product line; and for the first generation.
_BEAM_RADIUS = {"OS-0-": 27.67, "OS-1-": 15.806, "OS-2-": 13.762}
_BEAM_RADIUS_GEN1 = 12.163

# Height of the lidar frame above the sensor frame [mm]: default for metadata without a transform, and for an OS2.
_HEIGHT, _HEIGHT_OS2 = 36.18, 78.296

# Half of the vertical field of view, and azimuths of the 4 columns of beams [deg]: of OS-*-128 sensors whose metadata
# is part of ouster-sdk's tests (46b7bcee), made evenly spaced and symmetric.
_NOMINAL = {
    "OS0-128": (46.0, (9.15, 3.05, -3.05, -9.15)),
    "OS1-128": (21.4, (4.21, 1.41, -1.41, -4.21)),
    "OS2-128": (10.9, (2.07, 0.69, -0.69, -2.07)),
}

# Elevations of the upper half of the beams of ouster-sdk's default for an OS-1-64 without metadata [deg].
_OS1_64 = (
    16.611, 16.084, 15.557, 15.029, 14.502, 13.975, 13.447, 12.92, 12.393, 11.865, 11.338, 10.811, 10.283, 9.756, 9.229,
    8.701, 8.174, 7.646, 7.119, 6.592, 6.064, 5.537, 5.01, 4.482, 3.955, 3.428, 2.9, 2.373, 1.846, 1.318, 0.791, 0.264,
)  # fmt: skip

# First beam and step of the beams of a uniform sensor with fewer beams, among the 128: those of OS-*-32-U sensors are
# one column, and those of an OS1 with 64 beams two (metadata of ouster-sdk's tests). An OS0 and an OS2 with 64 beams
# are assumed to be alike. "OS1-64" is the default of ouster-sdk, of the first generation.
_UNIFORM = {"32": (3, 4), "64": (1, 2), "64-U": (1, 2), "128": (0, 1)}
_MODELS = (
    "OS0-128", "OS0-64", "OS0-32", "OS1-128", "OS1-64", "OS1-64-U", "OS1-32", "OS2-128", "OS2-64", "OS2-32",
)  # fmt: skip


@dataclass(frozen=True)
class _Beams:
    """Beams of a sensor, from its metadata; lengths in meters."""

    altitude: NDArray[np.float64]
    azimuth: NDArray[np.float64]
    beam_to_lidar: tuple[float, float]
    lidar_to_sensor: NDArray[np.float64]
    mode: str | None
    columns: int
    window: tuple[int, int] | None


def ouster(
    sensor: str | os.PathLike[str],
    mode: str | None = None,
    *,
    near: float = 0.0,
    far: float = math.inf,
) -> Rays:
    """Return the rays of a revolution of an Ouster OS0, OS1 or OS2, as in ``ouster.sdk.core.XYZLut``.

    Let n be the distance of the beam origins from the axis, and te = 2 pi (1 - m / W) the encoder angle of column m of
    W. In the lidar frame, a beam of azimuth A (to the right) and altitude a has the direction
    d = (cos(te - A) cos a, sin(te - A) cos a, sin a), and its range is measured from n (cos te, sin te, 0) - n d. The
    sensor frame is rotated by 180 degrees about z, and lower. Source: ouster-sdk, ``xyzlut.cpp`` at 46b7bcee.

    Args:
        sensor: The metadata of a sensor, a JSON file, of firmware 1.12 or later; or ``"OS1-128"``, ``"OS1-64-U"``,
            ``"OS1-32"`` and so on, also of an OS0 and OS2, for nominal beams, evenly spaced, from which every real
            sensor differs slightly. ``"OS1-64"`` has the beams of the first generation, 33 instead of 42 degrees.
        mode: Columns per revolution and revolutions per second, such as ``"1024x10"``; by default the mode in the file,
            or ``"1024x10"`` for a model.
        near: Minimum measured range [m].
        far: Maximum measured range [m].

    Returns:
        Rays of shape ``(beams, columns)``, the highest beam first, columns in the order of measurement ("staggered"):
        the first one points backward, and the sensor rotates clockwise. If the metadata has a column window, only the
        columns in it. Rings are row indices; all rays of a column have the same time.

    Raises:
        CameraError: If the model or mode is unknown.
        FileFormatError: If the file is not metadata of such a sensor.
    """
    beams = _nominal(sensor) if isinstance(sensor, str) and _is_model_name(sensor) else _read(sensor)
    mode = check_choice((beams.mode or "1024x10") if mode is None else mode, "mode", MODES, CameraError)
    width, rate = (int(number) for number in mode.split("x"))
    columns = _window(beams, width)
    encoder = 2.0 * math.pi * (1.0 - columns / width)
    radius, height = beams.beam_to_lidar
    directions = directions_at(encoder - beams.azimuth[:, None], beams.altitude[:, None])
    beam_origins = np.stack(
        [radius * np.cos(encoder), radius * np.sin(encoder), np.full(len(columns), height)], axis=-1
    )
    origins = beam_origins - math.hypot(radius, height) * directions
    rotation, shift = beams.lidar_to_sensor[:3, :3], beams.lidar_to_sensor[:3, 3]
    shape = directions.shape[:2]
    return Rays(
        directions @ rotation.T,
        origins=origins @ rotation.T + shift,
        times=np.broadcast_to(columns / (width * rate), shape),
        rings=np.broadcast_to(np.arange(shape[0])[:, None], shape),
        near=near,
        far=far,
        axes="ros_body",
    )


def _is_model_name(name: str) -> bool:
    return not name.lower().endswith(".json") and re.fullmatch(r"[Oo][Ss]-?\d.*", name) is not None


def _nominal(name: str) -> _Beams:
    """Return the nominal beams of a model."""
    model = re.sub(r"^OS-?(\d)-?", r"OS\1-", name.upper())
    if model not in _MODELS:
        raise CameraError(f"sensor must be {', '.join(_MODELS)} or the metadata of a sensor, a JSON file, got {name!r}")
    if model == "OS1-64":
        half = np.array(_OS1_64)
        altitude, azimuth = np.concatenate([half, -half[::-1]]), np.tile((3.164, 1.055, -1.055, -3.164), 16)
    else:
        highest, columns = _NOMINAL[f"{model[:3]}-128"]
        first, step = _UNIFORM[model[4:]]
        altitude = np.linspace(highest, -highest, 128)[first::step]
        azimuth = np.tile(columns, 32)[first::step]
    radius = _BEAM_RADIUS[f"OS-{model[2]}-"] / 1000
    height = _HEIGHT_OS2 if model.startswith("OS2") else _HEIGHT
    return _Beams(
        np.radians(altitude), np.radians(azimuth), (radius, 0.0), _default_lidar_to_sensor(height), None, 0, None
    )


def _default_lidar_to_sensor(height: float = _HEIGHT) -> NDArray[np.float64]:
    """Return the default transform from the lidar frame to the sensor frame [m], with the lidar at a height [mm]."""
    transform = np.diag([-1.0, -1.0, 1.0, 1.0])
    transform[2, 3] = height / 1000
    return transform


def _read(path: str | os.PathLike[str]) -> _Beams:
    """Read metadata. Firmware before 2.4 writes all keys at the top level, later firmware in sections."""
    path = as_path(path, "sensor")
    fields = read_json(path)
    if not isinstance(fields, dict):
        raise FileFormatError(f"{path}: is not metadata of an Ouster sensor: it must be a JSON object")
    top = fields
    beams = _section(top, "beam_intrinsics")
    altitude, azimuth = (_angles(beams, name, path) for name in ("beam_altitude_angles", "beam_azimuth_angles"))
    if altitude.shape != azimuth.shape:
        raise FileFormatError(f"{path}: has {len(altitude)} beam altitudes, but {len(azimuth)} beam azimuths")
    layout = top.get("lidar_data_format", top.get("data_format"))
    layout = layout if isinstance(layout, dict) else {}
    count = layout.get("pixels_per_column", len(altitude))
    missing = int((altitude == 0).sum())  # metadata of early sensors with 16 and 32 beams has 64 angles, padded with 0
    if count != len(altitude) or missing > 1:
        raise FileFormatError(
            f"{path}: must have the angles of all {count!r} beams, got {len(altitude)}, {missing} of them 0"
        )
    mode = top.get("lidar_mode", _section(top, "config_params").get("lidar_mode"))
    product = top.get("prod_line", _section(top, "sensor_info").get("prod_line"))
    product = product if isinstance(product, str) else ""
    named = re.match(r"OS-\d-(\d+)", product)
    if named and int(named[1]) != len(altitude):
        raise FileFormatError(f"{path}: has {len(altitude)} beams, but is for an {truncate(product)}")
    columns = layout.get("columns_per_frame")
    return _Beams(
        altitude,
        azimuth,
        _read_beam_origin(beams, product, path),
        _read_lidar_to_sensor(_section(top, "lidar_intrinsics"), path),
        mode if isinstance(mode, str) else None,
        columns if is_whole(columns) else 0,
        _read_window(layout.get("column_window"), columns, path),
    )


def _section(fields: dict[str, Json], name: str) -> dict[str, Json]:
    """Return a section of the metadata, or all fields if the metadata has no such section."""
    section = fields.get(name)
    return section if isinstance(section, dict) else fields


def _angles(fields: dict[str, Json], name: str, path: os.PathLike[str]) -> NDArray[np.float64]:
    """Return a list of angles in degrees from the metadata, converted to radians."""
    values = fields.get(name)
    if not isinstance(values, list) or not values:
        raise FileFormatError(f"{path}: is not metadata of an Ouster sensor: {name} is missing")
    numbers = _floats(values, (len(values),), name, path)
    if np.abs(numbers).max() > 360.0:
        raise FileFormatError(f"{path}: {name} must be angles in degrees, got {np.abs(numbers).max():g}")
    return np.radians(numbers)


def _floats(values: Json, shape: tuple[int, ...], name: str, path: os.PathLike[str]) -> NDArray[np.float64]:
    try:
        numbers = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        numbers = np.array(np.nan)
    if numbers.size != math.prod(shape) or not np.isfinite(numbers).all():
        raise FileFormatError(f"{path}: {name} must be {math.prod(shape)} finite numbers")
    return numbers.reshape(shape)


def _read_beam_origin(beams: dict[str, Json], product: str, path: os.PathLike[str]) -> tuple[float, float]:
    """Return the distance of the beam origins from the axis, and their height [m]."""
    if isinstance(beams.get("beam_to_lidar_transform"), list):
        transform = _floats(beams["beam_to_lidar_transform"], (4, 4), "beam_to_lidar_transform", path)
        return transform[0, 3] / 1000, transform[2, 3] / 1000
    radius = beams.get("lidar_origin_to_beam_origin_mm")
    if radius is None:
        prefixes = [prefix for prefix in _BEAM_RADIUS if product.startswith(prefix)]
        radius = _BEAM_RADIUS[prefixes[0]] if prefixes else _BEAM_RADIUS_GEN1
    return float(_floats(radius, (), "lidar_origin_to_beam_origin_mm", path)) / 1000, 0.0


def _read_lidar_to_sensor(lidar: dict[str, Json], path: os.PathLike[str]) -> NDArray[np.float64]:
    """Return the transform from the lidar frame to the sensor frame [m]."""
    value = lidar.get("lidar_to_sensor_transform")
    if value is None:
        return _default_lidar_to_sensor()
    transform = _floats(value, (4, 4), "lidar_to_sensor_transform", path)
    if not is_orthonormal(transform[:3, :3]):
        raise FileFormatError(f"{path}: lidar_to_sensor_transform must be a rotation and a translation")
    transform[:3, 3] /= 1000
    return transform


def _read_window(value: Json, columns: Json, path: os.PathLike[str]) -> tuple[int, int] | None:
    """Return the first and last measured column."""
    if value is None:
        return None
    ends = value if isinstance(value, list) and len(value) == 2 else []
    if not is_whole(columns) or columns < 1:
        raise FileFormatError(f"{path}: columns_per_frame must be a whole number from 1 up, got {columns!r}")
    if not ends or not all(is_whole(end) and 0 <= end < columns for end in ends):
        raise FileFormatError(f"{path}: column_window must be two columns of the {columns} per frame, got {value!r}")
    return int(ends[0]), int(ends[1])


def _window(beams: _Beams, width: int) -> NDArray[np.int64]:
    """Return the measured columns. A window whose end is less than its start wraps around."""
    columns = np.arange(width)
    if beams.window in (None, (0, beams.columns - 1)):
        return columns
    first, last = beams.window
    if beams.columns != width:
        raise CameraError(
            f"mode must have {beams.columns} columns because the file has a window from {first} to {last}, got {width}"
        )
    return columns[(columns >= first) & (columns <= last) if first <= last else (columns >= first) | (columns <= last)]
