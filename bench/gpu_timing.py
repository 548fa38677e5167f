# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Time work on a GPU, by device events and by wall time on the host.

Events enclose several successive calls after one that is not timed. The device then never idles, and the host's launch
overhead does not show unless it exceeds the work itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

import warp as wp

Run = Callable[[], Any]

# Minimum duration between the two events [s].
_MIN_SECONDS = 0.015
_MAX_CALLS = 64


class Timer(Protocol):
    """Interface to time one library's work."""

    def device_seconds(self, run: Run, calls: int) -> float:
        """Return the device time of one of several successive calls [s]."""

    def synchronize(self) -> None:
        """Wait for all work."""

    def record(self, run: Run) -> Run | None:
        """Return a function that replays the call as a CUDA graph, or None if the library has no graphs."""


class HostTimer:
    """Work on the CPU that is complete when the call returns."""

    def device_seconds(self, run: Run, calls: int) -> float:
        """Return the wall time per call [s]."""
        start = time.perf_counter()
        for _ in range(calls):
            run()
        return (time.perf_counter() - start) / calls

    def synchronize(self) -> None:
        """Do nothing: the work is complete."""

    def record(self, run: Run) -> Run | None:
        """Return None: the CPU has no graphs."""
        return None


class CoreTimer(HostTimer):
    """Work of a process bound to one core, measured by CPU time."""

    def device_seconds(self, run: Run, calls: int) -> float:
        """Return the CPU time per call [s]."""
        start = time.process_time()
        for _ in range(calls):
            run()
        return (time.process_time() - start) / calls


class WarpTimer:
    """Work on the current stream of a Warp device."""

    def __init__(self, device: wp.Device) -> None:
        """Create the events."""
        self._device = device

    def device_seconds(self, run: Run, calls: int) -> float:
        """Return the time per call between events [s]."""
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
        """Return a function that replays the call as a CUDA graph."""
        with wp.ScopedDevice(self._device):
            with wp.ScopedCapture(self._device, force_module_load=False) as capture:
                run()
            return lambda: wp.capture_launch(capture.graph)


class TorchTimer:
    """Work on PyTorch's current stream."""

    def device_seconds(self, run: Run, calls: int) -> float:
        """Return the time per call between events [s]."""
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
        """Return None: nvdiffrast reads counters on the host in every call, which a graph cannot capture."""
        return None


class DrJitTimer:
    """Work of Dr.Jit, which has private streams and records the time of every kernel."""

    def device_seconds(self, run: Run, calls: int) -> float:
        """Return the time per call in kernels [s], without the gaps between them."""
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
        """Return None: Dr.Jit has no graphs."""
        return None


def wall_seconds(timer: Timer, run: Run) -> float:
    """Return the latency of a call, until its work is complete [s]."""
    timer.synchronize()
    start = time.perf_counter()
    run()
    timer.synchronize()
    return time.perf_counter() - start


class LatencyTimer:
    """Calls that are waited for individually, measured by wall time."""

    def __init__(self, timer: Timer) -> None:
        """Store the timer that waits."""
        self._timer = timer
        self.synchronize, self.record = timer.synchronize, timer.record

    def device_seconds(self, run: Run, calls: int) -> float:
        """Return the mean latency of a call [s]."""
        return sum(wall_seconds(self._timer, run) for _ in range(calls)) / calls


def enough_calls(seconds: float) -> int:
    """Return the number of calls of this duration that make a measurable round."""
    return max(1, min(_MAX_CALLS, round(_MIN_SECONDS / max(seconds, 1e-6))))
