# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CPU cores for rays with distinct, close origins, such as those of many lidars."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.rendering._cpu_packets import Workspace
from warpvis.rendering._cpu_table import CpuTablePacketsCaster
from warpvis.rendering._ray_bundles import PreparedRays
from warpvis.rendering._ray_origins import PreparedRayOrigins, prepare_ray_origins, takes_packets
from warpvis.rendering._views import wants_faces

if TYPE_CHECKING:
    from warpvis.kernels.casting.packets import BvhScene
    from warpvis.kernels.casting.ray_bundle_packets import TableJob
    from warpvis.kernels.casting.worlds import Worlds


class CpuRayOriginsCaster(CpuTablePacketsCaster):
    """Cast neighboring rays in packets where `takes_packets` allows it, and single rays otherwise."""

    def __getstate__(self) -> dict[str, object]:
        """Return the state without the prepared rays, which copies prepare again or take from the camera's cache."""
        return {name: value for name, value in super().__getstate__().items() if name != "_prepared_origins"}

    def cast(self, poses: np.ndarray, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels, segmentation and faces of all poses; skip images that are None."""
        self._scene.bvh(faces=wants_faces(images))  # first, since `takes_packets` builds trees without faces
        if takes_packets(self._scene, self._camera, worlds, self._clip_near):
            super().cast(poses, worlds, images)
        else:
            self._single_rays.cast(poses, worlds, images)

    @property
    def _origins(self) -> NDArray[np.float64]:
        assert self._camera.origins is not None  # cameras without origins use another caster
        return self._camera.origins

    @cached_property
    def _prepared_origins(self) -> PreparedRayOrigins:
        camera, origins = self._camera, self._origins
        shape = (camera.height, camera.width, 3)

        def make() -> PreparedRayOrigins:
            return prepare_ray_origins(camera.rays.reshape(shape), origins.reshape(shape))

        return camera.prepared("origin packets", make)

    @property
    def _rays(self) -> PreparedRays:
        return self._prepared_origins.rays

    def _make_workspace(self, scene: BvhScene, views: int, workers: int) -> Workspace:
        from warpvis.kernels.casting.ray_origin_packets import RayOriginCall, cast_ray_origin_packets

        call = RayOriginCall()
        call.rays, call.origins = self._rays.struct, self._prepared_origins.struct
        return Workspace(scene, cast_ray_origin_packets, (call, RayOriginCall), self._make_job(views), workers)

    def _make_job(self, views: int) -> TableJob:
        job = super()._make_job(views)
        far = np.minimum(job.bundle_far.numpy() + self._prepared_origins.max_origin_z, np.finfo(np.float32).max)
        job.bundle_far = wp.array(far, dtype=wp.float32, device="cpu")
        return job
