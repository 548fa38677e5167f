# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""COLMAP's camera models, by their names and parameters.

Models: https://colmap.github.io/cameras.html, ``src/colmap/sensor/models.h``
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from warpvis.core.checks import check_text
from warpvis.errors import CameraError
from warpvis.sensors.lenses._closed import EUCM, FOV, Division
from warpvis.sensors.lenses._fisheyes import KannalaBrandt, RadTanThinPrismFisheye, ThinPrismFisheye
from warpvis.sensors.lenses._lens import Lens
from warpvis.sensors.lenses._panoramas import Equirectangular
from warpvis.sensors.lenses._pinhole import OpenCVPinhole

_Make = Callable[[Any], Lens]  # of a tuple of as many parameters as the model has


def _plain(kind: Any) -> _Make:
    """Make a lens whose fields are the parameters."""
    return lambda p: kind(*p)


def _bent(kind: Any) -> _Make:
    """Make one whose coefficients are what comes after ``fx fy cx cy``."""
    return lambda p: kind(*p[:4], p[4:])


def _simple(kind: Any) -> _Make:
    """Make one of a single focal length, ``f cx cy``, and the first of four coefficients."""
    return lambda p: kind(p[0], *p[:3], (*p[3:], 0, 0, 0, 0)[:4])


# Number in binary files, how many parameters, and what they make.
_MODELS: dict[str, tuple[int, int, _Make]] = {
    "SIMPLE_PINHOLE": (0, 3, _simple(OpenCVPinhole)),
    "PINHOLE": (1, 4, _plain(OpenCVPinhole)),
    "SIMPLE_RADIAL": (2, 4, _simple(OpenCVPinhole)),
    "RADIAL": (3, 5, _simple(OpenCVPinhole)),
    "OPENCV": (4, 8, _bent(OpenCVPinhole)),
    "OPENCV_FISHEYE": (5, 8, _bent(KannalaBrandt)),
    "FULL_OPENCV": (6, 12, _bent(OpenCVPinhole)),
    "FOV": (7, 5, _plain(FOV)),
    "SIMPLE_RADIAL_FISHEYE": (8, 4, _simple(KannalaBrandt)),
    "RADIAL_FISHEYE": (9, 5, _simple(KannalaBrandt)),
    "THIN_PRISM_FISHEYE": (10, 12, _bent(ThinPrismFisheye)),
    "RAD_TAN_THIN_PRISM_FISHEYE": (11, 16, _bent(RadTanThinPrismFisheye)),
    "SIMPLE_DIVISION": (12, 4, lambda p: Division(p[0], p[0], p[1], p[2], p[3])),
    "DIVISION": (13, 5, _plain(Division)),
    "SIMPLE_FISHEYE": (14, 3, _simple(KannalaBrandt)),
    "FISHEYE": (15, 4, _plain(KannalaBrandt)),
    "EUCM": (16, 6, _plain(EUCM)),
    "EQUIRECTANGULAR": (17, 2, _plain(Equirectangular)),
}

COLMAP_NUMBERS = {number: name for name, (number, *_) in _MODELS.items()}
"""The names of COLMAP's models by their numbers in binary files."""

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
    """Return how many parameters a model has.

    Raises:
        CameraError: COLMAP has no such model.
    """
    if check_text(model, "model", CameraError) not in _MODELS:
        raise CameraError(f"COLMAP has no camera model {model}; its models are {', '.join(_MODELS)}")
    return _MODELS[model][1]


def lens_from_colmap(model: str, parameters: Sequence[float]) -> Lens:
    """Make the lens of a model of COLMAP's, whose pixels have their centres at + 0.5 as ours have.

    Raises:
        CameraError: There is no such model, or it has other parameters.
    """
    count = colmap_count(model)
    if len(parameters) != count:
        raise CameraError(f"{model} has {count} parameters, got {len(parameters)}")
    return _MODELS[model][2](tuple(parameters))


def lens_to_colmap(lens: Lens) -> tuple[str, tuple[float, ...]]:
    """Return the model of COLMAP's that is a lens, and its parameters.

    Raises:
        CameraError: COLMAP has none that is the same.
    """
    if isinstance(lens, OpenCVPinhole) and not any(lens.all_coefficients[8:]):
        short = not any(lens.all_coefficients[4:])
        model = "OPENCV" if short else "FULL_OPENCV"
        return model, (lens.fx, lens.fy, lens.cx, lens.cy, *lens.all_coefficients[: 4 if short else 8])
    for kind, model in _WRITTEN.items():
        if isinstance(lens, kind):
            numbers = [getattr(lens, field.name) for field in fields(kind)]  # in COLMAP's order, coefficients last
            return model, tuple(float(number) for number in np.hstack(numbers))
    raise CameraError(f"COLMAP has no camera model for {type(lens).__name__} with these coefficients")
