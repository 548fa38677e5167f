# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Encoding and writing of shards in processes beside, each with an interpreter's lock of its own.

Compression lets go of the lock, but what is around it for every frame (opening a file, sums, ...) takes it a dozen
times: one process of 16 threads wrote 1,600 PNG images a second on 16 cores, two processes 3,900. So no process has
more than a few threads that encode. Images go there through memory that both map.
"""

from __future__ import annotations

import mmap
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import accumulate
from multiprocessing.connection import Connection, Pipe
from multiprocessing.spawn import get_executable
from queue import SimpleQueue
from typing import TypeAlias

import numpy as np

from warpvis.batch._records import Record
from warpvis.batch.storage._direct_io import ALIGNMENT
from warpvis.batch.writing._encoder import Target, WorkerLostError

_THREADS = 4
"""Threads of a process that encode."""
_SHARDS = 2
"""Shards of a process: one is encoded while the disk is waited for by another."""

# The path is the parent's, as of processes that multiprocessing spawns; unlike those, these do not import the user's
# script again, which need not be written for it.
_START = "import sys; sys.path[:] = sys.argv[1].split('\\n'); from warpvis.batch.writing._worker import main; main()"

Place: TypeAlias = tuple[str, str, tuple[int, ...], int]
"""An array in shared memory: its name, dtype, shape, and where it begins."""


def can_start() -> bool:
    """Tell whether this system and this interpreter can."""
    return hasattr(os, "memfd_create") and bool(get_executable()) and not getattr(sys, "frozen", False)


def process_count(threads: int) -> int:
    """Choose how many processes encode with so many threads in all; 0 if this one is enough."""
    return threads // _THREADS if threads >= 2 * _THREADS else 0


def shards_at_once(threads: int) -> int:
    """Tell how many shards those processes write at a time."""
    return process_count(threads) * _SHARDS


class EncodingProcesses:
    """Processes that encode images of shards, and write them with their records. A context: they end with it."""

    def __init__(self, target: Target, count: int) -> None:
        """Start so many; `ready` waits for them."""
        self._slots: SimpleQueue[Slot] = SimpleQueue()
        self._started = False
        # They end when this end of the pipe does, however this process ends.
        theirs, self._life = os.pipe()
        shared, sizes, data = _share(target)
        try:
            self._processes = [self._start(theirs, shared, sizes, data) for _ in range(count)]
        finally:
            os.close(theirs)
            os.close(shared)

    def _start(self, life: int, shared: int, sizes: list[int], data: bytes) -> subprocess.Popen[bytes]:
        ends = [Pipe() for _ in range(_SHARDS)]
        slots = [Slot(ours) for ours, _ in ends]
        numbers = [life, shared]
        for slot, (_, theirs) in zip(slots, ends, strict=True):
            numbers += [theirs.fileno(), slot.memory]
        command = [get_executable(), "-P", "-c", _START, "\n".join(sys.path), *map(str, numbers)]
        # In a session of its own: Ctrl-C is for the process that shares out the work.
        process = subprocess.Popen(
            [os.fsdecode(part) for part in command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=numbers,
            start_new_session=True,
        )
        for slot, (_, theirs) in zip(slots, ends, strict=True):
            theirs.close()
            slot.process = process
            self._slots.put(slot)
        slots[0].tell((_THREADS, sizes, data))
        return process

    def ready(self) -> None:
        """Wait until they have started.

        Raises:
            WorkerLostError: One cannot.
        """
        if not self._started:
            slots = [self._slots.get() for _ in range(len(self._processes) * _SHARDS)]
            for slot in slots:
                slot.answer()
                self._slots.put(slot)
            self._started = True

    def __enter__(self) -> EncodingProcesses:
        """Begin."""
        return self

    def __exit__(self, *error: object) -> None:
        """End them: those that still write have nobody to tell it."""
        os.close(self._life)
        for process in self._processes:
            process.wait()
        while not self._slots.empty():
            self._slots.get().close()

    @contextmanager
    def slot(self) -> Iterator[Slot]:
        """Wait until there is room for a shard's images, and have it as a context; several threads may call this."""
        slot = self._slots.get()
        try:
            yield slot
        finally:
            self._slots.put(slot)


class Slot:
    """Room for a shard's images in memory that a process shares, and the connection to the thread that writes it."""

    process: subprocess.Popen[bytes]

    def __init__(self, connection: Connection) -> None:
        self.memory = os.memfd_create("warpvis-images")
        self._connection = connection
        self._mapped: mmap.mmap | None = None
        self._places: list[Place] = []

    def fill(self, images: Mapping[str, np.ndarray]) -> None:
        """Copy images of a shard, by name; they may be written over then."""
        places: list[Place] = []
        size = 0
        for name, image in images.items():
            places.append((name, image.dtype.str, image.shape, size))
            size += -(-image.nbytes // ALIGNMENT) * ALIGNMENT
        if self._mapped is None or size > len(self._mapped):
            os.ftruncate(self.memory, max(size, 1))
            self._mapped = mmap.mmap(self.memory, max(size, 1))
        for image, (_, copy) in zip(images.values(), mapped_arrays(self._mapped, places), strict=True):
            np.copyto(copy, image)
        self._places = places

    def write(self, shard: int) -> Record:
        """Write a shard, whose images were copied, and then its record.

        Raises:
            OSError: A file cannot be written.
            WorkerLostError: The process that had it ended.
        """
        self.tell((shard, self._places, 0 if self._mapped is None else len(self._mapped)))
        answer = self.answer()
        if isinstance(answer, Exception):
            raise answer
        return answer

    def tell(self, message: object) -> None:
        with self._noticing_loss():
            self._connection.send(message)

    def answer(self) -> Record | Exception:
        with self._noticing_loss():
            return self._connection.recv()

    def close(self) -> None:
        self._connection.close()
        os.close(self.memory)

    @contextmanager
    def _noticing_loss(self) -> Iterator[None]:
        try:
            yield
        except (EOFError, ConnectionError):
            code = self.process.wait()
            raise WorkerLostError(f"a process that encodes ended with exit code {code}") from None


def mapped_arrays(memory: mmap.mmap, places: list[Place]) -> Iterator[tuple[str, np.ndarray]]:
    """Go through the names and arrays that shared memory holds."""
    for name, dtype, shape, offset in places:
        yield name, np.ndarray(shape, dtype, memory, offset)


def _share(target: Target) -> tuple[int, list[int], bytes]:
    """Put the arrays of a job, its poses above all, into memory that all processes map, and pickle the rest.

    Returns:
        The memory's file descriptor; the arrays' sizes, one after the other; and the rest.
    """
    arrays: list[pickle.PickleBuffer] = []
    data = pickle.dumps(target, protocol=5, buffer_callback=arrays.append)
    raw = [array.raw() for array in arrays]
    descriptor = os.memfd_create("warpvis-poses")
    with open(descriptor, "wb", closefd=False) as stream:
        for part in raw:
            stream.write(part)
    return descriptor, [len(part) for part in raw], data


def unshare(descriptor: int, sizes: list[int], data: bytes) -> Target:
    """Make a job of what `_share` made of it; its arrays stay where they are."""
    whole = memoryview(mmap.mmap(descriptor, sum(sizes), access=mmap.ACCESS_READ) if sum(sizes) else b"")
    ends = list(accumulate(sizes))
    return pickle.loads(data, buffers=[whole[end - size : end] for end, size in zip(ends, sizes, strict=True)])
