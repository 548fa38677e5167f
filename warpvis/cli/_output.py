# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Output of the commands: folders, JSON and tables."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path

from warpvis.core.file_content import writing
from warpvis.errors import FileFormatError

# Messages about files begin with their names.
_OF_FILE = re.compile(r"\S+\.\w+:")

# Arguments whose options have different names.
_OTHER_NAMES = {"options": "option", "seed": "sensor_seed", "frames": "poses"}


def make_folder(path: Path) -> None:
    """Create a folder and its parents."""
    existing = next((place for place in (path, *path.parents) if place.exists()), path)
    if existing.is_file():
        raise FileFormatError(f"{existing}: must be a folder, but is a file")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be created: {error.strerror}") from None


def require_place(path: Path, suffixes: Sequence[str]) -> None:
    """Check that a file can be written, before anything is computed."""
    if path.suffix.lower() not in suffixes:
        raise FileFormatError(f"{path}: the name must end in {' or '.join(suffixes)}")
    if path.is_dir():
        raise FileFormatError(f"{path}: cannot be written: it is a folder")
    if not path.parent.is_dir():
        raise FileFormatError(f"{path}: cannot be written: there is no folder {path.parent}")


def write_json(path: Path, content: Mapping[str, object]) -> None:
    """Write plain Python values as JSON."""
    with writing(path):
        path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def format_rows(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table with columns of fixed width."""
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    lines = [header, ["-" * width for width in widths], *rows]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)


def name_options(message: str, command: object) -> str:
    """Replace Python arguments in a message of the library by a command's options.

    ``objects=`` becomes ``--objects``, ``quaternion="wxyz"`` ``--quaternion wxyz``, ``resume=True`` ``--resume``, and
    the first word of ``threads must be ...`` ``--threads``. Names with underscores are replaced anywhere, except in
    messages about files, where they may be keys.
    """
    if not is_dataclass(command):
        return message
    options = {item.name: item.name for item in fields(command)} | _OTHER_NAMES
    options = {name: f"--{option.replace('_', '-')}" for name, option in options.items() if hasattr(command, option)}
    options.pop("file", None)
    names = "|".join(sorted(options, key=len, reverse=True))
    message = re.sub(
        rf"(?<![\w.-])({names})=(\"[^\"]*\"|[\w.]*)", lambda found: _as_option(options[found[1]], found[2]), message
    )
    with_lines = "|".join(name for name in options if "_" in name)
    if with_lines and not _OF_FILE.match(message):
        message = re.sub(rf"(?<![\w./-])({with_lines})(?![\w.])", lambda found: options[found[1]], message)
    return re.sub(rf"^({names})(?= (of \S+ )?must )", lambda found: options[found[1]], message)


def _as_option(option: str, value: str) -> str:
    value = value.strip('"')
    return option if value in ("", "True") else f"{option} {value}"
