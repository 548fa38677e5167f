# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Float64 references of the kernels that find objects in images before packets are cast."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from warpvis import Camera
from warpvis.core.poses import poses_to_matrices


def find_objects_cuda(
    boxes: NDArray, object_poses: NDArray, camera: Camera, pose: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the image bounds of the boxes of objects.

    Args:
        boxes: Min and max corner of each object in its frame [m], shape ``(M, 6)``.
        object_poses: Object to world, shape ``(M, 7)``.
        camera: The camera.
        pose: Camera to world, shape ``(7,)``.

    Returns:
        Min x, max x, min y and max y of the corners [px], with pixel centers at whole numbers, shape ``(M, 4)``; and
        whether all corners are in front of the camera, without which the bounds are not valid.
    """
    corners = np.stack(
        [boxes[:, [3 * k + i for i, k in enumerate(pick)]] for pick in product((0, 1), repeat=3)], axis=1
    )
    matrices = poses_to_matrices(object_poses)
    world = np.einsum("mij,mkj->mki", matrices[:, :3, :3], corners) + matrices[:, None, :3, 3]
    eye = poses_to_matrices(pose)
    x, y, z = np.moveaxis((world - eye[:3, 3]) @ eye[:3, :3], -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = camera.fx * x / z + camera.cx - 0.5, camera.fy * y / z + camera.cy - 0.5
    return np.stack([u.min(1), u.max(1), v.min(1), v.max(1)], axis=-1), (z > 0).all(axis=1)


def sort_into_tiles(entries: NDArray, counts: NDArray, tiles_y: int, tiles_x: int) -> list[list[int]]:
    """List the objects of each tile of 32x32 pixels of each view.

    Args:
        entries: First column and row of each object in each view and, in the upper half, the last ones, shape
            ``(V, M, 2)``.
        counts: Number of objects in each view, shape ``(V,)``.
        tiles_y: Rows of tiles in a view.
        tiles_x: Columns of tiles in a view.
    """
    lists: list[list[int]] = [[] for _ in range(len(counts) * tiles_y * tiles_x)]
    for view, count in enumerate(counts):
        for i, (columns, rows) in enumerate(entries[view, :count]):
            for y in range((rows & 0xFFFF) // 32, (rows >> 16) // 32 + 1):
                for x in range((columns & 0xFFFF) // 32, (columns >> 16) // 32 + 1):
                    lists[(view * tiles_y + y) * tiles_x + x].append(i)
    return lists
