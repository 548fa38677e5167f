# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""NumPy's ``.npz``, one file per shard: ``shard-000012.npz`` with the arrays of its frames."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from warpvis.batch._job import shard_name
from warpvis.batch.formats._base import ANY_OUTPUT, Format, Images
from warpvis.batch.storage._output import ALIGNMENT, MIN_DIRECT
from warpvis.cameras import ImageCamera, as_pinhole, opencv_intrinsics
from warpvis.sensors import sensor_to_fields

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

    from warpvis.batch.storage._output import ShardFiles

# Minimum time stamp of a ZIP file, because bytes must not depend on the time.
_EPOCH = (1980, 1, 1, 0, 0, 0)
_PADDING_ID = 0xD935
"""Header ID of an extra field of zeros that aligns the data of a ZIP entry, as in Android's zipalign."""


class Npz(Format):
    """Arrays by name, and ``K``, ``camera_to_world``, ``timestamps`` and ``frame``.

    For cameras with a lens, ``camera`` is JSON text, and ``K`` and ``distortion`` exist only for OpenCV's pinhole. With
    a sensor, lost pixels are NaN, and ``sensor`` is its model as JSON text.
    """

    name: ClassVar[str] = "npz"
    outputs: ClassVar[Collection[str]] = ANY_OUTPUT
    default_outputs: ClassVar[tuple[str, ...]] = ("depth",)

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        """Write the file of a shard."""
        plan, part = self.plan, self.plan.shard_slice(shard)
        metadata = {
            **_camera_arrays(plan.camera),
            "camera_to_world": plan.frames.camera_to_world[part],
            "timestamps": plan.frames.timestamps[part],
            "frame": np.arange(part.start, part.stop),
        }
        if plan.sensor is not None:
            metadata["sensor"] = np.array(json.dumps(sensor_to_fields(plan.sensor)))
        name = f"shard-{shard_name(shard)}.npz"
        files.write(name, *npz_parts({**images, **metadata}))
        return [name]


def _camera_arrays(camera: ImageCamera) -> dict[str, np.ndarray]:
    """Return ``K`` of a pinhole camera; for a lens, ``camera``, JSON for `load_camera`, and OpenCV's intrinsics."""
    intrinsics = opencv_intrinsics(camera)
    if as_pinhole(camera) is not None:
        return {"K": intrinsics["K"]}
    return {**intrinsics, "camera": np.array(json.dumps(camera.to_dict()))}


def npz_parts(arrays: Mapping[str, np.ndarray]) -> list[memoryview]:
    """Return the parts of an uncompressed ``.npz`` file; its bytes depend only on the arrays.

    The data of large arrays begins at multiples of `ALIGNMENT` bytes.
    """
    parts = _Parts()
    with zipfile.ZipFile(parts, "w") as archive:
        for name, array in arrays.items():
            array = np.asarray(array, order="C")
            header = io.BytesIO()
            np.lib.format.write_array_header_1_0(header, np.lib.format.header_data_from_array_1_0(array))
            entry = zipfile.ZipInfo(f"{name}.npy", _EPOCH)
            entry.create_system = 3
            if array.nbytes >= MIN_DIRECT:
                entry.extra = _padding(parts.tell() + _HEADER_BYTES + len(entry.filename) + len(header.getvalue()))
            with archive.open(entry, "w", force_zip64=True) as stream:
                stream.write(header.getvalue())
                stream.write(array.reshape(-1).view(np.uint8).data)
    return parts.parts


# Size of a local header of a ZIP entry, with the 64-bit sizes that `force_zip64` adds.
_HEADER_BYTES = 30 + 20


def _padding(end: int) -> bytes:
    """Return an extra field that moves the offset `end` to a multiple of `ALIGNMENT`."""
    length = (-end - 4) % ALIGNMENT
    return _PADDING_ID.to_bytes(2, "little") + length.to_bytes(2, "little") + bytes(length)


class _Parts(io.RawIOBase):
    """A stream that stores references to the written data without copying it."""

    def __init__(self) -> None:
        self.parts: list[memoryview] = []
        self._size = 0

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return False

    def tell(self) -> int:
        return self._size

    def write(self, data: ReadableBuffer) -> int:
        part = memoryview(data)
        self.parts.append(part)
        self._size += part.nbytes
        return part.nbytes
