# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Culling of movable objects on a GPU: sorting them into image tiles before packets are cast."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import warp as wp

from warpvis.core.kernel_cache import launch
from warpvis.kernels.constants import CUDA_LANES

if TYPE_CHECKING:
    from warpvis.cameras.base import AnyCamera
    from warpvis.kernels.casting.packets import BvhScene
    from warpvis.kernels.casting.packets_cuda import FoundObjects
    from warpvis.kernels.casting.worlds import Worlds

MANY_OBJECTS = 256
"""Number of movable objects from which they are sorted into tiles; with fewer, each packet tests all of them."""

# Maximum number of views times objects, which takes 2 GB; beyond it, each packet tests all objects.
_MAX_PAIRS = 1 << 26
# Columns and rows of pixels are stored in 16 bits.
_MAX_SIDE = 0xFFFF
_BLOCK = 128


def find_objects(
    scene: BvhScene, camera: AnyCamera, clip_near: bool, poses: wp.array, worlds: Worlds, device: wp.Device
) -> FoundObjects:
    """Find the movable objects that may be visible in each view, and sort them into tiles of its image.

    Args:
        scene: The acceleration structures.
        camera: The camera of all views.
        clip_near: Whether surfaces nearer than the camera's `near` are cut away.
        poses: Camera to world, shape ``(V,)``, transforms on the device.
        worlds: Poses and scales of objects.
        device: A GPU.

    Returns:
        The objects of each tile; without arrays, as from `nothing_found`, if they would take too much memory.
    """
    from warpvis.kernels.casting.packets_cuda import MAX_TILES, TILE_BITS, FoundObjects, sort_into_tiles

    count, views = scene.drawn_count, len(poses)
    if views * count > _MAX_PAIRS or max(camera.width, camera.height) > _MAX_SIDE:
        return nothing_found()
    found = FoundObjects()
    found.tiles_y, found.tiles_x = (-(-side >> TILE_BITS) for side in (camera.height, camera.width))
    tiles = views * found.tiles_y * found.tiles_x
    found.entries = wp.empty((views, count), dtype=wp.vec4i, device=device)
    found.counts = wp.zeros((views, 2), dtype=wp.int32, device=device)
    found.tile_counts = wp.zeros(tiles, dtype=wp.int32, device=device)
    found.tile_ends = wp.empty(tiles, dtype=wp.int32, device=device)
    found.order = wp.empty(MAX_TILES * views * count, dtype=wp.int32, device=device)
    lens = camera.device_struct(clip_near=clip_near)
    size = views, -(-count // CUDA_LANES), CUDA_LANES
    launch(
        _kernel(worlds.object_sizes is not None), size, [scene, lens, poses, worlds, found], device, block_dim=_BLOCK
    )
    wp.utils.array_scan(found.tile_counts, found.tile_ends, inclusive=True)
    launch(sort_into_tiles, (views, count), [found], device)
    return found


@cache
def nothing_found() -> FoundObjects:
    """Return an empty struct, which makes packets test all objects."""
    from warpvis.kernels.casting.packets_cuda import FoundObjects

    return FoundObjects()


@cache
def _kernel(resized: bool) -> wp.Kernel:
    from warpvis.kernels.casting.packets_cuda import make_find_kernel

    return make_find_kernel(resized)
