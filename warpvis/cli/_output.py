# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Help texts of options, and output of the commands: folders, JSON and tables.

Help has no line breaks, and no default if it is None or empty.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import tyro

from warpvis.core.file_content import writing
from warpvis.errors import FileFormatError

# Messages about files begin with their names.
_OF_FILE = re.compile(r"\S+\.\w+:")

# Arguments whose options have different names.
_OTHER_NAMES = {"options": "option", "seed": "sensor_seed", "frames": "poses"}

_Class = TypeVar("_Class", bound=type)
_Config = type(tyro.conf.arg())


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

    def as_option(found: re.Match[str]) -> str:
        value = found[2].strip('"')
        return options[found[1]] if value in ("", "True") else f"{options[found[1]]} {value}"

    message = re.sub(rf"(?<![\w.-])({names})=(\"[^\"]*\"|[\w.]*)", as_option, message)
    with_lines = "|".join(name for name in options if "_" in name)
    if with_lines and not _OF_FILE.match(message):
        message = re.sub(rf"(?<![\w./-])({with_lines})(?![\w.])", lambda found: options[found[1]], message)
    return re.sub(rf"^({names})(?= (of \S+ )?must )", lambda found: options[found[1]], message)


def with_help(command: _Class) -> _Class:
    """Return a dataclass of options with the help that tyro shows.

    An option's help is its docstring, without the line breaks that tyro would keep, or else that of its type. If its
    default is None or empty, its help shows no default, and ``None`` is not among its values.
    """
    hints, texts = get_type_hints(command, include_extras=True), _docstrings(command)
    for name in inspect.get_annotations(command):
        kind, *extras = get_args(hints[name]) if get_origin(hints[name]) is Annotated else (hints[name],)
        configs = [item for item in extras if isinstance(item, _Config)]
        settings = {key: value for item in configs for key, value in vars(item).items() if value is not None}
        text = texts.get(name) or settings.get("help") or ""
        config = tyro.conf.arg(
            metavar=settings.get("metavar") or _metavar(kind),
            help=text or None,
            help_behavior_hint=lambda default: "" if default in ("", "None") else f"(default: {default})",
        )
        annotations = [item for item in extras if item not in configs]
        command.__annotations__[name] = Annotated[(kind, *annotations, config)]
    return command


def _metavar(kind: Any) -> str | None:
    """Return the metavar of an optional value, without None; None for all other types."""
    parts = get_args(kind)
    if get_origin(kind) not in (Union, UnionType) or NoneType not in parts:
        return None
    words = [
        f"{{{','.join(get_args(part))}}}" if get_origin(part) is Literal else part.__name__.upper()
        for part in parts
        if part is not NoneType
    ]
    return "|".join(words)


def _docstrings(command: type) -> dict[str, str]:
    """Return the docstrings of a class's fields, each as one line; empty if the source is not available."""
    body = _classes(command.__module__).get(command.__name__, [])
    texts = {}
    for field, after in pairwise(body):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            match after:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    texts[field.target.id] = " ".join(text.split())
    return texts


@cache
def _classes(module: str) -> dict[str, list[ast.stmt]]:
    """Parse a module once, and return the bodies of its classes."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError):
        return {}
    return {item.name: item.body for item in tree.body if isinstance(item, ast.ClassDef)}
