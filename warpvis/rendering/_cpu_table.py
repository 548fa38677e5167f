# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CPU cores for ray tables: lenses, panoramas, lidars."""

from __future__ import annotations

import math
import time
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warpvis.cameras.pinhole import clip_inv_z
from warpvis.cameras.rays import RayCamera
from warpvis.core.poses import Convention, host_poses
from warpvis.core.types import PoseLike
from warpvis.rendering._cpu_packets import FEW_RAYS, MAX_KINDS, RayCosts, Workspace
from warpvis.rendering._prepared import FreeList
from warpvis.rendering._ray_bundles import PreparedRays, prepare_rays
from warpvis.rendering._views import wants_faces
from warpvis.rendering.casters import RayTableCaster
from warpvis.scene import Scene

if TYPE_CHECKING:
    from warpvis.kernels.casting.packets import BvhScene
    from warpvis.kernels.casting.ray_bundle_packets import TableJob
    from warpvis.kernels.casting.worlds import Worlds


class CpuTablePacketsCaster:
    """Cast packets of neighboring rays of a table, which is split over several pinhole images."""

    def __init__(self, scene: Scene, camera: RayCamera, *, cull_backfaces: bool, clip_near: bool, threads: int) -> None:
        """Set up the caster."""
        self._scene = scene
        self._camera = camera
        self._cull_backfaces = cull_backfaces
        self._clip_near = clip_near and camera.near > 0
        self._threads = threads
        self._costs = RayCosts(threads)
        self._free = FreeList[Workspace](MAX_KINDS)
        self._single_rays = RayTableCaster(
            scene, camera, cull_backfaces=cull_backfaces, clip_near=clip_near, threads=threads
        )

    def __getstate__(self) -> dict[str, object]:
        """Return the state without the prepared rays, which copies prepare again or take from the camera's cache."""
        return {name: value for name, value in self.__dict__.items() if name != "_rays"}

    def parse_poses(self, poses: PoseLike, convention: Convention) -> np.ndarray:
        """Check poses and return them in this caster's format."""
        return host_poses(poses, convention=convention, axes=self._camera.axes)

    def cast(self, poses: np.ndarray, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels, segmentation and faces of all poses; skip images that are None."""
        views = len(poses)
        if views == 0:
            return
        units = views * self._rays.struct.bundle.shape[0]
        if units == 0:  # no pixel has a ray
            self._single_rays.cast(poses, worlds, images)
            return
        scene = self._scene.bvh(faces=wants_faces(images)).struct
        rays = views * self._camera.width * self._camera.height
        costs = None if rays <= FEW_RAYS else self._costs
        workers = min(units, 1 if costs is None else costs.threads_for(rays))
        kind = (scene.levels, scene.drawn_count, views, workers)
        workspace = self._free.take(kind) or self._make_workspace(scene, views, workers)
        workspace.fill(scene, poses, worlds, images)
        start = time.perf_counter_ns()
        workspace.run()
        if costs is not None:
            costs.note(rays, workers, time.perf_counter_ns() - start)
        self._free.give_back(kind, workspace)

    def cast_at(self, poses: np.ndarray, worlds: Worlds, pixels: wp.array, images: list[wp.array | None]) -> None:
        """Cast single rays through image points, vec2 of shape ``(V, 1, N)``, which is also the images' shape."""
        self._single_rays.cast_at(poses, worlds, pixels, images)

    @cached_property
    def _rays(self) -> PreparedRays:
        camera = self._camera
        return camera.prepared("packets", lambda: prepare_rays(camera.rays.reshape(camera.height, camera.width, 3)))

    def _make_workspace(self, scene: BvhScene, views: int, workers: int) -> Workspace:
        from warpvis.kernels.casting.ray_bundle_packets import TableCall, cast_table_packets

        call = TableCall()
        call.rays = self._rays.struct
        return Workspace(scene, cast_table_packets, (call, TableCall), self._make_job(views), workers)

    def _make_job(self, views: int) -> TableJob:
        from warpvis.kernels.casting.ray_bundle_packets import TableJob

        camera, job = self._camera, TableJob()
        job.views, job.height, job.width = views, camera.height, camera.width
        job.near, job.far = camera.near, camera.far
        job.clip_inv_z = clip_inv_z(camera.near) if self._clip_near else math.inf
        job.clip_reach = camera.near * self._rays.longest_ray if self._clip_near else 0.0
        job.cull_backfaces = int(self._cull_backfaces)
        far = np.minimum(camera.far * self._rays.longest, np.finfo(np.float32).max)
        job.bundle_far = wp.array(far, dtype=wp.float32, device="cpu")
        job.scratch_bytes = wp.zeros(1, dtype=wp.int64, device="cpu")
        return job
