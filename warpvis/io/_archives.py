# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Archives and compressed files, unpacked into memory up to a size limit, and the same limit for other files.

rosbags allocates what the lengths in an MCAP file (https://mcap.dev/spec) specify, which may be anything in a damaged
file, so they are checked before.
"""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import os
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from warpvis.core.checks import describe_exception
from warpvis.errors import FileFormatError

_TARS = (".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz")
_ZIPS = (".zip", ".zae")
_SINGLE = (".gz", ".bz2", ".xz")

ARCHIVES = (*_ZIPS, *_TARS, *_SINGLE)
"""File name suffixes of archives."""

_Stream = IO[bytes] | gzip.GzipFile | bz2.BZ2File | lzma.LZMAFile

# A few thousand bytes can unpack to any size.
_MAX_BYTES = 1 << 30
_PIECE = 1 << 20

_MCAP_MAGIC = b"\x89MCAP0\r\n"
_MCAP_HEAD = 9
"""Bytes before the content of a record: its kind, and its length."""
_FOOTER, _CHUNK, _CHUNK_INDEX = 2, 6, 8
_UNPACKED = slice(16, 24)
"""Bytes of a chunk that store its uncompressed length."""
_FIX = "write it in smaller chunks"
_MCAP_SIZES = 16
"""Bytes at the end of a chunk index: its stored and its uncompressed length."""


def is_archive(name: str) -> bool:
    """Return whether a file name is that of an archive."""
    return name.lower().endswith(ARCHIVES)


def check_unpacked(path: Path, size: int, fix: str = "unpack it first") -> None:
    """Raise an error if a file unpacks to more than 1 GiB."""
    if size > _MAX_BYTES:
        raise FileFormatError(f"{path}: unpacks to more than 1 GiB, the maximum: {fix}")


def unpack(path: Path, zipped: bytes | None = None) -> dict[str, bytes]:
    """Return the files of an archive by name, in order; a compressed file is named without its suffix.

    The suffix of `path` determines the kind; `zipped` is the content of a ZIP file with any name.
    """
    found: dict[str, bytes] = {}
    size = 0
    try:
        for name, stream, stored_size in _members(path, zipped):
            check_unpacked(path, size + stored_size)  # before it takes memory
            with stream:
                found[name] = _read(stream, _MAX_BYTES - size + 1)
            size += len(found[name])
            check_unpacked(path, size)
    except FileFormatError:
        raise
    except Exception as error:  # each library raises its own exceptions
        raise FileFormatError(f"{path}: cannot be unpacked: {describe_exception(error)}") from None
    return found


def _read(stream: _Stream, max_bytes: int) -> bytes:
    """Read up to `max_bytes` bytes, in pieces, since libraries hold data read at once twice."""
    buffer = io.BytesIO()
    while piece := stream.read(min(_PIECE, max_bytes - buffer.tell())):
        buffer.write(piece)
    return buffer.getvalue()


def _members(path: Path, zipped: bytes | None) -> Iterator[tuple[str, _Stream, int]]:
    """Yield the files of an archive, with the size stored in the archive, or 0 if not stored."""
    name = path.name.lower()
    if zipped is not None or name.endswith(_ZIPS):
        with zipfile.ZipFile(path if zipped is None else io.BytesIO(zipped)) as archive:
            check_unpacked(path, sum(info.file_size for info in archive.infolist()))
            for info in archive.infolist():
                if not info.is_dir():
                    yield info.filename, archive.open(info), info.file_size
    elif name.endswith(_TARS):
        with tarfile.open(path, "r:*") as archive:
            for member in archive:
                stream = archive.extractfile(member) if member.isfile() else None
                if stream is not None:
                    yield member.name, stream, member.size
    else:
        kind = path.suffix.lower()
        yield path.stem, gzip.open(path) if kind == ".gz" else bz2.open(path) if kind == ".bz2" else lzma.open(path), 0


def check_mcap(bag: Path) -> None:
    """Reject MCAP files of a bag with a record longer than the file, or a chunk that unpacks to more than 1 GiB."""
    for path in sorted(bag.glob("*.mcap")) if bag.is_dir() else [bag]:
        if path.suffix.lower() == ".mcap" and path.is_file():
            _check_mcap_file(path)


def _check_mcap_file(path: Path) -> None:
    size = os.path.getsize(path)
    with path.open("rb") as file:
        if file.read(len(_MCAP_MAGIC)) != _MCAP_MAGIC:
            return  # rosbags reports it
        while len(head := file.read(_MCAP_HEAD)) == _MCAP_HEAD and head[0] != _FOOTER:
            start, length = file.tell(), int.from_bytes(head[1:], "little")
            if start + length > size:
                raise ValueError(f"{path.name} has a record of {length} bytes at byte {start}, and {size} in all")
            if head[0] == _CHUNK_INDEX and length >= _MCAP_SIZES:
                file.seek(start + length - _MCAP_SIZES)
                sizes = file.read(_MCAP_SIZES)
                stored = int.from_bytes(sizes[:8], "little")
                if stored > size:
                    raise ValueError(f"{path.name} has a chunk of {stored} bytes, and {size} in all")
                check_unpacked(path, int.from_bytes(sizes[8:], "little"), _FIX)
            if head[0] == _CHUNK and length >= _UNPACKED.stop:
                file.seek(start)
                check_unpacked(path, int.from_bytes(file.read(_UNPACKED.stop)[_UNPACKED], "little"), _FIX)
            file.seek(start + length)
