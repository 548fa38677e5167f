# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Access to the files of a dataset, the base class of readers, and readers of raw arrays: ``npz`` and ``zarr``."""

from __future__ import annotations

import io
import mmap
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from warpvis.batch._job import shard_name
from warpvis.batch.reading._job import Job
from warpvis.batch.storage._stores import LocalStore, Store
from warpvis.core.checks import describe_exception
from warpvis.core.outputs import OUTPUTS
from warpvis.core.types import Json
from warpvis.errors import FileFormatError

Value = TypeVar("Value")

# Number of cached files: memory-mapped files only use address space, files of URLs are held in memory.
_MAX_MAPPED, _MAX_IN_MEMORY = 512, 4

_LOCAL_HEADER = 30  # size of the header of a ZIP entry before its name and extra field
_MAX_HEADER = 4096


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


class ShardReader:
    """Reads frames of one format."""

    def __init__(self, files: Files, job: Job) -> None:
        self._files, self._job = files, job
        self.specs = job.specs()
        """Dtypes and shapes of the arrays of a frame that the dataset contains."""

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Read the array `name` of frame `row` of a shard into memory with its dtype and shape."""
        raise NotImplementedError


class NpzReader(ShardReader):
    """Reads ``shard-000012.npz``, whose arrays are not compressed and can be memory-mapped."""

    def __init__(self, files: Files, job: Job) -> None:
        super().__init__(files, job)
        self._shards = Recent[dict[str, NDArray]](files.cache_size)

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Copy an array of a frame from the mapped file."""
        out[...] = self._shards.get(shard, lambda: self._open(shard))[name][row]

    def _open(self, shard: int) -> dict[str, NDArray]:
        name = f"shard-{shard_name(shard)}.npz"
        data = self._files.bytes_of(name)
        try:
            with self._files.store.open(name) as stream, zipfile.ZipFile(stream) as archive:
                entries = {entry.filename: entry for entry in archive.infolist()}
            arrays = {key: _mapped_array(data, entries[f"{key}.npy"]) for key in self.specs}
        except Exception as error:  # zipfile and NumPy may raise any exception for damaged files
            raise FileFormatError(f"{self._job.name}: {name} is damaged: {describe_exception(error)}") from None
        length = self._job.shard_length(shard)
        for key, spec in self.specs.items():
            array = arrays[key]
            if array.dtype != spec.dtype or array.shape != (length, *spec.shape):
                raise FileFormatError(
                    f"{self._job.name}: {key} in {name} must be {spec.dtype} of shape {(length, *spec.shape)}, got "
                    f"{array.dtype} of {array.shape}"
                )
        return arrays


def _mapped_array(data: NDArray[np.uint8], entry: zipfile.ZipInfo) -> NDArray:
    """Return an array of an ``.npz`` file as a view of the file."""
    if entry.compress_type != zipfile.ZIP_STORED:
        raise ValueError(f"{entry.filename} is compressed")
    local = data[entry.header_offset : entry.header_offset + _LOCAL_HEADER]
    name_and_extra = local[26:30].view("<u2") if len(local) == _LOCAL_HEADER else [0]
    start = entry.header_offset + _LOCAL_HEADER + int(sum(name_and_extra))
    stream = io.BytesIO(data[start : start + _MAX_HEADER].tobytes())
    np.lib.format.read_magic(stream)
    shape, fortran_order, dtype = np.lib.format.read_array_header_1_0(stream)
    first, size = start + stream.tell(), dtype.itemsize * int(np.prod(shape))
    if fortran_order or dtype.hasobject or first + size > len(data) or stream.tell() + size != entry.file_size:
        raise ValueError(f"{entry.filename} is truncated, or not a numeric array in C order")
    return data[first : first + size].view(dtype).reshape(shape)


class ZarrReader(ShardReader):
    """Reads ``data.zarr``: shards of the codec ``sharding_indexed`` with one chunk per frame; see `formats._zarr`.

    Only files of the shard are read, so unfinished datasets can be read, too.
    """

    def __init__(self, files: Files, job: Job) -> None:
        super().__init__(files, job)
        self._tables = Recent[NDArray[np.uint64]](files.cache_size)
        self._is_compressed = job.options.get("compression", "none") == "zstd"
        if self._is_compressed:
            try:
                import numcodecs.zstd  # noqa: F401
            except ImportError:
                raise FileFormatError(
                    f"{job.name}: reading compressed chunks requires zarr: pip install 'warpvis[dataset]'"
                ) from None

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Copy an array of a frame from the mapped file, or decompress it."""
        spec = self.specs[name]
        file = f"data.zarr/{name}/c.{shard}" + ".0" * len(spec.shape)
        data = self._files.bytes_of(file)
        if name not in OUTPUTS:  # one chunk with all frames of the shard
            size = spec.dtype.itemsize * int(np.prod(spec.shape))
            chunk = data[row * size : (row + 1) * size]
        else:
            offset, length = self._tables.get(file, lambda: self._table(data)).reshape(-1, 2)[row].tolist()
            chunk = data[offset : offset + length]
            if self._is_compressed and 0 < len(chunk) == length:
                self._decode(file, chunk, out)
                return
        if chunk.nbytes != out.nbytes:
            raise self._damaged(file)
        out[...] = chunk.view(spec.dtype).reshape(spec.shape)

    def _table(self, data: NDArray[np.uint8]) -> NDArray[np.uint64]:
        """Return the index of chunks: offset and length of each."""
        count = self._job.contents.shard_frames
        table = data[len(data) - 16 * count - 4 : -4]
        return table.copy().view("<u8") if len(table) == 16 * count else np.zeros(2 * count, dtype=np.uint64)

    def _decode(self, file: str, chunk: NDArray[np.uint8], out: NDArray) -> None:
        from numcodecs.zstd import decompress

        try:
            decompress(chunk, out)
        except (RuntimeError, ValueError):
            raise self._damaged(file) from None

    def _damaged(self, file: str) -> FileFormatError:
        return FileFormatError(f"{self._job.name}: {file} is damaged")


def number(value: Json, name: str) -> float:
    """Check that a value from a JSON file is a number, and return it."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FileFormatError(f"{name}: expected a number, got {value!r}")
    return float(value)
