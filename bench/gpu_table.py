# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Format the tables and targets of gpu.py, and describe the machine."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from gpu_peers import BASELINE, EVERYTHING
from gpu_work import Result
from machine import describe
from more import compared, number, row

import warpvis as wv


@dataclass(frozen=True)
class Comparison:
    """The speed of a row of this library relative to the fastest row of other libraries."""

    title: str
    row_name: str
    groups: tuple[str, ...]
    """Names of the libraries; empty for all others."""

    def is_about(self, group: str) -> bool:
        """Return whether the row of that library is compared."""
        return group in self.groups if self.groups else group != "warpvis"


COMPARISONS = (
    Comparison("depth: Newton", BASELINE, ("newton",)),
    Comparison("depth: mujoco-warp", BASELINE, ("mujoco-warp",)),
    Comparison("depth: fastest other library", BASELINE, ()),
    Comparison("depth: `wp.mesh_query_ray`", BASELINE, ("bare",)),
    Comparison("depth, points, labels and objects: depth by `wp.mesh_query_ray`", EVERYTHING, ("bare",)),
)


def best(results: Iterable[Result]) -> Result | None:
    """Return the fastest method that rendered the right image."""
    return max((result for result in results if result.right), key=lambda result: result.fps, default=None)


def of_row(results: Iterable[Result], title: str) -> list[Result]:
    """Return the results of one row's methods."""
    return [result for result in results if result.method.row == title]


def tables(results: Sequence[Result], titles: dict[str, str], rounds: int, device: wp.Device) -> str:
    """Return all tables as Markdown, with the machine above."""
    cases = {name: [r for r in results if r.case == name] for name in titles if any(r.case == name for r in results)}
    packages = dict.fromkeys(package for result in results for package in result.method.packages)
    parts = [f"{machine(packages)}; {time.strftime('%Y-%m-%d')}."]
    parts.append(_figures(cases, titles))
    if device.is_cpu:
        return "\n\n".join([*parts, "On the CPU: these figures only show that all make the same picture."])
    parts.append(_caption(cases, titles, rounds))
    parts.append(_comparisons(cases, titles))
    parts.append(_calls(cases, titles))
    return "\n\n".join(parts)


def machine(packages: Iterable[str]) -> str:
    """Return one line with the GPU, its driver, the processor, and versions of packages."""
    line = describe(packages)
    if "warpvis " not in line:  # a checkout without an installation
        line += f", warpvis {wv.__version__}"
    return f"{_gpu()}; {line}"


def _gpu() -> str:
    devices = wp.get_cuda_devices()
    if not devices:
        return "no GPU"
    version = _driver_version()
    memory = devices[0].total_memory / 2**30
    return f"{devices[0].name}, {memory:.0f} GiB{f', driver {version}' if version else ''}"


def _driver_version() -> str:
    tool = shutil.which("nvidia-smi")
    if tool:
        command = [tool, "--query-gpu=driver_version", "--format=csv,noheader"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode == 0 and done.stdout.strip():
            return done.stdout.split()[0]
    note = Path("/proc/driver/nvidia/version")
    words = note.read_text().split() if note.is_file() else []
    return next((word for word in words if word.count(".") == 2 and word.replace(".", "").isdigit()), "")


def _figures(cases: dict[str, list[Result]], titles: dict[str, str]) -> str:
    """Return the table of frames per second, with the fastest variant of each row in every case."""
    lines = [row(["Frames per second", *(titles[name] for name in cases), "Same depth"])]
    lines.append(row(["---", *["---:"] * (len(cases) + 1)]))
    for title in dict.fromkeys(result.method.row for results in cases.values() for result in results):
        cells = [_cell(of_row(results, title), results) for results in cases.values()]
        everything = [result for results in cases.values() for result in of_row(results, title)]
        counted = [result for result in everything if result.right] or everything
        shares = [result.agreement.same for result in counted if result.agreement]
        missing = "; ".join(dict.fromkeys(result.missing for result in everything if result.missing))
        shown = f"{title} (missing: {missing})" if missing and not any(shares) else title
        lines.append(row([shown, *cells, _percent(min(shares)) if shares else "-"]))
    return "\n".join(lines)


def _cell(found: list[Result], of_case: list[Result]) -> str:
    fastest, baseline = best(found), best(of_row(of_case, BASELINE))
    if fastest is None:
        return "different image" if any(result.agreement for result in found) else "-"
    if baseline is None or fastest is baseline:
        return number(fastest.fps)
    return f"{number(fastest.fps)} ({compared(baseline.fps / fastest.fps)})"


def _caption(cases: dict[str, list[Result]], titles: dict[str, str], rounds: int) -> str:
    views = ", ".join(f"{titles[name]} {max(r.views for r in results):,}" for name, results in cases.items())
    return (
        "Depth images of the same views of one mesh, from poses on the GPU to images on the GPU. Views per call: "
        f"{views}; nvdiffrast takes as many as fit into its memory. Device time by events, for repeated calls or one "
        "CUDA graph replayed, whichever is faster; for OptiX, that of its kernels only. The median of at most "
        f"{rounds} rounds, in which the methods take turns; in brackets, compared with the first row. If a library can "
        "be used in several ways, the fastest in each case. Not timed: building trees, OptiX's rays, nvdiffrast's "
        "clip-space vertices and the depth of its z/w. Same depth: share of pixels within 1 mm of the `rays` caster "
        "(which culls back faces where the row does), in the worst case."
    )


def _comparisons(cases: dict[str, list[Result]], titles: dict[str, str]) -> str:
    """Return the table of speed relative to other libraries."""
    lines = [row(["Times as fast as", *(titles[name] for name in cases)])]
    lines.append(row(["---", *["---:"] * len(cases)]))
    for comparison in COMPARISONS:
        lines.append(row([comparison.title, *(_ratio(comparison, results) for results in cases.values())]))
    return "\n".join(lines)


def _ratio(comparison: Comparison, results: list[Result]) -> str:
    fastest = best(of_row(results, comparison.row_name))
    other = best(result for result in results if comparison.is_about(result.method.group))
    return "-" if fastest is None or other is None else f"{fastest.fps / other.fps:.1f}x"


def _calls(cases: dict[str, list[Result]], titles: dict[str, str]) -> str:
    """Return the latency of one call from Python, with the fastest variant of every row."""
    head = ["Milliseconds per call: latency (device time, as a CUDA graph)", *(titles[name] for name in cases)]
    lines = [row(head), row(["---", *["---:"] * len(cases)])]
    for title in dict.fromkeys(result.method.row for results in cases.values() for result in results):
        found = [best(of_row(results, title)) for results in cases.values()]
        if any(found):
            lines.append(row([title, *(_call(result) if result else "-" for result in found)]))
    return "\n".join(lines)


def _call(result: Result) -> str:
    wall, device, graph = (
        _milliseconds(float(np.median(times))) if times else "-"
        for times in (result.wall_seconds, result.device_seconds, result.graph_seconds)
    )
    way = ", ".join(filter(None, [result.method.variant, result.note]))
    return f"{wall} ({device}, {graph}){f' {way}' if way else ''}"


def _milliseconds(seconds: float) -> str:
    """Format a time to ten microseconds, or to one if it is short."""
    return f"{seconds * 1e3:.2f}" if seconds >= 1e-3 else f"{seconds * 1e3:.3f}"


def _percent(share: float) -> str:
    """Return a percentage, rounded down: 100 % means all pixels."""
    return f"{np.floor(share * 1e5) / 1e3:g} %"


def write_json(path: Path, results: Sequence[Result], state: str) -> None:
    """Write all results so far atomically."""
    packages = dict.fromkeys(package for result in results for package in result.method.packages)
    content = {"machine": machine(packages), "state": state, "results": [_as_dict(result) for result in results]}
    part = path.with_suffix(".part")
    part.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    os.replace(part, path)


def _as_dict(result: Result) -> dict[str, Any]:
    found = {key: value for key, value in vars(result).items() if key not in ("method", "agreement")}
    method = {key: getattr(result.method, key) for key in ("group", "row", "variant")}
    agreement = vars(result.agreement) if result.agreement else None
    return {**method, **found, "agreement": agreement, "fps": result.fps, "wall_fps": result.wall_fps}
