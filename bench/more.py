# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure other workloads than batches: single views, two threads, building a BVH, and narrower lanes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import warp as wp
from peers import Work, open3d, warpvis
from targets import NATIVE, compare_targets
from timing import take_turns

import warpvis as wv
from warpvis.core.threads import core_count

_BATCH = 64
_BUILDS = 5

# Single views of several poses are measured with one call each, because their cost differs.
_SINGLE_VIEWS = 8

# Workloads measured on some scenes only: on others they take long and tell little more.
_WITH_OPEN3D, _BUILT, _COMPILED = "room", "blobs_1m", ("room", "blobs_77k")

# Sides of small images [px], as environments have them.
_SIDES = (8, 32, 64, 84)
# Number of calls of each that are timed together.
_SMALL_CALLS = 25

# Rows of the table.
_ONE = "One view of 640x480, `packets`, depth"
_ONE_ALONE = f"{_ONE}, 1 thread"
_ONE_OPEN3D = "One view of 640x480, Open3D"
_SMALL = "One view of {0}x{0}, `packets`, depth, into new memory"
_SMALL_OPEN3D = "One view of {0}x{0}, Open3D"
_BATCH_OF_TWO = f"{_BATCH} views on 2 threads, times as fast as on 1"
_ONE_OF_TWO = "One view of 640x480 on 2 threads, times as fast as on 1"
_CLUSTERS = "Building `Scene.bvh()`"
_MESH = 'Building `wp.Mesh`, `bvh_constructor="sah"`'
_MEMORY = "Memory of the BVH, bytes per triangle"
_NARROW = "`packets` compiled for {}, of native speed"


@dataclass(frozen=True)
class Figure:
    """One cell of the table."""

    title: str
    scene: str
    value: float | None
    shown: str
    """Return the cell's text, or the reason for a missing value."""


def measure_more(scenes: Sequence[str], rounds: int) -> list[Figure]:
    """Measure all workloads of these scenes that run on this machine."""
    figures = []
    for name in scenes:
        figures += _attempt(_ONE, name, lambda name=name: _single_view(wv.scenes.PRESETS[name], rounds))
    if _WITH_OPEN3D in scenes:
        for side in _SIDES:
            small = partial(_small_view, wv.scenes.PRESETS[_WITH_OPEN3D], side, rounds)
            figures += _attempt(_SMALL.format(side), _WITH_OPEN3D, small)
    for name in scenes:
        figures += _attempt(_BATCH_OF_TWO, name, lambda name=name: _two_threads(wv.scenes.PRESETS[name], rounds))
    if _BUILT in scenes:
        figures += _attempt(_CLUSTERS, _BUILT, lambda: _building(wv.scenes.PRESETS[_BUILT]))
    compiled = [name for name in _COMPILED if name in scenes]
    if compiled:
        figures += _attempt(_NARROW.format("less"), compiled[0], lambda: _narrow(compiled))
    return figures


def _attempt(title: str, scene: str, measure: Callable[[], Iterator[Figure]]) -> list[Figure]:
    try:
        return list(measure())
    except Exception as error:  # any failure is shown in its cell of the table
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        return [Figure(title, scene, None, f"missing: {reason}".replace("|", "/"))]


def _single_view(preset: wv.scenes.ScenePreset, rounds: int) -> Iterator[Figure]:
    """Return the time of a single view [ms]."""
    camera = wv.Camera.from_fov(640, 480, hfov=preset.camera.hfov, near=preset.camera.near, far=preset.camera.far)
    scene = preset.build()
    works = [Work(scene, camera, pose[None]) for pose in preset.poses(_SINGLE_VIEWS)]
    kinds: dict[str, Callable[[Work], Any]] = {
        _ONE: warpvis,
        _ONE_ALONE: lambda work: warpvis(work, threads=1),
        _ONE_OPEN3D: open3d,
        _ONE_OF_TWO: lambda work: warpvis(work, threads=2),
    }
    if core_count() < 2:
        del kinds[_ONE_OF_TWO]
    if preset.name != _WITH_OPEN3D:
        del kinds[_ONE_OPEN3D]
    runs = [_one_by_one([prepare(work)[0] for work in works]) for prepare in kinds.values()]
    seconds = dict(zip(kinds, _medians(runs, rounds), strict=True))
    for title, value in seconds.items():
        if title == _ONE_OF_TWO:
            yield _times(title, preset.name, seconds[_ONE_ALONE] / value)
        else:
            milliseconds = value / len(works) * 1e3
            yield Figure(title, preset.name, milliseconds, f"{milliseconds:.3g} ms{_comparison(value, seconds[_ONE])}")


def _small_view(preset: wv.scenes.ScenePreset, side: int, rounds: int) -> Iterator[Figure]:
    """Return the time of a view into new memory [us]; Open3D's rays are made in advance."""
    camera = wv.Camera.from_fov(side, side, hfov=preset.camera.hfov, near=preset.camera.near, far=preset.camera.far)
    scene = preset.build()
    renderer = wv.Renderer(scene, camera, outputs=("depth",))
    poses = [pose[None] for pose in preset.poses(_SINGLE_VIEWS)]
    ours = _one_by_one([partial(renderer.render, pose) for pose in poses] * _SMALL_CALLS)
    theirs = _one_by_one([open3d(Work(scene, camera, pose))[0] for pose in poses] * _SMALL_CALLS)
    ours_median, theirs_median = (seconds / (len(poses) * _SMALL_CALLS) for seconds in _medians([ours, theirs], rounds))
    yield Figure(_SMALL.format(side), preset.name, ours_median, f"{ours_median * 1e6:.0f} us")
    yield Figure(
        _SMALL_OPEN3D.format(side),
        preset.name,
        theirs_median,
        f"{theirs_median * 1e6:.0f} us{_comparison(theirs_median, ours_median)}",
    )


def _one_by_one(runs: list[Callable[[], Any]]) -> Callable[[], None]:
    def run_all() -> None:
        for run in runs:
            run()

    return run_all


def _two_threads(preset: wv.scenes.ScenePreset, rounds: int) -> Iterator[Figure]:
    """Return the speedup of two threads."""
    if core_count() < 2:
        raise RuntimeError("there is only 1 core")
    work = Work(preset.build(), preset.camera, preset.poses(_BATCH))
    one, two = _medians([warpvis(work, threads=threads)[0] for threads in (1, 2)], rounds)
    yield _times(_BATCH_OF_TWO, preset.name, one / two)


def _building(preset: wv.scenes.ScenePreset) -> Iterator[Figure]:
    """Return the time to build the BVH and Warp's BVH of the same triangles [s]."""
    scene = preset.build()
    first = np.cumsum([0] + [len(item.vertices) for item in scene])
    vertices = np.concatenate([item.vertices for item in scene])
    faces = np.concatenate([item.faces + start for item, start in zip(scene, first, strict=False)])

    def mesh() -> wp.Mesh:
        points = wp.array(vertices, dtype=wp.vec3, device="cpu")
        return wp.Mesh(points, wp.array(faces.ravel(), dtype=wp.int32, device="cpu"), bvh_constructor="sah")

    mesh()  # warm, as the other builder is
    clusters, other = _medians([lambda: scene.to(scene.device).bvh(), mesh], _BUILDS)
    yield Figure(_CLUSTERS, preset.name, clusters, f"{clusters:.2f} s")
    yield Figure(_MESH, preset.name, other, f"{other:.2f} s{_comparison(other, clusters)}")
    memory = scene.bvh().bytes_per_triangle
    yield Figure(_MEMORY, preset.name, memory, f"{memory:.0f}")


def _narrow(names: Sequence[str]) -> Iterator[Figure]:
    """Return the speed of code compiled for fewer instructions, relative to native speed."""
    found = compare_targets(names)
    for target in found:
        for name in names if target != NATIVE else ():
            share = found[target][name] / found[NATIVE][name]
            yield Figure(_NARROW.format(target), name, share, f"{share * 100:.0f} %")


def _medians(calls: Sequence[Callable[[], Any]], rounds: int) -> list[float]:
    for call in calls:
        call()
    return [float(np.median(times)) for times in take_turns(calls, rounds)]


def _times(title: str, scene: str, ratio: float) -> Figure:
    return Figure(title, scene, ratio, f"{ratio:.2f}x")


def _comparison(seconds: float, baseline: float) -> str:
    return "" if seconds == baseline else f" ({compared(seconds / baseline)})"


def compared(ratio: float) -> str:
    """Describe a ratio of times."""
    slower = ratio >= 1
    return f"{number(ratio if slower else 1 / ratio)}x {'slower' if slower else 'faster'}"


def number(value: float) -> str:
    """Format two significant digits, or all before the point."""
    return f"{value:,.0f}" if value >= 10 else f"{value:.1f}" if value >= 0.995 else f"{value:.2g}"


def row(cells: Sequence[str]) -> str:
    """Return one row of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def more_markdown(figures: Sequence[Figure]) -> str:
    """Return the table, with notes below."""
    scenes = list(dict.fromkeys(figure.scene for figure in figures))
    cells = {(figure.title, figure.scene): figure.shown for figure in figures}
    lines = [row(["`packets`: single views, threads, building", *scenes]), row(["---", *["---:"] * len(scenes)])]
    for title in dict.fromkeys(figure.title for figure in figures):
        lines.append(row([title, *(cells.get((title, scene), "") for scene in scenes)]))
    return "\n".join([*lines, "", _CAPTION])


_CAPTION = (
    "On all cores unless a row names the number of threads; `wp.Mesh` builds on one. One view: one call for each, the "
    f"mean of {_SINGLE_VIEWS}; Open3D's rays are computed before. Compiled for AVX2 and AVX: with Warp's "
    "`cpu_compiler_flags` set to `-target-cpu haswell` and to nothing, which is the minimum for Warp on x86-64; each "
    "in separate processes, in turns."
)
