# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Handle cameras that map between pixels and 3D points: pinhole cameras, and cameras with lenses."""

from __future__ import annotations

from typing import TypeAlias

from warpvis.cameras.lens_camera import LensCamera
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.cameras.pinhole import Camera
from warpvis.cameras.ray_camera import LensedCamera
from warpvis.errors import CameraError

CalibratedCamera: TypeAlias = Camera | LensCamera
"""A camera from a calibration: a pinhole camera, or a camera with a lens."""

PlanarCamera: TypeAlias = Camera | OrthographicCamera
"""A camera whose image is a plane."""

ImageCamera: TypeAlias = Camera | LensedCamera
"""A pinhole camera, or a camera with a lens."""


def require_calibrated(camera: object) -> CalibratedCamera:
    """Return `camera`, or raise `CameraError` if it is neither a `Camera` nor a `LensCamera`."""
    if isinstance(camera, Camera | LensCamera):
        return camera
    raise _unexpected(camera)


def require_image_camera(camera: object) -> ImageCamera:
    """Return `camera`, or raise `CameraError` if it is neither a pinhole nor a camera with a lens."""
    if isinstance(camera, Camera | LensedCamera):
        return camera
    raise _unexpected(camera)


def _unexpected(camera: object) -> CameraError:
    hint = getattr(camera, "usage_hint", "")
    kinds = "a warpvis.Camera or a warpvis.cameras.LensCamera"
    return CameraError(f"camera must be {kinds}, got {type(camera).__name__}{hint and ': '}{hint}")
