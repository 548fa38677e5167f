# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reader of depth images in ROS 2 bags, based on rosbags."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.batch._job import shard_name
from warpvis.batch.formats._ros2 import image_topic
from warpvis.batch.reading._files import Files, Recent
from warpvis.batch.reading._job import FrameSpec, Job
from warpvis.batch.storage._stores import LocalStore
from warpvis.core.checks import describe_exception
from warpvis.errors import FileFormatError
from warpvis.io import check_mcap, from_image_msg

# Bags are read sequentially. All depth images of this number of recent bags are cached.
_BAGS = 2


class BagReader:
    """Reads depth from ``bag_000012``; point clouds have the same depth and are not read."""

    def __init__(self, files: Files, job: Job) -> None:
        """Prepare to read."""
        if not isinstance(files.store, LocalStore):
            raise FileFormatError(f"{job.name}: datasets of bags must be in a local folder, got a URL")
        try:
            import rosbags.highlevel  # noqa: F401
        except ImportError:
            raise FileFormatError(f"{job.name}: reading bags requires rosbags: pip install 'warpvis[ros]'") from None
        self._root, self._job = files.store.root, job
        self._specs = {name: spec for name, spec in job.specs().items() if name == "depth"}
        self._topic = "/" + str(job.options.get("topic", "/camera/depth")).strip("/") + f"/{image_topic(job.camera)}"
        self._bags = Recent[NDArray[np.float32]](_BAGS)

    def specs(self) -> Mapping[str, FrameSpec]:
        """Return the arrays of a frame."""
        return self._specs

    def read_into(self, name: str, shard: int, row: int, out: NDArray) -> None:
        """Copy the depth of a frame."""
        out[...] = self._bags.get(shard, lambda: self._read(shard))[row]

    def _read(self, shard: int) -> NDArray[np.float32]:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        bag = Path(os.fspath(self._root)) / f"bag_{shard_name(shard)}"
        length, spec = self._job.shard_length(shard), self._specs["depth"]
        depth = np.empty((length, *spec.shape), dtype=spec.dtype)
        count = 0
        try:
            check_mcap(bag)
            with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
                images = [connection for connection in reader.connections if connection.topic == self._topic]
                for connection, _, data in reader.messages(connections=images):
                    if count < length:
                        depth[count] = from_image_msg(reader.deserialize(data, connection.msgtype))
                    count += 1
        except Exception as error:  # rosbags may raise any exception for damaged bags
            raise FileFormatError(f"{self._job.name}: {bag.name} cannot be read: {describe_exception(error)}") from None
        if count != length:
            raise FileFormatError(f"{self._job.name}: {bag.name} must have {length} depth images, got {count}")
        return depth
