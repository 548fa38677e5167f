# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""JSON files, and the numbers in them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import FileFormatError

_LONGEST_SHOWN = 60


def read_json(path: Path) -> Any:
    """What a JSON file holds.

    Raises:
        FileFormatError: It cannot be read, or is not JSON; the line is named.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FileFormatError(f"{path}: is not a JSON text file") from None
    except json.JSONDecodeError as error:
        raise FileFormatError(f"{path}:{error.lineno}: is not JSON: {error.msg}") from None
    except RecursionError:
        raise FileFormatError(f"{path}: is not JSON that can be read: it is nested too deeply") from None
    except ValueError as error:  # a whole number of thousands of digits
        raise FileFormatError(f"{path}: is not JSON that can be read: {error}") from None


def as_numbers(value: Any, shape: tuple[int, ...], what: str) -> NDArray[np.float64]:
    """A value of a JSON file as finite numbers of a shape.

    Args:
        value: Lists of numbers. True and false are none.
        shape: Their wanted shape.
        what: What the message begins with: where the value is, and its name.

    Raises:
        FileFormatError: It is something else.
    """
    leaves = _leaves(value, shape)
    if leaves is not None and all(type(leaf) is float or type(leaf) is int for leaf in leaves):
        try:
            numbers = np.array(leaves, dtype=np.float64)
        except OverflowError:  # whole numbers have any number of digits
            numbers = np.array([np.inf])
        if np.isfinite(numbers).all():
            return numbers.reshape(shape)
    size = " x ".join(map(str, shape))
    raise FileFormatError(f"{what} must be {size} finite numbers, got {shorten(value)}")


def shorten(value: Any) -> str:
    """A value as messages show it: what it is, and its beginning."""
    if isinstance(value, dict):
        return "an object"
    if isinstance(value, list) and value and isinstance(value[0], list | dict):
        return f"a list of {len(value)} lists or objects"
    try:
        text = json.dumps(value)
    except (ValueError, RecursionError):
        return "what cannot be shown"
    return text if len(text) <= _LONGEST_SHOWN else text[:_LONGEST_SHOWN] + "..."


def _leaves(value: Any, shape: tuple[int, ...]) -> list[Any] | None:
    """The elements of lists of a shape; None if they are others."""
    items = [value]
    for size in shape:
        if not all(type(item) is list and len(item) == size for item in items):
            return None
        items = [element for item in items for element in item]
    return items
