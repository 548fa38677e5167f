# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras by name or from a JSON file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from warpvis.core.camera import Camera
from warpvis.core.checks import as_path
from warpvis.core.types import Json
from warpvis.errors import CameraError, FileFormatError
from warpvis.io._files import read_json

_COMMON = {"width", "height", "near", "far"}
_FROM_K = _COMMON | {"K", "pixel_center"}
_FROM_FOV = _COMMON | {"hfov", "vfov", "vertical"}


def load_camera(name_or_path: str) -> Camera:
    """Return the camera ``kinect``, or read one from a JSON file.

    The file holds ``width``, ``height`` [px], optionally ``near``, ``far`` [m], and either ``hfov`` or ``vfov`` [rad]
    (optionally ``vertical``), or ``K`` (3x3, optionally ``pixel_center``); see `Camera.from_fov` and `Camera.from_K`.

    Raises:
        FileFormatError: There is no such file, or it is not JSON.
        CameraError: The file does not describe a camera.
    """
    if isinstance(name_or_path, str) and name_or_path == "kinect":
        return Camera.kinect()
    path = as_path(name_or_path, "name_or_path")
    if not path.is_file():
        raise FileFormatError(f'{path}: no such file; a camera is "kinect" or a JSON file')
    return _camera_from_fields(read_json(path), path)


def _camera_from_fields(fields: Json, path: Path) -> Camera:
    if not isinstance(fields, dict):
        raise CameraError(f"{path}: a camera file holds one JSON object, got {type(fields).__name__}")
    known = _FROM_K if "K" in fields else _FROM_FOV
    unknown, missing = sorted(fields.keys() - known), sorted({"width", "height"} - fields.keys())
    if unknown or missing:
        problem = f"unknown {', '.join(unknown)}" if unknown else f"missing {', '.join(missing)}"
        raise CameraError(f"{path}: {problem}; a camera file may hold {', '.join(sorted(known))}")
    given: dict[str, Any] = fields  # whose values `Camera` checks
    try:
        return Camera.from_K(**given) if "K" in fields else Camera.from_fov(**given)
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from None
    except TypeError:
        raise CameraError(f"{path}: sizes, fields of view and ranges must be numbers") from None
