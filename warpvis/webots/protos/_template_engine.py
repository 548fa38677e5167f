# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The process that runs a world's templates, started lazily and restarted after a crash."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path

from warpvis.core.types import Json

WALL_SECONDS = 30.0
"""Maximum wall time of a template, for processes that cannot end themselves or are suspended [s]."""
WORLD_SECONDS = 60.0
"""Maximum wall time of all templates of a world [s]."""

_SCRIPT = Path(__file__).with_name("_template_process.py")


class TemplateEngine:
    """Runs templates in a separate process, which ends with this object and with the parent process.

    The process executes a new Python interpreter instead of continuing a fork, which is safe in processes with threads
    or CUDA and in those of `multiprocessing`. Processes forked from this one start separate template processes.
    """

    def __init__(self) -> None:
        """Initialize without starting the process."""
        self._lock = threading.Lock()
        self._owner = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._end: weakref.finalize[..., TemplateEngine] | None = None
        self._remaining_seconds = WORLD_SECONDS

    def run(self, job: dict[str, Json]) -> dict[str, str]:
        """Run a job of `_template_process`; return its answer.

        That is a dictionary with one of the keys ``"text"``, ``"odd"``, ``"error"`` (with ``"kind"``), ``"late"`` after
        a timeout, or ``"ended"`` with another reason for the end of the process.
        """
        with self._lock:
            if self._remaining_seconds <= 0:
                return {"ended": f"ones of a world that together run longer than {WORLD_SECONDS:g} s"}
            start = time.monotonic()
            try:
                return self._ask(json.dumps(job).encode())
            finally:
                self._remaining_seconds -= time.monotonic() - start

    def _ask(self, job: bytes) -> dict[str, str]:
        process = self._started()
        assert process.stdin is not None and process.stdout is not None
        late = threading.Event()

        def end() -> None:
            late.set()
            process.kill()

        clock = threading.Timer(WALL_SECONDS, end)
        clock.daemon = True
        clock.start()
        try:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.write(len(job).to_bytes(4, "little") + job)
                process.stdin.flush()
            head = process.stdout.read(4)
            answer = process.stdout.read(int.from_bytes(head, "little")) if len(head) == 4 else b""
        finally:
            clock.cancel()
        if answer:
            found: dict[str, str] = json.loads(answer)
            return found
        self.close()
        code = process.returncode
        if late.is_set() or code == -getattr(signal, "SIGPROF", 0):
            return {"late": ""}
        return {"ended": f"one that ended its process (exit status {code})"}

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is not None and self._owner == os.getpid():
            return self._process
        if self._end is not None:
            self._end.detach()
        if not sys.executable or getattr(sys, "frozen", False):  # a frozen program's executable is not Python
            raise OSError("sys.executable must be a Python interpreter, got none")
        paths = "\n".join(path for path in sys.path if "\n" not in path)
        command = [sys.executable, "-S", "-s", str(_SCRIPT), paths]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        self._owner = os.getpid()
        self._end = weakref.finalize(self, _end, self._process, self._owner)
        return self._process

    def close(self) -> None:
        """End the process, if it is running; the next template starts another."""
        if self._end is not None:
            self._end()
        self._process = self._end = None


def is_installed(module: str) -> bool:
    """Return whether a module can be imported, without importing it."""
    if module in sys.modules:
        return sys.modules[module] is not None
    return importlib.util.find_spec(module) is not None


def _end(process: subprocess.Popen[bytes], owner: int) -> None:
    if os.getpid() != owner:  # the process belongs to the parent of this fork
        return
    process.kill()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()
    process.wait()
