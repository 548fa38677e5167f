# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""TUM trajectories: lines ``timestamp tx ty tz qx qy qz qw``, camera to world.

Format: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats
"""

from __future__ import annotations

import math
import os

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_path, truncate
from warpvis.core.poses import LENGTH_TOLERANCE
from warpvis.errors import FileFormatError
from warpvis.io._files import read_lines

_LINE = "timestamp tx ty tz qx qy qz qw"


def read_poses(path: str | os.PathLike[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read a trajectory.

    Empty lines and lines that begin with ``#`` are skipped.

    Args:
        path: Text file.

    Returns:
        Timestamps [s], shape ``(V,)``, and rows ``x y z qx qy qz qw``, shape ``(V, 7)``.

    Raises:
        FileFormatError: If the file is missing or contains no poses, or a line is malformed; the message names it.
    """
    path = as_path(path)
    lines = read_lines(path, _LINE)
    rows = [
        _parse_line(line, f"{path}:{number}")
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
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
