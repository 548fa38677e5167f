# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lease lock for stores without file locks: a file with the owner and the time, which the owner renews regularly."""

from __future__ import annotations

import json
import os
import socket
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, NamedTuple

from warpvis.errors import FileFormatError

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

LEASE = 120.0
"""Duration of a lease [s]: longer than the difference between clocks of machines, and than delays of the store."""

_REFRESHES = 4  # per lease


class _Holder(NamedTuple):
    """The contents of a lock file."""

    owner: str
    host: str
    process: int
    time: float

    def holds(self) -> bool:
        """Return whether the process may still be writing."""
        return time.time() - self.time < LEASE and not (self.host == socket.gethostname() and _is_gone(self.process))


@contextmanager
def leased(system: AbstractFileSystem, path: str, name: str) -> Iterator[None]:
    """Hold the lock in the file `path` of a store, as a context manager; `name` is the name of the dataset in messages.

    The lock is exclusive if the store supports exclusive creation of files (fsspec's mode ``"xb"``: memory, disks, S3).
    On other stores, two processes that start at the same time may both write, as on any store after a process was
    suspended for longer than the lease. This is harmless for the same job: both write the same bytes.
    """
    owner = uuid.uuid4().hex
    if not _create(system, path, owner):
        require_unlocked(system, path, name)
        system.pipe_file(path, _text(owner))
    holder = _read(system, path)
    if holder is None or holder.owner != owner:
        raise FileFormatError(f"{name}: another process started to write it at the same time. Wait for it, or end it.")
    stop = threading.Event()
    refresher = threading.Thread(target=_refresh, args=(system, path, owner, stop), daemon=True)
    refresher.start()
    try:
        yield
    finally:
        stop.set()
        refresher.join()
        with suppress(OSError):  # a remaining lock expires
            if _is_ours(system, path, owner):
                system.rm_file(path)


def require_unlocked(system: AbstractFileSystem, path: str, name: str) -> None:
    """Raise a `FileFormatError` if another process holds the lock in the file `path`; nothing is written."""
    holder = _read(system, path)
    if holder is not None and holder.holds():
        raise FileFormatError(
            f"{name}: another process is writing it ({holder.process} on {holder.host}). Wait for it, or end it "
            f"and wait for {LEASE:.0f} s."
        )


def _create(system: AbstractFileSystem, path: str, owner: str) -> bool:
    """Create the lock; return False if it exists already."""
    try:
        system.pipe_file(path, _text(owner), mode="create")
    except FileExistsError:
        return False
    except (TypeError, ValueError, NotImplementedError):  # the store has no exclusive creation
        if _read(system, path) is not None:
            return False
        system.pipe_file(path, _text(owner))
    return True


def _refresh(system: AbstractFileSystem, path: str, owner: str, stop: threading.Event) -> None:
    while not stop.wait(LEASE / _REFRESHES):
        with suppress(OSError):  # retry at the next refresh
            if not _is_ours(system, path, owner):
                return
            system.pipe_file(path, _text(owner))


def _is_ours(system: AbstractFileSystem, path: str, owner: str) -> bool:
    holder = _read(system, path)
    return holder is not None and holder.owner == owner


def _text(owner: str) -> bytes:
    return json.dumps(_Holder(owner, socket.gethostname(), os.getpid(), time.time())._asdict()).encode()


def _read(system: AbstractFileSystem, path: str) -> _Holder | None:
    """Read the lock; return None if it does not exist or is malformed."""
    try:
        content = json.loads(system.cat_file(path))
        return _Holder(str(content["owner"]), str(content["host"]), int(content["process"]), float(content["time"]))
    except (FileNotFoundError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None


def _is_gone(process: int) -> bool:
    """Return whether the process does not exist on this machine."""
    if os.name != "posix" or process <= 0:  # on other systems, os.kill would end the process
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False
    return False
