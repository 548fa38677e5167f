# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Readers of images: PNG files of depth, labels and objects, COLMAP's maps, and depth in ROS 2 bags."""

from __future__ import annotations

import contextlib
import io
import json
import os
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.batch._job import shard_name
from warpvis.batch.formats._ros2 import image_topic
from warpvis.batch.reading._job import Job
from warpvis.batch.reading._shards import Files, Recent, ShardReader, number
from warpvis.batch.storage._stores import LocalStore
from warpvis.core.checks import describe_exception
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.io import BagFile, from_image_msg, missing_units

Column: TypeAlias = dict[str, NDArray]

_MILLIMETERS_PER_METER = 1000.0
# Bags are read sequentially. All depth images of this number of recent bags are cached.
_BAGS = 2
_BOP_COUNTS = {
    "visible_fraction": ("visib_fract", np.float32),
    "visible_pixels": ("px_count_visib", np.int32),
    "silhouette_pixels": ("px_count_all", np.int32),
}
"""Arrays of visibility in BOP's ``scene_gt_info.json``: key and dtype."""


class PngReader(ShardReader):
    """Reads files such as ``depth/000012/000000.png`` of the formats ``png``, ``tum`` and ``nerfstudio``.

    Pixels without depth, 0 or 65535, become +inf, also where a surface was nearer than the camera's `near`.
    """

    scale: float = _MILLIMETERS_PER_METER
    """Units of depth per meter."""

    def __init__(self, files: Files, job: Job) -> None:
        super().__init__(files, job)
        self._scale = job.option("scale", self.scale)

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Decode the file of a frame."""
        image = self._decode(f"{self._folder(name, shard)}/{row:06d}.png")
        if name in ("depth", "true_depth"):
            units = image.astype(np.uint16, copy=False)  # some versions of Pillow return 32 bits
            np.divide(units, self._scale, out=out, casting="unsafe")
            out[missing_units(units)] = np.inf
        elif name == "segmentation":
            out[...] = image
            out -= 1
        else:
            out[...] = image

    def _folder(self, name: str, shard: int) -> str:
        return f"{name}/{shard_name(shard)}"

    def _decode(self, file: str) -> NDArray:
        from PIL import Image, UnidentifiedImageError

        data, path = self._files.read(file), f"{self._job.name}: {file}"
        size = (self._job.camera.height, self._job.camera.width)
        try:
            with Image.open(io.BytesIO(data), formats=("PNG",)) as picture:
                shape = picture.size[::-1]
                image = np.asarray(picture) if shape == size else None  # do not decode images of unexpected size
        except UnidentifiedImageError:
            raise FileFormatError(f"{path} is damaged or not a PNG image") from None
        except Exception as error:  # Pillow may raise any exception for damaged files
            raise FileFormatError(f"{path} is damaged: {describe_exception(error)}") from None
        if image is None or image.shape != size:
            actual = shape if image is None else image.shape
            raise FileFormatError(f"{path} must have shape {size}, got {actual}")
        return image


class TumReader(PngReader):
    """Reads depth with 5000 units per meter."""

    scale = 5000.0


class BopReader(PngReader):
    """Reads depth of BOP scenes, and visibility from ``scene_gt_info.json``."""

    def __init__(self, files: Files, job: Job) -> None:
        super().__init__(files, job)
        self._scale = _MILLIMETERS_PER_METER / job.option("depth_scale", 1.0)
        self._split = str(job.options.get("split", "train"))
        self.specs = {name: spec for name, spec in self.specs.items() if name == "depth" or name in _BOP_COUNTS}
        self._counts = Recent[Column](files.cache_size)

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Decode the depth of a frame, or copy its visibility."""
        if name == "depth":
            super().read_into(name, shard, row, out)
        else:
            out[...] = self._counts.get(shard, lambda: self._read_counts(shard))[name][row]

    def _folder(self, name: str, shard: int) -> str:
        return f"{self._split}/{shard_name(shard)}/{name}"

    def _read_counts(self, shard: int) -> Column:
        file = f"{self._split}/{shard_name(shard)}/scene_gt_info.json"
        place = f"{self._job.name}: {file}"
        shape = (self._job.shard_length(shard), len(self._job.visibility_objects))
        try:
            content: dict[str, list[dict[str, Json]]] = json.loads(self._files.read(file))
            rows = [content[str(row)] for row in range(shape[0])]
            if any(len(row) != shape[1] for row in rows):
                raise ValueError(f"expected {shape[1]} objects in each image")
            return {
                name: np.array([[number(item[key], place) for item in row] for row in rows], dtype=dtype).reshape(shape)
                for name, (key, dtype) in _BOP_COUNTS.items()
            }
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            raise FileFormatError(f"{place} is damaged: {describe_exception(error)}") from None


class ColmapReader(ShardReader):
    """Reads COLMAP's depth and normal maps; normals are rotated to the world frame."""

    def __init__(self, files: Files, job: Job, rotations: NDArray[np.float64]) -> None:
        """Prepare to read; `rotations` are from camera to world for all frames, shape ``(frames, 3, 3)``."""
        super().__init__(files, job)
        self._rotations = rotations

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Read the map of a frame."""
        kind = "depth_maps" if name == "depth" else "normal_maps"
        file = f"stereo/{kind}/{shard_name(shard)}/{row:06d}.png.geometric.bin"
        channels = 1 if name == "depth" else 3
        camera, data = self._job.camera, self._files.read(file)
        header = f"{camera.width}&{camera.height}&{channels}&".encode()
        if not data.startswith(header) or len(data) - len(header) != 4 * channels * camera.width * camera.height:
            raise FileFormatError(f"{self._job.name}: {file} is damaged: its size or its header is wrong")
        values = np.frombuffer(data, dtype="<f4", offset=len(header)).reshape(channels, camera.height, camera.width)
        if name == "depth":
            out[...] = values[0]
            out[values[0] == 0] = np.inf
            return
        rotation = self._rotations[shard * self._job.contents.shard_frames + row].astype(np.float32)
        out[...] = values.transpose(1, 2, 0) @ rotation.T
        out[(values == 0).all(axis=0)] = np.nan


class BagReader(ShardReader):
    """Reads depth from ``bag_000012``; point clouds have the same depth and are not read."""

    def __init__(self, files: Files, job: Job) -> None:
        super().__init__(files, job)
        if not isinstance(files.store, LocalStore):
            raise FileFormatError(f"{job.name}: datasets of bags must be in a local folder, got a URL")
        try:
            import rosbags  # noqa: F401
        except ImportError:
            raise FileFormatError(f"{job.name}: reading bags requires rosbags: pip install 'warpvis[ros]'") from None
        self._root = files.store.root
        self.specs = {name: spec for name, spec in self.specs.items() if name == "depth"}
        self._topic = "/" + str(job.options.get("topic", "/camera/depth")).strip("/") + f"/{image_topic(job.camera)}"
        self._bags = Recent[NDArray[np.float32]](_BAGS)

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Copy the depth of a frame."""
        out[...] = self._bags.get(shard, lambda: self._read(shard))[row]

    def _read(self, shard: int) -> NDArray[np.float32]:
        bag = Path(os.fspath(self._root)) / f"bag_{shard_name(shard)}"
        length, spec = self._job.shard_length(shard), self.specs["depth"]
        depth = np.empty((length, *spec.shape), dtype=spec.dtype)
        count = 0
        try:
            with contextlib.closing(BagFile(bag)) as file:
                for _, _, message in file.messages([self._topic]):
                    if count < length:
                        depth[count] = from_image_msg(message)
                    count += 1
        except Exception as error:  # rosbags may raise any exception for damaged bags
            raise FileFormatError(f"{self._job.name}: {bag.name} cannot be read: {describe_exception(error)}") from None
        if count != length:
            raise FileFormatError(f"{self._job.name}: {bag.name} must have {length} depth images, got {count}")
        return depth
