# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""How the commands write: folders, JSON and tables."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from warpvis.errors import FileFormatError


def make_folder(path: Path) -> None:
    """Make a folder and those above it.

    Raises:
        FileFormatError: It cannot be made.
    """
    there = next((place for place in (path, *path.parents) if place.exists()), path)
    if there.is_file():
        raise FileFormatError(f"{there}: is a file; a folder is wanted")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be made a folder: {error.strerror}") from None


def require_place(path: Path, suffixes: Sequence[str]) -> None:
    """Refuse, before anything is computed, a file that could not be written.

    Raises:
        FileFormatError: Its name has another ending, it is a folder, or the folder for it is missing.
    """
    if path.suffix.lower() not in suffixes:
        raise FileFormatError(f"{path}: the name must end in {' or '.join(suffixes)}")
    if path.is_dir():
        raise FileFormatError(f"{path}: cannot be written: it is a folder")
    if not path.parent.is_dir():
        raise FileFormatError(f"{path}: cannot be written: there is no folder {path.parent}")


def write_json(path: Path, content: Mapping[str, object]) -> None:
    """Write plain Python values as JSON.

    Raises:
        FileFormatError: The file cannot be written.
    """
    try:
        path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be written: {error.strerror}") from None


def format_rows(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Write a table of fixed width as text."""
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    lines = [header, ["-" * width for width in widths], *rows]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)
