# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lidar scans as ROS 2 messages: a LaserScan, the fields of a PointCloud2, and the CustomMsg of livox_ros_driver2."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras import Rays
from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_choice, check_number, check_whole
from warpvis.core.messages import Message, MessageMaker, MessageTypes, Stamp, stamp_nanoseconds
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, MessageError

CloudLayout = Literal["velodyne", "ouster", "ouster_legacy", "hesai", "livox"]
"""Driver whose fields a PointCloud2 has."""

# sensor_msgs/PointField
DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}

_VELODYNE = (("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4"))
_OUSTER = (
    *_VELODYNE[:4], ("t", "<u4"), ("reflectivity", "<u2"), ("ring", "<u2"), ("ambient", "<u2"), ("range", "<u4"),
)  # fmt: skip
# FAST-LIO, Point-LIO and LIO-SAM have the point of Ouster's driver before 0.7.1, and PCL skips fields of other types.
_OUSTER_LEGACY = tuple((name, "u1" if name == "ring" else kind) for name, kind in _OUSTER)
_HESAI = (*_VELODYNE[:5], ("timestamp", "<f8"))
_LAYOUTS = {"velodyne": _VELODYNE, "ouster": _OUSTER, "ouster_legacy": _OUSTER_LEGACY, "hesai": _HESAI}
_LIVOX = (*_VELODYNE[:4], ("tag", "u1"), ("line", "u1"), ("timestamp", "<f8"))
# Units per unit of the source field, and maximum value: nanoseconds, millimeters, 1 / 255.
_SCALES = {"t": (1e9, 2**32 - 1), "range": (1e3, 2**32 - 1), "reflectivity": (255.0, 2**16 - 1)}

# Fields of a point in Livox's CustomPoint message.
_LIVOX_POINT = (
    ("offset_time", "<u4"), *_VELODYNE[:3], ("reflectivity", "u1"), ("tag", "u1"), ("line", "u1"),
)  # fmt: skip

_STRAIGHT = 1e-6  # rad

_MESSAGE, _POINT = "livox_ros_driver2/msg/CustomMsg", "livox_ros_driver2/msg/CustomPoint"

# The fields of msg/CustomMsg.msg and msg/CustomPoint.msg of livox_ros_driver2.
_DEFINITIONS = {
    _POINT: "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n",
    _MESSAGE: "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
    "livox_ros_driver2/CustomPoint[] points\n",
}


def check_cloud(cloud: object) -> NDArray[np.void]:
    """Check for a structured array with the fields x, y and z, of shape ``(N,)`` or ``(H, W)``, and return it."""
    if not isinstance(cloud, np.ndarray) or cloud.dtype.names is None:
        raise ArrayError("a cloud must be a NumPy array with named fields, as returned by warpvis.sensors.point_clouds")
    names = cloud.dtype.names
    if not {"x", "y", "z"} <= set(names) or cloud.ndim not in (1, 2):
        raise ArrayError(f"a cloud must have fields x, y and z, and one or two dimensions, got {', '.join(names)}")
    unknown = [name for name in names if cloud.dtype[name].str[1:] not in DATATYPES]
    if unknown:
        raise ArrayError(f"the field {unknown[0]} of a cloud must be a number, got {cloud.dtype[unknown[0]]}")
    return cloud


def as_layout(cloud: NDArray[np.void], layout: CloudLayout | None, stamp: Stamp = 0.0) -> NDArray[np.void]:
    """Return a packed cloud with the fields of a driver; `stamp` is the origin of its times."""
    if layout is None:
        fields = [(name, cloud.dtype[name].newbyteorder("<").str) for name in cloud.dtype.names or ()]
    else:
        check_choice(layout, "layout", (*_LAYOUTS, "livox"), MessageError)
        if layout == "livox":
            return _as_livox_cloud(cloud, stamp)
        fields = list(_LAYOUTS[layout])
    packed = np.zeros(cloud.shape, dtype=fields)
    for name, _ in fields:
        packed[name] = _field(cloud, name, layout)
    if layout == "hesai":
        packed["timestamp"] += stamp_nanoseconds(stamp) * 1e-9
    return packed


def _field(cloud: NDArray[np.void], name: str, layout: CloudLayout | None) -> Any:
    """Return the values of a driver's field; 0 for fields that a ray caster does not compute."""
    names = cloud.dtype.names or ()
    if layout is None or name in ("x", "y", "z"):
        return cloud[name]
    if name == "ambient" or (name in ("intensity", "reflectivity") and "intensity" not in names):
        return 0
    source = {"t": "time", "timestamp": "time", "reflectivity": "intensity"}.get(name, name)
    if source not in names:
        raise ArrayError(f'the layout "{layout}" needs the field {source}, which the cloud lacks')
    values = cloud[source]
    if layout == "ouster_legacy" and name == "ring":
        return _whole(values, 1.0, 255, name, source)
    if layout in ("ouster", "ouster_legacy") and name in _SCALES:  # 0 where nothing was measured
        return _whole(np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0), *_SCALES[name], name, source)
    return values


def as_livox_points(cloud: NDArray[np.void]) -> NDArray[np.void]:
    """Return the points of a cloud in the format of Livox's driver, in order of time; unavailable fields are 0."""
    names = cloud.dtype.names or ()
    if "time" not in names:
        raise ArrayError('the layout "livox" needs the field time, which the cloud lacks')
    flat = cloud.reshape(-1)
    flat = flat[np.isfinite(flat["x"]) & np.isfinite(flat["y"]) & np.isfinite(flat["z"])]
    flat = flat[np.argsort(flat["time"], kind="stable")]
    points = np.zeros(len(flat), dtype=list(_LIVOX_POINT))
    for axis in "xyz":
        points[axis] = flat[axis]
    sources = {"offset_time": ("time", 1e9), "reflectivity": ("intensity", 255.0), "tag": ("tag", 1.0)}
    for name, (source, scale) in (sources | {"line": ("ring", 1.0)}).items():
        if source in names:
            points[name] = _whole(flat[source], scale, np.iinfo(points.dtype[name]).max, name, source)
    return points


def _as_livox_cloud(cloud: NDArray[np.void], stamp: Stamp) -> NDArray[np.void]:
    """Return a cloud with the fields of the PointCloud2 of Livox's driver, whose times are absolute nanoseconds."""
    points = as_livox_points(cloud)
    packed = np.zeros(len(points), dtype=list(_LIVOX))
    for name in ("x", "y", "z", "tag", "line"):
        packed[name] = points[name]
    packed["intensity"] = points["reflectivity"]
    # As in the driver: a double resolves today's nanoseconds to 256 ns.
    packed["timestamp"] = (stamp_nanoseconds(stamp) + points["offset_time"].astype(np.int64)).astype(np.float64)
    return packed


def _whole(values: NDArray[Any], scale: float, maximum: int, name: str, source: str) -> NDArray[np.float64]:
    """Return whole numbers in the unit of a field."""
    scaled = np.rint(values.astype(np.float64) * scale)
    if scaled.size and not 0 <= scaled.min() <= scaled.max() <= maximum:
        raise ArrayError(
            f"{source} must be from 0 to {maximum / scale:g} for the field {name}, got {scaled.min() / scale:g} to "
            f"{scaled.max() / scale:g}"
        )
    return scaled


def to_laserscan(
    ranges: ArrayInput,
    rays: Rays,
    *,
    frame_id: str,
    stamp: Stamp = 0.0,
    scan_time: float | None = None,
    intensities: ArrayInput | None = None,
    types: MessageTypes | None = None,
) -> Message:
    """Create a ``sensor_msgs/LaserScan`` from one view of a planar scanner. It shares no memory with the arguments.

    Args:
        ranges: Depth of one view [m], float, one per ray: +inf for no return, -inf for too near (REP 117).
        rays: The rendered rays: `warpvis.sensors.lidars.laser_scan` or others in the plane z = 0, evenly spaced.
        frame_id: The scanner's frame: x forward, y left, z up.
        stamp: Time of the first ray [s], or a Time message.
        scan_time: Time between scans [s]; by default the duration of this scan.
        intensities: Intensities, one per ray.
        types: A type store of rosbags; by default ROS's own classes, which must be installed.

    Raises:
        MessageError: If another argument is invalid, or ROS is not installed.
    """
    maker = MessageMaker(types)
    if not isinstance(rays, Rays):
        raise ArrayError(f"rays must be warpvis.cameras.Rays, got {type(rays).__name__}")
    first, last, step, count = _even_angles(rays)
    wait = 0.0 if rays.times is None or count < 2 else _even_times(np.asarray(rays.times).reshape(-1))
    taken = check_number(count * wait if scan_time is None else scan_time, "scan_time", minimum=0.0, error=MessageError)
    row = _one_row(ranges, "ranges", count)
    strengths = np.zeros(0, dtype="<f4") if intensities is None else _one_row(intensities, "intensities", count)
    return maker.make(
        "sensor_msgs/msg/LaserScan",
        header=maker.header(frame_id, stamp),
        angle_min=first,
        angle_max=last,
        angle_increment=step,
        time_increment=wait,
        scan_time=taken,
        range_min=float(rays.near),
        range_max=float(rays.far),
        ranges=maker.sequence(row),
        intensities=maker.sequence(strengths),
    )


def _one_row(values: Any, name: str, count: int) -> NDArray[np.float32]:
    row = as_numpy(values, name=name)
    if row.size != count or row.dtype.kind not in "fiu":
        raise ArrayError(f"{name} must be {count} numbers, one for each ray, got {row.dtype} of {row.shape}")
    return np.array(row.reshape(-1), dtype="<f4")


def _even_angles(rays: Rays) -> tuple[float, float, float, int]:
    """Return the first and last angle of a planar scanner, the increment [rad], and the number of angles."""
    directions = np.asarray(rays.directions).reshape(-1, 3)
    if np.abs(directions[:, 2]).max() > _STRAIGHT or rays.origins is not None:
        raise ArrayError("rays of a LaserScan must be in the plane z = 0, from one point")
    angles = np.unwrap(np.arctan2(directions[:, 1], directions[:, 0]))
    if len(angles) < 2:
        return float(angles[0]), float(angles[0]), 0.0, len(angles)
    step = (angles[-1] - angles[0]) / (len(angles) - 1)
    if np.abs(np.diff(angles) - step).max() > _STRAIGHT:
        raise ArrayError("rays of a LaserScan must be evenly spaced")
    if angles[0] > math.pi - _STRAIGHT and step > 0:
        angles -= 2.0 * math.pi
    return float(angles[0]), float(angles[-1]), float(step), len(angles)


def _even_times(times: NDArray[np.float64]) -> float:
    wait = (times[-1] - times[0]) / (len(times) - 1)
    if np.abs(np.diff(times) - wait).max() > 1e-9:
        raise ArrayError("times of the rays of a LaserScan must be evenly spaced")
    return float(wait)


def register_livox_types(types: MessageTypes) -> None:
    """Add the messages of livox_ros_driver2, CustomMsg and CustomPoint, to a type store of rosbags, if missing.

    The type store is of ROS 2, such as from `rosbags.typesys.get_typestore`.
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
