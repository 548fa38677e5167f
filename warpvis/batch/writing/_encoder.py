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
    """A process that rendered or encoded ended before its work was finished."""


@dataclass(frozen=True, eq=False)
class Target:
    """The plan of a dataset, its format and its path; it can be pickled."""

    plan: Plan
    format: str
    out: str


class Encoder:
    """Encodes images of shards, and writes them with their records; several threads may write different shards.

    It is a context manager that ends its threads on exit.
    """

    def __init__(self, target: Target, threads: int) -> None:
        """Start `threads` encoding threads."""
        self._plan = target.plan
        self._store = open_store(target.out)
        self._crew = Crew(threads, "warpvis-encoder")
        self.layout = find_format(target.format)(target.plan)
        self.layout.encoders = self._crew

    def __enter__(self) -> Encoder:
        """Return this encoder."""
        return self

    def __exit__(self, *error: object) -> None:
        """Finish pending work, and end the threads."""
        self._crew.__exit__(*error)

    def write(self, shard: int, images: Images) -> Record:
        """Write a shard and then its record.

        Args:
            shard: Number of the shard.
            images: Arrays of its frames, by name.
        """
        part = self._plan.shard_slice(shard)
        with self._store.new_files() as files:
            units = self.layout.write_shard(shard, images, files)
            empty = count_empty(images, self._plan.object_labels)
            return commit(self._store, shard_record(shard), part.stop - part.start, files, units, empty=empty)
