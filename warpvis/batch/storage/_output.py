# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Temporary folders for the files of a shard; large files bypass the page cache with O_DIRECT."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

FilePart: TypeAlias = bytes | memoryview | np.ndarray
"""Part of a file to write; arrays are written in C order."""

ALIGNMENT = 4096
"""Alignment of addresses, offsets and lengths that O_DIRECT requires [B]."""

# Writing through the page cache takes 1 s of kernel time on one core for 250 to 700 MB, O_DIRECT 0.2 s per GB. With two
# cores that render 1.2 GB/s, the page cache would slow down rendering. For small parts O_DIRECT has no advantage.
MIN_DIRECT = 1 << 20
_PIECE = 1 << 23
_O_DIRECT = getattr(os, "O_DIRECT", 0)


class FileSum(NamedTuple):
    """Size and checksum of a file."""

    bytes: int
    crc32: int


class ShardFiles:
    """The files of one shard, or of the index, in a temporary folder; several threads may write different files."""

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        """Write to `folder`, which must exist and be empty."""
        self.folder = Path(folder)
        self._root = os.path.join(folder, "")  # joining strings is noticeably faster than joining paths
        self.warnings: dict[str, int] = {}
        self._sums: dict[str, FileSum] = {}
        self._folders = {""}

    def write(self, name: str, *parts: FilePart) -> None:
        """Write one file from its parts, in order; `name` is relative to the dataset, with slashes.

        Arrays that begin at a page boundary in memory and at a multiple of 4096 bytes in the file are written with
        O_DIRECT.
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
        """Record a warning, if `count` is not 0, which is shown at the end with its total count over all shards.

        The message follows the count, such as ``"pixels are farther than 65.535 m and are 0 in the PNG files"``.
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


def write_file(path: str | os.PathLike[str], parts: Iterable[FilePart]) -> tuple[int, int]:
    """Write a new file from its parts, and return its size in bytes and its CRC-32.

    Parts are bytes-like objects or NumPy arrays. If a part begins at a page boundary in memory and at a multiple of
    `ALIGNMENT` in the file, its whole pages bypass the page cache, if the system supports this.
    """
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
    try:
        size = crc = 0
        for part in parts:
            data = _as_bytes(part)
            direct = _direct_bytes(data, size)
            if direct:
                crc, direct = _write_direct(descriptor, data[:direct], crc)
            crc = _write_all(descriptor, data[direct:], crc)
            size += len(data)
        return size, crc
    finally:
        os.close(descriptor)


def _as_bytes(part: FilePart) -> memoryview:
    if isinstance(part, np.ndarray):
        return np.ascontiguousarray(part).reshape(-1).view(np.uint8).data
    return memoryview(part).cast("B")


def _direct_bytes(data: memoryview, offset: int) -> int:
    """Return the number of leading bytes that can be written with O_DIRECT."""
    if not _O_DIRECT or len(data) < MIN_DIRECT or offset % ALIGNMENT:
        return 0
    address = np.frombuffer(data, dtype=np.uint8).ctypes.data
    return 0 if address % ALIGNMENT else len(data) // ALIGNMENT * ALIGNMENT


def _write_direct(descriptor: int, data: memoryview, crc: int) -> tuple[int, int]:
    """Write with O_DIRECT; return the checksum and the number of written bytes, which is less if it is unsupported."""
    import fcntl

    flags = fcntl.fcntl(descriptor, fcntl.F_GETFL)
    done = 0
    try:
        fcntl.fcntl(descriptor, fcntl.F_SETFL, flags | _O_DIRECT)
        while done < len(data):
            written = os.write(descriptor, data[done : done + _PIECE])
            crc = zlib.crc32(data[done : done + written], crc)
            done += written
            if written % ALIGNMENT:
                break
    except OSError as error:
        import errno

        if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):
            raise
    finally:
        fcntl.fcntl(descriptor, fcntl.F_SETFL, flags)
    return crc, done


def _write_all(descriptor: int, data: memoryview, crc: int) -> int:
    """Write bytes through the page cache, and return the updated checksum."""
    while len(data):
        written = os.write(descriptor, data[:_PIECE])
        crc = zlib.crc32(data[:written], crc)
        data = data[written:]
    return crc
