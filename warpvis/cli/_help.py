# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Help texts of options: without line breaks, and without a default if it is None or empty."""

from __future__ import annotations

import ast
import inspect
import sys
from functools import cache
from itertools import pairwise
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import tyro

_Class = TypeVar("_Class", bound=type)
_Config = type(tyro.conf.arg())


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
            metavar=settings.get("metavar") or _metavar(kind), help=text or None, help_behavior_hint=_default
        )
        annotations = [item for item in extras if item not in configs]
        command.__annotations__[name] = Annotated[(kind, *annotations, config)]
    return command


def _default(text: str) -> str:
    return "" if text in ("", "None") else f"(default: {text})"


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
