# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of depth images and points to ROS 2 messages, and of messages to depth images."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.depth_images import check_meters
from warpvis.cameras.image_cameras import ImageCamera, as_pinhole, require_image_camera
from warpvis.core.arrays import as_numpy, on_gpu
from warpvis.core.checks import check_choice
from warpvis.core.messages import Message, MessageMaker, MessageTypes, Stamp
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, MessageError
from warpvis.io._cloud_messages import DATATYPES, CloudLayout, as_layout, check_cloud
from warpvis.io._depth import depth_to_units, require_meters, units_to_depth, warn_of_lost
from warpvis.io._image_messages import depth_pixels

DepthEncoding = Literal["32FC1", "16UC1"]
"""Encoding of depth in an Image, as defined by REP 118."""

_MILLIMETERS = 1000.0


def to_image_msg(
    depth: ArrayInput,
    *,
    frame_id: str,
    stamp: Stamp = 0.0,
    encoding: DepthEncoding = "32FC1",
    types: MessageTypes | None = None,
) -> Message:
    """Create a ``sensor_msgs/Image`` from a depth image. It shares no memory with the image.

    Args:
        depth: Planar depth [m], float, shape ``(H, W)`` or ``(1, H, W)``, of NumPy, Warp, PyTorch, ..., on any device.
        frame_id: The camera's optical frame.
        stamp: Time of the image [s], or a Time message.
        encoding: ``"32FC1"``, meters: +inf for no return, -inf for too near, NaN for not measured (REP 117); or
            ``"16UC1"``, whole millimeters, rounded, 0 for all of these (REP 118). Depth out of the 16-bit range is 0,
            too, with a warning that counts such pixels.
        types: A type store of rosbags; by default ROS's own classes, which must be installed.

    Raises:
        MessageError: If another argument is invalid, or ROS is not installed.
    """
    maker = MessageMaker(types)
    check_choice(encoding, "encoding", ("32FC1", "16UC1"), MessageError)
    image = _read_image(depth)
    pixels: NDArray[Any]
    if encoding == "16UC1":
        units = depth_to_units(image, _MILLIMETERS)
        warn_of_lost(image, units, _MILLIMETERS)
        pixels = np.ascontiguousarray(units, dtype="<u2")
    else:
        pixels = np.array(image, dtype="<f4", order="C")  # a copy, since renderers reuse their arrays
    height, width = pixels.shape
    return maker.make(
        "sensor_msgs/msg/Image",
        header=maker.header(frame_id, stamp),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=width * pixels.itemsize,
        data=maker.sequence(pixels.reshape(-1).view(np.uint8)),
    )


def from_image_msg(message: Message) -> NDArray[np.float32]:
    """Return the depth image of a ``sensor_msgs/Image`` [m], shape ``(H, W)`` float32.

    32FC1 is returned unchanged, with +inf, -inf and NaN as defined by REP 117. 16UC1 is in millimeters: 0 becomes NaN,
    not measured, and so does 65535, which some drivers write for the same or for a limit. Both byte orders and padded
    rows are supported. A ``sensor_msgs/CompressedImage`` of compressedDepth, PNG or RVL, is read, too. The message is
    of ROS 2, rosbags or ROS 1, or any object with its fields.

    Raises:
        MessageError: If it is not such an image, has another encoding, or has too few or too many bytes.
    """
    pixels = depth_pixels(message)
    return pixels if pixels.dtype.kind == "f" else units_to_depth(pixels, 1 / _MILLIMETERS)


def to_pointcloud2(
    points: ArrayInput,
    camera: ImageCamera | None = None,
    *,
    frame_id: str,
    stamp: Stamp = 0.0,
    layout: CloudLayout | None = None,
    types: MessageTypes | None = None,
) -> Message:
    """Create a ``sensor_msgs/PointCloud2``. It shares no memory with the arguments.

    For depth images and points it has the fields x, y and z, float32; for a lidar's cloud those of the cloud.

    Args:
        points: With `camera`, its depth image [m], shape ``(H, W)`` or ``(1, H, W)``: the cloud has the image's rows
            and columns and is in the camera's optical frame, NaN where there is no depth within the camera's range.
            Without, points [m] in any frame, shape ``(N, 3)``, or ``(H, W, 3)`` or ``(1, H, W, 3)`` for a cloud with
            rows and columns; or a lidar's cloud, as returned by `warpvis.sensors.point_clouds`, whose times are
            relative to `stamp`.
        camera: The camera of a depth image, which may be a `warpvis.cameras.LensCamera`.
        frame_id: The frame of the points; for a depth image, the camera's optical frame.
        stamp: Time of the image [s], or a Time message.
        layout: Driver whose fields a lidar's cloud gets: ``"velodyne"``, x y z intensity float32, ring uint16, time
            float32 [s]; ``"ouster"``, x y z intensity float32, t uint32 [ns], reflectivity ring ambient uint16,
            range uint32 [mm]; or ``"livox"``, x y z intensity float32, tag line uint8, timestamp float64 [ns], absolute
            and not relative to `stamp`, in order of time and without NaN. Odometry packages expect these fields.
            Intensity is 0 if the cloud has none, reflectivity and Livox's intensity are 255 for an intensity of 1, and
            ambient light, which is not simulated, is 0. By default the cloud's fields.
        types: A type store of rosbags; by default ROS's own classes, which must be installed.

    Raises:
        WarpvisError: If an argument is invalid, or ROS is not installed.
    """
    maker = MessageMaker(types)
    if camera is None and isinstance(points, np.ndarray) and points.dtype.names is not None:
        return _cloud_message(as_layout(check_cloud(points), layout, stamp), maker, maker.header(frame_id, stamp))
    if layout is not None:
        raise MessageError(f"layout is for a lidar's cloud, an array with named fields, got {layout!r}")
    cloud = _read_points(points) if camera is None else _back_project(_read_image(points), require_image_camera(camera))
    # Points of a depth image may be NaN in other messages, so these are never declared dense.
    dense = camera is None and bool(np.isfinite(cloud).all())
    named = np.ascontiguousarray(cloud).view([(axis, "<f4") for axis in "xyz"])[..., 0]
    return _cloud_message(named, maker, maker.header(frame_id, stamp), dense=dense)


def _cloud_message(cloud: NDArray[np.void], maker: MessageMaker, header: Message, dense: bool | None = None) -> Message:
    """Create a PointCloud2 from a packed cloud with named fields, shape ``(columns,)`` or ``(rows, columns)``."""
    rows, columns = cloud.shape if cloud.ndim == 2 else (1, len(cloud))
    return maker.make(
        "sensor_msgs/msg/PointCloud2",
        header=header,
        height=rows,
        width=columns,
        fields=[_point_field(cloud.dtype, name, maker) for name in cloud.dtype.names or ()],
        is_bigendian=False,
        point_step=cloud.itemsize,
        row_step=cloud.itemsize * columns,
        data=maker.sequence(np.ascontiguousarray(cloud).reshape(-1).view(np.uint8)),
        is_dense=bool(np.isfinite(cloud["x"]).all()) if dense is None else dense,
    )


def _point_field(kind: np.dtype[np.void], name: str, maker: MessageMaker) -> Message:
    """Create the PointField of a field of a packed cloud."""
    offset = kind.fields[name][1] if kind.fields is not None else 0
    datatype = DATATYPES[kind[name].str[1:]]
    return maker.make("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=datatype, count=1)


def _on_host(value: ArrayInput, name: str) -> NDArray[Any]:
    """Return an array of any library and device as a NumPy array."""
    if on_gpu(value):
        value = wp.from_dlpack(value)
    return as_numpy(value, name=name)


def _read_image(depth: ArrayInput) -> NDArray[Any]:
    """Return one depth image on the host, shape ``(H, W)``."""
    image = require_meters(_on_host(depth, "depth"))
    if image.ndim == 3 and len(image) == 1:
        image = image[0]
    if image.ndim != 2 or not image.size:
        raise ArrayError(f"depth must be one image of shape (H, W), got {image.shape}")
    return image


def _read_points(points: ArrayInput) -> NDArray[np.float32]:
    """Return points on the host, with rows and columns, shape ``(rows, columns, 3)``."""
    cloud = _on_host(points, "points")
    if cloud.ndim == 4 and len(cloud) == 1:
        cloud = cloud[0]
    if cloud.ndim not in (2, 3) or cloud.shape[-1] != 3 or cloud.dtype.kind not in "fiu":
        raise ArrayError(
            f"points must be numbers of shape (N, 3) or (H, W, 3), got {cloud.dtype} of {cloud.shape}; of a depth "
            "image, give its camera, too"
        )
    return np.array(cloud if cloud.ndim == 3 else cloud[None], dtype="<f4", order="C")


def _back_project(depth: NDArray[Any], camera: ImageCamera) -> NDArray[np.float32]:
    """Return the points of a depth image in the camera's frame, shape ``(H, W, 3)``, NaN where there is no depth."""
    if depth.shape != (camera.height, camera.width):
        raise ArrayError(f"depth must have the camera's shape ({camera.height}, {camera.width}), got {depth.shape}")
    check_meters(depth, "depth", camera.near, camera.far)
    depth = depth.astype(np.float32, copy=False)
    near, far = np.float32(camera.near), np.float32(camera.far)
    measured = np.isfinite(depth) & (depth > 0) & (depth >= near) & (depth <= far)
    z = np.where(measured, depth, np.float32(np.nan))
    pinhole = as_pinhole(camera)
    if pinhole is None:
        return (camera.rays * z[..., None].astype(np.float64)).astype("<f4")
    slope_x = (np.arange(camera.width) + 0.5 - pinhole.cx) / pinhole.fx
    slope_y = (np.arange(camera.height) + 0.5 - pinhole.cy) / pinhole.fy
    points = np.empty((*depth.shape, 3), dtype="<f4")
    points[..., 2] = z
    np.multiply(z, slope_x.astype(np.float32), out=points[..., 0])
    np.multiply(z, slope_y.astype(np.float32)[:, None], out=points[..., 1])
    return points
