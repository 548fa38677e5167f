# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of lenses from and to COLMAP's camera models.

Source: https://colmap.github.io/cameras.html, ``src/colmap/sensor/models.h``
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from warpvis.cameras.lenses._closed import EUCM, FOV, Division
from warpvis.cameras.lenses._fisheyes import KannalaBrandt, RadTanThinPrismFisheye, ThinPrismFisheye
from warpvis.cameras.lenses._lens import Lens, check_coefficients
from warpvis.cameras.lenses._panoramas import Equirectangular
from warpvis.cameras.lenses._pinhole import OpenCVPinhole
from warpvis.core.checks import check_text
from warpvis.errors import CameraError

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
            numbers = [getattr(lens, field.name) for field in fields(kind)]  # in COLMAP's order, coefficients last
            return model, tuple(float(number) for number in np.hstack(numbers))
    raise CameraError(f"COLMAP has no camera model for {type(lens).__name__} with these coefficients")
