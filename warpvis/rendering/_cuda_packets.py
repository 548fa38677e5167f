# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CUDA: one warp takes a block of pixels of a view down the BVH."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import TYPE_CHECKING, Any

import warp as wp

from warpvis.core.camera import Camera
from warpvis.core.kernel_cache import launch
from warpvis.kernels.constants import CUDA_LANES
from warpvis.rendering._cuda_points import cast_point_packets, takes_packets
from warpvis.rendering._found_objects import MANY_OBJECTS, find_objects, nothing_found
from warpvis.rendering._prepared import Idle, ImageSlots, memory_of
from warpvis.rendering._views import wants_faces, wants_ids
from warpvis.rendering.casters import CastPoses, RaysCaster

if TYPE_CHECKING:
    from warpvis.kernels.packets import BvhScene
    from warpvis.kernels.packets_cuda import FoundObjects
    from warpvis.kernels.pinhole import PinholeCamera
    from warpvis.kernels.worlds import Worlds

# Heights of packets, from how many on a multiprocessor on they are faster than the next, and the least height: where
# all stays, and where objects move, which every packet looks for.
_FEWEST_PACKETS = {False: (((16, 24), (8, 32), (4, 24), (2, 8)), 1), True: (((16, 24), (8, 16)), 4)}
# So many kinds of calls have a launch that waits for the next one.
_MAX_KINDS = 4

_Kind = tuple[int, bool, bool, bool, bool, int]
"""What `_kernel` makes a kernel of, and views."""


class _PackedLaunch:
    """A launch that is packed once, which takes longer than a GPU takes for many an image.

    CUDA reads these structs when it is launched. A call writes addresses into them, and keeps none: what the caller
    drops does not live on.
    """

    def __init__(self, kind: _Kind, camera: PinholeCamera, packets: tuple[int, int], cull: bool, device: wp.Device):
        """Pack a launch of so many rows and columns of packets."""
        from warpvis.kernels.packets import BvhScene
        from warpvis.kernels.packets_cuda import FoundObjects
        from warpvis.kernels.worlds import Worlds

        views = kind[-1]
        self._images = ImageSlots()
        scene, worlds, found = BvhScene(), Worlds(), FoundObjects()
        poses = wp.array(ptr=1, dtype=wp.transform, shape=(views,), device=device)  # not yet any
        self._poses, self._scene, self._worlds = memory_of(poses), _Assigned(scene), _Assigned(worlds)
        self._found = _Assigned(found)
        inputs = [scene, camera, poses, worlds, found, cull, self._images.struct]
        size = (packets[0], views, packets[1], CUDA_LANES)
        self._launch = launch(_kernel(*kind[:-1]), size, inputs, device, block_dim=CUDA_LANES, record_cmd=True)

    def run(
        self,
        scene: BvhScene,
        poses: wp.array,
        worlds: Worlds,
        found: FoundObjects,
        images: list[wp.array | None],
    ) -> None:
        """Launch it on the device's current stream."""
        self._scene.memory.struct, self._worlds.memory.struct = memory_of(scene), memory_of(worlds)
        self._found.memory.struct = memory_of(found)
        self._poses.data = poses.ptr
        self._images.fill(images)
        self._launch.launch()


class _Assigned:
    """A struct of Warp's to which another one of its kind can be assigned: ctypes does that to fields only."""

    def __init__(self, struct: Any) -> None:
        self._owner = struct
        memory = memory_of(struct)
        holder: Any = type("Holder", (ctypes.Structure,), {"_fields_": [("struct", type(memory))]})
        self.memory = holder.from_address(ctypes.addressof(memory))


class CudaPacketsCaster(RaysCaster):
    """A warp a packet of pixels, or of points of the image; few points are cast as rays."""

    _camera: Camera

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Prepare to cast, as `RaysCaster` does."""
        super().__init__(*arguments, **options)
        self._idle = Idle[_PackedLaunch](_MAX_KINDS)

    def cast(self, poses: CastPoses, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels, segmentation and faces of all poses; None is not made."""
        views, device = len(poses), self._scene.device
        if views == 0:
            return
        clusters, camera = self._scene.bvh(faces=wants_faces(images)), self._camera
        drawn = clusters.struct.drawn_count
        moving, large_packets = drawn > 0, 64
        if 0 < drawn < MANY_OBJECTS:
            large_packets = 12 if clusters.moves_solids_only else 32
        side = packet_side(views, camera.width, camera.height, device.sm_count, large_packets, moving=moving)
        kind = (side, wants_ids(images), moving, self._clip_near, moving and worlds.object_sizes is not None, views)
        packed = self._idle.take(kind) or self._pack(kind)
        places, staging = self._place(poses)
        self._draw(packed, clusters.struct, places, worlds, images)
        self._give_back(staging)
        self._idle.give_back(kind, packed)

    def cast_at(self, poses: CastPoses, worlds: Worlds, pixels: wp.array, images: list[wp.array | None]) -> None:
        """Cast through image points, shape ``(V, Y, X)`` vec2, as are the images'; lists of them have one row."""
        if not takes_packets(pixels.shape[1] * pixels.shape[2]):
            super().cast_at(poses, worlds, pixels, images)
            return
        places, staging = self._place(poses)
        options = self._cull_backfaces, self._clip_near
        scene, points = self._scene.bvh(faces=wants_faces(images)).struct, pixels.contiguous()
        cast_point_packets(scene, self._camera, options, places, worlds, points, images)
        self._give_back(staging)

    def _draw(
        self, packed: _PackedLaunch, scene: BvhScene, poses: wp.array, worlds: Worlds, images: list[wp.array | None]
    ) -> None:
        found = nothing_found()
        if scene.drawn_count >= MANY_OBJECTS:
            found = find_objects(scene, self._camera, self._clip_near, poses, worlds, self._scene.device)
        packed.run(scene, poses, worlds, found, images)

    def _pack(self, kind: _Kind) -> _PackedLaunch:
        from warpvis.kernels.packets_cuda import packet_width

        side, camera = kind[0], self._camera
        lens = camera.device_struct(clip_near=self._clip_near)
        packets = -(-camera.height // side), -(-camera.width // packet_width(side))
        return _PackedLaunch(kind, lens, packets, self._cull_backfaces, self._scene.device)


@cache
def _kernel(side: int, with_id: bool, movable: bool, clip: bool, resized: bool) -> wp.Kernel:
    from warpvis.kernels.packets_cuda import make_packet_kernel

    return make_packet_kernel(side, with_id, movable, clip, resized)


def packet_side(
    views: int,
    width: int,
    height: int,
    processors: int,
    large_packets: int = 64,
    *,
    moving: bool = False,
) -> int:
    """Choose the height of packets in pixels: as much as leaves enough packets for all multiprocessors.

    Images do not depend on it. The larger a packet, the fewer of them set up the same triangle; the smaller, the sooner
    the last one is done. See docs/internals/gpu.md for the measurements.

    Args:
        views: Images to make.
        width: Their width [px].
        height: Their height [px].
        processors: Multiprocessors of the GPU.
        large_packets: From how many a multiprocessor on packets of 32x32 are the fastest.
        moving: Whether packets look for objects with frames of their own.
    """
    from warpvis.kernels.packets_cuda import packet_width

    sides, least = _FEWEST_PACKETS[moving]
    for side, packets_per_processor in ((32, large_packets), *sides):
        if views * -(-width // packet_width(side)) * -(-height // side) >= packets_per_processor * processors:
            return side
    return least
