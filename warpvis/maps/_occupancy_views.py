# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Integration of depth images into the blocks of an occupancy map; see `warpvis.kernels.maps.occupancy`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import empty
from warpvis.core.checks import is_number
from warpvis.core.kernel_cache import launch
from warpvis.core.threads import WHOLE_ROW, launch_images
from warpvis.maps._depth_sigma import Sigma, fit_sigma
from warpvis.maps._occupancy_blocks import BlockStorage

if TYPE_CHECKING:
    from warpvis.kernels.maps.occupancy import DepthView

# Blocks that a CUDA thread judges.
_CUDA_SPAN = 8

# Minimum number of pixels or blocks that a CPU thread processes at a time.
_MIN_PIXELS, _MIN_BLOCKS = 4096, 64


class Integrator:
    """Adds depth images to blocks, one after the other, and keeps memory for the next image."""

    def __init__(self, blocks: BlockStorage, bounds: NDArray[np.float64] | None, log_odds: dict[str, float]) -> None:
        """Create an integrator.

        Args:
            blocks: The map.
            bounds: Lower and upper corner of the space to map [m], shape ``(2, 3)``; None for all space.
            log_odds: The change by a ``hit`` and a ``miss``, and the ``minimum`` and ``maximum``.
        """
        self._blocks, self._bounds, self._log_odds = blocks, bounds, log_odds
        self._device = blocks.device
        self.by_rows = blocks.device.is_cpu
        """Whether kernels of `warpvis.kernels.maps.occupancy_rows` are used."""
        self._scratch: dict[str, wp.array] = {}

    def add(
        self,
        images: wp.array,
        camera: Camera,
        camera_to_world: NDArray[np.float64],
        sigma: Sigma,
        reach: float,
        threads: int | None,
    ) -> None:
        """Add images ``(V, H, W)`` with poses ``(V, 4, 4)`` up to the depth `reach` [m]."""
        view = self._view_struct(camera, sigma, reach)
        for index, matrix in enumerate(camera_to_world):
            low, high = self._frustum_blocks(camera, matrix, reach)
            if (high <= low).any():
                continue
            self._blocks.include(low, high)
            rotation = matrix[:3, :3].T
            view.origin, view.rotation = wp.vec3d(*matrix[:3, 3]), wp.mat33d(*rotation.ravel())
            view.block_extent = wp.vec3(*(0.5 * self._blocks.block_side * np.abs(rotation).sum(axis=1)))
            depth = images[index : index + 1]
            bounds = self._scratch_array("bounds", depth.shape, wp.vec2)
            updates = self._judge_blocks(view, depth, bounds, rotation, (low, high), threads)
            self._update_voxels(view, depth, bounds, updates, low, threads)

    def _view_struct(self, camera: Camera, sigma: Sigma, reach: float) -> DepthView:
        from warpvis.kernels.maps.occupancy import DepthView
        from warpvis.kernels.maps.occupancy_blocks import LOG_ODDS_UNIT

        view = DepthView()
        view.camera, view.reach = camera.device_struct(), reach
        is_exact = is_number(sigma) and sigma == 0
        view.sigma = wp.vec3(0.0, 0.0, 0.0) if is_exact else wp.vec3(*fit_sigma(sigma, camera, reach))
        for name, value in self._log_odds.items():
            setattr(view, name, round(value / LOG_ODDS_UNIT))
        return view

    def _frustum_blocks(
        self, camera: Camera, matrix: NDArray[np.float64], reach: float
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the first blocks and those past the last of a box that contains the image up to a depth."""
        corners = camera.depth_rays([(0, 0), (camera.width, 0), (0, camera.height), (camera.width, camera.height)])
        places = np.vstack([np.zeros(3), reach * corners]) @ matrix[:3, :3].T + matrix[:3, 3]
        low, high = places.min(axis=0), places.max(axis=0)
        if self._bounds is not None:
            low, high = np.maximum(low, self._bounds[0]), np.minimum(high, self._bounds[1])
        side = self._blocks.block_side
        return np.floor(low / side).astype(np.int64), np.ceil(high / side).astype(np.int64)

    def _judge_blocks(
        self,
        view: DepthView,
        depth: wp.array,
        bounds: wp.array,
        rotation: NDArray[np.float64],
        box: tuple[NDArray[np.int64], NDArray[np.int64]],
        threads: int | None,
    ) -> wp.array:
        """Write the intervals that contain surfaces, update uniform blocks, and return which others need an update."""
        low, high = box
        shape = tuple((high - low).tolist())
        tile_shape = self._tile_shape(depth)
        tiles = self._scratch_array("tiles", tile_shape, wp.vec3)
        updates = self._scratch_array("updates", shape, wp.uint8)
        self._run("bound_surface", depth.shape, [view, depth, bounds], threads, by_rows=True)
        self._run("bound_tiles", tile_shape, [bounds, tiles], threads)

        first_center = wp.vec3(*(rotation @ ((low + 0.5) * self._blocks.block_side - np.array(view.origin))))
        step = wp.mat33(*(self._blocks.block_side * rotation.T).ravel())
        span = shape[2] if self._device.is_cpu else _CUDA_SPAN
        inputs = [view, self._corner(low), first_center, step, span, tiles, self._blocks.struct(), updates]
        self._run("judge_blocks", shape, inputs, threads, span=span)
        return updates

    def _update_voxels(
        self,
        view: DepthView,
        depth: wp.array,
        bounds: wp.array,
        updates: wp.array,
        low: NDArray[np.int64],
        threads: int | None,
    ) -> None:
        """Update the voxels of the blocks that need it."""
        from warpvis.kernels.maps import occupancy_blocks as kernels

        listed, count_new = self._list_blocks(self._corner(low), updates)
        count = len(listed)
        if not count:
            return
        self._blocks.fill(listed, count_new)
        blocks, summaries = self._blocks.struct(), self._scratch_array("summaries", (count,), wp.int32)
        marks = [self._blocks.marks, self._blocks.marked_slots] if self.by_rows else [self._blocks.marks]
        self._run("mark_points", depth.shape, [view, blocks, depth, *marks], threads, by_rows=True)
        inputs = [view, listed, bounds, blocks, *marks]
        if self.by_rows:
            tiles = self._scratch_array("tiles", self._tile_shape(depth), wp.vec3)
            inputs, shape = [view, listed, bounds, tiles, blocks, *marks, summaries], (count, 1, 1)
            self._run("update_voxels", shape, inputs, threads, by_rows=True, min_pixels=_MIN_BLOCKS)
        else:
            self._run("update_voxels", (count, kernels.SIDE, kernels.SIDE), inputs, threads)
            launch(kernels.summarize_blocks, count, [blocks, listed, summaries], self._device)
        self._blocks.release(listed, summaries)

    @staticmethod
    def _tile_shape(depth: wp.array) -> tuple[int, ...]:
        from warpvis.kernels.maps.occupancy import TILE

        return (1, *(-(-side // TILE) for side in depth.shape[1:]))

    def _list_blocks(self, lower: wp.vec3i, updates: wp.array) -> tuple[wp.array, int]:
        """Return the blocks that need an update, and the number of those without a slot."""
        from warpvis.kernels.maps import occupancy_blocks as kernels

        blocks = self._blocks.struct()
        capacity = max(1024, len(self._scratch.get("listed", ())))
        while True:
            listed = self._scratch_array("listed", (capacity,), wp.vec4i)
            counts = self._scratch_array("counts", (2,), wp.int32)
            counts.zero_()
            launch(kernels.list_blocks, updates.shape, [blocks, lower, updates, listed, counts], self._device)
            count, count_new = counts.numpy().tolist()
            if count <= capacity:
                return listed[:count], count_new
            capacity = 2 * count

    def _corner(self, low: NDArray[np.int64]) -> wp.vec3i:
        """Return the index of a block in the grid, from its index from the world's origin."""
        return wp.vec3i(*(low - self._blocks.first).tolist())

    def _run(
        self,
        name: str,
        shape: tuple[int, ...],
        inputs: list[object],
        threads: int | None,
        *,
        by_rows: bool = False,
        span: int = 1,
        min_pixels: int = _MIN_PIXELS,
    ) -> None:
        """Launch a kernel: on CPU cores that of a whole row, if there is one."""
        from warpvis.kernels.maps import occupancy, occupancy_rows

        by_rows = by_rows and self.by_rows
        kernel = getattr(occupancy_rows if by_rows else occupancy, name)
        views, rows, columns = shape
        launch_images(
            kernel,
            (views, rows, columns),
            lambda window: [window, *inputs],
            device=self._device,
            threads=threads,
            span=WHOLE_ROW if by_rows else span,
            min_pixels=min_pixels,
        )

    def _scratch_array(self, name: str, shape: tuple[int, ...], dtype: type) -> wp.array:
        """Return an uninitialized array, which is kept for the next image."""
        size = math.prod(shape)
        memory = self._scratch.get(name)
        if memory is None or memory.size < size:
            memory = self._scratch[name] = empty((size,), dtype, name="the map", device=self._device)
        return memory[:size].reshape(shape)
