# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Read text, JSON and NumPy files: all readers say what is wrong with one in the same words."""

from __future__ import annotations

import json
from collections.abc import Sequence
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


def read_array(path: Path) -> NDArray[Any]:
    """Read the array of a ``.npy`` file.

    Raises:
        FileFormatError: It cannot be read, or is something else.
    """
    loaded = _load_numpy(path, "NPY")
    if not isinstance(loaded, np.ndarray):
        loaded.close()
        raise FileFormatError(f"{path}: does not read as NPY: it is an archive")
    return loaded


def read_archive(path: Path, wanted: Sequence[str], needed: str) -> dict[str, NDArray[Any]]:
    """Read some arrays of a ``.npz`` file.

    Args:
        path: The file.
        wanted: Names of the arrays; others are not read.
        needed: The one that has to be there.

    Raises:
        FileFormatError: It cannot be read, is something else, or has no such array.
    """
    loaded = _load_numpy(path, "NPZ")
    if isinstance(loaded, np.ndarray):
        raise FileFormatError(f"{path}: does not read as NPZ: it is one array")
    with loaded:
        names = list(loaded)
        try:
            arrays = {name: loaded[name] for name in wanted if name in names}
        except Exception as error:  # so do damaged archives
            raise FileFormatError(f"{path}: does not read as NPZ: {first_line(error)}") from None
    if needed not in arrays:
        raise FileFormatError(f"{path}: expected an array {needed}, got {', '.join(names) or 'no arrays'}")
    return arrays


def _load_numpy(path: Path, kind: str) -> Any:
    try:
        return np.load(path, allow_pickle=False)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror or first_line(error)}") from None
    except Exception as error:  # a file that looks like an archive has errors of its own
        raise FileFormatError(f"{path}: does not read as {kind}: {first_line(error)}") from None


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


def read_lines(path: Path, line: str) -> list[str]:
    """The lines of a file that should hold some like `line`.

    Raises:
        FileFormatError: The file cannot be read, or is not text.
    """
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()  # spreadsheets write a mark
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FileFormatError(f"{path}: is not a text file of lines '{line}'") from None


def first_line(error: Exception) -> str:
    """What a library's error says, for a message of one sentence."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
