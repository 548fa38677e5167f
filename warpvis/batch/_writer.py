# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rendering and writing of shards, at the same time: what every process of a job does."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING

from warpvis.batch._emptiness import count_empty
from warpvis.batch._frame_renderer import FrameRenderer, ImageBuffers, frames_batch
from warpvis.batch._job import Plan
from warpvis.batch._records import Record, commit, shard_record
from warpvis.batch.formats._base import Images, find_format
from warpvis.batch.storage._stores import open_store
from warpvis.errors import WarpvisError

if TYPE_CHECKING:
    from warpvis.core.types import DeviceLike
    from warpvis.rendering import Caster
    from warpvis.scene import Scene

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


class WorkerLostError(WarpvisError):
    """A process that rendered ended before its work did."""


class ShardWriter:
    """Renders shards of a job on one device, and encodes and writes them while the next ones are rendered."""

    def __init__(self, job: Job, *, device: DeviceLike, threads: int | None = None, writers: int = 1) -> None:
        """Build what rendering needs.

        Args:
            job: The job.
            device: Where to render.
            threads: CPU threads that render; all cores of this process by default.
            writers: Threads that encode and write.
        """
        plan = job.plan
        self._plan = plan
        self._store = open_store(job.out)
        self._layout = find_format(job.format)(plan)
        self._layout.threads = threads
        self._renderer = FrameRenderer(
            job.scene,
            plan.camera,
            outputs=plan.outputs,
            objects=plan.chosen,
            exclude=plan.exclude,
            delta=self._layout.delta,
            masks=self._layout.masks,
            any_depth=self._layout.any_depth,
            device=device,
            threads=threads,
            caster=job.caster,
        )
        self._writers = writers
        size, pinned = min(plan.shard_frames, len(plan.frames)), not self._renderer.scene.device.is_cpu
        # One set of images is rendered while the others are written, in turns: memory does not grow with the job.
        images = self._renderer.images
        self._free = deque(ImageBuffers(images, plan.camera, size, pinned=pinned) for _ in range(writers + 1))
        self._lock = Lock()

    def run(self, shards: Iterable[int], done: Done) -> None:
        """Render and write shards; what had been begun when something goes wrong is finished first.

        Args:
            shards: Their numbers. The next one is asked for when there is memory to render it into.
            done: Called on the threads that write, by one at a time.

        Raises:
            OSError: A file cannot be written.
        """
        pending: dict[Future[None], ImageBuffers] = {}
        try:
            with ThreadPoolExecutor(self._writers, thread_name_prefix="warpvis-writer") as pool:
                for shard in shards:
                    self._collect(pending)
                    frames = frames_batch(self._plan.frames, self._plan.shard_slice(shard))
                    images = self._renderer.render(frames, out=self._free[0])
                    pending[pool.submit(self._write, shard, images, done)] = self._free.popleft()
                for future in pending:
                    future.result()
        finally:
            self._free.extend(pending.values())

    def _collect(self, pending: dict[Future[None], ImageBuffers]) -> None:
        """Take back the memory of shards that are written; wait for one if there is no memory left."""
        timeout = 0 if self._free else None
        for future in wait(pending, timeout, return_when=FIRST_COMPLETED).done:
            self._free.append(pending.pop(future))
            future.result()

    def _write(self, shard: int, images: Images, done: Done) -> None:
        part = self._plan.shard_slice(shard)
        with self._store.new_files() as files:
            units = self._layout.write_shard(shard, images, files)
            empty = count_empty(images)
            record = commit(self._store, shard_record(shard), part.stop - part.start, files, units, empty=empty)
        with self._lock:
            done(shard, record)
