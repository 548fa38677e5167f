# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of a recording's frames: files with one matrix, Redwood's logs, and association by time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import truncate
from warpvis.core.motion import interpolate
from warpvis.core.poses import poses_to_opencv
from warpvis.errors import FileFormatError, PoseError
from warpvis.io._files import read_rows

TIME_TOLERANCE = 0.02
"""Maximum difference of the times of images and poses that belong together [s], as in TUM's associate.py."""


def unknown_poses(count: int) -> NDArray[np.float64]:
    """Return rows of NaN, shape ``(count, 7)``."""
    return np.full((count, 7), np.nan)


def read_matrix(path: Path) -> NDArray[np.float64]:
    """Read a matrix of numbers in a text file, separated by spaces or commas."""
    rows: list[list[float]] = []
    for place, line in read_rows(path, "numbers of a matrix"):
        numbers = numbers_of(line.replace(",", " ").split(), finite=False)
        if numbers is None or (rows and len(numbers) != len(rows[0])):
            raise FileFormatError(f"{place}: expected a row of a matrix of numbers, got {truncate(line.strip(), 60)!r}")
        rows.append(numbers)
    if not rows:
        raise FileFormatError(f"{path}: must be a matrix of numbers, and is empty")
    return np.array(rows)


def read_pose_files(files: Sequence[Path | None]) -> NDArray[np.float64]:
    """Read camera-to-world matrices, one per file; NaN without a file, or if it is infinite, as in ScanNet."""
    poses = unknown_poses(len(files))
    for index, file in enumerate(files):
        if file is not None and file.is_file():
            matrix = read_matrix(file)
            if matrix.shape != (4, 4):
                raise FileFormatError(
                    f"{file}: a pose must be 4 x 4 numbers, got {matrix.shape[0]} x {matrix.shape[1]}"
                )
            if np.isfinite(matrix).all():
                poses[index] = pose_from_matrix(matrix, str(file))
    return poses


def pose_from_matrix(matrix: NDArray[np.float64], place: str) -> NDArray[np.float64]:
    """Convert a matrix, shape ``(4, 4)``, to a row."""
    try:
        return poses_to_opencv(matrix, name="pose")[0]
    except PoseError as problem:
        raise FileFormatError(f"{place}: {problem}") from None


def read_log(path: Path, count: int) -> NDArray[np.float64]:
    """Read a trajectory of Redwood and Open3D: five lines a pose, three integers and a camera-to-world matrix.

    The first integer is the index of the frame. Source: http://redwood-data.org/indoor/fileformat.html

    Args:
        path: The file.
        count: Number of the frames.
    """
    poses = unknown_poses(count)
    lines = list(read_rows(path, "i i i+1"))
    for start in range(0, len(lines), 5):
        place, header = lines[start]
        try:
            index, block = int(header.split()[0]), lines[start + 1 : start + 5]
            matrix = np.array([[float(word) for word in line.split()] for _, line in block])
        except ValueError:
            matrix = np.empty(0)
        if matrix.shape != (4, 4):
            raise FileFormatError(f"{place}: a pose must be a line of 3 integers and 4 lines of 4 numbers")
        if not 0 <= index < count:
            raise FileFormatError(
                f"{place}: the frame must be from 0 to {count - 1}, as there are depth images, got {index}"
            )
        if np.isfinite(matrix).all():
            poses[index] = pose_from_matrix(matrix, place)
    return poses


def nearest(times: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the index of the nearest of `others` for each time, or -1 if none is within `TIME_TOLERANCE`."""
    if not len(others):
        return np.full(len(times), -1)
    order = np.argsort(others, kind="stable")
    after = np.searchsorted(others[order], times).clip(0, len(others) - 1)
    before = (after - 1).clip(0)
    closer = np.abs(others[order[before]] - times) <= np.abs(others[order[after]] - times)
    found = order[np.where(closer, before, after)]
    return np.where(np.abs(others[found] - times) <= TIME_TOLERANCE, found, -1)


def poses_at(
    times: NDArray[np.float64],
    pose_times: NDArray[np.float64],
    rows: NDArray[np.float64],
    *,
    max_gap: float = TIME_TOLERANCE,
) -> NDArray[np.float64]:
    """Return the pose at each time, shape ``(N, 7)``.

    It is interpolated between the poses before and after, positions linearly and rotations along the shortest arc, if
    both are within `max_gap` [s]; else it is the nearest pose within `TIME_TOLERANCE`, or NaN without one.
    """
    found = nearest(times, pose_times)
    poses = np.where(found[:, None] >= 0, rows[found], np.nan)
    order = np.argsort(pose_times, kind="stable")
    known = pose_times[order]
    after = np.searchsorted(known, times)
    between = (after > 0) & (after < len(known))
    after = after.clip(1, max(len(known) - 1, 1))
    if len(known) < 2:
        return poses
    start, end = known[after - 1], known[after]
    between &= (times - start <= max_gap) & (end - times <= max_gap) & (end > start)
    part = np.divide(times - start, end - start, out=np.zeros_like(times), where=between)[:, None]
    mixed = interpolate(rows[order[after - 1]], rows[order[after]], part)
    return np.where(between[:, None], mixed, poses)


def numbers_of(words: Sequence[str], *, finite: bool = True) -> list[float] | None:
    """Return the words as numbers, or None if a word is not a number, or with `finite` not a finite one."""
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return None
    return numbers if not finite or np.isfinite(numbers).all() else None
