# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Encoding and writing of shards on threads of one process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from warpvis.batch._emptiness import count_empty
from warpvis.batch._records import Record, commit, shard_record
from warpvis.batch.formats._base import find_format
from warpvis.batch.storage._stores import open_store
from warpvis.core.threads import Crew
from warpvis.errors import WarpvisError

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.formats._base import Images


class WorkerLostError(WarpvisError):
    """A process that rendered or encoded ended before its work did."""


@dataclass(frozen=True, eq=False)
class Target:
    """What is written, and where; it pickles."""

    plan: Plan
    format: str
    out: str


class Encoder:
    """Encodes images of shards, and writes them with their records; several threads may call it for different shards.

    A context: its threads end with it.
    """

    def __init__(self, target: Target, threads: int) -> None:
        """Take what is written, and how many threads encode."""
        self._plan = target.plan
        self._store = open_store(target.out)
        self._crew = Crew(threads, "warpvis-encoder")
        self.layout = find_format(target.format)(target.plan)
        self.layout.encoders = self._crew

    def __enter__(self) -> Encoder:
        """Begin."""
        return self

    def __exit__(self, *error: object) -> None:
        """End when all that was begun is done."""
        self._crew.__exit__(*error)

    def write(self, shard: int, images: Images) -> Record:
        """Write a shard and then its record.

        Args:
            shard: Its number.
            images: Arrays of its frames, by name.

        Raises:
            OSError: A file cannot be written.
        """
        part = self._plan.shard_slice(shard)
        with self._store.new_files() as files:
            units = self.layout.write_shard(shard, images, files)
            empty = count_empty(images, self._plan.object_labels)
            return commit(self._store, shard_record(shard), part.stop - part.start, files, units, empty=empty)
