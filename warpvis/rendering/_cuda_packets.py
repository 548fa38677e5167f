# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CUDA: one warp takes a block of pixels of a view down the BVH."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import warp as wp

from warpvis.core.kernel_cache import launch
from warpvis.kernels.constants import CUDA_LANES
from warpvis.rendering.casters import RaysCaster, images_struct

if TYPE_CHECKING:
    from warpvis.kernels.worlds import Worlds


class CudaPacketsCaster(RaysCaster):
    """A warp a packet; points of the image are cast as rays."""

    def cast(self, poses: wp.array, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels and segmentation of all poses; None is not made."""
        views, device = len(poses), self._scene.device
        if views == 0:
            return
        clusters, camera = self._scene.bvh(), self._camera
        moving = bool(clusters.struct.movable_count)
        _, _, *of_triangles = images
        large_packets = (12 if clusters.moves_solids_only else 32) if moving else 64
        side = packet_side(views, camera.width, camera.height, device.sm_count, large_packets)
        with_id = any(image is not None for image in of_triangles)
        lens, outputs = camera.device_struct(clip_near=self._clip_near), images_struct(images)
        launch(
            _kernel(side, with_id, moving, self._clip_near, moving and worlds.object_sizes is not None),
            (views, -(-camera.height // side), -(-camera.width // side), CUDA_LANES),
            [clusters.struct, lens, poses, worlds, self._cull_backfaces, outputs],
            device,
            block_dim=CUDA_LANES,
        )


@cache
def _kernel(side: int, with_id: bool, movable: bool, clip: bool, resized: bool) -> wp.Kernel:
    from warpvis.kernels.packets_cuda import make_packet_kernel

    return make_packet_kernel(side, with_id, movable, clip, resized)


def packet_side(views: int, width: int, height: int, processors: int, large_packets: int = 64) -> int:
    """Choose the pixels a side of a packet: as many as leave enough packets for all multiprocessors.

    Images do not depend on it. The larger a packet, the fewer of them set up the same triangle; the smaller, the sooner
    the last one is done. See docs/internals/gpu.md for the measurements.

    Args:
        views: Images to make.
        width: Their width [px].
        height: Their height [px].
        processors: Multiprocessors of the GPU.
        large_packets: From how many a multiprocessor on packets of 32x32 are the fastest.
    """
    for side, packets_per_processor in ((32, large_packets), (16, 24)):
        if views * -(-width // side) * -(-height // side) >= packets_per_processor * processors:
            return side
    return 8
