# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of Livox lidars as the messages of Livox's own driver, livox_ros_driver2, which odometry packages take."""

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
    """Teach a type store of rosbags the messages of livox_ros_driver2, CustomMsg and CustomPoint, if it has them not.

    Args:
        types: A type store of ROS 2, such as `rosbags.typesys.get_typestore` gives.

    Raises:
        MessageError: It is none.
    """
    MessageMaker(types)  # which says what a type store is
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
    """Make a ``livox_ros_driver2/CustomMsg`` of a lidar's cloud. It shares no memory with it.

    Points are in the order of their times, and what was not measured is left out. FAST-LIO and Point-LIO take points
    whose ``line`` is below their ``scan_line`` and bit 5 of whose ``tag`` is 0, and the last one's time for the end of
    the frame.

    Args:
        cloud: A cloud with times, one of those that `warpvis.sensors.point_clouds` makes of a frame of
            `warpvis.sensors.lidars.livox`. Its ``time`` becomes ``offset_time`` [ns], ``ring`` is the ``line``, an
            ``intensity`` of 1 a ``reflectivity`` of 255, and ``tag``, if there is one, the ``tag``; else these are 0.
        frame_id: The lidar's frame.
        stamp: What times are counted from, the frame's start [s], or a Time message: the ``timebase``.
        lidar_id: Number of the lidar, 0 to 255.
        types: A type store of rosbags that has the messages, by `register_livox_types`; by default livox_ros_driver2's
            own classes, which must be there then.

    Raises:
        ArrayError: The cloud is none, has no times, or numbers that do not fit.
        MessageError: Another argument is not what it has to be, or the classes are not there.
    """
    maker = MessageMaker(types)
    if types is not None and _MESSAGE not in types.types:
        raise MessageError(f"types have no {_MESSAGE}: warpvis.io.register_livox_types(types) adds it")
    number = check_whole(lidar_id, "lidar_id", least=0, error=MessageError)
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
