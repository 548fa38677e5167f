# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses from TUM trajectories, and from CSV and Parquet tables.

Format: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats; tables have columns ``x y z qx qy qz qw``, and
optionally ``timestamp``.
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_path, pluralize, truncate
from warpvis.core.file_content import reading, require_package
from warpvis.core.numpy_files import check_unpacked
from warpvis.core.poses import LENGTH_TOLERANCE
from warpvis.errors import FileFormatError
from warpvis.io._files import read_lines, read_rows, shorten
from warpvis.io.poses._file_poses import FilePoses

if TYPE_CHECKING:
    import pyarrow

_TIME = "timestamp"
_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_NAMES = {
    _TIME: ("timestamp", "time", "t"),
    "x": ("x", "tx"),
    "y": ("y", "ty"),
    "z": ("z", "tz"),
    **{name: (name,) for name in _POSE[3:]},
}

# Column of the names of several people or objects, and the name without it.
_NAME, _DEFAULT_NAME = "name", "person"

_LINE = "timestamp tx ty tz qx qy qz qw"


def read_csv(path: Path) -> FilePoses:
    """Read poses of comma-separated values with a line of column names, which may begin with ``#``.

    Other columns, empty lines, and lines that begin with ``#`` are skipped.
    """
    table, columns, places, _ = _read_table(path)
    return _as_poses(table, columns, places.__getitem__)


def read_named_csv(path: Path) -> dict[str, FilePoses]:
    """Read poses of several people or objects: as `read_csv`, with a column ``name``, in the order of first lines.

    Without a column ``name``, all poses are of ``person``.
    """
    table, columns, places, names = _read_table(path)
    tracks = {}
    for name in dict.fromkeys(names):
        rows = [index for index, other in enumerate(names) if other == name]
        tracks[name] = _as_poses(table[rows], columns, [places[index] for index in rows].__getitem__)
    return tracks


def _read_table(path: Path) -> tuple[NDArray[np.float64], list[str], list[str], list[str]]:
    """Return the numbers of a table, their columns, and the location and the name of every row."""
    lines = read_lines(path, "x,y,z,qx,qy,qz,qw")
    reader = csv.reader(lines)
    columns: dict[str, int] = {}
    width, named = 0, -1
    rows: list[list[float]] = []
    places: list[str] = []
    names: list[str] = []
    try:
        for words in reader:
            place = f"{path}:{reader.line_num}"
            if not any(word.strip() for word in words):
                continue
            if not columns:
                words[0] = words[0].lstrip("# ")
                columns, width = _find_columns(words, place), len(words)
                headers = [word.strip().lower() for word in words]
                named = headers.index(_NAME) if _NAME in headers else -1
            elif not words[0].lstrip().startswith("#"):
                if len(words) != width:
                    raise FileFormatError(
                        f"{place}: expected {pluralize(width, 'value')}, as there are column names, got {len(words)}"
                    )
                rows.append([_parse_number(words[column], place) for column in columns.values()])
                places.append(place)
                names.append(words[named].strip() if named >= 0 else _DEFAULT_NAME)
    except csv.Error as error:
        raise FileFormatError(f"{path}:{reader.line_num}: cannot be read as CSV: {error}") from None
    if not columns:
        raise FileFormatError(f"{path}: holds no line of column names x, y, z, qx, qy, qz, qw")
    return np.array(rows, dtype=np.float64).reshape(-1, len(columns)), list(columns), places, names


def read_parquet(path: Path) -> FilePoses:
    """Read the poses of a Parquet file; other columns are not read."""
    parquet = require_package("pyarrow.parquet", f"{path}: Parquet files are read with pyarrow", "dataset")
    with reading(path, "Parquet"):
        with parquet.ParquetFile(path) as file:
            names = file.schema_arrow.names
            columns = _find_columns(names, str(path))
            size = file.metadata.num_rows * len(columns) * np.dtype(np.float64).itemsize
            check_unpacked(path, size, "split it into several files")
            table = file.read(columns=[names[index] for index in columns.values()])
        values = {name: table.column(table.column_names.index(names[index])) for name, index in columns.items()}
        arrays = [_as_floats(value, f"{path}: column {name}") for name, value in values.items()]
    return _as_poses(np.stack(arrays, axis=1), list(columns), lambda index: f"{path}: row {index}")


def _as_floats(column: pyarrow.ChunkedArray, name: str) -> NDArray[np.float64]:
    """Return a column's values; NaN for null."""
    import pyarrow

    if not (pyarrow.types.is_floating(column.type) or pyarrow.types.is_integer(column.type)):
        raise FileFormatError(f"{name} must hold numbers, got {column.type}")
    return column.to_numpy().astype(np.float64)


def _as_poses(table: NDArray[np.float64], columns: list[str], place: Callable[[int], str]) -> FilePoses:
    times = table[:, columns.index(_TIME)] if _TIME in columns else None
    return FilePoses(table[:, [columns.index(name) for name in _POSE]], place, timestamps=times)


def _parse_number(word: str, place: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FileFormatError(f"{place}: expected finite numbers, got {shorten(word.strip())}")
    return value


def _find_columns(names: Sequence[str], place: str) -> dict[str, int]:
    """Find the columns that are read, by their names and aliases."""
    headers = [name.strip().lower() for name in names]
    columns: dict[str, int] = {}
    for column, aliases in _NAMES.items():
        found = [index for index, name in enumerate(headers) if name in aliases]
        if len(found) > 1:
            raise FileFormatError(f"{place}: two columns are {column}: {names[found[0]]!r} and {names[found[1]]!r}")
        if found:
            columns[column] = found[0]
    missing = [name for name in _POSE if name not in columns]
    if missing:
        raise FileFormatError(
            f"{place}: expected the column names x, y, z (or tx, ty, tz), qx, qy, qz, qw, and timestamp if there is "
            f"one; missing {', '.join(missing)}"
        )
    return columns


def read_poses(path: str | os.PathLike[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read a trajectory.

    Empty lines and lines that begin with ``#`` are skipped.

    Returns:
        Timestamps [s], shape ``(V,)``, and rows ``x y z qx qy qz qw``, shape ``(V, 7)``.

    Raises:
        FileFormatError: If the file is missing or contains no poses, or a line is malformed; the message names it.
    """
    path = as_path(path)
    rows = [_parse_line(line, place) for place, line in read_rows(path, _LINE)]
    if not rows:
        raise FileFormatError(f"{path}: holds no lines '{_LINE}'")
    table = np.array(rows)
    return table[:, 0], table[:, 1:]


def _parse_line(line: str, place: str) -> list[float]:
    words = line.replace(",", " ").split()
    if len(words) != 8:
        raise FileFormatError(f"{place}: expected the 8 numbers '{_LINE}', got {len(words)} words")
    try:
        values = [float(word) for word in words]
    except ValueError:
        raise FileFormatError(f"{place}: expected the 8 numbers '{_LINE}', got {truncate(line.strip())!r}") from None
    if not all(map(math.isfinite, values)):
        raise FileFormatError(f"{place}: numbers must be finite, got {truncate(line.strip())!r}")
    length = math.hypot(*values[4:])
    if abs(length - 1) > LENGTH_TOLERANCE:
        raise FileFormatError(f"{place}: the quaternion qx qy qz qw must have length 1, got {length:.6g}")
    return values
