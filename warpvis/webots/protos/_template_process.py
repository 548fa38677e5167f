# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Script of the template process; it does not import warpvis, for a fast start.

It reads jobs and writes answers, each as JSON after its length in four bytes. The engines' limits end most templates.
C code within an engine, which these limits do not cover, is ended by limits of the process: a system timer, whose
signal needs no Python code, and a memory limit. The process ends with its parent.
"""

import os
import sys

if __name__ == "__main__":
    sys.path[:] = sys.argv[1].split("\n")  # the parent's path, to import the same engines

import json
import select
import signal
from typing import Any, BinaryIO

try:
    import resource
except ImportError:  # Windows has only the parent's timeout and the engines' limits
    resource = None  # type: ignore[assignment]

_PATIENCE = 1.0  # interval between checks whether the parent is alive [s]


def main() -> None:
    """Answer jobs until the input ends."""
    parent = os.getppid()
    jobs, answers = os.fdopen(os.dup(0), "rb", buffering=0), os.fdopen(os.dup(1), "wb")
    if resource is not None:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    while (job := _read(jobs, parent)) is not None:
        answer = json.dumps(_answer(job)).encode()
        answers.write(len(answer).to_bytes(4, "little") + answer)
        answers.flush()


def _read(jobs: BinaryIO, parent: int) -> dict[str, Any] | None:
    """Read the next job; return None after the parent has closed the pipe or ended."""
    # Another process forked from the parent may keep the pipe open.
    while hasattr(os, "fork") and not select.select([jobs], [], [], _PATIENCE)[0]:
        if os.getppid() != parent:
            return None
    head = _exactly(jobs, 4)
    text = _exactly(jobs, int.from_bytes(head, "little")) if head else None
    return json.loads(text) if text else None


def _exactly(jobs: BinaryIO, count: int) -> bytes | None:
    parts = []
    while count:
        part = jobs.read(min(count, 1 << 20))
        if not part:
            return None
        parts.append(part)
        count -= len(part)
    return b"".join(parts)


def _answer(job: dict[str, Any]) -> dict[str, str]:
    """Run a template; return its text, or the error of the engine or of encoding the text."""
    run = _javascript if job["language"] == "javascript" else _lua
    _limit(job["seconds"], job["memory"])
    try:
        result = run(job)
        if not isinstance(result, str):
            return {"odd": str(result)}
        result.encode()
        return {"text": result}
    except Exception as error:  # errors of the engines, and of texts with zero bytes or invalid Unicode
        kind = type(error).__name__
        return {"error": str(error) or kind, "kind": kind}
    finally:
        _limit(0, 0)


def _limit(seconds: float, memory: int) -> None:
    """Set limits of the process' CPU time [s] and of its additional memory [bytes]; 0 removes them."""
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, seconds)
    if resource is None or not sys.platform.startswith("linux"):
        return
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    limit = hard
    if memory:
        with open("/proc/self/statm", "rb") as statm:
            limit = int(statm.read().split()[0]) * resource.getpagesize() + memory
        limit = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
    resource.setrlimit(resource.RLIMIT_AS, (limit, hard))


def _javascript(job: dict[str, Any]) -> object:
    try:
        import _quickjs as quickjs  # without the package's thread pools
    except ImportError:
        import quickjs
    context = quickjs.Context()
    context.set_memory_limit(job["heap"])
    context.set_max_stack_size(job["stack"])
    context.set_time_limit(job["limit"])
    context.eval(job["library"])
    for name, value in job["variables"].items():
        context.set("$json", value)
        context.eval(f"var {name} = JSON.parse($json)")
    return context.eval(job["program"])


def _lua(job: dict[str, Any]) -> object:
    from lupa import lua52

    runtime = lua52.LuaRuntime(register_eval=False, register_builtins=False, max_memory=job["heap"])
    assignments = "".join(f"{name} = {value}\n" for name, value in job["variables"].items())
    return runtime.execute(job["library"])(job["program"], assignments, job["limit"], job["modules"])


if __name__ == "__main__":
    main()
