# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras of other systems' numbers: what is a pinhole, and what is said of lenses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from warpvis.core.camera import Camera
from warpvis.core.checks import describe_exception
from warpvis.core.image_cameras import describe_pixels, same_pixels
from warpvis.core.user_warnings import warn_user
from warpvis.errors import CameraError, FileFormatError, IntrinsicsWarning, MessageError
from warpvis.sensors import CalibratedCamera

_Camera = TypeVar("_Camera", Camera, CalibratedCamera)


class NoPinholeError(FileFormatError):
    """A file has a camera whose lens is of a model that is not rendered, such as a fisheye's."""


def make_pinhole(
    place: str,
    size: Sequence[float],
    intrinsics: Sequence[float],
    *,
    pixel_center: float,
    distortion: Sequence[float] = (),
) -> Camera:
    """Make the camera of a file.

    Args:
        place: Where it is, as messages say it.
        size: Width and height [px].
        intrinsics: ``fx fy cx cy`` [px].
        pixel_center: See `Camera.from_K`.
        distortion: Coefficients of the lens; a warning says so if one is not 0.

    Raises:
        FileFormatError: These numbers make no camera.
    """
    fx, fy, cx, cy = intrinsics
    try:
        matrix = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
        camera = Camera.from_K(matrix, *size, pixel_center=pixel_center)  # type: ignore[arg-type]  # `Camera` checks
    except CameraError as error:
        raise FileFormatError(f"{place}: {describe_exception(error)}") from None
    if any(distortion):
        warn_user(
            f"{place}: the lens has distortion, which is not rendered: images are those of the pinhole, as of pictures "
            "that were undistorted",
            IntrinsicsWarning,
        )
    return camera


def make_calibrated(place: str, make: Callable[[], CalibratedCamera]) -> CalibratedCamera:
    """Make the camera of a file, with its lens.

    Raises:
        FileFormatError: Its numbers make no camera.
    """
    try:
        return make()
    except (CameraError, MessageError) as error:
        raise FileFormatError(f"{place}: {describe_exception(error)}") from None


def one_camera(cameras: Sequence[_Camera], place: str) -> _Camera | None:
    """Return the camera of all images; None, with a warning, if they have several."""
    other = next((camera for camera in cameras if not same_pixels(camera, cameras[0])), None)
    if other is None:
        return cameras[0] if cameras else None
    warn_user(
        f"{place}: its images have different cameras, of {describe_pixels(cameras[0])} and of {describe_pixels(other)} "
        "among them; frames have one, so give it",
        IntrinsicsWarning,
    )
    return None


def camera_of_poses(read: Callable[[], CalibratedCamera | None]) -> CalibratedCamera | None:
    """Read the camera that a file of poses brings; None, with a warning, if it is no pinhole: poses are of use alone.

    Raises:
        FileFormatError: The file does not read.
    """
    try:
        return read()
    except NoPinholeError as error:
        warn_user(f"{error}: the poses come without a camera", IntrinsicsWarning)
        return None


def image_size(folder: Path, names: Sequence[str]) -> tuple[int, int] | None:
    """Read width and height of the first image that is there, of `names` in a folder; None if none is."""
    from PIL import Image

    for name in names:
        try:
            with Image.open(folder / name) as picture:
                return picture.size
        except Exception:  # each kind of damage has its own
            continue
    return None
