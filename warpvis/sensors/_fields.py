# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras with lenses as JSON, for files of our own and manifests."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.camera import Camera
from warpvis.core.checks import check_mapping, shortened
from warpvis.core.types import Json
from warpvis.errors import CameraError
from warpvis.sensors import lenses
from warpvis.sensors._lens_camera import CalibratedCamera, LensCamera

_LENSES = {name: getattr(lenses, name) for name in lenses.__all__ if name != "Lens"}
_KNOWN = tuple(field.name for field in fields(LensCamera))


def lens_camera_to_fields(camera: LensCamera) -> dict[str, Json]:
    """List what a camera is, as JSON holds it; `far` is None where it is infinite.

    Its lens has its model, which is the name of its class, and that class's fields: pixel centres are at + 0.5.
    """
    kept = {field.name: getattr(camera.lens, field.name) for field in fields(camera.lens)}  # type: ignore[arg-type]
    numbers = {name: list(value) if isinstance(value, tuple) else value for name, value in kept.items()}
    return {
        "lens": {"model": type(camera.lens).__name__, **numbers},
        "width": camera.width,
        "height": camera.height,
        "near": camera.near,
        "far": None if math.isinf(camera.far) else camera.far,
        "kind": camera.kind,
    }


def lens_camera_from_fields(given: Mapping[str, Any]) -> LensCamera:
    """Make the camera of what `lens_camera_to_fields` lists; `near`, `far` and `kind` may be missing.

    Raises:
        CameraError: The fields make none.
    """
    unknown = sorted(given.keys() - set(_KNOWN))
    missing = [name for name in ("lens", "width", "height") if name not in given]
    if unknown or missing:
        problem = f"unknown {shortened(unknown[0])}" if unknown else f"missing {missing[0]}"
        raise CameraError(f"{problem}; a camera with a lens may hold {', '.join(_KNOWN)}")
    numbers = dict(check_mapping(given["lens"], "lens", CameraError))
    model = numbers.pop("model", None)
    if not isinstance(model, str) or model not in _LENSES:
        raise CameraError(f"model of a lens must be one of {', '.join(_LENSES)}, got {shortened(repr(model))}")
    names = [field.name for field in fields(_LENSES[model])]
    wrong = sorted(numbers.keys() - set(names))
    if wrong:
        raise CameraError(f"unknown {shortened(wrong[0])} of a lens; {model} has {', '.join(names)}")
    try:
        lens = _LENSES[model](**numbers)
    except TypeError:
        raise CameraError(f"{model} needs the numbers {', '.join(names)}, got {', '.join(numbers)}") from None
    rest = {name: value for name, value in given.items() if name != "lens" and not (name == "far" and value is None)}
    return LensCamera(lens, **rest)


def opencv_intrinsics(camera: CalibratedCamera) -> dict[str, NDArray[np.float64]]:
    """Return what OpenCV would call a camera: ``K``, ``(3, 3)``, with pixel centres at + 0.5, and ``distortion``.

    The latter are 4, 5, 8, 12 or 14 coefficients of ``cv2.projectPoints``; 5 zeros of a pinhole. A lens of another
    model has neither.
    """
    if isinstance(camera, Camera):
        return {"K": camera.to_K(), "distortion": np.zeros(5)}
    lens = camera.lens
    if not isinstance(lens, lenses.OpenCVPinhole):
        return {}
    matrix = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]])
    return {"K": matrix, "distortion": np.array(lens.coefficients)}
