# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of Livox lidars as messages of Livox's driver, livox_ros_driver2, which odometry packages subscribe to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import check_whole
from warpvis.core.messages import Message, MessageMaker, MessageTypes, Stamp, stamp_nanoseconds
from warpvis.errors import MessageError
from warpvis.io._cloud_messages import as_livox_points, check_cloud

_MESSAGE, _POINT = "livox_ros_driver2/msg/CustomMsg", "livox_ros_driver2/msg/CustomPoint"

# The fields of msg/CustomMsg.msg and msg/CustomPoint.msg of livox_ros_driver2.
_DEFINITIONS = {
    _POINT: "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n",
    _MESSAGE: "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
    "livox_ros_driver2/CustomPoint[] points\n",
}


def register_livox_types(types: MessageTypes) -> None:
    """Add the messages of livox_ros_driver2, CustomMsg and CustomPoint, to a type store of rosbags, if missing.

    Args:
        types: A type store of ROS 2, such as from `rosbags.typesys.get_typestore`.

    Raises:
        MessageError: If `types` is not a type store.
    """
    MessageMaker(types)  # checks the type store
    store: Any = types
    if not hasattr(store, "register"):
        raise MessageError(f"types must be a type store of rosbags, got {types!r}")
    from rosbags.typesys import get_types_from_msg

    for name, text in _DEFINITIONS.items():
        if name not in store.types:
            store.register(get_types_from_msg(text, name))


def to_livox_msg(
    cloud: NDArray[np.void],
    *,
    frame_id: str,
    stamp: Stamp = 0.0,
    lidar_id: int = 0,
    types: MessageTypes | None = None,
) -> Message:
    """Create a ``livox_ros_driver2/CustomMsg`` from a lidar's cloud. It shares no memory with the cloud.

    Points are in order of time; points without a return are left out. FAST-LIO and Point-LIO use points whose ``line``
    is below their ``scan_line`` and whose ``tag`` has bit 5 cleared, and take the time of the last point as the end of
    the frame.

    Args:
        cloud: A cloud with times, as `warpvis.sensors.point_clouds` returns for a frame of
            `warpvis.sensors.lidars.livox`. Its ``time`` becomes ``offset_time`` [ns], ``ring`` the ``line``, an
            ``intensity`` of 1 a ``reflectivity`` of 255, and ``tag`` the ``tag``; missing fields become 0.
        frame_id: The lidar's frame.
        stamp: Origin of the times, the start of the frame [s], or a Time message: the ``timebase``.
        lidar_id: Number of the lidar, 0 to 255.
        types: A type store of rosbags with these messages, see `register_livox_types`; by default livox_ros_driver2's
            own classes, which must be installed.

    Raises:
        ArrayError: If it is not a cloud, has no times, or has values out of range.
        MessageError: If another argument is invalid, or the classes are not installed.
    """
    maker = MessageMaker(types)
    if types is not None and _MESSAGE not in types.types:
        raise MessageError(f"types have no {_MESSAGE}: warpvis.io.register_livox_types(types) adds it")
    number = check_whole(lidar_id, "lidar_id", minimum=0, error=MessageError)
    if number > 255:
        raise MessageError(f"lidar_id must be from 0 to 255, got {lidar_id}")
    points = as_livox_points(check_cloud(cloud))
    names = points.dtype.names or ()
    return maker.make(
        _MESSAGE,
        header=maker.header(frame_id, stamp),
        timebase=stamp_nanoseconds(stamp),
        point_num=len(points),
        lidar_id=number,
        rsvd=np.zeros(3, dtype=np.uint8),
        points=[maker.make(_POINT, **dict(zip(names, row, strict=True))) for row in points.tolist()],
    )
