# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Detection of poses of another meaning while images come one at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.pose_meaning import MIN_MOTION, refuse_inconsistent_views
from warpvis.core.poses import Convention

# Views that are kept; when there are as many, poses are right.
_MAX_VIEWS = 8


class EarlierViews:
    """A few images of a moving camera, with which the next ones must agree."""

    def __init__(self) -> None:
        """Keep no image."""
        self._depth: list[NDArray[np.floating]] = []
        self._rows: list[NDArray[np.floating]] = []
        self._last = np.zeros((4, 4))  # pose of the last image that is kept
        self._source: tuple[ImageCamera, Convention] | None = None

    def check(
        self,
        depth: NDArray[np.floating],
        camera: ImageCamera,
        poses: NDArray[np.floating],
        matrices: NDArray[np.float64],
        convention: Convention,
    ) -> None:
        """Raise `PoseError` if images contradict each other or earlier ones, and would not with other poses.

        Args:
            depth: Depth images on the host [m], shape ``(V, H, W)``.
            camera: Their camera.
            poses: Rows with OpenCV axes, shape ``(V, 7)``.
            matrices: The same poses, shape ``(V, 4, 4)``.
            convention: The axes that were given.
        """
        if len(depth) > 1:
            refuse_inconsistent_views(depth, camera, poses, convention)
        if self._source != (camera, convention):
            self._depth, self._rows, self._source = [], [], (camera, convention)
        if len(self._depth) == _MAX_VIEWS or not self._has_moved(matrices[0]):
            return
        kept = [*self._depth, depth[0]], [*self._rows, poses[0]]
        refuse_inconsistent_views(np.stack(kept[0]), camera, np.stack(kept[1]), convention)
        self._depth.append(depth[0].copy())
        self._rows.append(poses[0].copy())
        self._last = matrices[0]

    def _has_moved(self, matrix: NDArray[np.float64]) -> bool:
        return not self._depth or bool(np.abs(matrix - self._last).max() > MIN_MOTION)
