# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CPU cores: launches are packed once, and the work is split over threads."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import aligned_zeros
from warpvis.core.poses import Convention, host_poses
from warpvis.core.threads import array_of_one, launch_shared, pack_launch
from warpvis.core.types import PoseLike
from warpvis.kernels.constants import BLOCK_SIDE, JOB_COUNTERS, POSE_WORDS, TILE_SIDE
from warpvis.rendering.casters.base import CastOptions, ImagesByName, ImageSlots, ViewBatch
from warpvis.scene import Scene

if TYPE_CHECKING:
    from warpvis.kernels.casting.packets import BvhScene

# A strip's number of rows is a thread's share of the remaining rows, divided by this.
_SHARES_PER_THREAD = 2
# Initial estimate of the time per ray on one thread [ns].
_FIRST_COST = 6.0
# Calls with less work than the first [ns] use one thread, since waking another one takes longer; calls with more work
# than the second always use several.
_MIN_SHARED, _SURELY_SHARED = 8e4, 5e5
# Calls with at most this many rays use one thread and are not timed.
_FEW_RAYS = 256
# Between the two, one in this many calls uses the slower of one and several threads, to update its time.
_CALLS_PER_TRIAL = 16
# Time that the caller takes to wake one thread [ns].
_WAKING_TIME = 5e3
# Pixels of the trees of maps are finer than the camera's by this factor, since bounds in the trees are whole pixels.
_FINENESS, _MAX_FOCAL = 32.0, 2.0**15
# A map is cast in packets if its blocks of 4 x 4 points have at most this width plus height on average [px], measured
# on at most this many blocks.
_MAX_BLOCK_SIZE, _MAX_SAMPLED_BLOCKS = 24.0, 64


class Workspace:
    """A packed launch and the memory that it reads, for one call at a time.

    Packing a launch can take longer than rendering a small image. A call only writes addresses into the packed launch,
    without keeping the arrays alive.
    """

    def __init__(self, scene: Any, kernel: wp.Kernel, call: tuple[Any, Any], views: int, workers: int) -> None:
        """Pack a launch of `workers` threads for calls of `views` views; `call` is the kernel's struct and its type."""
        from warpvis.kernels.casting.images import Images

        self._counter = np.zeros(JOB_COUNTERS, dtype=np.int32)
        self._pose_rows = np.empty((views, POSE_WORDS), dtype=np.float32)
        self._call, call_type = call
        self._images = ImageSlots()
        self._job: Any = self._call.job
        shared: Any = self._call.workers
        shared.counter = wp.array(self._counter, dtype=wp.int32, device="cpu", copy=False)
        shared.scratch_bytes = wp.zeros(1, dtype=wp.int64, device="cpu")
        self._call.poses = wp.array(self._pose_rows, dtype=wp.transform, device="cpu", copy=False)
        self._memory = self._call.__ctype__()
        self._memory.scene = scene.__ctype__()
        arrays = array_of_one(self._call, call_type), array_of_one(self._images.struct, Images)
        self._launch = pack_launch(kernel, [*arrays])
        self._launch.launch()  # without scratch memory, it only writes the size that it needs to `scratch_bytes`
        self._workers = workers
        shared.scratch = aligned_zeros((workers, int(shared.scratch_bytes.numpy()[0])), wp.uint8)

    def run(self, scene: Any, views: ViewBatch, images: ImagesByName) -> None:
        """Cast the rays of a call: write the addresses of its arguments, copy its poses, and launch."""
        self._memory.scene, self._memory.worlds = scene.__ctype__(), views.worlds.__ctype__()
        self._write_poses(views.poses)
        self._images.fill(images)
        if views.pixels is not None:
            self._job.pixels = views.pixels.flatten().view(wp.float32).flatten()
        limits = views.limits if hasattr(self._job, "limits") else None  # lists of points ignore them
        if limits is not None:
            self._job.limits = limits.flatten()
        launch_shared(self._launch, self._counter, self._workers)
        if views.pixels is not None:
            self._job.pixels = None
        if limits is not None:
            self._job.limits = None

    def _write_poses(self, poses: Any) -> None:
        self._pose_rows[:] = poses


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


class CpuCaster:
    """Base of the casters on CPU cores: runs packed launches on as many threads as a call is worth."""

    def __init__(self, scene: Scene, camera: Any, options: CastOptions) -> None:
        """Set up the caster."""
        self._scene = scene
        self._camera = camera
        self._options = options
        self._costs: dict[str, RayCosts] = {}
        # Poses become rows in the frame of the camera's axes.
        self.parse_poses: Callable[[PoseLike, Convention], NDArray[np.float32]] = partial(host_poses, axes=camera.axes)

    def _run(
        self,
        method: str,
        views: ViewBatch,
        images: ImagesByName,
        rays: int,
        units: int,
        make: Callable[[BvhScene, int], Workspace],
    ) -> None:
        """Cast rays in packets.

        Args:
            method: Name of the kind of packets.
            views: The views.
            images: The images to write.
            rays: Number of rays.
            units: Number of units of work that workers take.
            make: Returns a workspace for a scene and a number of workers.
        """
        scene = self._scene.bvh(faces="faces" in images).struct
        costs, workers = None, 1
        if rays > _FEW_RAYS:
            costs = self._costs.get(method) or self._costs.setdefault(method, RayCosts(self._options.threads))
            workers = min(costs.threads_for(rays), units)

        shape = views.count if views.pixels is None else views.pixels.shape
        kind, pool = (self, method, scene.levels, scene.drawn_count, shape, workers), self._options.pool
        workspace: Workspace = pool.take(kind) or make(scene, workers)
        start = time.perf_counter_ns()
        workspace.run(scene, views, images)
        if costs is not None:
            costs.note(rays, workers, time.perf_counter_ns() - start)
        pool.give_back(kind, workspace)


class CpuPacketsCaster(CpuCaster):
    """Cast all pixels of a view, or of a strip of it, as one packet through a BVH.

    Coherent maps are cast in packets too, with a tree over their points that is built for each view.
    """

    _camera: Camera

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        """Write images of all views."""
        if not views.count:
            return
        pixels, height = views.pixels, self._camera.height
        if pixels is None:
            make = partial(self._make_strips, views.count, 0)
            strips = views.count * -(-height // TILE_SIDE)
            self._run("pixels", views, images, views.count * height * self._camera.width, strips, make)
        elif pixels.shape[1] > 1 and are_coherent(pixels):
            units = views.count * -(-pixels.shape[1] // TILE_SIDE)
            self._run("map", views, images, pixels.size, units, partial(self._make_map, pixels.shape))
        elif pixels.size:
            make = partial(self._make_strips, views.count, pixels.size // views.count)
            self._run("points", views, images, pixels.size, pixels.size, make)

    def _make_strips(self, views: int, points: int, scene: BvhScene, workers: int) -> Workspace:
        from warpvis.kernels.casting.packets import PacketCall, cast_packets

        call = PacketCall()
        call.job, units = self._strips(views, points, workers)
        return Workspace(scene, cast_packets, (call, PacketCall), views, min(workers, units))

    def _strips(self, views: int, points: int, workers: int) -> tuple[Any, int]:
        """Return the job of images, or of points of each view, and its number of units."""
        from warpvis.kernels.casting.packets import PacketJob

        job = PacketJob()
        # Every strip reads all points of its view: use no more strips than threads can share.
        strip_rows = split_rows(views, self._camera.height, workers, equal=bool(points))
        job.strip_rows = wp.array(strip_rows, dtype=wp.int32, device="cpu")
        job.max_rows = int(np.diff(strip_rows).max())
        job.camera = self._camera.device_struct(clip_near=self._options.clip_near)
        job.cull_backfaces = int(self._options.cull_backfaces)
        job.points = points
        return job, views * (len(strip_rows) - 1)

    def _make_map(self, shape: tuple[int, int, int], scene: BvhScene, workers: int) -> Workspace:
        from warpvis.kernels.casting.packets import RemapCall, RemapJob, cast_remapped_packets

        call, job = RemapCall(), RemapJob()
        views, job.rows, job.columns = shape
        job.camera = self._camera.device_struct(clip_near=self._options.clip_near)
        # The factor is a power of two, so that single precision suffices to convert coordinates.
        scale = min(_FINENESS, max(1.0, _MAX_FOCAL / self._camera.fx))
        job.tree_focal = self._camera.fx * 2.0 ** math.floor(math.log2(scale))
        job.cull_backfaces = int(self._options.cull_backfaces)
        call.job = job
        return Workspace(scene, cast_remapped_packets, (call, RemapCall), views, workers)


def split_rows(views: int, height: int, threads: int, *, equal: bool = False) -> NDArray[np.int32]:
    """Return the first row of each strip of a view, multiples of 16, followed by the height.

    With enough views for all threads, a view is one strip. Otherwise each strip is a share of the remaining rows, so
    that the last strips are small and threads finish at about the same time (guided self-scheduling: Polychronopoulos
    and Kuck 1987). With `equal`, strips have equal heights, one per thread of a view.
    """
    if equal:
        tiles = -(-height // TILE_SIDE)
        step = TILE_SIDE * -(-tiles // -(-threads // views))
        return np.array([*range(0, height, step), height], dtype=np.int32)
    shares = 1 if threads == 1 or views >= 4 * threads else -(-_SHARES_PER_THREAD * threads // views)
    rows, starts = 0, [0]
    while rows < height:
        tiles = -(-(height - rows) // TILE_SIDE)
        rows = min(rows + -(-tiles // shares) * TILE_SIDE, height)
        starts.append(rows)
    return np.array(starts, dtype=np.int32)


def are_coherent(pixels: wp.array) -> bool:
    """Return whether a sample of blocks of a map, vec2 of shape ``(V, Y, X)``, is coherent in the image."""
    views, rows, columns = pixels.shape
    block_columns, block_rows = columns // BLOCK_SIDE, rows // BLOCK_SIDE
    blocks = views * block_columns * block_rows
    if blocks == 0:
        return False
    view, block = np.divmod(
        np.linspace(0, blocks - 1, min(blocks, _MAX_SAMPLED_BLOCKS)).astype(np.int64), block_columns * block_rows
    )
    row, column = (first[:, None] * BLOCK_SIDE + np.arange(BLOCK_SIDE) for first in np.divmod(block, block_columns))
    positions = pixels.numpy()[view[:, None, None], row[:, :, None], column[:, None, :]].reshape(len(view), -1, 2)
    is_finite = np.isfinite(positions)
    high = np.where(is_finite, positions, -np.inf).max(axis=1)
    size = high - np.where(is_finite, positions, np.inf).min(axis=1)
    nonempty = np.isfinite(high).all(axis=-1)
    return not nonempty.any() or float(size[nonempty].sum(axis=-1).mean()) <= _MAX_BLOCK_SIZE
