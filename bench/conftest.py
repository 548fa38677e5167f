# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What the benchmarks share: scenes, numbers of threads, and how a call is measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import pytest

import warpvis as wv
from warpvis.core.threads import core_count

ROUNDS = 7

# How often a thread is given how many views in a round of casting: some 0.1 to 0.2 s on one core of 2026. The numbers
# are fixed, and do not depend on what was measured, so that rounds of different runs are the same work. Packets render
# the same few views again and again: as many views at once would be more memory than work.
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
    """Makes a preset's scene of its name, once a session."""
    return _build


@pytest.fixture(params=["packets", "rays"])
def caster(request: pytest.FixtureRequest) -> str:
    """The casters that CPU cores have."""
    return request.param


@pytest.fixture(params=["one_thread", "all_cores"])
def threads(request: pytest.FixtureRequest) -> int:
    """CPU threads: one, and as many as there are cores."""
    return 1 if request.param == "one_thread" else core_count()


@pytest.fixture
def measure(benchmark: Any) -> Callable[..., None]:
    """Measures a call that does some number of views, and notes frames per second."""

    def run(call: Callable[[], Any], views: int, calls: int = 1) -> None:
        benchmark.pedantic(call, rounds=ROUNDS, iterations=calls, warmup_rounds=1)
        benchmark.extra_info["views"] = views
        if benchmark.stats:  # there are none with --benchmark-disable
            benchmark.extra_info["fps"] = views / benchmark.stats.stats.median

    return run


@pytest.fixture
def measure_casting(measure: Any, scene_of: Any, caster: str, threads: int) -> Callable[..., None]:
    """Measures a caster on a preset."""

    def run(name: str, outputs: Sequence[Any]) -> None:
        preset = wv.scenes.PRESETS[name]
        calls, views_per_thread = _CALLS[caster].get(name, _EXPERIMENT_CALLS[caster])
        poses = preset.poses(views_per_thread * threads)
        renderer = wv.Renderer(scene_of(name), preset.camera, outputs=outputs, caster=caster, threads=threads)
        views = renderer.render(poses)
        measure(lambda: renderer.render(poses, out=views), len(poses), calls)

    return run
