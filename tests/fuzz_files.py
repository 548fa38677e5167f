# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Damaged files of every format: reading one must return a result or raise a `WarpvisError` of one sentence.

``make fuzz-files`` reads a hundred thousand of them. Each follows from its number, which the report names, and is read
in a child process with limits on time and memory, so that a crash is recorded and reading continues. `test_garbage`
reads a few.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import os
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

_SECONDS = 60.0
"""Time limit for reading a file."""
_SECONDS_TO_BEGIN = 600.0
_SLOW_SECONDS = 10.0
"""Files that take longer are listed."""
_BYTES = 4e9
"""Memory limit for reading a file."""
_LONGEST_MESSAGE = 3000
_LONGEST_END = 500
"""Maximum length of a child's output that is shown when it crashes [bytes]."""
_MUTANTS_OF_A_CHILD = 2500
_EVENTS = {
    "os.mkdir": 0,
    "os.rename": 1,
    "os.remove": 0,
    "os.rmdir": 0,
    "os.link": 1,
    "os.symlink": 1,
    "os.truncate": 0,
}
"""Audit events that change files, and the index of the argument with the path."""


class Watch:
    """Records writes outside the allowed folders and network access, by Python's audit hooks."""

    def __init__(self, allowed: list[Path]) -> None:
        """Install the hook; files below `allowed` may be written. Recording starts when `active` is set."""
        self._allowed = [str(path.resolve()) + os.sep for path in allowed]
        self.active = False
        self.seen: list[str] = []
        sys.addaudithook(self._hook)

    def _hook(self, event: str, arguments: tuple) -> None:
        if not self.active:
            return
        if event in ("socket.connect", "socket.getaddrinfo"):
            self.seen.append(f"{event} {arguments[1:]}")
            return
        place = None
        if event == "open":
            mode, flags = arguments[1], arguments[2]
            writes = set(mode or "") & set("wax+") or flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC)
            place = arguments[0] if writes else None
        elif event in _EVENTS:
            place = arguments[_EVENTS[event]]
        if isinstance(place, bytes | str | os.PathLike):
            folder = arguments[-1] if event in _EVENTS and event != "os.truncate" else -1  # an open folder
            folder = f"/proc/self/fd/{folder}" if isinstance(folder, int) and folder >= 0 else os.getcwd()
            whole = os.path.realpath(os.path.join(folder, os.fsdecode(place)))
            if whole != os.devnull and not any((whole + os.sep).startswith(folder) for folder in self._allowed):
                self.seen.append(f"{event} {whole}")


def _memory(name: str) -> int:
    """Return a memory size of this process [bytes]: ``VmHWM``, ``VmSize``."""
    text = Path("/proc/self/status").read_text(encoding="ascii")
    return 1024 * int(next(line.split()[1] for line in text.splitlines() if line.startswith(name)))


def _wrong_error(error: BaseException) -> str | None:
    """Return what is wrong with an error of a reader, or None."""
    import warpvis as wv

    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, MemoryError):
            return f"asks for too much memory: {str(cause)[:150]}"
        cause = cause.__cause__ or cause.__context__
    said = str(error)
    if not isinstance(error, wv.WarpvisError):
        where = [f"{Path(frame.filename).name}:{frame.lineno}" for frame in traceback.extract_tb(error.__traceback__)]
        return f"{type(error).__name__}: {said[:150]} ({' '.join(where[-4:])})"
    if not said.strip():
        return "an error that says nothing"
    if "\n" in said or len(said) > _LONGEST_MESSAGE:
        return f"an error of {len(said)} characters and {said.count(chr(10)) + 1} lines: {said[:100]!r}"
    return None


def make_mutant(seeds: list, number: int, folder: Path):
    """Write a damaged file and its companion files to a folder; return the index of its seed and the file's name.

    Args:
        seeds: Result of `fuzz_seeds.make_seeds`.
        number: Number of the mutant, which determines it.
        folder: A folder that does not exist yet.
    """
    from fuzz_mutations import mutate

    rng = np.random.default_rng(number)
    kinds = sorted({seed.format for seed in seeds})
    kind = kinds[number % len(kinds)]
    of_kind = [seed for seed in seeds if seed.format == kind]
    seed = of_kind[int(rng.integers(len(of_kind)))]
    shutil.copytree(seed.folder, folder)
    name = seed.changed[int(rng.integers(len(seed.changed)))]
    (folder / name).write_bytes(mutate(rng, name, (folder / name).read_bytes()))
    return seed, name


@dataclass
class Reader:
    """Reads mutants in this process."""

    seeds: list
    place: Path
    """Contains the folder of the files, ``given``, and the folder that must not be written to, ``elsewhere``."""
    watch: Watch = field(init=False)

    def __post_init__(self) -> None:
        """Create the folders and change to the one that must not be written to."""
        import warp as wp

        for name in ("elsewhere", "temporary"):
            (self.place / name).mkdir()
        os.chdir(self.place / "elsewhere")
        tempfile.tempdir = str(self.place / "temporary")
        kernels = [Path(wp.config.kernel_cache_dir)] if wp.config.kernel_cache_dir else []
        self.watch = Watch([self.place / "given", self.place / "temporary", *kernels])

    def read(self, number: int) -> dict:
        """Read a mutant and return the outcome."""
        given = self.place / "given"
        shutil.rmtree(given, ignore_errors=True)
        seed, name = make_mutant(self.seeds, number, given)
        outcome = {"number": number, "format": seed.format, "name": name, "refused": None, "wrong": None}
        Path("/proc/self/clear_refs").write_text("5")
        before, start = _memory("VmHWM"), time.perf_counter()
        self.watch.seen, self.watch.active = [], True
        try:
            seed.read(given)
        except Exception as error:
            outcome["wrong"], outcome["refused"] = _wrong_error(error), str(error)[:400].replace(str(given), "")
        finally:
            self.watch.active = False
        outcome["seconds"] = time.perf_counter() - start
        outcome["bytes"] = max(0, _memory("VmHWM") - before)
        if outcome["bytes"] > _BYTES:
            outcome["wrong"] = outcome["wrong"] or f"takes {outcome['bytes'] / 1e9:.1f} GB"
        left = [str(path) for name in ("elsewhere", "temporary") for path in (self.place / name).iterdir()]
        if self.watch.seen or left:
            outcome["wrong"] = outcome["wrong"] or f"writes elsewhere: {(self.watch.seen + left)[0]}"
        for path in left:
            shutil.rmtree(path) if os.path.isdir(path) else os.remove(path)
        return outcome


@contextlib.contextmanager
def made_seeds(module: str) -> Iterator[list]:
    """Yield the seeds in a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        yield importlib.import_module(module).make_seeds(Path(folder).resolve())


def _child(given: argparse.Namespace) -> None:
    """Read mutants in sequence and write a line before and after each."""
    warnings.simplefilter("ignore")
    out = os.fdopen(given.child, "w")
    with made_seeds(given.seeds) as seeds, tempfile.TemporaryDirectory() as place:
        print(json.dumps({"kinds": sorted({seed.format for seed in seeds})}), file=out, flush=True)
        reader = Reader(seeds, Path(place).resolve())
        # Load kernels and libraries first, so that no mutant is charged for their time and memory.
        for seed in seeds:
            copy = reader.place / "given"
            shutil.rmtree(copy, ignore_errors=True)
            shutil.copytree(seed.folder, copy)
            with contextlib.suppress(Exception):
                seed.read(copy)
        limit = _memory("VmSize") + int(given.gigabytes * 1e9)
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        for number in range(given.seed, given.seed + given.count):
            print(json.dumps({"begins": number}), file=out, flush=True)
            print(json.dumps(reader.read(number)), file=out, flush=True)
        os.chdir("/")


def _outcomes(given: argparse.Namespace) -> Iterator[dict]:
    """Read mutants in child processes; yield the formats first, then every outcome."""
    number, last = given.seed, given.seed + given.count
    while number < last:
        receive, send = os.pipe()
        count = min(last - number, _MUTANTS_OF_A_CHILD)
        options = {"child": send, "seed": number, "count": count, "gigabytes": given.gigabytes, "seeds": given.seeds}
        command = [sys.executable, "-B", __file__, *(f"--{name}={value}" for name, value in options.items())]
        with tempfile.TemporaryFile() as printed, os.fdopen(receive, "rb", buffering=0) as stream:
            quiet = {"stdout": subprocess.DEVNULL, "stderr": printed}
            with subprocess.Popen(command, pass_fds=[send], start_new_session=True, **quiet) as process:
                os.close(send)
                for said in _lines(stream, process, printed, given.seconds):
                    number = said.get("number", number - 1) + 1
                    yield said


def _lines(stream: IO[bytes], process: subprocess.Popen, printed: IO[bytes], seconds: float) -> Iterator[dict]:
    """Yield the messages of a child, and at last the outcome of the mutant that ended it, if any.

    Args:
        stream: Messages of the child.
        process: The child.
        printed: Output of the child.
        seconds: Longest time without a message.

    Raises:
        RuntimeError: If the child ended before it began.
    """
    begun, text, late = None, b"", False
    while not late:
        # A child makes the seeds first.
        ready, _, _ = select.select([stream], [], [], seconds if begun is not None else _SECONDS_TO_BEGIN)
        data = os.read(stream.fileno(), 1 << 16) if ready else b""
        late = not ready
        if not data:
            break
        *lines, text = (text + data).split(b"\n")
        for line in lines:
            said = json.loads(line)
            begun = said.get("begins")
            if begun is None:
                yield said
    if late:
        os.killpg(process.pid, signal.SIGKILL)
    code = process.wait()
    printed.seek(max(0, printed.seek(0, os.SEEK_END) - _LONGEST_END))
    end = f"ends the process with status {code}: {printed.read().decode(errors='replace')}"
    wrong = f"takes longer than {seconds:g} s" if late else end
    if begun is not None:
        yield {"number": begun, "format": None, "name": "", "refused": None, "wrong": wrong, "seconds": 0.0, "bytes": 0}
    elif late or code:
        raise RuntimeError(f"a child that reads files {wrong} where it reads none")


def main() -> None:
    """Read many damaged files and report failures with their numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0, help="number of the first file; the others count up")
    parser.add_argument("--gigabytes", type=float, default=_BYTES / 1e9, help="most memory that reading one may take")
    parser.add_argument("--keep", metavar="FOLDER", type=Path, help="write the file of --seed there, and read nothing")
    parser.add_argument("--messages", metavar="FILE", type=Path, help="write what is said of the files")
    parser.add_argument("--seconds", type=float, default=_SECONDS, help="longest that reading one may take")
    parser.add_argument("--seeds", metavar="MODULE", default="fuzz_seeds", help="what makes the files to change")
    parser.add_argument("--child", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child is not None:
        _child(given)
    elif given.keep is not None:
        with made_seeds(given.seeds) as seeds:
            seed, name = make_mutant(seeds, given.seed, given.keep)
        print(f"{seed.format}: {given.keep / name}")
    else:
        sys.exit(_report(given))


def _report(given: argparse.Namespace) -> bool:
    """Read the files, print failures and the number of files of each format; return whether any failed."""
    ends: dict[str, Counter[str]] = {"read": Counter(), "refused": Counter(), "wrong": Counter()}
    kinds: list[str] = []
    slowest, largest = 0.0, 0
    with open(given.messages or os.devnull, "a", encoding="utf-8") as messages:
        for said in _outcomes(given):
            if "kinds" in said:
                kinds = said["kinds"]
                continue
            kind = said["format"] or kinds[said["number"] % len(kinds)]
            end = "wrong" if said["wrong"] is not None else "read" if said["refused"] is None else "refused"
            ends[end][kind] += 1
            slowest, largest = max(slowest, said["seconds"]), max(largest, said["bytes"])
            what = said["wrong"] or (f"took {said['seconds']:.0f} s" if said["seconds"] > _SLOW_SECONDS else "")
            if what:
                print(f"{said['number']}: {kind}, {said['name']}: {what}", flush=True)
            print(json.dumps(said), file=messages, flush=True)
    print(f"{'format':32}{'files':>8}" + "".join(f"{end:>8}" for end in ends))
    for kind in kinds:
        counts = [counter[kind] for counter in ends.values()]
        print(f"{kind:32}{sum(counts):8}" + "".join(f"{count:8}" for count in counts))
    totals = {end: sum(counter.values()) for end, counter in ends.items()}
    print(
        f"{sum(totals.values())} files of {len(kinds)} formats: "
        + ", ".join(f"{count} {end}" for end, count in totals.items())
        + f"; the slowest took {slowest:.1f} s, the largest {largest / 1e9:.2f} GB"
    )
    return bool(totals["wrong"])


if __name__ == "__main__":
    main()
