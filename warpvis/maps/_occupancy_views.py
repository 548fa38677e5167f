# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The views and boxes of blocks of depth images that an occupancy map integrates."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import is_number
from warpvis.maps._depth_sigma import Sigma, fit_sigma
from warpvis.maps._occupancy_batch import Batch
from warpvis.maps._occupancy_blocks import BlockStorage


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
        self.batch = Batch(blocks)
        """The kernels."""
        self._common: _Common | None = None

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
        common = self._common
        if common is None or not common.serves(camera, sigma, reach):
            common = self._common = _Common(camera, sigma, reach, self._log_odds)
        low, high = self._frustum_blocks(common.corners, camera_to_world)
        shown = np.all(high > low, axis=1)
        if not shown.any():
            return
        self._blocks.include(low[shown].min(axis=0), high[shown].max(axis=0))
        boxes = self._boxes(camera_to_world, low, np.where(shown[:, None], high - low, 0))
        self.batch.integrate(images, common.views(camera_to_world), boxes, threads)

    def _boxes(
        self, camera_to_world: NDArray[np.float64], low: NDArray[np.int64], size: NDArray[np.int64]
    ) -> NDArray[np.void]:
        from warpvis.kernels.maps.occupancy_blocks import BlockBox

        boxes = np.zeros(len(low), dtype=_fields(BlockBox))
        side, axes = self._blocks.block_side, camera_to_world[:, :3, :3]
        boxes["lower"], boxes["size"] = low, size
        offsets = (low + 0.5) * side - camera_to_world[:, :3, 3]
        boxes["first_center"] = np.einsum("vwc,vw->vc", axes, offsets)
        boxes["step"] = side * axes
        boxes["extent"] = 0.5 * side * np.abs(axes).sum(axis=1)
        return boxes

    def _frustum_blocks(
        self, corners: NDArray[np.float64], camera_to_world: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the first block and that past the last of a box that contains each frustum, ``(V, 3)``."""
        places = corners @ camera_to_world[:, :3, :3].transpose(0, 2, 1) + camera_to_world[:, None, :3, 3]
        low, high = places.min(axis=1), places.max(axis=1)
        if self._bounds is not None:
            low, high = np.maximum(low, self._bounds[0]), np.minimum(high, self._bounds[1])
        side = self._blocks.block_side
        return np.floor(low / side).astype(np.int64), np.ceil(high / side).astype(np.int64)


class _Common:
    """What all images of a camera have in common; it takes longer to compute than what depends on the pose."""

    def __init__(self, camera: Camera, sigma: Sigma, reach: float, log_odds: dict[str, float]) -> None:
        from warpvis.kernels.maps.occupancy_blocks import LOG_ODDS_UNIT
        from warpvis.kernels.maps.occupancy_images import DepthView

        self._camera, self._sigma, self._reach = camera, sigma, reach
        view = np.zeros((), dtype=_fields(DepthView))
        struct: Any = camera.device_struct()
        view["camera"] = struct.numpy_value()
        view["reach"] = reach
        if not (is_number(sigma) and sigma == 0):
            view["sigma"] = fit_sigma(sigma, camera, reach)
        for name, value in log_odds.items():
            view[name] = round(value / LOG_ODDS_UNIT)
        self._view = view
        corners = camera.depth_rays([(0, 0), (camera.width, 0), (0, camera.height), (camera.width, camera.height)])
        self.corners = np.vstack([np.zeros(3), reach * corners])
        """Corners of the frustum up to `reach` in the camera frame [m], shape ``(5, 3)``."""

    def serves(self, camera: Camera, sigma: Sigma, reach: float) -> bool:
        """Return whether these are the same options."""
        same_sigma = sigma is self._sigma or (is_number(sigma) and is_number(self._sigma) and sigma == self._sigma)
        return same_sigma and camera == self._camera and reach == self._reach

    def views(self, camera_to_world: NDArray[np.float64]) -> NDArray[np.void]:
        """Return fields of `DepthView` for poses, ``(V,)``."""
        views = np.full(len(camera_to_world), self._view)
        views["origin"] = camera_to_world[:, :3, 3]
        views["rotation"] = camera_to_world[:, :3, :3].transpose(0, 2, 1)
        return views


@cache
def _fields(struct: Any) -> np.dtype[np.void]:
    """Return the data type of a kernel's struct, which takes Warp longer to find than some images to integrate."""
    return np.dtype(struct.numpy_dtype())
