# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The engine of one machine: this process, or one process for each of several GPUs."""

from __future__ import annotations

import multiprocessing
import sys
import traceback
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from threading import Event

import warp as wp

from warpvis.batch._encoding import WorkerLostError
from warpvis.batch._shard_job import Done, ShardJob
from warpvis.batch._writer import writer_count
from warpvis.core.arrays import get_device
from warpvis.core.threads import check_threads
from warpvis.core.types import DeviceLike
from warpvis.errors import ArrayError, WarpvisError

_POLL_INTERVAL = 0.2
"""Interval at which a process that waits for work checks for errors [s]."""


def run_local(job: ShardJob, shards: Iterable[int], done: Done, *, devices: Sequence[str], threads: int | None) -> None:
    """Render and write shards on devices of this machine; several devices get a process each, which share `threads`.

    `done` is called with every complete shard, by one thread at a time.
    """
    if len(devices) == 1:
        with job.start_worker(device=devices[0], threads=threads) as writer:
            writer.run(shards, done)
    else:
        _run_processes(job, shards, done, devices, max(1, check_threads(threads) // len(devices)))


def parse_devices(device: DeviceLike) -> list[str]:
    """Return the names of the devices given by one device, several separated by commas, or ``"cuda:all"``."""
    names: list[DeviceLike] = [device] if not isinstance(device, str) else [name.strip() for name in device.split(",")]
    if names == ["cuda:all"]:
        names = [str(found) for found in wp.get_cuda_devices()]
        if not names:
            raise ArrayError("device 'cuda:all' requires at least one GPU, got none on this machine")
    devices = list({str(found): found for found in map(get_device, names)}.values())
    if len({found.is_cpu for found in devices}) > 1:
        raise ArrayError(
            f"device must be the CPU or GPUs, not both, because their images are not bitwise identical, got {device!r}"
        )
    return [str(found) for found in devices]


def _run_processes(job: ShardJob, shards: Iterable[int], done: Done, devices: Sequence[str], threads: int) -> None:
    """Run a process for each device; each receives a new shard when it finishes one, which balances the load."""
    context = multiprocessing.get_context("spawn")  # CUDA does not survive a fork
    workers: dict[Connection, SpawnProcess] = {}
    try:
        for device in devices:
            ours, theirs = context.Pipe()
            process = context.Process(target=_work, args=(theirs, job, device, threads), name=device)
            process.start()
            theirs.close()
            workers[ours] = process
        _distribute(iter(shards), done, workers, ahead=writer_count(threads) + 2)
    finally:
        for connection, process in workers.items():
            connection.close()
            process.terminate()
            process.join()


def _distribute(shards: Iterable[int], done: Done, workers: dict[Connection, SpawnProcess], *, ahead: int) -> None:
    """Distribute shards to the processes until all shards are complete."""
    shards = iter(shards)
    open_shards = dict.fromkeys(workers, 0)
    ended: set[Connection] = set()

    def send_next(connection: Connection) -> None:
        shard = next(shards, None)
        if shard is not None:
            open_shards[connection] += 1
        elif connection in ended:
            return
        else:  # while it waits for work, a process does not check its last shards for errors
            ended.add(connection)
        connection.send(shard)

    try:
        for _ in range(ahead):
            for connection in workers:
                send_next(connection)
        while any(open_shards.values()):
            busy = [connection for connection, count in open_shards.items() if count]
            ready = wait(busy)
            for connection in busy:
                if connection not in ready:
                    continue
                answer = connection.recv()
                if isinstance(answer, Exception):
                    raise answer
                open_shards[connection] -= 1
                done(*answer)
                send_next(connection)
    except (EOFError, ConnectionError):
        raise WorkerLostError(_describe_loss(workers)) from None


def _describe_loss(workers: dict[Connection, SpawnProcess]) -> str:
    for process in workers.values():
        process.join(timeout=0.2)
        if process.exitcode is not None:
            return f"the process for {process.name} ended with exit code {process.exitcode}"
    return "a process ended"


def _work(connection: Connection, job: ShardJob, device: str, threads: int) -> None:
    """Run as a worker process, which receives shards through the connection and sends their records back."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is handled by the parent process
    # SIGTERM ends this process when shards in progress are written. Raising in the handler would have no effect while
    # Python runs a callback that ignores exceptions.
    ending = Event()
    signal.signal(signal.SIGTERM, lambda *_: ending.set())
    wp.config.log_level = wp.LOG_WARNING
    try:
        with job.start_worker(device=device, threads=threads) as writer:
            writer.run(
                _incoming(connection, writer.failed, ending), lambda shard, record: connection.send((shard, record))
            )
    except EOFError:  # the parent process has ended
        pass
    except (WarpvisError, OSError) as error:
        _send_error(connection, error)
    except Exception:
        _send_error(connection, RuntimeError(f"on {device}:\n{traceback.format_exc()}"))
    if ending.is_set():
        sys.exit(1)


def _incoming(connection: Connection, *stops: Event) -> Iterator[int]:
    """Yield the received shards until one could not be written or the process must end."""
    while not any(stop.is_set() for stop in stops):
        if connection.poll(_POLL_INTERVAL):
            shard = connection.recv()
            if shard is None:
                return
            yield shard


def _send_error(connection: Connection, error: Exception) -> None:
    with suppress(OSError):  # the parent process may have ended
        connection.send(error)
