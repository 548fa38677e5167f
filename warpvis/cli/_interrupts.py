# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Handling of Ctrl-C, which ends the process at any moment."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer, current_thread, main_thread
from types import FrameType

INTERRUPTED = 130
"""Exit code that shells report for a command ended by SIGINT."""

# Maximum duration of the cleanup of interrupted work [s].
_GRACE = 10.0


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
