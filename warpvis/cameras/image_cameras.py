# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Handle cameras that map between pixels and 3D points: pinhole cameras, and cameras with lenses."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.lens_camera import LensCamera
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.cameras.pinhole import Camera, describe_pinhole, same_pinhole
from warpvis.cameras.ray_camera import LensedCamera, RayCamera
from warpvis.core.checks import truncate
from warpvis.errors import CameraError

CalibratedCamera: TypeAlias = Camera | LensCamera
"""A camera from a calibration: a pinhole camera, or a camera with a lens."""

PlanarCamera: TypeAlias = Camera | OrthographicCamera
"""A camera whose image is a plane."""

ImageCamera: TypeAlias = Camera | LensedCamera
"""A pinhole camera, or a camera with a lens."""


def require_calibrated(camera: object) -> CalibratedCamera:
    """Return `camera`, or raise `CameraError` if it is neither a `Camera` nor a `LensCamera`."""
    if not isinstance(camera, Camera | LensCamera):
        kinds = "a warpvis.Camera or a warpvis.cameras.LensCamera"
        hint = f": {camera.usage_hint}" if isinstance(camera, RayCamera) else ""
        raise CameraError(f"camera must be {kinds}, got {type(camera).__name__}{hint}")
    return camera


def require_image_camera(camera: object) -> ImageCamera:
    """Return `camera`, or raise `CameraError` if it is neither a pinhole nor a camera with a lens."""
    if not isinstance(camera, Camera | LensedCamera):
        kinds = "a warpvis.Camera or a warpvis.cameras.LensCamera"
        hint = f": {camera.usage_hint}" if isinstance(camera, RayCamera) else ""
        raise CameraError(f"camera must be {kinds}, got {type(camera).__name__}{hint}")
    return camera


def pinhole_rays(camera: Camera) -> NDArray[np.float64]:
    """Return the rays of a pinhole camera's pixels, scaled to z = 1, shape ``(height, width, 3)``."""
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    return camera.back_project(np.stack([x, y], axis=-1), np.ones_like(x))


def same_pixels(camera: ImageCamera, other: ImageCamera) -> bool:
    """Return whether two cameras have the same size, projection and kind of depth; depth ranges may differ."""
    if isinstance(camera, Camera) and isinstance(other, Camera):
        return same_pinhole(camera, other)
    if isinstance(camera, Camera) or isinstance(other, Camera):
        return False
    mine, theirs = ((eye.lens, eye.width, eye.height, eye.kind) for eye in (camera, other))
    return mine == theirs


def describe_pixels(camera: ImageCamera) -> str:
    """Describe the image size and projection of a camera in a few words."""
    if isinstance(camera, Camera):
        return describe_pinhole(camera)
    return f"{camera.width}x{camera.height} pixels, {truncate(repr(camera.lens))}"
