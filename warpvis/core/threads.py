# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Parallel CPU kernels: Warp runs a CPU kernel on the calling thread, so several threads launch it for parts."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from queue import SimpleQueue
from threading import Lock, Thread, get_ident
from typing import Any, TypeVar

import numpy as np
import warp as wp

from warpvis.core.checks import check_whole
from warpvis.core.kernel_cache import launch, load_module
from warpvis.core.types import KernelArguments
from warpvis.errors import ArrayError
from warpvis.kernels.constants import COUNTER_FINISHED
from warpvis.kernels.pinhole import Window

# Average number of pieces per thread: enough to balance views of different cost, and few enough that the 0.1 ms of
# Python per launch is negligible.
_PIECES_PER_THREAD = 4
_MIN_PIXELS = 4096

# All rays of a block wait for its slowest one: with one query per thread, blocks of 64 threads are 7 % faster than
# blocks of 256 (H200, three scenes).
_CUDA_BLOCK = 64

WHOLE_ROW = 2**30
"""A span longer than any row: each kernel thread processes a whole row."""

MAX_THREADS = 4096
"""Maximum number of CPU threads; more are probably a mistake, because each needs memory."""

_pool: SimpleQueue[_Task] = SimpleQueue()
_pool_size = 0
_pool_lock = Lock()

_Part = TypeVar("_Part")


def core_count() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def launch_images(
    kernel: wp.Kernel,
    shape: tuple[int, int, int],
    arguments: Callable[[Window], KernelArguments],
    *,
    device: wp.Device,
    threads: int | None = None,
    split_views: bool = True,
    span: int = 1,
    min_pixels: int = _MIN_PIXELS,
) -> None:
    """Launch a kernel over all pixels: at once on CUDA, in pieces on the threads of the pool on the CPU.

    Args:
        kernel: A kernel with the thread index ``view, y, x`` that adds a `Window` to it.
        shape: ``(views, height, width)``.
        arguments: Function that returns the arguments of the kernel for a window.
        device: Device to launch on.
        threads: CPU threads, all cores by default.
        split_views: Whether several threads may share one view.
        span: Number of pixels of a row per kernel thread; the index x counts spans.
        min_pixels: Minimum number of pixels per piece.
    """
    views, height, width = shape
    spans = -(-width // span)
    threads = check_threads(threads)
    if 0 in shape:
        return
    if not device.is_cpu:
        inputs = arguments(_window(0, 0))
        launch(kernel, (views, height, spans), inputs, device, block_dim=_CUDA_BLOCK)
        return

    load_module(kernel)
    packed: dict[int, _PackedPieces] = {}

    def launch_piece(piece: tuple[int, int, int, int]) -> None:
        view, view_count, row, row_count = piece
        dim, window = (view_count, row_count, spans), _window(view, row)
        pieces = packed.get(get_ident())
        if pieces is None:
            pieces = packed[get_ident()] = _PackedPieces(kernel, dim, arguments(window), window)
        else:
            pieces.set(dim, window)
        pieces.launch.launch()

    run_each(launch_piece, _split(shape, threads, split_views, min_pixels), threads)


class _PackedPieces:
    """A recorded launch that a thread reuses for several pieces; packing all arguments again may take longer."""

    def __init__(self, kernel: wp.Kernel, dim: tuple[int, int, int], inputs: KernelArguments, window: Window) -> None:
        """Pack the launch of the first piece."""
        self.launch = wp.launch(kernel, dim=dim, inputs=inputs, device="cpu", record_cmd=True)
        self._window_index = next(index for index, value in enumerate(inputs) if value is window)

    def set(self, dim: tuple[int, int, int], window: Window) -> None:
        """Change the launch to another piece."""
        self.launch.set_dim(dim)
        self.launch.set_param_at_index(self._window_index, window)


def launch_points(
    kernel: wp.Kernel,
    shape: tuple[int, int],
    arguments: Callable[[Window], KernelArguments],
    *,
    device: wp.Device,
    threads: int | None = None,
) -> None:
    """Launch a kernel over all points of all views, ``(views, points)``, in rows that are distributed to CPU threads.

    The thread index of the kernel is ``view, row, column``; `kernels.visibility.points.locate_point` converts it.
    """
    from warpvis.kernels.visibility.points import POINTS_PER_ROW

    views, points = shape
    rows = -(-points // POINTS_PER_ROW)
    launch_images(kernel, (views, rows, POINTS_PER_ROW), arguments, device=device, threads=threads)


def pack_launch(kernel: wp.Kernel, inputs: list[object]) -> wp.Launch:
    """Record a launch of one CPU thread for repeated use, because packing may take longer than the launch.

    Structs are packed by reference: each launch reads their current contents.
    """
    load_module(kernel)
    return wp.launch(kernel, dim=1, inputs=inputs, device="cpu", record_cmd=True)


def launch_shared(recorded: wp.Launch, counter: np.ndarray, workers: int) -> None:
    """Run a recorded launch on several threads, which share its work by a counter of ``native/cpu/workers.h``."""
    counter.fill(0)
    if workers == 1:
        recorded.launch()
    else:
        run_together(recorded.launch, workers, lambda: bool(counter[COUNTER_FINISHED] == workers))


def write_fields(struct: Any, **values: Any) -> None:
    """Write structs, arrays and numbers to fields of a struct, for launches while the caller keeps them alive.

    None is written as an array without memory.
    Assignment of a struct to a field takes Warp 10 to 70 us, longer than some launches; this takes less than 1 us.
    """
    memory = struct.__ctype__()
    for name, value in values.items():
        if value is None:
            getattr(memory, name).data = 0
        else:
            setattr(memory, name, value if isinstance(value, int) else value.__ctype__())


def array_of_one(struct: Any, dtype: Any) -> wp.array:
    """Return a view of a struct as an array: a launch reads the struct's current contents. Does not keep it alive."""
    return wp.array(ptr=ctypes.addressof(struct.__ctype__()), dtype=dtype, shape=(1,), device="cpu")


class _PartTaker:
    """Distributes parts to the threads that call it; after a failure, no more parts are started."""

    def __init__(self, work: Callable[[_Part], object], parts: Sequence[_Part]) -> None:
        self.failures: list[BaseException] = []
        self._work, self._remaining = work, iter(parts)

    def __call__(self) -> None:
        for part in self._remaining:
            if self.failures:
                return
            try:
                self._work(part)
            except BaseException as error:
                self.failures.append(error)
                raise


def run_each(work: Callable[[_Part], object], parts: Sequence[_Part], threads: int) -> None:
    """Call `work` for each part on at most `threads` threads: this one and threads of the pool."""
    run_together(_PartTaker(work, parts), min(threads, len(parts)), lambda: False)


def run_together(work: Callable[[], None], workers: int, all_finished: Callable[[], bool]) -> None:
    """Call `work` concurrently: once on this thread, and on threads of the pool.

    Args:
        work: Function that takes parts of the work until none are left; late calls return at once.
        workers: Number of calls.
        all_finished: Returns whether all calls are known to have finished. Then their threads are not waited for, which
            may take longer than a small frame.
    """
    if workers < 1:
        return
    pending = _submit(work, workers - 1)
    try:
        work()
        if all_finished():
            return
    except BaseException:
        for other in _started(pending):
            other.wait()  # it writes to memory that the caller reuses after the error
        raise
    for other in _started(pending):
        other.wait()
        if other.error is not None:
            raise other.error


class _Task:
    """A task for a thread of the pool, which can be canceled until it starts.

    Creating and waiting for a `Future` would take longer than a small image.
    """

    __slots__ = ("_done", "_started", "_work", "error")

    def __init__(self, work: Callable[[], None]) -> None:
        self.error: BaseException | None = None
        self._work = work
        self._started, self._done = Lock(), Lock()
        self._done.acquire()

    def run(self) -> None:
        """Run the task unless it was canceled."""
        if not self._started.acquire(blocking=False):
            return
        try:
            self._work()
        except BaseException as error:
            self.error = error
        finally:
            self._done.release()

    def cancel(self) -> bool:
        """Cancel the task; return False if it has started."""
        return self._started.acquire(blocking=False)

    def wait(self) -> None:
        """Wait until the task is finished; may be called once."""
        self._done.acquire()


def _started(tasks: list[_Task]) -> list[_Task]:
    """Cancel tasks, and return those that have already started."""
    return [task for task in tasks if not task.cancel()]


class Crew:
    """A fixed number of threads, separate from the pool, that limits concurrency for any number of callers.

    Parts of calls are processed in the order of the calls. It is a context manager that ends its threads on exit.
    """

    def __init__(self, threads: int, name: str) -> None:
        """Create a crew of `threads` threads, which start on demand; `name` is their name in debuggers."""
        self.threads = threads
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix=name)

    def __enter__(self) -> Crew:
        """Return this crew."""
        return self

    def __exit__(self, *error: object) -> None:
        """Finish pending work, and end the threads."""
        self._pool.shutdown()

    def each(self, work: Callable[[_Part], object], parts: Sequence[_Part]) -> None:
        """Call `work` for each part, and wait; an error is raised after all running parts have finished."""
        run_parts = _PartTaker(work, parts)
        wait([self._pool.submit(run_parts) for _ in range(min(self.threads, len(parts)))])
        if run_parts.failures:
            raise run_parts.failures[0]


def check_threads(threads: int | None) -> int:
    """Check a number of threads, and return it; None stands for all cores."""
    if threads is None:
        return core_count()
    if check_whole(threads, "threads") > MAX_THREADS:
        raise ArrayError(f"threads must be at most {MAX_THREADS}, got {threads}")
    return int(threads)


def _split(
    shape: tuple[int, int, int], threads: int, split_views: bool, min_pixels: int = _MIN_PIXELS
) -> list[tuple[int, int, int, int]]:
    """Return pieces ``(view, view_count, row, row_count)`` of about equal size that cover all rows of all views."""
    views, height, width = shape
    if threads == 1:
        return [(0, views, 0, height)]
    pixels = max(views * height * width // (threads * _PIECES_PER_THREAD), min_pixels)
    if not split_views or pixels >= height * width:
        step = max(1, pixels // (height * width))
        return [(view, min(step, views - view), 0, height) for view in range(0, views, step)]
    rows = max(1, pixels // width)
    return [(view, 1, row, min(rows, height - row)) for view in range(views) for row in range(0, height, rows)]


def _window(view: int, row: int) -> Window:
    window = Window()
    window.first_view, window.first_row = view, row
    return window


def _submit(work: Callable[[], None], count: int) -> list[_Task]:
    """Submit `work` to `count` threads of the pool, which grows to the maximum count requested so far."""
    global _pool_size
    tasks = [_Task(work) for _ in range(count)]
    if _pool_size < count:
        with _pool_lock:
            while _pool_size < count:
                Thread(target=_work_for_pool, args=(_pool,), name=f"warpvis_{_pool_size}", daemon=True).start()
                _pool_size += 1
    for task in tasks:
        _pool.put(task)
    return tasks


def _work_for_pool(pool: SimpleQueue[_Task]) -> None:
    """Run tasks forever. The threads are daemons: they do not block interpreter exit."""
    while True:
        pool.get().run()


def _forget_pool() -> None:
    """Replace the pool: a forked child inherits the object, but none of its threads."""
    global _pool, _pool_size, _pool_lock
    _pool, _pool_size, _pool_lock = SimpleQueue(), 0, Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_pool)
