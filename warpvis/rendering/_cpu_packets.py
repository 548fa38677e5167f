# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CPU cores: what a call needs is prepared once, and the work is split over threads."""

from __future__ import annotations

import ctypes
import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import aligned_zeros
from warpvis.core.camera import Camera
from warpvis.core.poses import Convention, host_poses
from warpvis.core.threads import pack_launch, run_together
from warpvis.core.types import PoseLike
from warpvis.kernels.constants import COUNTER_FINISHED, JOB_COUNTERS, POSE_WORDS, TILE_SIDE
from warpvis.rendering._prepared import Idle, ImageSlots, memory_of
from warpvis.rendering._views import wants_faces
from warpvis.scene import Scene

if TYPE_CHECKING:
    from warpvis.kernels.packets import BvhScene, PacketJob
    from warpvis.kernels.remap_packets import RemapJob
    from warpvis.kernels.table_packets import TableJob
    from warpvis.kernels.worlds import Worlds

# A strip is a thread's part of the rows that are left, divided by this.
_SHARES_PER_THREAD = 2
TILE = TILE_SIDE

# What a ray takes one thread [ns], until calls have shown it.
_FIRST_COST = 6.0
# Less work [ns] is done before another thread has woken up; more than that surely is not.
_MIN_SHARED, _SURELY_SHARED = 8e4, 5e5
# So few rays are one thread's, and nobody looks how long they take.
FEW_RAYS = 256
# In between, one of so many calls is made in the way that was slower, to see whether it still is.
_CALLS_BETWEEN_LOOKS = 16
# To wake a thread takes the caller so long [ns].
_WAKING = 5e3
# So many kinds of calls have memory that waits for the next one: as many threads as were tried last, and others.
MAX_KINDS = 3


class Workspace:
    """What one call at a time works with: a launch that is packed once, and the memory that it reads then.

    To pack a launch takes longer than many an image. Here a call writes addresses, and keeps none: what the caller
    drops does not live on.
    """

    def __init__(
        self,
        scene: BvhScene,
        kernel: wp.Kernel,
        call: tuple[Any, Any],
        job: PacketJob | TableJob | RemapJob,
        workers: int,
    ) -> None:
        """Prepare for calls like a job on so many threads; `call` is the kernel's struct of a call, and its type."""
        from warpvis.kernels.images import Images

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
        self.launch.launch()  # without memory, it says how much it needs
        self._workers = workers
        self.job.scratch = aligned_zeros((workers, int(job.scratch_bytes.numpy()[0])), wp.uint8)

    def fill(self, scene: BvhScene, poses: NDArray[np.float32], worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write down what a call is about, which has to keep it alive."""
        self._memory.scene, self._memory.worlds = memory_of(scene), memory_of(worlds)
        self.pose_rows[:] = poses
        self.counter.fill(0)
        self._images.fill(images)

    def run(self) -> None:
        """Cast."""
        workers = self._workers
        if workers == 1:
            self.launch.launch()
        else:
            run_together(self.launch.launch, workers, lambda: bool(self.counter[COUNTER_FINISHED] == workers))


def _array_of_one(struct: Any, dtype: Any) -> wp.array:
    """View a struct, which has to be kept, as an array: a launch then reads what the struct holds at the time."""
    return wp.array(ptr=ctypes.addressof(memory_of(struct)), dtype=dtype, shape=(1,), device="cpu")


class RayCosts:
    """How long rays take alone and shared, as calls show it, and so how many threads a call is worth.

    Images do not depend on it.
    """

    def __init__(self, threads: int) -> None:
        """Know nothing yet; use at most so many threads."""
        self._threads = threads
        # Of a ray [ns], the less of the last two times: what takes long once may have been interrupted.
        self._alone = self._last_alone = _FIRST_COST
        self._shared = self._last_shared = 0.0
        self._calls = 0

    def threads_for(self, rays: int) -> int:
        """Choose a number of threads: one, a power of two, or all."""
        work = rays * self._alone
        if self._threads == 1 or work < _MIN_SHARED:
            return 1
        if work < _SURELY_SHARED:
            self._calls += 1
            looks = self._calls % _CALLS_BETWEEN_LOOKS == 0
            if looks == (self._shared < self._alone):
                return 1
        # Who wakes n threads, one after the other, has then an nth of the work to do: that is least where n is the root
        # of their ratio.
        best = math.isqrt(int(work / _WAKING))
        return min(self._threads, max(2, 1 << (best - 1).bit_length()))

    def note(self, rays: int, threads: int, nanoseconds: int) -> None:
        """Take note of what a call took."""
        cost = nanoseconds / rays
        if threads == 1:
            self._alone, self._last_alone = min(cost, self._last_alone), cost
            return
        self._shared, self._last_shared = min(cost, self._last_shared), cost
        # One thread would not have taken longer than all of them together.
        together = cost * threads
        self._alone = together if rays * self._alone >= _SURELY_SHARED else min(together, self._alone)


class CpuPacketsCaster:
    """All pixels of a view, or of a strip of it, walk a BVH together; on CPU cores."""

    def __init__(self, scene: Scene, camera: Camera, *, cull_backfaces: bool, clip_near: bool, threads: int) -> None:
        """Prepare to cast."""
        self._scene = scene
        self._camera = camera
        self._cull_backfaces = cull_backfaces
        self._clip_near = clip_near
        self._threads = threads
        self._costs = RayCosts(threads), RayCosts(threads)  # of pixels, and of points
        self._idle = Idle[Workspace](MAX_KINDS)

    def parse_poses(self, poses: PoseLike, convention: Convention) -> np.ndarray:
        """Check poses, and return them as this caster takes them."""
        return host_poses(poses, convention=convention)

    def cast(self, poses: np.ndarray, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write depth, points, normals, labels, segmentation and faces of all poses; None is not made."""
        self._run(poses, worlds, None, images)

    def cast_at(self, poses: np.ndarray, worlds: Worlds, pixels: wp.array, images: list[wp.array | None]) -> None:
        """Cast through image points, shape ``(V, Y, X)`` vec2, as are the images'."""
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
        space = self._idle.take(kind) or self._make_space(scene, self._make_job(views, points, workers), workers)
        space.fill(scene, poses, worlds, images)
        if pixels is not None:
            space.job.at = pixels.flatten().view(wp.float32).flatten()
        if costs is None:
            space.run()
        else:
            start = time.perf_counter_ns()
            space.run()
            costs.note(rays, workers, time.perf_counter_ns() - start)
        if pixels is not None:
            space.job.at = None
        self._idle.give_back(kind, space)

    @staticmethod
    def _make_space(scene: BvhScene, job: PacketJob, workers: int) -> Workspace:
        from warpvis.kernels.packets import PacketCall, cast_packets

        return Workspace(scene, cast_packets, (PacketCall(), PacketCall), job, min(workers, job.views * job.strips))

    def _make_job(self, views: int, points: int, workers: int) -> PacketJob:
        from warpvis.kernels.packets import PacketJob

        camera, job = self._camera, PacketJob()
        job.views, job.height, job.width = views, camera.height, camera.width
        # Every strip looks at all points of its view: no more of them than threads have to share.
        strip_rows = split_rows(views, camera.height, workers, equal=bool(points))
        job.strips, job.most_rows = len(strip_rows) - 1, int(np.diff(strip_rows).max())
        job.strip_rows = wp.array(strip_rows, dtype=wp.int32, device="cpu")
        job.focal_x, job.focal_y = camera.fx, camera.fy
        job.center_x, job.center_y = camera.cx, camera.cy
        lens = camera.device_struct(clip_near=self._clip_near)
        job.near, job.far, job.most_inv_z, job.clip_reach = lens.near, lens.far, lens.most_inv_z, lens.clip_reach
        job.cull_backfaces = int(self._cull_backfaces)
        job.points = points
        job.scratch_bytes = wp.zeros(1, dtype=wp.int64, device="cpu")
        return job


def split_rows(views: int, height: int, threads: int, *, equal: bool = False) -> NDArray[np.int32]:
    """Say where the strips of a view begin, multiples of 16, and where the last one ends.

    With views for all threads, a view is one strip. Else each strip is a share of the rows that are left, so that the
    last ones are small and threads end at about the same time (guided self-scheduling: Polychronopoulos and Kuck 1987);
    or `equal`: one for each thread that a view has.
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
