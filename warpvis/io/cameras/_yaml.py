# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras from YAML files: ROS's camera_calibration, Kalibr's camchain and OpenCV's calibration.

Formats: https://wiki.ros.org/camera_calibration_parsers, https://github.com/ethz-asl/kalibr/wiki/yaml-formats
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from warpvis.cameras import ImageCamera
from warpvis.cameras.lenses import lens_from_kalibr
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import is_number
from warpvis.core.file_content import load_yaml
from warpvis.errors import FileFormatError
from warpvis.io._files import as_numbers, shorten
from warpvis.io.cameras._making import checked, make_camera
from warpvis.io.cameras._opencv import has_opencv_names, is_stereo, opencv_camera

_MATRICES = {"camera_matrix": 9, "projection_matrix": 12}


def yaml_camera(path: Path, name: str = "", *, distortion: bool) -> ImageCamera:
    """Read a camera of a YAML file: for ROS, that of the raw images with `distortion`, else of the rectified ones.

    Args:
        path: The file.
        name: Name of a Kalibr camera, ``cam0``, or of OpenCV's stereo pair, ``M1``; required if there are several.
        distortion: See `make_camera`; OpenCV's files of one camera require it.
    """
    data = _load(path)
    if is_stereo(data) or (distortion and has_opencv_names(data)):
        return opencv_camera(path, data, name, distortion=distortion)
    if not distortion and "image_width" in data:
        return _ros_camera(path, _only(path, data, name))
    place, entry = _choose(path, data, name)
    model = entry.get("camera_model", "pinhole")
    problem = "" if model == "pinhole" else f"camera_model {shorten(model)}"
    size = as_numbers(entry.get("resolution"), (2,), f"{place}: resolution").tolist()
    return make_camera(place, size, partial(lens_from_kalibr, entry), distortion=distortion, model=problem)


def _only(path: Path, data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    if name:
        raise FileFormatError(f"{path}: holds one camera, so it takes no name {name!r}")
    return data


def _choose(path: Path, data: Mapping[str, Any], name: str) -> tuple[str, Mapping[str, Any]]:
    """Choose one of Kalibr's cameras, and return its location for messages."""
    cameras = {str(key): value for key, value in data.items() if isinstance(value, dict) and "intrinsics" in value}
    if not cameras:
        raise FileFormatError(f"{path}: holds no camera of ROS (image_width, ...) or Kalibr (cam0: intrinsics, ...)")
    known = ", ".join(cameras)
    if name and name not in cameras:
        raise FileFormatError(f"{path}: has no camera {name!r}; it has {known}")
    if not name and len(cameras) > 1:
        raise FileFormatError(f"{path}: has the cameras {known}; choose one as {path}:{next(iter(cameras))}")
    chosen = name or next(iter(cameras))
    return f"{path}: {chosen}", cameras[chosen]


def _load(path: Path) -> Mapping[str, Any]:
    data = load_yaml(path)
    if not isinstance(data, dict):
        raise FileFormatError(f"{path}: a camera file holds one YAML mapping, got {type(data).__name__}")
    return data


def _ros_camera(path: Path, data: Mapping[str, Any]) -> Camera:
    """Create the camera of the rectified images, as from a CameraInfo message; of the raw ones without `P`."""
    matrices = {name: _matrix(path, data, name, count) for name, count in _MATRICES.items()}
    lens = data.get("distortion_coefficients")
    info = SimpleNamespace(
        width=data["image_width"],
        height=data.get("image_height"),
        k=matrices["camera_matrix"] or [0.0] * 9,
        p=matrices["projection_matrix"] or [0.0] * 12,
        r=[1.0, 0, 0, 0, 1, 0, 0, 0, 1],
        d=_floats(lens.get("data")) if isinstance(lens, dict) else [],
        distortion_model=str(data.get("distortion_model", "plumb_bob")),
        binning_x=0,
        binning_y=0,
        roi=SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0, do_rectify=False),
    )
    rectified = matrices["projection_matrix"] is not None
    return checked(str(path), partial(Camera.from_camera_info, info, rectified=rectified))


def _matrix(path: Path, data: Mapping[str, Any], name: str, count: int) -> list[float] | None:
    entry = data.get(name)
    if not isinstance(entry, dict):
        return None
    return as_numbers(entry.get("data"), (count,), f"{path}: {name}").tolist()


def _floats(value: object) -> list[float]:
    items = value if isinstance(value, list) else []
    numbers = [item for item in items if isinstance(item, int | float)]
    return [float(item) if is_number(item) else math.inf for item in numbers]  # YAML integers have any number of digits
