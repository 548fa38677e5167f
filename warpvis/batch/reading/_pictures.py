# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Readers of formats with a file a frame: PNG files of depth, labels and objects, and COLMAP's maps."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.batch._job import shard_name
from warpvis.batch.reading._files import Files, Recent
from warpvis.batch.reading._job import FrameSpec, Job
from warpvis.batch.reading._shards import number
from warpvis.core.checks import describe_exception
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.io import missing_units

Column: TypeAlias = dict[str, NDArray]

_MILLIMETRES = 1000.0
_BOP_COUNTS = {
    "visible_fraction": ("visib_fract", np.float32),
    "visible_pixels": ("px_count_visib", np.int32),
    "silhouette_pixels": ("px_count_all", np.int32),
}
"""What BOP's ``scene_gt_info.json`` says of every object, and under which key."""


class PngReader:
    """Reads ``depth/000012/000000.png`` and the like: formats ``png``, ``tum`` and ``nerfstudio``.

    0 and 65535 are no depth, and become +inf: whether something was too near is not told.
    """

    scale: float = _MILLIMETRES
    """Units of a metre."""

    def __init__(self, files: Files, job: Job) -> None:
        """Prepare to read."""
        self._files, self._job, self._specs = files, job, job.specs()
        self._scale = job.option("scale", self.scale)

    def specs(self) -> Mapping[str, FrameSpec]:
        """List the arrays."""
        return self._specs

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Decode a frame's file."""
        image = self._decode(f"{self._folder(name, shard)}/{row:06d}.png")
        if name in ("depth", "true_depth"):
            _to_metres(image, self._scale, out)
        elif name == "segmentation":
            out[...] = image
            out -= 1
        else:
            out[...] = image

    def _folder(self, name: str, shard: int) -> str:
        return f"{name}/{shard_name(shard)}"

    def _decode(self, file: str) -> NDArray:
        from PIL import Image, UnidentifiedImageError

        data, place = self._files.read(file), f"{self._job.name}: {file}"
        size = (self._job.camera.height, self._job.camera.width)
        try:
            with Image.open(io.BytesIO(data), formats=("PNG",)) as picture:
                shape = picture.size[::-1]
                image = np.asarray(picture) if shape == size else None  # of any size, and any memory
        except UnidentifiedImageError:
            raise FileFormatError(f"{place} is damaged, or no PNG image") from None
        except Exception as error:  # each kind of damage has its own
            raise FileFormatError(f"{place} is damaged: {describe_exception(error)}") from None
        if image is None or image.shape != size:
            found = shape if image is None else image.shape
            raise FileFormatError(f"{place} is of shape {found}, and should be of {size}")
        return image


def _to_metres(units: NDArray, scale: float, out: NDArray) -> None:
    units = units.astype(np.uint16, copy=False)  # some versions of Pillow have 32 bits
    np.divide(units, scale, out=out, casting="unsafe")
    out[missing_units(units)] = np.inf


class TumReader(PngReader):
    """The same of 5000 units a metre."""

    scale = 5000.0


class BopReader(PngReader):
    """Reads depth of BOP's scenes, and what ``scene_gt_info.json`` says of the objects."""

    def __init__(self, files: Files, job: Job) -> None:
        """Prepare to read."""
        super().__init__(files, job)
        self._scale = _MILLIMETRES / job.option("depth_scale", 1.0)
        self._split = str(job.options.get("split", "train"))
        self._specs = {name: spec for name, spec in self._specs.items() if name == "depth" or name in _BOP_COUNTS}
        self._counts = Recent[Column](files.most)

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Decode a frame's depth, or look its objects up."""
        if name == "depth":
            super().read_into(name, shard, row, out)
        else:
            out[...] = self._counts.get(shard, lambda: self._read_counts(shard))[name][row]

    def _folder(self, name: str, shard: int) -> str:
        return f"{self._split}/{shard_name(shard)}/{name}"

    def _read_counts(self, shard: int) -> Column:
        file = f"{self._split}/{shard_name(shard)}/scene_gt_info.json"
        where = f"{self._job.name}: {file}"
        shape = (self._job.shard_length(shard), len(self._job.visibility_objects))
        try:
            content: dict[str, list[dict[str, Json]]] = json.loads(self._files.read(file))
            rows = [content[str(row)] for row in range(shape[0])]
            if any(len(row) != shape[1] for row in rows):
                raise ValueError(f"expected {shape[1]} objects in each image")
            return {
                name: np.array([[number(item[key], where) for item in row] for row in rows], dtype=dtype).reshape(shape)
                for name, (key, dtype) in _BOP_COUNTS.items()
            }
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            raise FileFormatError(f"{where} is damaged: {describe_exception(error)}") from None


class ColmapReader:
    """Reads COLMAP's depth and normal maps; normals are turned into the world's frame again."""

    def __init__(self, files: Files, job: Job, rotations: NDArray[np.float64]) -> None:
        """Prepare to read.

        Args:
            files: The files.
            job: The job.
            rotations: Camera to world of every frame, shape ``(frames, 3, 3)``.
        """
        self._files, self._job, self._specs, self._rotations = files, job, job.specs(), rotations

    def specs(self) -> Mapping[str, FrameSpec]:
        """List the arrays."""
        return self._specs

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Read a frame's map."""
        kind = "depth_maps" if name == "depth" else "normal_maps"
        file = f"stereo/{kind}/{shard_name(shard)}/{row:06d}.png.geometric.bin"
        channels = 1 if name == "depth" else 3
        camera, data = self._job.camera, self._files.read(file)
        head = f"{camera.width}&{camera.height}&{channels}&".encode()
        if not data.startswith(head) or len(data) - len(head) != 4 * channels * camera.width * camera.height:
            raise FileFormatError(f"{self._job.name}: {file} is damaged: its size or its head is another")
        values = np.frombuffer(data, dtype="<f4", offset=len(head)).reshape(channels, camera.height, camera.width)
        if name == "depth":
            out[...] = values[0]
            out[values[0] == 0] = np.inf
            return
        rotation = self._rotations[shard * self._job.shard_frames + row].astype(np.float32)
        out[...] = values.transpose(1, 2, 0) @ rotation.T
        out[(values == 0).all(axis=0)] = np.nan
