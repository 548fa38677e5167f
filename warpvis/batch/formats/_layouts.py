# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Base class of formats with one file per frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar, TypeAlias, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from warpvis.batch._job import shard_name
from warpvis.batch.formats._base import Format
from warpvis.batch.storage._output import FilePart
from warpvis.errors import FileFormatError
from warpvis.io import (
    COLOR_SUFFIXES,
    ColorFile,
    count_lost,
    depth_to_units,
    describe_lost,
    encode_colors,
    encode_pngs,
)

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles

Parts: TypeAlias = tuple[FilePart, ...]
"""The parts of a file, in order."""

Row = TypeVar("Row")

COLOR_OPTIONS: Mapping[str, str] = {"color": "png, jpeg or webp", "quality": "1 to 100 for jpeg and webp, 95"}
"""Options of formats with files of color images."""

SPARSE_POINTS: Mapping[str, str] = {"sparse_points": "number of 3D points, 10000; 0 for none"}
"""Option of formats with sparse points."""

_OF_COLORS = (*COLOR_OPTIONS, *SPARSE_POINTS)
_DEFAULT_QUALITY = 95
_DEFAULT_SPARSE_POINTS = 10_000
_ROWS_AT_ONCE = 4096


class Layout(Format):
    """A format with one file per frame and image: frame j of shard 12 is ``FOLDER/000012/<j in six digits>SUFFIX``.

    Each folder contains the files of one shard, so that they are added to the dataset atomically.
    """

    encodes = True
    color_files: ClassVar[tuple[ColorFile, ...]] = get_args(ColorFile)
    """Supported values of the option ``color``; the first is the default."""

    def __init__(self, plan: Plan) -> None:
        """Prepare to write a dataset: check the outputs and the names of options of its plan."""
        super().__init__(plan)
        self.color_file: ColorFile = self._parse_color_file()
        self.color_suffix = COLOR_SUFFIXES[self.color_file]
        """File name suffix of color images."""
        self._quality = self._parse_quality()
        if self.color_file != "png":
            self.library = f"{self.library or ''} pillow"

    def write_frames(
        self,
        shard: int,
        folder: str,
        suffix: str,
        count: int,
        make: Callable[[range], Iterable[Parts]],
        files: ShardFiles,
    ) -> str:
        """Write the files of the frames of a shard on the encoding threads, and return their folder.

        Args:
            shard: Number of the shard.
            folder: Parent of the folder.
            suffix: Suffix of file names.
            count: Number of frames of the shard.
            make: Function that returns the files for a range of frames, given by their indices in the shard, in order.
                Each file is written before the next one is requested.
            files: Destination of the files.
        """
        unit = f"{folder}/{shard_name(shard)}"

        def write_range(frames: range) -> None:
            for frame, parts in zip(frames, make(frames), strict=True):
                files.write(f"{unit}/{frame:06d}{suffix}", *parts)

        camera = self.plan.camera
        self.encode_each(count, camera.width * camera.height, write_range)
        return unit

    def write_depth_pngs(
        self, shard: int, folder: str, depth: NDArray[np.float32], scale: float, files: ShardFiles
    ) -> str:
        """Write depth [m] as 16-bit PNG with `scale` units per meter, 0 without depth, and return the folder."""
        lost: list[int] = []

        def make(frames: range) -> Iterable[Parts]:
            images = depth[frames.start : frames.stop]
            units = depth_to_units(images, scale)
            lost.append(count_lost(images, units))
            return zip(encode_pngs(units))

        unit = self.write_frames(shard, folder, ".png", len(depth), make, files)
        files.warn(describe_lost(scale), sum(lost))
        return unit

    def write_byte_pngs(self, shard: int, folder: str, images: NDArray[np.uint8], files: ShardFiles) -> str:
        """Write labels or other 8-bit images as PNG, and return their folder."""

        def make(frames: range) -> Iterable[Parts]:
            return zip(encode_pngs(images[frames.start : frames.stop]))

        return self.write_frames(shard, folder, ".png", len(images), make, files)

    def write_colors(self, shard: int, folder: str, images: NDArray[np.uint8], files: ShardFiles) -> str:
        """Write color images as the files that the option ``color`` selects, and return their folder."""

        def make(frames: range) -> Iterable[Parts]:
            return zip(self.encode_colors(images[frames.start : frames.stop]))

        return self.write_frames(shard, folder, self.color_suffix, len(images), make, files)

    def encode_colors(self, images: NDArray[np.uint8]) -> Iterator[bytes]:
        """Encode color images ``(n, H, W, 3)`` as the options specify."""
        return encode_colors(images, self.color_file, self._quality)

    def frame_names(self, suffix: str) -> Iterator[str]:
        """Yield the file names of all frames, starting with the folder of the shard."""
        per_shard = self.plan.shard_frames
        for shard in range(self.plan.shard_count):
            frames = self.plan.shard_slice(shard)
            for frame in range(frames.start, frames.stop):
                yield f"{shard_name(shard)}/{frame - shard * per_shard:06d}{suffix}"

    def positive_option(self, name: str, default: float) -> float:
        """Return a positive number from the options.

        Raises:
            FileFormatError: If the option is not a positive number.
        """
        option = self.plan.options.get(name, default)
        try:
            value = math.nan if isinstance(option, bool) else float(option)
        except (TypeError, ValueError):
            value = math.nan
        if not 0 < value < math.inf:
            raise FileFormatError(f"option {name} must be a positive number, got {option!r}")
        return value

    def flag_option(self, name: str) -> bool:
        """Return a flag from the options, False by default.

        Raises:
            FileFormatError: If the option is neither true nor false.
        """
        option = self.plan.options.get(name, False)
        if option not in (True, False, "true", "false"):
            raise FileFormatError(f"option {name} must be true or false, got {option!r}")
        return option in (True, "true")

    def parse_sparse_points(self) -> int:
        """Return the number of sparse points from the options; 0 without color.

        Raises:
            FileFormatError: If the option is not a whole number.
        """
        default = _DEFAULT_SPARSE_POINTS if "color" in self.plan.outputs else 0
        count = _whole(self.plan.options.get("sparse_points", default))
        if count is None or count < 0:
            value = self.plan.options["sparse_points"]
            raise FileFormatError(f"option sparse_points must be a whole number from 0 up, got {value!r}")
        return count

    def _parse_color_file(self) -> ColorFile:
        for option in _OF_COLORS:
            if option in self.plan.options and not self.plan.has_colors:
                raise FileFormatError(f"option {option} requires the output color, got {', '.join(self.plan.outputs)}")
        value = self.plan.options.get("color", self.color_files[0])
        kind = next((kind for kind in self.color_files if kind == value), None)
        if kind is None:
            raise FileFormatError(f"option color must be {_list(self.color_files)} for {self.name!r}, got {value!r}")
        return kind

    def _parse_quality(self) -> int:
        if "quality" in self.plan.options and self.color_file == "png":
            raise FileFormatError("quality must be given only with color=jpeg or color=webp, got color=png")
        value = self.plan.options.get("quality", _DEFAULT_QUALITY)
        quality = _whole(value)
        if quality is None or not 1 <= quality <= 100:
            raise FileFormatError(f"option quality must be a whole number from 1 to 100, got {value!r}")
        return quality

    def label_entries(self) -> dict[str, str]:
        """Return the names of labels by value, for JSON."""
        return {str(number): name for number, name in self.plan.label_names.items()}

    def object_entries(self) -> list[dict[str, str]]:
        """Return names and labels of the objects of the scene, in the order of their indices."""
        named = zip(self.plan.object_names, self.plan.object_labels, strict=True)
        return [{"name": name, "label": self.plan.label_names.name(label)} for name, label in named]


def _whole(value: str | float) -> int | None:
    """Return an option as a whole number; None if it is not one."""
    try:
        return None if isinstance(value, bool) or float(value) != int(value) else int(value)
    except (TypeError, ValueError, OverflowError):
        return None


def _list(words: tuple[str, ...]) -> str:
    return " or ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def rows_of(array: NDArray[np.float64], convert: Callable[[NDArray[np.float64]], list[Row]]) -> Iterator[Row]:
    """Yield the rows of an array as Python objects; `convert` is called for thousands of rows at a time."""
    for first in range(0, len(array), _ROWS_AT_ONCE):
        yield from convert(array[first : first + _ROWS_AT_ONCE])


def numbers(values: Iterable[float]) -> str:
    """Format numbers separated by spaces, with enough digits for exact conversion back."""
    return " ".join(map(repr, values))


def write_lines(files: ShardFiles, name: str, lines: Iterable[str]) -> None:
    """Write a text file line by line, without holding it in memory."""
    with files.local_path(name).open("w", encoding="utf-8", newline="\n") as stream:
        stream.writelines(f"{line}\n" for line in lines)
