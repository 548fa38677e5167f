# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Blocks of an occupancy map from a truncated signed distance field (TSDF)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.maps._known_blocks import KnownBlocks

# Share of a voxel by which an origin may differ from a multiple of its side.
_ORIGIN_TOLERANCE = 0.01

# Indices of voxels are 32-bit.
_MAX_INDEX = 2**30


def blocks_of_tsdf(
    distance: ArrayInput, weight: ArrayInput, cell_size: float, origin: ArrayLike, values: tuple[int, int]
) -> KnownBlocks:
    """Return the blocks of a TSDF; `values` are the stored log-odds of free and of occupied voxels."""
    from warpvis.kernels.maps.occupancy_blocks import NEVER_SEEN, NOT_MEASURED, SIDE

    distances, weights = (as_numpy(array, name=name) for array, name in ((distance, "distance"), (weight, "weight")))
    if distances.ndim != 3 or not distances.size or distances.dtype.kind != "f":
        raise ArrayError(f"distance must be floats of shape (nx, ny, nz), got {distances.dtype} of {distances.shape}")
    if weights.shape != distances.shape or weights.dtype.kind not in "fiub":
        raise ArrayError(f"weight must be numbers of shape {distances.shape}, got {weights.dtype} of {weights.shape}")
    low = _first_voxel(origin, cell_size)

    free, occupied = values
    start = low // SIDE
    size = -(-(low + distances.shape) // SIDE) - start
    x, y, z = (slice(skip, skip + count) for skip, count in zip(low - SIDE * start, distances.shape, strict=True))
    dense = np.full(SIDE * size, int(NEVER_SEEN), dtype=np.int16)
    voxels, measured, half = dense[x, y, z], weights > 0, 0.5 * cell_size
    voxels[measured & (distances > half)] = free
    voxels[measured & (np.abs(distances) <= half)] = occupied
    voxels[measured & (distances < -half)] = int(NOT_MEASURED)

    count_x, count_y, count_z = size.tolist()
    blocks = dense.reshape(count_x, SIDE, count_y, SIDE, count_z, SIDE).transpose(0, 2, 4, 1, 3, 5)
    blocks = blocks.reshape(-1, SIDE, SIDE, SIDE)
    first = blocks[:, 0, 0, 0]
    is_uniform = (blocks == first[:, None, None, None]).all(axis=(1, 2, 3))
    is_known = is_uniform & (first != int(NEVER_SEEN))
    places = np.stack(np.unravel_index(np.arange(len(blocks)), size.tolist()), axis=1) + start
    ones = np.ones_like(places[is_known])
    return KnownBlocks(places[is_known], ones, first[is_known], places[~is_uniform], blocks[~is_uniform])


def _first_voxel(origin: ArrayLike, cell_size: float) -> NDArray[np.int64]:
    """Return the index of the voxel that begins at a place [m]."""
    corner = as_numpy(origin, name="origin").astype(np.float64)
    if corner.shape != (3,) or not np.isfinite(corner).all():
        raise ArrayError(f"origin must be a finite point x, y, z [m], got {corner.tolist()}")
    low = np.round(corner / cell_size)
    if (np.abs(corner / cell_size - low) > _ORIGIN_TOLERANCE).any():
        raise ArrayError(
            f"origin must be a multiple of the voxels' side, {cell_size} m, along each axis, as in a map, got "
            f"{corner.tolist()}; it is the lower corner of a voxel, half its side below the place of its distance"
        )
    if (np.abs(low) > _MAX_INDEX).any():
        raise ArrayError(f"origin must be at most {_MAX_INDEX} voxels from the world's origin, got {corner.tolist()}")
    return low.astype(np.int64)
