# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth images of ROS 1 and ROS 2 bags, and of the RealSense SDK's recordings, which are bags, too."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import truncate
from warpvis.core.file_content import reading
from warpvis.core.messages import Message, stamp_nanoseconds
from warpvis.errors import FileFormatError, MessageError
from warpvis.io._bag_files import CAMERA_INFO, COMPRESSED_IMAGE, IMAGE, TRANSFORMS, BagFile
from warpvis.io._depth import pixels_to_depth
from warpvis.io._image_messages import color_pixels, depth_pixels, is_color, is_depth
from warpvis.io.cameras._making import one_camera
from warpvis.io.poses._ros_bags import camera_of_info
from warpvis.io.recordings._found import MILLIMETERS, Found, resample_color
from warpvis.io.recordings._poses import nearest
from warpvis.io.recordings._transforms import TransformTree, frame_name

_COMPRESSED = "/compressedDepth"
_MAX_LIST = 500
"""Maximum length of a list of topics in a message [characters]."""

# Topics of the RealSense SDK. Source: https://github.com/IntelRealSense/librealsense, src/media/ros/ros_file_format.h
_SDK_DEPTH = re.compile(r"(/device_\d+/sensor_\d+)/Depth_\d+/image/data")


class _Messages:
    """The messages of a topic of images, in the order of the bag."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.keys: list[tuple[int, int]] = []  # time in the bag [ns], and number among the messages with this time
        self._stamps: list[int] = []  # of the headers [ns]
        self._counts: Counter[int] = Counter()

    def add(self, time: int, message: Message) -> None:
        """Add a message."""
        self.keys.append((time, self._counts[time]))
        self._counts[time] += 1
        self._stamps.append(stamp_nanoseconds(message.header.stamp))

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of the headers [s], or if all are 0, of the bag."""
        return 1e-9 * np.array(self._stamps if any(self._stamps) else [time for time, _ in self.keys])


@dataclass(frozen=True, eq=False, kw_only=True)
class BagFound(Found):
    """The frames of a recording in a bag; `depths` repeats its path."""

    bag: BagFile
    depth: _Messages
    color: _Messages | None
    color_rows: NDArray[np.int64]  # index of the color image of every depth image, or -1

    def reader(self, camera: ImageCamera, unit: float | None) -> BagReader:
        """Return the reader of the images."""
        return BagReader(self, camera, unit)


@dataclass(frozen=True, eq=False)
class BagReader:
    """Reads depth and color images from a bag."""

    found: BagFound
    camera: ImageCamera
    unit: float | None  # length of one unit [m], also of floats; None for that of the format

    def read_depth(self, index: int) -> NDArray[np.float32]:
        """Return a depth image [m]."""
        try:
            pixels = depth_pixels(self._message(self.found.depth, index))
        except MessageError as error:
            raise FileFormatError(f"{self.place(index)}: {error}") from None
        return pixels_to_depth(pixels, self.found.unit if self.unit is None else self.unit, self.unit)

    def read_color(self, index: int) -> NDArray[np.uint8] | None:
        """Return a color image with the pixels of the depth image."""
        row, color = int(self.found.color_rows[index]), self.found.color
        if color is None or row < 0:
            return None
        place = f"{self.found.bag.path}: topic {color.topic}, image {row}"
        try:
            pixels = color_pixels(self._message(color, row))
        except MessageError as error:
            raise FileFormatError(f"{place}: {error}") from None
        return resample_color(pixels, self.found.color_camera, self.camera, place)

    def place(self, index: int) -> str:
        """Return the bag, the topic and the number of a depth image."""
        return f"{self.found.bag.path}: topic {self.found.depth.topic}, image {index}"

    def _message(self, messages: _Messages, index: int) -> Message:
        with reading(self.found.bag.path, "a ROS bag"):
            return self.found.bag.message(messages.topic, *messages.keys[index])


def read_bag_images(path: Path, topic: str | None, world_frame: str | None) -> BagFound:
    """Read the times, the camera and the poses of the depth images of a topic; images are read when accessed.

    All messages of depth, color and tf are read once. The frame of an image is its camera's optical frame, as
    ``sensor_msgs/Image`` defines it.
    """
    bag = BagFile(path)
    with reading(path, "a ROS bag"):
        kinds = bag.topics
        firsts = {name: bag.first(name) for name, kind in kinds.items() if kind in (IMAGE, COMPRESSED_IMAGE)}
        images = {name: message for name, message in sorted(firsts.items()) if message is not None}
        depth = _Messages(_choose_topic(path, images, kinds, topic))
        frame = frame_name(images[depth.topic].header.frame_id)
        sdk = _SDK_DEPTH.match(depth.topic)
        color = None if sdk else _choose_color(images, frame)
        tree, transforms = TransformTree(), {name for name, kind in kinds.items() if kind in TRANSFORMS}
        streams = {messages.topic: messages for messages in (depth, color) if messages is not None}
        for name, time, message in bag.messages([*streams, *transforms]):
            if name in streams:
                streams[name].add(time, message)
            else:
                tree.add(message, is_static=name.endswith("tf_static"))
        camera, source = _camera(bag, kinds, depth.topic, frame)
        color_camera = _camera(bag, kinds, color.topic, frame)[0] if color is not None else None
        unit = _sdk_unit(bag, kinds, sdk[1]) if sdk else MILLIMETERS
    try:
        poses, world = tree.poses_of(frame, depth.times, world_frame)
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from None
    return BagFound(
        [path] * len(depth.keys),
        poses,
        None,
        depth.times,
        camera,
        source,
        unit,
        color_camera if isinstance(color_camera, Camera) else None,
        {"topic": depth.topic, "color_topic": None if color is None else color.topic, "world_frame": world},
        bag=bag,
        depth=depth,
        color=color,
        color_rows=nearest(depth.times, np.array([]) if color is None else color.times),
    )


def _choose_topic(path: Path, images: Mapping[str, Message], kinds: Mapping[str, str], topic: str | None) -> str:
    """Return the topic of depth images: `topic`, or the only one, of those named so if some are."""
    # 16-bit infrared images have the encoding mono16, too.
    found = {
        name: getattr(message, "encoding", None) or message.format
        for name, message in images.items()
        if is_depth(message) and (getattr(message, "encoding", "") != "mono16" or "depth" in name.lower())
    }
    if topic is not None:
        if topic in images and is_depth(images[topic]):
            return topic
        listed = truncate(", ".join(found), _MAX_LIST) or "none"
        problem = "has no depth images" if topic in kinds else "is not in the bag"
        raise FileFormatError(f"{path}: topic {topic!r} {problem}; topics of depth images are: {listed}")
    named = {name for name in found if "depth" in name.lower()} or set(found)
    if len(named) == 1:
        return named.pop()
    if named:
        listed = truncate(", ".join(f"{name} ({found[name]})" for name in sorted(named)), _MAX_LIST)
        raise FileFormatError(f"{path}: the bag has several topics of depth images; choose one as topic=: {listed}")
    listed = truncate(", ".join(f"{name} ({kind})" for name, kind in sorted(kinds.items())), _MAX_LIST) or "no topics"
    raise FileFormatError(
        f"{path}: the bag has no topic of depth images, Image of 16UC1 or 32FC1, or compressedDepth: it has {listed}"
    )


def _choose_color(images: Mapping[str, Message], frame: str) -> _Messages | None:
    """Return the topic of color images in the frame of the depth images; color before gray, raw before compressed."""

    def rank(name: str) -> tuple[bool, bool, str]:
        return getattr(images[name], "encoding", "") == "mono8", hasattr(images[name], "format"), name

    found = [
        name for name, message in images.items() if is_color(message) and frame_name(message.header.frame_id) == frame
    ]
    return _Messages(min(found, key=rank)) if found else None


def _camera(bag: BagFile, kinds: Mapping[str, str], topic: str, frame: str) -> tuple[ImageCamera | None, str]:
    """Return the camera of a topic of images, from the CameraInfo beside it, else of those with its frame."""
    image = topic.removesuffix(_COMPRESSED).removesuffix("/compressed")
    parent = image.rpartition("/")[0]
    beside = [f"{parent}/camera_info", f"{image}/camera_info", f"{parent.removesuffix('/image')}/info/camera_info"]
    infos = [name for name, kind in kinds.items() if kind == CAMERA_INFO]
    messages: dict[str, Any] = {name: bag.first(name) for name in infos}
    found = next(([name] for name in beside if messages.get(name) is not None), None)
    if found is None:
        found = [name for name in infos if messages[name] and frame_name(messages[name].header.frame_id) == frame]
    name = image.rpartition("/")[2]
    is_raw = "raw" in name and "rect" not in name
    cameras = [camera_of_info(f"{bag.path}: {name}", messages[name], is_raw) for name in found]
    return one_camera([camera for camera in cameras if camera is not None], str(bag.path)), ", ".join(found)


def _sdk_unit(bag: BagFile, kinds: Mapping[str, str], sensor: str) -> float:
    """Return the length of a unit of depth in a recording of the RealSense SDK [m], 1 mm if it has none."""
    # Older versions of the SDK write a space; from 2.58 on, values are text.
    names = [f"{sensor}/option/{name}/value" for name in ("Depth_Units", "Depth Units")]
    option = next((bag.first(name) for name in names if name in kinds), None)
    unit = MILLIMETERS if option is None else float(option.data)
    if not 0 < unit < np.inf:
        raise FileFormatError(f"{bag.path}: Depth_Units must be above 0 m, got {unit}; pass unit=")
    return float(f"{unit:.6g}")  # as stored in single precision
