# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a process that encodes does; `_processes` starts it."""

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
    """Write shards until the process that started this one ends, or wants no more.

    The arguments are numbers of files that are open: of a pipe that ends with it, of memory with the job's arrays, and
    of a connection and memory for each shard that is written at a time.
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
    """Write the shards that come in through one connection."""
    mapped: mmap.mmap | None = None
    with suppress(EOFError, OSError):  # nobody is there any more
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
                answer = RuntimeError(f"in a process that encodes:\n{traceback.format_exc()}")
            connection.send(answer)
