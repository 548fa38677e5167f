# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Check single arguments: integers, numbers, paths. `warpvis.core.arrays` checks arrays."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any, TypeGuard

from warpvis.errors import ArrayError, FileFormatError, WarpvisError

# Longest component of a path that file systems support [bytes].
_LONGEST_NAME = 255

# Longest third-party text in an error message [characters].
_MAX_MESSAGE = 300

# Exceptions that file readers raise accidentally on damaged files; their messages describe the reader, not the file.
_STUMBLES = (ArithmeticError, AssertionError, AttributeError, LookupError, NameError, StopIteration, TypeError)


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value is a Python or NumPy real number in the range of double precision; inf and NaN count."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return False
    try:
        float(value)
    except OverflowError:
        return False
    return True


def is_whole(value: object) -> TypeGuard[int]:
    """Return whether a value is a Python or NumPy integer."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def with_article(name: str) -> str:
    """Return the name of an agent with an article, unless it begins with a capital letter: "the robot", "Ada"."""
    return name if name[:1].isupper() else f"the {name}"


def pluralize(count: int, noun: str) -> str:
    """Format a count with its noun for messages: ``1 frame``, ``2 frames``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def format_fraction(fraction: float, *, digits: int = 2) -> str:
    """Format a fraction with decimals: ``0.25``, or ``<0.01`` and ``>0.99`` where it would round to 0 or 1."""
    return _round_between(fraction, 1, digits)


def format_percent(fraction: float, *, digits: int = 0) -> str:
    """Format a fraction in percent: ``25 %``, or ``<1 %`` and ``>99 %`` where it would round to 0 or 100."""
    return f"{_round_between(100 * fraction, 100, digits)} %"


def _round_between(value: float, limit: int, digits: int) -> str:
    """Format a number with decimals, or as a bound where it would round to 0 or `limit` without being equal to it."""
    text, step = f"{value:.{digits}f}", 10.0**-digits
    if value > 0 and float(text) == 0:
        return f"<{step:.{digits}f}"
    if value < limit and float(text) == limit:
        return f">{limit - step:.{digits}f}"
    return text


def check_whole(value: object, name: str, *, minimum: int = 1, error: type[WarpvisError] = ArrayError) -> int:
    """Check that `value` is an integer of at least `minimum`, and return it."""
    if not is_whole(value) or value < minimum:
        raise error(f"{name} must be a whole number from {minimum} up, got {value!r}")
    return int(value)


def check_number(
    value: object,
    name: str,
    *,
    minimum: float = -math.inf,
    maximum: float = math.inf,
    error: type[WarpvisError] = ArrayError,
) -> float:
    """Check that `value` is a finite number within limits, and return it."""
    if not is_number(value) or not math.isfinite(value) or not minimum <= value <= maximum:
        limits = "a finite number" if minimum == -math.inf else f"a finite number from {minimum:g} up"
        limits = limits if maximum == math.inf else f"a number from {minimum:g} to {maximum:g}"
        raise error(f"{name} must be {limits}, got {value!r}")
    return float(value)


def check_angle(
    value: object,
    name: str,
    *,
    minimum: float = -math.inf,
    maximum: float = math.inf,
    error: type[WarpvisError] = ArrayError,
) -> float:
    """Check that `value` is a finite angle within limits [rad], and return it.

    Integers beyond a full turn are rejected because they are degrees: such an angle in radians is not an integer.
    """
    if not is_number(value) or not math.isfinite(value) or not minimum <= value <= maximum:
        limits = "a finite number of radians" if maximum == math.inf else f"from {minimum:.6g} to {maximum:.6g} radians"
        raise error(f"{name} must be {limits}, got {value!r}{degrees_hint(value)}")
    if abs(value) > 2.0 * math.pi and float(value).is_integer():
        raise error(f"{name} must be in radians, got {value!r}{degrees_hint(value)}")
    return float(value)


def degrees_hint(value: object) -> str:
    """Return the end of an error message about an angle [rad]: a suggestion, if the value is probably in degrees."""
    if not is_number(value) or not math.pi < abs(value) < math.inf:
        return ""
    return f"; angles are in radians: pass math.radians({value!r}) for degrees"


def check_choice(value: object, name: str, choices: Collection[str], error: type[WarpvisError] = ArrayError) -> str:
    """Check that `value` is one of `choices`, and return it."""
    if not isinstance(value, str) or value not in choices:
        *initial, last = (f'"{choice}"' for choice in choices)
        raise error(f"{name} must be {', '.join(initial)} or {last}, got {value!r}")
    return value


def check_flag(value: object, name: str, error: type[WarpvisError] = ArrayError) -> bool:
    """Check that `value` is a boolean, or the integer 0 or 1, and return it as bool."""
    if type(value).__name__ in ("bool", "bool_") or (is_whole(value) and value in (0, 1)):
        return bool(value)
    raise error(f"{name} must be True or False, got {value!r}")


def check_mapping(value: object, name: str, error: type[WarpvisError] = ArrayError) -> Mapping[Any, Any]:
    """Check that `value` is a mapping, and return it."""
    if not isinstance(value, Mapping):
        raise error(f"{name} must be a mapping, got {value!r}")
    return value


def check_text(value: object, name: str, error: type[WarpvisError] = ArrayError) -> str:
    """Check that `value` is a string, and return it."""
    if not isinstance(value, str):
        raise error(f"{name} must be text, got {value!r}")
    return value


def as_items(value: object, name: str, error: type[WarpvisError] = ArrayError) -> list[Any]:
    """Convert an iterable to a list; a string is a single item."""
    if isinstance(value, str):
        return [value]
    if not isinstance(value, Iterable) or isinstance(value, bytes):
        raise error(f"{name} must be a list, got {value!r}")
    try:
        return list(value)
    except (TypeError, RuntimeError):  # zero-dimensional arrays have `__iter__` but raise when iterated
        raise error(f"{name} must be a list, got {value!r}") from None


def as_path(path: object, name: str = "path") -> Path:
    """Convert a string or `os.PathLike` to a path. Numbers are rejected: `open` treats them as file descriptors."""
    text = path if isinstance(path, str) else os.fspath(path) if isinstance(path, os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise FileFormatError(f"{name} must be the name of a file, text or an os.PathLike, got {path!r}")
    if max(len(os.fsencode(part)) for part in Path(text).parts or ("",)) > _LONGEST_NAME:
        raise FileFormatError(f"{name} is too long for the name of a file: {text[:40]!r}...")
    return Path(text)


def describe_exception(error: BaseException) -> str:
    """Describe an exception of third-party code as part of a single sentence with a limited length."""
    message = " ".join(str(error).split())
    if isinstance(error, MemoryError):
        message = "it asks for more memory than there is"
    elif isinstance(error, RecursionError):
        message = "it is nested too deeply"
    elif isinstance(error, _STUMBLES):
        message = f"it is damaged, or something else ({type(error).__name__}{': ' if message else ''}{message})"
    message = message or type(error).__name__
    return truncate(message, _MAX_MESSAGE)


def truncate(text: str, max_length: int = 120) -> str:
    """Shorten a text to `max_length` characters for a message, by keeping its beginning and its end."""
    end = max_length // 3
    return text if len(text) <= max_length else f"{text[: max_length - end - 3]}...{text[-end:]}"
