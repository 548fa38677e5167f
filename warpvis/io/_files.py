# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Readers of text and archives, with uniform error messages and a limit of the unpacked size."""

from __future__ import annotations

import bz2
import gzip
import io
import json
import lzma
import os
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from warpvis.core import numpy_files
from warpvis.core.checks import describe_exception
from warpvis.core.file_content import read_text
from warpvis.core.numpy_files import check_unpacked
from warpvis.core.types import Json
from warpvis.errors import FileFormatError

_LONGEST_SHOWN = 60

_TARS = (".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz")
_ZIPS = (".zip", ".zae")
_SINGLE = (".gz", ".bz2", ".xz")

ARCHIVES = (*_ZIPS, *_TARS, *_SINGLE)
"""File name suffixes of archives."""

_Stream = IO[bytes] | gzip.GzipFile | bz2.BZ2File | lzma.LZMAFile

_PIECE = 1 << 20

# rosbags allocates what the lengths in an MCAP file (https://mcap.dev/spec) specify, which may be anything in a damaged
# file, so they are checked before.
_MCAP_MAGIC = b"\x89MCAP0\r\n"
_MCAP_HEAD = 9
"""Bytes before the content of a record: its kind, and its length."""
_FOOTER, _CHUNK, _CHUNK_INDEX = 2, 6, 8
_UNPACKED = slice(16, 24)
"""Bytes of a chunk that store its uncompressed length."""
_FIX = "write it in smaller chunks"
_MCAP_SIZES = 16
"""Bytes at the end of a chunk index: its stored and its uncompressed length."""


def as_numbers(value: Json, shape: tuple[int, ...], location: str) -> NDArray[np.float64]:
    """Convert a JSON value to an array of finite numbers; `location` begins the message: its location, and its name."""
    leaves = _leaves(value, shape)
    if leaves is not None and all(type(leaf) is float or type(leaf) is int for leaf in leaves):
        try:
            numbers = np.array(leaves, dtype=np.float64)
        except OverflowError:  # integers may have any number of digits
            numbers = np.array([np.inf])
        if np.isfinite(numbers).all():
            return numbers.reshape(shape)
    expected = f"{' x '.join(map(str, shape))} finite numbers" if shape else "a finite number"
    raise FileFormatError(f"{location} must be {expected}, got {shorten(value)}")


def shorten(value: Json) -> str:
    """Return a short text of a value for messages: its kind, or its beginning."""
    if isinstance(value, dict):
        return "an object"
    if isinstance(value, list) and value and isinstance(value[0], list | dict):
        return f"a list of {len(value)} lists or objects"
    try:
        text = json.dumps(value)
    except (ValueError, RecursionError):
        return "a value that cannot be shown"
    return text if len(text) <= _LONGEST_SHOWN else text[:_LONGEST_SHOWN] + "..."


def _leaves(value: Json, shape: tuple[int, ...]) -> list[Json] | None:
    """Return the elements of nested lists; None if their shape differs."""
    items = [value]
    for size in shape:
        lists = [item for item in items if isinstance(item, list) and len(item) == size]
        if len(lists) < len(items):
            return None
        items = [element for each in lists for element in each]
    return items


def read_rows(path: Path, line: str) -> Iterator[tuple[str, str]]:
    """Yield location and content of the lines of a text file, except empty ones and those that begin with ``#``."""
    for number, content in enumerate(read_lines(path, line), start=1):
        if content.strip() and not content.lstrip().startswith("#"):
            yield f"{path}:{number}", content


def read_lines(path: Path, line: str) -> list[str]:
    """Read the lines of a text file; `line` is the expected format of a line, for the message."""
    return read_text(path, f"a text file of lines '{line}'").splitlines()


def is_archive(name: str) -> bool:
    """Return whether a file name is that of an archive."""
    return name.lower().endswith(ARCHIVES)


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
                found[name] = _read(stream, numpy_files.MAX_UNPACKED - size + 1)
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
