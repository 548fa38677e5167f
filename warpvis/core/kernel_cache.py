# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels are compiled once on a machine: by one process, into Warp's cache, while others that need them wait."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Any

import warp as wp

from warpvis.core.types import KernelArguments

_logger = logging.getLogger("warpvis")

# Others are heard of after so many seconds of waiting, and compiling is told of as often.
_PATIENCE = 1.0
_USUALLY = {True: "about 10 s", False: "about 20 s"}  # on a CPU, for a GPU

_CUDA_BLOCK = 256  # of `wp.launch`

_load_lock = Lock()
_said: set[str] = set()
_compiling = 0


def launch(
    kernel: wp.Kernel,
    dim: int | tuple[int, ...],
    inputs: KernelArguments,
    device: wp.Device,
    *,
    block_dim: int | None = None,
    record_cmd: bool = False,
) -> Any:
    """Launch a kernel as `wp.launch` does, after `load_module`."""
    load_module(kernel, device, block_dim)
    # Warp 1.17 takes None for no size of a block.
    block = {} if block_dim is None else {"block_dim": block_dim}
    return wp.launch(kernel, dim=dim, inputs=inputs, device=device, record_cmd=record_cmd, **block)


def load_module(kernel: wp.Kernel, device: wp.Device | None = None, block_dim: int | None = None) -> None:
    """Load a kernel's module, after compiling it where the cache does not have it.

    Two threads must not do it at the same time, and two processes need not: a file lock beside the cache's files has
    others wait for the first. The system takes the lock from a process that ends, however it does.

    Args:
        kernel: The kernel.
        device: Where it is to be launched; the CPU by default.
        block_dim: Threads of a block on a GPU; as many as `wp.launch` takes by default.
    """
    module = kernel.module
    device = wp.get_device("cpu") if device is None else device
    # Warp launches blocks of one thread on a CPU, and compiles them apart from others.
    variant = 1 if device.is_cpu else block_dim or _CUDA_BLOCK
    if (device.context, variant) in module.execs:
        return
    with _load_lock:
        if _is_compiled(module, device, variant):
            _load(module, device, variant)
            return
    _finish_elsewhere(module, device, variant)


def init_warp() -> None:
    """Start Warp, with a temporary cache where its own folder cannot be made."""
    try:
        wp.init()
    except OSError as error:
        # Warp adds its version to a folder that it is given before it has started.
        wp.config.kernel_cache_dir = str(_use_temporary_cache(error).parent)
        wp.init()


def is_compiling() -> bool:
    """Tell whether a thread of this process compiles kernels."""
    return _compiling > 0


def _load(module: Any, device: wp.Device, variant: int) -> None:
    # Without the block's size, Warp 1.17 loads for a CPU what no launch takes there.
    wp.load_module(module, device, block_dim=variant)


def _finish_elsewhere(module: Any, device: wp.Device, variant: int) -> None:
    """Compile on a thread of its own, and wait for it: a compiler does not hear Ctrl-C, and who waits does."""
    done, failures = Event(), list[BaseException]()

    def work() -> None:
        global _compiling
        _compiling += 1
        try:
            with _load_lock, _one_process(module):
                _compile(module, device, variant)
        except BaseException as error:
            failures.append(error)
        finally:
            _compiling -= 1
            done.set()

    Thread(target=work, name="warpvis-compile", daemon=True).start()
    done.wait()
    if failures:
        raise failures[0]


def _compile(module: Any, device: wp.Device, variant: int) -> None:
    """Compile a module, unless another process just did, and load it."""
    if _is_compiled(module, device, variant):
        _load(module, device, variant)
        return
    _say("compiling", f"compiling kernels, once: {_USUALLY[device.is_cpu]}")
    name, start = module.name.rpartition(".")[2], time.perf_counter()
    with _counting(name, start):
        _load(module, device, variant)
    seconds = time.perf_counter() - start
    _logger.info("compiled kernels of %s for %s in %.1f s", name, device.alias, seconds)


@contextlib.contextmanager
def _counting(name: str, start: float) -> Iterator[None]:
    """Count seconds on a terminal."""
    if not _on_terminal():
        yield
        return
    done = Event()

    def count() -> None:
        while not done.wait(_PATIENCE):
            print(f"\r  {name} {time.perf_counter() - start:3.0f} s", end="", file=sys.stderr, flush=True)

    counter = Thread(target=count, name="warpvis-progress", daemon=True)
    counter.start()
    try:
        yield
    finally:
        done.set()
        counter.join()
        print(f"\r  {name} {time.perf_counter() - start:5.1f} s", file=sys.stderr, flush=True)


@contextlib.contextmanager
def _one_process(module: Any) -> Iterator[None]:
    """Hold the lock of a module, of all processes that share the cache."""
    from filelock import FileLock, Timeout

    folder = _writable_cache() / "warpvis-locks"
    folder.mkdir(exist_ok=True)
    # Whichever device and variant it is for: Warp puts them in one folder.
    lock = FileLock(folder / f"{module.name}.lock", timeout=_PATIENCE)
    try:
        try:
            lock.acquire()
        except Timeout:
            _say("waiting", "waiting for another process to compile the kernels")
            lock.acquire(timeout=-1)
    except (OSError, NotImplementedError) as error:
        # A file system without locks: as many compile as need to.
        _logger.info("kernels are compiled without a lock: %s", error)
    try:
        yield
    finally:
        lock.release()


def _is_compiled(module: Any, device: wp.Device, variant: int) -> bool:
    """Tell whether the cache has what a device loads. Warp has no public question for it: see its `Module._compile`."""
    folder = Path(wp.config.kernel_cache_dir) / module.get_module_identifier(variant)
    return folder.is_dir() and (folder / module._get_compile_output_name(device, block_dim=variant)).is_file()


def _writable_cache() -> Path:
    """Return the cache's folder, or a temporary one that has what it has where nothing can be written to it."""
    folder = Path(wp.config.kernel_cache_dir)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="warpvis-", dir=folder):
            return folder
    except OSError as error:
        return _use_temporary_cache(error)


def _use_temporary_cache(error: OSError) -> Path:
    """Have Warp use a folder that all processes of this user find, so that they compile once, too."""
    old = wp.config.kernel_cache_dir
    base = Path(tempfile.gettempdir()) / f"warpvis-kernels-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    base.mkdir(mode=0o700, exist_ok=True)
    if hasattr(os, "getuid") and (base.stat().st_uid != os.getuid() or base.stat().st_mode & 0o022):
        # Code that others could write there would be run.
        base = Path(tempfile.mkdtemp(prefix="warpvis-kernels-"))
    folder = base / wp.config.version
    folder.mkdir(exist_ok=True)
    warnings.warn(
        f"Warp's cache cannot be written to ({error}); kernels are compiled into {folder}; "
        "WARP_CACHE_PATH may name another folder",
        stacklevel=2,
    )
    for entry in Path(old or folder).glob("wp_*"):
        with contextlib.suppress(FileExistsError):
            (folder / entry.name).symlink_to(entry)
    wp.config.kernel_cache_dir = str(folder)
    return folder


def _say(kind: str, sentence: str) -> None:
    """Say a sentence once: in the log, and on a terminal."""
    if kind in _said:
        return
    _said.add(kind)
    _logger.info(sentence)
    if _on_terminal():
        print(f"warpvis: {sentence}", file=sys.stderr, flush=True)


def _on_terminal() -> bool:
    return sys.stderr is not None and sys.stderr.isatty()


def _forget_lock() -> None:
    """Forget a lock that a thread held which a forked child does not have."""
    global _load_lock, _compiling
    _load_lock, _compiling = Lock(), 0


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_lock)
