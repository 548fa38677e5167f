# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Share scenes, numbers of threads and the measurement of a call among the benchmarks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import pytest

import warpvis as wv
from warpvis.core.threads import core_count

ROUNDS = 7

# Number of views and of calls in a round of casting: about 0.1 to 0.2 s on one core of 2026. The numbers are fixed and
# do not depend on measurements, so that rounds of different runs are the same work. Packets render the same few views
# repeatedly, because more views at once would measure memory.
_CALLS = {
    "rays": {"room": (1, 20), "blobs_77k": (1, 4), "blobs_1m": (1, 3)},
    "packets": {"room": (40, 32), "blobs_77k": (10, 32), "blobs_1m": (3, 32)},
}
_EXPERIMENT_CALLS = {"rays": (1, 10), "packets": (60, 32)}


@cache
def _build(name: str) -> wv.Scene:
    return wv.scenes.PRESETS[name].build()


@pytest.fixture
def scene_of() -> Callable[[str], wv.Scene]:
    """Return a function that makes the scene of a preset, once per session."""
    return _build


@pytest.fixture(params=["packets", "rays"])
def caster(request: pytest.FixtureRequest) -> str:
    """Return each caster of the CPU."""
    return request.param


@pytest.fixture(params=["one_thread", "all_cores"])
def threads(request: pytest.FixtureRequest) -> int:
    """Return numbers of CPU threads: one, and the number of cores."""
    return 1 if request.param == "one_thread" else core_count()


@pytest.fixture
def measure(benchmark: Any) -> Callable[..., None]:
    """Return a function that measures a call and records frames per second."""

    def run(call: Callable[[], Any], views: int, calls: int = 1) -> None:
        benchmark.pedantic(call, rounds=ROUNDS, iterations=calls, warmup_rounds=1)
        benchmark.extra_info["views"] = views
        if benchmark.stats:  # there are none with --benchmark-disable
            benchmark.extra_info["fps"] = views / benchmark.stats.stats.median

    return run


@pytest.fixture
def measure_casting(measure: Any, scene_of: Any, caster: str, threads: int) -> Callable[..., None]:
    """Return a function that measures a caster on a preset."""

    def run(name: str, outputs: Sequence[Any]) -> None:
        preset = wv.scenes.PRESETS[name]
        calls, views_per_thread = _CALLS[caster].get(name, _EXPERIMENT_CALLS[caster])
        poses = preset.poses(views_per_thread * threads)
        renderer = wv.Renderer(scene_of(name), preset.camera, outputs=outputs, caster=caster, threads=threads)
        views = renderer.render(poses)
        measure(lambda: renderer.render(poses, out=views), len(poses), calls)

    return run
