# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Check of the lengths in MCAP files: rosbags allocates what they specify, which may be anything in a damaged file.

Format: https://mcap.dev/spec
"""

from __future__ import annotations

import os
from pathlib import Path

from warpvis.io._archives import check_unpacked

_MAGIC = b"\x89MCAP0\r\n"
_HEAD = 9
"""Bytes before the content of a record: its kind, and its length."""
_FOOTER, _CHUNK, _CHUNK_INDEX = 2, 6, 8
_UNPACKED = slice(16, 24)
"""Bytes of a chunk that store its uncompressed length."""
_FIX = "write it in smaller chunks"
_SIZES = 16
"""Bytes at the end of a chunk index: its stored and its uncompressed length."""


def check_mcap(bag: Path) -> None:
    """Reject MCAP files of a bag in which a record is longer than the file, or a chunk unpacks to more than 1 GiB.

    Args:
        bag: A file, or a folder of files; files with other suffixes are skipped.
    """
    for path in sorted(bag.glob("*.mcap")) if bag.is_dir() else [bag]:
        if path.suffix.lower() == ".mcap" and path.is_file():
            _check_file(path)


def _check_file(path: Path) -> None:
    size = os.path.getsize(path)
    with path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            return  # rosbags reports it
        while len(head := file.read(_HEAD)) == _HEAD and head[0] != _FOOTER:
            start, length = file.tell(), int.from_bytes(head[1:], "little")
            if start + length > size:
                raise ValueError(f"{path.name} has a record of {length} bytes at byte {start}, and {size} in all")
            if head[0] == _CHUNK_INDEX and length >= _SIZES:
                file.seek(start + length - _SIZES)
                sizes = file.read(_SIZES)
                stored = int.from_bytes(sizes[:8], "little")
                if stored > size:
                    raise ValueError(f"{path.name} has a chunk of {stored} bytes, and {size} in all")
                check_unpacked(path, int.from_bytes(sizes[8:], "little"), _FIX)
            if head[0] == _CHUNK and length >= _UNPACKED.stop:
                file.seek(start)
                check_unpacked(path, int.from_bytes(file.read(_UNPACKED.stop)[_UNPACKED], "little"), _FIX)
            file.seek(start + length)
