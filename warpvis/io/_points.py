# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Points from files: text of lines ``x y z``, NumPy ``.npy``, and ``.ply``."""

from __future__ import annotations

import io
import math
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_path, describe_exception, truncate
from warpvis.core.file_content import require_content
from warpvis.errors import FileFormatError
from warpvis.io._files import read_array, read_lines
from warpvis.io._ply import straighten_ply

_LINE = "x y z"


def read_points(path: str | os.PathLike[str]) -> NDArray[np.float64]:
    """Read points in the world's frame.

    A ``.npy`` file contains an array of shape ``(N, 3)``, a ``.ply`` file a point cloud or the vertices of a mesh.
    All other files are text with lines ``x y z``, separated by spaces or commas; empty lines, lines that begin with
    ``#``, and a header line ``x y z`` are skipped.

    Args:
        path: The file.

    Returns:
        Points in the file's order, shape ``(N, 3)``.

    Raises:
        FileFormatError: If the file is missing or contains no points, or a line or a row is malformed; the message
            names it.
    """
    path = as_path(path)
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file")
    require_content(path, "a file of points", images=False)
    readers = {".npy": _read_npy, ".ply": _read_ply}
    points = readers.get(path.suffix.lower(), _read_text)(path)
    if not len(points):
        raise FileFormatError(f"{path}: holds no points")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise FileFormatError(f"{path}: points must be finite, and {len(bad)} are not, the first at index {bad[0]}")
    return points


def _read_text(path: Path) -> NDArray[np.float64]:
    lines = read_lines(path, _LINE)
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        words = line.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        if not rows and [word.lower() for word in words] == ["x", "y", "z"]:
            continue
        rows.append(_parse_words(words, f"{path}:{number}"))
    return np.array(rows).reshape(-1, 3)


def _parse_words(words: list[str], place: str) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != 3 or not all(map(math.isfinite, values)):
        raise FileFormatError(f"{place}: expected three finite numbers '{_LINE}', got {truncate(' '.join(words))!r}")
    return values


def _read_npy(path: Path) -> NDArray[np.float64]:
    array = read_array(path)
    if array.dtype.kind not in "fiu" or array.ndim != 2 or array.shape[1] != 3:
        raise FileFormatError(
            f"{path}: expected an array of numbers of shape (N, 3), got {array.dtype} of shape {array.shape}"
        )
    return array.astype(np.float64)


def _read_ply(path: Path) -> NDArray[np.float64]:
    import trimesh

    try:
        loaded = trimesh.load(io.BytesIO(straighten_ply(path.read_bytes())), file_type="ply", process=False)
        return np.asarray(loaded.vertices, dtype=np.float64).reshape(-1, 3)
    except Exception as error:  # trimesh's readers may raise any exception
        raise FileFormatError(f"{path}: cannot be read as PLY: {describe_exception(error)}") from None
