# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of lenses to the parameters of ROS, nerfstudio and TUM."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.lenses._fisheyes import KannalaBrandt
from warpvis.cameras.lenses._lens import Lens
from warpvis.cameras.lenses._pinhole import COUNTS, OpenCVPinhole
from warpvis.errors import CameraError


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
