# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras from the calibration files of OpenCV's ``cv2.FileStorage`` and of ROS: YAML, XML and JSON.

Formats: https://github.com/opencv/opencv/blob/4.x/samples/cpp/calibration.cpp,
https://github.com/opencv/opencv/blob/4.x/samples/cpp/stereo_calib.cpp (``intrinsics.yml``),
https://github.com/opencv/opencv_contrib/blob/4.x/modules/ccalib/samples/omni_calibration.cpp (``xi``),
https://docs.opencv.org/4.x/da/d56/classcv_1_1FileStorage.html, https://wiki.ros.org/camera_calibration_parsers
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from warpvis.cameras import ImageCamera
from warpvis.cameras.lenses import Lens, Mei, OpenCVPinhole, lens_from_opencv
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import describe_exception
from warpvis.errors import CameraError, FileFormatError
from warpvis.io._files import as_numbers
from warpvis.io.cameras._making import checked, choose, image_size, make_camera, only_camera

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

_BASE64 = "$base64$"
_BASE64_HEADER = 24
"""Bytes before the numbers of a matrix in base64; they contain the type once more."""


def read_xml(path: Path) -> dict[str, Any]:
    """Read the numbers, texts and matrices of an OpenCV XML file."""
    from xml.etree import ElementTree

    try:
        root = ElementTree.parse(path).getroot()
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the last two for unknown encodings
        raise FileFormatError(f"{path}: is not XML: {describe_exception(error)}") from None
    return {item.tag: _xml_value(item) for item in root}


def _xml_value(item: Any) -> Any:
    """Convert an element: a matrix, a map (such as those of camodocal), or a number or text."""
    data = item.find("data")
    if data is not None:
        words = (data.text or "").split()
        is_binary = data.get("type_id") == "binary"
        numbers = _BASE64 + "".join(words) if is_binary else [_number(word) for word in words]
        return {"dt": (item.findtext("dt") or "").strip(), "data": numbers}
    if len(item):
        return {child.tag: _xml_value(child) for child in item}
    return _number((item.text or "").strip().strip('"'))


def is_opencv(data: Mapping[str, Any]) -> bool:
    """Return whether a file is OpenCV's or ROS's calibration: it has one of their keys, or any matrix of OpenCV."""
    types = (value.get("type_id") for value in data.values() if isinstance(value, dict))
    names = (*_STEREO, *(name for names in _NAMES.values() for name in names))
    return any(name in data for name in names) or "opencv-matrix" in types


def opencv_camera(path: Path, data: Mapping[str, Any], name: str, *, distortion: bool) -> ImageCamera:
    """Create the camera of the raw images; without `distortion`, that of the rectified ones if there is a `P`."""
    if any(key in data for key in _STEREO) and not any(key in data for key in _NAMES["matrix"]):
        data = _stereo_camera(path, data, name)
    else:
        only_camera(path, name)
    if "projection_matrix" in data and not distortion:
        return _rectified_camera(path, data)
    width, height, matrix = (_required(path, data, key) for key in ("width", "height", "matrix"))
    lens, model = _entry(data, "lens"), data.get("distortion_model")
    k = _matrix(path, matrix, "camera matrix", 9).reshape(3, 3)
    d = _values(path, lens) if isinstance(lens, dict) else lens
    if model is not None:
        info = SimpleNamespace(width=width, height=height, k=k, d=d or [], distortion_model=str(model))
        camera = checked(str(path), partial(Camera.from_raw_camera_info, info))
    elif "xi" in data:
        xi = data["xi"] if not isinstance(data["xi"], dict) else _matrix(path, data["xi"], "xi", 1).item()
        xi = float(as_numbers(xi, (), f"{path}: xi"))
        camera = checked(str(path), lambda: Camera.from_lens(_omnidir(k, d, xi), width, height))
    else:
        kind: Literal["pinhole", "fisheye"] = "fisheye" if data.get("fisheye_model") in (1, True) else "pinhole"
        camera = checked(str(path), lambda: Camera.from_opencv(k, d, width, height, model=kind))
    if distortion:
        return camera
    lens = camera.lens
    problem = "" if isinstance(lens, OpenCVPinhole) else f"the lens {type(lens).__name__}"
    return make_camera(str(path), (camera.width, camera.height), lambda: lens, distortion=False, model=problem)


def _omnidir(k: Any, d: Any, xi: float) -> Lens:
    """Create the lens of ``cv2.omnidir``, Mei's model."""
    pinhole = lens_from_opencv(k, d)
    if not isinstance(pinhole, OpenCVPinhole) or len(pinhole.coefficients) != 4:
        raise CameraError("D of OpenCV's omnidir must be 4 numbers")
    return Mei(pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy, xi, pinhole.coefficients)


def _entry(data: Mapping[str, Any], key: str) -> Any:
    return next((data[name] for name in _NAMES[key] if name in data), None)


def _required(path: Path, data: Mapping[str, Any], key: str) -> Any:
    found = _entry(data, key)
    if found is None:
        unit = "" if key == "matrix" else " [px]"
        raise FileFormatError(f"{path}: holds no camera of ROS or OpenCV: {_NAMES[key][0]}{unit} is missing")
    return found


def _matrix(path: Path, entry: Any, name: str, count: int) -> Any:
    values = _values(path, entry) if isinstance(entry, dict) else entry
    return as_numbers(values, (count,), f"{path}: {name}")


def _values(path: Path, entry: Mapping[str, Any]) -> Any:
    """Return the elements of a matrix, which may be in base64 (``cv2.FileStorage_WRITE_BASE64``)."""
    data = entry.get("data", [])
    if isinstance(data, str) and data.startswith(_BASE64):
        try:
            data = base64.b64decode(data.removeprefix(_BASE64), validate=True)
        except (binascii.Error, ValueError):
            raise FileFormatError(f"{path}: has a matrix that is not valid base64") from None
    if not isinstance(data, bytes):
        return data
    kind, content = entry.get("dt"), data[_BASE64_HEADER:]
    if kind not in ("f", "d") or len(content) % np.dtype(kind).itemsize:
        raise FileFormatError(
            f'{path}: a matrix in base64 must have dt "f" or "d" and whole numbers of it, got {kind!r}'
        )
    return np.frombuffer(content, np.dtype(kind).newbyteorder("<")).tolist()


def _rectified_camera(path: Path, data: Mapping[str, Any]) -> Camera:
    """Create the camera of ROS's rectified images, as from a CameraInfo message."""
    p = _matrix(path, data["projection_matrix"], "projection_matrix", 12)
    info = SimpleNamespace(
        width=_required(path, data, "width"),
        height=_required(path, data, "height"),
        k=_matrix(path, _required(path, data, "matrix"), "camera matrix", 9).tolist(),
        p=p.tolist(),
        r=[1.0, 0, 0, 0, 1, 0, 0, 0, 1],
        d=[],
        distortion_model=str(data.get("distortion_model", "plumb_bob")),
        binning_x=0,
        binning_y=0,
        roi=SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0, do_rectify=False),
    )
    return checked(str(path), partial(Camera.from_camera_info, info, rectified=True))


def _stereo_camera(path: Path, data: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the entries of one camera of a stereo pair, ``M1`` or ``M2``, with the names of a single camera."""
    chosen = choose(path, [matrix for matrix in _STEREO if matrix in data], name)
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
