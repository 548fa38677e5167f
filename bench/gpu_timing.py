# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Timing work on a GPU: by the device's own events, and by the clock of who waits for it.

Events stand around several calls in a row, with one before them that is not timed: the device then has work all the
while, and what the host takes to queue a call does not show unless it takes longer than the work itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

import warp as wp

Run = Callable[[], Any]

# The time that events stand around, at least.
_MIN_SECONDS = 0.015
_MAX_CALLS = 64


class Timer(Protocol):
    """How one library's work is timed."""

    def device_seconds(self, run: Run, calls: int) -> float:
        """Seconds that the device takes for one of several calls in a row."""

    def synchronize(self) -> None:
        """Wait for all work."""

    def record(self, run: Run) -> Run | None:
        """What replays the call's work as a CUDA graph; None where there are none."""


class HostTimer:
    """Work on the CPU, which is done when the call returns."""

    def device_seconds(self, run: Run, calls: int) -> float:
        """Seconds a call by the clock."""
        start = time.perf_counter()
        for _ in range(calls):
            run()
        return (time.perf_counter() - start) / calls

    def synchronize(self) -> None:
        """There is nothing to wait for."""

    def record(self, run: Run) -> Run | None:
        """There are no graphs."""
        return None


class CoreTimer(HostTimer):
    """Work of a process that keeps to one core, by the time that it has that core."""

    def device_seconds(self, run: Run, calls: int) -> float:
        """Return the processor's seconds a call."""
        start = time.process_time()
        for _ in range(calls):
            run()
        return (time.process_time() - start) / calls


class WarpTimer:
    """Work on a Warp device's current stream."""

    def __init__(self, device: wp.Device) -> None:
        """Prepare to time."""
        self._device = device

    def device_seconds(self, run: Run, calls: int) -> float:
        """Seconds a call by events."""
        with wp.ScopedDevice(self._device):
            before, after = (wp.Event(self._device, enable_timing=True) for _ in range(2))
            run()
            wp.record_event(before)
            for _ in range(calls):
                run()
            wp.record_event(after)
            wp.synchronize_event(after)
        return wp.get_event_elapsed_time(before, after) / 1e3 / calls

    def synchronize(self) -> None:
        """Wait for the device."""
        wp.synchronize_device(self._device)

    def record(self, run: Run) -> Run | None:
        """The call's work as a graph."""
        with wp.ScopedDevice(self._device):
            with wp.ScopedCapture(self._device, force_module_load=False) as capture:
                run()
            return lambda: wp.capture_launch(capture.graph)


class TorchTimer:
    """Work on PyTorch's current stream."""

    def device_seconds(self, run: Run, calls: int) -> float:
        """Seconds a call by events."""
        import torch

        before, after = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        run()
        before.record()
        for _ in range(calls):
            run()
        after.record()
        after.synchronize()
        return before.elapsed_time(after) / 1e3 / calls

    def synchronize(self) -> None:
        """Wait for the device."""
        import torch

        torch.cuda.synchronize()

    def record(self, run: Run) -> Run | None:
        """Nothing: nvdiffrast reads back counters in every call, which a graph cannot hold."""
        return None


class DrJitTimer:
    """Work of Dr.Jit, whose streams are its own: it notes the time of every kernel."""

    def device_seconds(self, run: Run, calls: int) -> float:
        """Seconds a call spends in kernels; nothing of what Dr.Jit does between them."""
        import drjit as dr

        run()
        dr.sync_thread()
        dr.kernel_history_clear()
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            for _ in range(calls):
                run()
            dr.sync_thread()
            history = dr.kernel_history()
        return sum(entry["execution_time"] for entry in history) / 1e3 / calls

    def synchronize(self) -> None:
        """Wait for the device."""
        import drjit as dr

        dr.sync_thread()

    def record(self, run: Run) -> Run | None:
        """There are no graphs."""
        return None


def wall_seconds(timer: Timer, run: Run) -> float:
    """Seconds from a call to the end of its work, as who waits for it sees it."""
    timer.synchronize()
    start = time.perf_counter()
    run()
    timer.synchronize()
    return time.perf_counter() - start


class LatencyTimer:
    """Calls that are waited for one by one, by the clock."""

    def __init__(self, timer: Timer) -> None:
        """Wait as `timer` does."""
        self._timer = timer
        self.synchronize, self.record = timer.synchronize, timer.record

    def device_seconds(self, run: Run, calls: int) -> float:
        """Return the mean seconds from a call to the end of its work."""
        return sum(wall_seconds(self._timer, run) for _ in range(calls)) / calls


def enough_calls(seconds: float) -> int:
    """How many calls of that time make a round that can be measured."""
    return max(1, min(_MAX_CALLS, round(_MIN_SECONDS / max(seconds, 1e-6))))
