# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CPU cores for ray bundles: lenses, panoramas, lidars."""

from __future__ import annotations

import math
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warpvis.cameras.pinhole import clip_inv_z
from warpvis.cameras.rays import RayCamera
from warpvis.kernels.constants import CPU_MAX_ORIGIN_EXTENT, CPU_MAX_SPREAD
from warpvis.rendering.casters.base import CastOptions, ImagesByName, ViewBatch
from warpvis.rendering.casters.moving import MovingCaster, MovingPoses
from warpvis.rendering.casters.packets_cpu import CpuCaster, Workspace
from warpvis.rendering.casters.ray_origins_cpu import PreparedRayOrigins, prepare_ray_origins
from warpvis.rendering.casters.rays import MAX_ORIGIN_EXTENT, RayBundleCaster, origin_extent, takes_packets
from warpvis.rendering.casters.sorted_rays_cpu import PreparedRays, prepare_rays
from warpvis.scene import Scene

if TYPE_CHECKING:
    from warpvis.kernels.casting.packets import BvhScene
    from warpvis.kernels.casting.ray_bundle_packets import TableJob


class CpuRayBundleCaster(CpuCaster):
    """Cast packets of neighboring rays, which are split over several pinhole images; image points as single rays.

    Rays with distinct origins are cast in packets where their origins are close to each other, or at least to those of
    the other rays of a packet; and as single rays otherwise, since packets would then test too many triangles.
    """

    _camera: RayCamera

    def __init__(self, scene: Scene, camera: RayCamera, options: CastOptions) -> None:
        """Set up the caster."""
        super().__init__(scene, camera, options)
        self._clips = options.clip_near and camera.near > 0
        self._single_rays = RayBundleCaster(scene, camera, options)
        self._moving = MovingCaster(scene, camera, options)

    def __getstate__(self) -> dict[str, object]:
        """Return the state without the prepared rays, which copies prepare again or take from the camera's cache."""
        return {name: value for name, value in self.__dict__.items() if name not in ("_rays", "_origins")}

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        """Write images of all views."""
        if not views.count:
            return
        if views.pixels is not None:
            self._single_rays.cast(views, images)
            return
        if not self._takes_packets(views, images):
            # Sensors that move have another method for rays with distinct origins, which movable solids do not prevent.
            if self._scene.bvh().has_solids:
                still = MovingPoses.at_rest(views.poses_on(self._scene.device))
                self._moving.cast(ViewBatch(still, views.worlds), images)
            else:
                self._single_rays.cast(views, images)
            return
        units = views.count * self._rays.struct.bundle.shape[0]
        if units == 0:  # no pixel has a ray
            self._single_rays.cast(views, images)
            return
        rays, make = views.count * self._camera.width * self._camera.height, partial(self._make_workspace, views.count)
        self._run("rays", views, images, rays, units, make)

    def _takes_packets(self, views: ViewBatch, images: ImagesByName) -> bool:
        if self._camera.origins is None:
            return True
        self._scene.bvh(faces="faces" in images)  # first, since `takes_packets` builds trees without faces
        if not takes_packets(self._scene, self._camera, views.worlds, self._clips, CPU_MAX_ORIGIN_EXTENT):
            return False
        if origin_extent(self._camera) <= MAX_ORIGIN_EXTENT:
            return True
        return self._origins is not None and self._origins.packet_spread <= CPU_MAX_SPREAD

    @cached_property
    def _origins(self) -> PreparedRayOrigins | None:
        camera, origins = self._camera, self._camera.origins
        if origins is None:
            return None
        shape = (camera.height, camera.width, 3)
        return camera.prepared(
            "origin packets", lambda: prepare_ray_origins(camera.rays.reshape(shape), origins.reshape(shape))
        )

    @cached_property
    def _rays(self) -> PreparedRays:
        camera = self._camera
        if self._origins is not None:
            return self._origins.rays
        return camera.prepared("packets", lambda: prepare_rays(camera.rays.reshape(camera.height, camera.width, 3)))

    def _make_workspace(self, views: int, scene: BvhScene, workers: int) -> Workspace:
        from warpvis.kernels.casting.ray_bundle_packets import TableCall, cast_ray_origin_packets, cast_table_packets

        call, kernel = TableCall(), cast_table_packets
        if self._origins is not None:
            call.origins, kernel = self._origins.struct, cast_ray_origin_packets
        call.rays = self._rays.struct
        call.job = self._make_job()
        return Workspace(scene, kernel, (call, TableCall), views, workers)

    def _make_job(self) -> TableJob:
        from warpvis.kernels.casting.ray_bundle_packets import TableJob
        from warpvis.kernels.pinhole import PinholeCamera

        camera, job, table = self._camera, TableJob(), PinholeCamera()
        table.height, table.width, table.near, table.far = camera.height, camera.width, camera.near, camera.far
        table.clip_inv_z = clip_inv_z(camera.near) if self._clips else math.inf
        table.clip_reach = camera.near * self._rays.longest_ray if self._clips else 0.0
        job.camera = table
        job.cull_backfaces = int(self._options.cull_backfaces)
        far = np.minimum(camera.far * self._rays.longest, np.finfo(np.float32).max)
        if self._origins is not None:
            far = far.astype(np.float32) + self._origins.max_origin_z
            far = np.minimum(far, np.finfo(np.float32).max)
        job.bundle_far = wp.array(far, dtype=wp.float32, device="cpu")
        return job
