# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CUDA for ray bundles: lenses, panoramas, lidars."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import warp as wp

from warpvis.core.kernel_cache import launch
from warpvis.kernels.constants import CUDA_LANES
from warpvis.rendering.casters.base import ImagesByName, ViewBatch, images_struct, needs_ids
from warpvis.rendering.casters.found_objects_cuda import nothing_found
from warpvis.rendering.casters.packet_images_cuda import POINTS_SIDE
from warpvis.rendering.casters.rays import MAX_ORIGIN_EXTENT, RayBundleCaster, takes_packets
from warpvis.rendering.casters.sorted_rays_cuda import POINTS, PreparedPackets, prepare_packets

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds


MAX_EYE_OFFSET = 2.0
"""Maximum median distance at which the rays of a packet pass its eye [px m]; beyond it, single rays are faster."""


class CudaRayBundleCaster(RayBundleCaster):
    """Cast packets of neighboring rays, one warp per packet; image points are cast as single rays.

    Rays with distinct origins are cast in packets where `takes_packets` allows it, and as single rays otherwise.
    """

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        """Write images of all views."""
        if not views.count:
            return
        if views.pixels is not None:
            super().cast(views, images)
            return
        scene, prepared, worlds = self._scene.bvh(faces="faces" in images).struct, self._prepared, views.worlds
        if self._uses_single_rays(worlds):
            super().cast(views, images)
            return
        with_id, moving, poses = needs_ids(images), scene.drawn_count > 0, views.poses_on(self._scene.device)
        outputs, lens = images_struct(images), self._camera.device_struct()
        resized, origins = moving and worlds.object_sizes is not None, self._camera.origins is not None
        kinds = [(side, 0, packets) for side, packets in prepared.packets]
        if prepared.points is not None:
            kinds.append((POINTS_SIDE, POINTS, prepared.points))
        for side, points, packets in kinds:
            launch(
                _kernel(side, with_id, moving, resized, points, origins),
                (packets.frame.shape[0], views.count, 1, CUDA_LANES),
                [scene, lens, poses, worlds, nothing_found(), packets, self._options.cull_backfaces, outputs],
                self._scene.device,
                block_dim=CUDA_LANES,
            )

    def _uses_single_rays(self, worlds: Worlds) -> bool:
        clip_near = self._options.clip_near
        if self._camera.origins is not None:
            supported = takes_packets(self._scene, self._camera, worlds, clip_near, MAX_ORIGIN_EXTENT)
            return not supported or self._prepared.eye_offset > MAX_EYE_OFFSET
        return clip_near and self._camera.near > 0

    @property
    def _prepared(self) -> PreparedPackets:
        camera, device = self._camera, self._scene.device
        shape, origins = (camera.height, camera.width, 3), camera.origins
        image_origins = None if origins is None else origins.reshape(shape)
        return camera.prepared(
            ("ray packets", device.alias), lambda: prepare_packets(camera.rays.reshape(shape), device, image_origins)
        )


@cache
def _kernel(side: int, with_id: bool, movable: bool, resized: bool, points: int, origins: bool) -> wp.Kernel:
    from warpvis.kernels.casting.packets_cuda import make_ray_packet_kernel

    return make_ray_packet_kernel(side, with_id, movable, resized, points, origins)
