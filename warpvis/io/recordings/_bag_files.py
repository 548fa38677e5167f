# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of ROS 1 and ROS 2 bags, read without ROS."""

from __future__ import annotations

import io
import os
import threading
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from warpvis.core.file_content import require_content, require_package
from warpvis.core.messages import Message
from warpvis.errors import FileFormatError
from warpvis.io._files import check_mcap

BAG_SUFFIXES = (".bag", ".mcap", ".db3")
"""File name suffixes of bags: ROS 1, and ROS 2 with MCAP or sqlite3 storage."""

IMAGE, COMPRESSED_IMAGE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


class _BoundedFile(io.BufferedReader):
    """A file whose reads allocate at most its size, since lengths in a damaged bag may be anything."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self._size = os.path.getsize(path)

    def read(self, size: int | None = -1) -> bytes:
        remaining = max(self._size - self.tell(), 0)
        return super().read(remaining if size is None or size < 0 else min(size, remaining))


class _BoundedPath:
    """A path that rosbags opens as a `_BoundedFile`."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __getattr__(self, name: str) -> Any:
        return getattr(self._path, name)

    def __str__(self) -> str:
        return str(self._path)

    def open(self, *_: object) -> _BoundedFile:
        return _BoundedFile(self._path)


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag: a file with its suffix, or a folder of ROS 2."""
    return path.suffix.lower() in BAG_SUFFIXES if path.is_file() else (path / "metadata.yaml").is_file()


class BagFile:
    """A bag, which every thread of every process opens when it reads the first message."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._local = threading.local()

    def __reduce__(self) -> tuple[type[BagFile], tuple[Path]]:
        return BagFile, (self.path,)

    @property
    def topics(self) -> dict[str, str]:
        """Message type of every topic."""
        return {item.topic: item.msgtype for item in self._reader.connections}

    def messages(
        self, topics: Iterable[str], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[str, int, Message]]:
        """Yield topic, time of the bag [ns] and message, in the order of the times, from `start` to before `stop`."""
        reader, names = self._reader, set(topics)
        connections = [item for item in reader.connections if item.topic in names]
        if connections:
            for connection, time, data in reader.messages(connections, start, stop):
                yield connection.topic, time, self._deserialize(reader, data, connection.msgtype)

    def message(self, topic: str, time: int, number: int) -> Message:
        """Return a message, by its time in the bag [ns] and its number among those of the topic with this time."""
        found = next(islice(self.messages([topic], time, time + 1), number, None), None)
        if found is None:
            raise FileFormatError(f"{self.path}: topic {topic} has no message at {time} ns")
        return found[2]

    def first(self, topic: str) -> Message | None:
        """Return the first message of a topic; None if it has none."""
        return next((message for _, _, message in self.messages([topic])), None)

    @property
    def _reader(self) -> Any:
        if getattr(self._local, "process", None) != os.getpid():  # a forked process must not share a file's position
            self._local.reader, self._local.process = self._open(), os.getpid()
        return self._local.reader

    def _open(self) -> Any:
        require_package("rosbags.highlevel", f"{self.path}: bags are read with rosbags", "ros")
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        require_content(self.path, "a ROS bag", images=False)
        check_mcap(self.path)
        path: Any = _BoundedPath(self.path) if self.path.suffix == ".bag" else self.path
        reader = AnyReader([path], default_typestore=get_typestore(Stores.LATEST))
        reader.open()
        return reader

    def _deserialize(self, reader: Any, data: bytes, kind: str) -> Message:
        from rosbags.highlevel import AnyReaderError

        try:
            return reader.deserialize(data, kind)
        except AnyReaderError:
            if kind != IMAGE or reader.is2:
                raise
            # The RealSense SDK appends the length of a unit of depth, float32, to the images of its ROS 1 bags.
            return reader.deserialize(data[:-4], kind)
