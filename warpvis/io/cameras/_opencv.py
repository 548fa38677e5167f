# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras from the calibration files of OpenCV's ``cv2.FileStorage``: YAML, XML and JSON.

Formats: https://github.com/opencv/opencv/blob/4.x/samples/cpp/calibration.cpp,
https://github.com/opencv/opencv/blob/4.x/samples/cpp/stereo_calib.cpp (``intrinsics.yml``),
https://docs.opencv.org/4.x/da/d56/classcv_1_1FileStorage.html
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

from warpvis.cameras import ImageCamera
from warpvis.cameras.lenses import OpenCVPinhole
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import describe_exception
from warpvis.errors import FileFormatError
from warpvis.io._files import as_numbers
from warpvis.io.cameras._making import checked, image_size, make_camera

_NAMES = {
    "matrix": ("camera_matrix", "Camera_Matrix", "cameraMatrix"),
    "lens": ("distortion_coefficients", "Distortion_Coefficients", "distCoeffs"),
    "width": ("image_width", "image_Width", "imageWidth"),
    "height": ("image_height", "image_Height", "imageHeight"),
}
"""Keys in files of OpenCV's samples, old and new, and of ROS."""

_STEREO = {"M1": "D1", "M2": "D2"}
"""Camera matrices and coefficients in files of OpenCV's sample of stereo calibration, which lack the image size."""

_STEREO_IMAGES = ("left*", "right*")
"""Names of the images of that sample."""


def xml_camera(path: Path, name: str = "", *, distortion: bool) -> ImageCamera:
    """Read the camera of an OpenCV XML file; see `opencv_camera`."""
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
    return opencv_camera(path, data, name, distortion=distortion)


def has_opencv_names(data: Mapping[str, Any]) -> bool:
    """Return whether a file has a key of OpenCV's or ROS's calibration."""
    return any(name in data for names in _NAMES.values() for name in names)


def is_opencv(fields: Mapping[str, Any]) -> bool:
    """Return whether a JSON object is OpenCV's calibration: it has a camera matrix or any matrix of OpenCV."""
    types = (value.get("type_id") for value in fields.values() if isinstance(value, dict))
    return any(name in fields for name in (*_STEREO, *_NAMES["matrix"])) or "opencv-matrix" in types


def is_stereo(data: Mapping[str, Any]) -> bool:
    """Return whether a file has the cameras of OpenCV's sample of stereo calibration."""
    return any(name in data for name in _STEREO) and not any(name in data for name in _NAMES["matrix"])


def opencv_camera(path: Path, data: Mapping[str, Any], name: str = "", *, distortion: bool) -> ImageCamera:
    """Create the camera of the raw images from OpenCV's or ROS's calibration; see `make_camera` for `distortion`."""
    if is_stereo(data):
        data = _stereo_camera(path, data, name)
    elif name:
        raise FileFormatError(f"{path}: holds one camera, so it takes no name {name!r}")
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
        camera = checked(str(path), partial(Camera.from_raw_camera_info, info))
    else:
        kind: Literal["pinhole", "fisheye"] = "fisheye" if data.get("fisheye_model") in (1, True) else "pinhole"
        camera = checked(str(path), lambda: Camera.from_opencv(k, d, *size, model=kind))  # type: ignore[arg-type]  # it checks
    if distortion:
        return camera
    lens = camera.lens
    problem = "" if isinstance(lens, OpenCVPinhole) else f"the lens {type(lens).__name__}"
    return make_camera(str(path), (camera.width, camera.height), lambda: lens, distortion=False, model=problem)


def _stereo_camera(path: Path, data: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the entries of one camera of a stereo pair, ``M1`` or ``M2``, with the names of a single camera."""
    cameras = [matrix for matrix in _STEREO if matrix in data]
    known = ", ".join(cameras)
    if name and name not in cameras:
        raise FileFormatError(f"{path}: has no camera {name!r}; it has {known}")
    if not name and len(cameras) > 1:
        raise FileFormatError(f"{path}: has the cameras {known}; choose one as {path}:{cameras[0]}")
    chosen = name or cameras[0]
    if _STEREO[chosen] not in data:
        raise FileFormatError(f"{path}: has {chosen} without its distortion coefficients, {_STEREO[chosen]}")
    entry = {**data, "camera_matrix": data[chosen], "distortion_coefficients": data[_STEREO[chosen]]}
    if not any(key in data for side in ("width", "height") for key in _NAMES[side]):
        entry["image_width"], entry["image_height"] = _stereo_size(path)
    return entry


def _stereo_size(path: Path) -> tuple[int, int]:
    """Return width and height [px] of the sample's images next to the file, which must agree."""
    images = [image.name for pattern in _STEREO_IMAGES for image in sorted(path.parent.glob(pattern))]
    sizes = {size for image in images if (size := image_size(path.parent, [image])) is not None}
    if len(sizes) == 1:
        return sizes.pop()
    problem = f"several: {', '.join(f'{w}x{h}' for w, h in sorted(sizes)[:3])} pixels" if sizes else "none"
    raise FileFormatError(
        f"{path}: must have image_width and image_height [px], or images {' and '.join(_STEREO_IMAGES)} of one size "
        f"next to it, got {problem}"
    )


def _number(word: str) -> float | str:
    try:
        return float(word)
    except ValueError:
        return word
