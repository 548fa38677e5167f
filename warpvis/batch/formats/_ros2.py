# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 2 bags with MCAP storage: depth and color images, intrinsics, point clouds, and poses of the camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.batch._job import shard_name
from warpvis.batch.formats._base import Images, lens_as
from warpvis.batch.formats._layouts import Layout
from warpvis.cameras import ImageCamera, as_pinhole
from warpvis.cameras.lenses import lens_to_ros
from warpvis.core.messages import Message, MessageMaker, nanoseconds
from warpvis.errors import FileFormatError
from warpvis.io import to_color_msg, to_image_msg, to_pointcloud2

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles

COLOR_TOPIC = "/camera/color"
"""Default of the option ``color_topic``."""
_LAST_SECOND = 2**31 - 1

MakeMessage: TypeAlias = Callable[[float, Images, NDArray[np.float64]], Message]
"""Function that returns the message of a frame from its time [s], images, and camera pose."""


class Ros2(Layout):
    """Writes one bag per shard, ``bag_000012/``, for `ros2 bag play`.

    Topics: ``/camera/depth/image_rect`` (``sensor_msgs/Image``, 32FC1, meters; REP 117: +inf for nothing, -inf for too
    near), ``/camera/depth/camera_info`` (intrinsics with pixel centers at integers, no distortion), ``/tf`` (pose of
    the camera in the world), and, if ``points`` is an output, ``/camera/depth/points`` (``sensor_msgs/PointCloud2`` in
    the optical frame of the camera, organized in rows and columns of the image, NaN without a surface). If ``color`` is
    an output, ``/camera/color/image_rect`` (rgb8) has the same pixels and frame as the depth image, and
    ``/camera/color/camera_info`` the same intrinsics.

    With a lens, images are not rectified: their topics are ``/camera/depth/image_raw`` and ``/camera/color/image_raw``,
    and the camera info contains the distortion and a ``P`` with the same intrinsics.
    """

    name: ClassVar[str] = "ros2"
    outputs: ClassVar[frozenset[str]] = frozenset({"color", "depth", "points"})
    default_outputs: ClassVar[tuple[str, ...]] = ("depth",)
    options: ClassVar[Mapping[str, str]] = {
        "frame_id": "camera_depth_optical_frame",
        "parent_frame_id": "world",
        "topic": "/camera/depth",
        "color_topic": "/camera/color",
    }
    library: str | None = "rosbags"

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        if "depth" not in plan.outputs:
            raise FileFormatError(f"outputs must include depth for format 'ros2', got {', '.join(plan.outputs)}")
        lens_as(plan, self.name, lens_to_ros)
        self._image_topic = image_topic(plan.camera)
        self._frame_id = self._name("frame_id", "camera_depth_optical_frame")
        self._parent = self._name("parent_frame_id", "world")
        self._topic = "/" + self._name("topic", "/camera/depth").strip("/")
        self._color_topic = color_topic(plan.options)
        self._name("color_topic", COLOR_TOPIC)
        if self._color_topic == self._topic:
            raise FileFormatError(f"option color_topic must not be the topic of depth, got {self._topic!r}")
        times = plan.frames.timestamps
        bad = np.flatnonzero(~((times >= 0) & (times < _LAST_SECOND)))
        if len(bad):
            raise FileFormatError(
                f"timestamps must be from 0 to {_LAST_SECOND} s for ROS 2, got {times[bad[0]]} in frame {bad[0]}"
            )
        self._types = _message_types()
        self._maker = MessageMaker(self._types)

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        from rosbags.rosbag2 import StoragePlugin, Writer

        name = f"bag_{shard_name(shard)}"
        frames = self.plan.frames[self.plan.shard_slice(shard)]
        with Writer(files.local_path(name), version=9, storage_plugin=StoragePlugin.MCAP) as bag:
            makers = self._makers()
            kinds = {topic: kind for topic, (kind, _) in makers.items()}
            topics = {topic: bag.add_connection(topic, kind, typestore=self._types) for topic, kind in kinds.items()}
            for row, (pose, time) in enumerate(zip(frames.camera_to_world, frames.timestamps, strict=True)):
                seconds, frame = float(time), {name: image[row] for name, image in images.items()}
                stamp = nanoseconds(seconds)
                for topic, (kind, make) in makers.items():
                    message = make(seconds, frame, pose)
                    bag.write(topics[topic], stamp, self._types.serialize_cdr(message, kind))
        return [name]

    def _name(self, option: str, default: str) -> str:
        """Return a name from the options."""
        value = self.plan.options.get(option, default)
        if not isinstance(value, str) or not value.strip("/") or any(letter.isspace() for letter in value):
            raise FileFormatError(f"option {option} must be a name without spaces, got {value!r}")
        return value

    def _makers(self) -> dict[str, tuple[str, MakeMessage]]:
        """Return the topics with their message types and functions that make their messages."""
        makers: dict[str, tuple[str, MakeMessage]] = {
            "/tf": ("tf2_msgs/msg/TFMessage", self._transforms),
            f"{self._topic}/camera_info": ("sensor_msgs/msg/CameraInfo", self._camera_info),
            f"{self._topic}/{self._image_topic}": ("sensor_msgs/msg/Image", self._image),
        }
        if "points" in self.plan.outputs:
            makers[f"{self._topic}/points"] = ("sensor_msgs/msg/PointCloud2", self._cloud)
        if "color" in self.plan.outputs:
            makers[f"{self._color_topic}/camera_info"] = ("sensor_msgs/msg/CameraInfo", self._camera_info)
            makers[f"{self._color_topic}/{self._image_topic}"] = ("sensor_msgs/msg/Image", self._color)
        return makers

    def _transforms(self, time: float, images: Images, pose: NDArray[np.float64]) -> Message:
        x, y, z, qx, qy, qz, qw = pose.tolist()
        make = self._maker.make
        transform = make(
            "geometry_msgs/msg/Transform",
            translation=make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
            rotation=make("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
        )
        stamped = make(
            "geometry_msgs/msg/TransformStamped",
            header=self._maker.header(self._parent, time),
            child_frame_id=self._frame_id,
            transform=transform,
        )
        return make("tf2_msgs/msg/TFMessage", transforms=[stamped])

    def _camera_info(self, time: float, images: Images, pose: NDArray[np.float64]) -> Message:
        return self.plan.camera.to_camera_info(frame_id=self._frame_id, stamp=time, types=self._types)

    def _image(self, time: float, images: Images, pose: NDArray[np.float64]) -> Message:
        return to_image_msg(images["depth"], frame_id=self._frame_id, stamp=time, types=self._types)

    def _cloud(self, time: float, images: Images, pose: NDArray[np.float64]) -> Message:
        return to_pointcloud2(images["depth"], self.plan.camera, frame_id=self._frame_id, stamp=time, types=self._types)

    def _color(self, time: float, images: Images, pose: NDArray[np.float64]) -> Message:
        return to_color_msg(images["color"], frame_id=self._frame_id, stamp=time, types=self._types)


def color_topic(options: Mapping[str, Any]) -> str:
    """Return the name of the color topics in a format's options."""
    return "/" + str(options.get("color_topic", COLOR_TOPIC)).strip("/")


def image_topic(camera: ImageCamera) -> str:
    """Return the name of the image topic: images of a pinhole camera are rectified, those of a lens are raw."""
    return "image_raw" if as_pinhole(camera) is None else "image_rect"


def _message_types() -> Typestore:
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise FileFormatError("format 'ros2' requires rosbags: pip install 'warpvis[ros]'") from None
    return get_typestore(Stores.ROS2_JAZZY)
