# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras of YAML files: ROS's camera_calibration and Kalibr's camchain.

Formats: https://wiki.ros.org/camera_calibration_parsers, https://github.com/ethz-asl/kalibr/wiki/yaml-formats
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from warpvis.core.camera import Camera
from warpvis.core.checks import is_number, said_by
from warpvis.core.yaml_files import load_yaml
from warpvis.errors import CameraError, FileFormatError, MessageError
from warpvis.io._files import as_numbers, shorten
from warpvis.io.cameras._pinhole import make_pinhole

_MATRICES = {"camera_matrix": 9, "projection_matrix": 12}


def yaml_camera(path: Path, name: str = "") -> Camera:
    """Read a camera of a YAML file.

    Args:
        path: The file.
        name: Which camera of Kalibr's, ``cam0``; needed where there are several.

    Raises:
        FileFormatError: It does not read, or holds no pinhole, or several.
    """
    data = _load(path)
    if "image_width" in data:
        if name:
            raise FileFormatError(f"{path}: holds one camera, so it takes no name {name!r}")
        return _ros_camera(path, data)
    cameras = {str(key): value for key, value in data.items() if isinstance(value, dict) and "intrinsics" in value}
    if not cameras:
        raise FileFormatError(f"{path}: holds no camera of ROS (image_width, ...) or Kalibr (cam0: intrinsics, ...)")
    known = ", ".join(cameras)
    if name and name not in cameras:
        raise FileFormatError(f"{path}: has no camera {name!r}; it has {known}")
    if not name and len(cameras) > 1:
        raise FileFormatError(f"{path}: has the cameras {known}; choose one as {path}:{next(iter(cameras))}")
    chosen = name or next(iter(cameras))
    return _kalibr_camera(f"{path}: {chosen}", cameras[chosen])


def _load(path: Path) -> Mapping[str, Any]:
    data = load_yaml(path)
    if not isinstance(data, dict):
        raise FileFormatError(f"{path}: a camera file holds one YAML mapping, got {type(data).__name__}")
    return data


def _ros_camera(path: Path, data: Mapping[str, Any]) -> Camera:
    """Make the camera of the rectified images, as of a message CameraInfo."""
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
    try:
        return Camera.from_camera_info(info, rectified=matrices["projection_matrix"] is not None)
    except (CameraError, MessageError) as error:
        raise FileFormatError(f"{path}: {said_by(error)}") from None


def _matrix(path: Path, data: Mapping[str, Any], name: str, count: int) -> list[float] | None:
    entry = data.get(name)
    if not isinstance(entry, dict):
        return None
    return as_numbers(entry.get("data"), (count,), f"{path}: {name}").tolist()


def _kalibr_camera(place: str, entry: Mapping[str, Any]) -> Camera:
    model = entry.get("camera_model", "pinhole")
    if model != "pinhole":
        raise FileFormatError(f"{place}: camera_model {shorten(model)} is no pinhole")
    size = as_numbers(entry.get("resolution"), (2,), f"{place}: resolution").tolist()
    intrinsics = as_numbers(entry.get("intrinsics"), (4,), f"{place}: intrinsics").tolist()
    lens = _floats(entry.get("distortion_coeffs"))
    return make_pinhole(place, size, intrinsics, pixel_center=0.0, distortion=lens)


def _floats(value: object) -> list[float]:
    items = value if isinstance(value, list) else []
    numbers = [item for item in items if isinstance(item, int | float)]
    return [float(item) if is_number(item) else math.inf for item in numbers]  # YAML's have any number of digits
