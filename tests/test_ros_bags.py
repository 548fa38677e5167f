# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of ROS 2 bags: every kind of message, in both storages, and bags that say too little or too much."""

import numpy as np
import pytest

import warpvis as wv
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.io import read_frames

rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")

STORE = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
STORAGES = {"mcap": rosbag2.StoragePlugin.MCAP, "sqlite3": rosbag2.StoragePlugin.SQLITE3}
ROWS = np.random.default_rng(0).normal(size=(5, 7))
ROWS[:, 3:] /= np.linalg.norm(ROWS[:, 3:], axis=1, keepdims=True)
SECONDS = [10, 10, 11, 12, 1_700_000_000]
NANOSECONDS = [0, 500_000_000, 1, 0, 250_000_000]
TIMES = np.array(SECONDS) + 1e-9 * np.array(NANOSECONDS)
ROS = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""A ROS body's axes in the OpenCV camera's frame: forward is z, left is -x, up is -y."""


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
    """Topics of messages, one each 10 ms; the one file of the bag."""
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


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_message_in_both_storages(tmp_path, kind, storage):
    messages, convention = KINDS[kind]
    text = STORE.types["std_msgs/msg/String"](data="hello")
    file = write_bag(tmp_path / "bag", {"/camera": messages, "/chatter": [text]}, storage)
    times = np.array([10, 10, 10.5, 10.5, 10.5]) if kind == "PoseArray" else TIMES
    for place in (tmp_path / "bag", file):
        frames = read_frames(place)
        matrices, given = poses_to_matrices(frames.camera_to_world), poses_to_matrices(ROWS)
        turn = given[:, :3, :3] @ (ROS.T if convention == "ros_body" else np.eye(3))
        np.testing.assert_allclose(matrices[:, :3, :3], turn, atol=1e-12)
        np.testing.assert_array_equal(matrices[:, :3, 3], ROWS[:, :3])
        np.testing.assert_allclose(frames.timestamps, times, rtol=1e-15)
        source = {"file": place.name, "format": "ros", "convention": convention, "topic": "/camera"}
        assert frames.source == source
        other = read_frames(place, convention="opengl", topic="/camera").camera_to_world
        np.testing.assert_allclose(other, poses_to_opencv(ROWS, "opengl"), atol=1e-12)


def test_topics_and_child_frames_are_chosen(tmp_path):
    tf = [
        transforms(transform_stamped(0, ROWS[0], "base", "odom"), transform_stamped(0, ROWS[1], "eye_optical_frame")),
        transforms(transform_stamped(1, ROWS[2], "eye_optical_frame")),
    ]
    topics = {"/tf": tf, "/pose": [pose_stamped(0, ROWS[3])]}
    write_bag(tmp_path / "bag", topics)
    frames = read_frames(tmp_path / "bag", topic="/tf:eye_optical_frame")
    np.testing.assert_allclose(poses_to_matrices(frames.camera_to_world), poses_to_matrices(ROWS[1:3]), atol=1e-12)
    assert frames.source["topic"] == "/tf:eye_optical_frame"
    assert len(read_frames(tmp_path / "bag", topic="/pose")) == 1
    for topic, said in (
        (
            None,
            "the bag has several topics with poses; choose one as topic=: it has /pose (geometry_msgs/msg/PoseStamp",
        ),
        ("/tf", "topic /tf has the child frames base, eye_optical_frame; choose one as topic='/tf:base'"),
        ("/tf:hand", "topic /tf has no child frame 'hand'; it has base, eye_optical_frame"),
        ("/pose:hand", "topic /pose has no child frame 'hand'; it has none"),
        (
            "/nothing",
            "the bag has no topic '/nothing'; topics with poses are: /pose (geometry_msgs/msg/PoseStamped), /tf",
        ),
    ):
        with pytest.raises(wv.errors.FileFormatError) as error:
            read_frames(tmp_path / "bag", topic=topic)
        assert str(error.value).startswith(f"{tmp_path / 'bag'}: {said}")


def test_stamps_of_zero_are_none(tmp_path):
    messages = [pose_stamped(0, row) for row in ROWS]
    for message in messages:
        message.header.stamp.sec = 0
    write_bag(tmp_path / "bag", {"/pose": messages})
    np.testing.assert_array_equal(read_frames(tmp_path / "bag").timestamps, np.arange(5))


@pytest.mark.parametrize(
    ("topics", "said"),
    [
        ({}, ": the bag has no topic with poses: it has no topics"),
        (
            {"/chatter": "std_msgs/msg/String"},
            ": the bag has no topic with poses: it has /chatter (std_msgs/msg/String)",
        ),
        ({"/pose": "geometry_msgs/msg/PoseStamped"}, ": topic /pose holds no poses"),
        ({"/path": [path(0, ROWS), path(1, [])]}, ": topic /path holds no poses"),
        (
            {"/pose": [pose_stamped(0, ROWS[0]), pose_stamped(1, ROWS[1], "odom")]},
            ": topic /pose has poses in the frames map, odom, and transforms are not chained",
        ),
        (
            {"/pose": [pose_stamped(0, ROWS[0]), pose_stamped(1, np.zeros(7))]},
            ": topic /pose: pose 1: poses must have quaternions of length 1, got 0",
        ),
        (
            {"/pose": [pose_stamped(0, [np.nan] * 7)]},
            ": topic /pose: pose 0: poses must be finite numbers of at most 1e18",
        ),
    ],
)
def test_bags_without_poses(tmp_path, topics, said):
    write_bag(tmp_path / "bag", topics)
    with pytest.raises(wv.errors.FileFormatError) as error:
        read_frames(tmp_path / "bag")
    assert str(error.value) == f"{tmp_path / 'bag'}{said}"


def test_another_topic_is_asked_for(tmp_path):
    write_bag(tmp_path / "bag", {"/chatter": "std_msgs/msg/String"})
    with pytest.raises(
        wv.errors.FileFormatError, match=r"topic /chatter has type std_msgs/msg/String, which has no poses"
    ):
        read_frames(tmp_path / "bag", topic="/chatter")


@pytest.mark.parametrize("storage", STORAGES)
def test_damaged_bags_are_read_or_refused(tmp_path, storage):
    file = write_bag(tmp_path / "bag", {"/pose": KINDS["PoseStamped"][0]}, storage)
    content, rng = file.read_bytes(), np.random.default_rng(0)
    damaged = tmp_path / f"damaged{file.suffix}"
    refused = 0
    for trial in range(60):
        changed = bytearray(content[: rng.integers(len(content))] if trial % 2 else content)
        for place in rng.integers(max(len(changed), 1), size=rng.integers(20)):
            changed[place : place + 1] = rng.bytes(1)
        damaged.write_bytes(changed)
        try:
            assert np.isfinite(read_frames(damaged).camera_to_world).all()
        except wv.errors.FileFormatError as error:
            refused += 1
            assert str(error).startswith(str(damaged))
            assert "\n" not in str(error)
    assert refused >= 20
    for text in ("", "a: [", "a: 1", "rosbag2_bagfile_information: 3", "\xff"):
        (tmp_path / "bag" / "metadata.yaml").write_text(text, encoding="latin-1")
        with pytest.raises(wv.errors.FileFormatError) as error:
            read_frames(tmp_path / "bag")
        assert str(error.value).startswith(f"{tmp_path / 'bag'}: ")
        assert "\n" not in str(error.value)
