# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure workloads of warpvis against peers in the same run, and compare the ratios with a table of earlier ones.

A ratio is the time of a peer divided by that of warpvis: it falls if warpvis becomes slower. Ratios vary less between
runs than times, because other load on the machine affects both sides.
"""

from __future__ import annotations

import argparse
import gc
import json
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from gpu_timing import Run, Timer, enough_calls

ROOT = Path(__file__).resolve().parent.parent

# Default decrease of a ratio that counts as lower; the ratio is then measured a second time.
TOLERATED = 0.05

ROUNDS = 9

# No further round of a workload begins after this many seconds, once the minimum number of rounds is complete.
_MAX_SECONDS, _MIN_ROUNDS = 3.0, 3

# Fraction of values that must agree; rays at edges may round differently.
_MIN_SAME = 0.95

# Ways to use a peer that are slower than its fastest by this factor in a first measurement are dropped.
_WORTH_A_LOOK = 1.25


@dataclass(frozen=True)
class Contest:
    """Calls that take turns."""

    ours: Run
    peers: Mapping[str, Sequence[Run]]
    """One or more ways to use each peer, of which the fastest counts."""
    timer: Timer
    same: float = 1.0
    """Fraction of values on which both sides agree."""
    with_graphs: bool = False
    """Whether calls are replayed as CUDA graphs."""


@dataclass(frozen=True)
class Workload:
    """A name, and a function that builds scenes and buffers, which is not timed."""

    name: str
    prepare: Callable[[], Contest]


@dataclass(frozen=True)
class Figure:
    """One workload's row of a table."""

    ms: float
    """Median time of warpvis's call."""
    ratios: dict[str, float]
    """Median time of each peer relative to it."""
    commit: str = ""
    date: str = ""

    def fallen(self, before: Figure | None, tolerated: float = TOLERATED) -> dict[str, float]:
        """Return ratios that are lower than in `before` by more than a fraction, relative to their former values."""
        earlier = before.ratios if before else {}
        shares = {peer: ratio / earlier[peer] for peer, ratio in self.ratios.items() if peer in earlier}
        return {peer: share for peer, share in shares.items() if share < 1 - tolerated}


def read_table(path: Path) -> dict[str, Figure]:
    """Return the rows of a table by workload name; empty if the file does not exist."""
    if not path.is_file():
        return {}
    return {name: Figure(**row) for name, row in json.loads(path.read_text(encoding="utf-8"))["workloads"].items()}


def write_table(path: Path, machine: str, table: Mapping[str, Figure]) -> None:
    """Write a table; an interrupted run leaves the previous file intact."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"machine": machine, "workloads": {name: asdict(row) for name, row in table.items()}}, indent=1)
    draft = path.with_suffix(".tmp")
    draft.write_text(text + "\n", encoding="utf-8")
    draft.replace(path)


def measure(contest: Contest, rounds: int) -> Figure:
    """Return medians over rounds in which all calls take turns.

    Raises:
        RuntimeError: If the values of both sides differ.
    """
    if not contest.same >= _MIN_SAME:
        raise RuntimeError(f"both sides must agree on {_MIN_SAME:.0%} of values, got {contest.same:.2%}")
    timer = contest.timer
    rows = [("", contest.ours), *((peer, run) for peer, ways in contest.peers.items() for run in ways)]
    if contest.with_graphs:
        for _ in range(2):  # allocations and module loads happen before calls are captured
            for _, run in rows:
                run()
        gc.collect()  # no memory may be freed during capture
        rows = [(peer, timer.record(run) or run) for peer, run in rows]
    first = [min(timer.device_seconds(run, 1) for _ in range(2)) for _, run in rows]
    fastest = {
        peer: min(seconds for (other, _), seconds in zip(rows, first, strict=True) if other == peer) for peer, _ in rows
    }
    selected = [i for i, (peer, _) in enumerate(rows) if first[i] <= _WORTH_A_LOOK * fastest[peer]]
    times = np.array(_rounds(timer, [rows[i][1] for i in selected], [first[i] for i in selected], rounds))
    ratios: dict[str, float] = {}
    for i, column in zip(selected[1:], times[1:], strict=True):
        peer, ratio = rows[i][0], float(np.median(column / times[0]))
        ratios[peer] = min(ratio, ratios.get(peer, ratio))
    return Figure(1e3 * float(np.median(times[0])), ratios)


def _rounds(timer: Timer, runs: Sequence[Run], first: Sequence[float], rounds: int) -> list[list[float]]:
    """Return the times of each call [s], one per round."""
    calls = [enough_calls(seconds) for seconds in first]
    times: list[list[float]] = [[] for _ in runs]
    gc.collect()
    gc.disable()
    try:
        start = time.monotonic()
        for number in range(rounds):
            if number >= _MIN_ROUNDS and time.monotonic() - start > _MAX_SECONDS:
                break
            for i in range(len(runs))[:: -1 if number % 2 else 1]:
                times[i].append(timer.device_seconds(runs[i], calls[i]))
    finally:
        gc.enable()
    return times


def describe_exception(error: Exception) -> str:
    """Return the error's first clause."""
    if isinstance(error, ModuleNotFoundError):
        return f"{str(error.name).partition('.')[0]} is not installed"
    line = (str(error).strip() or type(error).__name__).splitlines()[0]
    text = line.rstrip(".").replace("|", "/")
    return text if len(text) <= 160 else text[:157] + "..."


def commit_name() -> str:
    """Return the current commit, with "-dirty" if files differ from it; "unversioned" without git."""
    commit = _git("rev-parse", "--short", "HEAD")
    if commit is None:
        return "unversioned"
    return f"{commit}-dirty" if _git("status", "--porcelain") else commit


def _git(*arguments: str) -> str | None:
    try:
        done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


@dataclass
class Guard:
    """A run, whose figures are compared with a table, printed and written as they come."""

    machine: str
    table_path: Path
    out_path: Path | None = None
    update: bool = False
    commit: str = ""
    rounds: int = ROUNDS
    tolerated: float = TOLERATED
    limit: float = np.inf
    """Seconds after which no further workload begins."""
    fallen: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Read the table."""
        self.table = read_table(self.table_path)
        self.found: dict[str, Figure] = {}
        self._start = time.monotonic()

    def run(self, workloads: Iterable[Workload]) -> int:
        """Measure workloads and return the exit status: 1 if a ratio fell, or a workload of the table failed."""
        self._print(f"{self.machine}, commit {self.commit}; table {self.table_path}: {len(self.table)} workloads")
        for workload in workloads:
            if time.monotonic() - self._start > self.limit:
                self.missing.append(f"{workload.name}: {self.limit:.0f} s have passed")
                continue
            self._measure(workload)
            gc.collect()
        return self.report()

    def accept(self, name: str, figure: Figure, note: str = "") -> None:
        """Compare a workload's figure with the table, print it, and write it."""
        before = self.table.get(name)
        self.found[name] = figure
        shown = []
        for peer, ratio in figure.ratios.items():
            was = f" ({before.ratios[peer]:.3g})" if before and peer in before.ratios else " (new)"
            shown.append(f"{peer} {ratio:.3g}{was}")
        fallen = figure.fallen(before, self.tolerated)
        for peer, share in fallen.items():
            self.fallen.append(
                f"{name}: {peer} {figure.ratios[peer]:.3g}, {1 - share:.0%} below {before.ratios[peer]:.3g} of "
                f"{before.commit} ({before.date}); a call takes {figure.ms:.4g} ms, {before.ms:.4g} ms then"
            )
        self._print(f"{name}: {figure.ms:.4g} ms; {', '.join(shown)}{'; FELL' if fallen else ''}{note}")
        lost = [peer for peer in before.ratios if peer not in figure.ratios] if before else []
        self.missing += [f"{name}: {peer}, which the table has" for peer in lost]
        if self.out_path:
            write_table(self.out_path, self.machine, self.found)
        if self.update:
            self.table[name] = figure
            write_table(self.table_path, self.machine, self.table)

    def report(self) -> int:
        """Print what fell and what was not measured, and return the exit status."""
        if self.missing:
            print("\nNot measured:", *self.missing, sep="\n  ")
        if self.fallen:
            print(f"\nFELL by more than {self.tolerated:.0%}:", *self.fallen, sep="\n  ")
        else:
            print(f"\nOf {len(self.found)} workloads, none fell by more than {self.tolerated:.0%}.")
        print(f"{time.monotonic() - self._start:.0f} s", flush=True)
        return 1 if self.fallen else 0

    def _measure(self, workload: Workload) -> None:
        begin = time.monotonic()
        try:
            contest = workload.prepare()
            prepared = time.monotonic()
            figure = measure(contest, self.rounds * (2 if self.update else 1))
            if figure.fallen(self.table.get(workload.name), self.tolerated):
                self._print(f"{workload.name}: lower than in the table, measured again")
                figure = measure(contest, 2 * self.rounds)
        except Exception as error:  # whatever a workload raises, the others are measured
            line = f"{workload.name}: {describe_exception(error)}"
            self._print(f"{line}; not measured")
            self.missing.append(line)
            if workload.name in self.table and not isinstance(error, ModuleNotFoundError):
                self.fallen.append(f"{line}; the table has it")
            return
        note = f"; {prepared - begin:.1f} s to prepare, {time.monotonic() - prepared:.1f} s to measure"
        self.accept(workload.name, Figure(figure.ms, figure.ratios, self.commit, time.strftime("%Y-%m-%d")), note)

    def _print(self, line: str) -> None:
        print(f"[{time.monotonic() - self._start:5.0f} s] {line}", flush=True)


def add_options(
    parser: argparse.ArgumentParser, limit: float, tolerated: float = TOLERATED, rounds: int = ROUNDS
) -> None:
    """Add the options that all guards share."""
    parser.add_argument("--only", nargs="+", metavar="NAME", help="workloads that have one of these in their names")
    parser.add_argument("--list", action="store_true", help="print the workloads' names")
    parser.add_argument("--update", action="store_true", help="write the table")
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="write the new figures there, as a table, as they come"
    )
    parser.add_argument(
        "--figures", type=Path, metavar="FILE", help="take figures from a file of --out, measure nothing"
    )
    parser.add_argument("--table", type=Path, metavar="FILE", help="a table other than this machine's")
    parser.add_argument("--commit", default="", metavar="NAME", help="where there is no git")
    parser.add_argument("--rounds", type=int, default=rounds)
    parser.add_argument("--tolerated", type=float, default=tolerated, metavar="SHARE", help="what a ratio may fall by")
    parser.add_argument("--limit", type=float, default=limit, help="no further workload after that many seconds")


def run_guard(options: argparse.Namespace, machine: str, table: Path, workloads: Iterable[Workload]) -> int:
    """Execute the options and return the exit status."""
    chosen = [w for w in workloads if not options.only or any(text in w.name for text in options.only)]
    if options.list:
        print(*(workload.name for workload in chosen), sep="\n")
        return 0
    guard = Guard(
        machine,
        options.table or table,
        options.out,
        options.update,
        options.commit or commit_name(),
        options.rounds,
        options.tolerated,
        options.limit,
    )
    if options.figures is None:
        if not options.only:
            lost = sorted(guard.table.keys() - {workload.name for workload in chosen})
            guard.missing += [f"{name}: the table has it, and no workload has its name" for name in lost]
        return guard.run(chosen)
    for name, figure in read_table(options.figures).items():
        guard.accept(name, figure)
    return guard.report()
