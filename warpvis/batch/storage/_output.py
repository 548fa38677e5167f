# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Temporary folders for the files of a shard."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from warpvis.batch.storage._direct_io import FilePart, write_file


class FileSum(NamedTuple):
    """Size and checksum of a file."""

    bytes: int
    crc32: int


class ShardFiles:
    """The files of one shard, or of the index, in a temporary folder; several threads may write different files."""

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        """Write to `folder`, which must exist and be empty."""
        self.folder = Path(folder)
        self._root = os.path.join(
            folder, ""
        )  # joining strings is faster than joining paths, which is noticeable for small files
        self.warnings: dict[str, int] = {}
        self._sums: dict[str, FileSum] = {}
        self._folders = {""}

    def write(self, name: str, *parts: FilePart) -> None:
        """Write one file from its parts, in order.

        Args:
            name: Path relative to the dataset, with slashes. Missing folders are created.
            *parts: Bytes, memoryviews, or NumPy arrays, which are written in C order. Arrays that begin at a page
                boundary in memory and at a multiple of 4096 bytes in the file are written with O_DIRECT.
        """
        self._sums[name] = FileSum(*write_file(self._path(name), parts))

    def write_text(self, name: str, text: str) -> None:
        """Write one file of UTF-8 text."""
        self.write(name, text.encode())

    def local_path(self, name: str) -> Path:
        """Return the path of a file for libraries that write files themselves; its folder is created."""
        return Path(self._path(name))

    def _path(self, name: str) -> str:
        folder = name.rpartition("/")[0]
        if folder not in self._folders:
            (self.folder / folder).mkdir(parents=True, exist_ok=True)
            self._folders.add(folder)
        return f"{self._root}{name}"

    def warn(self, message: str, count: int) -> None:
        """Record a warning, which is shown to the user at the end with its total count over all shards.

        Args:
            message: The end of the message after the count, such as
                ``"pixels are farther than 65.535 m and are 0 in the PNG files"``.
            count: The count; nothing is recorded if it is 0.
        """
        if count:
            self.warnings[message] = self.warnings.get(message, 0) + int(count)

    def sums(self) -> dict[str, FileSum]:
        """Return size and checksum of each file in the folder, sorted by name."""
        names = sorted(files_below(self.folder))
        return {name: self._sums.get(name) or _sum_file(self.folder / name) for name in names}


def files_below(folder: Path) -> Iterator[str]:
    """Yield the paths of all files in a folder and its subfolders, relative to it, with slashes."""
    for parent, _, names in os.walk(folder):
        relative = os.path.relpath(parent, folder).replace(os.sep, "/")
        yield from (name if relative == "." else f"{relative}/{name}" for name in names)


def _sum_file(path: Path) -> FileSum:
    size = crc = 0
    with path.open("rb") as stream:
        while data := stream.read(1 << 20):
            size, crc = size + len(data), zlib.crc32(data, crc)
    return FileSum(size, crc)
