# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 1 and ROS 2 bags with images of the room of `support.recordings`, CameraInfo and tf."""

import struct

import numpy as np
import pytest

from support.recordings import K_SMALL, SMALL, poses, rays, room_depth, rows

rosbag1, rosbag2 = pytest.importorskip("rosbags.rosbag1"), pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")

STORES = {name: typesys.get_typestore(typesys.Stores[name]) for name in ("ROS1_NOETIC", "ROS2_HUMBLE")}
STORES["ROS1_NOETIC"].register(
    typesys.get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
)
STORAGES = {"mcap": rosbag2.StoragePlugin.MCAP, "sqlite3": rosbag2.StoragePlugin.SQLITE3}
KINDS = ("ros1", *STORAGES)

START = 1_700_000_000_123_456_789
"""Time of the first image [ns]; images are 0.1 s apart, and are logged 30 ms after their stamps."""
FRAME = "camera_depth_optical_frame"


def stamps(count):
    return [START + index * 10**8 for index in range(count)]


class Bag:
    """Writes messages to a bag."""

    def __init__(self, path, kind="mcap"):
        self.ros1 = kind == "ros1"
        self.store = STORES["ROS1_NOETIC" if self.ros1 else "ROS2_HUMBLE"]
        self.path = path.with_suffix(".bag") if self.ros1 else path
        if self.ros1:
            self.writer = rosbag1.Writer(self.path)
            self.writer.set_compression(rosbag1.Writer.CompressionFormat.LZ4)
        else:
            self.writer = rosbag2.Writer(self.path, version=9, storage_plugin=STORAGES[kind])
        self.connections = {}

    def __enter__(self):
        self.writer.open()
        return self

    def __exit__(self, *_):
        self.writer.close()

    def make(self, kind, **fields):
        return self.store.types[kind](**fields)

    def add(self, topic, time, message, tail=b""):
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        data = (self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr)(message, kind)
        self.writer.write(self.connections[topic], time, bytes(data) + tail)

    def header(self, stamp, frame=FRAME):
        time = self.make("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
        number = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=("/" if self.ros1 else "") + frame, **number)

    def image(self, stamp, pixels, encoding, frame=FRAME):
        data = np.ascontiguousarray(pixels)
        return self.make(
            "sensor_msgs/msg/Image",
            header=self.header(stamp, frame),
            height=data.shape[0],
            width=data.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=data.strides[0],
            data=data.reshape(-1).view(np.uint8),
        )

    def compressed(self, stamp, data, text, frame=FRAME):
        fields = {"format": text, "data": np.frombuffer(data, dtype=np.uint8)}
        return self.make("sensor_msgs/msg/CompressedImage", header=self.header(stamp, frame), **fields)

    def info(self, stamp, k=K_SMALL, size=SMALL, frame=FRAME, d=(0.0,) * 5):
        fx, fy, cx, cy = k
        region = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
        values = {
            "d": np.array(d),
            "k": np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1]),
            "r": np.eye(3).ravel(),
            "p": np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]),
        }
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(stamp, frame),
            width=size[0],
            height=size[1],
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=self.make("sensor_msgs/msg/RegionOfInterest", **region),
            **{name.upper() if self.ros1 else name: value for name, value in values.items()},
        )

    def transforms(self, stamp, parent, child, row):
        position = self.make("geometry_msgs/msg/Vector3", **dict(zip("xyz", map(float, row[:3]), strict=True)))
        rotation = self.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", map(float, row[3:]), strict=True)))
        item = self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp, parent),
            child_frame_id=("/" if self.ros1 else "") + child,
            transform=self.make("geometry_msgs/msg/Transform", translation=position, rotation=rotation),
        )
        return self.make("tf2_msgs/msg/TFMessage", transforms=[item])


def room(stamp):
    """Return the depth of the room at a time [m], float32."""
    return room_depth(rays(K_SMALL, *SMALL), poses([1e-9 * (stamp - START)])[0]).astype(np.float32)


def add_tf(bag, count, step=10**7, root="map"):
    """Add tf, from the root to the moving base and by two static transforms to the camera; stamps between images."""
    link, optical = poses([3.0])[0], poses([-2.0])[0]
    bag.add("/tf_static", START, bag.transforms(0, "base", "link", rows(link[None])[0]))
    bag.add("/tf_static", START, bag.transforms(0, "link", FRAME, rows(optical[None])[0]))
    times = np.arange(START - 5 * 10**7 - 10**6, START + count * 10**8, step)
    moving = poses(1e-9 * (times - START)) @ np.linalg.inv(link @ optical)
    for time, row in zip(times.tolist(), rows(moving), strict=True):
        bag.add("/tf", time + 10**6, bag.transforms(time, root, "base", row))


def write_room(path, kind="mcap", count=3, *, encoding="32FC1", with_tf=True, topic="/camera/depth/image_rect_raw"):
    """Write a bag of the room, logged 30 ms after the stamps, and return its path."""
    with Bag(path, kind) as bag:
        for stamp in stamps(count):
            depth = room(stamp)
            pixels = depth if encoding == "32FC1" else np.rint(depth * 1000).astype(np.uint16)
            bag.add(topic, stamp + 3 * 10**7, bag.image(stamp, pixels, encoding))
            bag.add(f"{topic.rpartition('/')[0]}/camera_info", stamp + 3 * 10**7, bag.info(stamp))
        if with_tf:
            add_tf(bag, count)
    return bag.path


def encode_rvl(image):
    """Encode RVL, number by number, as A. Wilson's paper (ISS 2017) does."""
    nibbles = []

    def write(value):
        while True:
            nibble, value = value & 7, value >> 3
            nibbles.append(nibble | 8 if value else nibble)
            if not value:
                return

    pixels = image.ravel().tolist()
    index = previous = 0
    while index < len(pixels):
        end = index
        while end < len(pixels) and pixels[end] == 0:
            end += 1
        write(end - index)
        index = end
        while end < len(pixels) and pixels[end] != 0:
            end += 1
        write(end - index)
        for pixel in pixels[index:end]:
            delta = pixel - previous
            write(2 * delta if delta >= 0 else -2 * delta - 1)
            previous = pixel
        index = end
    nibbles += [0] * (-len(nibbles) % 8)
    words = [int("".join(f"{nibble:x}" for nibble in nibbles[i : i + 8]), 16) for i in range(0, len(nibbles), 8)]
    return struct.pack(f"<II{len(words)}I", image.shape[1], image.shape[0], *words)
