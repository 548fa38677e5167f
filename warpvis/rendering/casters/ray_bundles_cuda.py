# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CUDA for ray bundles: lenses, panoramas, lidars."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import warp as wp

from warpvis.rendering.casters.base import ImagesByName, ViewBatch, needs_ids
from warpvis.rendering.casters.found_objects_cuda import nothing_found
from warpvis.rendering.casters.packed_launch_cuda import PackedPackets
from warpvis.rendering.casters.packet_images_cuda import POINTS_SIDE
from warpvis.rendering.casters.rays import MAX_ORIGIN_EXTENT, RayBundleCaster, origin_extent, takes_packets
from warpvis.rendering.casters.single_rays_cuda import rays_in_order, takes_sorted_rays
from warpvis.rendering.casters.sorted_rays_cuda import POINTS, PreparedPackets, prepare_packets

if TYPE_CHECKING:
    from warpvis.kernels.casting.packets import BvhScene
    from warpvis.kernels.casting.sorted_rays import SortedRays
    from warpvis.kernels.casting.worlds import Worlds


MAX_EYE_OFFSET = 2.0
"""Maximum distance at which the rays of a packet pass its eye [px m]; beyond it, single rays are faster.

In scenes with movable objects or instances, this is the median over all packets: either all rays are single, or none.
"""


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
        scene = self._scene.bvh(faces="faces" in images).struct
        if scene.drawn_count == 0 and self._splits(views):
            prepared, single = self._prepared(split=True), self._single_rays
            if prepared.count(_MIN_SIDE):
                self._cast_packets(scene, prepared, views, images)
            if single is not None:
                self._cast_sorted(single, "single rays", views, images)
        elif self._uses_single_rays(views.worlds):
            super().cast(views, images)
        else:
            self._cast_packets(scene, self._prepared(), views, images)

    def _cast_packets(self, scene: BvhScene, prepared: PreparedPackets, views: ViewBatch, images: ImagesByName) -> None:
        moving, poses, worlds = scene.drawn_count > 0, views.poses_on(self._scene.device), views.worlds
        kind = (needs_ids(images), moving, moving and worlds.object_sizes is not None, views.count)
        self._options.pool.use(
            (self, prepared, *kind),
            lambda: self._pack(prepared, *kind),
            lambda packed: packed.run(scene, poses, worlds, nothing_found(), images),
        )

    def _pack(self, prepared: PreparedPackets, with_id: bool, moving: bool, resized: bool, views: int) -> PackedPackets:
        origins, side = self._camera.origins is not None, packet_side(prepared, views, self._scene.device.sm_count)
        kinds = [(size, 0, packets) for size, packets in prepared.packets(side)]
        if prepared.points is not None:
            kinds.append((POINTS_SIDE, POINTS, prepared.points))
        groups = [
            (packet_kernel(size, with_id, moving, resized, points, origins), packets, (packets.windows.shape[0], 1))
            for size, points, packets in kinds
        ]
        lens, cull = self._camera.device_struct(), self._options.cull_backfaces
        return PackedPackets(groups, lens, views, cull, self._scene.device)

    def _splits(self, views: ViewBatch) -> bool:
        """Return whether some rays may be single and the others in packets, in a scene in which nothing moves.

        All rays from one point are in packets, in any scene.
        """
        camera = self._camera
        is_near = camera.origins is not None and origin_extent(camera) <= MAX_ORIGIN_EXTENT
        return is_near and takes_sorted_rays(self._options, views, camera.width * camera.height)

    def _uses_single_rays(self, worlds: Worlds) -> bool:
        clip_near = self._options.clip_near
        if self._camera.origins is not None:
            supported = takes_packets(self._scene, self._camera, worlds, clip_near, MAX_ORIGIN_EXTENT)
            return not supported or self._prepared().eye_offset > MAX_EYE_OFFSET
        return clip_near and self._camera.near > 0

    def _prepared(self, *, split: bool = False) -> PreparedPackets:
        """Return all rays in packets or, with `split`, only those that are faster in packets if objects do not move."""
        camera, device = self._camera, self._scene.device
        shape, origins, limit = (camera.height, camera.width, 3), camera.origins, MAX_EYE_OFFSET if split else None
        image_origins = None if origins is None else origins.reshape(shape)
        return camera.prepared(
            ("ray packets", device.alias, split),
            lambda: prepare_packets(camera.rays.reshape(shape), device, image_origins, limit),
        )

    @property
    def _single_rays(self) -> SortedRays | None:
        """The other rays; None if all are in packets."""
        camera, device = self._camera, self._scene.device

        def make() -> SortedRays | None:
            index = self._prepared(split=True).single
            return rays_in_order(camera, index, device) if len(index) else None

        return camera.prepared(("single rays", device.alias), make)


# Pairs of a side and the number of packets per multiprocessor from which it is faster than the next smaller one; and
# the minimum side.
_MIN_PACKETS, _MIN_SIDE = ((32, 64), (16, 12)), 8


def packet_side(prepared: PreparedPackets, views: int, processors: int) -> int:
    """Return the side of packets [px]: the largest that leaves enough of them for all multiprocessors of a GPU."""
    for side, packets_per_processor in _MIN_PACKETS:
        if views * prepared.count(side) >= packets_per_processor * processors:
            return side
    return _MIN_SIDE


@cache
def packet_kernel(side: int, with_id: bool, movable: bool, resized: bool, points: int, origins: bool) -> wp.Kernel:
    """Return the kernel of `make_ray_packet_kernel` with these arguments, which is made once."""
    from warpvis.kernels.casting.packets_cuda import make_ray_packet_kernel

    return make_ray_packet_kernel(side, with_id, movable, resized, points, origins)
