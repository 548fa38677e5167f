# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Single rays of a bundle on a GPU: rays of similar directions in the same warps, which then read the same nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.rays import RayCamera
from warpvis.core.kernel_cache import launch
from warpvis.rendering.casters.base import CastOptions, ImagesByName, ViewBatch, images_struct
from warpvis.rendering.casters.packed_launch_cuda import PosesSlot, StructSlot
from warpvis.rendering.casters.ray_order_cuda import sorted_order

if TYPE_CHECKING:
    from warpvis.kernels.casting.sorted_rays import SortedRays
    from warpvis.kernels.casting.triangle_scene import TriangleScene
    from warpvis.kernels.casting.worlds import Worlds

# Maximum number of listed rays with a close hit; if there are more, all rays are cast again.
_MAX_CLOSE = 1 << 14
# Number of threads that cast them.
_CLOSE_THREADS = 1 << 14
# Threads of a block, as in all casters with one query per thread; see `warpvis.core.threads`.
_BLOCK = 64
# Maximum number of rays of a call: a thread's last index, which exceeds it by less than `_CLOSE_THREADS`, is an int32.
_MAX_RAYS = 2**31 - 1 - _CLOSE_THREADS
MIN_RAYS = 1 << 17
"""Number of rays of a call from which sorting gains more than a second launch takes."""


def takes_sorted_rays(options: CastOptions, views: ViewBatch, rays: int) -> bool:
    """Return whether `PackedRays` support a call with a number of rays per view, if objects have no own frames."""
    ignores_hits = options.cull_backfaces or options.clip_near or views.worlds.excluded is not None
    return not ignores_hits and 0 < views.count * rays <= _MAX_RAYS


class PackedRays:
    """Packed launches that cast sorted rays, and their memory."""

    def __init__(self, rays: SortedRays, camera: RayCamera, views: int, device: wp.Device) -> None:
        """Pack the launches for rays of a camera and a number of views."""
        from warpvis.kernels.casting import sorted_rays as kernels
        from warpvis.kernels.casting.images import Images
        from warpvis.kernels.casting.triangle_scene import TriangleScene
        from warpvis.kernels.casting.worlds import Worlds

        close = kernels.CloseRays()
        self._count = wp.empty(1, dtype=wp.int32, device=device)
        close.count, close.rays = self._count, wp.empty(_MAX_CLOSE, dtype=wp.int32, device=device)
        self._scene, self._worlds, self._images = (StructSlot(kind()) for kind in (TriangleScene, Worlds, Images))
        self._poses = PosesSlot(views, device)
        lens, poses = camera.device_struct(), self._poses.poses
        inputs, images = [self._scene.struct, lens, poses, self._worlds.struct, rays, close], self._images.struct
        self._launches = [
            launch(kernel, size, given, device, block_dim=None if device.is_cpu else _BLOCK, record_cmd=True)
            for kernel, size, given in (
                (kernels.cast_sorted_rays, (views, rays.rays.shape[0]), [*inputs, images]),
                (kernels.cast_close_rays, (_CLOSE_THREADS,), [*inputs, _CLOSE_THREADS, images]),
            )
        ]

    def run(self, triangles: TriangleScene, poses: wp.array, worlds: Worlds, images: ImagesByName) -> None:
        """Launch on the device's current stream."""
        self._scene.set(triangles)
        self._worlds.set(worlds)
        self._images.set(images_struct(images))
        self._poses.set(poses)
        self._count.zero_()
        for command in self._launches:
            command.launch()


def sorted_rays(camera: RayCamera, device: wp.Device) -> SortedRays:
    """Return the rays of a camera on a device, sorted; copied there once."""

    def make() -> SortedRays:
        shape, origins = (camera.height, camera.width, 3), camera.origins
        order = sorted_order(camera.rays.reshape(shape), None if origins is None else origins.reshape(shape))
        return rays_in_order(camera, order, device)

    return camera.prepared(("sorted rays", device.alias), make)


def rays_in_order(camera: RayCamera, place: NDArray[np.int64], device: wp.Device) -> SortedRays:
    """Copy rays of a camera to a device; `place` are their indices in its table."""
    from warpvis.kernels.casting.sorted_rays import SortedRays

    rays, result = camera.rays.reshape(-1, 3), SortedRays()
    result.place = wp.array(place.astype(np.int32), dtype=wp.int32, device=device)
    result.rays = wp.array(rays[place], dtype=wp.vec3d, device=device)
    if camera.origins is not None:
        result.origins = wp.array(camera.origins.reshape(-1, 3)[place], dtype=wp.vec3d, device=device)
    result.width = camera.width
    return result
