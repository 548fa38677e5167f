# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 2 bags with MCAP storage: depth images, intrinsics, point clouds, and where the camera is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from decimal import ROUND_HALF_EVEN, Decimal
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.batch._job import shard_name
from warpvis.batch.formats._base import Images
from warpvis.batch.formats._layouts import Layout
from warpvis.errors import FileFormatError

if TYPE_CHECKING:
    from rosbags.typesys.store import Msg, Msgarg, Typestore

    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles

_LAST_SECOND = 2**31 - 1

MakeMessage: TypeAlias = "Callable[[int, NDArray[np.float32], NDArray[np.float64]], Msg]"
"""Makes a frame's message of its time [ns], its depth image [m], shape ``(H, W)``, and its camera's pose."""


class Ros2(Layout):
    """Writes a bag a shard, ``bag_000012/``, which `ros2 bag play` reads.

    Topics: ``/camera/depth/image_rect`` (``sensor_msgs/Image``, 32FC1, metres; REP 117: +inf for nothing, -inf for too
    near), ``/camera/depth/camera_info`` (intrinsics with pixel centres at whole numbers, no distortion), ``/tf`` (world
    to camera), and if ``points`` are among the outputs ``/camera/depth/points`` (``sensor_msgs/PointCloud2`` in the
    camera's optical frame, NaN where nothing is; it has the image's rows and columns).
    """

    name: ClassVar[str] = "ros2"
    outputs: ClassVar[frozenset[str]] = frozenset({"depth", "points"})
    default_outputs: ClassVar[tuple[str, ...]] = ("depth",)
    options: ClassVar[Mapping[str, str]] = {
        "frame_id": "camera_depth_optical_frame",
        "parent_frame_id": "world",
        "topic": "/camera/depth",
    }
    library: ClassVar[str | None] = "rosbags"

    def __init__(self, plan: Plan) -> None:
        """Check the plan.

        Raises:
            FileFormatError: It has no depth, an unknown option, or a time that ROS cannot say, or the package
                ``rosbags`` is missing.
        """
        super().__init__(plan)
        if "depth" not in plan.outputs:
            raise FileFormatError(f"format 'ros2' needs the output depth, got {', '.join(plan.outputs)}")
        self._frame_id = self._name("frame_id", "camera_depth_optical_frame")
        self._parent = self._name("parent_frame_id", "world")
        self._topic = "/" + self._name("topic", "/camera/depth").strip("/")
        times = plan.frames.timestamps
        bad = np.flatnonzero(~((times >= 0) & (times < _LAST_SECOND)))
        if len(bad):
            raise FileFormatError(
                f"ROS 2 counts times from 0 to {_LAST_SECOND} seconds, and frame {bad[0]} has the time {times[bad[0]]}"
            )
        self._types = _message_types()

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        """Write one bag; see `warpvis.batch.formats._base.Format`."""
        from rosbags.rosbag2 import StoragePlugin, Writer

        name = f"bag_{shard_name(shard)}"
        frames = self.plan.frames[self.plan.shard_slice(shard)]
        with Writer(files.local_path(name), version=9, storage_plugin=StoragePlugin.MCAP) as bag:
            makers = self._makers()
            kinds = {topic: kind for topic, (kind, _) in makers.items()}
            topics = {topic: bag.add_connection(topic, kind, typestore=self._types) for topic, kind in kinds.items()}
            for depth, pose, time in zip(images["depth"], frames.camera_to_world, frames.timestamps, strict=True):
                stamp = nanoseconds(float(time))
                for topic, (kind, make) in makers.items():
                    message = make(stamp, depth, pose)
                    bag.write(topics[topic], stamp, self._types.serialize_cdr(message, kind))
        return [name]

    def index(self, files: ShardFiles) -> list[str]:
        """Write nothing: every bag is read by itself."""
        return []

    def _name(self, option: str, default: str) -> str:
        """Read a name among the options."""
        value = self.plan.options.get(option, default)
        if not isinstance(value, str) or not value.strip("/") or any(letter.isspace() for letter in value):
            raise FileFormatError(f"option {option} must be a name without spaces, got {value!r}")
        return value

    def _makers(self) -> dict[str, tuple[str, MakeMessage]]:
        """List of every topic its type, and what makes its message."""
        makers: dict[str, tuple[str, MakeMessage]] = {
            "/tf": ("tf2_msgs/msg/TFMessage", self._transforms),
            f"{self._topic}/camera_info": ("sensor_msgs/msg/CameraInfo", self._camera_info),
            f"{self._topic}/image_rect": ("sensor_msgs/msg/Image", self._image),
        }
        if "points" in self.plan.outputs:
            makers[f"{self._topic}/points"] = ("sensor_msgs/msg/PointCloud2", self._cloud)
        return makers

    def _message(self, kind: str, *values: Msgarg) -> Msg:
        return self._types.types[kind](*values)

    def _header(self, stamp: int, frame_id: str) -> Msg:
        time = self._message("builtin_interfaces/msg/Time", *divmod(stamp, 10**9))
        return self._message("std_msgs/msg/Header", time, frame_id)

    def _transforms(self, stamp: int, depth: NDArray[np.float32], pose: NDArray[np.float64]) -> Msg:
        x, y, z, qx, qy, qz, qw = pose.tolist()
        translation = self._message("geometry_msgs/msg/Vector3", x, y, z)
        rotation = self._message("geometry_msgs/msg/Quaternion", qx, qy, qz, qw)
        transform = self._message("geometry_msgs/msg/Transform", translation, rotation)
        header = self._header(stamp, self._parent)
        stamped = self._message("geometry_msgs/msg/TransformStamped", header, self._frame_id, transform)
        return self._message("tf2_msgs/msg/TFMessage", [stamped])

    def _camera_info(self, stamp: int, depth: NDArray[np.float32], pose: NDArray[np.float64]) -> Msg:
        camera, header = self.plan.camera, self._header(stamp, self._frame_id)
        k = camera.to_K(pixel_center=0.0)
        p = np.concatenate([k, np.zeros((3, 1))], axis=1).ravel()
        region = self._message("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        matrices = np.zeros(5), k.ravel(), np.eye(3).ravel(), p
        return self._message(
            "sensor_msgs/msg/CameraInfo", header, camera.height, camera.width, "plumb_bob", *matrices, 0, 0, region
        )

    def _image(self, stamp: int, depth: NDArray[np.float32], pose: NDArray[np.float64]) -> Msg:
        height, width = depth.shape
        data = np.ascontiguousarray(depth, dtype="<f4").reshape(-1).view(np.uint8)
        header = self._header(stamp, self._frame_id)
        return self._message("sensor_msgs/msg/Image", header, height, width, "32FC1", 0, 4 * width, data)

    def _cloud(self, stamp: int, depth: NDArray[np.float32], pose: NDArray[np.float64]) -> Msg:
        height, width = depth.shape
        fields = [self._message("sensor_msgs/msg/PointField", axis, 4 * k, 7, 1) for k, axis in enumerate("xyz")]
        points = np.empty((height, width, 3), dtype="<f4")
        slope_x, slope_y = self._slopes
        points[..., 2] = np.where(np.isfinite(depth), depth, np.float32(np.nan))
        np.multiply(points[..., 2], slope_x, out=points[..., 0])
        np.multiply(points[..., 2], slope_y[:, None], out=points[..., 1])
        shape = height, width, fields, False, 12, 12 * width
        header = self._header(stamp, self._frame_id)
        return self._message("sensor_msgs/msg/PointCloud2", header, *shape, points.reshape(-1).view(np.uint8), False)

    @cached_property
    def _slopes(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """x/z of every column's rays, shape ``(W,)``, and y/z of every row's, shape ``(H,)``."""
        camera = self.plan.camera
        x = (np.arange(camera.width) + 0.5 - camera.cx) / camera.fx
        y = (np.arange(camera.height) + 0.5 - camera.cy) / camera.fy
        return x.astype(np.float32), y.astype(np.float32)


def _message_types() -> Typestore:
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise FileFormatError("format 'ros2' needs the package rosbags: pip install 'warpvis[ros]'") from None
    return get_typestore(Stores.ROS2_JAZZY)


def nanoseconds(seconds: float) -> int:
    """Convert a time [s] to whole nanoseconds: those of its shortest decimal, which is what a text file said."""
    return int((Decimal(repr(seconds)) * 10**9).to_integral_value(ROUND_HALF_EVEN))
