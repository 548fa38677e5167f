# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""JSON representation of cameras with lenses, for camera files and batch manifests."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras import lenses
from warpvis.cameras.image_cameras import CalibratedCamera
from warpvis.cameras.lens_camera import LensCamera
from warpvis.cameras.lenses import Lens
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import check_mapping, is_number, is_whole, truncate
from warpvis.core.types import Json
from warpvis.errors import CameraError

_LENSES = {name: getattr(lenses, name) for name in lenses.__all__ if name != "Lens"}
_KNOWN = tuple(field.name for field in fields(LensCamera))


def lens_camera_to_fields(camera: LensCamera) -> dict[str, Json]:
    """Convert a camera to a JSON object; an infinite `far` becomes None.

    The lens is stored as its model, the name of its class, and the fields of that class, with pixel centers at +0.5.
    The model of a class outside of warpvis is ``module:Class``.

    Raises:
        CameraError: If the lens is not a dataclass of parameters, strings and tuples of these.
    """
    lens: Any = camera.lens
    model = _model_name(type(lens))
    if not is_dataclass(lens):
        raise CameraError(f"lens must be a dataclass to be written to a file, got {model}")
    parameters = {field.name: _to_json(getattr(lens, field.name)) for field in fields(lens) if field.init}
    wrong = next((name for name, value in parameters.items() if value is None), None)
    if wrong is not None:
        raise CameraError(
            f"{wrong} of lens {model} must be a number, a string or a tuple of these to be written to a file, got "
            f"{truncate(repr(getattr(lens, wrong)))}"
        )
    return {
        "lens": {"model": model, **parameters},
        "width": camera.width,
        "height": camera.height,
        "near": camera.near,
        "far": None if math.isinf(camera.far) else camera.far,
        "kind": camera.kind,
    }


def lens_camera_from_fields(values: Mapping[str, Any]) -> LensCamera:
    """Create the camera from fields of `lens_camera_to_fields`; `near`, `far` and `kind` are optional.

    Raises:
        CameraError: If the fields are invalid, or if the class of the lens is in a module that is not imported.
    """
    unknown = sorted(values.keys() - set(_KNOWN))
    missing = [name for name in ("lens", "width", "height") if name not in values]
    if unknown or missing:
        problem = f"unknown {truncate(unknown[0])}" if unknown else f"missing {missing[0]}"
        raise CameraError(f"{problem}; the fields of a camera with a lens are {', '.join(_KNOWN)}")
    parameters = dict(check_mapping(values["lens"], "lens", CameraError))
    model = parameters.pop("model", None)
    if not isinstance(model, str) or (model not in _LENSES and ":" not in model):
        raise CameraError(f"model of a lens must be one of {', '.join(_LENSES)}, got {truncate(repr(model))}")
    kind = _find_model(model)
    if kind is None:
        module, _, name = map(truncate, model.partition(":"))
        raise CameraError(f"class {name} of the lens is not part of warpvis. Import {module}, which defines it, first.")
    names = [field.name for field in fields(kind) if field.init]
    wrong = sorted(parameters.keys() - set(names))
    if wrong:
        raise CameraError(f"unknown {truncate(wrong[0])} of a lens; the fields of {model} are {', '.join(names)}")
    try:
        lens = kind(**{name: tuple(value) if isinstance(value, list) else value for name, value in parameters.items()})
    except TypeError:
        raise CameraError(f"{model} needs the parameters {', '.join(names)}, got {', '.join(parameters)}") from None
    options = {
        name: value for name, value in values.items() if name != "lens" and not (name == "far" and value is None)
    }
    return LensCamera(lens, **options)


def _model_name(kind: type[Lens]) -> str:
    return kind.__name__ if _LENSES.get(kind.__name__) is kind else f"{kind.__module__}:{kind.__qualname__}"


def _find_model(name: str) -> Any:
    """Return the class of a model; None if its module is not imported: modules named in files are never imported."""
    pending: list[Any] = [Lens]
    found = _LENSES.get(name)
    while pending and found is None:
        kind = pending.pop()
        pending += kind.__subclasses__()
        found = kind if _model_name(kind) == name and is_dataclass(kind) else None
    return found


def _to_json(value: object) -> Json:
    """Convert a number, a string or a tuple of these to JSON; return None for other values."""
    if isinstance(value, tuple):
        parts = [_to_json(part) for part in value]
        return None if None in parts else parts
    if isinstance(value, str | bool):
        return value
    return int(value) if is_whole(value) else float(value) if is_number(value) else None


def opencv_intrinsics(camera: CalibratedCamera) -> dict[str, NDArray[np.float64]]:
    """Return OpenCV's intrinsics of a camera: ``K``, shape ``(3, 3)``, with pixel centers at +0.5, and ``distortion``.

    The distortion contains 4, 5, 8, 12 or 14 coefficients as in ``cv2.projectPoints``, or 5 zeros for a pinhole camera.
    The result is empty for other lens models.
    """
    if isinstance(camera, Camera):
        return {"K": camera.to_K(), "distortion": np.zeros(5)}
    lens = camera.lens
    if not isinstance(lens, lenses.OpenCVPinhole):
        return {}
    matrix = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]])
    return {"K": matrix, "distortion": np.array(lens.coefficients)}
