# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Commands in a process of their own: Ray ends the process that it is in when it loses the node that it is on."""

from __future__ import annotations

import multiprocessing
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection

from warpvis.cli._interrupts import INTERRUPTED
from warpvis.errors import WarpvisError

_GRACE = 15.0  # seconds, a little more than it gives itself to tidy up


def run_apart(work: Callable[[], None], lost: str) -> None:
    """Run what pickles in a process of its own, and end as it does.

    Raises:
        WarpvisError: The process ended in the midst of it: `lost`, and its exit code.
        SystemExit: It ended with an exit code other than 0.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(theirs, work))
    process.start()
    theirs.close()
    try:
        code = ours.recv()
        process.join()
    except EOFError:
        process.join()
        raise WarpvisError(f"{lost} (exit code {process.exitcode})") from None
    except KeyboardInterrupt:  # which that process has got, too
        process.join(_GRACE)
        process.kill()
        raise
    if code:
        sys.exit(code)


def _work(connection: Connection, work: Callable[[], None]) -> None:
    """Run it as a command, and say the exit code."""
    from tqdm import tqdm

    from warpvis.cli import run_command

    tqdm.set_lock(threading.RLock())  # its own would be a semaphore that outlives the process
    code = 1
    try:
        run_command(work)
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except KeyboardInterrupt:
        code = INTERRUPTED
    finally:
        sys.stdout.flush()
        connection.send(code)
