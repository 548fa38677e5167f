# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""COLMAP's models: cameras and world-to-camera poses, as text and binary.

Format: https://colmap.github.io/format.html and https://colmap.github.io/cameras.html
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from warpvis.cameras import ImageCamera
from warpvis.cameras.lenses import COLMAP_NUMBERS, COLMAP_PINHOLES, colmap_count, lens_from_colmap
from warpvis.core.checks import truncate
from warpvis.errors import FileFormatError
from warpvis.io._files import read_lines
from warpvis.io.cameras._making import NoPinholeError, choose, make_camera, one_camera


class ColmapImage(NamedTuple):
    """An image of a model: its name, its camera, and the pose world to camera."""

    name: str
    camera: int
    rotation: tuple[float, ...]
    """``w x y z``."""
    translation: tuple[float, ...]


def colmap_camera(path: Path, name: str = "", used: set[int] | None = None, *, distortion: bool) -> ImageCamera | None:
    """Read the camera of ``cameras.txt`` or ``cameras.bin``.

    Args:
        path: The file.
        name: Id of the camera, which is required if there are several.
        used: Ids of the cameras of images, which share a camera; if they do not, warn and return None.
        distortion: See `make_camera`.
    """
    rows = list(_binary_rows(path) if path.suffix == ".bin" else _text_rows(path))
    chosen = [row for row in rows if used is None or row.number in used]
    if not chosen:
        raise FileFormatError(f"{path}: holds no camera" + (" of the images" if rows else ""))
    if name:
        choose(path, [str(row.number) for row in rows], name)
        chosen = [row for row in rows if str(row.number) == name]
    kinds = {(row.model, row.size, tuple(row.parameters)): row for row in chosen}
    example = "" if used is not None else str(rows[0].number)
    return one_camera((_make(row, distortion) for row in kinds.values()), str(path), example)


def _make(row: _Row, distortion: bool) -> ImageCamera:
    problem = "" if row.model in COLMAP_PINHOLES else f"camera model {row.model}"
    make_lens = partial(lens_from_colmap, row.model, row.parameters)
    return make_camera(row.place, row.size, make_lens, distortion=distortion, model=problem)


def colmap_images(path: Path) -> list[ColmapImage]:
    """Read ``images.txt`` or ``images.bin``, sorted by the images' names."""
    images = list(_binary_images(path) if path.suffix == ".bin" else _text_images(path))
    return sorted(images, key=lambda image: image.name)


class _Row(NamedTuple):
    """A camera of a file, and its location in messages."""

    number: int
    place: str
    model: str
    size: tuple[int, int]
    parameters: list[float]


def _text_rows(path: Path) -> Iterator[_Row]:
    for number, line in enumerate(read_lines(path, "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]"), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        place = f"{path}:{number}"
        try:
            index, model, width, height = int(words[0]), words[1], int(words[2]), int(words[3])
            parameters = [float(word) for word in words[4:]]
        except (IndexError, ValueError):
            expected = "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]"
            raise FileFormatError(f"{place}: expected {expected}, got {truncate(line)!r}") from None
        yield _Row(index, place, model, (width, height), parameters)


def _text_images(path: Path) -> Iterator[ColmapImage]:
    """Yield the images; each line is followed by a line of points, which may be empty."""
    lines = enumerate(read_lines(path, "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"), start=1)
    for number, line in lines:
        words = line.split(maxsplit=9)
        if not words or words[0].startswith("#"):
            continue
        try:
            numbers = [float(word) for word in words[1:8]]
            yield ColmapImage(words[9].strip(), int(words[8]), tuple(numbers[:4]), tuple(numbers[4:]))
        except (IndexError, ValueError):
            expected = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"
            raise FileFormatError(f"{path}:{number}: expected {expected}, got {truncate(line, 60)!r}") from None
        next(lines, None)


class _Bytes:
    """A sequential reader of a binary file."""

    def __init__(self, path: Path) -> None:
        try:
            self._data = path.read_bytes()
        except OSError as error:
            raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
        self._path, self._place = path, 0

    def take(self, layout: str) -> tuple[float, ...]:
        try:
            values = struct.unpack_from(f"<{layout}", self._data, self._place)
        except struct.error:
            raise FileFormatError(f"{self._path}: is truncated, or not a COLMAP file") from None
        self._place += struct.calcsize(f"<{layout}")
        return values

    def skip(self, count: int) -> None:
        self._place = min(self._place + count, len(self._data))

    def text(self) -> str:
        end = self._data.find(b"\0", self._place)
        if end < 0:
            raise FileFormatError(f"{self._path}: is truncated, or not a COLMAP file")
        text, self._place = self._data[self._place : end].decode(errors="replace"), end + 1
        return text


def _binary_rows(path: Path) -> Iterator[_Row]:
    data = _Bytes(path)
    (count,) = data.take("Q")
    for _ in range(int(count)):
        index, model, width, height = (int(value) for value in data.take("iiQQ"))
        name, place = COLMAP_NUMBERS.get(model, ""), f"{path}: camera {index}"
        if not name:
            raise NoPinholeError(f"{place}: camera model number {model} is not a pinhole")
        yield _Row(index, place, name, (width, height), list(data.take(f"{colmap_count(name)}d")))


def _binary_images(path: Path) -> Iterator[ColmapImage]:
    data = _Bytes(path)
    (count,) = data.take("Q")
    for _ in range(int(count)):
        _, *numbers, camera = data.take("I7di")
        name = data.text()
        (points,) = data.take("Q")
        data.skip(24 * int(points))
        yield ColmapImage(name, int(camera), tuple(numbers[:4]), tuple(numbers[4:]))
