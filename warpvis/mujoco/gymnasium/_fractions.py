# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""How much of named objects shows: pixels that show them, of those that would if they were alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.rendering import AnyCamera, Renderer
from warpvis.scene import Scene

_PART_BYTES = 1 << 26  # so much is rendered at a time


class VisibleFractions:
    """Counts pixels of objects that are made of several geoms, whose silhouettes overlap.

    `warpvis.object_visibility` counts those of single objects. As there, the canvas of silhouettes is three times as
    wide and as high as the image.
    """

    def __init__(self, scene: Scene, camera: AnyCamera, **options: Any) -> None:
        """Prepare to count.

        Args:
            scene: The scene.
            camera: The camera of the images.
            options: As for `warpvis.Renderer`.
        """
        width, height = camera.width, camera.height
        canvas = replace(camera, width=3 * width, height=3 * height, cx=camera.cx + width, cy=camera.cy + height)
        self._renderer = Renderer(scene, canvas, outputs=("segmentation",), **options)

    def count(
        self,
        segmentation: NDArray[np.int32],
        members: NDArray[np.bool_],
        eyes: NDArray[np.float32],
        object_poses: NDArray[np.float32] | None,
        hidden: NDArray[np.bool_],
    ) -> NDArray[np.float32]:
        """Count in some views.

        Args:
            segmentation: What they show, shape ``(V, H, W)``, of indices of the scene's objects, or -1.
            members: Which of the scene's objects each named object is, shape ``(K, objects)``.
            eyes: Camera to world, rows ``x y z qx qy qz qw``, shape ``(V, 7)``.
            object_poses: Where everything is that moves, shape ``(V, M, 7)``; None if nothing does.
            hidden: Which of the scene's objects do not show, shape ``(V, objects)``.

        Returns:
            Visible fractions, 0 where nothing shows, shape ``(V, K)``.
        """
        is_member = np.append(members, np.zeros((len(members), 1), dtype=bool), axis=1)
        visible = np.stack([mine[segmentation].sum(axis=(1, 2)) for mine in is_member], axis=1)
        alone = np.zeros_like(visible)
        views, names = np.nonzero(visible)
        size = self._renderer.camera.width * self._renderer.camera.height * 4
        step = max(1, _PART_BYTES // size)
        for first in range(0, len(views), step):
            some, mine = views[first : first + step], names[first : first + step]
            seen = self._renderer.render(
                eyes[some],
                object_poses=None if object_poses is None else object_poses[some],
                exclude=(hidden[some] | ~members[mine]).astype(np.uint8),
            )
            assert seen.segmentation is not None
            alone[some, mine] = (seen.segmentation.numpy() >= 0).sum(axis=(1, 2))
        # The canvas has other pixel coordinates, whose rounding may lose one of an edge.
        whole = np.maximum(alone, visible)
        return np.divide(visible, whole, out=np.zeros(visible.shape, dtype=np.float32), where=whole > 0)
