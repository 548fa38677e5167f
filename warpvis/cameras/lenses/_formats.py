# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lenses from and to the parameters of OpenCV, ROS, Kalibr, nerfstudio, instant-ngp, TUM and COLMAP.

Source of COLMAP's models: https://colmap.github.io/cameras.html, ``src/colmap/sensor/models.h``
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields as fields_of
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.checks import check_matrix
from warpvis.cameras.lenses._closed import EUCM, FOV, Division, DoubleSphere
from warpvis.cameras.lenses._fisheyes import FTheta, KannalaBrandt, RadTanThinPrismFisheye, ThinPrismFisheye
from warpvis.cameras.lenses._lens import Lens, check_coefficients, format_alternatives
from warpvis.cameras.lenses._omnidirectional import Mei
from warpvis.cameras.lenses._panoramas import Equirectangular
from warpvis.cameras.lenses._pinhole import COUNTS, OpenCVPinhole
from warpvis.core.checks import as_items, check_flag, check_text, is_number, truncate
from warpvis.errors import CameraError

_ROS_COUNTS: dict[str, tuple[int, ...]] = {
    "plumb_bob": (4, 5),
    "rational_polynomial": (8, 12, 14),
    "equidistant": (4,),
    "fisheye": (4,),
}
_KALIBR_COUNTS = {"none": (0,), "radtan": (4,), "equidistant": (4,), "equi": (4,), "fov": (1,)}
NERF_PINHOLES = ("PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
"""Models of nerfstudio that are pinhole cameras, with or without distortion."""

_NERF_FISHEYES = ("OPENCV_FISHEYE", "FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
# Rows of instant-ngp's "equirectangular" are equally spaced in height, not in angle. It is not supported.
_NGP_MODELS = {
    "is_fisheye": "OPENCV_FISHEYE",
    "latlong": "EQUIRECTANGULAR",
    "equirectangular": "equirectangular (of equal area)",
    "ftheta_p0": "FTHETA",
}
_FISHEYES = ("equidistant", "equi", "fisheye")


def lens_from_opencv(k: ArrayLike, d: ArrayLike | None, *, fisheye: bool = False) -> Lens:
    """Create a lens from OpenCV's `K` and `D`, with pixel centers at integers."""
    intrinsics = check_matrix(k, 0.0)  # like `Camera.from_K`
    coefficients = _numbers(d, "D")
    counts, name = ((4,), "OpenCV's fisheye") if fisheye else (COUNTS, "OpenCV's pinhole")
    _check_count(coefficients, (0, *counts), "D", name)
    if fisheye:
        return KannalaBrandt(*intrinsics, coefficients or (0.0,) * 4)
    return OpenCVPinhole(*intrinsics, coefficients or (0.0,) * 4)


def lens_from_ros(k: ArrayLike, d: ArrayLike | None, model: str) -> Lens:
    """Create a lens from the `K`, `D` and `distortion_model` of a CameraInfo."""
    coefficients = _numbers(d, "D")
    if not model and not any(coefficients):
        return lens_from_opencv(k, None)
    if model not in _ROS_COUNTS:
        raise CameraError(f"distortion_model must be one of {', '.join(_ROS_COUNTS)}, got {truncate(repr(model))}")
    _check_count(coefficients, (0, *_ROS_COUNTS[model]), "D", model)
    return lens_from_opencv(k, coefficients, fisheye=model in _FISHEYES)


def lens_from_kalibr(entry: Mapping[str, Any]) -> Lens:
    """Create a lens from a camera in Kalibr's ``camchain.yaml``, with pixel centers at integers."""
    model, distortion = str(entry.get("camera_model", "pinhole")), str(entry.get("distortion_model", "none"))
    coefficients = _numbers(entry.get("distortion_coeffs"), "distortion_coeffs")
    numbers = _numbers(entry.get("intrinsics"), "intrinsics")
    counts = {"pinhole": 4, "omni": 5, "eucm": 6, "ds": 6}
    if model not in counts:
        raise CameraError(f"camera_model must be one of {', '.join(counts)}, got {truncate(repr(model))}")
    _check_count(numbers, (counts[model],), "intrinsics", model)
    if distortion not in _KALIBR_COUNTS:
        raise CameraError(
            f"distortion_model must be one of {', '.join(_KALIBR_COUNTS)}, got {truncate(repr(distortion))}"
        )
    fx, fy, cx, cy = numbers[-4:]
    intrinsics = fx, fy, cx + 0.5, cy + 0.5
    if model == "pinhole":
        if not any(coefficients):
            return OpenCVPinhole(*intrinsics) if distortion in ("none", "radtan", "fov") else KannalaBrandt(*intrinsics)
        _check_count(coefficients, _KALIBR_COUNTS[distortion], "distortion_coeffs", distortion)
        makes: dict[str, Callable[[], Lens]] = {
            "radtan": lambda: OpenCVPinhole(*intrinsics, coefficients),
            "fov": lambda: FOV(*intrinsics, coefficients[0]),
        }
        return makes.get(distortion, lambda: KannalaBrandt(*intrinsics, coefficients))()
    if any(coefficients):
        if model == "omni" and distortion == "radtan":
            _check_count(coefficients, _KALIBR_COUNTS[distortion], "distortion_coeffs", distortion)
            return Mei(*intrinsics, numbers[0], coefficients)
        raise CameraError(
            f"distortion_model of camera_model {model} must be {'none or radtan' if model == 'omni' else 'none'}, got "
            f"{distortion} with non-zero coefficients"
        )
    if model == "ds":
        return DoubleSphere(*intrinsics, *numbers[:2])
    if model == "eucm":
        return EUCM(*intrinsics, *numbers[:2])
    xi = numbers[0]
    if xi < 0:
        raise CameraError(f"xi of an omni camera must be at least 0, got {xi!r}")
    return EUCM(fx / (1 + xi), fy / (1 + xi), cx + 0.5, cy + 0.5, xi / (1 + xi))


def nerfstudio_model(fields: Mapping[str, Any]) -> str:
    """Return the model of a camera in ``transforms.json``, from ``camera_model`` or from the keys of instant-ngp.

    instant-ngp uses the keys ``is_fisheye``, ``latlong``, ``equirectangular`` and ``ftheta_p0`` to ``ftheta_p4``
    (``read_lens`` in its ``src/nerf_loader.cu``).
    """
    name = fields.get("camera_model")
    models = [] if name is None else [str(name)]
    for key, model in _NGP_MODELS.items():
        if key in fields and (key.startswith("ftheta") or check_flag(fields[key], key, CameraError)):
            if name is None:
                models.append(model)
            elif name != model and not (model == "OPENCV_FISHEYE" and name in _NERF_FISHEYES):
                raise CameraError(f"camera_model must be {model} or left out with {key}, got {truncate(repr(name))}")
    if len(models) > 1:
        raise CameraError(f"a camera must have one model, got keys of {' and '.join(models)}")
    return models[0] if models else "OPENCV"


def _nerfstudio_distortion(fields: Mapping[str, Any]) -> tuple[float, ...]:
    """Return ``k1 k2 k3 k4 p1 p2`` of a camera in ``transforms.json``, from single keys or ``distortion_params``."""
    if fields.get("distortion_params") is None:
        return tuple(_number(fields, name) for name in ("k1", "k2", "k3", "k4", "p1", "p2"))
    coefficients = _numbers(fields["distortion_params"], "distortion_params")
    _check_count(coefficients, (6,), "distortion_params", "nerfstudio")
    return coefficients


def lens_from_nerfstudio(fields: Mapping[str, Any], size: Sequence[float], intrinsics: Sequence[float]) -> Lens:
    """Create a lens from a camera of nerfstudio or instant-ngp, with pixel centers at +0.5."""
    model = nerfstudio_model(fields)
    k1, k2, k3, k4, p1, p2 = _nerfstudio_distortion(fields)
    fx, fy, cx, cy = (float(number) for number in intrinsics)
    if model in NERF_PINHOLES:
        if k4:
            raise CameraError(
                f"k4 of camera_model {model} must be 0, got {k4:g}. A term in the eighth power of the radius is not "
                "supported."
            )
        return OpenCVPinhole(fx, fy, cx, cy, (k1, k2, p1, p2, k3) if k3 else (k1, k2, p1, p2))
    if model in _NERF_FISHEYES:
        if p1 or p2:
            raise CameraError(f"p1 and p2 of camera_model {model} must be 0, got {p1:g} and {p2:g}")
        return KannalaBrandt(fx, fy, cx, cy, (k1, k2, k3, k4))
    if model == "FTHETA":
        constant, *coefficients = (_number(fields, f"ftheta_p{power}") for power in range(5))
        if constant:
            raise CameraError(f"ftheta_p0, the angle at the principal point, must be 0, got {constant:g}")
        return FTheta(cx, cy, tuple(coefficients))
    if model == "EQUIRECTANGULAR":
        return Equirectangular(float(size[0]), float(size[1]))
    raise CameraError(f"camera_model {truncate(repr(model))} of nerfstudio is not supported")


def _number(fields: Mapping[str, Any], name: str) -> float:
    value = fields.get(name)
    value = 0.0 if value is None else value
    if not is_number(value):
        raise CameraError(f"{name} must be a number, got {truncate(repr(value))}")
    return float(value)


def _numbers(values: Any, name: str) -> tuple[float, ...]:
    if values is None:
        return ()
    items = np.ravel(values).tolist() if hasattr(values, "__array__") else as_items(values, name, CameraError)
    flat = [number for item in items for number in (item if isinstance(item, list | tuple) else [item])]
    # The comparison rejects integers that exceed the range of float.
    wrong = [number for number in flat if not is_number(number) or not abs(number) <= sys.float_info.max]
    if wrong:
        raise CameraError(f"{name} must be finite numbers, got {truncate(repr(wrong[0]))}")
    return tuple(float(number) for number in flat)


def _check_count(values: Sequence[float], counts: Sequence[int], name: str, model: str) -> None:
    if len(values) not in counts:
        expected = format_alternatives([count for count in counts if count] or [0])
        raise CameraError(f"{name} of {model} must be {expected} numbers, got {len(values)}")


def lens_to_ros(lens: Lens) -> tuple[NDArray[np.float64], tuple[float, ...], str]:
    """Return `K`, `D` and ``distortion_model`` of a CameraInfo, with pixel centers at integers.

    Raises:
        CameraError: If ROS has no such model.
    """
    if isinstance(lens, KannalaBrandt):
        return _matrix(lens), lens.coefficients, "equidistant"
    if isinstance(lens, OpenCVPinhole):
        num_used = _num_used(lens)
        # plumb_bob has 5 coefficients, rational_polynomial 8; OpenCV accepts 12 and 14 as rational_polynomial, too.
        count = next(count for count in COUNTS if count >= max(num_used, 5))
        return _matrix(lens), lens.all_coefficients[:count], "plumb_bob" if count == 5 else "rational_polynomial"
    raise CameraError(f"ROS has no distortion_model for {type(lens).__name__}")


def lens_to_nerfstudio(lens: Lens) -> dict[str, str | float]:
    """Return ``camera_model``, ``fl_x fl_y cx cy`` and coefficients for ``transforms.json``, with centers at +0.5.

    Raises:
        CameraError: If nerfstudio has no such model.
    """
    if isinstance(lens, KannalaBrandt):
        named = dict(zip(("k1", "k2", "k3", "k4"), lens.coefficients, strict=True))
        return {"camera_model": "OPENCV_FISHEYE", **_intrinsics(lens), **named}
    if isinstance(lens, OpenCVPinhole) and _num_used(lens) <= 5:
        k1, k2, p1, p2, k3, *_ = lens.all_coefficients
        third = {"k3": k3} if k3 else {}
        return {"camera_model": "OPENCV", **_intrinsics(lens), "k1": k1, "k2": k2, "p1": p1, "p2": p2, **third}
    raise CameraError(f"nerfstudio has no camera_model for {_describe(lens)}")


def lens_to_tum(lens: Lens) -> tuple[float, ...]:
    """Return ``fx fy cx cy k1 k2 p1 p2 k3``, as in the TUM dataset, with pixel centers at integers.

    Raises:
        CameraError: If the lens has another model.
    """
    if isinstance(lens, OpenCVPinhole) and _num_used(lens) <= 5:
        return lens.fx, lens.fy, lens.cx - 0.5, lens.cy - 0.5, *lens.all_coefficients[:5]
    raise CameraError(
        f"lens must be OpenCVPinhole with at most 5 coefficients to be written for TUM, got {_describe(lens)}"
    )


def _num_used(lens: OpenCVPinhole) -> int:
    """Return the number of coefficients up to the last one that is not 0."""
    return max((index for index, value in enumerate(lens.coefficients, start=1) if value), default=0)


def _describe(lens: Lens) -> str:
    name = type(lens).__name__
    return f"{name} with {_num_used(lens)} coefficients" if isinstance(lens, OpenCVPinhole) else name


def _intrinsics(lens: KannalaBrandt | OpenCVPinhole) -> dict[str, float]:
    return {"fl_x": lens.fx, "fl_y": lens.fy, "cx": lens.cx, "cy": lens.cy}


def _matrix(lens: KannalaBrandt | OpenCVPinhole) -> NDArray[np.float64]:
    return np.array([[lens.fx, 0, lens.cx - 0.5], [0, lens.fy, lens.cy - 0.5], [0, 0, 1]])


_Make = Callable[[Any], Lens]  # from the tuple of the model's parameters


def _plain(kind: Any) -> _Make:
    """Return a factory of lenses whose fields are the parameters."""
    return lambda p: kind(*p)


def _with_coefficients(kind: Any) -> _Make:
    """Return a factory of lenses whose coefficients follow ``fx fy cx cy``."""
    return lambda p: kind(*p[:4], p[4:])


def _with_one_focal_length(kind: Any) -> _Make:
    """Return a factory of lenses with a single focal length, ``f cx cy``, and up to four coefficients."""
    return lambda p: kind(p[0], *p[:3], (*p[3:], 0, 0, 0, 0)[:4])


# Model: number in binary files, number of parameters, factory.
_MODELS: dict[str, tuple[int, int, _Make]] = {
    "SIMPLE_PINHOLE": (0, 3, _with_one_focal_length(OpenCVPinhole)),
    "PINHOLE": (1, 4, _plain(OpenCVPinhole)),
    "SIMPLE_RADIAL": (2, 4, _with_one_focal_length(OpenCVPinhole)),
    "RADIAL": (3, 5, _with_one_focal_length(OpenCVPinhole)),
    "OPENCV": (4, 8, _with_coefficients(OpenCVPinhole)),
    "OPENCV_FISHEYE": (5, 8, _with_coefficients(KannalaBrandt)),
    "FULL_OPENCV": (6, 12, _with_coefficients(OpenCVPinhole)),
    "FOV": (7, 5, _plain(FOV)),
    "SIMPLE_RADIAL_FISHEYE": (8, 4, _with_one_focal_length(KannalaBrandt)),
    "RADIAL_FISHEYE": (9, 5, _with_one_focal_length(KannalaBrandt)),
    "THIN_PRISM_FISHEYE": (10, 12, _with_coefficients(ThinPrismFisheye)),
    "RAD_TAN_THIN_PRISM_FISHEYE": (11, 16, _with_coefficients(RadTanThinPrismFisheye)),
    "SIMPLE_DIVISION": (12, 4, lambda p: Division(p[0], p[0], p[1], p[2], p[3])),
    "DIVISION": (13, 5, _plain(Division)),
    "SIMPLE_FISHEYE": (14, 3, _with_one_focal_length(KannalaBrandt)),
    "FISHEYE": (15, 4, _plain(KannalaBrandt)),
    "EUCM": (16, 6, _plain(EUCM)),
    "EQUIRECTANGULAR": (17, 2, _plain(Equirectangular)),
}

COLMAP_NUMBERS = {number: name for name, (number, *_) in _MODELS.items()}
"""Names of COLMAP's models by their numbers in binary files."""

COLMAP_PINHOLES = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV")
"""Models of COLMAP that are pinhole cameras, with or without distortion."""

_WRITTEN = {
    KannalaBrandt: "OPENCV_FISHEYE",
    ThinPrismFisheye: "THIN_PRISM_FISHEYE",
    RadTanThinPrismFisheye: "RAD_TAN_THIN_PRISM_FISHEYE",
    FOV: "FOV",
    Division: "DIVISION",
    EUCM: "EUCM",
    Equirectangular: "EQUIRECTANGULAR",
}


def colmap_count(model: str) -> int:
    """Return the number of parameters of a model."""
    if check_text(model, "model", CameraError) not in _MODELS:
        raise CameraError(f"COLMAP has no camera model {model}; its models are {', '.join(_MODELS)}")
    return _MODELS[model][1]


def lens_from_colmap(model: str, parameters: object) -> Lens:
    """Create a lens from a model of COLMAP. Its pixel centers are at +0.5, as in warpvis."""
    checked = check_coefficients(parameters, model, (colmap_count(model),), "parameters")
    return _MODELS[model][2](checked)


def lens_to_colmap(lens: Lens) -> tuple[str, tuple[float, ...]]:
    """Convert a lens to a model of COLMAP and its parameters.

    Raises:
        CameraError: If COLMAP has no equivalent model.
    """
    if isinstance(lens, OpenCVPinhole) and lens.is_pinhole:
        return "PINHOLE", (lens.fx, lens.fy, lens.cx, lens.cy)
    if isinstance(lens, OpenCVPinhole) and not any(lens.all_coefficients[8:]):
        short = not any(lens.all_coefficients[4:])
        model = "OPENCV" if short else "FULL_OPENCV"
        return model, (lens.fx, lens.fy, lens.cx, lens.cy, *lens.all_coefficients[: 4 if short else 8])
    for kind, model in _WRITTEN.items():
        if isinstance(lens, kind):
            numbers = [getattr(lens, field.name) for field in fields_of(kind)]  # in COLMAP's order, coefficients last
            return model, tuple(float(number) for number in np.hstack(numbers))
    raise CameraError(f"COLMAP has no camera model for {type(lens).__name__} with these coefficients")
