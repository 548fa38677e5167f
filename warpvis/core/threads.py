# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Spread CPU work over all cores: Warp runs a kernel on the calling thread, so each thread launches its own views."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from queue import SimpleQueue
from threading import Lock, Thread, get_ident
from typing import TypeVar

import warp as wp

from warpvis.core.checks import check_whole
from warpvis.core.kernel_cache import launch, load_module
from warpvis.core.types import KernelArguments
from warpvis.errors import ArrayError
from warpvis.kernels.pinhole import Window

# Pieces a thread gets on average: enough to even out views of different cost, few enough that the 0.1 ms of Python
# that a launch costs does not show.
_PIECES_PER_THREAD = 4
_MIN_PIXELS = 4096

# Rays of one block wait for its slowest: with one query a thread and nothing else, blocks of 64 are 7 % faster than of
# 256 (H200, three scenes).
_CUDA_BLOCK = 64

WHOLE_ROW = 2**30
"""A span of more pixels than a row has: then a thread of a kernel takes all of one."""

MAX_THREADS = 4096
"""More CPU threads than this are a mistake: each has memory of its own."""

_pool: SimpleQueue[_Task] = SimpleQueue()
_pool_size = 0
_pool_lock = Lock()

_Part = TypeVar("_Part")


def core_count() -> int:
    """Return how many cores this process may run on."""
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
    least_pixels: int = _MIN_PIXELS,
) -> None:
    """Launch a kernel over all pixels: at once on CUDA, in pieces over the pool's threads on the CPU.

    Args:
        kernel: A kernel with the thread index ``view, y, x`` that adds a `Window` to it.
        shape: ``(views, height, width)``.
        arguments: The kernel's arguments for a window.
        device: Where to launch.
        threads: CPU threads, all cores by default.
        split_views: Whether several threads may share one view.
        span: How many pixels of a row one thread of the kernel takes; its x counts these spans.
        least_pixels: Pixels that are worth a CPU thread.

    Raises:
        ArrayError: `threads` is not a whole number from 1 up.
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
        known = packed.get(get_ident())
        if known is None:
            known = packed[get_ident()] = _PackedPieces(kernel, dim, arguments(window), window)
        else:
            known.set(dim, window)
        known.launch.launch()

    run_each(launch_piece, _split(shape, threads, split_views, least_pixels), threads)


class _PackedPieces:
    """A thread's launches of a kernel over pieces: to pack all arguments again takes longer than many a piece."""

    def __init__(self, kernel: wp.Kernel, dim: tuple[int, int, int], inputs: KernelArguments, window: Window) -> None:
        """Pack the first one."""
        self.launch = wp.launch(kernel, dim=dim, inputs=inputs, device="cpu", record_cmd=True)
        self._place = next(place for place, value in enumerate(inputs) if value is window)

    def set(self, dim: tuple[int, int, int], window: Window) -> None:
        """Have it be of another piece."""
        self.launch.set_dim(dim)
        self.launch.set_param_at_index(self._place, window)


def launch_points(
    kernel: wp.Kernel,
    shape: tuple[int, int],
    arguments: Callable[[Window], KernelArguments],
    *,
    device: wp.Device,
    threads: int | None = None,
) -> None:
    """Launch a kernel over all points of all views, ``(views, points)``, in rows that CPU threads share out.

    The kernel's thread index is ``view, row, column``; `warpvis.kernels.points.point_index` makes a point of it.
    """
    from warpvis.kernels.points import POINTS_PER_ROW

    views, points = shape
    rows = -(-points // POINTS_PER_ROW)
    launch_images(kernel, (views, rows, POINTS_PER_ROW), arguments, device=device, threads=threads)


def pack_launch(kernel: wp.Kernel, inputs: list[object]) -> wp.Launch:
    """Pack a launch of one CPU thread, for several threads or times: packing takes longer than many a launch.

    Structs are packed by reference: a launch reads what they hold then.
    """
    load_module(kernel)
    return wp.launch(kernel, dim=1, inputs=inputs, device="cpu", record_cmd=True)


class _PartTaker:
    """Shares out parts among the threads that call it; after a failure the others take no more."""

    def __init__(self, work: Callable[[_Part], object], parts: Sequence[_Part]) -> None:
        self.failures: list[BaseException] = []
        self._work, self._waiting = work, iter(parts)

    def __call__(self) -> None:
        for part in self._waiting:
            if self.failures:
                return
            try:
                self._work(part)
            except BaseException as error:
                self.failures.append(error)
                raise


def run_each(work: Callable[[_Part], object], parts: Sequence[_Part], threads: int) -> None:
    """Call `work` for each part, on at most so many threads at a time: this one and the pool's."""
    run_together(_PartTaker(work, parts), min(threads, len(parts)), lambda: False)


def run_together(work: Callable[[], None], workers: int, all_finished: Callable[[], bool]) -> None:
    """Call `work` as many times at the same time: once here, and on the pool's threads.

    Args:
        work: Shares out what there is to do; a call that comes late finds nothing left.
        workers: How many calls.
        all_finished: Whether every call is known to have done its work: then nobody waits for its thread to say so,
            which takes longer than many a frame.
    """
    if workers < 1:
        return
    others = _submit(work, workers - 1)
    try:
        work()
        if all_finished():
            return
    except BaseException:
        for other in _begun(others):
            other.wait()  # it writes to what the caller takes back now
        raise
    for other in _begun(others):
        other.wait()
        if other.error is not None:
            raise other.error


class _Task:
    """Work for a thread of the pool, unless it is called off before one has begun.

    A `Future` does the same, and takes longer to make and to wait for than a small image.
    """

    __slots__ = ("_begun", "_done", "_work", "error")

    def __init__(self, work: Callable[[], None]) -> None:
        self.error: BaseException | None = None
        self._work = work
        self._begun, self._done = Lock(), Lock()
        self._done.acquire()

    def run(self) -> None:
        """Do it."""
        if not self._begun.acquire(blocking=False):
            return
        try:
            self._work()
        except BaseException as error:
            self.error = error
        finally:
            self._done.release()

    def call_off(self) -> bool:
        """Have nobody begin any more; whether nobody has."""
        return self._begun.acquire(blocking=False)

    def wait(self) -> None:
        """Wait until it is done, once."""
        self._done.acquire()


def _begun(tasks: list[_Task]) -> list[_Task]:
    """Return those that could not be called off."""
    return [task for task in tasks if not task.call_off()]


class Crew:
    """Threads apart from the pool's, which work through one call's parts after another's: what they do is no more than
    so many things at a time, however many callers wait for them.

    A context: its threads end with it.
    """

    def __init__(self, threads: int, name: str) -> None:
        """Take so many threads, which begin when they are needed; `name` is what debuggers call them."""
        self.threads = threads
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix=name)

    def __enter__(self) -> Crew:
        """Begin."""
        return self

    def __exit__(self, *error: object) -> None:
        """End when all that was begun is done."""
        self._pool.shutdown()

    def each(self, work: Callable[[_Part], object], parts: Sequence[_Part]) -> None:
        """Call `work` for each part, and wait; an error comes back when nobody works on this call's any more."""
        run_parts = _PartTaker(work, parts)
        wait([self._pool.submit(run_parts) for _ in range(min(self.threads, len(parts)))])
        if run_parts.failures:
            raise run_parts.failures[0]


def check_threads(threads: int | None) -> int:
    """Return the number of threads to use; all cores for None."""
    if threads is None:
        return core_count()
    if check_whole(threads, "threads") > MAX_THREADS:
        raise ArrayError(f"threads must be at most {MAX_THREADS}, got {threads}")
    return int(threads)


def _split(
    shape: tuple[int, int, int], threads: int, split_views: bool, least_pixels: int = _MIN_PIXELS
) -> list[tuple[int, int, int, int]]:
    """Make pieces ``(view, view_count, row, row_count)`` of about equal size that cover all rows of all views."""
    views, height, width = shape
    if threads == 1:
        return [(0, views, 0, height)]
    pixels = max(views * height * width // (threads * _PIECES_PER_THREAD), least_pixels)
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
    """Hand `work` to so many threads of the one pool, which grows to as many as were ever asked for."""
    tasks = [_Task(work) for _ in range(count)]
    if _pool_size < count:
        _enlarge_pool(count)
    for task in tasks:
        _pool.put(task)
    return tasks


def _enlarge_pool(size: int) -> None:
    global _pool_size
    with _pool_lock:
        while _pool_size < size:
            Thread(target=_work_for_pool, args=(_pool,), name=f"warpvis_{_pool_size}", daemon=True).start()
            _pool_size += 1


def _work_for_pool(pool: SimpleQueue[_Task]) -> None:
    """Do what is to be done, for good: who sleeps here keeps no process from ending."""
    while True:
        pool.get().run()


def _forget_pool() -> None:
    """Forget the pool: a forked child has its object but none of its threads."""
    global _pool, _pool_size, _pool_lock
    _pool, _pool_size, _pool_lock = SimpleQueue(), 0, Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_pool)
