# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Make small mistakes in the code, one at a time, and see whether the tests notice.

    python scripts/mutate.py --count 40 --seed 7
    python scripts/mutate.py --at kernels/native/cpu/raster.h:239

Each mistake is made in a copy of the tree, never in the tree itself. One that no test notices has survived: either a
test is missing, or nothing that is asked of the code depends on it. `scripts/equivalent_mutants.toml` lists the latter,
each with its reason; any other survivor makes this exit with 1.
"""

from __future__ import annotations

import argparse
import os
import queue
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from mutants import Mutant, choose, mutants_of

ROOT = Path(__file__).resolve().parent.parent
EQUIVALENTS = Path(__file__).resolve().parent / "equivalent_mutants.toml"
FILES = ("kernels/native/cpu/*.h", "kernels/native/shared/*.h", "warpvis/rendering/**/*.py")
STILLBORN = 3
"""Exit status of a command that finds that the code does not compile: that is no test."""
PYTHON = shlex.quote(sys.executable)
PYTEST = f"{PYTHON} -m pytest -q -x -p no:cacheprovider"
NATIVE = f"{PYTHON} tests/native_build.py"

_PICTURES = ("casters", "packets", "worlds", "solids", "near_plane", "points", "point_packets", "object_visibility")
_PICTURES += ("bvh",)
_RENDER = ("rendering", "near_plane", "panorama", "casters", "worlds", "packets", "cuda_packets", "interop")
_RENDER += ("threads", "bad_input", "small_calls")


@dataclass(frozen=True)
class Verdict:
    """What became of a mutant: "killed", "survived", "equivalent", or "stillborn" where it does not compile."""

    mutant: Mutant
    outcome: str
    why: str = ""
    seconds: float = 0.0


class Copies:
    """Copies of the tree, each with a cache of its own for what is compiled, and the processes that run in them."""

    def __init__(self, folder: Path, count: int) -> None:
        """Copy what is tracked, and what is new and not ignored."""
        names = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=ROOT,
            capture_output=True,
            check=True,
        ).stdout.decode()
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self.stopped = False
        self.idle: queue.SimpleQueue[Path] = queue.SimpleQueue()
        for number in range(count):
            copy = folder / f"copy_{number}" / "tree"
            for name in filter(None, names.split("\0")):
                if (ROOT / name).is_file():
                    (copy / name).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy2(ROOT / name, copy / name)
            self.idle.put(copy)

    def run(self, command: str, copy: Path, limit: float) -> tuple[int, str]:
        """Run a command in a copy: its exit status and its output; 124 if it took too long."""
        environment = {
            **os.environ,
            "WARP_CACHE_PATH": str(copy.parent / "warp"),
            "WARPVIS_NATIVE_CACHE": str(copy.parent / "native"),
            "WARPVIS_NATIVE_FLAGS": "-w",  # a mutant is not noticed by what it leaves unused
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        with self._lock:
            if self.stopped:
                return 130, "interrupted"
            process = subprocess.Popen(
                shlex.split(command),
                cwd=copy,
                env=environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                start_new_session=True,
            )
            self._running.add(process)
        try:
            return _finish(process, limit)
        finally:
            with self._lock:
                self._running.discard(process)

    def stop(self) -> None:
        """End what runs, and start nothing more."""
        with self._lock:
            self.stopped = True
            for process in self._running:
                _end(process)


def _finish(process: subprocess.Popen[str], limit: float) -> tuple[int, str]:
    try:
        output, _ = process.communicate(timeout=limit)
        return process.returncode, output
    except subprocess.TimeoutExpired:
        _end(process)
        process.communicate()
        return 124, f"took longer than {limit:.0f} s"


def _end(process: subprocess.Popen[str]) -> None:
    """End a process and what it started: it leads a session of its own."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)


def tests_for(path: str, copy: Path) -> list[str]:
    """Commands that are to notice a mistake in a file, the quickest first."""
    names = _RENDER if path.endswith(".py") else _PICTURES
    files = [f"tests/test_{name}.py" for name in names if (copy / f"tests/test_{name}.py").is_file()]
    first = [] if path.endswith(".py") else [NATIVE]
    return [*first, " ".join([PYTEST, *files])]


def is_program(path: str, text: str) -> bool:
    """Whether a Python file can be compiled. Of C++, its tests say so."""
    try:
        return not path.endswith(".py") or bool(compile(text, path, "exec"))
    except SyntaxError:
        return False


def judge(mutant: Mutant, copies: Copies, commands: list[str] | None, limits: dict[str, float]) -> Verdict:
    """Make one mistake in a copy of the tree, run the tests there, and take it back."""
    copy, begun = copies.idle.get(), time.monotonic()
    target = copy / mutant.path
    original = target.read_text(encoding="utf-8")
    try:
        text = mutant.apply(original)
        target.write_text(text, encoding="utf-8")
        if not is_program(mutant.path, text):
            return Verdict(mutant, "stillborn")
        for command in commands or tests_for(mutant.path, copy):
            status, output = copies.run(command, copy, limits[command])
            if status == STILLBORN:
                return Verdict(mutant, "stillborn")
            if status:
                return Verdict(mutant, "killed", _first_failure(output), time.monotonic() - begun)
        return Verdict(mutant, "survived", "", time.monotonic() - begun)
    finally:
        target.write_text(original, encoding="utf-8")
        copies.idle.put(copy)


def _first_failure(output: str) -> str:
    lines = output.strip().splitlines()
    marked = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
    return (marked or lines or ["no output"])[-1 if not marked else 0][:160]


@dataclass(frozen=True)
class Equivalent:
    """A mutant that no test can notice, known by its line, without indentation, and where that is not enough, by what
    stands above it.
    """

    line: str
    becomes: str
    reason: str
    above: str = ""

    def excuses(self, mutant: Mutant) -> bool:
        """Tell whether it is this mutant."""
        same = (self.line, self.becomes) == (mutant.before.strip(), mutant.after.strip())
        return same and self.above in ("", mutant.above.strip())


def known_equivalents(path: Path = EQUIVALENTS) -> list[Equivalent]:
    """Return what the list says."""
    entries = tomllib.loads(path.read_text(encoding="utf-8")).get("mutant", []) if path.is_file() else []
    return [Equivalent(**entry) for entry in entries]


def collect(patterns: list[str], at: list[str]) -> list[Mutant]:
    """All mutants of the files, or those at some places."""
    places = [place.rsplit(":", 1) for place in at]
    paths = {name for name, _ in places} or {
        str(path.relative_to(ROOT)) for pattern in patterns for path in sorted(ROOT.glob(pattern))
    }
    found = [m for path in sorted(paths) for m in mutants_of(path, (ROOT / path).read_text(encoding="utf-8"))]
    return [m for m in found if not places or [m.path, str(m.number)] in places]


def check_baseline(mutants: list[Mutant], copies: Copies, commands: list[str] | None, limit: float) -> dict[str, float]:
    """Run the tests without a mistake, which have to pass; what each command may take with one."""
    copy = copies.idle.get()
    limits: dict[str, float] = {}
    for path in dict.fromkeys(mutant.path for mutant in mutants):
        for command in commands or tests_for(path, copy):
            if command in limits:
                continue
            begun = time.monotonic()
            status, output = copies.run(command, copy, limit)
            if status:
                sys.exit(f"without any mutant, this fails:\n{command}\n{output[-3000:]}")
            limits[command] = 60.0 + 5.0 * (time.monotonic() - begun)
    copies.idle.put(copy)
    return limits


def report(verdicts: list[Verdict]) -> int:
    """Print what survived and how many of each there are; the number of survivors that nothing excuses."""
    for verdict in verdicts:
        if verdict.outcome == "survived":
            mutant = verdict.mutant
            print(f"\nSURVIVED {mutant.place} ({mutant.kind})\n- {mutant.before}\n+ {mutant.after}")
    counts = {name: sum(v.outcome == name for v in verdicts) for name in ("killed", "survived", "equivalent")}
    print(
        "\n" + ", ".join(f"{count} {name}" for name, count in counts.items()) + f", of {sum(counts.values())} mutants"
    )
    return counts["survived"]


def main() -> int:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", nargs="+", default=list(FILES), help="patterns of files to make mistakes in")
    parser.add_argument("--at", nargs="+", default=[], metavar="FILE:LINE", help="all mutants of these lines")
    parser.add_argument("--count", type=int, default=20, help="how many mutants to choose")
    parser.add_argument("--seed", type=int, default=0, help="which ones")
    parser.add_argument("--jobs", type=int, default=1, help="mutants at a time, each in a copy of its own")
    parser.add_argument("--limit", type=float, default=1200.0, help="seconds that tests without mutants may take")
    parser.add_argument("--command", action="append", help="what is to notice mistakes, instead of the tests")
    parser.add_argument("--list", action="store_true", help="print the mutants, and make none")
    arguments = parser.parse_args()

    mutants = collect(arguments.files, arguments.at)
    equivalents = known_equivalents()
    # Stillborn ones are replaced by the next ones.
    waiting = mutants if arguments.at else choose(mutants, 2 * arguments.count, arguments.seed)
    wanted = len(waiting) if arguments.at else min(arguments.count, len(waiting))
    if arguments.list:
        for mutant in waiting[:wanted]:
            print(f"{mutant.place} ({mutant.kind})\n- {mutant.before.strip()}\n+ {mutant.after.strip()}")
        return 0
    if not waiting:
        sys.exit("no mutants: no such files or lines")

    verdicts: list[Verdict] = []
    for number in (signal.SIGINT, signal.SIGTERM):  # also where a shell has them ignored
        signal.signal(number, signal.default_int_handler)
    with tempfile.TemporaryDirectory(prefix="warpvis_mutants_") as folder:
        copies = Copies(Path(folder), arguments.jobs)
        pool = ThreadPoolExecutor(arguments.jobs)
        try:
            limits = check_baseline(waiting, copies, arguments.command, arguments.limit)
            rest = iter(waiting)

            def work() -> None:
                while len(verdicts) < wanted and (mutant := next(rest, None)) is not None:
                    reasons = [known.reason for known in equivalents if known.excuses(mutant)]
                    if reasons:
                        verdict = Verdict(mutant, "equivalent", reasons[0])
                    else:
                        verdict = judge(mutant, copies, arguments.command, limits)
                    if copies.stopped:
                        return
                    if verdict.outcome != "stillborn":
                        verdicts.append(verdict)
                        change = f"{mutant.before.strip()}  ->  {mutant.after.strip()}"
                        print(f"{verdict.outcome} {mutant.place} ({verdict.seconds:.0f} s) {change}  {verdict.why}")
                        sys.stdout.flush()

            for done in [pool.submit(work) for _ in range(arguments.jobs)]:
                done.result()
        except KeyboardInterrupt:
            print("\ninterrupted; so far:")
        finally:
            copies.stop()
            pool.shutdown(cancel_futures=True)
    return 1 if report(verdicts[:wanted]) else 0


if __name__ == "__main__":
    sys.exit(main())
