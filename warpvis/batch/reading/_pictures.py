# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Readers of images: files of color, depth, labels and objects, COLMAP's maps, and images in ROS 2 bags."""

from __future__ import annotations

import contextlib
import io
import json
import os
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.batch._job import shard_name
from warpvis.batch.formats._ros2 import color_topic, image_topic
from warpvis.batch.reading._job import Job
from warpvis.batch.reading._shards import Files, Recent, ShardReader, number
from warpvis.batch.storage._stores import LocalStore
from warpvis.core.checks import describe_exception
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.io import COLOR_SUFFIXES, BagFile, color_pixels, from_image_msg, missing_units

Column: TypeAlias = dict[str, NDArray]

_MILLIMETERS_PER_METER = 1000.0
# Bags are read sequentially. All images of an output of this number of recent bags are cached.
_BAGS = 2
_BOP_COUNTS = {
    "visible_fraction": ("visib_fract", np.float32),
    "visible_pixels": ("px_count_visib", np.int32),
    "silhouette_pixels": ("px_count_all", np.int32),
}
"""Arrays of visibility in BOP's ``scene_gt_info.json``: key and dtype."""


class PictureReader(ShardReader):
    """Base class of readers of color images in files such as ``images/000012/000000.jpg``."""

    color_folder: ClassVar[str] = "images"
    """Folder of the output ``color``."""

    def __init__(self, files: Files, job: Job) -> None:
        super().__init__(files, job)
        self._color_suffix = COLOR_SUFFIXES.get(str(job.options.get("color", "png")), ".png")

    def _folder(self, name: str, shard: int) -> str:
        """Return the folder of the images of an output."""
        return f"{self.color_folder if name == 'color' else name}/{shard_name(shard)}"

    def _read_color(self, name: str, shard: int, row: int, out: NDArray) -> None:
        file = f"{self._folder(name, shard)}/{row:06d}{self._color_suffix}"
        out[...] = self._decode(file, (3,), self._color_suffix.strip(".").upper().replace("JPG", "JPEG"))

    def _decode(self, file: str, channels: tuple[int, ...] = (), kind: str = "PNG") -> NDArray:
        """Decode a file, an image of the camera's size with the given number of `channels`."""
        from PIL import Image, UnidentifiedImageError

        data, path = self._files.read(file), f"{self._job.name}: {file}"
        size = (self._job.camera.height, self._job.camera.width, *channels)
        try:
            with Image.open(io.BytesIO(data), formats=(kind,)) as picture:
                shape = picture.size[::-1]
                image = np.asarray(picture) if shape == size[:2] else None  # do not decode images of unexpected size
        except UnidentifiedImageError:
            raise FileFormatError(f"{path} is damaged or not a {kind} image") from None
        except Exception as error:  # Pillow may raise any exception for damaged files
            raise FileFormatError(f"{path} is damaged: {describe_exception(error)}") from None
        if image is None or image.shape != size:
            actual = shape if image is None else image.shape
            raise FileFormatError(f"{path} must have shape {size}, got {actual}")
        return image


class PngReader(PictureReader):
    """Reads files such as ``depth/000012/000000.png`` of the formats ``png``, ``tum`` and ``nerfstudio``.

    Pixels without depth, 0 or 65535, become +inf, also where a surface was nearer than the camera's `near`.
    """

    color_folder = "color"
    scale: float = _MILLIMETERS_PER_METER
    """Units of depth per meter."""

    def __init__(self, files: Files, job: Job) -> None:
        super().__init__(files, job)
        self._scale = job.option("scale", self.scale)

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Decode the file of a frame."""
        if name in ("color", "albedo"):
            self._read_color(name, shard, row, out)
            return
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


class NerfstudioReader(PngReader):
    """Reads color from ``images``, and depth in millimeters."""

    color_folder = "images"


class TumReader(PngReader):
    """Reads color from ``rgb``, and depth with 5000 units per meter."""

    color_folder = "rgb"
    scale = 5000.0


class BopReader(PngReader):
    """Reads color and depth of BOP scenes, and visibility from ``scene_gt_info.json``."""

    color_folder = "rgb"

    def __init__(self, files: Files, job: Job) -> None:
        super().__init__(files, job)
        self._scale = _MILLIMETERS_PER_METER / job.option("depth_scale", 1.0)
        self._split = str(job.options.get("split", "train"))
        read = {"color", "depth", *_BOP_COUNTS}
        self.specs = {name: spec for name, spec in self.specs.items() if name in read}
        self._counts = Recent[Column](files.cache_size)

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Decode an image of a frame, or copy its visibility."""
        if name in ("color", "depth"):
            super().read_into(name, shard, row, out)
        else:
            out[...] = self._counts.get(shard, lambda: self._read_counts(shard))[name][row]

    def _folder(self, name: str, shard: int) -> str:
        return f"{self._split}/{shard_name(shard)}/{self.color_folder if name == 'color' else name}"

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


class ColmapReader(PictureReader):
    """Reads COLMAP's images, depth and normal maps; normals are rotated to the world frame."""

    def __init__(self, files: Files, job: Job, rotations: NDArray[np.float64]) -> None:
        """Prepare to read; `rotations` are from camera to world for all frames, shape ``(frames, 3, 3)``."""
        super().__init__(files, job)
        self._rotations = rotations

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Read an image or a map of a frame."""
        if name == "color":
            self._read_color(name, shard, row, out)
            return
        kind = "depth_maps" if name == "depth" else "normal_maps"
        file = f"stereo/{kind}/{shard_name(shard)}/{row:06d}{self._color_suffix}.geometric.bin"
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
    """Reads depth and color from ``bag_000012``; point clouds have the same depth and are not read."""

    def __init__(self, files: Files, job: Job) -> None:
        super().__init__(files, job)
        if not isinstance(files.store, LocalStore):
            raise FileFormatError(f"{job.name}: datasets of bags must be in a local folder, got a URL")
        try:
            import rosbags  # noqa: F401
        except ImportError:
            raise FileFormatError(f"{job.name}: reading bags requires rosbags: pip install 'warpvis[ros]'") from None
        self._root = files.store.root
        self.specs = {name: spec for name, spec in self.specs.items() if name in ("depth", "color")}
        topics = {
            "depth": "/" + str(job.options.get("topic", "/camera/depth")).strip("/"),
            "color": color_topic(job.options),
        }
        self._topics = {name: f"{topics[name]}/{image_topic(job.camera)}" for name in self.specs}
        self._bags = Recent[NDArray[Any]](_BAGS * max(1, len(self.specs)))

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Copy an image of a frame."""
        out[...] = self._bags.get((name, shard), lambda: self._read(name, shard))[row]

    def _read(self, name: str, shard: int) -> NDArray[Any]:
        bag = Path(os.fspath(self._root)) / f"bag_{shard_name(shard)}"
        length, spec = self._job.shard_length(shard), self.specs[name]
        images = np.empty((length, *spec.shape), dtype=spec.dtype)
        count = 0
        try:
            with contextlib.closing(BagFile(bag)) as file:
                for _, _, message in file.messages([self._topics[name]]):
                    if count < length:
                        images[count] = from_image_msg(message) if name == "depth" else color_pixels(message)
                    count += 1
        except Exception as error:  # rosbags may raise any exception for damaged bags
            raise FileFormatError(f"{self._job.name}: {bag.name} cannot be read: {describe_exception(error)}") from None
        if count != length:
            raise FileFormatError(f"{self._job.name}: {bag.name} must have {length} {name} images, got {count}")
        return images
