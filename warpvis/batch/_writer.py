# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rendering and writing of shards, at the same time: what every process of a job does."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Event, Lock
from typing import TYPE_CHECKING

from warpvis.batch._frame_renderer import FrameRenderer, ImageBuffers, frames_batch
from warpvis.batch._job import Plan
from warpvis.batch._records import Record
from warpvis.batch.formats._base import Format, Images
from warpvis.batch.storage._stores import is_local
from warpvis.batch.writing._encoder import Encoder, Target
from warpvis.batch.writing._processes import EncodingProcesses, can_start, process_count, shards_at_once
from warpvis.core.threads import check_threads

if TYPE_CHECKING:
    from warpvis.core.types import DeviceLike
    from warpvis.rendering import Caster
    from warpvis.scene import Scene

_MOST_WRITERS = 8
"""More threads that write do not write faster, and each holds a shard."""
_SETS_TO_COPY = 3
"""Sets of images where processes write what is copied for them: one is rendered, and two are copied."""
_LEAST_SHARDS = 16
"""Fewer are written before processes have started."""

Done = Callable[[int, Record], None]
"""Called with the number and the record of a shard that is whole."""


@dataclass(frozen=True, eq=False)
class Job:
    """What a process needs to take part; it pickles."""

    plan: Plan
    scene: Scene
    format: str
    out: str
    caster: Caster = "auto"


Run = Callable[[Job, Sequence[int], Done], None]
"""An engine: renders and writes shards of a job."""


def writer_count(threads: int) -> int:
    """Tell how many shards are written at a time, at most, by so many threads that encode."""
    return max(min(_MOST_WRITERS, threads), shards_at_once(threads))


class ShardWriter:
    """Renders shards of a job on one device, and encodes and writes them while the next ones are rendered.

    A context: the processes that encode, where there are many cores, end with it.
    """

    def __init__(self, job: Job, *, device: DeviceLike, threads: int | None = None) -> None:
        """Build what rendering needs.

        Args:
            job: The job.
            device: Where to render.
            threads: CPU threads that render, and as many that encode; all cores of this process by default.
        """
        plan = job.plan
        self._plan = plan
        threads = check_threads(threads)
        target = Target(plan, job.format, job.out)
        self._encoder = Encoder(target, threads)
        layout = self._encoder.layout
        self._processes = _start_processes(target, layout, threads)
        self._writers = min(_MOST_WRITERS, threads) if self._processes is None else shards_at_once(threads)
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
        )
        size, pinned = min(plan.shard_frames, len(plan.frames)), not self._renderer.scene.device.is_cpu
        images = self._renderer.images
        # One set of images is rendered while the others are written, in turns: memory does not grow with the job.
        # Processes write what was copied for them.
        sets = self._writers + 1 if self._processes is None else _SETS_TO_COPY
        self._free: SimpleQueue[ImageBuffers] = SimpleQueue()
        for _ in range(sets):
            self._free.put(ImageBuffers(images, plan.camera, size, pinned=pinned))
        self._lock = Lock()
        self.failed = Event()
        """Set when a shard could not be written: `run` raises it when it is asked for another one, or has no more."""

    def __enter__(self) -> ShardWriter:
        """Begin."""
        return self

    def __exit__(self, *error: object) -> None:
        """End."""
        if self._processes is not None:
            self._processes.__exit__(*error)
        self._encoder.__exit__(*error)

    def run(self, shards: Iterable[int], done: Done) -> None:
        """Render and write shards; what had been begun when something goes wrong is finished first.

        Args:
            shards: Their numbers.
            done: Called on the threads that write, by one at a time.

        Raises:
            OSError: A file cannot be written.
            WorkerLostError: A process that encodes ended.
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
        """Write a shard, and give its images' memory back as early as may be."""
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
    """Start processes that encode, if they are worth it: many cores, much to encode, a disk of this machine."""
    count = process_count(threads)
    if not count or not layout.encodes or target.plan.shard_count < _LEAST_SHARDS or not is_local(target.out):
        return None
    return EncodingProcesses(target, count) if can_start() else None


def _raise_failures(pending: set[Future[None]]) -> None:
    """Forget what is done, and raise what went wrong there."""
    for future in [future for future in pending if future.done()]:
        pending.remove(future)
        future.result()
