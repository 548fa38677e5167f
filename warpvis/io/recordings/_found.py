# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Content of a recording's folder before its images are read, and their reader."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import pluralize
from warpvis.core.file_content import is_file, reading, require_content
from warpvis.core.numpy_files import read_array
from warpvis.core.types import Json
from warpvis.core.user_warnings import warn_user
from warpvis.errors import FileFormatError
from warpvis.io._depth import pixels_to_depth, read_pixels
from warpvis.io.cameras._making import image_size
from warpvis.io.recordings._recording import FrameReader

_DEPTH_SUFFIXES = (".png", ".tif", ".tiff", ".pgm", ".npy")
_COLOR_SUFFIXES = (".png", ".jpg", ".jpeg", ".ppm", ".bmp")
MILLIMETERS = 0.001
"""Length of one unit of depth images, if not defined by a format [m]."""


@dataclass(frozen=True, eq=False)
class Found:
    """The frames of a recording in files."""

    depths: list[Path]  # file of every depth image
    camera_to_world: NDArray[np.float64]  # rows of NaN where no pose is known, shape ``(N, 7)``
    colors: list[Path | None] | None = None
    timestamps: NDArray[np.float64] | None = None
    camera: ImageCamera | None = None
    camera_source: str = ""  # origin of `camera`
    unit: float = MILLIMETERS  # length of one unit of integers [m]
    color_camera: Camera | None = None  # camera of color images that have other pixels than the depth images
    details: Mapping[str, Json] = field(default_factory=dict)  # further details of the origin of the frames

    def reader(self, camera: ImageCamera, unit: float | None) -> FrameReader:
        """Return the reader of the images; `unit` is the length of one unit [m], None for that of the format."""
        return FileReader(self, camera, unit)


@dataclass(frozen=True, eq=False)
class FileReader:
    """Reads depth and color images from files."""

    found: Found
    camera: ImageCamera
    unit: float | None  # length of one unit [m], also of floats; None for that of the format

    def read_depth(self, index: int) -> NDArray[np.float32]:
        """Return a depth image [m]."""
        unit = self.found.unit if self.unit is None else self.unit
        return pixels_to_depth(read_pixels(self.found.depths[index]), unit, self.unit)

    def read_color(self, index: int) -> NDArray[np.uint8] | None:
        """Return a color image; pixels of a separate color camera are resampled to those of the depth image."""
        path = self.found.colors[index] if self.found.colors is not None else None
        if path is None:
            return None
        return resample_color(read_color_file(path), self.found.color_camera, self.camera, path)

    def place(self, index: int) -> str:
        """Return the path of a depth image."""
        return str(self.found.depths[index])


def resample_color(
    color: NDArray[np.uint8], source: Camera | None, camera: ImageCamera, place: object
) -> NDArray[np.uint8]:
    """Return the colors of the pixels of a depth image, if its camera and that of the colors, `source`, differ."""
    if source is None or not isinstance(camera, Camera) or color.shape[:2] == (camera.height, camera.width):
        return color
    if color.shape[:2] != (source.height, source.width):
        raise FileFormatError(
            f"{place}: must have the {source.width} x {source.height} pixels of the color camera, got "
            f"{color.shape[1]} x {color.shape[0]}"
        )
    x = np.floor((np.arange(camera.width) + 0.5 - camera.cx) * (source.fx / camera.fx) + source.cx).astype(int)
    y = np.floor((np.arange(camera.height) + 0.5 - camera.cy) * (source.fy / camera.fy) + source.cy).astype(int)
    return color[np.ix_(y.clip(0, source.height - 1), x.clip(0, source.width - 1))]


def read_color_file(path: Path) -> NDArray[np.uint8]:
    """Read a color image, shape ``(H, W, 3)``."""
    from PIL import Image

    if not is_file(path):
        raise FileFormatError(f"{path}: no such file")
    require_content(path, "a color image", images=False)
    with reading(path, "a color image"), Image.open(path) as picture:
        return np.asarray(picture.convert("RGB"))


def depth_size(path: Path) -> tuple[int, int]:
    """Return width and height of a depth image [px]."""
    if path.suffix.lower() == ".npy":
        shape = read_array(path).shape
        if len(shape) != 2:
            raise FileFormatError(f"{path}: expected a depth image of shape (H, W), got {shape}")
        return shape[1], shape[0]
    size = image_size(path.parent, [path.name])
    if size is None:
        raise FileFormatError(f"{path}: is not an image, or damaged")
    return size


def images_in(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Return the images in a folder, sorted by the numbers in their names."""
    with reading(folder, "a folder of images"):
        files = [path for path in folder.iterdir() if path.suffix.lower() in suffixes and path.is_file()]
    return sorted(files, key=lambda path: ([float(number) for number in numbers_in(path.stem)], path.name))


def depth_images_in(folder: Path) -> list[Path]:
    """Return the depth images in a folder, at least one."""
    found = images_in(folder, _DEPTH_SUFFIXES)
    if not found:
        raise FileFormatError(f"{folder}: has no depth images, {', '.join(_DEPTH_SUFFIXES)}")
    return found


def numbers_in(name: str) -> list[str]:
    """Return the numbers in a name, with decimals."""
    return re.findall(r"\d+(?:\.\d+)?", name)


def match_colors(depths: Sequence[Path], folder: Path | None) -> list[Path | None] | None:
    """Return the color image of each depth image, by the first number in their names; None without a folder."""
    colors = images_in(folder, _COLOR_SUFFIXES) if folder is not None else []
    if not colors:
        return None
    by_number = {_key(path): path for path in colors}
    return [by_number.get(_key(path)) for path in depths]


def _key(path: Path) -> float | str:
    numbers = numbers_in(path.stem)
    return float(numbers[0]) if numbers else path.stem


def existing(listing: Path, depths: list[Path]) -> NDArray[np.int64]:
    """Return the indices of the depth images that exist, of those in a list; warn if some are missing."""
    exist = np.array([is_file(path) for path in depths], dtype=bool)
    missing = np.flatnonzero(~exist)
    if len(missing) == len(depths):
        first = f", the first is {depths[0]}" if depths else ""
        raise FileFormatError(f"{listing}: none of the {pluralize(len(depths), 'depth image')} exists{first}")
    if len(missing):
        warn_user(
            f"{listing}: {len(missing)} of {len(depths)} depth images do not exist and are left out, the first is "
            f"{depths[missing[0]]}",
            UserWarning,
        )
    return np.flatnonzero(exist)
