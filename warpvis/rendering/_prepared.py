# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What is made once for calls of a kind, and waits for the next one."""

from __future__ import annotations

from collections.abc import Hashable
from threading import Lock
from typing import Any, Generic, TypeVar

_Thing = TypeVar("_Thing")


class Idle(Generic[_Thing]):
    """Things that no call uses at the moment, by the kind of call that may: callers on several threads take their own.

    Of each kind there are as many as calls were made at the same time; kinds that have not come last are forgotten.
    """

    def __init__(self, most_kinds: int) -> None:
        """Have nothing yet; keep at most so many kinds."""
        self._things: dict[Hashable, list[_Thing]] = {}
        self._most_kinds = most_kinds
        self._lock = Lock()

    def take(self, kind: Hashable) -> _Thing | None:
        """Take a thing of a kind, if there is one."""
        try:
            return self._things[kind].pop()
        except (KeyError, IndexError):
            return None

    def give_back(self, kind: Hashable, thing: _Thing) -> None:
        """Have it wait for the next call."""
        try:
            self._things[kind].append(thing)
        except KeyError:
            with self._lock:
                while len(self._things) >= self._most_kinds:
                    del self._things[next(iter(self._things))]
                self._things[kind] = [thing]


def memory_of(struct: Any) -> Any:
    """Return the memory of a struct of Warp's, as ctypes has it: a launch that is packed reads it when it is made."""
    return struct.__ctype__()
