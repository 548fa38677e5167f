# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth images and points as messages of ROS 2, and depth images from messages."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy, on_gpu
from warpvis.core.camera import Camera
from warpvis.core.checks import check_choice
from warpvis.core.depth_images import check_meters
from warpvis.core.image_cameras import ImageCamera, require_image_camera
from warpvis.core.messages import Message, MessageMaker, MessageTypes, Stamp, field, whole_field
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, MessageError
from warpvis.io._cloud_messages import DATATYPES, CloudLayout, as_layout, check_cloud
from warpvis.io._depth import depth_to_units, units_to_depth, warn_of_lost

DepthEncoding = Literal["32FC1", "16UC1"]
"""How an Image holds depth, as REP 118 says."""

_MILLIMETRES = 1000.0

# Bytes of a pixel, and what they are; some drivers call 16UC1 mono16.
_PIXELS = {"32FC1": "f4", "16UC1": "u2", "mono16": "u2"}


def to_image_msg(
    depth: ArrayInput,
    *,
    frame_id: str,
    stamp: Stamp = 0.0,
    encoding: DepthEncoding = "32FC1",
    types: MessageTypes | None = None,
) -> Message:
    """Make a ``sensor_msgs/Image`` of a depth image. It shares no memory with it.

    Args:
        depth: Planar depth [m], float, shape ``(H, W)`` or ``(1, H, W)``, of NumPy, Warp, PyTorch, ..., on any device.
        frame_id: The camera's optical frame.
        stamp: When the image was taken [s], or a Time message.
        encoding: ``"32FC1"``, meters: +inf for nothing, -inf for too near, NaN for not measured (REP 117); or
            ``"16UC1"``, whole millimeters, rounded, 0 for all of these (REP 118). Depth that 16 bits cannot hold is 0,
            too, and a warning says of how many pixels.
        types: A type store of rosbags; by default ROS's own classes, which must be there then.

    Raises:
        ArrayError: The image is not what it has to be.
        MessageError: Another argument is not, or ROS is not there.
    """
    maker = MessageMaker(types)
    check_choice(encoding, "encoding", ("32FC1", "16UC1"), MessageError)
    image = _read_image(depth)
    pixels: NDArray[Any]
    if encoding == "16UC1":
        units = depth_to_units(image, _MILLIMETRES)
        warn_of_lost(image, units, _MILLIMETRES)
        pixels = np.ascontiguousarray(units, dtype="<u2")
    else:
        pixels = np.array(image, dtype="<f4", order="C")  # a copy: renderers write into the same arrays again
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

    Of 32FC1 it is what the message holds: +inf, -inf and NaN mean what REP 117 says. Of 16UC1, which holds millimeters,
    0 becomes NaN, not measured, and so does 65535, which some write for the same or for a limit. Either order of bytes
    is read, and rows that are padded.

    Args:
        message: Of ROS 2, rosbags or ROS 1, or any object with its fields.

    Raises:
        MessageError: It is no Image, of another encoding, or has too few or too many bytes.
    """
    encoding = field(message, "encoding")
    if encoding not in _PIXELS:
        raise MessageError(f"an Image of depth must be of 32FC1 or 16UC1, got {encoding!r}")
    height, width, step = (whole_field(message, name) for name in ("height", "width", "step"))
    if height < 1 or width < 1:
        raise MessageError(f"an Image of depth must have pixels, got {width} x {height}")
    kind = np.dtype((">" if field(message, "is_bigendian") else "<") + _PIXELS[encoding])
    data = _bytes_of(field(message, "data"))
    if step < width * kind.itemsize or data.size != height * step:
        raise MessageError(
            f"an Image of {width} x {height} pixels of {encoding} in rows of {step} bytes must have at least "
            f"{kind.itemsize} bytes a pixel and {height * step} in all, got {data.size}"
        )
    rows = np.ascontiguousarray(data.reshape(height, step)[:, : width * kind.itemsize])
    pixels = rows.view(kind)
    if kind.kind == "f":
        return pixels.astype(np.float32)
    return units_to_depth(pixels, 1 / _MILLIMETRES)


def to_pointcloud2(
    points: ArrayInput,
    camera: ImageCamera | None = None,
    *,
    frame_id: str,
    stamp: Stamp = 0.0,
    layout: CloudLayout | None = None,
    types: MessageTypes | None = None,
) -> Message:
    """Make a ``sensor_msgs/PointCloud2``. It shares no memory with what it is of.

    Of depth images and points it has the fields x, y and z, float32; of a lidar's cloud those of the cloud.

    Args:
        points: With `camera`, its depth image [m], shape ``(H, W)`` or ``(1, H, W)``: the cloud has the image's rows
            and columns and is in the camera's optical frame, NaN where no depth is, or none within its range. Else
            points [m] of any frame, shape ``(N, 3)``, or ``(H, W, 3)`` or ``(1, H, W, 3)`` for a cloud with rows and
            columns. Or a lidar's cloud, one of those that `warpvis.sensors.point_clouds` makes, whose times
            are counted from `stamp`.
        camera: The camera that a depth image is of, which may be a `warpvis.sensors.LensCamera`.
        frame_id: The frame of the points; of a depth image, the camera's optical frame.
        stamp: When the image was taken [s], or a Time message.
        layout: Whose driver's fields a lidar's cloud gets: ``"velodyne"``, x y z intensity float32, ring uint16, time
            float32 [s]; ``"ouster"``, x y z intensity float32, t uint32 [ns], reflectivity ring ambient uint16,
            range uint32 [mm]; or ``"livox"``, x y z intensity float32, tag line uint8, timestamp float64 [ns], of the
            clock and not from `stamp`, in the order of times and without NaN. Odometry packages look for these.
            Intensity is 0 if the cloud has none, reflectivity and Livox's intensity 255 for an intensity of 1, and
            ambient light, which is not simulated, 0. By default the cloud's own fields.
        types: A type store of rosbags; by default ROS's own classes, which must be there then.

    Raises:
        WarpvisError: An argument is not what it has to be, or ROS is not there.
    """
    maker = MessageMaker(types)
    if camera is None and isinstance(points, np.ndarray) and points.dtype.names is not None:
        return _cloud_message(as_layout(check_cloud(points), layout, stamp), maker, maker.header(frame_id, stamp))
    if layout is not None:
        raise MessageError(f"layout is for a lidar's cloud, an array with named fields, got {layout!r}")
    cloud = _read_points(points) if camera is None else _back_project(_read_image(points), require_image_camera(camera))
    # A depth image's points may be NaN, whether or not these are.
    dense = camera is None and bool(np.isfinite(cloud).all())
    named = np.ascontiguousarray(cloud).view([(axis, "<f4") for axis in "xyz"])[..., 0]
    return _cloud_message(named, maker, maker.header(frame_id, stamp), dense=dense)


def _cloud_message(cloud: NDArray[np.void], maker: MessageMaker, header: Message, dense: bool | None = None) -> Message:
    """Make a PointCloud2 of a packed cloud with named fields, shape ``(columns,)`` or ``(rows, columns)``."""
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
    """Make the PointField of a field of a packed cloud."""
    offset = kind.fields[name][1] if kind.fields is not None else 0
    datatype = DATATYPES[kind[name].str[1:]]
    return maker.make("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=datatype, count=1)


def _on_host(value: ArrayInput, name: str) -> NDArray[Any]:
    """Return an array of any library and device as NumPy's."""
    if on_gpu(value):
        value = (value if isinstance(value, wp.array) else wp.from_dlpack(value)).numpy()
    return as_numpy(value.numpy() if isinstance(value, wp.array) else value, name=name)


def _read_image(depth: ArrayInput) -> NDArray[Any]:
    """Return one depth image on the host, shape ``(H, W)``."""
    image = _on_host(depth, "depth")
    if image.dtype.kind != "f":
        raise ArrayError(f"depth must be in meters, a float array, got {image.dtype}; divide millimeters by 1000")
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
    """Return the points of a depth image in the camera's frame, shape ``(H, W, 3)``, NaN where no depth is."""
    if depth.shape != (camera.height, camera.width):
        raise ArrayError(f"depth must have the camera's shape ({camera.height}, {camera.width}), got {depth.shape}")
    check_meters(depth, "depth", camera.near, camera.far)
    depth = depth.astype(np.float32, copy=False)
    near, far = np.float32(camera.near), np.float32(camera.far)
    measured = np.isfinite(depth) & (depth > 0) & (depth >= near) & (depth <= far)
    z = np.where(measured, depth, np.float32(np.nan))
    if not isinstance(camera, Camera):
        return (camera.rays * z[..., None].astype(np.float64)).astype("<f4")
    slope_x = (np.arange(camera.width) + 0.5 - camera.cx) / camera.fx
    slope_y = (np.arange(camera.height) + 0.5 - camera.cy) / camera.fy
    points = np.empty((*depth.shape, 3), dtype="<f4")
    points[..., 2] = z
    np.multiply(z, slope_x.astype(np.float32), out=points[..., 0])
    np.multiply(z, slope_y.astype(np.float32)[:, None], out=points[..., 1])
    return points


def _bytes_of(data: Any) -> NDArray[np.uint8]:
    """Return the bytes of a message's field: bytes, an `array.array`, an array of NumPy, or a list of numbers."""
    try:
        if isinstance(data, (list, tuple)):
            data = bytes(data)
        return np.frombuffer(data, dtype=np.uint8)
    except (TypeError, ValueError) as error:
        raise MessageError(f"data of an Image must be bytes: {error}") from None
