# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras whose parameters have names: camodocal (VINS-Fusion), ORB-SLAM and Basalt.

Formats: https://github.com/HKUST-Aerial-Robotics/VINS-Fusion/tree/master/config,
https://github.com/UZ-SLAMLab/ORB_SLAM3/blob/master/src/Settings.cc,
https://gitlab.com/VladyslavUsenko/basalt-headers/-/blob/master/include/basalt/serialization/headers_serialization.h
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from warpvis.cameras import ImageCamera
from warpvis.cameras.lenses import EUCM, FOV, DoubleSphere, KannalaBrandt, Lens, Mei, OpenCVPinhole, Scaramuzza
from warpvis.errors import FileFormatError
from warpvis.io._files import as_numbers, shorten
from warpvis.io.cameras._making import choose, make_camera, only_camera


class _Model(NamedTuple):
    """A camera model of a format: its parameters, and a function of these that creates the lens."""

    names: str
    """Names of the parameters, in the order of `make`; the third and fourth are the principal point."""
    make: Callable[..., Lens]
    optional: str = ""
    """Names that may be missing, and then are 0."""


def _pinhole(fx: float, fy: float, cx: float, cy: float, *coefficients: float) -> Lens:
    return OpenCVPinhole(fx, fy, cx, cy, coefficients or (0.0,) * 4)


def _kannala_brandt(fx: float, fy: float, cx: float, cy: float, *coefficients: float) -> Lens:
    return KannalaBrandt(fx, fy, cx, cy, coefficients)


def _mei(fx: float, fy: float, cx: float, cy: float, xi: float, *coefficients: float) -> Lens:
    return Mei(fx, fy, cx, cy, xi, coefficients)


_FOCAL = "fx fy cx cy"
_RATIONAL = f"{_FOCAL} k1 k2 p1 p2 k3 k4 k5 k6"

_CAMODOCAL = {
    "PINHOLE": _Model(f"{_FOCAL} k1 k2 p1 p2", _pinhole),
    "PINHOLE_FULL": _Model(_RATIONAL, _pinhole),
    "KANNALA_BRANDT": _Model("mu mv u0 v0 k2 k3 k4 k5", _kannala_brandt),
    "MEI": _Model("gamma1 gamma2 u0 v0 xi k1 k2 p1 p2", _mei),
    "SCARAMUZZA": _Model(
        "ac ad cx cy ae p0 p1 p2 p3 p4",
        lambda c, d, cx, cy, e, *coefficients: Scaramuzza(cx, cy, coefficients, (c, d, e, 1.0)),
    ),
}
_CAMODOCAL_GROUPS = (
    "projection_parameters", "distortion_parameters", "mirror_parameters", "poly_parameters", "affine_parameters"
)  # fmt: skip

_ORB_SLAM = {
    "PinHole": _Model(f"{_FOCAL} k1 k2 p1 p2 k3", _pinhole, optional="k1 k2 p1 p2 k3"),
    "Rectified": _Model(_FOCAL, _pinhole),
    "KannalaBrandt8": _Model(f"{_FOCAL} k1 k2 k3 k4", _kannala_brandt),
}
_ORB_SLAM_PREFIXES = ("Camera1", "Camera", "Camera2")
"""Beginnings of keys; the second one is that of ORB-SLAM2 and old files of ORB-SLAM3."""

_BASALT = {
    "pinhole": _Model(_FOCAL, _pinhole),
    "pinhole-radtan8": _Model(_RATIONAL, _pinhole),
    "kb4": _Model(f"{_FOCAL} k1 k2 k3 k4", _kannala_brandt),
    "ds": _Model(f"{_FOCAL} xi alpha", DoubleSphere),
    "eucm": _Model(f"{_FOCAL} alpha beta", EUCM),
    "ucm": _Model(f"{_FOCAL} alpha", EUCM),
    "fov": _Model(f"{_FOCAL} w", FOV),
}


def is_camodocal(data: Mapping[str, Any]) -> bool:
    """Return whether a file has a camera of camodocal, or names such files, as the settings of VINS-Fusion do."""
    return "model_type" in data or "cam0_calib" in data


def camodocal_camera(path: Path, data: Mapping[str, Any], name: str, *, distortion: bool) -> ImageCamera:
    """Read a camera of camodocal, which VINS-Fusion uses."""
    if "model_type" not in data:
        files = dict.fromkeys(str(data[key]) for key in ("cam0_calib", "cam1_calib") if key in data)
        raise FileFormatError(f"{path}: holds no camera but names the files {' and '.join(files)}; give one of these")
    only_camera(path, name)
    groups = [data[group] for group in _CAMODOCAL_GROUPS if isinstance(data.get(group), dict)]
    fields = {name: value for group in groups for name, value in group.items()}
    size = _size(str(path), data, "image_width", "image_height")
    model = str(data["model_type"]).upper()
    return _make(str(path), _CAMODOCAL, "model_type", model, fields, size, distortion)


def is_orb_slam(data: Mapping[str, Any]) -> bool:
    """Return whether a file is the settings of ORB-SLAM2 or 3."""
    return any(f"{prefix}.{axis}" in data for prefix in _ORB_SLAM_PREFIXES for axis in ("fx", "type"))


def orb_slam_camera(path: Path, data: Mapping[str, Any], name: str, *, distortion: bool) -> ImageCamera:
    """Read ``Camera1`` or ``Camera2`` of the settings of ORB-SLAM."""
    cameras = [prefix for prefix in _ORB_SLAM_PREFIXES if f"{prefix}.fx" in data]
    if not cameras:
        raise FileFormatError(f"{path}: Camera1.fx [px] is missing")
    chosen = choose(path, cameras, name)
    fields = {key.removeprefix(f"{chosen}."): value for key, value in data.items() if key.startswith(f"{chosen}.")}
    place, size = f"{path}: {chosen}", _size(str(path), data, "Camera.width", "Camera.height")
    return _make(place, _ORB_SLAM, "Camera.type", data.get("Camera.type", "PinHole"), fields, size, distortion)


def is_basalt(data: Mapping[str, Any]) -> bool:
    """Return whether a file is a calibration of Basalt."""
    value = data.get("value0")
    return isinstance(value, dict) and "intrinsics" in value


def basalt_camera(path: Path, data: Mapping[str, Any], name: str, *, distortion: bool) -> ImageCamera:
    """Read a camera of Basalt by its number: ``cam0``, ``cam1``, ..."""
    entries, sizes = data["value0"]["intrinsics"], data["value0"].get("resolution")
    if not isinstance(entries, list) or not entries or not all(isinstance(entry, dict) for entry in entries):
        raise FileFormatError(f"{path}: intrinsics must be a list of objects, got {shorten(entries)}")
    sides = as_numbers(sizes, (len(entries), 2), f"{path}: resolution [px]").tolist()
    number = int(choose(path, [f"cam{index}" for index in range(len(entries))], name).removeprefix("cam"))
    place, entry = f"{path}: cam{number}", entries[number]
    fields = entry.get("intrinsics")
    if not isinstance(fields, dict):
        raise FileFormatError(f"{place}: intrinsics must be an object, got {shorten(fields)}")
    return _make(place, _BASALT, "camera_type", entry.get("camera_type"), fields, tuple(sides[number]), distortion)


def _size(place: str, data: Mapping[str, Any], *names: str) -> tuple[float, float]:
    width, height = (_number(place, data, name, " [px]") for name in names)
    return width, height


def _make(
    place: str,
    models: Mapping[str, _Model],
    key: str,
    name: Any,
    fields: Mapping[str, Any],
    size: tuple[float, float],
    distortion: bool,
) -> ImageCamera:
    """Create the camera of a model; its pixel centers are at integers."""
    model = models.get(name) if isinstance(name, str) else None
    if model is None:
        raise FileFormatError(f"{place}: {key} must be one of {', '.join(models)}, got {shorten(name)}")
    values, note = {**dict.fromkeys(model.optional.split(), 0.0), **fields}, f" of {key} {name}"
    fx, fy, cx, cy, *others = (_number(place, values, parameter, note) for parameter in model.names.split())
    make_lens = partial(model.make, fx, fy, cx + 0.5, cy + 0.5, *others)
    problem = "" if model.make is _pinhole else f"{key} {name}"
    return make_camera(place, size, make_lens, distortion=distortion, model=problem)


def _number(place: str, fields: Mapping[str, Any], name: str, note: str) -> float:
    if name not in fields:
        raise FileFormatError(f"{place}: {name}{note} is missing")
    return float(as_numbers(fields[name], (), f"{place}: {name}{note}"))
