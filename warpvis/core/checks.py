# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What single arguments have to be: whole numbers, numbers, paths. `warpvis.core.arrays` checks arrays."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any, TypeGuard

from warpvis.errors import ArrayError, FileFormatError, WarpvisError

# Of one part of a path [bytes]: what file systems hold.
_LONGEST_NAME = 255

# Of what is said by others, in a message [characters].
_LONGEST_SAID = 300

# What readers of files stumble over where a file is damaged; what they say then is of them, and not of the file.
_STUMBLES = (ArithmeticError, AssertionError, AttributeError, LookupError, NameError, StopIteration, TypeError)


def is_number(value: object) -> TypeGuard[float]:
    """Tell whether a value is a real number, of Python or NumPy, that double precision has; infinity and NaN are."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return False
    try:
        float(value)
    except OverflowError:
        return False
    return True


def is_whole(value: object) -> TypeGuard[int]:
    """Tell whether a value is an integer of Python or NumPy."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def counted(count: int, noun: str) -> str:
    """Write a number of things as messages do: ``1 frame``, ``2 frames``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def format_fraction(fraction: float, *, digits: int = 2) -> str:
    """Return a fraction with decimals: ``0.25``, or ``<0.01`` and ``>0.99`` where it would round to 0 or 1."""
    return _round_between(fraction, 1, digits)


def format_percent(fraction: float, *, digits: int = 0) -> str:
    """Return a fraction in percent: ``25 %``, or ``<1 %`` and ``>99 %`` where it would round to 0 or 100."""
    return f"{_round_between(100 * fraction, 100, digits)} %"


def _round_between(value: float, whole: int, digits: int) -> str:
    """Return a number with decimals, and a bound of it where it would round to 0 or to `whole` but is neither."""
    text, step = f"{value:.{digits}f}", 10.0**-digits
    if value > 0 and float(text) == 0:
        return f"<{step:.{digits}f}"
    if value < whole and float(text) == whole:
        return f">{whole - step:.{digits}f}"
    return text


def check_whole(value: object, name: str, *, least: int = 1, error: type[WarpvisError] = ArrayError) -> int:
    """Return `value` as a whole number from `least` up.

    Raises:
        WarpvisError: It is none; of the class `error`.
    """
    if not is_whole(value) or value < least:
        raise error(f"{name} must be a whole number from {least} up, got {value!r}")
    return int(value)


def check_number(
    value: object,
    name: str,
    *,
    least: float = -math.inf,
    most: float = math.inf,
    error: type[WarpvisError] = ArrayError,
) -> float:
    """Return `value` as a finite number within limits.

    Raises:
        WarpvisError: It is none; of the class `error`.
    """
    if not is_number(value) or not math.isfinite(value) or not least <= value <= most:
        limits = "a finite number" if least == -math.inf else f"a finite number from {least:g} up"
        limits = limits if most == math.inf else f"a number from {least:g} to {most:g}"
        raise error(f"{name} must be {limits}, got {value!r}")
    return float(value)


def check_angle(
    value: object,
    name: str,
    *,
    least: float = -math.inf,
    most: float = math.inf,
    error: type[WarpvisError] = ArrayError,
) -> float:
    """Return `value` as a finite angle within limits [rad].

    Whole numbers beyond a turn are refused, because they are degrees: angles in radians are not whole there.

    Raises:
        WarpvisError: If it is none; of the class `error`.
    """
    if not is_number(value) or not math.isfinite(value) or not least <= value <= most:
        limits = "a finite number of radians" if most == math.inf else f"from {least:.6g} to {most:.6g} radians"
        raise error(f"{name} must be {limits}, got {value!r}{degrees_hint(value)}")
    if abs(value) > 2.0 * math.pi and float(value).is_integer():
        raise error(f"{name} must be in radians, got {value!r}{degrees_hint(value)}")
    return float(value)


def degrees_hint(value: object) -> str:
    """Return the end of a message that refuses an angle [rad]: the remedy, if it looks like one in degrees."""
    if not is_number(value) or not math.pi < abs(value) < math.inf:
        return ""
    return f"; angles are in radians: pass math.radians({value!r}) for degrees"


def check_choice(value: object, name: str, choices: Collection[str], error: type[WarpvisError] = ArrayError) -> str:
    """Return `value` if it is one of the words to choose from.

    Raises:
        WarpvisError: It is none; of the class `error`.
    """
    if not isinstance(value, str) or value not in choices:
        *most, last = (f'"{choice}"' for choice in choices)
        raise error(f"{name} must be {', '.join(most)} or {last}, got {value!r}")
    return value


def check_flag(value: object, name: str, error: type[WarpvisError] = ArrayError) -> bool:
    """Return `value`, if it says yes or no.

    Raises:
        WarpvisError: It is another thing, whatever Python takes it for; of the class `error`.
    """
    if type(value).__name__ in ("bool", "bool_") or (is_whole(value) and value in (0, 1)):
        return bool(value)
    raise error(f"{name} must be True or False, got {value!r}")


def check_mapping(value: object, name: str, error: type[WarpvisError] = ArrayError) -> Mapping[Any, Any]:
    """Return `value`, if it is a mapping.

    Raises:
        WarpvisError: It is none; of the class `error`.
    """
    if not isinstance(value, Mapping):
        raise error(f"{name} must be a mapping, got {value!r}")
    return value


def check_text(value: object, name: str, error: type[WarpvisError] = ArrayError) -> str:
    """Return `value` if it is text.

    Raises:
        WarpvisError: It is none; of the class `error`.
    """
    if not isinstance(value, str):
        raise error(f"{name} must be text, got {value!r}")
    return value


def as_items(value: object, name: str, error: type[WarpvisError] = ArrayError) -> list[Any]:
    """Return what is given one by one, as a list; text alone is one item.

    Raises:
        WarpvisError: It cannot be gone through; of the class `error`.
    """
    if isinstance(value, str):
        return [value]
    if not isinstance(value, Iterable) or isinstance(value, bytes):
        raise error(f"{name} must be a list, got {value!r}")
    try:
        return list(value)
    except (TypeError, RuntimeError):  # arrays without a dimension look as if they had items
        raise error(f"{name} must be a list, got {value!r}") from None


def as_path(path: object, name: str = "path") -> Path:
    """Read a path of text or any `os.PathLike`: never a number, which Python's files take for an open file.

    Raises:
        FileFormatError: It is none.
    """
    text = path if isinstance(path, str) else os.fspath(path) if isinstance(path, os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise FileFormatError(f"{name} must be the name of a file, text or an os.PathLike, got {path!r}")
    if max(len(os.fsencode(part)) for part in Path(text).parts or ("",)) > _LONGEST_NAME:
        raise FileFormatError(f"{name} is too long for the name of a file: {text[:40]!r}...")
    return Path(text)


def said_by(error: BaseException) -> str:
    """Return what an exception of a library, or of other code, says, as a part of one sentence of bounded length."""
    said = " ".join(str(error).split())
    if isinstance(error, MemoryError):
        said = "it asks for more memory than there is"
    elif isinstance(error, RecursionError):
        said = "it is nested too deeply"
    elif isinstance(error, _STUMBLES):
        said = f"it is damaged, or something else ({type(error).__name__}{': ' if said else ''}{said})"
    said = said or type(error).__name__
    return shortened(said, _LONGEST_SAID)


def shortened(text: str, most: int = 120) -> str:
    """Return a text for a message: of a longer one than `most` characters, its beginning and its end."""
    end = most // 3
    return text if len(text) <= most else f"{text[: most - end - 3]}...{text[-end:]}"
