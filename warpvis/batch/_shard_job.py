# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What engines require of a job: shards by number, and a worker that makes them in a process."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from threading import Event
from typing import Protocol

from warpvis.batch._dataset import Record, ShardPlan
from warpvis.core.types import DeviceLike

Done = Callable[[int, Record], None]
"""Callback that receives the number and the record of each complete shard."""


class Worker(Protocol):
    """Makes and writes shards in one process, as a context manager."""

    failed: Event
    """Set when a shard could not be written; `run` raises the error before its next shard, or after its last."""

    def __enter__(self) -> Worker: ...

    def __exit__(self, *error: object) -> None: ...

    def run(self, shards: Iterable[int], done: Done) -> None:
        """Make and write shards; `done` is called for every complete one, by one thread at a time."""


class ShardJob(Protocol):
    """The data that a process needs to work on a job; it can be pickled."""

    @property
    def out(self) -> str:
        """The dataset's folder or URL."""

    @property
    def plan(self) -> ShardPlan:
        """Number and lengths of the shards."""

    def start_worker(self, *, device: DeviceLike, threads: int | None) -> Worker:
        """Start the worker of this process."""


Run = Callable[[ShardJob, Sequence[int], Done], None]
"""An engine: makes and writes shards of a job."""
