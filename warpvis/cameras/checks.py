# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Check image sizes, intrinsics and depth ranges of cameras."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import is_number
from warpvis.core.user_warnings import warn_user
from warpvis.errors import ArrayError, CameraError, IntrinsicsWarning

MAX_RAYS = 2**26
"""Maximum number of rays of a camera; they take 1.6 GB."""

_FIRST_PIXELS = 1.5
"""Bound on a normalized principal point, plus half a pixel for a different pixel-center convention [px]."""

_MAX_TANGENT = 20
"""Largest tangent of the field of view to one side of the optical axis: 87 degrees."""

_SAME_SIZE = 0.06
"""Maximum distance of a principal point from the middle of the image, in half sizes; cameras are within this."""

_OTHER_SCALE = 0.5
"""Minimum binary logarithm of the scale between two image sizes."""


def check_numbers(camera: Any, positive: str) -> None:
    """Check the fields of a camera with an image plane, a frozen dataclass, and convert them to int and float.

    `positive` begins the error message if `fx` or `fy` is not positive.
    """
    _make_sizes(camera)
    _make_floats(camera, ("fx", "fy", "cx", "cy"))
    if camera.fx <= 0 or camera.fy <= 0:
        raise CameraError(
            f"{positive}, got fx={camera.fx}, fy={camera.fy}; pass their absolute values, and for images with y up, as "
            'OpenGL and ICL-NUIM have, poses with convention="opengl"'
        )
    check_range(camera)


def check_image_size(camera: Any) -> None:
    """Check the image size of a camera with a ray for each pixel, a frozen dataclass, and convert it to int."""
    _make_sizes(camera)
    check_ray_count(camera.width, camera.height)


def check_ray_count(width: int, height: int) -> None:
    """Raise `CameraError` if an image has too many rays."""
    if width * height > MAX_RAYS:
        raise CameraError(f"width x height must be at most {MAX_RAYS} rays, got {width} x {height}")


def check_pixel_units(width: int, height: int, intrinsics: Any) -> None:
    """Check that intrinsics are in pixels, and not divided by the image size.

    A normalized principal point is in the first pixel, and normalized focal lengths are about 1. Focal lengths in
    pixels that are less than a 20th of the image size would mean 87 degrees of view to one side of such a point.
    Images whose middle is in the first pixels are not checked.
    """
    fx, fy, cx, cy = (getattr(intrinsics, name) for name in ("fx", "fy", "cx", "cy"))
    in_corner = max(abs(cx), abs(cy)) <= _FIRST_PIXELS < max(width, height) / 2
    if in_corner and fx * _MAX_TANGENT < width and fy * _MAX_TANGENT < height:
        raise CameraError(
            f"intrinsics must be in pixels of an image of {width} x {height}, got fx={fx:g}, fy={fy:g} and a principal "
            f"point in the first pixel: if they are normalized, multiply fx and cx by {width}, fy and cy by {height}"
        )


def check_range(camera: Any) -> None:
    """Check `near` and `far` of a camera, a frozen dataclass, and convert them to float."""
    _make_floats(camera, ("near", "far"))
    if camera.near < 0 or camera.far <= camera.near:
        raise CameraError(f"the depth range needs 0 <= near < far, got near={camera.near}, far={camera.far}")


def check_size(value: object, name: str) -> int:
    """Return an image dimension as int: an integer of any numeric type, positive and less than 2**31."""
    if not is_number(value) or not 1 <= value < 2**31 or int(value) != value:
        raise CameraError(f"{name} must be a whole number of pixels from 1 up, got {value!r}")
    return int(value)


def check_matrix(k: ArrayLike, pixel_center: float) -> tuple[float, float, float, float]:
    """Return ``fx fy cx cy`` [px] for pixel centers at +0.5, from an intrinsic matrix for centers at `pixel_center`."""
    matrix = as_floats(k, "K")
    if matrix.shape != (3, 3):
        remedies = {(3, 4): "; pass K[:, :3]", (4, 4): "; pass K[:3, :3]", (9,): "; pass K.reshape(3, 3)"}
        raise CameraError(f"K must have shape (3, 3), got {matrix.shape}{remedies.get(matrix.shape, '')}")
    if np.any(matrix[2, :2] != 0) and not np.any(matrix[:2, 2]):
        raise CameraError(
            f"K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got its transpose, {matrix.tolist()}; pass K.T"
        )
    if np.any(matrix[[0, 1, 2, 2], [1, 0, 0, 1]] != 0) or matrix[2, 2] != 1:
        raise CameraError(
            f"K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] without skew, got {matrix.tolist()}; "
            "undistort and rectify the image first"
        )
    shift = 0.5 - check_pixel_center(pixel_center)
    fx, fy, cx, cy = matrix[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    return fx, fy, cx + shift, cy + shift


def check_pixel_center(pixel_center: float) -> float:
    """Return the coordinate of a pixel's center, or raise `CameraError` if it is neither 0.0 nor 0.5."""
    if not is_number(pixel_center) or pixel_center not in (0.0, 0.5):
        raise CameraError(f"pixel_center must be 0.5 or 0.0, got {pixel_center!r}")
    return pixel_center


@lru_cache(maxsize=1024)  # warns once per camera: cameras that differ only in range are created repeatedly
def warn_of_improbable(width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> None:
    """Warn about improbable intrinsics: for another image size, or divided by the image size."""
    problem, scale = "", cx / width + cy / height
    if min(fx, fy) < 1 and max(width / fx, height / fy) > 2 * _MAX_TANGENT:  # less may be a small image
        problem = f"focal lengths are fx={fx:g}, fy={fy:g}, less than a pixel: intrinsics are in pixels"
    elif _is_middle(cx, cy, height, width) and abs(width - height) > _SAME_SIZE * width:
        problem = (
            f"the principal point ({cx:g}, {cy:g}) is the middle of an image of {height} x {width} pixels, not of "
            f"{width} x {height}: width comes before height"
        )
    elif scale > 0 and abs(math.log2(scale)) > _OTHER_SCALE and _is_middle(cx, cy, scale * width, scale * height):
        problem = (
            f"the principal point ({cx:g}, {cy:g}) is the middle of an image of {scale * width:.0f} x "
            f"{scale * height:.0f} pixels, not of {width} x {height}: multiply fx, fy, cx and cy by {1 / scale:.3g}"
        )
    elif not (0 <= cx <= width and 0 <= cy <= height):
        problem = f"the principal point ({cx:g}, {cy:g}) is outside of the image of {width} x {height} pixels"
    elif min(width / fx, height / fy) > 2 * _MAX_TANGENT and _is_middle(cx, cy, width, height):
        problem = (
            f"focal lengths of fx={fx:g}, fy={fy:g} px are a field of view of "
            f"{math.degrees(2 * math.atan(width / 2 / fx)):.0f} degrees: if they are in millimeters, multiply them "
            "by the width of the image [px] and divide by that of the imager [mm]"
        )
    if problem:
        warn_user(f"{problem}; are the intrinsics of an image of this size?", IntrinsicsWarning)


def _is_middle(cx: float, cy: float, width: float, height: float) -> bool:
    """Return whether a principal point is close to the middle of an image."""
    return abs(2 * cx / width - 1) < _SAME_SIZE and abs(2 * cy / height - 1) < _SAME_SIZE


def as_floats(value: object, name: str) -> NDArray[np.float64]:
    """Return numbers in double precision, or raise `CameraError`."""
    try:
        return as_numpy(value, name=name).astype("float64")
    except ArrayError as error:
        raise CameraError(str(error)) from None


def as_rows(value: object, count: int, name: str) -> NDArray[np.float64]:
    """Return numbers of shape ``(..., count)`` in double precision, or raise `CameraError`."""
    rows = as_floats(value, name)
    if rows.shape[-1:] != (count,):
        raise CameraError(f"{name} must have shape (..., {count}), got {rows.shape}")
    return rows


def _make_sizes(camera: Any) -> None:
    for name in ("width", "height"):
        object.__setattr__(camera, name, check_size(getattr(camera, name), name))


def _make_floats(camera: Any, names: Sequence[str]) -> None:
    for name in names:
        value = getattr(camera, name)
        if not is_number(value) or math.isnan(value) or (math.isinf(value) and name != "far"):
            raise CameraError(f"{name} must be a finite number, got {value!r}")
        object.__setattr__(camera, name, float(value))
