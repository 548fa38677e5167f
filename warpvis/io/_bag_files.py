# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of ROS 1 and ROS 2 bags, read without ROS."""

from __future__ import annotations

import io
import os
import threading
import weakref
from collections.abc import Iterable, Iterator
from functools import cached_property
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
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""Message types of tf, of tf2 and of tf, which older bags of ROS 1 have."""


class _BoundedFile(io.BufferedReader):
    """A file whose reads allocate at most its size, since lengths in a damaged bag may be anything."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self._size = os.path.getsize(path)

    def read(self, size: int | None = -1) -> bytes:
        remaining = max(self._size - self.tell(), 0)
        return super().read(remaining if size is None or size < 0 else min(size, remaining))


class _BoundedPath(type(Path())):  # type: ignore[misc]
    """A path that rosbags opens as a `_BoundedFile`."""

    def open(self, mode: str = "r", *options: Any, **more: Any) -> Any:
        return _BoundedFile(self) if mode == "rb" else super().open(mode, *options, **more)


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag: a file with its suffix, or a folder of ROS 2."""
    return path.suffix.lower() in BAG_SUFFIXES if path.is_file() else (path / "metadata.yaml").is_file()


class _OpenBag:
    """A bag that a thread of a process opened; it is closed when this object is no longer referenced."""

    def __init__(self, reader: Any) -> None:
        self.reader = reader
        self.process = os.getpid()
        # Not left to the garbage collector: connections of rosbags refer to their reader, which refers to them.
        weakref.finalize(self, reader.close)


class BagFile:
    """A bag, which every thread of every process opens when it reads the first message.

    It is closed when the thread ends, or when the `BagFile` is no longer referenced.
    """

    def __init__(self, path: Path) -> None:
        """Choose the bag; a folder must have ``metadata.yaml``."""
        if path.is_dir() and not (path / "metadata.yaml").is_file():
            raise FileFormatError(f"{path}: is a folder without metadata.yaml, so it is not a ROS 2 bag")
        self.path = path
        self._is_ros1 = path.suffix.lower() == ".bag" and path.is_file()
        self._local = threading.local()

    def __reduce__(self) -> tuple[type[BagFile], tuple[Path]]:
        return BagFile, (self.path,)

    @property
    def topics(self) -> dict[str, str]:
        """Message type of every topic; the first one if publishers had several."""
        return {item.topic: item.msgtype for item in reversed(self._reader.connections)}

    def messages(
        self, topics: Iterable[str], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[str, int, Message]]:
        """Yield topic, time of the bag [ns] and message, in the order of the times, from `start` to before `stop`."""
        reader, names, kinds = self._reader, set(topics), self.topics
        found = [item for item in reader.connections if item.topic in names and item.msgtype == kinds[item.topic]]
        if found:  # without connections, rosbags yields all messages
            for connection, time, data in reader.messages(found, start, stop):
                yield connection.topic, time, self._deserialize(data, connection.msgtype)

    def message(self, topic: str, time: int, number: int) -> Message:
        """Return a message, by its time in the bag [ns] and its number among those of the topic with this time."""
        found = next(islice(self.messages([topic], time, time + 1), number, None), None)
        if found is None:
            raise FileFormatError(f"{self.path}: topic {topic} has no message at {time} ns")
        return found[2]

    def first(self, topic: str) -> Message | None:
        """Return the first message of a topic; None if it has none."""
        return next((message for _, _, message in self.messages([topic])), None)

    def close(self) -> None:
        """Close the bag in this thread."""
        self._local.opened = None

    @property
    def _reader(self) -> Any:
        opened = getattr(self._local, "opened", None)
        if opened is None or opened.process != os.getpid():  # a forked process must not share a file's position
            opened = self._local.opened = _OpenBag(self._open())
        return opened.reader

    def _open(self) -> Any:
        require_package("rosbags.rosbag2", f"{self.path}: ROS bags are read with rosbags", "ros")
        from rosbags import rosbag1, rosbag2

        require_content(self.path, "a ROS bag", images=False)
        check_mcap(self.path)
        reader: Any = (rosbag1 if self._is_ros1 else rosbag2).Reader(_BoundedPath(self.path))
        reader.open()
        return reader

    @cached_property
    def _types(self) -> Any:
        """The types of messages; definitions in the bag are not read, since one of any topic may be malformed."""
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        store = get_typestore(Stores.ROS1_NOETIC if self._is_ros1 else Stores.LATEST)
        for kind in TRANSFORMS:
            store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", kind))
        return store

    def _deserialize(self, data: bytes, kind: str) -> Message:
        from rosbags.serde import SerdeError

        if not self._is_ros1:
            return self._types.deserialize_cdr(data, kind)
        try:
            return self._types.deserialize_ros1(data, kind)
        except SerdeError:
            if kind != IMAGE:
                raise
            # The RealSense SDK appends the length of a unit of depth, float32, to images.
            return self._types.deserialize_ros1(data[:-4], kind)
