# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Readers of text and NumPy files with uniform error messages."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from warpvis.core.checks import truncate
from warpvis.core.file_content import read_text, reading
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.io._archives import check_unpacked

_LONGEST_SHOWN = 60


def read_array(path: Path) -> NDArray[np.generic]:
    """Read the array of a ``.npy`` file."""
    loaded = _load_numpy(path, "NPY")
    if isinstance(loaded, NpzFile):
        loaded.close()
        raise FileFormatError(f"{path}: cannot be read as NPY: it is an archive")
    return loaded


def read_archive(path: Path, selected: Sequence[str], needed: str) -> dict[str, NDArray[np.generic]]:
    """Read the arrays `selected` of a ``.npz`` file, of which `needed` is required; others are not read."""
    loaded = _load_numpy(path, "NPZ")
    if not isinstance(loaded, NpzFile):
        raise FileFormatError(f"{path}: cannot be read as NPZ: it is one array")
    with loaded:
        names = list(loaded)
        members = loaded.zip.infolist() if loaded.zip is not None else []
        packed = [info for info in members if info.compress_type != zipfile.ZIP_STORED]
        size = sum(info.file_size for info in packed if info.filename.removesuffix(".npy") in selected)
        check_unpacked(path, size, "write it with numpy.savez, without compression")
        with reading(path, "NPZ"):
            arrays = {name: loaded[name] for name in selected if name in names}
    other = [name for name, array in arrays.items() if not isinstance(array, np.ndarray)]
    if other:
        raise FileFormatError(f"{path}: cannot be read as NPZ: {other[0]} is not an array")
    if needed not in arrays:
        raise FileFormatError(f"{path}: expected an array {needed}, got {truncate(', '.join(names)) or 'no arrays'}")
    return arrays


def _load_numpy(path: Path, kind: str) -> NDArray[np.generic] | NpzFile:
    with reading(path, kind):
        try:
            return np.load(path, allow_pickle=False)
        except ValueError as error:
            if str(error).startswith("This file contains pickled"):  # NumPy's message for any unknown file type
                raise ValueError("it contains no NumPy arrays") from None
            raise


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
    size = " x ".join(map(str, shape))
    raise FileFormatError(f"{location} must be {size} finite numbers, got {shorten(value)}")


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
