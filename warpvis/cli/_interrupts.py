# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Handling of Ctrl-C, which ends the process at any moment, of closed output, and commands in a subprocess.

Ray ends the process that it runs in when it loses its node, so its commands run in a subprocess.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import RLock, Timer, current_thread, main_thread
from types import FrameType
from typing import TYPE_CHECKING

from warpvis.errors import WarpvisError

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

INTERRUPTED = 130
"""Exit code that shells report for a command ended by SIGINT."""

# Maximum duration of the cleanup of interrupted work, and the time that a subprocess has for it [s].
_GRACE, _SUBPROCESS_GRACE = 10.0, 15.0


@contextmanager
def exiting_on_interrupt() -> Iterator[None]:
    """Exit with code 130 on SIGINT: at once while modules are imported, else after interrupted work has cleaned up.

    A `KeyboardInterrupt` alone is not enough: a module under import may catch it as an error and go on.
    """
    if current_thread() is not main_thread():
        yield
        return
    timer = Timer(_GRACE, _exit)
    timer.daemon = True

    def interrupt(_: int, frame: FrameType | None) -> None:
        if _is_importing(frame) or timer.is_alive():
            _exit()
        timer.start()  # exceptions in destructors and callbacks are lost
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    except KeyboardInterrupt:
        _exit_if_compiling()
        sys.exit(INTERRUPTED)
    finally:
        timer.cancel()
        signal.signal(signal.SIGINT, before)


@contextmanager
def exiting_on_closed_output() -> Iterator[None]:
    """Exit with code 1 if the reader of the output has ended, as ``head`` does."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the interpreter flushes it at its end
        sys.exit(1)


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _exit_if_compiling() -> None:
    """Exit at once if a thread compiles kernels, since it would go on while the interpreter shuts down."""
    cache = sys.modules.get("warpvis.core.kernel_cache")
    if cache is not None and cache.is_compiling():
        _exit()


def _exit() -> None:
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    os._exit(INTERRUPTED)


def run_in_subprocess(work: Callable[[], None], lost: str) -> None:
    """Run a picklable function as a command in a subprocess, and exit like it."""
    import multiprocessing

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
        process.join(_SUBPROCESS_GRACE)
        process.kill()
        raise
    if code:
        sys.exit(code)


def _work(connection: Connection, work: Callable[[], None]) -> None:
    """Run a function as a command, and send the exit code."""
    from tqdm import tqdm

    from warpvis.cli import run_command

    tqdm.set_lock(RLock())  # tqdm's default is a semaphore that outlives the process
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
