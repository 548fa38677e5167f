# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Where a dataset's files go: a shard's temporary folder."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from warpvis.batch.storage._direct_io import FilePart, write_file


class FileSum(NamedTuple):
    """What a file holds."""

    bytes: int
    crc32: int


class ShardFiles:
    """The files of one shard, or of the index, while they are written: in a folder of their own.

    Several threads may write different files of it.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        """Write below `folder`, which is there and empty."""
        self.folder = Path(folder)
        self._root = os.path.join(folder, "")  # of as many files a second as cores encode, joining paths shows
        self.warnings: dict[str, int] = {}
        self._sums: dict[str, FileSum] = {}
        self._folders = {""}

    def write(self, name: str, *parts: FilePart) -> None:
        """Write one file from its parts, in order.

        Args:
            name: Its path in the dataset, relative, with slashes. Folders are made.
            *parts: Bytes, memoryviews, or NumPy arrays, whose bytes are written in C order. An array that begins at a
                page of memory and at a multiple of 4096 bytes in the file is written the fastest way there is.
        """
        self._sums[name] = FileSum(*write_file(self._path(name), parts))

    def write_text(self, name: str, text: str) -> None:
        """Write one file of UTF-8 text."""
        self.write(name, text.encode())

    def local_path(self, name: str) -> Path:
        """Say where a library that writes files itself must write the file; the folder for it is made."""
        return Path(self._path(name))

    def _path(self, name: str) -> str:
        folder = name.rpartition("/")[0]
        if folder not in self._folders:
            (self.folder / folder).mkdir(parents=True, exist_ok=True)
            self._folders.add(folder)
        return f"{self._root}{name}"

    def warn(self, message: str, count: int) -> None:
        """Tell the user of something at the end, with its count over all shards.

        Args:
            message: What happened to so many, e.g. ``"pixels are farther than 65.535 m and are 0 in the PNG files"``.
            count: How many; 0 says nothing.
        """
        if count:
            self.warnings[message] = self.warnings.get(message, 0) + int(count)

    def sums(self) -> dict[str, FileSum]:
        """Return bytes and checksum of every file in the folder, by name, sorted."""
        names = sorted(files_below(self.folder))
        return {name: self._sums.get(name) or _sum_file(self.folder / name) for name in names}


def files_below(folder: Path) -> Iterator[str]:
    """Go through all files of a folder and those in it: their paths relative to it, with slashes."""
    for place, _, names in os.walk(folder):
        inside = os.path.relpath(place, folder).replace(os.sep, "/")
        yield from (name if inside == "." else f"{inside}/{name}" for name in names)


def _sum_file(path: Path) -> FileSum:
    size = crc = 0
    with path.open("rb") as stream:
        while data := stream.read(1 << 20):
            size, crc = size + len(data), zlib.crc32(data, crc)
    return FileSum(size, crc)
