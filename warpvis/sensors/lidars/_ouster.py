# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ouster's lidars: by their metadata, or the nominal beams of a model."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_path, check_choice, is_whole, truncate
from warpvis.core.json_files import read_json
from warpvis.core.types import Json
from warpvis.errors import CameraError, FileFormatError
from warpvis.sensors._rays import Rays
from warpvis.sensors.lidars._angles import directions_at

MODES = ("512x10", "512x20", "1024x10", "1024x20", "2048x10", "4096x5")
"""Columns of a turn, and turns in a second."""

# From the axis to where beams leave the sensor [mm], by the beginning of the model's name; and of the first generation.
_TO_BEAM = {"OS-0-": 27.67, "OS-1-": 15.806, "OS-2-": 13.762}
_TO_BEAM_BEFORE = 12.163

# How high the lidar's frame stands over the sensor's, where metadata does not say so, and for an OS2 [mm].
_HEIGHT, _HEIGHT_OS2 = 36.18, 78.296

# Half of what beams are spread over, and azimuths of the four columns that they stand in [deg]: of OS-*-128 sensors
# whose metadata comes with ouster-sdk's tests (46b7bcee), made even and symmetric.
_NOMINAL = {
    "OS0-128": (46.0, (9.15, 3.05, -3.05, -9.15)),
    "OS1-128": (21.4, (4.21, 1.41, -1.41, -4.21)),
    "OS2-128": (10.9, (2.07, 0.69, -0.69, -2.07)),
}

# The upper half of the beams that ouster-sdk takes for an OS-1-64 without metadata [deg].
_OS1_64 = (
    16.611, 16.084, 15.557, 15.029, 14.502, 13.975, 13.447, 12.92, 12.393, 11.865, 11.338, 10.811, 10.283, 9.756, 9.229,
    8.701, 8.174, 7.646, 7.119, 6.592, 6.064, 5.537, 5.01, 4.482, 3.955, 3.428, 2.9, 2.373, 1.846, 1.318, 0.791, 0.264,
)  # fmt: skip
_MODELS = ("OS1-64", *_NOMINAL)


@dataclass(frozen=True)
class _Beams:
    """What the metadata of a sensor says of its beams; lengths in metres."""

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
    """Make the rays of a turn of an Ouster OS0, OS1 or OS2, as ``ouster.sdk.core.XYZLut`` has them.

    With n from the axis to where beams leave the sensor, column m of W, te = 2 pi (1 - m / W), a beam of azimuth A (to
    the right) and altitude a looks along (cos(te - A) cos a, sin(te - A) cos a, sin a), and its range is counted from
    n (cos te, sin te, 0) less n times that direction, in the lidar's frame; the sensor's is turned by 180 degrees about
    z, and stands lower. (ouster-sdk, ``xyzlut.cpp`` at 46b7bcee)

    Args:
        sensor: The metadata that comes with a sensor, a JSON file, of firmware 1.12 or later; or ``"OS0-128"``,
            ``"OS1-128"``, ``"OS2-128"`` or ``"OS1-64"``: beams evenly spread, as no sensor's are exactly.
        mode: Columns and turns in a second, ``"1024x10"``: by default those of the file, and ``"1024x10"`` of a model.
        near: Least range that it measures [m].
        far: Greatest [m].

    Returns:
        Rays of shape ``(beams, columns)``, beam 0 the highest, columns as they are measured ("staggered"): the first
        looks backward, and the sensor turns clockwise. Of a sensor with a column window, only its columns. Rings are
        the rows; a column is measured at once.

    Raises:
        CameraError: The model or mode is unknown.
        FileFormatError: The file is no metadata of such a sensor.
    """
    beams = _nominal(sensor) if isinstance(sensor, str) and _looks_like_model(sensor) else _read(sensor)
    mode = check_choice((beams.mode or "1024x10") if mode is None else mode, "mode", MODES, CameraError)
    width, rate = (int(number) for number in mode.split("x"))
    columns = _window(beams, width)
    turned = 2.0 * math.pi * (1.0 - columns / width)
    out, up = beams.beam_to_lidar
    directions = directions_at(turned - beams.azimuth[:, None], beams.altitude[:, None])
    outlet = np.stack([out * np.cos(turned), out * np.sin(turned), np.full(len(columns), up)], axis=-1)
    origins = outlet - math.hypot(out, up) * directions
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


def _looks_like_model(name: str) -> bool:
    return not name.lower().endswith(".json") and re.fullmatch(r"[Oo][Ss]-?\d.*", name) is not None


def _nominal(name: str) -> _Beams:
    """Return the beams of a model.

    Raises:
        CameraError: It is another.
    """
    known = re.sub(r"^OS-?(\d)-?", r"OS\1-", name.upper())
    if known not in _MODELS:
        raise CameraError(f"sensor must be {', '.join(_MODELS)}, or the metadata of another, a JSON file; got {name!r}")
    if known == "OS1-64":
        half = np.array(_OS1_64)
        altitude, azimuth = np.concatenate([half, -half[::-1]]), np.tile((3.164, 1.055, -1.055, -3.164), 16)
    else:
        most, columns = _NOMINAL[known]
        altitude, azimuth = np.linspace(most, -most, 128), np.tile(columns, 32)
    to_beam = _TO_BEAM[f"OS-{known[2]}-"] / 1000
    height = _HEIGHT_OS2 if known.startswith("OS2") else _HEIGHT
    return _Beams(np.radians(altitude), np.radians(azimuth), (to_beam, 0.0), _default_to_sensor(height), None, 0, None)


def _default_to_sensor(height: float = _HEIGHT) -> NDArray[np.float64]:
    """Return the transform from the lidar's frame to the sensor's, of a height [mm], with metres."""
    transform = np.diag([-1.0, -1.0, 1.0, 1.0])
    transform[2, 3] = height / 1000
    return transform


def _read(path: str | os.PathLike[str]) -> _Beams:
    """Read metadata, of firmware before 2.4, whose keys stand at the top, or after.

    Raises:
        FileFormatError: It is none.
    """
    path = as_path(path, "sensor")
    fields = read_json(path)
    if not isinstance(fields, dict):
        raise FileFormatError(f"{path}: is no metadata of an Ouster sensor, which is a JSON object")
    top = fields
    beams = _part(top, "beam_intrinsics")
    altitude, azimuth = (_angles(beams, name, path) for name in ("beam_altitude_angles", "beam_azimuth_angles"))
    if altitude.shape != azimuth.shape:
        raise FileFormatError(f"{path}: has {len(altitude)} altitudes of beams, and {len(azimuth)} azimuths")
    layout = top.get("lidar_data_format", top.get("data_format"))
    layout = layout if isinstance(layout, dict) else {}
    count = layout.get("pixels_per_column", len(altitude))
    missing = int((altitude == 0).sum())  # of first sensors, of 16 and 32 beams, whose metadata has 64
    if count != len(altitude) or missing > 1:
        raise FileFormatError(
            f"{path}: must have angles of all {count!r} beams, got {len(altitude)}, of which {missing} are 0"
        )
    mode = top.get("lidar_mode", _part(top, "config_params").get("lidar_mode"))
    product = top.get("prod_line", _part(top, "sensor_info").get("prod_line"))
    product = product if isinstance(product, str) else ""
    named = re.match(r"OS-\d-(\d+)", product)
    if named and int(named[1]) != len(altitude):
        raise FileFormatError(f"{path}: is of an {truncate(product)}, and has {len(altitude)} beams")
    columns = layout.get("columns_per_frame")
    return _Beams(
        altitude,
        azimuth,
        _to_beam(beams, product, path),
        _to_sensor(_part(top, "lidar_intrinsics"), path),
        mode if isinstance(mode, str) else None,
        columns if is_whole(columns) else 0,
        _read_window(layout.get("column_window"), columns, path),
    )


def _part(fields: dict[str, Json], name: str) -> dict[str, Json]:
    """Return a part of newer metadata; of older, whose parts are not apart, all."""
    part = fields.get(name)
    return part if isinstance(part, dict) else fields


def _angles(fields: dict[str, Json], name: str, path: os.PathLike[str]) -> NDArray[np.float64]:
    """Return angles [rad] that stand in the metadata as a list [deg]."""
    values = fields.get(name)
    if not isinstance(values, list) or not values:
        raise FileFormatError(f"{path}: is no metadata of an Ouster sensor: {name} is not there")
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


def _to_beam(beams: dict[str, Json], product: str, path: os.PathLike[str]) -> tuple[float, float]:
    """Return how far from the axis and how high beams begin [m]."""
    if isinstance(beams.get("beam_to_lidar_transform"), list):
        transform = _floats(beams["beam_to_lidar_transform"], (4, 4), "beam_to_lidar_transform", path)
        return transform[0, 3] / 1000, transform[2, 3] / 1000
    given = beams.get("lidar_origin_to_beam_origin_mm")
    if given is None:
        begins = [name for name in _TO_BEAM if product.startswith(name)]
        given = _TO_BEAM[begins[0]] if begins else _TO_BEAM_BEFORE
    return float(_floats(given, (), "lidar_origin_to_beam_origin_mm", path)) / 1000, 0.0


def _to_sensor(lidar: dict[str, Json], path: os.PathLike[str]) -> NDArray[np.float64]:
    """Return the transform from the lidar's frame to the sensor's, with metres."""
    given = lidar.get("lidar_to_sensor_transform")
    if given is None:
        return _default_to_sensor()
    transform = _floats(given, (4, 4), "lidar_to_sensor_transform", path)
    rotation = transform[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3:
        raise FileFormatError(f"{path}: lidar_to_sensor_transform must be a rotation and a translation")
    transform[:3, 3] /= 1000
    return transform


def _read_window(given: Json, columns: Json, path: os.PathLike[str]) -> tuple[int, int] | None:
    """Return the first and last column that are measured."""
    if given is None:
        return None
    ends = given if isinstance(given, list) and len(given) == 2 else []
    if not is_whole(columns) or columns < 1:
        raise FileFormatError(f"{path}: columns_per_frame must be a whole number from 1 up, got {columns!r}")
    if not ends or not all(is_whole(end) and 0 <= end < columns for end in ends):
        raise FileFormatError(f"{path}: column_window must be two columns of the {columns} per frame, got {given!r}")
    return int(ends[0]), int(ends[1])


def _window(beams: _Beams, width: int) -> NDArray[np.int64]:
    """Return the columns that are measured; a window that ends before it begins goes over the last one.

    Raises:
        CameraError: The window is of another number of columns.
    """
    columns = np.arange(width)
    if beams.window in (None, (0, beams.columns - 1)):
        return columns
    first, last = beams.window
    if beams.columns != width:
        raise CameraError(f"mode must have {beams.columns} columns, since the file measures {first} to {last} of them")
    return columns[(columns >= first) & (columns <= last) if first <= last else (columns >= first) | (columns <= last)]
