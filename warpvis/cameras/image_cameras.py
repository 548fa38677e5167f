# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Handle cameras that map between pixels and 3D points: pinhole cameras, and cameras with lenses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.base import AnyCamera, intrinsics
from warpvis.cameras.lens_camera import LensCamera
from warpvis.cameras.lenses import OpenCVPinhole, lens_from_dict
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import truncate
from warpvis.errors import CameraError

PlanarCamera: TypeAlias = Camera | OrthographicCamera
"""A camera whose image is a plane."""

ImageCamera: TypeAlias = Camera | LensCamera
"""A pinhole camera, or a camera with a lens."""


def require_image_camera(camera: object, name: str = "camera", other: str = "") -> ImageCamera:
    """Return `camera`, or raise `CameraError` if it is neither a `Camera` nor a `LensCamera`.

    `name` is that of the argument, and `other` names what else the caller accepts, for the message.
    """
    if isinstance(camera, Camera | LensCamera):
        return camera
    hint = getattr(camera, "usage_hint", "")
    kinds = "a warpvis.Camera or a warpvis.cameras.LensCamera"
    kinds = kinds.replace(" or", ",") + f" or {other}" if other else kinds
    raise CameraError(f"{name} must be {kinds}, got {type(camera).__name__}{hint and ': '}{hint}")


def as_pinhole(camera: AnyCamera) -> Camera | None:
    """Return the pinhole camera with the same pixels; None if rays are distorted, or depth is along the ray."""
    lens = getattr(camera, "lens", None)
    if lens is None or not lens.is_pinhole or camera.kind != "z":
        return None
    return Camera(camera.width, camera.height, *intrinsics(lens), camera.near, camera.far)


def camera_from_dict(values: Mapping[str, Any]) -> ImageCamera:
    """Create a camera from the result of its `to_dict`; ranges and `kind` are optional.

    Raises:
        CameraError: If a value is invalid, or if the class of the lens is in a module that is not imported.
    """
    kind, described = (LensCamera, "a camera with a lens") if "lens" in values else (Camera, "a camera")
    known = [field.name for field in fields(kind)]
    unknown = sorted(values.keys() - set(known))
    missing = [name for name in known if name not in values and name not in ("near", "far", "kind")]
    if unknown or missing:
        problem = f"unknown {truncate(unknown[0])}" if unknown else f"missing {missing[0]}"
        raise CameraError(f"{problem}; the fields of {described} are {', '.join(known)}")
    given = {name: value for name, value in values.items() if not (name == "far" and value is None)}
    if "lens" in given:
        given["lens"] = lens_from_dict(given["lens"])
    return kind(**given)


def opencv_intrinsics(camera: ImageCamera) -> dict[str, NDArray[np.float64]]:
    """Return OpenCV's intrinsics of a camera: ``K``, shape ``(3, 3)``, with pixel centers at +0.5, and ``distortion``.

    The distortion contains 4, 5, 8, 12 or 14 coefficients as in ``cv2.projectPoints``, or 5 zeros for a pinhole camera.
    The result is empty for other lens models.
    """
    lens = camera.lens
    if not isinstance(lens, OpenCVPinhole):
        return {}
    matrix = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]])
    return {"K": matrix, "distortion": np.array(lens.coefficients)}
