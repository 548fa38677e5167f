# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of occupancy grids to ROS 2 messages."""

from __future__ import annotations

from warpvis.core.checks import check_number
from warpvis.core.messages import Message, MessageMaker, MessageTypes, Stamp
from warpvis.errors import MessageError
from warpvis.maps import OccupancyGrid


def to_occupancy_grid(
    grid: OccupancyGrid,
    *,
    frame_id: str,
    stamp: Stamp = 0.0,
    height: float = 0.0,
    types: MessageTypes | None = None,
) -> Message:
    """Create a ``nav_msgs/OccupancyGrid``. It shares no memory with the grid.

    Args:
        grid: The grid, from `OccupancyMap.occupancy_grid`.
        frame_id: The fixed frame of the map, with z up; x and y are the first and the second axis of the grid.
        stamp: Time of the grid [s], or a Time message.
        height: Height of the floor in the frame [m], which is the z of the grid's origin.
        types: A type store of rosbags; by default ROS's own classes, which must be installed.

    Raises:
        MessageError: If an argument is invalid, or ROS is not installed.
    """
    if not isinstance(grid, OccupancyGrid):
        raise MessageError(f"grid must be a warpvis.maps.OccupancyGrid, got {type(grid).__name__}")
    maker = MessageMaker(types)
    header = maker.header(frame_id, stamp)
    x, y = grid.origin
    z = check_number(height, "height", error=MessageError)
    rows, columns = grid.cells.shape
    info = maker.make(
        "nav_msgs/msg/MapMetaData",
        map_load_time=header.stamp,
        resolution=float(grid.cell_size),
        width=columns,
        height=rows,
        origin=maker.make(
            "geometry_msgs/msg/Pose",
            position=maker.make("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=maker.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        ),
    )
    return maker.make("nav_msgs/msg/OccupancyGrid", header=header, info=info, data=maker.sequence(grid.cells.flatten()))
