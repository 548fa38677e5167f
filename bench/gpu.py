# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare frames per second of warpvis and its peers on a GPU, side by side in one run, in Markdown tables.

The depth of every method is first compared with that of the reference, the `rays` caster. Then methods take turns. A
method that fails gets a line with the reason. All results are written to a JSON file as they come ($OUT/gpu.json, or
--json), so that an interrupted run loses little.

  python bench/gpu.py                                       everything, within minutes
  python bench/gpu.py --cases room-320 --peers bare newton  one case, and some peers
  python bench/gpu.py --markdown docs/figures.md            with the tables between that file's marks
  python bench/gpu.py --device cpu --views 2 --rounds 1     whether all render the same image, without a GPU
"""

from __future__ import annotations

import argparse
import gc
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import gpu_other_peers
import gpu_peers
import warp as wp
from gpu_cases import ALL_CASES, CASES
from gpu_table import best, of_row, tables, write_json
from gpu_timing import Run, enough_calls, wall_seconds
from gpu_work import Case, Method, Prepared, Result, Subject, agreement
from marked import split_marked, write_marked
from ratios import describe_exception

_MARK = "gpu"  # name of the tables in docs/figures.md

# Ways to use a library that are slower than its fastest by more than this in a first measurement are not measured
# again.
_WORTH_A_LOOK = 1.25

# Minimum number of rounds of a case, whatever the time.
_MIN_ROUNDS = 3

# Libraries that could end the process, and lose all figures, first run in another process with this case. (OptiX and
# nvdiffrast do not use Warp, and nvdiffrast may be compiled for another PyTorch.)
_ON_TRIAL = ("optix", "nvdiffrast")
_TRIAL = ("room", 64, 64, 2)
_TRIAL_SECONDS = 90
_COMPILING_SECONDS = 300


@dataclass(frozen=True)
class Contestant:
    """A method that takes part in the rounds."""

    result: Result
    prepared: Prepared
    graph: Run | None
    calls: int


class Log:
    """Writes results as they come."""

    def __init__(self, path: Path | None) -> None:
        """Start the clock."""
        self.results: list[Result] = []
        self._path = path
        self._start = time.monotonic()

    @property
    def seconds(self) -> float:
        """Return the time since the start [s]."""
        return time.monotonic() - self._start

    def say(self, line: str) -> None:
        """Print one line immediately."""
        print(f"[{self.seconds:5.0f} s] {line}", flush=True)

    def save(self, state: str) -> None:
        """Write all results so far."""
        if self._path:
            write_json(self._path, self.results, state)


def all_methods() -> Iterator[Method]:
    """Return the names of all rows of the table, in order."""
    yield from gpu_peers.methods()
    yield from gpu_other_peers.methods()


def measure(case: Case, name: str, methods: Sequence[Method], options: argparse.Namespace, log: Log) -> None:
    """Measure all methods on one case."""
    first_of_case = len(log.results)
    contestants = []
    for method in methods:
        result = Result(method, name)
        log.results.append(result)
        try:
            contestants.append(_enter(case, method, result))
        except Exception as error:  # whatever a peer raises is shown in its line
            result.missing = describe_exception(error)
        log.say(f"{name}: {_first_look(result)}")
    log.save(f"{name}: first look")
    of_case = log.results[first_of_case:]
    contestants = [entry for entry in contestants if entry.result.missing == "" and _worth(entry.result, of_case)]
    rounds, start = 0, time.monotonic()
    while rounds < options.rounds and (rounds < _MIN_ROUNDS or time.monotonic() - start < options.case_seconds):
        _round(contestants[:: -1 if rounds % 2 else 1])
        rounds += 1
        log.save(f"{name}: {rounds} rounds")
    log.say(f"{name}: {rounds} rounds of {len(contestants)} methods, {time.monotonic() - start:.0f} s")
    for result in of_case:
        if result.device_seconds:
            log.say(f"{name}: {_figures(result)}")


def _enter(case: Case, method: Method, result: Result) -> Contestant:
    """Prepare a method, compare its images with the reference, and time it once."""
    prepared = method.prepare(case)
    result.views, result.note = prepared.views, prepared.note
    if prepared.image is not None:
        prepared.image.fill_(float("nan"))
    prepared.run()
    prepared.timer.synchronize()
    count = min(case.checked, prepared.views)
    result.agreement = agreement(prepared.depth(count), case.truths[method.culls][:count], case.camera)
    result.first_seconds = prepared.timer.device_seconds(prepared.run, 1)
    graph = _record(prepared, result)
    return Contestant(result, prepared, graph, enough_calls(result.first_seconds))


def _record(prepared: Prepared, result: Result) -> Run | None:
    """Return the call as a CUDA graph, or None."""
    try:
        graph = prepared.timer.record(prepared.run)
        if graph is not None:
            graph()
            prepared.timer.synchronize()
        return graph
    except Exception as error:  # a call that cannot be captured is measured without a graph
        result.graph_missing = describe_exception(error)
        return None


def _worth(result: Result, results: Sequence[Result]) -> bool:
    """Return whether a way to use a library may be its fastest."""
    if not result.right:
        return False
    rival = best(of_row(results, result.method.row))
    return rival is None or result.first_seconds <= _WORTH_A_LOOK * rival.first_seconds


def _round(contestants: Sequence[Contestant]) -> None:
    """Run a round of each contestant."""
    gc.collect()
    for entry in contestants:
        timer, run, result = entry.prepared.timer, entry.prepared.run, entry.result
        try:
            result.device_seconds.append(timer.device_seconds(run, entry.calls))
            if entry.graph:
                result.graph_seconds.append(timer.device_seconds(entry.graph, entry.calls))
            result.wall_seconds.append(wall_seconds(timer, run))
        except Exception as error:  # it has worked once, and the others still do
            result.missing = describe_exception(error)


def _first_look(result: Result) -> str:
    if result.missing:
        return f"{result.method.title}: not there: {result.missing}"
    note = f" [{result.note}]" if result.note else ""
    wrong = "" if result.right else "; ANOTHER PICTURE, not measured further"
    graph = f"; no graph: {result.graph_missing}" if result.graph_missing else ""
    speed = f"{result.views / result.first_seconds:,.0f} fps at first look"
    return f"{result.method.title}{note}: {result.agreement}; {speed}{graph}{wrong}"


def _figures(result: Result) -> str:
    note = f" [{result.note}]" if result.note else ""
    return f"{result.fps:>12,.0f} fps, {result.wall_fps:>12,.0f} fps by the clock  {result.method.title}{note}"


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    groups = list(dict.fromkeys(method.group for method in all_methods()))
    out = os.environ.get("OUT")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--cases", nargs="+", choices=ALL_CASES, default=list(CASES), metavar="CASE", help=", ".join(ALL_CASES)
    )
    parser.add_argument(
        "--peers",
        nargs="+",
        choices=groups,
        default=groups,
        metavar="PEER",
        help=f"{', '.join(groups)}; by default all",
    )
    parser.add_argument("--device", default="cuda:0", help="cpu shows that all make the same picture")
    parser.add_argument("--views", type=int, help="views a call, instead of each case's own number")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--case-seconds", type=float, default=20, help="no further round of a case after that")
    parser.add_argument("--limit", type=float, default=400, help="no further case after that many seconds")
    parser.add_argument("--json", type=Path, default=Path(out) / "gpu.json" if out else None, metavar="FILE")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="put the tables there, between its marks")
    parser.add_argument("--trial", choices=groups, help=argparse.SUPPRESS)
    return parser.parse_args(arguments)


def _try_out(method: Method, options: argparse.Namespace) -> int:
    """Use a method once, in a process of which nothing else depends."""
    preset, width, height, views = _TRIAL
    case = Case.of(Subject(preset, wp.get_device(options.device)), width, height, views)
    _enter(case, method, Result(method, "trial"))
    return 0


def crashes(groups: Sequence[str], device: str, log: Log) -> dict[str, str]:
    """Return the libraries that end the process, and how; those that only raise are not included."""
    command = [sys.executable, __file__, "--device", device, "--trial"]
    running = {
        group: subprocess.Popen([*command, group], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for group in groups
    }
    found = {}
    for group, process in running.items():
        try:
            code = process.wait(_COMPILING_SECONDS if gpu_other_peers.COMPILE in os.environ else _TRIAL_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            found[group] = "it did not end when tried out"
        else:
            if code < 0:
                found[group] = f"it ended the process when tried out, by signal {-code}"
        log.say(f"{group}: {found.get(group, 'tried out')}")
    return found


def _subjects(names: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Return cases grouped by preset, so that each scene is built once."""
    presets = dict.fromkeys(ALL_CASES[name][1] for name in names)
    return [(preset, [name for name in names if ALL_CASES[name][1] == preset]) for preset in presets]


def _free() -> None:
    """Release memory that libraries cache."""
    gc.collect()
    if "torch" in sys.modules:
        sys.modules["torch"].cuda.empty_cache()
    if "drjit" in sys.modules:
        sys.modules["drjit"].flush_malloc_cache()


def _refuse(reason: str) -> Callable[[Case], Prepared]:
    def prepare(case: Case) -> Prepared:
        raise RuntimeError(reason)

    return prepare


def run(options: argparse.Namespace, log: Log) -> None:
    """Measure all cases within the time limit."""
    device = wp.get_device(options.device)
    crashing = crashes([group for group in _ON_TRIAL if group in options.peers], options.device, log)
    methods = [
        replace(method, prepare=_refuse(crashing[method.group])) if method.group in crashing else method
        for method in all_methods()
        if method.group in {"warpvis", *options.peers}
    ]
    for preset, names in _subjects(options.cases):
        if log.seconds > options.limit:
            log.say(f"{', '.join(names)}: left out, {options.limit:.0f} s have passed")
            continue
        log.say(f"{preset}: building the scene")
        subject = Subject(preset, device)
        for name in names:
            _, _, width, height, views = ALL_CASES[name]
            if log.seconds > options.limit:
                log.say(f"{name}: left out, {options.limit:.0f} s have passed")
                continue
            measure(Case.of(subject, width, height, options.views or views), name, methods, options, log)
            _free()
        del subject
        _free()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison, and print lines and finally tables."""
    options = _parse(arguments)
    wp.config.log_level = wp.LOG_WARNING
    try:
        device = wp.get_device(options.device)
        if options.markdown:
            split_marked(options.markdown, _MARK)
    except (OSError, RuntimeError, ValueError) as error:
        print(f"gpu.py: {error}", file=sys.stderr)
        return 2
    if options.trial:
        return _try_out(next(method for method in all_methods() if method.group == options.trial), options)
    log = Log(options.json)
    run(options, log)
    text = tables(log.results, {name: case[0] for name, case in ALL_CASES.items()}, options.rounds, device)
    print(f"\n{text}", flush=True)
    log.save("complete")
    if options.markdown:
        write_marked(options.markdown, _MARK, text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
