# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Jobs that generate situations: their plan, and the worker of each process."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from threading import Event, Lock
from typing import Any, Protocol

from warpvis.batch._dataset import Record, commit, shard_record
from warpvis.batch._shard_job import Done
from warpvis.batch.situations._base import SituationFormat, find_situation_format
from warpvis.batch.situations._pictures import picture_files
from warpvis.batch.storage._stores import open_store
from warpvis.core.threads import Crew, check_threads
from warpvis.core.types import DeviceLike
from warpvis.situations import Situation

_MAX_PENDING = 2
"""Shards that wait to be written while the next one is generated."""


class Generator(Protocol):
    """Generates the situations of a shard, which depend only on its options and the number of the shard."""

    def shard(self, number: int) -> list[Situation]:
        """Generate the situations of a shard, which take place in one room."""


GeneratorFactory = Callable[..., Generator]
"""A class or function of a module, called with the options, ``device=`` and ``threads=`` in every process."""


@dataclass(frozen=True)
class SituationPlan:
    """Numbers of situations and shards."""

    count: int
    """Number of situations."""
    shard_situations: int
    """Maximum number of situations of a shard."""

    @property
    def shard_count(self) -> int:
        """Number of shards."""
        return -(-self.count // self.shard_situations)

    def shard_length(self, shard: int) -> None:
        """Return None: a room may hold fewer situations than the maximum, and only its record has their number."""

    def shard_limit(self, shard: int) -> int:
        """Return the maximum number of situations of a shard."""
        return min(self.shard_situations, self.count - shard * self.shard_situations)


@dataclass(frozen=True, eq=False)
class SituationJob:
    """The data that a process needs to generate and write shards; it can be pickled."""

    plan: SituationPlan
    generator: GeneratorFactory
    options: Any
    format: str
    out: str

    def start_worker(self, *, device: DeviceLike, threads: int | None) -> SituationWorker:
        """Start the generator and the threads of a process."""
        return SituationWorker(self, device=device, threads=threads)

    def layout(self) -> SituationFormat:
        """Return the format for these shards."""
        return find_situation_format(self.format)(self.plan.shard_count, self.plan.shard_situations)


class SituationWorker:
    """Generates shards, and encodes and writes them while the next ones are generated; a context manager."""

    def __init__(self, job: SituationJob, *, device: DeviceLike, threads: int | None) -> None:
        """Build the generator, and start encoding threads: `threads` of each, by default one for each core."""
        self._job = job
        self._layout = job.layout()
        self._store = open_store(job.out)
        self._generator = job.generator(job.options, device=device, threads=threads)
        self._encoders = Crew(check_threads(threads), "warpvis-encoder")
        self._lock = Lock()
        self.failed = Event()

    def __enter__(self) -> SituationWorker:
        return self

    def __exit__(self, *error: object) -> None:
        self._encoders.__exit__()

    def run(self, shards: Iterable[int], done: Done) -> None:
        """Generate and write shards; after an error, shards that were already generated are still written."""
        pending: list[Future[None]] = []
        with ThreadPoolExecutor(1, thread_name_prefix="warpvis-writer") as pool:
            for shard in shards:
                if len(pending) >= _MAX_PENDING:
                    pending.pop(0).result()
                situations = choose_situations(self._generator.shard(shard), self._job.plan.shard_limit(shard))
                pending.append(pool.submit(self._write, shard, situations, done))
        for future in pending:
            future.result()

    def _write(self, shard: int, situations: list[Situation], done: Done) -> None:
        try:
            record = self._commit(shard, situations)
            with self._lock:
                done(shard, record)
        except BaseException:
            self.failed.set()
            raise

    def _commit(self, shard: int, situations: list[Situation]) -> Record:
        pictures: list[Any] = [None] * len(situations)

        def encode(index: int) -> None:
            pictures[index] = picture_files(situations[index])

        self._encoders.each(encode, range(len(situations)))
        with self._store.new_files() as files:
            units = self._layout.write_shard(shard, situations, pictures, files)
            return commit(self._store, shard_record(shard), len(situations), files, units)


def choose_situations(situations: list[Situation], limit: int) -> list[Situation]:
    """Return the first situations of a shard, without one whose twin is not among them."""
    chosen = situations[:limit]
    names = {situation.name for situation in chosen}
    return [situation for situation in chosen if situation.twin is None or situation.twin in names]
