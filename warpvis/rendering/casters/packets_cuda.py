# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CUDA: one warp traverses the BVH for a block of pixels of a view."""

from __future__ import annotations

from functools import cache, lru_cache

import warp as wp

from warpvis.cameras.pinhole import Camera
from warpvis.rendering.casters.base import ImagesByName, ViewBatch, needs_ids
from warpvis.rendering.casters.found_objects_cuda import MANY_OBJECTS, find_objects, nothing_found
from warpvis.rendering.casters.packed_launch_cuda import PackedPackets
from warpvis.rendering.casters.points_cuda import cast_point_packets, takes_packets
from warpvis.rendering.casters.rays import RaysCaster

# By whether the scene has movable objects, which every packet tests: pairs of a packet height and the number of packets
# per multiprocessor from which it is faster than the next smaller height; and the minimum height.
_MIN_PACKETS = {False: (((16, 24), (8, 32), (4, 24), (2, 8)), 1), True: (((16, 24), (8, 16)), 4)}
_Kind = tuple[int, bool, bool, bool, bool, int]
"""Arguments of `_kernel`, followed by the number of views."""


class CudaPacketsCaster(RaysCaster):
    """Cast packets of pixels or image points, one warp per packet; few image points are cast as single rays."""

    _camera: Camera

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        """Write images of all views."""
        device, worlds = self._scene.device, views.worlds
        if not views.count:
            return
        if views.pixels is not None and not takes_packets(views.pixels.shape[1] * views.pixels.shape[2]):
            super().cast(views, images)
            return
        clusters, camera, clip = self._scene.bvh(faces="faces" in images), self._camera, self._options.clip_near
        scene, poses = clusters.struct, views.poses_on(device)
        if views.pixels is not None:
            cast_point_packets(scene, camera, self._options, views, images)
            return
        movable_count = scene.drawn_count
        moving, large_packets = movable_count > 0, 64
        if 0 < movable_count < MANY_OBJECTS:
            large_packets = 12 if clusters.moves_solids_only else 32
        side = packet_side(views.count, camera.width, camera.height, device.sm_count, large_packets, moving=moving)
        resized = moving and worlds.object_sizes is not None
        kind: _Kind = (side, needs_ids(images), moving, clip, resized, views.count)
        found = nothing_found()
        if movable_count >= MANY_OBJECTS:
            found = find_objects(scene, camera, clip, poses, worlds, device)
        self._options.pool.use(
            (self, *kind), lambda: self._pack(kind), lambda packed: packed.run(scene, poses, worlds, found, images)
        )

    def _pack(self, kind: _Kind) -> PackedPackets:
        from warpvis.kernels.casting.packets_cuda import packet_width
        from warpvis.kernels.casting.point_order import PointLists

        side, camera = kind[0], self._camera
        lens = camera.device_struct(clip_near=self._options.clip_near)
        packets = -(-camera.height // side), -(-camera.width // packet_width(side))
        groups = [(_kernel(*kind[:-1]), PointLists(), packets)]
        return PackedPackets(groups, lens, kind[-1], self._options.cull_backfaces, self._scene.device)


@cache
def _kernel(side: int, with_id: bool, movable: bool, clip: bool, resized: bool) -> wp.Kernel:
    from warpvis.kernels.casting.packets_cuda import make_packet_kernel

    return make_packet_kernel(side, with_id, movable, clip, resized)


@lru_cache(maxsize=1024)
def packet_side(
    views: int,
    width: int,
    height: int,
    processors: int,
    large_packets: int = 64,
    *,
    moving: bool = False,
) -> int:
    """Return the height of packets [px]: the largest that leaves enough packets for all multiprocessors.

    Images do not depend on it. With larger packets, fewer packets set up the same triangle; with smaller packets, the
    last one finishes sooner. See docs/internals/gpu.md for the measurements.

    Args:
        views: Number of images.
        width: Width of an image [px].
        height: Height of an image [px].
        processors: Number of multiprocessors of the GPU.
        large_packets: Number of packets per multiprocessor from which packets of 32x32 are fastest.
        moving: Whether the scene has movable objects, which packets must test.
    """
    from warpvis.kernels.casting.packets_cuda import packet_width

    sides, min_side = _MIN_PACKETS[moving]
    for side, packets_per_processor in ((32, large_packets), *sides):
        if views * -(-width // packet_width(side)) * -(-height // side) >= packets_per_processor * processors:
            return side
    return min_side
