# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fractions of named objects: visible pixels relative to pixels of the isolated object."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.rendering import Renderer
from warpvis.scene import Scene

_PART_BYTES = 1 << 26  # size of images rendered per batch


class VisibleFractions:
    """Computes visible fractions of objects of several geoms with overlapping silhouettes.

    `warpvis.object_visibility` does so for single objects. As there, the canvas of silhouettes is three times as wide
    and high as the image.
    """

    def __init__(self, scene: Scene, camera: PlanarCamera, **options: Any) -> None:
        """Create the renderer of silhouettes.

        Args:
            scene: The scene.
            camera: The camera of the images.
            options: Options of `warpvis.Renderer`.
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
        """Compute visible fractions in views.

        Args:
            segmentation: Indices of the scene's objects, or -1, shape ``(V, H, W)``.
            members: Whether each of the scene's objects is part of a named object, shape ``(K, objects)``.
            eyes: Camera to world, rows ``x y z qx qy qz qw``, shape ``(V, 7)``.
            object_poses: Poses of movable objects, shape ``(V, M, 7)``; None without any.
            hidden: Whether each of the scene's objects is hidden, shape ``(V, objects)``.

        Returns:
            Visible fractions, 0 for invisible objects, shape ``(V, K)``.
        """
        is_member = np.append(members, np.zeros((len(members), 1), dtype=bool), axis=1)
        visible = np.stack([mine[segmentation].sum(axis=(1, 2)) for mine in is_member], axis=1)
        isolated = np.zeros_like(visible)
        views, names = np.nonzero(visible)
        size = self._renderer.camera.width * self._renderer.camera.height * 4
        step = max(1, _PART_BYTES // size)
        for first in range(0, len(views), step):
            batch, mine = views[first : first + step], names[first : first + step]
            seen = self._renderer.render(
                eyes[batch],
                object_poses=None if object_poses is None else object_poses[batch],
                exclude=(hidden[batch] | ~members[mine]).astype(np.uint8),
            )
            assert seen.segmentation is not None
            isolated[batch, mine] = (seen.segmentation.numpy() >= 0).sum(axis=(1, 2))
        # Pixel coordinates of the canvas differ, so that rounding may lose a pixel at an edge.
        total = np.maximum(isolated, visible)
        return np.divide(visible, total, out=np.zeros(visible.shape, dtype=np.float32), where=total > 0)
