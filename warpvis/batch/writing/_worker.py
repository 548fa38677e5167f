# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Main function of encoding processes, which `_processes` starts."""

from __future__ import annotations

import mmap
import os
import sys
import threading
import traceback
from contextlib import suppress
from multiprocessing.connection import Connection

from warpvis.batch.writing._encoder import Encoder
from warpvis.batch.writing._processes import mapped_arrays, unshare
from warpvis.errors import WarpvisError


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
