# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Concurrent rendering and writing of shards, in every process of a job."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from queue import SimpleQueue
from threading import Event, Lock
from typing import TYPE_CHECKING

from warpvis.batch._dataset import Record
from warpvis.batch._encoding import Encoder, EncodingProcesses, Target, can_start, process_count, shards_at_once
from warpvis.batch._frame_renderer import FrameRenderer, ImageBuffers, frames_batch
from warpvis.batch._job import Plan
from warpvis.batch._shard_job import Done
from warpvis.batch.formats._base import Format, Images
from warpvis.batch.storage._stores import is_local
from warpvis.core.threads import check_threads
from warpvis.rendering import ColorOptions, check_colors

if TYPE_CHECKING:
    from warpvis.core.types import DeviceLike
    from warpvis.rendering import CasterName
    from warpvis.scene import Scene

_MAX_WRITERS = 8
"""More writer threads are not faster, and each holds a shard in memory."""
_SETS_TO_COPY = 3
"""Sets of images if encoding processes write copies of them: one is rendered to, and two are copied from."""
_MIN_SHARDS = 16
"""With fewer shards, all of them are written before encoding processes have started."""


@dataclass(frozen=True, eq=False)
class Job:
    """The data that a process needs to work on a job; it can be pickled."""

    plan: Plan
    scene: Scene
    format: str
    out: str
    caster: CasterName = "auto"
    colors: ColorOptions = field(default_factory=check_colors)

    def start_worker(self, *, device: DeviceLike, threads: int | None) -> ShardWriter:
        """Start the renderer and the threads of a process."""
        return ShardWriter(self, device=device, threads=threads)


def writer_count(threads: int) -> int:
    """Return the maximum number of shards that are written at the same time with `threads` encoding threads."""
    return max(min(_MAX_WRITERS, threads), shards_at_once(threads))


class ShardWriter:
    """Renders shards of a job on one device, and encodes and writes them while the next ones are rendered.

    It is a context manager. With many cores it starts encoding processes, which end on exit.
    """

    def __init__(self, job: Job, *, device: DeviceLike, threads: int | None = None) -> None:
        """Build the renderer; start `threads` that render and as many that encode, by default all cores."""
        plan = job.plan
        self._plan = plan
        threads = check_threads(threads)
        target = Target(plan, job.format, job.out)
        self._encoder = Encoder(target, threads)
        layout = self._encoder.layout
        self._processes = _start_processes(target, layout, threads)
        self._writers = min(_MAX_WRITERS, threads) if self._processes is None else shards_at_once(threads)
        self._renderer = FrameRenderer(
            job.scene,
            plan.camera,
            outputs=plan.outputs,
            objects=plan.chosen,
            exclude=plan.exclude,
            delta=layout.delta,
            masks=layout.masks,
            any_depth=layout.any_depth,
            sensor=plan.sensor,
            seed=plan.sensor_seed,
            device=device,
            threads=threads,
            caster=job.caster,
            **job.colors,
        )
        size, pinned = min(plan.shard_frames, len(plan.frames)), not self._renderer.scene.device.is_cpu
        images = self._renderer.images
        # One set of images is rendered to while the others are written, so that memory does not grow with the job.
        # Encoding processes write copies, which frees a set earlier.
        sets = self._writers + 1 if self._processes is None else _SETS_TO_COPY
        self._free: SimpleQueue[ImageBuffers] = SimpleQueue()
        for _ in range(sets):
            self._free.put(ImageBuffers(images, plan.camera, size, pinned=pinned))
        self._lock = Lock()
        self.failed = Event()
        """Set when a shard could not be written; `run` raises the error before its next shard, or after its last."""

    def __enter__(self) -> ShardWriter:
        return self

    def __exit__(self, *error: object) -> None:
        """End the encoding processes and threads."""
        if self._processes is not None:
            self._processes.close()
        self._encoder.close()

    def run(self, shards: Iterable[int], done: Done) -> None:
        """Render and write shards; after an error, shards that were already rendered are still written.

        `done` is called on the writer threads, by one thread at a time.
        """
        if self._processes is not None:
            self._processes.ready()
        pending: set[Future[None]] = set()
        with ThreadPoolExecutor(self._writers, thread_name_prefix="warpvis-writer") as pool:
            for shard in shards:
                _raise_failures(pending)
                frames = frames_batch(self._plan.frames, self._plan.shard_slice(shard))
                buffers = self._free.get()
                try:
                    images = self._renderer.render(frames, out=buffers)
                except BaseException:
                    self._free.put(buffers)
                    raise
                pending.add(pool.submit(self._write, shard, images, buffers, done))
        _raise_failures(pending)

    def _write(self, shard: int, images: Images, buffers: ImageBuffers, done: Done) -> None:
        try:
            record = self._encode(shard, images, buffers)
            with self._lock:
                done(shard, record)
        except BaseException:
            self.failed.set()
            raise

    def _encode(self, shard: int, images: Images, buffers: ImageBuffers) -> Record:
        """Write a shard, and release the memory of its images as early as possible."""
        if self._processes is None:
            try:
                return self._encoder.write(shard, images)
            finally:
                self._free.put(buffers)
        with self._processes.slot() as slot:
            try:
                slot.fill(images)
            finally:
                self._free.put(buffers)
            return slot.write(shard)


def _start_processes(target: Target, layout: Format, threads: int) -> EncodingProcesses | None:
    """Start encoding processes if they pay off: with many cores, enough shards to encode, and a local disk."""
    count = process_count(threads)
    if not count or not layout.encodes or target.plan.shard_count < _MIN_SHARDS or not is_local(target.out):
        return None
    return EncodingProcesses(target, count) if can_start() else None


def _raise_failures(pending: set[Future[None]]) -> None:
    """Remove finished futures, and raise the exceptions of those that failed."""
    for future in [future for future in pending if future.done()]:
        pending.remove(future)
        future.result()
