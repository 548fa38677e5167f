# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Bytes of a dataset's files, and what was made of the latest of them."""

from __future__ import annotations

import mmap
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from warpvis.batch.storage._stores import LocalStore, Store
from warpvis.errors import FileFormatError

Value = TypeVar("Value")

# Mapped files cost addresses and no memory; those of a URL are held whole.
_MAPPED, _HELD = 512, 4


class Recent(Generic[Value]):
    """The latest few of what is made by key; callers on several threads may make one twice."""

    def __init__(self, most: int) -> None:
        """Keep at most so many."""
        self._most = most
        self._kept: OrderedDict[Hashable, Value] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """Return what is kept of the key, or make it."""
        found = self._kept.get(key)
        if found is None:
            found = self._kept[key] = make()
            while len(self._kept) > self._most:
                try:
                    self._kept.popitem(last=False)
                except KeyError:  # another thread was quicker
                    break
        return found


class Files:
    """The files of a dataset: of this machine they are mapped into memory, of a URL they are read."""

    def __init__(self, store: Store) -> None:
        """Read files of `store`."""
        self.store = store
        self.most = _MAPPED if isinstance(store, LocalStore) else _HELD
        self._recent = Recent[NDArray[np.uint8]](self.most)

    def bytes_of(self, name: str) -> NDArray[np.uint8]:
        """Return what a file holds, read-only.

        Raises:
            FileFormatError: It is missing, or cannot be read.
        """
        return self._recent.get(name, lambda: self._open(name))

    def read(self, name: str) -> bytes:
        """Read a small file, which is not kept.

        Raises:
            FileFormatError: It is missing, or cannot be read.
        """
        try:
            data = self.store.read(name)
        except OSError as error:
            raise FileFormatError(f"{self.store.name}: {name} cannot be read: {error.strerror or error}") from None
        if data is None:
            raise FileFormatError(f"{self.store.name}: {name} is missing")
        return data

    def _open(self, name: str) -> NDArray[np.uint8]:
        if not isinstance(self.store, LocalStore):
            return np.frombuffer(self.read(name), dtype=np.uint8)
        try:
            with self.store.open(name) as stream:
                return np.frombuffer(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ), dtype=np.uint8)
        except FileNotFoundError:
            raise FileFormatError(f"{self.store.name}: {name} is missing") from None
        except ValueError:  # nothing to map
            raise FileFormatError(f"{self.store.name}: {name} is empty") from None
        except OSError as error:
            raise FileFormatError(f"{self.store.name}: {name} cannot be read: {error.strerror or error}") from None
