# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras whose pixels and points of the world are found from each other: pinholes, and cameras with lenses."""

from __future__ import annotations

from typing import TypeAlias

from warpvis.core.camera import Camera, describe_pinhole, same_pinhole
from warpvis.core.checks import shortened
from warpvis.core.ray_camera import LensedCamera
from warpvis.errors import CameraError

ImageCamera: TypeAlias = Camera | LensedCamera
"""A pinhole, or a camera with a lens."""


def require_image_camera(camera: object) -> ImageCamera:
    """Return `camera` itself; raise `CameraError` if it is neither a pinhole nor a camera with a lens."""
    if not isinstance(camera, Camera | LensedCamera):
        kinds = "a warpvis.Camera or a warpvis.sensors.LensCamera"
        raise CameraError(f"camera must be {kinds}, got {type(camera).__name__}")
    return camera


def same_pixels(camera: ImageCamera, other: ImageCamera) -> bool:
    """Tell whether two cameras have the same pixels, whatever their ranges are."""
    if isinstance(camera, Camera) and isinstance(other, Camera):
        return same_pinhole(camera, other)
    if isinstance(camera, Camera) or isinstance(other, Camera):
        return False
    mine, theirs = ((eye.lens, eye.width, eye.height, eye.kind) for eye in (camera, other))
    return mine == theirs


def describe_pixels(camera: ImageCamera) -> str:
    """Say in a few words which pixels a camera has."""
    if isinstance(camera, Camera):
        return describe_pinhole(camera)
    return f"{camera.width}x{camera.height} pixels, {shortened(repr(camera.lens))}"
