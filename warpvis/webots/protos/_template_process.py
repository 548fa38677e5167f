# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The process that templates run in: a script, which imports nothing of warpvis and so starts in a moment.

It reads jobs and writes answers, each as JSON after four bytes of its length. An engine's own limits end most
templates. What they do not reach, code in C within the engine, ends with the process: the clock is a timer of the
system, whose signal needs no Python, and memory is a limit of the process. It ends when its parent does.
"""

import os
import sys

if __name__ == "__main__":
    sys.path[:] = sys.argv[1].split("\n")  # the parent's, so that the engines are those that it would import

import json
import select
import signal
from typing import Any, BinaryIO

try:
    import resource
except ImportError:  # not on Windows, where the parent's clock and the engines' limits remain
    resource = None  # type: ignore[assignment]

_PATIENCE = 1.0  # time between looks at whether the parent is there [s]


def main() -> None:
    """Answer jobs until there are no more."""
    parent = os.getppid()
    jobs, answers = os.fdopen(os.dup(0), "rb", buffering=0), os.fdopen(os.dup(1), "wb")
    if resource is not None:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    while (job := _read(jobs, parent)) is not None:
        answer = json.dumps(_answer(job)).encode()
        answers.write(len(answer).to_bytes(4, "little") + answer)
        answers.flush()


def _read(jobs: BinaryIO, parent: int) -> dict[str, Any] | None:
    """Read the next job; None where the parent has closed the pipe, or is gone."""
    # Another process that the parent forked may hold the pipe open.
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
    """Run a template; say what it makes, or what the engine or the reading of its answer says."""
    run = _javascript if job["language"] == "javascript" else _lua
    _limit(job["seconds"], job["memory"])
    try:
        result = run(job)
        if not isinstance(result, str):
            return {"odd": str(result)}
        result.encode()
        return {"text": result}
    except Exception as error:  # the engines' own, and those of texts with zero bytes or without Unicode
        kind = type(error).__name__
        return {"error": str(error) or kind, "kind": kind}
    finally:
        _limit(0, 0)


def _limit(seconds: float, memory: int) -> None:
    """Set the process' clock of computing time, and its memory beyond what it has; 0 for none."""
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
        import _quickjs as quickjs  # without the thread pools that the package makes
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
    given = "".join(f"{name} = {value}\n" for name, value in job["variables"].items())
    return runtime.eval(job["library"])(job["program"], given, job["limit"], job["modules"])


if __name__ == "__main__":
    main()
