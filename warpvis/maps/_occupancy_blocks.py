# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Storage of an occupancy map: a grid of blocks that grows, and voxels of the blocks that are not uniform."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import empty
from warpvis.errors import ArrayError

if TYPE_CHECKING:
    from warpvis.kernels.maps.occupancy_blocks import Blocks

# Blocks that a grid grows by beyond what is needed, since cameras move on.
_MARGIN = 8

# A grid of this many blocks takes 1.6 GB.
_MAX_BLOCKS = 2**28

_MIN_SLOTS = 1024


class BlockStorage:
    """Blocks of voxels on a device; see `warpvis.kernels.maps.occupancy_blocks`."""

    def __init__(self, cell_size: float, device: wp.Device) -> None:
        """Create a grid without blocks."""
        from warpvis.kernels.maps import occupancy_blocks as kernels

        self.device = device
        self.cell_size = cell_size
        self.version = 1
        """A number that changes when arrays are replaced."""
        self.first = np.zeros(3, dtype=np.int64)
        self.slot = self._full((0, 0, 0), wp.int32, -1)
        self.uniform = self._full((0, 0, 0), wp.int16, int(kernels.NEVER_SEEN))
        self.voxels = self._full((0, kernels.VOXELS), wp.int16, 0)
        self.marks = self._full((0, kernels.VOXELS), wp.uint8, 0)
        self.marked_slots = self._full((0,), wp.uint8, 0)
        self.free_slots = self._full((0,), wp.int32, 0)
        self.free_count = 0

    def _full(self, shape: tuple[int, ...], dtype: type, value: int) -> wp.array:
        array = empty(shape, dtype, name="the map", device=self.device)
        array.fill_(value)
        return array

    @property
    def size(self) -> NDArray[np.int64]:
        """Number of blocks along x, y and z."""
        return np.array(self.slot.shape)

    @property
    def block_side(self) -> float:
        """Side of a block [m]."""
        from warpvis.kernels.maps.occupancy_blocks import SIDE

        return SIDE * self.cell_size

    @property
    def used_slots(self) -> int:
        """Number of blocks that are not uniform."""
        return len(self.voxels) - self.free_count

    def struct(self) -> Blocks:
        """Return the blocks as a kernel argument."""
        from warpvis.kernels.maps.occupancy_blocks import Blocks

        blocks = Blocks()
        blocks.first, blocks.cell = wp.vec3i(*self.first.tolist()), self.cell_size
        blocks.slot, blocks.uniform, blocks.voxels = self.slot, self.uniform, self.voxels
        return blocks

    def include(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> None:
        """Grow the grid to include blocks from `low` to below `high`, counted from the world's origin."""
        from warpvis.kernels.maps import occupancy_blocks as kernels

        if not self.slot.size:
            self.first = low - _MARGIN
            end = self.first
        else:
            end = self.first + self.size
        if (low >= self.first).all() and (high <= end).all():
            return
        first = np.where(low < self.first, low - _MARGIN, self.first)
        end = np.where(high > end, high + _MARGIN, end)
        shape = tuple((end - first).tolist())
        if np.prod(shape) > _MAX_BLOCKS:
            sides = (end - first) * kernels.SIDE * self.cell_size
            raise ArrayError(
                f"the map must have at most {_MAX_BLOCKS} blocks, got {' x '.join(f'{side:.0f}' for side in sides)} m "
                f"in voxels of {self.cell_size} m; give it bounds or larger voxels"
            )
        slot, uniform = self._full(shape, wp.int32, -1), self._full(shape, wp.int16, int(kernels.NEVER_SEEN))
        if self.slot.size:
            starts = (self.first - first).tolist()
            x, y, z = (slice(start, start + count) for start, count in zip(starts, self.slot.shape, strict=True))
            slot[x, y, z].assign(self.slot)
            uniform[x, y, z].assign(self.uniform)
        self.first, self.slot, self.uniform = first, slot, uniform
        self.version += 1

    def take_slots(self, count: int) -> NDArray[np.int32]:
        """Return slots that were free."""
        if self.free_count < count:
            self.make_room(count)
        self.free_count -= count
        slots: NDArray[np.int32] = self.free_slots.numpy()[self.free_count : self.free_count + count]
        return slots

    def make_room(self, count: int) -> None:
        """Add slots until `count` are free."""
        old = len(self.voxels)
        slots = max(_MIN_SLOTS, old + old // 2, old - self.free_count + count)
        voxels, marks = (self._full((slots, self.voxels.shape[1]), dtype, 0) for dtype in (wp.int16, wp.uint8))
        if old:
            wp.copy(voxels, self.voxels, count=self.voxels.size)
        free = np.concatenate([self.free_slots.numpy()[: self.free_count], np.arange(old, slots)])
        self.voxels, self.marks, self.marked_slots = voxels, marks, self._full((slots,), wp.uint8, 0)
        self.free_slots = self._full((slots,), wp.int32, 0)
        self.free_count = len(free)
        self.version += 1
        wp.copy(self.free_slots, wp.array(free, dtype=wp.int32, device=self.device), count=len(free))
