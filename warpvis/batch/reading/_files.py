# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Access to the files of a dataset, and a cache of recently read values."""

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

# Number of cached files: memory-mapped files only use address space, files of URLs are held in memory.
_MAX_MAPPED, _MAX_IN_MEMORY = 512, 4


class Recent(Generic[Value]):
    """A cache of recent values by key; concurrent callers may create a value twice."""

    def __init__(self, size: int) -> None:
        """Cache at cache_size `size` values."""
        self._size = size
        self._values: OrderedDict[Hashable, Value] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """Return the cached value of the key; create it if it is missing."""
        value = self._values.get(key)
        if value is None:
            value = self._values[key] = make()
            while len(self._values) > self._size:
                try:
                    self._values.popitem(last=False)
                except KeyError:  # removed by another thread
                    break
        return value


class Files:
    """The files of a dataset: local files are memory-mapped, files of a URL are read whole."""

    def __init__(self, store: Store) -> None:
        """Read files from `store`."""
        self.store = store
        self.cache_size = _MAX_MAPPED if isinstance(store, LocalStore) else _MAX_IN_MEMORY
        self._recent = Recent[NDArray[np.uint8]](self.cache_size)

    def bytes_of(self, name: str) -> NDArray[np.uint8]:
        """Return the contents of a file, read-only."""
        return self._recent.get(name, lambda: self._open(name))

    def read(self, name: str) -> bytes:
        """Read a small file without caching it."""
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
        except ValueError:  # empty files cannot be mapped
            raise FileFormatError(f"{self.store.name}: {name} is empty") from None
        except OSError as error:
            raise FileFormatError(f"{self.store.name}: {name} cannot be read: {error.strerror or error}") from None
