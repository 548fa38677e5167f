# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Archives and compressed files, unpacked into memory up to a size limit."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
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


def is_archive(name: str) -> bool:
    """Return whether a file name is that of an archive."""
    return name.lower().endswith(ARCHIVES)


def check_unpacked(path: Path, size: int, fix: str = "unpack it first") -> None:
    """Raise an error if a file unpacks to more than 1 GiB."""
    if size > _MAX_BYTES:
        raise FileFormatError(f"{path}: unpacks to more than 1 GiB, the maximum: {fix}")


def unpack(path: Path, zipped: bytes | None = None) -> dict[str, bytes]:
    """Return the files of an archive by name, in order; a compressed file is named without its suffix.

    Args:
        path: The archive; its suffix determines the kind.
        zipped: Content of a ZIP file with any name.
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
