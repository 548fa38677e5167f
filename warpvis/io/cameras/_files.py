# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras by name, or from a file of any supported format."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, overload

from warpvis.cameras import ImageCamera, camera_from_dict
from warpvis.cameras.pinhole import Camera, require_camera
from warpvis.core.checks import as_path, check_flag, describe_exception
from warpvis.core.file_content import read_json, require_content
from warpvis.core.types import Json
from warpvis.errors import CameraError, FileFormatError
from warpvis.io.cameras._colmap import colmap_camera, colmap_lens_camera
from warpvis.io.cameras._json import (
    bop_camera,
    bop_images_camera,
    is_bop,
    is_nerfstudio,
    nerfstudio_camera,
    nerfstudio_lens_camera,
)
from warpvis.io.cameras._pinhole import NoPinholeError
from warpvis.io.cameras._tum import TUM_FILE, tum_camera
from warpvis.io.cameras._yaml import xml_lens_camera, yaml_camera, yaml_lens_camera

_COMMON = {"width", "height", "near", "far"}
_FROM_K = _COMMON | {"K", "pixel_center"}
_FROM_FOV = _COMMON | {"hfov", "vfov", "vertical"}


@overload
def load_camera(name_or_path: str, *, distortion: Literal[False] = False) -> Camera: ...


@overload
def load_camera(name_or_path: str, *, distortion: bool) -> ImageCamera: ...


def load_camera(name_or_path: str, *, distortion: bool = False) -> ImageCamera:
    """Return the camera ``kinect``, or read one from a file.

    - warpvis JSON: ``width``, ``height`` [px], optionally ``near``, ``far`` [m], and either ``hfov`` or ``vfov``
      [rad] (optionally ``vertical``), or ``K`` (3x3, optionally ``pixel_center``); see `Camera.from_fov` and
      `Camera.from_K`. With `distortion` it may have a ``lens``, as written by ``render_batch``.
    - ``transforms.json`` of nerfstudio and instant-ngp; BOP's ``camera.json`` and ``scene_camera.json``.
    - COLMAP's ``cameras.txt`` and ``cameras.bin`` with a single camera.
    - ``calibration.txt`` next to the images of TUM's layout: ``fx fy cx cy``, and ``k1 k2 p1 p2 k3`` of a lens.
    - YAML of ROS's camera_calibration, and Kalibr's camchain (``camchain.yaml:cam1``).
    - With `distortion`: YAML and XML of OpenCV's calibration, too.

    Other systems' cameras have no range: `near` is 0 and `far` infinite; use `dataclasses.replace` to set them.

    Args:
        name_or_path: ``"kinect"``, or a file.
        distortion: Whether to read the lens: the result is a `warpvis.cameras.LensCamera` if it has distortion, with
            any model of the format. For ROS's calibration, the result is then the camera of the raw images (`K` and
            `D`), otherwise that of the rectified images (`P`). By default the camera is a pinhole, and a warning is
            issued if the file has distortion, which is not rendered.

    Raises:
        FileFormatError: If the file does not exist, or contains no camera, or several.
        CameraError: If a warpvis JSON file does not describe a camera.
    """
    if isinstance(name_or_path, str) and name_or_path == "kinect":
        return Camera.kinect()
    path, name = _split_name(as_path(name_or_path, "name_or_path"))
    with_lens = check_flag(distortion, "distortion", CameraError)
    if not path.is_file():
        raise FileFormatError(f'{path}: no such file; a camera is "kinect" or a file')
    require_content(path, "a camera file", images=False)
    camera = _read_lens(path, name) if with_lens else _read(path, name)
    if camera is None:
        raise FileFormatError(f"{path}: holds no camera of all images")
    return camera


def _split_name(path: Path) -> tuple[Path, str]:
    """Split ``camchain.yaml:cam1``."""
    stem, _, name = path.name.rpartition(":")
    if stem and not path.exists():
        return path.with_name(stem), name
    return path, ""


def _read(path: Path, name: str) -> Camera | None:
    kind = path.suffix.lower()
    if kind in (".yaml", ".yml"):
        return yaml_camera(path, name)
    if name:
        raise FileFormatError(f"{path}: a camera name after a colon is only for YAML files, got {name!r}")
    if path.name in ("cameras.txt", "cameras.bin"):
        return colmap_camera(path)
    if path.name == TUM_FILE:
        return require_camera(tum_camera(path, distortion=False))
    fields = read_json(path)
    if isinstance(fields, dict) and is_nerfstudio(fields):
        return nerfstudio_camera(path, fields)
    if isinstance(fields, dict) and is_bop(fields):
        return bop_camera(path, fields)
    if isinstance(fields, dict) and any(isinstance(entry, dict) and "cam_K" in entry for entry in fields.values()):
        return bop_images_camera(path, fields)
    return _camera_from_fields(fields, path)


def _read_lens(path: Path, name: str) -> ImageCamera | None:
    """Read a camera that may have a lens; BOP's and warpvis's files without ``lens`` have none."""
    kind = path.suffix.lower()
    if kind in (".yaml", ".yml"):
        return yaml_lens_camera(path, name)
    if not name and kind == ".xml":
        return xml_lens_camera(path)
    if not name and path.name in ("cameras.txt", "cameras.bin"):
        return colmap_lens_camera(path)
    if not name and path.name == TUM_FILE:
        return tum_camera(path, distortion=True)
    if not name and kind == ".json":
        fields = read_json(path)
        if isinstance(fields, dict) and is_nerfstudio(fields):
            return nerfstudio_lens_camera(path, fields)
        if isinstance(fields, dict) and "lens" in fields:
            return _own_lens_camera(path, fields)
    return _read(path, name)


def _own_lens_camera(path: Path, fields: Mapping[str, Json]) -> ImageCamera:
    try:
        return camera_from_dict(fields)
    except CameraError as error:
        raise CameraError(f"{path}: {describe_exception(error)}") from None


def _camera_from_fields(fields: Json, path: Path) -> Camera:
    if not isinstance(fields, dict):
        raise CameraError(f"{path}: a camera file holds one JSON object, got {type(fields).__name__}")
    known = _FROM_K if "K" in fields else _FROM_FOV
    if "lens" in fields:
        raise NoPinholeError(f"{path}: the camera has a lens, so it is not a pinhole")
    unknown, missing = sorted(fields.keys() - known), sorted({"width", "height"} - fields.keys())
    if unknown or missing:
        problem = f"unknown {', '.join(unknown)}" if unknown else f"missing {', '.join(missing)}"
        raise CameraError(f"{path}: {problem}; a camera file may hold {', '.join(sorted(known))}")
    arguments: dict[str, Any] = fields  # `Camera` checks the values
    try:
        return Camera.from_K(**arguments) if "K" in fields else Camera.from_fov(**arguments)
    except CameraError as error:
        raise CameraError(f"{path}: {describe_exception(error)}") from None
    except TypeError:
        raise CameraError(f"{path}: sizes, fields of view and ranges must be numbers") from None
