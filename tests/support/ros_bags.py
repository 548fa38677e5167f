# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""ROS bags with poses."""

import numpy as np
import pytest

rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")
STORE = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
STORAGES = {"mcap": rosbag2.StoragePlugin.MCAP, "sqlite3": rosbag2.StoragePlugin.SQLITE3}
ROWS = np.random.default_rng(0).normal(size=(5, 7))
ROWS[:, 3:] /= np.linalg.norm(ROWS[:, 3:], axis=1, keepdims=True)
SECONDS = [10, 10, 11, 12, 1_700_000_000]
NANOSECONDS = [0, 500_000_000, 1, 0, 250_000_000]


def make(kind, **fields):
    return STORE.types[kind](**fields)


def header(i, frame="map"):
    stamp = make("builtin_interfaces/msg/Time", sec=SECONDS[i], nanosec=NANOSECONDS[i])
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def vector(kind, values):
    return make(f"geometry_msgs/msg/{kind}", **dict(zip("xyzw", map(float, values), strict=False)))


def pose(row):
    place, turn = vector("Point", row[:3]), vector("Quaternion", row[3:])
    return make("geometry_msgs/msg/Pose", position=place, orientation=turn)


def with_covariance(row):
    return make("geometry_msgs/msg/PoseWithCovariance", pose=pose(row), covariance=np.zeros(36))


def pose_stamped(i, row, frame="map"):
    return make("geometry_msgs/msg/PoseStamped", header=header(i, frame), pose=pose(row))


def covariance_stamped(i, row):
    return make("geometry_msgs/msg/PoseWithCovarianceStamped", header=header(i), pose=with_covariance(row))


def transform_stamped(i, row, child="camera_optical_frame", parent="map"):
    transform = make(
        "geometry_msgs/msg/Transform",
        translation=vector("Vector3", row[:3]),
        rotation=vector("Quaternion", row[3:]),
    )
    return make(
        "geometry_msgs/msg/TransformStamped", header=header(i, parent), child_frame_id=child, transform=transform
    )


def odometry(i, row, child="base_link"):
    twist = make("geometry_msgs/msg/Twist", linear=vector("Vector3", (0, 0, 0)), angular=vector("Vector3", (0, 0, 0)))
    twist = make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36))
    return make("nav_msgs/msg/Odometry", header=header(i), child_frame_id=child, pose=with_covariance(row), twist=twist)


def path(i, rows):
    poses = [pose_stamped(j, row, "") for j, row in enumerate(rows)]
    return make("nav_msgs/msg/Path", header=header(i), poses=poses)


def pose_array(i, rows):
    return make("geometry_msgs/msg/PoseArray", header=header(i), poses=[pose(row) for row in rows])


def transforms(*items):
    return make("tf2_msgs/msg/TFMessage", transforms=list(items))


def write_bag(folder, topics, storage="mcap"):
    """Write topics of messages 10 ms apart, and return the bag's only file."""
    with rosbag2.Writer(folder, version=9, storage_plugin=STORAGES[storage]) as writer:
        for name, messages in topics.items():
            kind = messages if isinstance(messages, str) else messages[0].__msgtype__
            connection = writer.add_connection(name, kind, typestore=STORE)
            for i, message in enumerate([] if isinstance(messages, str) else messages):
                writer.write(connection, 10_000_000 * (i + 1), STORE.serialize_cdr(message, kind))
    (file,) = folder.glob("*.mcap" if storage == "mcap" else "*.db3")
    return file


KINDS = {
    "PoseStamped": ([pose_stamped(*item) for item in enumerate(ROWS)], "ros_body"),
    "PoseWithCovarianceStamped": ([covariance_stamped(*item) for item in enumerate(ROWS)], "ros_body"),
    "TransformStamped": ([transform_stamped(*item) for item in enumerate(ROWS)], "opencv"),
    "transform of a body": ([transform_stamped(*item, child="base") for item in enumerate(ROWS)], "ros_body"),
    "Odometry": ([odometry(*item) for item in enumerate(ROWS)], "ros_body"),
    "optical Odometry": ([odometry(*item, child="left_optical_frame") for item in enumerate(ROWS)], "opencv"),
    "Path": ([path(0, ROWS[:2]), path(1, ROWS[::-1]), path(2, ROWS)], "ros_body"),
    "PoseArray": ([pose_array(0, ROWS[:2]), pose_array(1, ROWS[2:])], "ros_body"),
    "TFMessage": ([transforms(transform_stamped(i, row)) for i, row in enumerate(ROWS)], "opencv"),
}
