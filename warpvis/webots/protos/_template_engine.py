# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A process for a world's templates: it is started with the first one, and anew after one that it did not survive."""

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
"""Longest that a template may take where its process cannot end itself, or is not let run [s]."""
WORLD_SECONDS = 60.0
"""Longest that all templates of a world may take [s]."""

_SCRIPT = Path(__file__).with_name("_template_process.py")


class TemplateEngine:
    """Runs templates in a process of its own, which ends with this object, and with the process that made it.

    It is started by executing Python, never by a fork that goes on: in a process with threads or CUDA, and in those
    that `multiprocessing` makes, it works alike. Processes that are forked from this one start their own.
    """

    def __init__(self) -> None:
        """Start nothing yet."""
        self._lock = threading.Lock()
        self._owner = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._end: weakref.finalize[..., TemplateEngine] | None = None
        self._left = WORLD_SECONDS

    def run(self, job: dict[str, Json]) -> dict[str, str]:
        """Run a job of `_template_process`; return its answer.

        Returns:
            One of the keys ``"text"``, ``"odd"``, ``"error"`` with ``"kind"``, ``"late"`` where the clock ended it, or
            ``"ended"``: what else ended it.
        """
        with self._lock:
            if self._left <= 0:
                return {"ended": f"ones of a world that together run longer than {WORLD_SECONDS:g} s"}
            start = time.monotonic()
            try:
                return self._ask(json.dumps(job).encode())
            finally:
                self._left -= time.monotonic() - start

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
        return {"ended": f"one that its process did not survive (exit status {code})"}

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is not None and self._owner == os.getpid():
            return self._process
        if self._end is not None:
            self._end.detach()
        if not sys.executable or getattr(sys, "frozen", False):  # a frozen program's executable is the program
            raise OSError("this program does not say where a Python interpreter is")
        paths = "\n".join(path for path in sys.path if "\n" not in path)
        command = [sys.executable, "-S", "-s", str(_SCRIPT), paths]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        self._owner = os.getpid()
        self._end = weakref.finalize(self, _end, self._process, self._owner)
        return self._process

    def close(self) -> None:
        """End the process, if there is one; the next template starts another."""
        if self._end is not None:
            self._end()
        self._process = self._end = None


def is_installed(module: str) -> bool:
    """Tell whether a module can be imported, without importing it."""
    if module in sys.modules:
        return sys.modules[module] is not None
    return importlib.util.find_spec(module) is not None


def _end(process: subprocess.Popen[bytes], owner: int) -> None:
    if os.getpid() != owner:  # it belongs to the process that this one was forked from
        return
    process.kill()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()
    process.wait()
