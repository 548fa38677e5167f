# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A lock for stores that have none: a file that says who writes, for how long from now, written again meanwhile."""

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
"""A lock counts for so many seconds from its last writing: longer than clocks of machines differ, or a store stalls."""

_REFRESHED = 4  # times in a lease


class _Holder(NamedTuple):
    """What a lock says."""

    owner: str
    host: str
    process: int
    time: float

    def holds(self) -> bool:
        """Tell whether its process may still be writing."""
        return time.time() - self.time < LEASE and not (self.host == socket.gethostname() and _is_gone(self.process))


@contextmanager
def leased(system: AbstractFileSystem, path: str, name: str) -> Iterator[None]:
    """Hold the lock in the file `path` of a store, within a context; `name` is what messages call the dataset.

    Two that begin at the same moment are told apart where the store can create a file only if there is none (fsspec's
    mode ``"xb"``: memory, disks, S3). Elsewhere, or where a process stood still for longer than the lease, both may
    write: of the same job they write the same bytes.

    Raises:
        FileFormatError: Another process holds it.
        OSError: It cannot be written.
    """
    owner = uuid.uuid4().hex
    if not _create(system, path, owner):
        require_unlocked(system, path, name)
        system.pipe_file(path, _text(owner))
    found = _read(system, path)
    if found is None or found.owner != owner:
        raise FileFormatError(f"{name}: another process began to write it at the same moment; wait for it, or end it")
    over = threading.Event()
    refreshing = threading.Thread(target=_refresh, args=(system, path, owner, over), daemon=True)
    refreshing.start()
    try:
        yield
    finally:
        over.set()
        refreshing.join()
        with suppress(OSError):  # what is left ends with its lease
            if _is_ours(system, path, owner):
                system.rm_file(path)


def require_unlocked(system: AbstractFileSystem, path: str, name: str) -> None:
    """Raise a `FileFormatError` if another process holds the lock in the file `path`; nothing is written."""
    holder = _read(system, path)
    if holder is not None and holder.holds():
        raise FileFormatError(
            f"{name}: another process is writing it ({holder.process} on {holder.host}); wait for it, or end it "
            f"and wait for {LEASE:.0f} s"
        )


def _create(system: AbstractFileSystem, path: str, owner: str) -> bool:
    """Write the lock if there is none; tell whether it was written."""
    try:
        system.pipe_file(path, _text(owner), mode="create")
    except FileExistsError:
        return False
    except (TypeError, ValueError, NotImplementedError):  # of stores that cannot
        if _read(system, path) is not None:
            return False
        system.pipe_file(path, _text(owner))
    return True


def _refresh(system: AbstractFileSystem, path: str, owner: str, over: threading.Event) -> None:
    while not over.wait(LEASE / _REFRESHED):
        with suppress(OSError):  # the next time, maybe
            if not _is_ours(system, path, owner):
                return
            system.pipe_file(path, _text(owner))


def _is_ours(system: AbstractFileSystem, path: str, owner: str) -> bool:
    holder = _read(system, path)
    return holder is not None and holder.owner == owner


def _text(owner: str) -> bytes:
    return json.dumps(_Holder(owner, socket.gethostname(), os.getpid(), time.time())._asdict()).encode()


def _read(system: AbstractFileSystem, path: str) -> _Holder | None:
    """Read who holds the lock; None if nobody, or what is there says nothing of it."""
    try:
        content = json.loads(system.cat_file(path))
        return _Holder(str(content["owner"]), str(content["host"]), int(content["process"]), float(content["time"]))
    except (FileNotFoundError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None


def _is_gone(process: int) -> bool:
    """Tell whether this machine has no such process."""
    if os.name != "posix" or process <= 0:  # elsewhere, asking would end it
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False
    return False
