# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras from the calibration of RealSense cameras, NVIDIA's rigs and OCamCalib.

Formats: the calibration table that the RealSense Viewer saves and the fields of ``rs2_intrinsics``
(https://github.com/IntelRealSense/librealsense/blob/master/include/librealsense2/rsutil.h), the rig files of DriveWorks
(https://docs.nvidia.com/drive/driveworks-3.5/rigconfiguration_usecase0.html), and ``calib_results.txt``
(https://sites.google.com/site/scarabotix/ocamcalib-toolbox).
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

from warpvis.cameras import ImageCamera
from warpvis.cameras.lenses import FOV, FTheta, KannalaBrandt, Lens, OpenCVPinhole, Scaramuzza
from warpvis.errors import CameraError, FileFormatError
from warpvis.io._files import as_numbers, read_lines, shorten
from warpvis.io.cameras._making import checked, choose, make_camera, make_pinhole, only_camera

_RS_INTRINSICS = ("fx", "fy", "ppx", "ppy", "width", "height")
_RS_CURVED = {"none", "brown_conrady", "kannala_brandt4", "ftheta"}
"""Distortion models of the SDK that are supported with coefficients that are not 0."""

_POLYNOMIALS: dict[str, Literal["radius_to_angle", "angle_to_radius"]] = {
    "pixeldistance-to-angle": "radius_to_angle",
    "angle-to-pixeldistance": "angle_to_radius",
}
_LINEAR = {"linear-c": 1.0, "linear-d": 0.0, "linear-e": 0.0}

_OCAM = "#polynomial coefficients for the DIRECT mapping function"
_OCAM_EXPECTED = (
    "expected five lines of numbers, as OCamCalib writes them: the count and the coefficients of the direct and of the "
    'inverse polynomial, the center (row and column), "c d e", and the height and width'
)


def is_realsense(data: Mapping[str, Any]) -> bool:
    """Return whether a file is a calibration table of a RealSense, or has the fields of its SDK's intrinsics."""
    return any(str(key).startswith("rectified.") for key in data) or {"ppx", "ppy"} <= data.keys()


def realsense_camera(path: Path, data: Mapping[str, Any], name: str, *, distortion: bool) -> ImageCamera:
    """Read the intrinsics of one stream, or those of the rectified images of a size such as ``1280x720``."""
    if not any(str(key).startswith("rectified.") for key in data):
        only_camera(path, name)
        numbers = [_number(path, data, key) for key in _RS_INTRINSICS]
        coefficients = as_numbers(data.get("coeffs", [0.0] * 5), (5,), f"{path}: coeffs").tolist()
        lens = checked(str(path), partial(_realsense_lens, str(data.get("model", "none")), coefficients, numbers))
        problem = "" if isinstance(lens, OpenCVPinhole) else f"model {shorten(data['model'])}"
        return make_camera(str(path), numbers[4:], lambda: lens, distortion=distortion, model=problem)
    modes: dict[str, list[float]] = {}
    for index in dict.fromkeys(
        key.split(".")[1] for key in data if key.startswith("rectified.") and key.count(".") > 1
    ):
        numbers = [_number(path, data, f"rectified.{index}.{key}") for key in _RS_INTRINSICS]
        if all(numbers[:2] + numbers[4:]):  # unused modes are zeros
            modes[f"{numbers[4]:g}x{numbers[5]:g}"] = numbers
    if not modes:
        raise FileFormatError(f"{path}: holds no rectified camera with a size and focal lengths [px]")
    chosen = choose(path, list(modes), name)
    return make_pinhole(f"{path}: {chosen}", modes[chosen][4:], modes[chosen][:4])


def _realsense_lens(model: str, coefficients: Sequence[float], numbers: Sequence[float]) -> Lens:
    """Create the lens of ``rs2_intrinsics``, whose pixel centers are at integers."""
    fx, fy, cx, cy = numbers[0], numbers[1], numbers[2] + 0.5, numbers[3] + 0.5
    model = model.rpartition(".")[2].lower().replace(" ", "_").replace("-", "")
    if not any(coefficients) and model != "kannala_brandt4":
        return OpenCVPinhole(fx, fy, cx, cy)
    if model not in _RS_CURVED:
        raise CameraError(
            f"model must be one of {', '.join(sorted(_RS_CURVED))} with coeffs that are not 0, got {shorten(model)}"
        )
    if model == "kannala_brandt4":
        return KannalaBrandt(fx, fy, cx, cy, tuple(coefficients[:4]))
    if model == "ftheta":
        return FOV(fx, fy, cx, cy, coefficients[0])
    return OpenCVPinhole(fx, fy, cx, cy, tuple(coefficients))


def is_rig(data: Mapping[str, Any]) -> bool:
    """Return whether a file is a rig of NVIDIA's DriveWorks."""
    return isinstance(data.get("rig"), dict)


def rig_camera(path: Path, data: Mapping[str, Any], name: str, *, distortion: bool) -> ImageCamera:
    """Read an F-theta camera of a rig by the name of its sensor."""
    sensors = data["rig"].get("sensors")
    listed = [sensor for sensor in sensors if isinstance(sensor, dict)] if isinstance(sensors, list) else []
    cameras = {str(sensor.get("name")): sensor["properties"] for sensor in listed if _has_model(sensor)}
    if not cameras:
        raise FileFormatError(f"{path}: the rig has no camera: no sensor has properties with a Model")
    chosen = choose(path, list(cameras), name)
    place, fields = f"{path}: {chosen}", cameras[chosen]
    if fields["Model"] != "ftheta":
        raise FileFormatError(f"{place}: Model must be ftheta, got {shorten(fields['Model'])}")
    cx, cy, width, height = (_number(place, fields, key) for key in ("cx", "cy", "width", "height"))
    for key, expected in _LINEAR.items():
        if _number(place, {**_LINEAR, **fields}, key, "") not in (expected, 0.0):  # three zeros are the identity
            raise FileFormatError(f"{place}: {key} must be {expected:g}, got {shorten(fields[key])}")
    kind = "pixeldistance-to-angle" if "bw-poly" in fields else fields.get("polynomial-type")
    if not isinstance(kind, str) or kind not in _POLYNOMIALS:
        raise FileFormatError(f"{place}: polynomial-type must be one of {', '.join(_POLYNOMIALS)}, got {shorten(kind)}")
    constant, *coefficients = _polynomial(place, fields.get("bw-poly", fields.get("polynomial")))
    if constant:
        raise FileFormatError(f"{place}: the first coefficient, the constant term, must be 0, got {constant:g}")
    while len(coefficients) > 1 and not coefficients[-1]:
        coefficients.pop()
    make_lens = partial(FTheta, cx, cy, tuple(coefficients), _POLYNOMIALS[kind])
    return make_camera(place, (width, height), make_lens, distortion=distortion, model="an F-theta camera")


def _has_model(sensor: Mapping[str, Any]) -> bool:
    properties = sensor.get("properties")
    return isinstance(properties, dict) and "Model" in properties


def _polynomial(place: str, value: Any) -> list[float]:
    words = value.split() if isinstance(value, str) else value
    try:
        numbers = [float(word) for word in words]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) < 2:
        raise FileFormatError(
            f"{place}: polynomial must be at least 2 numbers, the first of them 0, got {shorten(value)}"
        )
    return as_numbers(numbers, (len(numbers),), f"{place}: polynomial").tolist()


def is_ocam(path: Path) -> bool:
    """Return whether a text file is a ``calib_results.txt`` of OCamCalib."""
    return any(_OCAM in line for line in read_lines(path, "of OCamCalib")[:3])


def ocam_camera(path: Path, name: str, *, distortion: bool) -> ImageCamera:
    """Read the camera of OCamCalib, whose axes are down and to the right, and whose direct polynomial is negative."""
    only_camera(path, name)
    lines = [line for line in read_lines(path, "of OCamCalib") if line.strip() and not line.startswith("#")]
    try:
        rows = [[float(word) for word in line.split()] for line in lines]
        (count, *direct), _, (row, column), (c, d, e), size = rows
        height, width = size
    except ValueError:
        raise FileFormatError(f"{path}: {_OCAM_EXPECTED}") from None
    if len(direct) != count:
        raise FileFormatError(f"{path}: the direct polynomial must have {count:g} coefficients, got {len(direct)}")
    make_lens = partial(Scaramuzza, column + 0.5, row + 0.5, tuple(direct), (1.0, e, d, c))
    return make_camera(str(path), (width, height), make_lens, distortion=distortion, model="an omnidirectional camera")


def _number(place: object, fields: Mapping[str, Any], name: str, unit: str = " [px]") -> float:
    """Return a number, which the formats may write as text."""
    if name not in fields:
        raise FileFormatError(f"{place}: {name}{unit} is missing")
    value = fields[name]
    with contextlib.suppress(ValueError):
        value = float(value) if isinstance(value, str) else value
    return float(as_numbers(value, (), f"{place}: {name}{unit}"))
