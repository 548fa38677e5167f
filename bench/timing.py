# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Time calls in turns, so that other load on the machine affects all of them equally."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Sequence
from typing import Any

# Fast calls are repeated in a round until the time is measurable.
_MIN_SECONDS = 0.1

# Threads of a library may spin for a while after their work: a pause keeps them from disturbing the next one.
_PAUSE = 0.05


def take_turns(calls: Sequence[Callable[[], Any]], rounds: int) -> list[list[float]]:
    """Return the times of each call [s], one per round. Each call must have run once before."""
    repeats = [max(1, round(_MIN_SECONDS / _seconds(call, 1))) for call in calls]
    times: list[list[float]] = [[] for _ in calls]
    gc.collect()
    gc.disable()
    try:
        for number in range(rounds):
            for i in range(len(calls))[:: -1 if number % 2 else 1]:
                time.sleep(_PAUSE)
                times[i].append(_seconds(calls[i], repeats[i]))
    finally:
        gc.enable()
    return times


def _seconds(call: Callable[[], Any], repeats: int) -> float:
    start = time.perf_counter()
    for _ in range(repeats):
        call()
    return (time.perf_counter() - start) / repeats
