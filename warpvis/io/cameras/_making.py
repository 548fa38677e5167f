# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras from the lenses of other systems, with or without their distortion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from warpvis.cameras import ImageCamera
from warpvis.cameras.base import intrinsics
from warpvis.cameras.lenses import Lens, OpenCVPinhole
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import describe_exception, truncate
from warpvis.core.user_warnings import warn_user
from warpvis.errors import CameraError, FileFormatError, IntrinsicsWarning, MessageError

Made = TypeVar("Made")

_NAMES_SHOWN = 12
"""Maximum number of names of cameras in a message."""


class NoPinholeError(FileFormatError):
    """A file's camera has a lens model that is not a pinhole, such as a fisheye, and is read without its lens."""


def make_camera(
    place: str, size: Sequence[float], make_lens: Callable[[], Lens], *, distortion: bool, model: str = ""
) -> ImageCamera:
    """Create the camera of a file.

    Args:
        place: Location of the camera, for messages.
        size: Width and height [px].
        make_lens: Function that creates its lens, or raises `CameraError`.
        distortion: Whether to return the camera with its lens, or a pinhole with the same intrinsics, with a warning
            if the lens has distortion.
        model: Description of a lens model that is not a pinhole with distortion, and requires `distortion`.
    """
    if model and not distortion:
        raise NoPinholeError(f"{place}: {model} is not a pinhole")

    def make() -> tuple[Lens, ImageCamera]:
        lens = make_lens()
        maker = Camera.from_lens if distortion else _without_distortion
        return lens, maker(lens, *size)  # type: ignore[arg-type]  # `Camera` checks

    lens, camera = checked(place, make)
    if not (distortion or lens.is_pinhole):
        warn_user(
            f"{place}: the lens has distortion, which is not rendered: images are those of a pinhole, like "
            "undistorted pictures",
            IntrinsicsWarning,
        )
    return camera


def make_pinhole(place: str, size: Sequence[float], numbers: Sequence[float]) -> ImageCamera:
    """Create a pinhole camera from ``fx fy cx cy`` [px], with pixel centers at integers."""
    fx, fy, cx, cy = numbers
    return make_camera(place, size, lambda: OpenCVPinhole(fx, fy, cx + 0.5, cy + 0.5), distortion=False)


def _without_distortion(lens: Lens, width: int, height: int) -> Camera:
    return Camera(width, height, *intrinsics(lens))


def checked(place: str, make: Callable[[], Made]) -> Made:
    """Call a function that creates a camera of a file, and name the file if its numbers are invalid."""
    try:
        return make()
    except (CameraError, MessageError) as error:
        raise FileFormatError(f"{place}: {describe_exception(error)}") from None


def choose(path: Path, names: Sequence[str], name: str) -> str:
    """Return the name of the camera to read, which must be given if a file has several."""
    shown = ", ".join(names[:_NAMES_SHOWN]) + (", ..." if len(names) > _NAMES_SHOWN else "")
    if name and name not in names:
        raise FileFormatError(f"{path}: has no camera {truncate(name)!r}; it has {shown}")
    if not name and len(names) > 1:
        raise FileFormatError(f"{path}: has the cameras {shown}; choose one as {path}:{names[0]}")
    return name or names[0]


def only_camera(path: Path, name: str) -> None:
    """Raise `FileFormatError` if a name is given for a file that has one camera."""
    if name:
        raise FileFormatError(f"{path}: holds one camera, so it takes no name {truncate(name)!r}")


def one_camera(cameras: Iterable[ImageCamera], place: str, example: str = "") -> ImageCamera | None:
    """Return the camera of all images, or None without a camera.

    If they have several, raise an error that names `example`, a way to choose one, or without it, warn and return None.
    """
    remaining = iter(cameras)
    first = next(remaining, None)
    other = next((camera for camera in remaining if not camera.has_pixels_of(first)), None)
    if first is None or other is None:
        return first
    problem = f"{place}: its images have different cameras, such as {first.describe()} and {other.describe()}"
    if example:
        raise FileFormatError(f"{problem}; choose one as {place}:{example}")
    warn_user(f"{problem}; frames have only one, so give it explicitly", IntrinsicsWarning)
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
