# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compile kernels once per machine: one process compiles into Warp's cache while the others wait."""

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

# Seconds of waiting before a message about another process; also the interval of progress messages.
_MESSAGE_INTERVAL = 1.0
_TYPICAL_DURATION = {True: "about 10 s", False: "about 20 s"}  # on a CPU, for a GPU

_CUDA_BLOCK = 256  # of `wp.launch`

_load_lock = Lock()
_logged: set[str] = set()
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
    # Warp 1.17 does not accept None as a block size.
    block = {} if block_dim is None else {"block_dim": block_dim}
    return wp.launch(kernel, dim=dim, inputs=inputs, device=device, record_cmd=record_cmd, **block)


def load_module(kernel: wp.Kernel, device: wp.Device | None = None, block_dim: int | None = None) -> None:
    """Load a kernel's module, after compiling it if the cache does not contain it.

    Threads must not load a module concurrently, and a file lock in the cache lets other processes wait for the first
    one instead of compiling again. The operating system releases the lock when its process ends, even after a crash.
    `device` and `block_dim` are those of the launch, by default the CPU and the default of `wp.launch`.
    """
    module = kernel.module
    device = wp.get_device("cpu") if device is None else device
    # On a CPU, Warp launches blocks of one thread, and compiles them as a separate variant.
    variant = 1 if device.is_cpu else block_dim or _CUDA_BLOCK
    if (device.context, variant) in module.execs:
        return
    with _load_lock:
        if _is_compiled(module, device, variant):
            _load(module, device, variant)
            return
    _compile_on_thread(module, device, variant)


def init_warp() -> None:
    """Initialize Warp, with a temporary cache if its cache folder cannot be created."""
    try:
        wp.init()
    except OSError as error:
        # Warp appends its version to a folder that is configured before initialization.
        wp.config.kernel_cache_dir = str(_use_temporary_cache(error).parent)
        wp.init()


def is_compiling() -> bool:
    """Return whether a thread of this process is compiling kernels."""
    return _compiling > 0


def _load(module: Any, device: wp.Device, variant: int) -> None:
    # Without a block size, Warp 1.17 loads a variant that no CPU launch uses.
    wp.load_module(module, device, block_dim=variant)


def _compile_on_thread(module: Any, device: wp.Device, variant: int) -> None:
    """Compile on a separate thread and wait for it: compilation blocks Ctrl-C, waiting for an event does not."""
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
    """Load a module, after compiling it unless another process has just done so."""
    if _is_compiled(module, device, variant):
        _load(module, device, variant)
        return
    _log_once("compiling", f"compiling kernels, once: {_TYPICAL_DURATION[device.is_cpu]}")
    name, start = module.name.rpartition(".")[2], time.perf_counter()
    with _show_progress(name, start):
        _load(module, device, variant)
    seconds = time.perf_counter() - start
    _logger.info("compiled kernels of %s for %s in %.1f s", name, device.alias, seconds)


@contextlib.contextmanager
def _show_progress(name: str, start: float) -> Iterator[None]:
    """Print elapsed seconds on a terminal."""
    if not _on_terminal():
        yield
        return
    done = Event()

    def count() -> None:
        while not done.wait(_MESSAGE_INTERVAL):
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
    """Hold the lock of a module, which all processes that use the cache share."""
    from filelock import FileLock, Timeout

    folder = _writable_cache() / "warpvis-locks"
    folder.mkdir(exist_ok=True)
    # One lock for all devices and variants: Warp stores them in one folder.
    lock = FileLock(folder / f"{module.name}.lock", timeout=_MESSAGE_INTERVAL)
    try:
        try:
            lock.acquire()
        except Timeout:
            _log_once("waiting", "waiting for another process to compile the kernels")
            lock.acquire(timeout=-1)
    except (OSError, NotImplementedError) as error:
        # The file system does not support locks: several processes may compile.
        _logger.info("kernels are compiled without a lock: %s", error)
    try:
        yield
    finally:
        lock.release()


def _is_compiled(module: Any, device: wp.Device, variant: int) -> bool:
    """Return whether the cache contains the binary of a device. Not public in Warp: see its `Module._compile`."""
    folder = Path(wp.config.kernel_cache_dir) / module.get_module_identifier(variant)
    return folder.is_dir() and (folder / module._get_compile_output_name(device, block_dim=variant)).is_file()


def _writable_cache() -> Path:
    """Return the cache folder, or, if it is not writable, a temporary folder that links to its contents."""
    folder = Path(wp.config.kernel_cache_dir)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="warpvis-", dir=folder):
            return folder
    except OSError as error:
        return _use_temporary_cache(error)


def _use_temporary_cache(error: OSError) -> Path:
    """Configure a cache folder that all processes of this user share, so that they compile once, too."""
    old = wp.config.kernel_cache_dir
    base = Path(tempfile.gettempdir()) / f"warpvis-kernels-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    base.mkdir(mode=0o700, exist_ok=True)
    if hasattr(os, "getuid") and (base.stat().st_uid != os.getuid() or base.stat().st_mode & 0o022):
        # Other users could write code there, which would then be executed.
        base = Path(tempfile.mkdtemp(prefix="warpvis-kernels-"))
    folder = base / wp.config.version
    folder.mkdir(exist_ok=True)
    warnings.warn(
        f"Warp's cache is not writable ({error}). Kernels are compiled to {folder}. Set WARP_CACHE_PATH to use another "
        "folder.",
        stacklevel=2,
    )
    for entry in Path(old or folder).glob("wp_*"):
        with contextlib.suppress(FileExistsError):
            (folder / entry.name).symlink_to(entry)
    wp.config.kernel_cache_dir = str(folder)
    return folder


def _log_once(kind: str, sentence: str) -> None:
    """Write a sentence to the log and to a terminal, once."""
    if kind in _logged:
        return
    _logged.add(kind)
    _logger.info(sentence)
    if _on_terminal():
        print(f"warpvis: {sentence}", file=sys.stderr, flush=True)


def _on_terminal() -> bool:
    return sys.stderr is not None and sys.stderr.isatty()


def _forget_lock() -> None:
    """Reset a lock that is held by a thread that does not exist in a forked child."""
    global _load_lock, _compiling
    _load_lock, _compiling = Lock(), 0


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_lock)
