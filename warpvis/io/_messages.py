# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of depth images, color images and points to ROS 2 messages, and of messages to images."""

from __future__ import annotations

import io
from typing import Any, Literal

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.depth_images import check_meters
from warpvis.cameras.image_cameras import ImageCamera, as_pinhole, require_image_camera
from warpvis.core.arrays import as_numpy, on_gpu
from warpvis.core.checks import check_choice, check_whole
from warpvis.core.messages import Message, MessageMaker, MessageTypes, Stamp
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, MessageError
from warpvis.io._cloud_messages import DATATYPES, CloudLayout, as_layout, check_cloud
from warpvis.io._depth import depth_to_units, require_meters, units_to_depth, warn_of_lost
from warpvis.io._image_messages import color_pixels, depth_pixels

DepthEncoding = Literal["32FC1", "16UC1"]
"""Encoding of depth in an Image, as defined by REP 118."""

ColorEncoding = Literal["rgb8", "bgr8"]
"""Encoding of color in an Image."""

Compression = Literal["jpeg", "png"]
"""Format of the file in a CompressedImage."""

_MILLIMETERS = 1000.0
_PNG_LEVEL = 3
"""Compression level of PNG, the default of compressed_image_transport."""


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
    return _image_message(pixels, encoding, maker, maker.header(frame_id, stamp))


def to_color_msg(
    color: ArrayInput,
    *,
    frame_id: str,
    stamp: Stamp = 0.0,
    encoding: ColorEncoding = "rgb8",
    types: MessageTypes | None = None,
) -> Message:
    """Create a ``sensor_msgs/Image`` from a color image. It shares no memory with the image.

    Args:
        color: Color in sRGB, uint8, shape ``(H, W, 3)`` or ``(1, H, W, 3)``, of NumPy, Warp, PyTorch, ..., on any
            device, as `Views.color` of one view.
        frame_id: The camera's optical frame.
        stamp: Time of the image [s], or a Time message.
        encoding: Order of the channels in the message, ``"rgb8"`` or ``"bgr8"``.
        types: A type store of rosbags; by default ROS's own classes, which must be installed.

    Raises:
        ArrayError: If it is not a color image.
        MessageError: If another argument is invalid, or ROS is not installed.
    """
    maker = MessageMaker(types)
    check_choice(encoding, "encoding", ("rgb8", "bgr8"), MessageError)
    image = _read_color(color)
    pixels = np.array(image if encoding == "rgb8" else image[..., ::-1], order="C")  # renderers reuse their arrays
    return _image_message(pixels, encoding, maker, maker.header(frame_id, stamp))


def to_compressed_msg(
    color: ArrayInput,
    *,
    frame_id: str,
    stamp: Stamp = 0.0,
    compression: Compression = "jpeg",
    quality: int = 95,
    types: MessageTypes | None = None,
) -> Message:
    """Create a ``sensor_msgs/CompressedImage`` from a color image, as compressed_image_transport publishes it.

    Args:
        color: Color in sRGB, as for `to_color_msg`.
        frame_id: The camera's optical frame.
        stamp: Time of the image [s], or a Time message.
        compression: ``"jpeg"``, or ``"png"``, which is lossless.
        quality: Quality of JPEG, 1 to 100.
        types: A type store of rosbags; by default ROS's own classes, which must be installed.

    Raises:
        ArrayError: If it is not a color image.
        MessageError: If another argument is invalid, or ROS is not installed.
    """
    from PIL import Image

    maker = MessageMaker(types)
    check_choice(compression, "compression", ("jpeg", "png"), MessageError)
    if check_whole(quality, "quality", minimum=1, error=MessageError) > 100:
        raise MessageError(f"quality must be from 1 to 100, got {quality}")
    file = io.BytesIO()
    options = {"quality": quality} if compression == "jpeg" else {"compress_level": _PNG_LEVEL}
    Image.fromarray(_read_color(color)).save(file, compression, **options)
    return maker.make(
        "sensor_msgs/msg/CompressedImage",
        header=maker.header(frame_id, stamp),
        # The encoding of the image after decompression, and that in which OpenCV decodes the file.
        format=f"rgb8; {compression} compressed bgr8",
        data=maker.sequence(np.frombuffer(file.getbuffer(), dtype=np.uint8)),
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


def from_color_msg(message: Message) -> NDArray[np.uint8]:
    """Return the color image of a ``sensor_msgs/Image`` or ``CompressedImage`` in sRGB, shape ``(H, W, 3)`` uint8.

    An Image has the encoding rgb8, bgr8, rgba8, bgra8 or mono8, with or without padded rows; a CompressedImage is a
    JPEG or PNG file. Opacity is ignored, and gray has three equal channels. The message is of ROS 2, rosbags or ROS 1,
    or any object with its fields.

    Raises:
        MessageError: If it is not such an image, has another encoding, or is damaged.
    """
    return color_pixels(message)


def to_pointcloud2(
    points: ArrayInput,
    camera: ImageCamera | None = None,
    *,
    colors: ArrayInput | None = None,
    frame_id: str,
    stamp: Stamp = 0.0,
    layout: CloudLayout | None = None,
    types: MessageTypes | None = None,
) -> Message:
    """Create a ``sensor_msgs/PointCloud2``. It shares no memory with the arguments.

    For depth images and points it has the fields x, y and z, float32; for a lidar's cloud those of the cloud. With
    `colors`, the field rgb follows, float32, whose bits are ``0x00RRGGBB``, as PCL and RViz read it.

    Args:
        points: With `camera`, its depth image [m], shape ``(H, W)`` or ``(1, H, W)``: the cloud has the image's rows
            and columns and is in the camera's optical frame, NaN where there is no depth within the camera's range.
            Without, points [m] in any frame, shape ``(N, 3)``, or ``(H, W, 3)`` or ``(1, H, W, 3)`` for a cloud with
            rows and columns; or a lidar's cloud, as returned by `warpvis.sensors.point_clouds`, whose times are
            relative to `stamp`.
        camera: The camera of a depth image, which may be a `warpvis.cameras.LensCamera`.
        colors: Colors of the points in sRGB, uint8, shape ``(H, W, 3)``, ``(1, H, W, 3)`` or ``(N, 3)``, as
            `Views.color` of one view; not for the `layout` of a driver.
        frame_id: The frame of the points; for a depth image, the camera's optical frame.
        stamp: Time of the image [s], or a Time message.
        layout: Driver whose fields a lidar's cloud gets. Odometry packages expect these fields and types:

            - ``"velodyne"``: x y z intensity float32, ring uint16, time float32 [s].
            - ``"ouster"``: x y z intensity float32, t uint32 [ns], reflectivity ring ambient uint16, range uint32 [mm].
            - ``"ouster_legacy"``: the same with ring uint8, which FAST-LIO, Point-LIO and LIO-SAM read.
            - ``"hesai"``: x y z intensity float32, ring uint16, timestamp float64 [s], absolute.
            - ``"livox"``: x y z intensity float32, tag line uint8, timestamp float64 [ns], absolute, in order of time
              and without NaN.

            Intensity is 0 if the cloud has none, reflectivity and Livox's intensity are 255 for an intensity of 1, and
            ambient light, which is not simulated, is 0. By default the cloud's fields.
        types: A type store of rosbags; by default ROS's own classes, which must be installed.

    Raises:
        WarpvisError: If an argument is invalid, or ROS is not installed.
    """
    maker = MessageMaker(types)
    if camera is None and isinstance(points, np.ndarray) and points.dtype.names is not None:
        if colors is not None and layout is not None:
            raise MessageError(f'colors are not in the fields of the layout "{layout}"; omit one of the two')
        named = _add_colors(as_layout(check_cloud(points), layout, stamp), colors)
        return _cloud_message(named, maker, maker.header(frame_id, stamp))
    if layout is not None:
        raise MessageError(f"layout is for a lidar's cloud, an array with named fields, got {layout!r}")
    cloud = _read_points(points) if camera is None else _back_project(_read_image(points), require_image_camera(camera))
    # Points of a depth image may be NaN in other messages, so these are never declared dense.
    dense = camera is None and bool(np.isfinite(cloud).all())
    named = np.ascontiguousarray(cloud).view([(axis, "<f4") for axis in "xyz"])[..., 0]
    return _cloud_message(_add_colors(named, colors), maker, maker.header(frame_id, stamp), dense=dense)


def _add_colors(cloud: NDArray[np.void], colors: ArrayInput | None) -> NDArray[np.void]:
    """Return a packed cloud with the field rgb, if colors are given."""
    if colors is None:
        return cloud
    channels = _on_host(colors, "colors")
    expected = (*cloud.shape, 3)
    if channels.dtype != np.uint8 or _without_views(channels.shape) != _without_views(expected):
        raise ArrayError(
            f"colors must be uint8 of shape {_without_views(expected)}, one for each point, got {channels.dtype} of "
            f"{channels.shape}"
        )
    red, green, blue = np.moveaxis(channels.reshape(expected).astype("<u4"), -1, 0)
    colored = np.empty(cloud.shape, dtype=[*cloud.dtype.descr, ("rgb", "<f4")])
    for name in cloud.dtype.names or ():
        colored[name] = cloud[name]
    colored["rgb"] = (red << 16 | green << 8 | blue).view("<f4")
    return colored


def _without_views(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return a shape without leading axes of length 1, but with the last two axes."""
    while len(shape) > 2 and shape[0] == 1:
        shape = shape[1:]
    return shape


def _image_message(pixels: NDArray[Any], encoding: str, maker: MessageMaker, header: Message) -> Message:
    """Create an Image from contiguous pixels, shape ``(H, W)`` or ``(H, W, channels)``."""
    height, width = pixels.shape[:2]
    return maker.make(
        "sensor_msgs/msg/Image",
        header=header,
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=pixels.nbytes // height,
        data=maker.sequence(pixels.reshape(-1).view(np.uint8)),
    )


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


def _read_color(color: ArrayInput) -> NDArray[np.uint8]:
    """Return one color image on the host, shape ``(H, W, 3)``."""
    image = _on_host(color, "color")
    if image.ndim == 4 and len(image) == 1:
        image = image[0]
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[-1] != 3 or not image.size:
        raise ArrayError(f"color must be one image of shape (H, W, 3), uint8, got {image.dtype} of {image.shape}")
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
