# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Commands in a subprocess, since Ray ends the process it runs in when it loses its node."""

from __future__ import annotations

import multiprocessing
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection

from warpvis.cli._interrupts import INTERRUPTED
from warpvis.errors import WarpvisError

_GRACE = 15.0  # seconds, a little more than the subprocess takes to clean up


def run_in_subprocess(work: Callable[[], None], lost: str) -> None:
    """Run a picklable function as a command in a subprocess, and exit like it."""
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
    except KeyboardInterrupt:  # the subprocess receives SIGINT, too
        process.join(_GRACE)
        process.kill()
        raise
    if code:
        sys.exit(code)


def _work(connection: Connection, work: Callable[[], None]) -> None:
    """Run a function as a command, and send the exit code."""
    from tqdm import tqdm

    from warpvis.cli import run_command

    tqdm.set_lock(threading.RLock())  # tqdm's default is a semaphore that outlives the process
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
