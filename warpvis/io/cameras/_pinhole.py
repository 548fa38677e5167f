# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pinhole cameras from the numbers of other systems, and warnings about lenses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from warpvis.cameras import ImageCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import describe_exception
from warpvis.core.user_warnings import warn_user
from warpvis.errors import CameraError, FileFormatError, IntrinsicsWarning, MessageError

_Camera = TypeVar("_Camera", Camera, ImageCamera)


class NoPinholeError(FileFormatError):
    """A file's camera has a lens model that cannot be rendered, such as a fisheye."""


def make_pinhole(
    place: str,
    size: Sequence[float],
    intrinsics: Sequence[float],
    *,
    pixel_center: float,
    distortion: Sequence[float] = (),
) -> Camera:
    """Create the camera of a file.

    Args:
        place: Location of the camera, for messages.
        size: Width and height [px].
        intrinsics: ``fx fy cx cy`` [px].
        pixel_center: See `Camera.from_K`.
        distortion: Coefficients of the lens; warns if one is not 0.
    """
    fx, fy, cx, cy = intrinsics
    try:
        matrix = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
        camera = Camera.from_K(matrix, *size, pixel_center=pixel_center)  # type: ignore[arg-type]  # `Camera` checks
    except CameraError as error:
        raise FileFormatError(f"{place}: {describe_exception(error)}") from None
    if any(distortion):
        warn_user(
            f"{place}: the lens has distortion, which is not rendered: images are those of a pinhole, like "
            "undistorted pictures",
            IntrinsicsWarning,
        )
    return camera


def make_calibrated(place: str, make: Callable[[], ImageCamera]) -> ImageCamera:
    """Create the camera of a file, with its lens."""
    try:
        return make()
    except (CameraError, MessageError) as error:
        raise FileFormatError(f"{place}: {describe_exception(error)}") from None


def one_camera(cameras: Sequence[_Camera], place: str) -> _Camera | None:
    """Return the camera of all images; None, with a warning, if they have several."""
    other = next((camera for camera in cameras if not camera.has_pixels_of(cameras[0])), None)
    if other is None:
        return cameras[0] if cameras else None
    warn_user(
        f"{place}: its images have different cameras, such as {cameras[0].describe()} and "
        f"{other.describe()}; frames have only one, so give it explicitly",
        IntrinsicsWarning,
    )
    return None


def camera_of_poses(read: Callable[[], ImageCamera | None]) -> ImageCamera | None:
    """Read the camera in a file of poses; warn and return None if it is not a pinhole, since poses are useful alone."""
    try:
        return read()
    except NoPinholeError as error:
        warn_user(f"{error}: the frames have no camera", IntrinsicsWarning)
        return None


def image_size(folder: Path, names: Sequence[str]) -> tuple[int, int] | None:
    """Read width and height of the first image in a folder, of `names`, that exists; None if none does."""
    from PIL import Image

    for name in names:
        try:
            with Image.open(folder / name) as picture:
                return picture.size
        except Exception:  # each kind of damage raises its own exception
            continue
    return None
