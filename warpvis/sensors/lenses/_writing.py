# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lenses as other systems' numbers: ROS's, nerfstudio's and TUM's, each with its own pixel centres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import CameraError
from warpvis.sensors.lenses._fisheyes import KannalaBrandt
from warpvis.sensors.lenses._lens import Lens
from warpvis.sensors.lenses._pinhole import COUNTS, OpenCVPinhole


def lens_to_ros(lens: Lens) -> tuple[NDArray[np.float64], tuple[float, ...], str]:
    """Return `K`, `D` and ``distortion_model`` of a CameraInfo, whose pixels have their centres at whole numbers.

    Raises:
        CameraError: ROS has no such model.
    """
    if isinstance(lens, KannalaBrandt):
        return _matrix(lens), lens.coefficients, "equidistant"
    if isinstance(lens, OpenCVPinhole):
        used = _used(lens)
        # Of plumb_bob there are 5, of rational_polynomial 8; more is what OpenCV takes under that name.
        count = next(count for count in COUNTS if count >= max(used, 5))
        return _matrix(lens), lens.all_coefficients[:count], "plumb_bob" if count == 5 else "rational_polynomial"
    raise CameraError(f"ROS has no distortion_model for {type(lens).__name__}")


def lens_to_nerfstudio(lens: Lens) -> dict[str, str | float]:
    """Return ``camera_model``, ``fl_x fl_y cx cy`` and coefficients of ``transforms.json``, pixel centres at + 0.5.

    Raises:
        CameraError: nerfstudio has no such model.
    """
    if isinstance(lens, KannalaBrandt):
        named = dict(zip(("k1", "k2", "k3", "k4"), lens.coefficients, strict=True))
        return {"camera_model": "OPENCV_FISHEYE", **_intrinsics(lens), **named}
    if isinstance(lens, OpenCVPinhole) and _used(lens) <= 5:
        k1, k2, p1, p2, k3, *_ = lens.all_coefficients
        third = {"k3": k3} if k3 else {}
        return {"camera_model": "OPENCV", **_intrinsics(lens), "k1": k1, "k2": k2, "p1": p1, "p2": p2, **third}
    raise CameraError(f"nerfstudio has no camera_model for {_described(lens)}")


def lens_to_tum(lens: Lens) -> tuple[float, ...]:
    """Return ``fx fy cx cy k1 k2 p1 p2 k3``, as TUM lists its cameras, with pixel centres at whole numbers.

    Raises:
        CameraError: The lens is of another model.
    """
    if isinstance(lens, OpenCVPinhole) and _used(lens) <= 5:
        return lens.fx, lens.fy, lens.cx - 0.5, lens.cy - 0.5, *lens.all_coefficients[:5]
    raise CameraError(f"TUM has five coefficients of OpenCV's pinhole, and none for {_described(lens)}")


def _used(lens: OpenCVPinhole) -> int:
    """Count the coefficients up to the last one that is not 0."""
    return max((place for place, value in enumerate(lens.coefficients, start=1) if value), default=0)


def _described(lens: Lens) -> str:
    name = type(lens).__name__
    return f"{name} of {_used(lens)} coefficients" if isinstance(lens, OpenCVPinhole) else name


def _intrinsics(lens: KannalaBrandt | OpenCVPinhole) -> dict[str, float]:
    return {"fl_x": lens.fx, "fl_y": lens.fy, "cx": lens.cx, "cy": lens.cy}


def _matrix(lens: KannalaBrandt | OpenCVPinhole) -> NDArray[np.float64]:
    return np.array([[lens.fx, 0, lens.cx - 0.5], [0, lens.fy, lens.cy - 0.5], [0, 0, 1]])
