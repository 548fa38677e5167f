# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What the benchmarks share: scenes, numbers of threads, and how a call is measured."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import pytest

import warpvis as wv
from warpvis.threads import core_count

ROUNDS = 7

# Views that a thread gets in a round of casting: some 0.2 s for the `rays` caster on one core of 2026. The numbers are
# fixed, and do not depend on what was measured, so that rounds of different runs are the same work.
_VIEWS_PER_THREAD = {"room": 20, "blobs_77k": 4, "blobs_1m": 3}
_EXPERIMENT_VIEWS_PER_THREAD = 10


@cache
def _build(name: str) -> wv.Scene:
    return wv.scenes.PRESETS[name].build()


@pytest.fixture
def scene_of() -> Callable[[str], wv.Scene]:
    """Makes a preset's scene of its name, once a session."""
    return _build


@pytest.fixture
def views_per_thread() -> Callable[[str], int]:
    """How many views of a preset make a round of casting with one thread."""
    return lambda name: _VIEWS_PER_THREAD.get(name, _EXPERIMENT_VIEWS_PER_THREAD)


@pytest.fixture(params=["one_thread", "all_cores"])
def threads(request: pytest.FixtureRequest) -> int:
    """CPU threads: one, and as many as there are cores."""
    return 1 if request.param == "one_thread" else core_count()


@pytest.fixture
def measure(benchmark: Any) -> Callable[[Callable[[], Any], int], None]:
    """Measures a call that does some number of views, and notes frames per second."""

    def run(call: Callable[[], Any], views: int) -> None:
        benchmark.pedantic(call, rounds=ROUNDS, iterations=1, warmup_rounds=1)
        benchmark.extra_info["views"] = views
        if benchmark.stats:  # there are none with --benchmark-disable
            benchmark.extra_info["fps"] = views / benchmark.stats.stats.median

    return run
