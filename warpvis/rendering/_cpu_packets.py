# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CPU cores: launches are packed once, and the work is split over threads."""

from __future__ import annotations

import ctypes
import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import aligned_zeros
from warpvis.core.poses import Convention, host_poses
from warpvis.core.threads import pack_launch, run_together
from warpvis.core.types import PoseLike
from warpvis.kernels.constants import COUNTER_FINISHED, JOB_COUNTERS, POSE_WORDS, TILE_SIDE
from warpvis.rendering._prepared import FreeList, ImageSlots, memory_of
from warpvis.rendering._views import wants_faces
from warpvis.scene import Scene

if TYPE_CHECKING:
    from warpvis.kernels.casting.packets import BvhScene, PacketJob
    from warpvis.kernels.casting.ray_bundle_packets import TableJob
    from warpvis.kernels.casting.remap_packets import RemapJob
    from warpvis.kernels.casting.worlds import Worlds

# A strip's number of rows is a thread's share of the remaining rows, divided by this.
_SHARES_PER_THREAD = 2
TILE = TILE_SIDE

# Initial estimate of the time per ray on one thread [ns].
_FIRST_COST = 6.0
# Calls with less work than the first [ns] use one thread, since waking another one takes longer; calls with more work
# than the second always use several.
_MIN_SHARED, _SURELY_SHARED = 8e4, 5e5
# Calls with at most this many rays use one thread and are not timed.
FEW_RAYS = 256
# Between the two, one in this many calls uses the slower of one and several threads, to update its time.
_CALLS_PER_TRIAL = 16
# Time that the caller takes to wake one thread [ns].
_WAKING_TIME = 5e3
# Maximum number of kinds of calls with cached workspaces; the number of threads is part of the kind.
MAX_KINDS = 3


class Workspace:
    """A packed launch and the memory that it reads, for one call at a time.

    Packing a launch can take longer than rendering a small image. A call only writes addresses into the packed launch,
    without keeping the arrays alive.
    """

    def __init__(
        self,
        scene: BvhScene,
        kernel: wp.Kernel,
        call: tuple[Any, Any],
        job: PacketJob | TableJob | RemapJob,
        workers: int,
    ) -> None:
        """Pack a launch for calls like `job` on `workers` threads; `call` is the kernel's call struct and its type."""
        from warpvis.kernels.casting.images import Images

        self.counter = np.zeros(JOB_COUNTERS, dtype=np.int32)
        job.counter = wp.array(self.counter, dtype=wp.int32, device="cpu", copy=False)
        self.pose_rows = np.empty((job.views, POSE_WORDS), dtype=np.float32)
        self._call, call_type = call
        self._images = ImageSlots()
        self._call.job = job
        self.job: Any = self._call.job
        self._call.poses = wp.array(self.pose_rows, dtype=wp.transform, device="cpu", copy=False)
        self._memory = memory_of(self._call)
        self._memory.scene = memory_of(scene)
        arrays = _array_of_one(self._call, call_type), _array_of_one(self._images.struct, Images)
        self.launch = pack_launch(kernel, [*arrays])
        self.launch.launch()  # without scratch memory, it only writes the size that it needs to `scratch_bytes`
        self._workers = workers
        self.job.scratch = aligned_zeros((workers, int(job.scratch_bytes.numpy()[0])), wp.uint8)

    def fill(self, scene: BvhScene, poses: NDArray[np.float32], worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write the addresses of a call's arguments, which the caller must keep alive, and copy its poses."""
        self._memory.scene, self._memory.worlds = memory_of(scene), memory_of(worlds)
        self.pose_rows[:] = poses
        self.counter.fill(0)
        self._images.fill(images)

    def run(self) -> None:
        """Cast the rays of the call."""
        workers = self._workers
        if workers == 1:
            self.launch.launch()
        else:
            run_together(self.launch.launch, workers, lambda: bool(self.counter[COUNTER_FINISHED] == workers))


def _array_of_one(struct: Any, dtype: Any) -> wp.array:
    """Return a view of a struct as an array: a launch reads the struct's current contents. Does not keep it alive."""
    return wp.array(ptr=ctypes.addressof(memory_of(struct)), dtype=dtype, shape=(1,), device="cpu")


class RayCosts:
    """Measured times per ray on one and on several threads, and the number of threads that they imply for a call.

    Images do not depend on the number of threads.
    """

    def __init__(self, threads: int) -> None:
        """Start with default estimates and a maximum number of threads."""
        self._threads = threads
        # Times per ray [ns]: the minimum of the last two calls, since a single slow call may have been preempted.
        self._single = self._last_single = _FIRST_COST
        self._shared = self._last_shared = 0.0
        self._calls = 0

    def threads_for(self, rays: int) -> int:
        """Return the number of threads for a call: one, a power of two, or all."""
        work = rays * self._single
        if self._threads == 1 or work < _MIN_SHARED:
            return 1
        if work < _SURELY_SHARED:
            self._calls += 1
            is_trial = self._calls % _CALLS_PER_TRIAL == 0
            if is_trial == (self._shared < self._single):
                return 1
        # Waking n threads takes n * _WAKING_TIME, and the work then takes work / n: the sum is minimal at
        # n = sqrt(work / _WAKING_TIME).
        best = math.isqrt(int(work / _WAKING_TIME))
        return min(self._threads, max(2, 1 << (best - 1).bit_length()))

    def note(self, rays: int, threads: int, nanoseconds: int) -> None:
        """Record the duration of a call."""
        cost = nanoseconds / rays
        if threads == 1:
            self._single, self._last_single = min(cost, self._last_single), cost
            return
        self._shared, self._last_shared = min(cost, self._last_shared), cost
        # One thread would take at most the total time of all threads.
        total = cost * threads
        self._single = total if rays * self._single >= _SURELY_SHARED else min(total, self._single)


class CpuPacketsCaster:
    """Cast all pixels of a view, or of a strip of it, as one packet through a BVH."""

    def __init__(self, scene: Scene, camera: Camera, *, cull_backfaces: bool, clip_near: bool, threads: int) -> None:
        """Set up the caster."""
        self._scene = scene
        self._camera = camera
        self._cull_backfaces = cull_backfaces
        self._clip_near = clip_near
        self._threads = threads
        self._costs = RayCosts(threads), RayCosts(threads)  # for pixels and for image points
        self._free = FreeList[Workspace](MAX_KINDS)

    def parse_poses(self, poses: PoseLike, convention: Convention) -> np.ndarray:
        """Check poses and return them in this caster's format."""
        return host_poses(poses, convention=convention)

    def cast(self, poses: np.ndarray, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels, segmentation and faces of all poses; skip images that are None."""
        self._run(poses, worlds, None, images)

    def cast_at(self, poses: np.ndarray, worlds: Worlds, pixels: wp.array, images: list[wp.array | None]) -> None:
        """Cast through image points, vec2 of shape ``(V, Y, X)``, which is also the images' shape."""
        views, height, width = pixels.shape
        if not pixels.size:
            return
        if height > 1:
            rows = (views, 1, height * width)
            pixels, images = pixels.reshape(rows), [image and image.reshape(rows) for image in images]
        self._run(poses, worlds, pixels, images)

    def _run(self, poses: np.ndarray, worlds: Worlds, pixels: wp.array | None, images: list[wp.array | None]) -> None:
        views = len(poses)
        if views == 0:
            return
        clusters = self._scene.bvh(faces=wants_faces(images))
        points = 0 if pixels is None else pixels.shape[2]
        rays = views * (points or self._camera.width * self._camera.height)
        costs = None if rays <= FEW_RAYS else self._costs[points > 0]
        workers = 1 if costs is None else costs.threads_for(rays)
        scene = clusters.struct
        kind = (scene.levels, scene.drawn_count, views, points, workers)
        workspace = self._free.take(kind) or self._make_workspace(
            scene, self._make_job(views, points, workers), workers
        )
        workspace.fill(scene, poses, worlds, images)
        if pixels is not None:
            workspace.job.pixels = pixels.flatten().view(wp.float32).flatten()
        if costs is None:
            workspace.run()
        else:
            start = time.perf_counter_ns()
            workspace.run()
            costs.note(rays, workers, time.perf_counter_ns() - start)
        if pixels is not None:
            workspace.job.pixels = None
        self._free.give_back(kind, workspace)

    @staticmethod
    def _make_workspace(scene: BvhScene, job: PacketJob, workers: int) -> Workspace:
        from warpvis.kernels.casting.packets import PacketCall, cast_packets

        return Workspace(scene, cast_packets, (PacketCall(), PacketCall), job, min(workers, job.views * job.strips))

    def _make_job(self, views: int, points: int, workers: int) -> PacketJob:
        from warpvis.kernels.casting.packets import PacketJob

        camera, job = self._camera, PacketJob()
        job.views, job.height, job.width = views, camera.height, camera.width
        # Every strip reads all points of its view: use no more strips than threads can share.
        strip_rows = split_rows(views, camera.height, workers, equal=bool(points))
        job.strips, job.max_rows = len(strip_rows) - 1, int(np.diff(strip_rows).max())
        job.strip_rows = wp.array(strip_rows, dtype=wp.int32, device="cpu")
        job.focal_x, job.focal_y = camera.fx, camera.fy
        job.center_x, job.center_y = camera.cx, camera.cy
        lens = camera.device_struct(clip_near=self._clip_near)
        job.near, job.far, job.clip_inv_z, job.clip_reach = lens.near, lens.far, lens.clip_inv_z, lens.clip_reach
        job.cull_backfaces = int(self._cull_backfaces)
        job.points = points
        job.scratch_bytes = wp.zeros(1, dtype=wp.int64, device="cpu")
        return job


def split_rows(views: int, height: int, threads: int, *, equal: bool = False) -> NDArray[np.int32]:
    """Return the first row of each strip of a view, multiples of 16, followed by the height.

    With enough views for all threads, a view is one strip. Otherwise each strip is a share of the remaining rows, so
    that the last strips are small and threads finish at about the same time (guided self-scheduling: Polychronopoulos
    and Kuck 1987). With `equal`, strips have equal heights, one per thread of a view.
    """
    if equal:
        tiles = -(-height // TILE)
        step = TILE * -(-tiles // -(-threads // views))
        return np.array([*range(0, height, step), height], dtype=np.int32)
    shares = 1 if threads == 1 or views >= 4 * threads else -(-_SHARES_PER_THREAD * threads // views)
    rows, starts = 0, [0]
    while rows < height:
        tiles = -(-(height - rows) // TILE)
        rows = min(rows + -(-tiles // shares) * TILE, height)
        starts.append(rows)
    return np.array(starts, dtype=np.int32)
