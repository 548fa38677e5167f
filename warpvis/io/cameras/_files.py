# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras by name, or from a file of any supported format."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal, overload

import numpy as np

from warpvis.cameras import ImageCamera, camera_from_dict
from warpvis.cameras.lenses import lens_from_opencv
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import as_path, check_flag, describe_exception, truncate
from warpvis.core.file_content import is_file, load_yaml, read_json, require_content
from warpvis.core.types import Json
from warpvis.errors import CameraError, FileFormatError
from warpvis.io._files import read_lines
from warpvis.io.cameras._colmap import colmap_camera
from warpvis.io.cameras._devices import is_ocam, is_realsense, is_rig, ocam_camera, realsense_camera, rig_camera
from warpvis.io.cameras._json import (
    bop_camera,
    bop_images_camera,
    is_bop,
    is_bop_images,
    is_nerfstudio,
    is_open3d,
    nerfstudio_camera,
    open3d_camera,
)
from warpvis.io.cameras._kalibr import is_kalibr, kalibr_camera
from warpvis.io.cameras._making import NoPinholeError, image_size, make_camera, only_camera
from warpvis.io.cameras._models import (
    basalt_camera,
    camodocal_camera,
    is_basalt,
    is_camodocal,
    is_orb_slam,
    orb_slam_camera,
)
from warpvis.io.cameras._opencv import is_opencv, opencv_camera, read_xml

_YAML = (".yaml", ".yml")

_COMMON = {"width", "height", "near", "far"}
_FROM_K = _COMMON | {"K", "pixel_center"}
_FROM_FOV = _COMMON | {"hfov", "vfov", "vertical"}

_TUM_FILE = "calibration.txt"
_TUM_IMAGES = ("depth.txt", "rgb.txt", "associated.txt")
"""Lists of images, from which the image size is read."""


@overload
def load_camera(name_or_path: str, *, distortion: Literal[False]) -> Camera: ...


@overload
def load_camera(name_or_path: str, *, distortion: bool = True) -> ImageCamera: ...


def load_camera(name_or_path: str, *, distortion: bool = True) -> ImageCamera:
    """Return the camera ``kinect``, or read one from a file.

    - warpvis JSON: ``width``, ``height`` [px], optionally ``near``, ``far`` [m], and either ``hfov`` or ``vfov``
      [rad] (optionally ``vertical``), or ``K`` (3x3, optionally ``pixel_center``); see `Camera.from_fov` and
      `Camera.from_K`; or a ``lens``, as written by ``render_batch``.
    - Calibrations of OpenCV, ROS, Kalibr, camodocal (VINS-Fusion), ORB-SLAM, Basalt, OCamCalib, RealSense cameras and
      NVIDIA's rigs; cameras of COLMAP, nerfstudio, instant-ngp, Blender's NeRF sets, Open3D, BOP and TUM. The table in
      ``docs/sensors/calibration_files.md`` lists their files, models and limits.

    If a file has several cameras, a colon and a name select one: ``camchain.yaml:cam1``, ``cameras.txt:7`` (the id),
    ``transforms.json:images/0001.png`` (the frame). Other systems' cameras have no range: `near` is 0 and `far`
    infinite; use `dataclasses.replace` to set them.

    Args:
        name_or_path: ``"kinect"``, or a file.
        distortion: Whether to read the lens: the result is a `warpvis.cameras.LensCamera` if it has distortion, with
            any model of the format. For ROS's calibration, the result is then the camera of the raw images (`K` and
            `D`), otherwise that of the rectified images (`P`). If False, the camera is a pinhole, and a warning is
            issued if the file has distortion, which is not rendered.

    Raises:
        FileFormatError: If the file does not exist, or contains no camera, or several and no name is given.
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
        raise FileFormatError(f"{path}: holds no camera")
    return camera


def _split_name(path: Path) -> tuple[Path, str]:
    """Split ``camchain.yaml:cam1`` after the first part that is a file; names may contain colons and slashes."""
    text = str(path)
    ends = [match.start() for match in re.finditer(":", text)]
    file_end = next((end for end in ends if is_file(Path(text[:end]))), ends[-1] if ends else 0)
    if is_file(path) or not file_end:
        return path, ""
    return Path(text[:file_end]), text[file_end + 1 :]


_Reader = Callable[..., ImageCamera | None]

_FORMATS: tuple[tuple[Callable[[Mapping[str, Any]], bool], _Reader], ...] = (
    (is_camodocal, camodocal_camera),
    (is_orb_slam, orb_slam_camera),
    (is_basalt, basalt_camera),
    (is_rig, rig_camera),
    (is_realsense, realsense_camera),
    (is_opencv, opencv_camera),
    (is_kalibr, kalibr_camera),
    (is_nerfstudio, nerfstudio_camera),
    (is_open3d, open3d_camera),
    (is_bop, bop_camera),
    (is_bop_images, bop_images_camera),
)
"""Formats that are recognized by the keys of their files, in YAML, XML or JSON."""


def _read(path: Path, name: str, distortion: bool) -> ImageCamera | None:
    kind = path.suffix.lower()
    if path.name in ("cameras.txt", "cameras.bin"):
        return colmap_camera(path, name, distortion=distortion)
    if kind == ".txt" and path.name != _TUM_FILE and is_ocam(path):
        return ocam_camera(path, name, distortion=distortion)
    if path.name == _TUM_FILE:
        only_camera(path, name)
        return _tum_camera(path, distortion=distortion)
    fields: Any = load_yaml(path) if kind in _YAML else read_xml(path) if kind == ".xml" else read_json(path)
    if not isinstance(fields, dict):
        unit = "YAML mapping" if kind in _YAML else "JSON object"
        error = FileFormatError if kind in _YAML else CameraError
        raise error(f"{path}: a camera file holds one {unit}, got {type(fields).__name__}")
    fields = {str(key): value for key, value in fields.items()}
    for is_format, read in _FORMATS:
        if is_format(fields):
            return read(path, fields, name, distortion=distortion)
    if kind in _YAML or kind == ".xml":
        raise FileFormatError(
            f"{path}: holds no camera of ROS or OpenCV (image_width, camera_matrix, ...), Kalibr (cam0: intrinsics, "
            "...), camodocal (model_type, ...) or ORB-SLAM (Camera1.fx, ...)"
        )
    only_camera(path, name)
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
