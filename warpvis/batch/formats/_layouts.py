# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What the layouts with a file a frame have in common."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from warpvis.batch._job import shard_name
from warpvis.batch.formats._base import Format, check_options
from warpvis.batch.storage._direct_io import FilePart
from warpvis.errors import FileFormatError
from warpvis.io import count_lost, depth_to_units, describe_lost, encode_pngs

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles

Parts: TypeAlias = tuple[FilePart, ...]
"""What a file is written from, in order."""

Row = TypeVar("Row")

_ROWS_AT_ONCE = 4096


class Layout(Format):
    """A format with one file a frame and image: frame j of shard 12 is ``FOLDER/000012/<j in six digits>SUFFIX``.

    A folder holds the files of one shard, so that they appear together.
    """

    encodes = True
    options: ClassVar[Mapping[str, str]] = {}
    """Names of its options, and what messages say of their values."""

    def __init__(self, plan: Plan) -> None:
        """Check the plan's outputs and the names of its options.

        Raises:
            FileFormatError: The format has not those.
        """
        check_options(plan, self.name, self.options)
        foreign = [output for output in plan.outputs if output not in self.outputs]
        if foreign or not plan.outputs:
            has = ", ".join(sorted(self.outputs))
            raise FileFormatError(f"format {self.name!r} holds {has}, not {foreign[0] if foreign else 'nothing'}")
        self.plan = plan

    def write_frames(
        self,
        shard: int,
        folder: str,
        suffix: str,
        count: int,
        make: Callable[[range], Iterable[Parts]],
        files: ShardFiles,
    ) -> str:
        """Write the files of a shard's frames, a few of them on each thread that encodes, and return their folder.

        Args:
            shard: The shard.
            folder: Where its folder goes.
            suffix: How the names of files end.
            count: Frames of the shard.
            make: Makes the files of neighbouring frames, of their numbers in the shard, in order. Each is written
                before it makes the next.
            files: Where to write.
        """
        unit = f"{folder}/{shard_name(shard)}"

        def write_some(frames: range) -> None:
            for frame, parts in zip(frames, make(frames), strict=True):
                files.write(f"{unit}/{frame:06d}{suffix}", *parts)

        camera = self.plan.camera
        self.encode_each(count, camera.width * camera.height, write_some)
        return unit

    def write_depth_pngs(
        self, shard: int, folder: str, depth: NDArray[np.float32], scale: float, files: ShardFiles
    ) -> str:
        """Write depth [m] as 16-bit PNG of `scale` units a metre, 0 where there is none, and return their folder."""
        lost: list[int] = []

        def make(frames: range) -> Iterable[Parts]:
            some = depth[frames.start : frames.stop]
            units = depth_to_units(some, scale)
            lost.append(count_lost(some, units))
            return zip(encode_pngs(units))

        unit = self.write_frames(shard, folder, ".png", len(depth), make, files)
        files.warn(describe_lost(scale), sum(lost))
        return unit

    def write_byte_pngs(self, shard: int, folder: str, images: NDArray[np.uint8], files: ShardFiles) -> str:
        """Write labels, or other numbers of 8 bits, as PNG, and return their folder."""

        def make(frames: range) -> Iterable[Parts]:
            return zip(encode_pngs(images[frames.start : frames.stop]))

        return self.write_frames(shard, folder, ".png", len(images), make, files)

    def frame_names(self, suffix: str) -> Iterator[str]:
        """Go through the names of all frames' files, without the folder in front of the shard's."""
        per_shard = self.plan.shard_frames
        for shard in range(self.plan.shard_count):
            frames = self.plan.shard_slice(shard)
            for frame in range(frames.start, frames.stop):
                yield f"{shard_name(shard)}/{frame - shard * per_shard:06d}{suffix}"

    def positive_option(self, name: str, default: float) -> float:
        """Read a positive number among the options.

        Raises:
            FileFormatError: It is none.
        """
        given = self.plan.options.get(name, default)
        try:
            value = math.nan if isinstance(given, bool) else float(given)
        except (TypeError, ValueError):
            value = math.nan
        if not 0 < value < math.inf:
            raise FileFormatError(f"option {name} must be a positive number, got {given!r}")
        return value

    def flag_option(self, name: str) -> bool:
        """Read a flag among the options, off by default.

        Raises:
            FileFormatError: It is neither true nor false.
        """
        given = self.plan.options.get(name, False)
        if given not in (True, False, "true", "false"):
            raise FileFormatError(f"option {name} must be true or false, got {given!r}")
        return given in (True, "true")

    def label_entries(self) -> dict[str, str]:
        """Name the values of labels, as JSON has them."""
        return {str(number): name for number, name in self.plan.label_names.items()}

    def object_entries(self) -> list[dict[str, str]]:
        """List names and labels of the scene's objects, in the order of their indices."""
        named = zip(self.plan.object_names, self.plan.object_labels, strict=True)
        return [{"name": name, "label": self.plan.label_names.name(label)} for name, label in named]


def rows_of(array: NDArray[np.float64], convert: Callable[[NDArray[np.float64]], list[Row]]) -> Iterator[Row]:
    """Go through an array's rows as Python's numbers, which `convert` makes of some thousand rows at a time."""
    for first in range(0, len(array), _ROWS_AT_ONCE):
        yield from convert(array[first : first + _ROWS_AT_ONCE])


def numbers(values: Iterable[float]) -> str:
    """Write numbers with spaces between, in as many digits as it takes to read the same ones back."""
    return " ".join(map(repr, values))


def write_lines(files: ShardFiles, name: str, lines: Iterable[str]) -> None:
    """Write a text file line by line; it need not fit into memory."""
    with files.local_path(name).open("w", encoding="utf-8", newline="\n") as stream:
        stream.writelines(f"{line}\n" for line in lines)
