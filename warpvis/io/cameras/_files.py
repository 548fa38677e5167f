# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras by name, or from a file of any supported format."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal, overload

import numpy as np

from warpvis.cameras import ImageCamera, camera_from_dict
from warpvis.cameras.lenses import lens_from_opencv
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import as_path, check_flag, describe_exception, truncate
from warpvis.core.file_content import read_json, require_content
from warpvis.core.types import Json
from warpvis.errors import CameraError, FileFormatError
from warpvis.io._files import read_lines
from warpvis.io.cameras._colmap import colmap_camera
from warpvis.io.cameras._json import bop_camera, bop_images_camera, is_bop, is_nerfstudio, nerfstudio_camera
from warpvis.io.cameras._making import NoPinholeError, image_size, make_camera
from warpvis.io.cameras._opencv import is_opencv, opencv_camera, xml_camera
from warpvis.io.cameras._yaml import yaml_camera

_COMMON = {"width", "height", "near", "far"}
_FROM_K = _COMMON | {"K", "pixel_center"}
_FROM_FOV = _COMMON | {"hfov", "vfov", "vertical"}

_TUM_FILE = "calibration.txt"
_TUM_IMAGES = ("depth.txt", "rgb.txt", "associated.txt")
"""Lists of images, from which the image size is read."""


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
    - JSON and XML of OpenCV's calibration, and with `distortion`, its YAML, too.
    - ``intrinsics.yml`` of OpenCV's sample of stereo calibration: ``intrinsics.yml:M1`` or ``:M2``.

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
    if not path.is_file():
        raise FileFormatError(f'{path}: no such file; a camera is "kinect" or a file')
    require_content(path, "a camera file", images=False)
    camera = _read(path, name, check_flag(distortion, "distortion", CameraError))
    if camera is None:
        raise FileFormatError(f"{path}: holds no camera of all images")
    return camera


def _split_name(path: Path) -> tuple[Path, str]:
    """Split ``camchain.yaml:cam1``."""
    stem, _, name = path.name.rpartition(":")
    if stem and not path.exists():
        return path.with_name(stem), name
    return path, ""


def _read(path: Path, name: str, distortion: bool) -> ImageCamera | None:
    kind = path.suffix.lower()
    if kind in (".yaml", ".yml"):
        return yaml_camera(path, name, distortion=distortion)
    if kind == ".xml":
        return xml_camera(path, name, distortion=distortion)
    if name and kind != ".json":
        raise FileFormatError(f"{path}: a camera name after a colon is only for YAML, XML and JSON, got {name!r}")
    if path.name in ("cameras.txt", "cameras.bin"):
        return colmap_camera(path, distortion=distortion)
    if path.name == _TUM_FILE:
        return _tum_camera(path, distortion=distortion)
    fields = read_json(path)
    if not isinstance(fields, dict):
        raise CameraError(f"{path}: a camera file holds one JSON object, got {type(fields).__name__}")
    if is_opencv(fields):
        return opencv_camera(path, fields, name, distortion=distortion)
    if name:
        raise FileFormatError(f"{path}: holds one camera, so it takes no name {name!r}")
    if is_nerfstudio(fields):
        return nerfstudio_camera(path, fields, distortion=distortion)
    if is_bop(fields):
        return bop_camera(path, fields)
    if any(isinstance(entry, dict) and "cam_K" in entry for entry in fields.values()):
        return bop_images_camera(path, fields)
    if "lens" in fields and not distortion:
        raise NoPinholeError(f"{path}: the camera has a lens, so it is not a pinhole")
    try:
        return camera_from_dict(fields) if "lens" in fields else _camera_from_fields(fields)
    except CameraError as error:
        raise CameraError(f"{path}: {describe_exception(error)}") from None


def _camera_from_fields(fields: Mapping[str, Json]) -> Camera:
    known = _FROM_K if "K" in fields else _FROM_FOV
    unknown, missing = sorted(fields.keys() - known), sorted({"width", "height"} - fields.keys())
    if unknown or missing:
        problem = f"unknown {', '.join(unknown)}" if unknown else f"missing {', '.join(missing)}"
        raise CameraError(f"{problem}; a camera file may hold {', '.join(sorted(known))}")
    arguments: dict[str, Any] = dict(fields)  # `Camera` checks the values
    try:
        return Camera.from_K(**arguments) if "K" in fields else Camera.from_fov(**arguments)
    except TypeError:
        raise CameraError("sizes, fields of view and ranges must be numbers") from None


def _tum_camera(path: Path, *, distortion: bool) -> ImageCamera:
    """Read the camera, whose pixel centers are at whole numbers; the image size is that of an image next to it."""
    expected = "fx fy cx cy, or those and k1 k2 p1 p2 k3"
    for number, line in enumerate(read_lines(path, expected), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) not in (4, 9):
            raise FileFormatError(f"{path}:{number}: expected {expected}, got {truncate(line, 60)!r}")
        size, (fx, fy, cx, cy, *lens) = _tum_size(path), values
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        return make_camera(str(path), size, partial(lens_from_opencv, matrix, lens), distortion=distortion)
    raise FileFormatError(f"{path}: expected {expected}, and holds no numbers")


def _tum_size(path: Path) -> tuple[int, int]:
    for name in _TUM_IMAGES:
        if not (path.parent / name).is_file():
            continue
        rows = (line.split() for line in read_lines(path.parent / name, "timestamp filename"))
        images = [row[1] for row in rows if len(row) > 1 and not row[0].startswith("#")]
        size = image_size(path.parent, images[:1])
        if size is not None:
            return size
    raise FileFormatError(
        f"{path}: does not define the image size, and there is no image next to it that {_TUM_IMAGES[0]} lists"
    )
