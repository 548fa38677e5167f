# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Zarr v3: one group, ``data.zarr``, with an array per output, a chunk per frame, and a file per shard.

zarr-python writes the metadata once at the beginning. The files of shards are written here, in the format of the codec
``sharding_indexed`` (https://zarr-specs.readthedocs.io/en/latest/v3/codecs/sharding-indexed/index.html): the chunks,
then an index with the offset and the length of each, uint64, and a CRC-32C of the index. Uncompressed images are
written directly from the memory to which they were rendered. zarr-python takes 4.3 s on one core to write a shard of
1 GB (3.1.6, 320x240 float32, uncompressed); this code takes 0.5 s, mostly for the checksum.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from warpvis.batch._job import Options, Plan, frame_arrays
from warpvis.batch.formats._base import ANY_OUTPUT, VISIBILITY_ARRAYS, Format, Images
from warpvis.batch.storage._output import FilePart, files_below
from warpvis.cameras import ImageCamera, as_pinhole, opencv_intrinsics
from warpvis.core.outputs import OUTPUTS
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.sensors import Reason, sensor_to_fields

if TYPE_CHECKING:
    import zarr
    from zarr.core.chunk_key_encodings import ChunkKeyEncodingParams

    from warpvis.batch.storage._output import ShardFiles

_GROUP = "data.zarr"
# "depth/c.12.0.0" instead of nested folders, whose creation takes time.
_KEYS: ChunkKeyEncodingParams = {"name": "default", "separator": "."}
_MISSING = np.uint64(2**64 - 1)
_DEFAULT_LEVEL = 1


class Zarr(Format):
    """Arrays indexed ``[view, y, x]`` and ``[view, object]``, and arrays of poses and times."""

    name: ClassVar[str] = "zarr"
    outputs: ClassVar[Collection[str]] = ANY_OUTPUT
    default_outputs: ClassVar[tuple[str, ...]] = ("depth",)
    library: str | None = "zarr numcodecs"
    options: ClassVar[Mapping[str, str]] = {"compression": "none, zstd", "level": "1 to 22"}

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        try:
            import zarr  # noqa: F401
        except ImportError:
            raise FileFormatError("format 'zarr' requires zarr: pip install 'warpvis[dataset]'") from None
        self._level = _parse_level(plan.options)
        self.encodes = self._level is not None

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        """Write one file per array."""
        units = []
        for name, array in images.items():
            unit = f"{_GROUP}/{name}/c.{shard}" + ".0" * (array.ndim - 1)
            if name in OUTPUTS:
                files.write(unit, *self._sharded(array))
            else:
                files.write(unit, _pad(array, self.plan.shard_frames))
            units.append(unit)
        return units

    def _sharded(self, array: np.ndarray) -> list[FilePart]:
        """Return the file of a shard: one chunk per frame, and the index of chunks."""
        import google_crc32c  # a dependency of zarr

        frames = len(array)
        chunks: list[FilePart] = [array]
        sizes = [array.nbytes // frames] * frames
        if self._level is not None:
            packed = self._compress(array)
            chunks, sizes = [*packed], [len(chunk) for chunk in packed]
        table = np.full((self.plan.shard_frames, 2), _MISSING, dtype="<u8")
        table[:frames, 1] = sizes
        table[:frames, 0] = np.cumsum([0, *sizes[:-1]])
        return [*chunks, table, google_crc32c.value(table.tobytes()).to_bytes(4, "little")]

    def _compress(self, array: np.ndarray) -> list[bytes]:
        from numcodecs.zstd import compress

        frames = [b""] * len(array)

        def compress_range(numbers: range) -> None:
            for frame in numbers:
                frames[frame] = compress(array[frame].reshape(-1).view(np.uint8), self._level)

        camera = self.plan.camera
        self.encode_each(len(array), camera.width * camera.height, compress_range)
        return frames

    def begin(self, files: ShardFiles) -> list[str]:
        """Write the metadata, and the arrays that are not in shards, so that unfinished datasets can be opened."""
        import zarr

        plan = self.plan
        group = zarr.create_group(files.folder / _GROUP, attributes=self._attributes(), overwrite=False)
        for name in plan.outputs:
            if name in OUTPUTS:
                self._create_image(group, name)
        if "visibility" in plan.outputs:
            self._create_visibility(group)
        for name, array in frame_arrays(plan.frames).items():
            _create_whole(group, name, array)
        return sorted(files_below(files.folder))

    def _create_image(self, group: zarr.Group, name: str) -> None:
        from zarr.codecs import ZstdCodec

        plan, spec = self.plan, OUTPUTS[name]
        vector = (len(spec.components),) if spec.components else ()
        image = (plan.camera.height, plan.camera.width, *vector)
        group.create_array(
            name,
            shape=(len(plan.frames), *image),
            chunks=(1, *image),
            shards=(plan.shard_frames, *image),
            dtype=spec.dtype,
            fill_value=spec.empty,
            chunk_key_encoding=_KEYS,
            compressors=None if self._level is None else ZstdCodec(level=self._level),
            dimension_names=("view", "y", "x", *([spec.components] if vector else [])),
        )

    def _create_visibility(self, group: zarr.Group) -> None:
        plan = self.plan
        for name, (dtype, last) in VISIBILITY_ARRAYS.items():
            group.create_array(
                name,
                shape=(len(plan.frames), len(plan.chosen), *last),
                chunks=(plan.shard_frames, len(plan.chosen), *last),
                dtype=dtype,
                fill_value=0,
                chunk_key_encoding=_KEYS,
                compressors=None,
                dimension_names=("view", "object", *(["xywh"] if last else [])),
            )

    def _attributes(self) -> dict[str, Json]:
        plan, camera = self.plan, self.plan.camera
        along = "planar, along z" if camera.kind == "z" else "range, along the ray"
        attributes: dict[str, Json] = {
            **_camera_attributes(camera),
            "camera_axes": "opencv: x right, y down, z forward",
            "camera_to_world": "rows x y z qx qy qz qw",
            "up": plan.up,
            "units": "meters",
            "depth": f"{along}; inf: nothing or beyond far; -inf: nearer than near",
            "labels": {plan.label_names.word(number): number for number in plan.label_names},
            "object_names": list(plan.object_names),
            "object_labels": list(plan.object_labels),
        }
        if plan.sensor is not None:
            attributes["depth"] = f"{attributes['depth']}; nan: lost by the sensor"
            attributes["sensor"], attributes["sensor_seed"] = sensor_to_fields(plan.sensor), plan.sensor_seed
        if "reasons" in plan.outputs:
            attributes["reasons"] = {reason.name: reason.value for reason in Reason}
        if "visibility" in plan.outputs:
            attributes["visibility_objects"] = [plan.object_names[index] for index in plan.chosen]
        return attributes


def _camera_attributes(camera: ImageCamera) -> dict[str, Json]:
    """Return attributes of the camera; for a lens, ``camera`` can be read by `load_camera`."""
    attributes: dict[str, Json] = {name: array.tolist() for name, array in opencv_intrinsics(camera).items()}
    if as_pinhole(camera) is None:
        attributes["camera"] = camera.to_dict()
    else:
        attributes["distortion"] = "none"
    far = camera.far if math.isfinite(camera.far) else None
    matrix = {"K": attributes.pop("K")} if "K" in attributes else {}
    return {**matrix, "pixel_center": 0.5, "near": camera.near, "far": far, **attributes}


def _create_whole(group: zarr.Group, name: str, array: np.ndarray) -> None:
    """Write an array in chunks of a few MB."""
    row = max(1, array[:1].nbytes)
    chunk = (min(len(array), max(1, (1 << 22) // row)), *array.shape[1:])
    stored = group.create_array(name, shape=array.shape, chunks=chunk, dtype=array.dtype, compressors=None)
    stored[...] = array


def _pad(array: np.ndarray, frames: int) -> np.ndarray:
    """Pad an array with zeros to `frames` frames, because the last chunk also has the full size."""
    if len(array) == frames:
        return array
    return np.concatenate([array, np.zeros((frames - len(array), *array.shape[1:]), dtype=array.dtype)])


def _parse_level(options: Options) -> int | None:
    """Return the level of Zstandard; None for no compression."""
    kind, level = options.get("compression", "none"), options.get("level", _DEFAULT_LEVEL)
    if kind not in ("none", "zstd"):
        raise FileFormatError(f"compression must be none or zstd, got {kind!r}")
    if kind == "none":
        if "level" in options:
            raise FileFormatError("level must be given only with compression=zstd, got compression=none")
        return None
    try:
        number = int(level)
    except (TypeError, ValueError):
        number = 0
    if not 1 <= number <= 22:
        raise FileFormatError(f"level must be a whole number from 1 to 22, got {level!r}")
    return number
