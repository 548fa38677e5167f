# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CUDA for ray tables: lenses, panoramas, lidars."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import warp as wp

from warpvis.core.kernel_cache import launch
from warpvis.kernels.constants import CUDA_LANES
from warpvis.rendering._found_objects import nothing_found
from warpvis.rendering._ray_images import POINTS_SIDE
from warpvis.rendering._ray_origins import takes_packets
from warpvis.rendering._ray_packets import POINTS, PreparedPackets, prepare_packets
from warpvis.rendering._views import wants_faces, wants_ids
from warpvis.rendering.casters import CastPoses, RayTableCaster, as_images, images_struct

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds


MAX_EYE_OFFSET = 2.0
"""Maximum median distance at which the rays of a packet pass its eye [px m]; beyond it, single rays are faster."""


class CudaTablePacketsCaster(RayTableCaster):
    """Cast packets of neighboring rays, one warp per packet; image points are cast as single rays.

    Rays with distinct origins are cast in packets where `takes_packets` allows it, and as single rays otherwise.
    """

    def cast(self, poses: CastPoses, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels, segmentation and faces of all poses; skip images that are None."""
        if len(poses) == 0:
            return
        scene, prepared = self._scene.bvh(faces=wants_faces(images)).struct, self._prepared
        if self._uses_single_rays(worlds):
            super().cast(poses, worlds, images)
            return
        with_id = wants_ids(images)
        moving = scene.drawn_count > 0
        device_poses, staging = self._upload(poses)
        outputs, lens = images_struct(as_images(images)), self._camera.device_struct()
        resized, origins = moving and worlds.object_sizes is not None, self._camera.origins is not None
        kinds = [(side, 0, packets) for side, packets in prepared.packets]
        if prepared.points is not None:
            kinds.append((POINTS_SIDE, POINTS, prepared.points))
        for side, points, packets in kinds:
            launch(
                _kernel(side, with_id, moving, resized, points, origins),
                (packets.frame.shape[0], len(poses), CUDA_LANES),
                [scene, lens, device_poses, worlds, nothing_found(), packets, self._cull_backfaces, outputs],
                self._scene.device,
                block_dim=CUDA_LANES,
            )
        self._give_back(staging)

    def _uses_single_rays(self, worlds: Worlds) -> bool:
        if self._camera.origins is not None:
            supported = takes_packets(self._scene, self._camera, worlds, self._clip_near)
            return not supported or self._prepared.eye_offset > MAX_EYE_OFFSET
        return self._clip_near and self._camera.near > 0

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
    from warpvis.kernels.casting.ray_bundle_packets_cuda import make_ray_packet_kernel

    return make_ray_packet_kernel(side, with_id, movable, resized, points, origins)
