# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Results of pose file readers, and their conversion to frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.frames import Frames
from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.poses import Convention, QuaternionOrder
from warpvis.core.types import ArrayInput, Json, ObjectPoses
from warpvis.errors import FileFormatError, PoseError, WarpvisError


@dataclass(frozen=True, eq=False)
class FilePoses:
    """The content of a pose file, before its values are checked."""

    poses: NDArray[np.generic]  # camera to world: rows ``(V, 7)`` or matrices ``(V, 4, 4)``
    place: Callable[[int], str]  # location of a pose for messages: ``walk.csv:12``
    convention: Convention = "opencv"  # default axes of the camera frame for the format
    timestamps: NDArray[np.generic] | None = None  # time of every pose [s], shape ``(V,)``
    object_poses: ObjectPoses = None  # see `Frames`
    world_index: ArrayInput | None = None  # see `Frames`
    camera: ImageCamera | None = None  # the camera of all poses, if defined in the file
    image_names: Sequence[str | None] | None = None  # image of every pose, if defined in the file
    depth_names: Sequence[str | None] | None = None  # depth image of every pose, if defined in the file
    details: Mapping[str, Json] = field(default_factory=dict)  # further details of the source of the poses

    def to_frames(
        self, path: Path, file_format: str, convention: Convention | None, quaternion: QuaternionOrder = "xyzw"
    ) -> Frames:
        """Convert to frames; `quaternion` is the order of the quaternions in `poses` and `object_poses`."""
        if not len(self.poses):
            raise FileFormatError(f"{path}: holds no poses")
        axes = convention or self.convention
        source = {"file": path.name, "format": file_format, "convention": axes, **self.details}
        if quaternion != "xyzw":
            source["quaternion"] = quaternion
        try:
            return Frames.from_poses(
                self.poses,
                convention=axes,
                quaternion=quaternion,
                timestamps=self.timestamps,
                object_poses=self.object_poses,
                world_index=self.world_index,
                camera=self.camera,
                source=source,
            )
        except WarpvisError as error:
            self._refuse_first(axes, quaternion)
            raise FileFormatError(f"{path}: {error}") from None

    def _refuse_first(self, convention: Convention, quaternion: QuaternionOrder) -> None:
        """Raise an error that names the first malformed pose, if there is one, found by bisection."""

        def problem(count: int) -> str:
            try:
                Frames.from_poses(self.poses[:count], convention=convention, quaternion=quaternion)
            except PoseError as error:
                return str(error).partition(": ")[0]
            return ""

        fine, count = 0, len(self.poses)
        if not problem(count):
            return
        while count - fine > 1:
            middle = (fine + count) // 2
            fine, count = (fine, middle) if problem(middle) else (middle, count)
        raise FileFormatError(f"{self.place(fine)}: {problem(count)}")
