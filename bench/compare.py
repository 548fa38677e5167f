# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare frames per second of warpvis and its peers on the same views, side by side in one run.

Methods take turns, so that other load on the machine affects all of them equally, and the Markdown table shows medians.
The depth of every method is first compared with that of the reference, the `rays` caster. A second table has workloads
other than batches (see more.py).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from machine import OtherWork, describe
from marked import split_marked, write_marked
from more import Figure, compared, measure_more, more_markdown, number, row
from numpy.typing import NDArray
from peers import BASELINE, METHODS, Method, Work, warpvis
from timing import take_turns

import warpvis as wv

MARK = "bench"
"""Name of the tables in docs/figures.md, unless another is given."""

TOLERANCE = 1e-3


@dataclass
class Result:
    """Result of one method on one scene."""

    method: str
    scene: str
    views: int = 0
    agreement: float = 0.0
    """Fraction of pixels whose depth matches the reference."""
    missing: str = ""
    """Reason for a missing result, or empty."""
    seconds: list[float] = field(default_factory=list)
    """Time of all views in each round [s]."""

    @property
    def fps(self) -> float:
        """Frames per second of the median round."""
        return self.views / float(np.median(self.seconds)) if self.seconds else 0.0


def compare(preset: wv.scenes.ScenePreset, methods: Sequence[Method], views: int, rounds: int) -> list[Result]:
    """Measure methods on one scene."""
    scene = preset.build()
    work = Work(scene, preset.camera, preset.poses(views))
    truths = {culls: _reference(work, culls) for culls in (False, True)}
    results, calls = [], {}
    for method in methods:
        result = Result(method.title, preset.name)
        results.append(result)
        try:
            calls[method.title] = _start(method, work, truths[method.culls], result)
        except Exception as error:  # whatever a peer raises is shown in its cell of the table
            result.missing = _reason(error)
        _say(_progress(result))
    times = dict(zip(calls, take_turns(list(calls.values()), rounds), strict=True))
    for result in results:
        result.seconds = times.get(result.method, [])
    return results


def _reference(work: Work, cull_backfaces: bool) -> NDArray:
    still = Work(work.still, work.camera, work.poses)
    run, to_depth = warpvis(still, caster="rays", cull_backfaces=cull_backfaces)
    return to_depth(run())


def _start(method: Method, work: Work, truth: NDArray, result: Result) -> Callable[[], Any]:
    """Return a method's call that renders all views, after comparing its result with the reference."""
    part = work.first(method.max_views)
    run, to_depth = method.prepare(part)
    depth = to_depth(run())
    result.views = len(part.poses)
    result.agreement = agreement(depth, truth[: result.views], part.camera)
    return run


def agreement(depth: NDArray, truth: NDArray, camera: wv.Camera) -> float:
    """Return the fraction of pixels within `TOLERANCE`; pixels out of range must be marked in the same way."""
    depth = np.where(depth < camera.near, -np.inf, np.where(depth > camera.far, np.inf, depth))
    with np.errstate(invalid="ignore"):  # inf - inf
        return float(np.mean((depth == truth) | (np.abs(depth - truth) <= TOLERANCE)))


def markdown(results: list[Result], methods: Sequence[Method], rounds: int) -> str:
    """Return the table, with the machine above and notes below."""
    scenes = list(dict.fromkeys(result.scene for result in results))
    cells = {(result.method, result.scene): result for result in results}
    packages = dict.fromkeys(package for method in methods for package in method.packages)
    lines = [describe(packages) + time.strftime("; %Y-%m-%d."), "", row(["Frames per second", *scenes, "Same depth"])]
    lines.append(row(["---", *["---:"] * (len(scenes) + 1)]))
    for method in methods:
        found = [cells[method.title, scene] for scene in scenes]
        ran = [result.agreement for result in found if not result.missing]
        missing = "; ".join(dict.fromkeys(result.missing for result in found if result.missing))
        title = f"{method.title} (missing: {missing})" if missing else method.title
        columns = [_cell(result, cells[BASELINE, result.scene]) for result in found]
        lines.append(row([title, *columns, _percent(min(ran)) if ran else "-"]))
    return "\n".join([*lines, "", _caption(scenes, methods, cells, rounds)])


def _caption(scenes: list[str], methods: Sequence[Method], cells: dict[tuple[str, str], Result], rounds: int) -> str:
    camera = wv.scenes.PRESETS[scenes[0]].camera
    views = ", ".join(f"{scene} {cells[BASELINE, scene].views}" for scene in scenes)
    slow = [method for method in methods if method.max_views < sys.maxsize]
    few = ", ".join(f"{method.title.partition(',')[0]} at most {method.max_views}" for method in slow)
    return (
        f"Depth images of {camera.width}x{camera.height} pixels, on all cores unless a row names one thread. "
        f"Views: {views}{f'; of these, {few}' if few else ''}. The median of {rounds} rounds, in which the methods "
        "take turns; in brackets, compared with the first row. Same depth: share of pixels within 1 mm of the `rays` "
        "caster (which culls back faces where the row does), in the worst scene."
    )


def _cell(result: Result, baseline: Result) -> str:
    if result.missing:
        return "-"
    if result is baseline or not baseline.fps:
        return number(result.fps)
    return f"{number(result.fps)} ({compared(baseline.fps / result.fps)})"


def _percent(share: float) -> str:
    """Return a percentage, rounded down: 100 % means all pixels."""
    return f"{np.floor(share * 1e5) / 1e3:g} %"


def _reason(error: Exception) -> str:
    """Return the error's first clause."""
    if isinstance(error, ModuleNotFoundError):
        return f"{str(error.name).partition('.')[0]} is not installed"
    line = (str(error).strip() or type(error).__name__).splitlines()[0]
    text = line.partition(". ")[0].rstrip(".").replace("|", "/")
    return text if len(text) <= 90 else text[:87] + "..."


def _progress(result: Result) -> str:
    state = f"missing: {result.missing}" if result.missing else f"{_percent(result.agreement)} of pixels agree"
    return f"{result.scene}: {result.method}: {state}"


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def write_json(path: Path, results: list[Result], more: list[Figure]) -> None:
    """Write all results with the time of every round, and those of the second table."""
    packages = dict.fromkeys(package for method in METHODS for package in method.packages)
    rows = [{**asdict(result), "fps": result.fps} for result in results]
    content = {"machine": describe(packages), "results": rows, "more": [asdict(figure) for figure in more]}
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    def count(text: str) -> int:
        if int(text) < 1:
            raise argparse.ArgumentTypeError(f"must be 1 or more, got {text}")
        return int(text)

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [preset.name for preset in wv.scenes.BENCHMARK_SCENES]
    parser.add_argument(
        "--scenes", nargs="+", choices=wv.scenes.PRESETS, default=names, metavar="SCENE", help="presets' names"
    )
    parser.add_argument("--methods", nargs="+", metavar="TEXT", help="rows that have one of these in their names; all")
    parser.add_argument("--views", type=count, default=64, help="views a round")
    parser.add_argument("--rounds", type=count, default=9)
    parser.add_argument("--skip-more", action="store_true", help="leave out the second table")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all times there")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="put the tables there, between its marks")
    parser.add_argument("--mark", default=MARK, help="whose tables they are in that file")
    return parser.parse_args(arguments)


def _is_wanted(method: Method, texts: Sequence[str] | None) -> bool:
    """Return whether a row is requested; the reference always is."""
    return texts is None or method.title == BASELINE or any(text in method.title for text in texts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison, and print the tables."""
    options = _parse(arguments)
    if options.markdown:
        try:
            split_marked(options.markdown, options.mark)
        except (OSError, ValueError) as error:
            _say(f"compare.py: {error}")
            return 2
    wp.config.log_level = wp.LOG_WARNING
    other_work = OtherWork()
    methods = [method for method in METHODS if _is_wanted(method, options.methods)]
    results = []
    for name in options.scenes:
        results += compare(wv.scenes.PRESETS[name], methods, options.views, options.rounds)
    more = [] if options.skip_more else measure_more(options.scenes, options.rounds)
    tables = "\n\n".join([markdown(results, methods, options.rounds), *([more_markdown(more)] if more else [])])
    print(tables, flush=True)
    if other_work.warning():
        _say(other_work.warning())
    if options.json:
        write_json(options.json, results, more)
    if options.markdown:
        write_marked(options.markdown, options.mark, tables)
    return 0


if __name__ == "__main__":
    sys.exit(main())
