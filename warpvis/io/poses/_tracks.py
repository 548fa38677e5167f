# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of several people or objects over time."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.frames import Frames
from warpvis.core.arrays import check_length
from warpvis.core.checks import as_path, is_number
from warpvis.core.motion import interpolate
from warpvis.core.poses import Convention, QuaternionOrder, check_quaternion
from warpvis.errors import ArrayError, FileFormatError
from warpvis.io.poses._frames import read_frames
from warpvis.io.poses._tables import read_named_csv


@dataclass(frozen=True, eq=False)
class Track:
    """Poses of one person or object over time."""

    frames: Frames
    """The poses, in the order of their times."""

    def pose_at(self, time: float, *, max_gap: float = 1.0) -> NDArray[np.float64] | None:
        """Return the pose at a time, interpolated between the poses before and after.

        A track of a single pose does not move, and has this pose at all times.

        Args:
            time: Time [s].
            max_gap: Maximum distance in time of the poses before and after [s]. Before the first and after the last
                pose, these are valid for as long.

        Returns:
            A row ``x y z qx qy qz qw`` of the OpenCV camera frame; None if no pose is known at that time.
        """
        if not is_number(time) or not np.isfinite(time):
            raise ArrayError(f"time must be a finite number of seconds, got {time!r}")
        gap = check_length(max_gap, "max_gap", infinite=True)
        times, rows = self.frames.timestamps, self.frames.camera_to_world
        if len(times) == 1:
            return rows[0].copy()
        after = int(np.searchsorted(times, time, side="right"))
        around = [index for index in (after - 1, after) if 0 <= index < len(times)]
        if any(abs(times[index] - time) > gap for index in around):
            return None
        if len(around) == 1:
            return rows[around[0]].copy()
        first, second = around
        part = (time - times[first]) / (times[second] - times[first])
        return interpolate(rows[first : first + 1], rows[second : second + 1], np.array([[part]]))[0]


def read_tracks(
    path: str | os.PathLike[str], *, convention: Convention | None = None, quaternion: QuaternionOrder = "xyzw"
) -> dict[str, Track]:
    """Read poses of several people or objects over time.

    Args:
        path: A CSV file with the columns of `read_frames` and a column ``name``; or a file of poses of any format of
            `read_frames`, which are those of one person with the name of the file.
        convention: Axes of the camera frame of the poses, as for `read_frames`.
        quaternion: Order of the quaternions of ``npy`` and ``npz`` files, as for `read_frames`.

    Returns:
        Tracks by name, in the order of the file.

    Raises:
        FileFormatError: If the file is missing, contains no poses, or is malformed, or if times repeat.
    """
    file = as_path(path)
    check_quaternion(quaternion)
    if file.suffix.lower() == ".csv":
        tracks = {name: found.to_frames(file, "csv", convention) for name, found in read_named_csv(file).items()}
    else:
        tracks = {file.stem: read_frames(file, convention=convention, quaternion=quaternion)}
    if not tracks:
        raise FileFormatError(f"{file}: holds no poses")
    return {name: _sort(frames, name, str(file)) for name, frames in tracks.items()}


def _sort(frames: Frames, name: str, place: str) -> Track:
    if not name:
        raise FileFormatError(f"{place}: names must not be empty")
    ordered = frames.take(np.argsort(frames.timestamps, kind="stable"))
    repeated = np.flatnonzero(np.diff(ordered.timestamps) <= 0)
    if len(repeated):
        time = ordered.timestamps[repeated[0]]
        raise FileFormatError(f"{place}: {name!r} must have one pose at a time, got several at {time:.6f} s")
    return Track(ordered)
