# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CPU cores for maps: images whose pixels show arbitrary points of the camera's image."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warpvis.cameras.pinhole import Camera
from warpvis.kernels.constants import BLOCK_SIDE, TILE_SIDE
from warpvis.rendering._cpu_packets import MAX_KINDS, CpuPacketsCaster, RayCosts, Workspace
from warpvis.rendering._prepared import FreeList
from warpvis.rendering._views import wants_faces
from warpvis.scene import Scene

if TYPE_CHECKING:
    from warpvis.kernels.casting.packets import BvhScene
    from warpvis.kernels.casting.worlds import Worlds

# Pixels of the trees' images are finer than the camera's by this factor, since bounds in the trees are whole pixels.
_FINENESS, _MAX_FOCAL = 32.0, 2.0**15
# A map is cast in packets if its blocks of 4 x 4 points have at most this width plus height on average [px], measured
# on at most this many blocks.
_MAX_BLOCK_SIZE, _MAX_SAMPLED_BLOCKS = 24.0, 64


class CpuRemapCaster(CpuPacketsCaster):
    """Cast coherent maps in packets too, with a tree over their points that is built for each view."""

    def __init__(self, scene: Scene, camera: Camera, *, cull_backfaces: bool, clip_near: bool, threads: int) -> None:
        """Set up the caster."""
        super().__init__(scene, camera, cull_backfaces=cull_backfaces, clip_near=clip_near, threads=threads)
        self._map_costs = RayCosts(threads)
        self._free_maps = FreeList[Workspace](MAX_KINDS)

    def cast_at(self, poses: np.ndarray, worlds: Worlds, pixels: wp.array, images: list[wp.array | None]) -> None:
        """Cast through image points, vec2 of shape ``(V, Y, X)``, which is also the images' shape; Y is 1 for lists."""
        if pixels.shape[1] > 1 and are_coherent(pixels):
            self._cast_map(poses, worlds, pixels, images)
        else:
            super().cast_at(poses, worlds, pixels, images)

    def _cast_map(self, poses: np.ndarray, worlds: Worlds, pixels: wp.array, images: list[wp.array | None]) -> None:
        views, rows, columns = pixels.shape
        rays = views * rows * columns
        scene = self._scene.bvh(faces=wants_faces(images)).struct
        workers = min(self._map_costs.threads_for(rays), views * -(-rows // TILE_SIDE))
        kind = (scene.levels, scene.drawn_count, pixels.shape, workers)
        workspace = self._free_maps.take(kind) or self._make_map_workspace(scene, pixels.shape, workers)
        workspace.fill(scene, poses, worlds, images)
        workspace.job.pixels = pixels.flatten().view(wp.float32).flatten()
        start = time.perf_counter_ns()
        workspace.run()
        self._map_costs.note(rays, workers, time.perf_counter_ns() - start)
        workspace.job.pixels = None
        self._free_maps.give_back(kind, workspace)

    def _make_map_workspace(self, scene: BvhScene, shape: tuple[int, int, int], workers: int) -> Workspace:
        from warpvis.kernels.casting.remap_packets import RemapCall, RemapJob, cast_remapped_packets

        job = RemapJob()
        job.views, job.rows, job.columns = shape
        job.camera = self._camera.device_struct(clip_near=self._clip_near)
        # The factor is a power of two, so that single precision suffices to convert coordinates.
        scale = min(_FINENESS, max(1.0, _MAX_FOCAL / self._camera.fx))
        job.tree_focal = self._camera.fx * 2.0 ** math.floor(math.log2(scale))
        job.cull_backfaces = int(self._cull_backfaces)
        job.scratch_bytes = wp.zeros(1, dtype=wp.int64, device="cpu")
        return Workspace(scene, cast_remapped_packets, (RemapCall(), RemapCall), job, workers)


def are_coherent(pixels: wp.array) -> bool:
    """Return whether a sample of blocks of a map, vec2 of shape ``(V, Y, X)``, is coherent in the image."""
    views, rows, columns = pixels.shape
    block_columns, block_rows = columns // BLOCK_SIDE, rows // BLOCK_SIDE
    blocks = views * block_columns * block_rows
    if blocks == 0:
        return False
    view, block = np.divmod(
        np.linspace(0, blocks - 1, min(blocks, _MAX_SAMPLED_BLOCKS)).astype(np.int64), block_columns * block_rows
    )
    row, column = (first[:, None] * BLOCK_SIDE + np.arange(BLOCK_SIDE) for first in np.divmod(block, block_columns))
    positions = pixels.numpy()[view[:, None, None], row[:, :, None], column[:, None, :]].reshape(len(view), -1, 2)
    is_finite = np.isfinite(positions)
    high = np.where(is_finite, positions, -np.inf).max(axis=1)
    size = high - np.where(is_finite, positions, np.inf).min(axis=1)
    nonempty = np.isfinite(high).all(axis=-1)
    return not nonempty.any() or float(size[nonempty].sum(axis=-1).mean()) <= _MAX_BLOCK_SIZE
