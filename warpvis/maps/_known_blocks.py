# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The known blocks of an occupancy map on the host, for files and conversions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.maps._occupancy_blocks import BlockStorage


@dataclass(frozen=True)
class KnownBlocks:
    """Blocks with the values of `warpvis.kernels.maps.occupancy_blocks`; blocks count from the world's origin."""

    first: NDArray[np.int64]
    """First blocks of boxes of blocks whose voxels have one value, shape ``(N, 3)``."""
    size: NDArray[np.int64]
    """Number of blocks of each box along x, y and z, shape ``(N, 3)``."""
    values: NDArray[np.int16]
    """Value of each box, shape ``(N,)``."""
    mixed: NDArray[np.int64]
    """The other blocks, shape ``(M, 3)``."""
    voxels: NDArray[np.int16]
    """Their voxels, ``[block, x, y, z]``, shape ``(M, 8, 8, 8)``."""

    def clip(self, bounds: NDArray[np.float64], block_side: float) -> KnownBlocks:
        """Return the blocks that overlap with a box in space [m]."""
        low, high = np.floor(bounds[0] / block_side), np.ceil(bounds[1] / block_side)
        first, end = np.maximum(self.first, low), np.minimum(self.first + self.size, high)
        boxes = (first < end).all(axis=1)
        blocks = ((self.mixed >= low) & (self.mixed < high)).all(axis=1)
        first, size = first[boxes].astype(np.int64), (end - first)[boxes].astype(np.int64)
        return KnownBlocks(first, size, self.values[boxes], self.mixed[blocks], self.voxels[blocks])


def stored_log_odds(probability: float) -> int:
    """Return the stored value of voxels with a probability."""
    from warpvis.kernels.maps.occupancy_blocks import LOG_ODDS_UNIT

    return round(math.log(probability / (1.0 - probability)) / LOG_ODDS_UNIT)


def read_blocks(storage: BlockStorage) -> KnownBlocks:
    """Copy the known blocks of a map to the host."""
    from warpvis.kernels.maps.occupancy_blocks import NEVER_SEEN, SIDE

    slot, uniform = storage.slot.numpy(), storage.uniform.numpy()
    has_slot = slot >= 0
    single = ~has_slot & (uniform != int(NEVER_SEEN))
    first, mixed = np.argwhere(single) + storage.first, np.argwhere(has_slot) + storage.first
    voxels = storage.voxels.numpy()[slot[has_slot]].reshape(-1, SIDE, SIDE, SIDE)
    return KnownBlocks(first, np.ones_like(first), uniform[single], mixed, voxels)


def write_blocks(storage: BlockStorage, known: KnownBlocks) -> None:
    """Add blocks, each at most once, to an empty map.

    Raises:
        ArrayError: If the map would have too many blocks.
    """
    from warpvis.kernels.maps.occupancy_blocks import NEVER_SEEN, NOT_MEASURED, VOXELS

    if not len(known.first) + len(known.mixed):
        return
    ends = known.first + known.size
    low = np.vstack([known.first, known.mixed]).min(axis=0)
    storage.include(low, np.vstack([ends, known.mixed + 1]).max(axis=0))

    mixed = known.mixed - storage.first
    rows = known.voxels.reshape(len(mixed), VOXELS)
    slots, slot = storage.take_slots(len(mixed)), storage.slot.numpy()
    slot[tuple(mixed.T)] = slots
    storage.slot.assign(slot)
    voxels = storage.voxels.numpy()
    voxels[slots] = rows
    storage.voxels.assign(voxels)

    uniform = storage.uniform.numpy()
    has_unseen = (rows == int(NEVER_SEEN)).any(axis=1)
    uniform[tuple(mixed.T)] = np.where(has_unseen, int(NEVER_SEEN), int(NOT_MEASURED))
    single = (known.size == 1).all(axis=1)
    uniform[tuple((known.first - storage.first)[single].T)] = known.values[single]
    starts, stops = known.first[~single] - storage.first, ends[~single] - storage.first
    for (x, y, z), (x_end, y_end, z_end), value in zip(
        starts.tolist(), stops.tolist(), known.values[~single].tolist(), strict=True
    ):
        uniform[x:x_end, y:y_end, z:z_end] = value
    storage.uniform.assign(uniform)
