# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Meshes of the surfaces of an occupancy map: surface nets of faces between occupied and free voxels.

Source: S. F. Frisken Gibson, "Constrained Elastic Surface Nets", MICCAI 1998. Log-odds count measurements and are no
distances, so the surface crosses all lines between voxel centers at the same place, unlike in marching cubes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import ArrayError
from warpvis.maps._known_blocks import KnownBlocks
from warpvis.maps._voxel_map import Voxel

States = Callable[[NDArray[np.float32]], NDArray[np.uint8]]
"""Returns the `Voxel` states at points."""


_INWARD = 0.4
"""Share of a voxel by which faces are moved into the SURFACE voxel.

Measured surfaces are nearest to the middle of the first voxels that they hit. There, walls of one voxel would be flat.
"""


def surface_net(
    known: KnownBlocks, cell_size: float, states_at: States
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return a mesh whose front is on the free side."""
    quads, inward = _find_faces(_surface_voxels(known), cell_size, states_at)
    if not len(quads):
        raise ArrayError("the map must contain a surface beside free space; integrate depth images first")
    low = quads.min(axis=(0, 1))
    size = quads.max(axis=(0, 1)) - low + 1
    keys = np.ravel_multi_index(tuple(np.moveaxis(quads - low, -1, 0)), size.tolist())
    _, vertices_of = np.unique(keys, return_inverse=True)
    vertices_of = vertices_of.reshape(-1, 4)
    # A vertex is the mean of its faces.
    counts = np.bincount(vertices_of.ravel())
    centers = np.repeat(quads.mean(axis=1) + _INWARD * inward, 4, axis=0)
    sums = [np.bincount(vertices_of.ravel(), weights=centers[:, axis]) for axis in range(3)]
    triangles = vertices_of[:, [(0, 1, 2), (0, 2, 3)]].reshape(-1, 3)
    return cell_size * np.stack(sums, axis=1) / counts[:, None], triangles


def _surface_voxels(known: KnownBlocks) -> NDArray[np.int64]:
    """Return the indices of SURFACE voxels, shape ``(N, 3)``."""
    side = known.voxels.shape[1]
    block, *place = np.nonzero(known.voxels >= 0)
    solid = known.first[known.values >= 0]
    inside = np.moveaxis(np.indices((side, side, side)), 0, -1).reshape(-1, 3)
    return np.vstack(
        [
            side * known.mixed[block] + np.stack(place, axis=1),
            (side * solid[:, None] + inside).reshape(-1, 3),
        ]
    )


def _find_faces(
    voxels: NDArray[np.int64], cell_size: float, states_at: States
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the corners of faces between voxels and their FREE neighbors [voxels], and their directions inward.

    Returns:
        Corners, shape ``(N, 4, 3)``, and directions, shape ``(N, 3)``.
    """
    faces, inward, axes = [], [], np.eye(3, dtype=np.int64)
    for axis in range(3):
        normal, first, second = axes[axis], axes[axis - 2], axes[axis - 1]
        corners = np.stack([0 * normal, first, first + second, second])
        for step in (-1, 1):
            beside = ((voxels + step * normal + 0.5) * cell_size).astype(np.float32)
            seen = voxels[states_at(beside) == Voxel.FREE]
            offsets = corners[::-1] if step < 0 else corners + normal
            faces.append(seen[:, None] + offsets)
            inward.append(np.broadcast_to(-step * normal, seen.shape))
    return np.concatenate(faces), np.concatenate(inward)
