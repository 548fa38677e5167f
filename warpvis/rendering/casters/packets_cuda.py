# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CUDA: one warp traverses the BVH for a block of pixels of a view."""

from __future__ import annotations

import ctypes
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

import warp as wp

from warpvis.cameras.pinhole import Camera
from warpvis.core.kernel_cache import launch
from warpvis.kernels.constants import CUDA_LANES
from warpvis.rendering.casters.base import ImagesByName, ImageSlots, ViewBatch, needs_ids
from warpvis.rendering.casters.found_objects_cuda import MANY_OBJECTS, find_objects, nothing_found
from warpvis.rendering.casters.points_cuda import cast_point_packets, takes_packets
from warpvis.rendering.casters.rays import RaysCaster

if TYPE_CHECKING:
    from warpvis.kernels.pinhole import PinholeCamera

# By whether the scene has movable objects, which every packet tests: pairs of a packet height and the number of packets
# per multiprocessor from which it is faster than the next smaller height; and the minimum height.
_MIN_PACKETS = {False: (((16, 24), (8, 32), (4, 24), (2, 8)), 1), True: (((16, 24), (8, 16)), 4)}
_Kind = tuple[int, bool, bool, bool, bool, int]
"""Arguments of `_kernel`, followed by the number of views."""


class _PackedLaunch:
    """A packed launch: packing can take longer than a GPU takes to render an image.

    CUDA reads the structs when the launch is submitted. A call only writes addresses into them, without keeping the
    arrays alive.
    """

    def __init__(self, kind: _Kind, camera: PinholeCamera, packets: tuple[int, int], cull: bool, device: wp.Device):
        """Pack a launch; `packets` is the number of rows and columns of packets."""
        from warpvis.kernels.casting.packets import BvhScene
        from warpvis.kernels.casting.packets_cuda import FoundObjects
        from warpvis.kernels.casting.point_order import PointLists
        from warpvis.kernels.casting.worlds import Worlds

        views = kind[-1]
        self._images = ImageSlots()
        scene, worlds, found = BvhScene(), Worlds(), FoundObjects()
        poses = wp.array(ptr=1, dtype=wp.transform, shape=(views,), device=device)  # placeholder address
        self._poses, self._scene, self._worlds = poses.__ctype__(), _Assigned(scene), _Assigned(worlds)
        self._found = _Assigned(found)
        inputs = [scene, camera, poses, worlds, found, PointLists(), cull, self._images.struct]
        size = (packets[0], views, packets[1], CUDA_LANES)
        self._launch = launch(_kernel(*kind[:-1]), size, inputs, device, block_dim=CUDA_LANES, record_cmd=True)

    def run(self, scene: Any, poses: wp.array, worlds: Any, found: Any, images: ImagesByName) -> None:
        """Launch on the device's current stream."""
        self._scene.memory.struct, self._worlds.memory.struct = scene.__ctype__(), worlds.__ctype__()
        self._found.memory.struct = found.__ctype__()
        self._poses.data = poses.ptr
        self._images.fill(images)
        self._launch.launch()


class _Assigned:
    """Wrap a Warp struct so that another one of its type can be assigned to it: ctypes assigns only to fields."""

    def __init__(self, struct: Any) -> None:
        self._owner = struct
        memory = struct.__ctype__()
        holder: Any = type("Holder", (ctypes.Structure,), {"_fields_": [("struct", type(memory))]})
        self.memory = holder.from_address(ctypes.addressof(memory))


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

    def _pack(self, kind: _Kind) -> _PackedLaunch:
        from warpvis.kernels.casting.packets_cuda import packet_width

        side, camera = kind[0], self._camera
        lens = camera.device_struct(clip_near=self._options.clip_near)
        packets = -(-camera.height // side), -(-camera.width // packet_width(side))
        return _PackedLaunch(kind, lens, packets, self._options.cull_backfaces, self._scene.device)


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
