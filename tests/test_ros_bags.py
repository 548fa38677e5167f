# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of poses from ROS 2 bags: every message type, both storages, and bags with missing or ambiguous poses."""

import numpy as np
import pytest

import warpvis as wv
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.io import read_frames

from support.ros_bags import (
    KINDS,
    NANOSECONDS,
    ROWS,
    SECONDS,
    STORAGES,
    STORE,
    path,
    pose_stamped,
    transform_stamped,
    transforms,
    write_bag,
)

TIMES = np.array(SECONDS) + 1e-9 * np.array(NANOSECONDS)
ROS = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""Axes of a ROS body in the OpenCV camera's frame: forward is z, left is -x, up is -y."""


@pytest.mark.smoke("*-mcap")
@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("kind", KINDS)
def test_message_types_in_both_storages(tmp_path, kind, storage):
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


def test_topics_and_child_frames_are_selected(tmp_path):
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


def test_zero_stamps_are_replaced_by_indices(tmp_path):
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
def test_bags_without_poses_raise(tmp_path, topics, said):
    write_bag(tmp_path / "bag", topics)
    with pytest.raises(wv.errors.FileFormatError) as error:
        read_frames(tmp_path / "bag")
    assert str(error.value) == f"{tmp_path / 'bag'}{said}"


def test_topic_without_poses_raises(tmp_path):
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
