# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of a depth camera, whose frames are read when they are accessed."""

from __future__ import annotations

import operator
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, overload

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.depth_images import check_meters
from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.pose_meaning import refuse_inconsistent_views
from warpvis.core.types import Json
from warpvis.core.user_warnings import warn_user
from warpvis.errors import ArrayError, FileFormatError, PoseError

_LONG_RANGE = 10.0
"""Depth that most pixels of a depth camera never exceed tenfold [m], for cameras without `far`."""


class FrameReader(Protocol):
    """Reads the images of a recording by the index of the frame."""

    def read_depth(self, index: int) -> NDArray[np.float32]:
        """Return a depth image [m], shape ``(H, W)``."""
        ...

    def read_color(self, index: int) -> NDArray[np.uint8] | None:
        """Return the color image of a depth image, shape ``(H, W, 3)``, or None if it has none."""
        ...

    def place(self, index: int) -> str:
        """Return the location of a depth image for messages."""
        ...


class MeasuredFrame:
    """One frame of a depth camera; `depth` and `color` are read at their first access."""

    camera: ImageCamera
    """The camera of the depth image."""
    camera_to_world: NDArray[np.float64]
    """Pose ``x y z qx qy qz qw`` [m] of the OpenCV camera frame, shape ``(7,)``; NaN if it is not known."""
    timestamp: float
    """Time of the depth image [s]; the index of the frame if the recording has no times."""

    def __init__(self, recording: Recording, row: int) -> None:
        self.camera = recording.camera
        self.camera_to_world = recording.camera_to_world[row]
        self.timestamp = float(recording.timestamps[row])
        self._reader = recording._reader
        self._index = int(recording._rows[row])

    @cached_property
    def depth(self) -> NDArray[np.float32]:
        """Planar depth [m], shape ``(H, W)``, NaN where the sensor has no measurement.

        Raises:
            FileFormatError: If the image is missing or damaged, does not have the size of the camera, or is not in
                meters.
        """
        depth = self._reader.read_depth(self._index)
        place, expected = self._reader.place(self._index), (self.camera.height, self.camera.width)
        if depth.shape != expected:
            raise FileFormatError(
                f"{place}: must have the pixels of the camera, {_size(expected)}, got {_size(depth.shape)}; give the "
                "camera of the depth images as camera="
            )
        depth = np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(np.nan))
        try:
            check_meters(depth, "depth", self.camera.near, min(self.camera.far, _LONG_RANGE))
        except ArrayError:
            median = float(np.nanmedian(depth))
            raise FileFormatError(
                f"{place}: depth must be in meters, got a median of {median:g}, as millimeters are; pass unit=0.001, "
                "the length of a unit in meters"
            ) from None
        return depth

    @cached_property
    def color(self) -> NDArray[np.uint8] | None:
        """Color of every pixel of the depth image, sRGB, shape ``(H, W, 3)``; None if the recording has none.

        Raises:
            FileFormatError: If the image is missing or damaged, or does not have the size of the depth image.
        """
        color = self._reader.read_color(self._index)
        expected = (self.camera.height, self.camera.width)
        if color is not None and color.shape[:2] != expected:
            raise FileFormatError(
                f"{self._reader.place(self._index)}: its color image must have the size of the depth image, "
                f"{_size(expected)}, got {_size(color.shape)}; register the color images to the depth images"
            )
        return color

    def __repr__(self) -> str:
        return f"MeasuredFrame({self._reader.place(self._index)}, timestamp={self.timestamp:g})"


@dataclass(frozen=True, eq=False)
class Recording:
    """N frames of one depth camera, in the order of the recording.

    An index or an iteration returns a `MeasuredFrame`, a slice the recording of these frames. Images are read when they
    are accessed.
    """

    camera: ImageCamera
    """The camera of all depth images."""
    timestamps: NDArray[np.float64]
    """Time of every depth image [s], shape ``(N,)``; 0, 1, 2, ... if the recording has no times."""
    camera_to_world: NDArray[np.float64]
    """Rows ``x y z qx qy qz qw`` [m] of the OpenCV camera frame, shape ``(N, 7)``; NaN where no pose is known."""
    source: Mapping[str, Json]
    """Origin of the frames: the name of the file or folder, its format, and the origin of the camera."""
    _reader: FrameReader
    _rows: NDArray[np.int64]  # index of every frame for the reader, shape ``(N,)``

    def __len__(self) -> int:
        return len(self.timestamps)

    @overload
    def __getitem__(self, part: int) -> MeasuredFrame: ...

    @overload
    def __getitem__(self, part: slice) -> Recording: ...

    def __getitem__(self, part: int | slice) -> MeasuredFrame | Recording:
        if isinstance(part, slice):
            return self._take(np.arange(len(self))[part])
        try:
            row = operator.index(part)
        except TypeError:
            raise ArrayError(f"a recording must be indexed by an integer or a slice, got {part!r}") from None
        if not -len(self) <= row < len(self):
            raise IndexError(f"frame must be from {-len(self)} to {len(self) - 1}, got {row}")
        return MeasuredFrame(self, row % len(self))

    def __iter__(self) -> Iterator[MeasuredFrame]:
        return (MeasuredFrame(self, row) for row in range(len(self)))

    def posed(self) -> Recording:
        """Return the frames whose pose is known.

        Raises:
            FileFormatError: If no pose is known.
        """
        known = np.flatnonzero(np.isfinite(self.camera_to_world).all(axis=1))
        if not len(known):
            raise FileFormatError("no pose of the recording is known; pass poses=, a file of poses, to open_recording")
        return self._take(known)

    def stack(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Read all frames, for calls that take many, such as `wv.classify` and `wv.voxel_map`.

        Returns:
            Depth [m], shape ``(N, H, W)``, NaN where the sensor has no measurement, and `camera_to_world`, shape
            ``(N, 7)``, NaN where no pose is known: these frames are left out by ``recording.posed().stack()``. A
            warning is issued if the views contradict each other, and would not if the poses had another meaning.

        Raises:
            FileFormatError: If an image is missing, damaged, of another size, or not in meters; the message names it.
        """
        depth = np.empty((len(self), self.camera.height, self.camera.width), dtype=np.float32)
        for index, frame in enumerate(self):
            depth[index] = frame.depth
        try:
            refuse_inconsistent_views(depth, self.camera, self.camera_to_world)
        except PoseError as error:
            warn_user(f"recording {self.source.get('file')!r}: {error}", UserWarning)
        return depth, self.camera_to_world.copy()

    def _take(self, rows: NDArray[np.integer]) -> Recording:
        return replace(
            self,
            timestamps=self.timestamps[rows],
            camera_to_world=self.camera_to_world[rows],
            _rows=self._rows[rows],
        )

    def __repr__(self) -> str:
        known = int(np.isfinite(self.camera_to_world).all(axis=1).sum())
        name = self.source.get("file")
        return f"Recording({name!r}, {len(self)} frames, {known} with a pose, {self.camera.describe()})"


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]}" if len(shape) >= 2 else f"shape {shape}"
