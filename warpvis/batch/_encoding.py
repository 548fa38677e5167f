# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Encoding and writing of shards, on threads, and in additional processes on machines with many cores.

Compression releases the global interpreter lock (GIL), but other work for each frame (opening a file, checksums, ...)
acquires it a dozen times: on 16 cores, one process with 16 threads wrote 1,600 PNG images per second, two processes
3,900. Each additional process therefore has only a few encoding threads. Images are passed through shared memory.
"""

from __future__ import annotations

import mmap
import os
import pickle
import subprocess
import sys
import threading
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import accumulate
from multiprocessing.connection import Connection, Pipe
from multiprocessing.spawn import get_executable
from queue import SimpleQueue
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from warpvis.batch._dataset import Record, commit, shard_record
from warpvis.batch._emptiness import count_empty
from warpvis.batch._job import WorkerLostError
from warpvis.batch.formats._base import find_format
from warpvis.batch.storage._output import ALIGNMENT
from warpvis.batch.storage._stores import open_store
from warpvis.core.threads import Crew
from warpvis.errors import WarpvisError

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.formats._base import Images

_THREADS = 4
"""Encoding threads per process."""
_SHARDS = 2
"""Concurrent shards per process: one is encoded while another one waits for the disk."""

# `sys.path` is that of the parent, as with multiprocessing's spawn. Unlike spawn, the process does not import the main
# script, which might lack a guard for that.
_START = "import sys; sys.path[:] = sys.argv[1].split('\\n'); from warpvis.batch._encoding import main; main()"

Place: TypeAlias = tuple[str, str, tuple[int, ...], int]
"""An array in shared memory: name, dtype, shape and offset in bytes."""


@dataclass(frozen=True, eq=False)
class Target:
    """The plan of a dataset, its format and its path; it can be pickled."""

    plan: Plan
    format: str
    out: str


class Encoder:
    """Encodes images of shards, and writes them with their records; several threads may write different shards."""

    def __init__(self, target: Target, threads: int) -> None:
        """Start `threads` encoding threads."""
        self._plan = target.plan
        self._store = open_store(target.out)
        self._crew = Crew(threads, "warpvis-encoder")
        self.layout = find_format(target.format)(target.plan)
        self.layout.encoders = self._crew

    def close(self) -> None:
        """Finish pending work, and end the threads."""
        self._crew.__exit__()

    def write(self, shard: int, images: Images) -> Record:
        """Write a shard and then its record."""
        with self._store.new_files() as files:
            units = self.layout.write_shard(shard, images, files)
            empty = count_empty(images, self._plan.object_labels)
            frames = self._plan.shard_length(shard)
            return commit(self._store, shard_record(shard), frames, files, units, empty=empty)


def can_start() -> bool:
    """Return whether the system and the interpreter support encoding processes."""
    return hasattr(os, "memfd_create") and bool(get_executable()) and not getattr(sys, "frozen", False)


def process_count(threads: int) -> int:
    """Return the number of encoding processes for a total number of threads; 0 if this process is enough."""
    return threads // _THREADS if threads >= 2 * _THREADS else 0


def shards_at_once(threads: int) -> int:
    """Return the number of shards that these processes write concurrently."""
    return process_count(threads) * _SHARDS


class EncodingProcesses:
    """Processes that encode images of shards, and write them with their records."""

    def __init__(self, target: Target, count: int) -> None:
        """Start `count` processes without waiting; `ready` waits for them."""
        self._slots: SimpleQueue[Slot] = SimpleQueue()
        self._started = False
        # The processes end when this end of the pipe is closed, which also happens if this process crashes.
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
        # A new session: Ctrl-C must only reach the parent process.
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
        slots[0].send((_THREADS, sizes, data))
        return process

    def ready(self) -> None:
        """Wait until all processes have started."""
        if not self._started:
            slots = [self._slots.get() for _ in range(len(self._processes) * _SHARDS)]
            for slot in slots:
                slot.receive()
                self._slots.put(slot)
            self._started = True

    def close(self) -> None:
        """End the processes."""
        os.close(self._life)
        for process in self._processes:
            process.wait()
        while not self._slots.empty():
            self._slots.get().close()

    @contextmanager
    def slot(self) -> Iterator[Slot]:
        """Wait for a free slot for the images of a shard, as a context manager; several threads may call this."""
        slot = self._slots.get()
        try:
            yield slot
        finally:
            self._slots.put(slot)


class Slot:
    """Shared memory for the images of a shard, and the connection to the thread that writes it."""

    process: subprocess.Popen[bytes]

    def __init__(self, connection: Connection) -> None:
        self.memory = os.memfd_create("warpvis-images")
        self._connection = connection
        self._mapped: mmap.mmap | None = None
        self._places: list[Place] = []

    def fill(self, images: Mapping[str, np.ndarray]) -> None:
        """Copy the images of a shard to shared memory; they may be overwritten afterwards."""
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
        """Write a shard, whose images were copied by `fill`, and then its record."""
        self.send((shard, self._places, 0 if self._mapped is None else len(self._mapped)))
        reply = self.receive()
        if isinstance(reply, Exception):
            raise reply
        return reply

    def send(self, message: object) -> None:
        with self._detect_loss():
            self._connection.send(message)

    def receive(self) -> Record | Exception:
        with self._detect_loss():
            return self._connection.recv()

    def close(self) -> None:
        self._connection.close()
        os.close(self.memory)

    @contextmanager
    def _detect_loss(self) -> Iterator[None]:
        try:
            yield
        except (EOFError, ConnectionError):
            code = self.process.wait()
            raise WorkerLostError(f"an encoding process ended with exit code {code}") from None


def mapped_arrays(memory: mmap.mmap, places: list[Place]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the names and arrays in shared memory."""
    for name, dtype, shape, offset in places:
        yield name, np.ndarray(shape, dtype, memory, offset)


def _share(target: Target) -> tuple[int, list[int], bytes]:
    """Copy the arrays of a target, mainly poses, to shared memory; return it, their sizes, and the pickled rest."""
    arrays: list[pickle.PickleBuffer] = []
    data = pickle.dumps(target, protocol=5, buffer_callback=arrays.append)
    raw = [array.raw() for array in arrays]
    descriptor = os.memfd_create("warpvis-poses")
    with open(descriptor, "wb", closefd=False) as stream:
        for part in raw:
            stream.write(part)
    return descriptor, [len(part) for part in raw], data


def unshare(descriptor: int, sizes: list[int], data: bytes) -> Target:
    """Restore a target shared by `_share`; its arrays are views of shared memory."""
    memory = memoryview(mmap.mmap(descriptor, sum(sizes), access=mmap.ACCESS_READ) if sum(sizes) else b"")
    ends = list(accumulate(sizes))
    return pickle.loads(data, buffers=[memory[end - size : end] for end, size in zip(ends, sizes, strict=True)])


def main() -> None:
    """Write shards until the parent process ends or closes the pipe.

    The command-line arguments are open file descriptors: a pipe that the parent process closes, shared memory with the
    arrays of the job, and a connection and shared memory for each concurrent shard.
    """
    life, shared, *numbers = map(int, sys.argv[2:])
    connections = [Connection(number) for number in numbers[::2]]
    threads, sizes, data = connections[0].recv()
    encoder = Encoder(unshare(shared, sizes, data), threads)
    for connection, memory in zip(connections, numbers[1::2], strict=True):
        threading.Thread(target=_serve, args=(encoder, connection, memory), daemon=True).start()
    os.read(life, 1)
    os._exit(0)


def _serve(encoder: Encoder, connection: Connection, memory: int) -> None:
    """Write the shards received through one connection."""
    mapped: mmap.mmap | None = None
    with suppress(EOFError, OSError):  # the parent process has ended
        connection.send(None)
        while True:
            shard, places, size = connection.recv()
            if mapped is None or len(mapped) != size:
                mapped = mmap.mmap(memory, size)
            try:
                answer: object = encoder.write(shard, dict(mapped_arrays(mapped, places)))
            except (WarpvisError, OSError) as error:
                answer = error
            except Exception:
                answer = RuntimeError(f"in an encoding process:\n{traceback.format_exc()}")
            connection.send(answer)
