# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras from the calibration files of OpenCV's ``cv2.FileStorage``: YAML, XML and JSON.

Formats: https://github.com/opencv/opencv/blob/4.x/samples/cpp/calibration.cpp,
https://docs.opencv.org/4.x/da/d56/classcv_1_1FileStorage.html
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

from warpvis.cameras import ImageCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import describe_exception
from warpvis.errors import FileFormatError
from warpvis.io._files import as_numbers
from warpvis.io.cameras._making import checked, make_camera

_NAMES = {
    "matrix": ("camera_matrix", "Camera_Matrix", "cameraMatrix"),
    "lens": ("distortion_coefficients", "Distortion_Coefficients", "distCoeffs"),
    "width": ("image_width", "image_Width", "imageWidth"),
    "height": ("image_height", "image_Height", "imageHeight"),
}
"""Keys in files of OpenCV's samples, old and new, and of ROS."""


def xml_camera(path: Path) -> ImageCamera:
    """Read the camera of an OpenCV XML file, with its lens."""
    from xml.etree import ElementTree

    try:
        root = ElementTree.parse(path).getroot()
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the last two for unknown encodings
        raise FileFormatError(f"{path}: is not XML: {describe_exception(error)}") from None
    data: dict[str, Any] = {}
    for item in root:
        numbers = item.findtext("data")
        text = (item.text or "").strip()
        data[item.tag] = text if numbers is None else {"data": [_number(word) for word in numbers.split()]}
        if numbers is None:
            data[item.tag] = _number(text)
    return opencv_camera(path, data)


def has_opencv_names(data: Mapping[str, Any]) -> bool:
    """Return whether a file has a key of OpenCV's or ROS's calibration."""
    return any(name in data for names in _NAMES.values() for name in names)


def is_opencv(fields: Mapping[str, Any]) -> bool:
    """Return whether a JSON object is OpenCV's calibration: it has a camera matrix or any matrix of OpenCV."""
    types = (value.get("type_id") for value in fields.values() if isinstance(value, dict))
    return any(name in fields for name in _NAMES["matrix"]) or "opencv-matrix" in types


def opencv_camera(path: Path, data: Mapping[str, Any], *, distortion: bool = True) -> ImageCamera:
    """Create the camera of the raw images from OpenCV's or ROS's calibration; see `make_camera` for `distortion`."""
    entries = {}
    for key, names in _NAMES.items():
        found = [data[name] for name in names if name in data]
        if not found and key != "lens":
            raise FileFormatError(f"{path}: holds no camera of ROS or OpenCV: {names[0]} is missing")
        entries[key] = found[0] if found else None
    matrix, lens = entries["matrix"], entries["lens"]
    numbers = as_numbers(matrix.get("data") if isinstance(matrix, dict) else matrix, (9,), f"{path}: camera matrix")
    d = lens.get("data", []) if isinstance(lens, dict) else lens
    size, model = (entries["width"], entries["height"]), data.get("distortion_model")
    k = numbers.reshape(3, 3)
    if model is not None:
        info = SimpleNamespace(width=size[0], height=size[1], k=k, d=d or [], distortion_model=str(model))
        return checked(str(path), partial(Camera.from_raw_camera_info, info))
    kind: Literal["pinhole", "fisheye"] = "fisheye" if data.get("fisheye_model") in (1, True) else "pinhole"
    camera = checked(str(path), lambda: Camera.from_opencv(k, d, *size, model=kind))  # type: ignore[arg-type]  # it checks
    if distortion:
        return camera
    lens, problem = camera.lens, "" if kind == "pinhole" else "the lens with fisheye_model 1"
    return make_camera(str(path), (camera.width, camera.height), lambda: lens, distortion=False, model=problem)


def _number(word: str) -> float | str:
    try:
        return float(word)
    except ValueError:
        return word
