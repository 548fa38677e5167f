# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth of LeRobot datasets: videos of 12 bits with logarithmic quantization, and TIFF in Parquet files.

Source: https://github.com/huggingface/lerobot at 7427f31801f944f5ec9ce53cda02862ce7d1638b, src/lerobot/datasets:
depth_utils.py (`dequantize_depth`), video_utils.py (`decode_video_frames_pyav`), dataset_metadata.py, dataset_reader.py
and dataset_writer.py; and src/lerobot/configs/video.py (defaults of the quantization).
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.checks import is_number, truncate
from warpvis.core.file_content import read_json, reading, require_package
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.io._depth import decode_units, pixels_to_depth
from warpvis.io._files import shorten
from warpvis.io.recordings._found import MILLIMETERS, Found
from warpvis.io.recordings._poses import unknown_poses

_MAX_CODE = 4095
_PIXEL_FORMAT = "gray12le"
_DEFAULTS = {"depth_min": 0.01, "depth_max": 10.0, "shift": 3.5}
_UNITS = {"m": 1.0, "mm": MILLIMETERS}
_PNG = b"\x89PNG"


@dataclass(frozen=True, eq=False, kw_only=True)
class LeRobotFound(Found):
    """The frames of an episode; `depths` repeats its file."""

    feature: str
    first_row: int  # row of the first frame in the file
    start: float  # time of the first frame in a video [s]
    interval: float  # time between frames [s]
    depth_of_code: NDArray[np.float32] | None  # depth [m] of every code of a video; None for images
    stored_unit: float | None  # length of one unit of images [m]; None for that of their type

    def reader(self, camera: ImageCamera, unit: float | None) -> LeRobotReader:
        """Return the reader of the images."""
        if unit is not None and self.depth_of_code is not None:
            raise FileFormatError(f"{self.depths[0]}: unit= is not for videos of LeRobot, which are in meters")
        return LeRobotReader(self, unit)


@dataclass(frozen=True, eq=False)
class LeRobotReader:
    """Reads depth images from a video or a Parquet file."""

    found: LeRobotFound
    unit: float | None  # length of one unit of images [m]; None for that of the dataset

    def read_depth(self, index: int) -> NDArray[np.float32]:
        """Return a depth image [m]."""
        found, place = self.found, self.place(index)
        if found.depth_of_code is not None:
            assert found.timestamps is not None  # for type checkers: an episode has times
            time = found.start + float(found.timestamps[index])
            with reading(place, "a video of LeRobot"):
                codes = _decode(found.depths[index], place, time, 0.5 * found.interval)
            return found.depth_of_code[codes.clip(max=_MAX_CODE)]
        with reading(place, "an image of LeRobot"):
            data = self._images[index].as_py()["bytes"]
        if not data:
            raise FileFormatError(f"{place}: the dataset has no image, only its name")
        pixels = decode_units(io.BytesIO(data), "PNG" if data.startswith(_PNG) else "TIFF", place)
        unit = self.unit or found.stored_unit
        return pixels_to_depth(pixels, unit or MILLIMETERS, unit)

    def read_color(self, index: int) -> NDArray[np.uint8] | None:
        """Return None: LeRobot does not define which color image has the pixels of a depth image."""
        return None

    def place(self, index: int) -> str:
        """Return the file and the number of a depth image in the episode."""
        return f"{self.found.depths[index]}: {self.found.feature}, frame {index} of the episode"

    @cached_property
    def _images(self) -> Any:
        """The encoded images of the episode."""
        found = self.found
        table = _table(found.depths[0], [found.feature])
        return table.column(found.feature).slice(found.first_row, len(found.depths)).combine_chunks()


def is_lerobot(path: Path) -> bool:
    """Return whether a folder is a LeRobot dataset."""
    return (path / "meta" / "info.json").is_file()


def read_lerobot(path: Path, topic: str | None, episode: int | None) -> LeRobotFound:
    """Read the times of an episode, and the place of its depth images.

    Args:
        path: The dataset.
        topic: The feature with depth images; not needed if only one is.
        episode: Index of the episode; not needed if there is only one.
    """
    place = path / "meta" / "info.json"
    info: Any = read_json(place)
    if not isinstance(info, Mapping) or not isinstance(info.get("features"), Mapping):
        raise FileFormatError(f"{place}: must be an object with features, got {shorten(info)}")
    version = info.get("codebase_version")
    if not str(version).startswith("v3."):
        raise FileFormatError(
            f"{place}: must be of a LeRobot dataset v3, got {shorten(version)}; convert it by lerobot"
        )
    features: Mapping[str, Any] = info["features"]
    feature = _choose_feature(path, features, topic)
    row = _episode(path, episode)
    is_video = features[feature].get("dtype") == "video"
    with reading(place, "a LeRobot dataset"):
        data = _file(path, info, "data_path", row, "data")
        table = _table(data, ["episode_index", "timestamp"])
        rows = np.flatnonzero(table.column("episode_index").to_numpy() == row["episode_index"])
        times = table.column("timestamp").to_numpy()[rows].astype(np.float64)
        images = _file(path, info, "video_path", row, f"videos/{feature}") if is_video else data
        start = float(row[f"videos/{feature}/from_timestamp"]) if is_video else 0.0
        interval = 1 / float(info["fps"])
    if not len(rows) or len(rows) != rows[-1] + 1 - rows[0] or not np.isfinite(times).all():
        raise FileFormatError(f"{data}: has no frames with times of episode {row['episode_index']} in a row")
    details = features[feature].get("info")
    details = details if isinstance(details, Mapping) else {}
    unit = details.get("depth_unit")
    if unit is not None and unit not in tuple(_UNITS):
        raise FileFormatError(f"{place}: depth_unit of {feature} must be 'm' or 'mm', got {shorten(unit)}")
    return LeRobotFound(
        [images] * len(rows),
        unknown_poses(len(rows)),
        timestamps=times,
        details={"topic": feature, "episode": int(row["episode_index"])},
        feature=feature,
        first_row=int(rows[0]),
        start=start,
        interval=interval,
        depth_of_code=_depth_of_code(details, f"{place}: {feature}") if is_video else None,
        stored_unit=None if unit is None else _UNITS[unit],
    )


def _choose_feature(path: Path, features: Mapping[str, Any], topic: str | None) -> str:
    """Return `topic` or the only feature that is marked as depth."""
    depths = [name for name, feature in features.items() if isinstance(feature, Mapping) and _is_depth(feature)]
    listed = truncate(", ".join(depths), 500) or "none"
    if topic is not None and topic not in depths:
        raise FileFormatError(f"{path}: {topic!r} is not a feature of depth images; these are: {listed}")
    if topic is None and len(depths) != 1:
        problem = "several features of depth images; choose one as topic=" if depths else "no feature of depth images"
        raise FileFormatError(
            f"{path}: the dataset has {problem}: {listed if depths else truncate(', '.join(features))}"
        )
    return topic or depths[0]


def _is_depth(feature: Mapping[str, Any]) -> bool:
    info, old = ({} if not isinstance(feature.get(name), Mapping) else feature[name] for name in ("info", "video_info"))
    marks = (info.get("is_depth_map"), info.get("video.is_depth_map"), old.get("video.is_depth_map"))
    return feature.get("dtype") in ("video", "image") and any(mark is True for mark in marks)


def _episode(path: Path, episode: int | None) -> Mapping[str, Any]:
    """Return the row of an episode in the metadata."""
    files = sorted((path / "meta" / "episodes").glob("*/*.parquet"))
    tables = [_table(file, None) for file in files]
    with reading(path / "meta" / "episodes", "episodes of LeRobot"):
        numbers = [int(number) for table in tables for number in table.column("episode_index").to_pylist()]
        if episode is None and len(numbers) != 1:
            raise FileFormatError(f"{path}: the dataset has {len(numbers)} episodes; choose one as episode=")
        number = numbers[0] if episode is None else episode
        if number not in numbers:
            raise FileFormatError(f"{path}: episode must be from 0 to {len(numbers) - 1}, got {number}")
        row = numbers.index(number)
        for table in tables:
            if row < table.num_rows:
                return {name: table.column(name)[row].as_py() for name in table.column_names if "stats/" not in name}
            row -= table.num_rows
    raise AssertionError  # an index of `numbers` is in a table


def _file(path: Path, info: Mapping[str, Json], template: str, row: Mapping[str, Any], prefix: str) -> Path:
    """Return the file of an episode from a template of the metadata."""
    indices = {name: int(row[f"{prefix}/{name}"]) for name in ("chunk_index", "file_index")}
    return path / str(info[template]).format(video_key=prefix.partition("/")[2], **indices)


def _table(path: Path, columns: list[str] | None) -> Any:
    parquet = require_package("pyarrow.parquet", f"{path}: LeRobot datasets are read with pyarrow", "lerobot")
    with reading(path, "Parquet"):
        with parquet.ParquetFile(path) as file:
            return file.read(columns=columns)


def _depth_of_code(info: Mapping[str, Any], place: str) -> NDArray[np.float32]:
    """Return the depth of every code of 12 bits [m], shape ``(4096,)``.

    With ``use_log``, it is ``exp(log(min + shift) + code / 4095 log((max + shift) / (min + shift))) - shift``, else
    linear in the code. The first and the last code are no depth, since the encoder replaces what is nearer or not
    measured by the minimum, and what is farther by the maximum.
    """
    given = {name: info.get(f"video.{name}") for name in (*_DEFAULTS, "use_log")}
    values: dict[str, Any] = {name: _DEFAULTS[name] if given[name] is None else given[name] for name in _DEFAULTS}
    if not all(is_number(value) and math.isfinite(value) for value in values.values()):
        raise FileFormatError(f"{place}: depth_min, depth_max and shift must be finite numbers, got {shorten(values)}")
    low, high, shift = (float(values[name]) for name in _DEFAULTS)
    use_log = True if given["use_log"] is None else bool(given["use_log"])
    if not 0 <= low < high or (use_log and low + shift <= 0):
        raise FileFormatError(
            f"{place}: depth_min must be from 0 m to below depth_max, and depth_min + shift above 0 m, got depth_min "
            f"{low:g}, depth_max {high:g} and shift {shift:g}"
        )
    part = np.arange(_MAX_CODE + 1) / _MAX_CODE
    if use_log:
        depth = np.exp(math.log(low + shift) + part * math.log((high + shift) / (low + shift))) - shift
    else:
        depth = low + part * (high - low)
    depth[[0, -1]] = np.nan
    return depth.astype(np.float32)


def _decode(path: Path, place: str, time: float, tolerance: float) -> NDArray[np.uint16]:
    """Return the codes of the frame of a video that is nearest to a time [s]."""
    av = require_package("av", f"{path}: videos of LeRobot are decoded with PyAV", "lerobot")
    best, nearest = None, math.inf
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        if stream.pix_fmt != _PIXEL_FORMAT:
            raise FileFormatError(f"{path}: depth must be a video of {_PIXEL_FORMAT}, got {stream.pix_fmt}")
        container.seek(max(round(time / stream.time_base) - 1, 0), stream=stream)
        for frame in container.decode(stream):
            if frame.pts is None:
                continue
            distance = abs(float(frame.pts * stream.time_base) - time)
            if distance >= nearest:
                break
            best, nearest = frame, distance
        if best is None or nearest > tolerance:
            raise FileFormatError(f"{place}: the video has no frame at {time:.4f} s")
        plane = best.planes[0]
        rows = np.frombuffer(plane, "<u2").reshape(-1, plane.line_size // 2)
        return rows[: best.height, : best.width].copy()
