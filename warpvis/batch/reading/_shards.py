# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What each format's reader is, and readers of raw arrays: ``npz`` and ``zarr``."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from warpvis.batch._job import shard_name
from warpvis.batch.formats._base import IMAGE_DTYPES
from warpvis.batch.reading._files import Files, Recent
from warpvis.batch.reading._job import FrameSpec, Job
from warpvis.core.checks import describe_exception
from warpvis.core.types import Json
from warpvis.errors import FileFormatError

_LOCAL_HEADER = 30  # of a ZIP entry, before its name and its extra field
_MAX_HEADER = 4096


class ShardReader(Protocol):
    """Reads frames of one format."""

    def __init__(self, files: Files, job: Job) -> None:
        """Prepare to read."""

    def specs(self) -> Mapping[str, FrameSpec]:
        """List the arrays that the dataset holds, of a frame each."""
        ...

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Read a frame's array.

        Args:
            name: The array.
            shard: The frame's shard.
            row: Its place in the shard.
            out: Memory of the array's dtype and shape.

        Raises:
            FileFormatError: A file is missing, damaged, or cannot be read.
        """
        ...


class NpzReader:
    """Reads ``shard-000012.npz``, of which all arrays lie in the file as they are in memory."""

    def __init__(self, files: Files, job: Job) -> None:
        """Prepare to read."""
        self._files, self._job, self._specs = files, job, job.specs()
        self._shards = Recent[dict[str, NDArray]](files.most)

    def specs(self) -> Mapping[str, FrameSpec]:
        """List the arrays."""
        return self._specs

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Copy a frame's array out of the mapped file."""
        out[...] = self._shards.get(shard, lambda: self._open(shard))[name][row]

    def _open(self, shard: int) -> dict[str, NDArray]:
        name = f"shard-{shard_name(shard)}.npz"
        data = self._files.bytes_of(name)
        try:
            with self._files.store.open(name) as stream, zipfile.ZipFile(stream) as archive:
                entries = {entry.filename: entry for entry in archive.infolist()}
            arrays = {key: _mapped_array(data, entries[f"{key}.npy"]) for key in self._specs}
        except Exception as error:  # whatever zipfile and NumPy raise for what is no such file
            raise FileFormatError(f"{self._job.name}: {name} is damaged: {describe_exception(error)}") from None
        length = self._job.shard_length(shard)
        for key, spec in self._specs.items():
            found = arrays[key]
            if found.dtype != spec.dtype or found.shape != (length, *spec.shape):
                raise FileFormatError(
                    f"{self._job.name}: {name} holds {key} as {found.dtype} of {found.shape}, and should hold "
                    f"{spec.dtype} of {(length, *spec.shape)}"
                )
        return arrays


def _mapped_array(data: NDArray[np.uint8], entry: zipfile.ZipInfo) -> NDArray:
    """Return an array of an ``.npz`` file where it lies.

    Raises:
        ValueError: It is compressed, cut off, or no array.
    """
    if entry.compress_type != zipfile.ZIP_STORED:
        raise ValueError(f"{entry.filename} is compressed")
    local = data[entry.header_offset : entry.header_offset + _LOCAL_HEADER]
    name_and_extra = local[26:30].view("<u2") if len(local) == _LOCAL_HEADER else [0]
    start = entry.header_offset + _LOCAL_HEADER + int(sum(name_and_extra))
    head = io.BytesIO(data[start : start + _MAX_HEADER].tobytes())
    np.lib.format.read_magic(head)
    shape, by_columns, dtype = np.lib.format.read_array_header_1_0(head)
    first, size = start + head.tell(), dtype.itemsize * int(np.prod(shape))
    if by_columns or dtype.hasobject or first + size > len(data) or head.tell() + size != entry.file_size:
        raise ValueError(f"{entry.filename} is cut off, or no array of rows")
    return data[first : first + size].view(dtype).reshape(shape)


class ZarrReader:
    """Reads ``data.zarr``: shards of the codec ``sharding_indexed`` with a chunk a frame; see `formats._zarr`.

    The files alone say all, so that what is not finished is read, too.
    """

    def __init__(self, files: Files, job: Job) -> None:
        """Prepare to read.

        Raises:
            FileFormatError: The chunks are compressed, and numcodecs is missing.
        """
        self._files, self._job, self._specs = files, job, job.specs()
        self._tables = Recent[NDArray[np.uint64]](files.most)
        self._packed = job.options.get("compression", "none") == "zstd"
        if self._packed:
            try:
                import numcodecs.zstd  # noqa: F401
            except ImportError:
                raise FileFormatError(
                    f"{job.name}: its chunks are compressed, which needs zarr: pip install 'warpvis[dataset]'"
                ) from None

    def specs(self) -> Mapping[str, FrameSpec]:
        """List the arrays."""
        return self._specs

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Copy a frame's array out of the mapped file, or decode it."""
        spec = self._specs[name]
        file = f"data.zarr/{name}/c.{shard}" + ".0" * len(spec.shape)
        data = self._files.bytes_of(file)
        if name not in IMAGE_DTYPES:  # one chunk of all frames of the shard
            size = spec.dtype.itemsize * int(np.prod(spec.shape))
            chunk = data[row * size : (row + 1) * size]
        else:
            offset, length = self._tables.get(file, lambda: self._table(data)).reshape(-1, 2)[row].tolist()
            chunk = data[offset : offset + length]
            if self._packed and 0 < len(chunk) == length:
                self._decode(file, chunk, out)
                return
        if chunk.nbytes != out.nbytes:
            raise self._damaged(file)
        out[...] = chunk.view(spec.dtype).reshape(spec.shape)

    def _table(self, data: NDArray[np.uint8]) -> NDArray[np.uint64]:
        """Read where the chunks are: offset and length of each."""
        count = self._job.shard_frames
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
    """Return a number of a JSON file.

    Raises:
        FileFormatError: It is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FileFormatError(f"{name}: expected a number, got {value!r}")
    return float(value)
