# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Insert small faults into the code, one at a time, and check that the tests detect them.

    python scripts/mutate.py --count 40 --seed 7
    python scripts/mutate.py --at kernels/native/cpu/raster.h:239

Faults are inserted in copies of the tree only. A fault that no test detects has survived: either a test is missing, or
the mutant is equivalent. `scripts/equivalent_mutants.toml` lists equivalent mutants with reasons; other survivors give
exit status 1.
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
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

from mutants import Mutant, choose, mutants_of

ROOT = Path(__file__).resolve().parent.parent
EQUIVALENTS = Path(__file__).resolve().parent / "equivalent_mutants.toml"
FILES = ("kernels/native/cpu/*.h", "kernels/native/shared/*.h", "warpvis/rendering/**/*.py")
STILLBORN = 3
"""Exit status of a command if the code does not compile, which does not count as a detection."""
PYTHON = shlex.quote(sys.executable)
# Slow tests, too: the fast ones are a selection of parameters.
PYTEST = f"{PYTHON} -m pytest -q -x -p no:cacheprovider -m 'not browser and not docs and not site'"
NATIVE = f"{PYTHON} tests/native_build.py"

TESTS: tuple[tuple[str, str], ...] = (
    # Headers of depth camera models, whose rows of pixels are compared with single pixels bit by bit.
    ("shared/time_of_flight.h", "sensor_rows time_of_flight"),
    ("shared/kinect.h", "sensor_rows kinect_noise"),
    ("shared/corruptions.h", "sensor_rows corruptions"),
    ("shared/redwood.h", "sensor_rows kinect_simulators"),
    ("shared/fattening.h", "fattening sensor_cuda_code"),
    ("shared/noise.h", "sensor_rows kinect_noise corruptions time_of_flight"),
    ("cpu/number_lanes.h", "random_numbers sensor_rows stereo classify time_of_flight"),
    ("cpu/random_lanes.h", "random_numbers sensor_rows stereo"),
    ("shared/random*.h", "random_numbers sensor_rows stereo"),
    ("shared/scalar.h", "random_numbers stereo"),
    ("shared/stereo.h", "stereo"),
    ("cpu/depth_rows.h", "classify lens_visibility"),
    # Headers of the BVH builder.
    ("cpu/bvh_*.h", "bvh packets refit"),
    # Headers of packets of rays and of image positions.
    ("cpu/table*.h", "table_packets panorama remap apart_packets"),
    ("cpu/ray_*.h", "table_packets panorama remap apart_packets"),
    ("cpu/remap*.h", "remap"),
    # Headers of visibility.
    ("cpu/point*.h", "point_packets points"),
    ("cpu/silhouettes.h", "object_visibility"),
    ("cpu/fractions.h", "visible_fractions"),
    ("cpu/sample_windows.h", "visible_fractions"),
    # Headers that every packet caster includes.
    ("cpu/sparse.h", "packets points point_packets solids exact_pixels"),
    ("cpu/solids.h", "solids sizes"),
    ("cpu/objects.h", "worlds sizes instances solids object_visibility"),
    ("cpu/scene.h", "worlds sizes instances packets faces"),
    ("shared/stretch.h", "sizes"),
    ("cpu/workers.h", "threads packets worlds"),
    ("cpu/arena.h", "threads packets worlds"),
    ("cpu/*.h", "exact_pixels casters packets near_plane worlds table_packets"),
    ("shared/error_bounds.h", "error_bounds exact_pixels casters packets near_plane table_packets"),
    ("shared/*.h", "exact_pixels casters packets worlds near_plane solids table_packets stereo object_visibility"),
    # Modules of sensors and of special cameras.
    ("rendering/_depth_sensor.py", "depth_sensor randomized latency stereo"),
    ("rendering/_sensing.py", "depth_sensor randomized latency small_calls stereo"),
    ("rendering/_depth_kernels.py", "classify stereo depth_sensor"),
    ("rendering/_panorama.py", "panorama prepared_rays small_calls bad_input"),
    ("rendering/_computed.py", "lit_colors albedo small_calls"),
    ("rendering/_blindness.py", "unlikely_views"),
    ("rendering/casters/moving.py", "moving_sensors"),
    ("rendering/_along.py", "moving_sensors rangefinders echoes"),
    # Modules of packets of rays.
    ("rendering/casters/sorted_rays_cpu.py", "table_packets panorama apart_packets prepared_rays lens_camera"),
    ("rendering/casters/ray_origins_cuda.py", "cuda_apart"),
    ("rendering/casters/packet_images_cuda.py", "cuda_packets cuda_points cuda_apart"),
    ("rendering/casters/sorted_rays_cuda.py", "cuda_packets cuda_points cuda_apart"),
    ("rendering/casters/ray_origins_cpu.py", "apart_packets cuda_apart"),
    ("rendering/casters/ray_bundles_cpu.py", "apart_packets"),
    ("rendering/casters/packets_cpu.py", "remap"),
    ("rendering/casters/ray_bundles_cpu.py", "table_packets prepared_rays panorama threads"),
    ("rendering/casters/points_cuda.py", "cuda_points"),
    ("rendering/casters/*_cuda.py", "cuda_packets cuda_emulator cuda_emulator_precision"),
    ("rendering/casters/found_objects_cuda.py", "found_objects"),
    ("rendering/casters/base.py", "small_calls prepared_rays threads"),
    ("rendering/_choices.py", "bad_input fill rendering near_plane"),
    ("rendering/_views.py", "rendering small_calls interop lit_colors"),
    ("rendering/casters/rays.py", "rendering casters table_packets small_calls interop threads prepared_rays"),
    ("rendering/casters/packets_cpu.py", "packets threads small_calls worlds"),
    ("rendering/*.py", "rendering small_calls near_plane panorama casters worlds packets interop threads bad_input"),
)
"""Patterns of files, and the test files that use them, quick ones first: those of the first pattern that matches."""
_BY_CLANG = ("packets", "solids", "points", "object_visibility")
"""Test files of the headers in the programs of `tests/native_build.py`."""


@dataclass(frozen=True)
class Verdict:
    """The outcome of a mutant: "killed", "survived", "equivalent", or "stillborn" if it does not compile."""

    mutant: Mutant
    outcome: str
    why: str = ""
    seconds: float = 0.0


class Copies:
    """Copies of the tree with separate caches of compiled code, and the processes that run in them."""

    def __init__(self, folder: Path, count: int) -> None:
        """Copy tracked files, and untracked files that are not ignored."""
        names = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=ROOT,
            capture_output=True,
            check=True,
        ).stdout.decode()
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self.stopped = False
        self.free: queue.SimpleQueue[Path] = queue.SimpleQueue()
        for number in range(count):
            copy = folder / f"copy_{number}" / "tree"
            for name in filter(None, names.split("\0")):
                if (ROOT / name).is_file():
                    (copy / name).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy2(ROOT / name, copy / name)
            self.free.put(copy)

    def run(self, command: str, copy: Path, limit: float) -> tuple[int, str]:
        """Run a command in a copy; return its exit status (124 after a timeout) and its output."""
        environment = {
            **os.environ,
            "WARP_CACHE_PATH": str(copy.parent / "warp"),
            "WARPVIS_NATIVE_CACHE": str(copy.parent / "native"),
            "WARPVIS_NATIVE_FLAGS": "-w",  # warnings about unused code do not count as a detection
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
        """End running processes, and start no others."""
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
    """End a process and its children, which are in its session."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)


def test_files(path: str) -> list[str]:
    """Return the names of the test files that use a file, without ``test_`` and suffix, quick ones first."""
    return next((names.split() for pattern, names in TESTS if fnmatch(path, f"*/{pattern}")), [])


def tests_for(path: str, copy: Path) -> list[str]:
    """Return the commands that test a file, fastest first."""
    names = test_files(path)
    files = [f"tests/test_{name}.py" for name in names if (copy / f"tests/test_{name}.py").is_file()]
    native = [NATIVE] if path.endswith(".h") and any(name in _BY_CLANG for name in names) and _has_clang() else []
    return [*native, " ".join([PYTEST, *files])]


@cache
def _has_clang() -> bool:
    return not subprocess.run(shlex.split(f"{NATIVE} --has-clang"), cwd=ROOT, capture_output=True).returncode


def is_program(path: str, text: str) -> bool:
    """Return whether a Python file compiles; C++ is checked by its tests."""
    try:
        return not path.endswith(".py") or bool(compile(text, path, "exec"))
    except SyntaxError:
        return False


def judge(mutant: Mutant, copies: Copies, commands: list[str] | None, limits: dict[str, float]) -> Verdict:
    """Insert a fault in a copy of the tree, run the tests there, and revert it."""
    copy, begun = copies.free.get(), time.monotonic()
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
        copies.free.put(copy)


def _first_failure(output: str) -> str:
    lines = output.strip().splitlines()
    marked = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
    return (marked or lines or ["no output"])[-1 if not marked else 0][:160]


@dataclass(frozen=True)
class Equivalent:
    """A mutant that no test can detect, identified by its stripped line and, if ambiguous, the previous line."""

    line: str
    becomes: str
    reason: str
    above: str = ""

    def excuses(self, mutant: Mutant) -> bool:
        """Return whether it is the given mutant."""
        same = (self.line, self.becomes) == (mutant.before.strip(), mutant.after.strip())
        return same and self.above in ("", mutant.above.strip())


def known_equivalents(path: Path = EQUIVALENTS) -> list[Equivalent]:
    """Read the list of equivalent mutants."""
    entries = tomllib.loads(path.read_text(encoding="utf-8")).get("mutant", []) if path.is_file() else []
    return [Equivalent(**entry) for entry in entries]


def collect(patterns: list[str], at: list[str]) -> list[Mutant]:
    """Return all mutants of files, or those of given lines."""
    places = [place.rsplit(":", 1) for place in at]
    paths = {name for name, _ in places} or {
        str(path.relative_to(ROOT)) for pattern in patterns for path in sorted(ROOT.glob(pattern))
    }
    found = [m for path in sorted(paths) for m in mutants_of(path, (ROOT / path).read_text(encoding="utf-8"))]
    return [m for m in found if not places or [m.path, str(m.number)] in places]


def check_baseline(mutants: list[Mutant], copies: Copies, commands: list[str] | None, limit: float) -> dict[str, float]:
    """Run the tests without a fault, which must pass; return the time limit [s] of each command."""
    copy = copies.free.get()
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
    copies.free.put(copy)
    return limits


def report(verdicts: list[Verdict]) -> int:
    """Print survivors and counts; return the number of survivors."""
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
    parser.add_argument("--files", nargs="+", default=list(FILES), help="patterns of files to mutate")
    parser.add_argument("--at", nargs="+", default=[], metavar="FILE:LINE", help="all mutants of these lines")
    parser.add_argument("--count", type=int, default=20, help="number of mutants")
    parser.add_argument("--seed", type=int, default=0, help="seed of the choice")
    parser.add_argument(
        "--jobs", type=int, default=1, help="number of mutants tested in parallel, each in a separate copy"
    )
    parser.add_argument("--limit", type=float, default=1200.0, help="time limit of tests without mutants [s]")
    parser.add_argument("--command", action="append", help="test command, instead of the default tests")
    parser.add_argument("--list", action="store_true", help="print the mutants without testing them")
    arguments = parser.parse_args()

    mutants = collect(arguments.files, arguments.at)
    equivalents = known_equivalents()
    # Stillborn ones are replaced by the next ones.
    waiting = mutants if arguments.at else choose(mutants, 2 * arguments.count, arguments.seed)
    target_count = len(waiting) if arguments.at else min(arguments.count, len(waiting))
    if arguments.list:
        for mutant in waiting[:target_count]:
            print(f"{mutant.place} ({mutant.kind})\n- {mutant.before.strip()}\n+ {mutant.after.strip()}")
        return 0
    if not waiting:
        sys.exit("no mutants: no such files or lines")

    verdicts: list[Verdict] = []
    for number in (signal.SIGINT, signal.SIGTERM):  # even if the shell ignores them
        signal.signal(number, signal.default_int_handler)
    with tempfile.TemporaryDirectory(prefix="warpvis_mutants_") as folder:
        copies = Copies(Path(folder), arguments.jobs)
        pool = ThreadPoolExecutor(arguments.jobs)
        try:
            limits = check_baseline(waiting, copies, arguments.command, arguments.limit)
            pending = iter(waiting)

            def work() -> None:
                while len(verdicts) < target_count and (mutant := next(pending, None)) is not None:
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
    return 1 if report(verdicts[:target_count]) else 0


if __name__ == "__main__":
    sys.exit(main())
