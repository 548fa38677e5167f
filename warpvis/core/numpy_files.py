# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Readers of NumPy files, with uniform error messages and a limit of the unpacked size."""

from __future__ import annotations

import contextlib
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from warpvis.core.checks import truncate
from warpvis.core.file_content import reading
from warpvis.errors import FileFormatError

MAX_UNPACKED = 1 << 30
"""Maximum size of unpacked files [bytes], since a few thousand bytes can unpack to any size."""


def read_array(path: Path) -> NDArray[np.generic]:
    """Read the array of a ``.npy`` file."""
    with _opened(path, "NPY") as loaded:
        if isinstance(loaded, NpzFile):
            raise FileFormatError(f"{path}: cannot be read as NPY: it is an archive")
        return loaded


def read_archive(path: Path, selected: Sequence[str], needed: str) -> dict[str, NDArray[np.generic]]:
    """Read the arrays `selected` of a ``.npz`` file, of which `needed` is required; others are not read."""
    with _opened(path, "NPZ") as loaded:
        if not isinstance(loaded, NpzFile):
            raise FileFormatError(f"{path}: cannot be read as NPZ: it is one array")
        names = list(loaded)
        members = loaded.zip.infolist() if loaded.zip is not None else []
        packed = [info for info in members if info.compress_type != zipfile.ZIP_STORED]
        size = sum(info.file_size for info in packed if info.filename.removesuffix(".npy") in selected)
        check_unpacked(path, size, "write it with numpy.savez, without compression")
        arrays = {name: loaded[name] for name in selected if name in names}
    other = [name for name, array in arrays.items() if not isinstance(array, np.ndarray)]
    if other:
        raise FileFormatError(f"{path}: cannot be read as NPZ: {other[0]} is not an array")
    if needed not in arrays:
        raise FileFormatError(f"{path}: expected an array {needed}, got {truncate(', '.join(names)) or 'no arrays'}")
    return arrays


@contextlib.contextmanager
def _opened(path: Path, kind: str) -> Iterator[NDArray[np.generic] | NpzFile]:
    """Open a file of NumPy, and close it: given a path, NumPy leaves damaged archives open."""
    with reading(path, kind), path.open("rb") as file:
        try:
            loaded = np.load(file, allow_pickle=False)
        except ValueError as error:
            if str(error).startswith("This file contains pickled"):  # NumPy's message for any unknown file type
                raise ValueError("it contains no NumPy arrays") from None
            raise
        with loaded if isinstance(loaded, NpzFile) else contextlib.nullcontext():
            yield loaded


def check_unpacked(path: Path, size: int, fix: str = "unpack it first") -> None:
    """Raise an error if a file unpacks to more than 1 GiB."""
    if size > MAX_UNPACKED:
        raise FileFormatError(f"{path}: unpacks to more than 1 GiB, the maximum: {fix}")
