# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the ROS 2 node that watches a depth camera, without ROS: stand-ins for a node, tf and messages."""

import importlib.util
import json
import sys
import types
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rosbags.typesys")

import ros_messages
from scipy.spatial.transform import Rotation

import warpvis as wv

from support.ros_nodes import Buffer, Missing, Node, Time
from support.watching import BALL, BOX, CAMERA, FLOOR, depths, person, raised, trajectory

PATH = Path(__file__).parent.parent / "examples" / "ros2_watch.py"
FRAME = "camera_depth_optical_frame"
KINDS = [
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CameraInfo",
    "std_msgs/msg/String",
    "nav_msgs/msg/OccupancyGrid",
]
PLACES = " ".join(f"{name}={','.join(map(str, raised(place)))}" for name, place in (("ball", BALL), ("box", BOX)))
OPTIONS = {"places": PLACES, "people": "anna=anna_head", "people_axes": "ros_optical", "floor_height": FLOOR}
OPTIONS |= {"cell_size": 0.04, "near": CAMERA.near, "far": CAMERA.far}


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("ros2_watch", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def start(example, monkeypatch):
    """Return a function that starts a node with given parameters and returns it, its tf buffer and messages."""
    messages = ros_messages.install(monkeypatch)

    def start(**parameters):
        node, buffer = Node(messages, OPTIONS | parameters), Buffer(messages)
        ros = example.Ros(*(messages[kind] for kind in KINDS), Time, buffer, Missing, "sensor")
        example.Watch(node, ros)
        return node, buffer

    return start


def row(pose):
    return tuple(map(float, pose))


def send(node, images, times):
    """Deliver the calibration and depth images at whole seconds."""
    node.takes["depth/camera_info"][1](CAMERA.to_camera_info(frame_id=FRAME, stamp=float(times[0])))
    for image, time in zip(images, times, strict=True):
        node.takes["depth/image_rect"][1](wv.io.to_image_msg(image, frame_id=FRAME, stamp=float(time)))


def test_node_publishes_what_a_watcher_reports(start):
    node, buffer = start()
    poses, anna = trajectory(4), person()
    images = depths(poses)
    for time, pose in enumerate(poses, 1):
        buffer.tell(FRAME, row(pose), float(time))
    buffer.tell("anna_head", row(anna.poses[0]), 1.0)
    send(node, images, range(1, 5))
    places = {"ball": raised(BALL), "box": raised(BOX)}
    watcher = wv.visibility.DepthWatcher(CAMERA, places=places, floor=FLOOR, cell_size=0.04)
    expected = [
        watcher.update(image, pose, [anna], time=time)
        for time, (image, pose) in enumerate(zip(images, poses, strict=True), 1)
    ]
    published = {name: node.published[name] for name in ("labels", "visibility", "candidates")}
    assert all(len(messages) == 4 for messages in published.values())
    for index, watched in enumerate(expected):
        labels = published["labels"][index]
        assert (labels.encoding, labels.step, labels.header.frame_id) == ("mono8", 160, FRAME)
        found = np.frombuffer(bytes(labels.data), dtype=np.uint8).reshape(120, 160)
        assert (found == watched.labels).mean() > 0.999
        seen = json.loads(published["visibility"][index].data)
        assert seen["header"] == {"stamp": {"sec": index + 1, "nanosec": 0}, "frame_id": "map"}
        for agent, sights in watched.sights.items():
            for place, sight in sights.items():
                assert seen["agents"][agent][place]["status"] == sight.status.name.lower()
                assert seen["agents"][agent][place]["hidden"] == pytest.approx(sight.hidden, abs=1e-4)
        meant = json.loads(published["candidates"][index].data)["people"]["anna"]
        assert meant == pytest.approx(watched.candidates["anna"], abs=1e-3)


def test_images_wait_for_their_transform(start):
    node, buffer = start()
    poses = trajectory(3)
    images = depths(poses)
    send(node, images[:2], (1, 2))
    assert node.published["labels"] == [] and len(node.warned) == 1 and FRAME in node.warned[0]
    for time, pose in enumerate(poses, 1):
        buffer.tell(FRAME, row(pose), float(time))
    send(node, images[2:], (3,))
    assert [message.header.stamp.sec for message in node.published["labels"]] == [1, 2, 3]
    assert "anna_head" in node.warned[1] and len(node.warned) == 2
    assert list(json.loads(node.published["visibility"][0].data)["agents"]) == ["robot"]


def test_floor_map_is_an_occupancy_grid_in_the_fixed_frame(start):
    node, buffer = start()
    (period, publish) = node.timers[0]
    publish()
    assert period == 1.0 and node.published["floor_map"] == []
    poses = trajectory(3)
    for time, pose in enumerate(poses, 1):
        buffer.tell(FRAME, row(pose), float(time))
    send(node, depths(poses), (1, 2, 3))
    publish()
    (grid,) = node.published["floor_map"]
    assert grid.header.frame_id == "map" and grid.header.stamp.sec == 3
    values = np.array(grid.data).reshape(grid.info.height, grid.info.width)
    assert set(np.unique(values)) == {-1, 0, 100}
    origin = grid.info.origin.position
    assert origin.z == pytest.approx(FLOOR) and grid.info.origin.orientation.w == 1

    def value_at(x, y):
        return values[int((y - origin.y) / 0.04), int((x - origin.x) / 0.04)]

    assert value_at(1.5, -0.3) == 0 and value_at(2.58, 0.6) == 100 and value_at(1.0, 3.0) == -1
    assert value_at(BALL[0] - 0.06, BALL[1]) == 100  # the front of its table


def test_grid_of_a_tilted_world(example):
    """The corner of the map is the same point in both worlds."""
    turn = Rotation.from_euler("xyz", (0.4, -0.2, 1.1))
    transform = np.concatenate([(0.3, -2, 1), turn.as_quat()])
    position, orientation = SimpleNamespace(x=-1.5, y=2.0, z=0.0), SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
    example.place_in_frame(SimpleNamespace(position=position, orientation=orientation), transform)
    found = [position.x, position.y, position.z]
    np.testing.assert_allclose(turn.apply(found) + transform[:3], (-1.5, 2.0, 0), atol=1e-12)
    quaternion = [orientation.x, orientation.y, orientation.z, orientation.w]
    np.testing.assert_allclose((Rotation.from_quat(quaternion) * turn).magnitude(), 0, atol=1e-12)


def test_another_calibration_starts_a_new_map(start):
    node, buffer = start()
    poses = trajectory(2)
    images = depths(poses)
    for time, pose in enumerate(poses, 1):
        buffer.tell(FRAME, row(pose), float(time))
    send(node, images[:1], (1,))
    half = wv.Camera.from_fov(80, 60, hfov=1.4, near=CAMERA.near, far=CAMERA.far)
    node.takes["depth/camera_info"][1](half.to_camera_info(frame_id=FRAME, stamp=2.0))
    node.takes["depth/image_rect"][1](wv.io.to_image_msg(images[1][::2, ::2], frame_id=FRAME, stamp=2.0))
    assert [message.width for message in node.published["labels"]] == [160, 80]


def test_missing_floor_is_reported_once(start):
    node, buffer = start(search_floor=True)
    pose = wv.look_at((0, 0, 1), (3, 0, 1))
    for time in (1, 2):
        buffer.tell(FRAME, row(pose), float(time))
    send(node, np.full((2, 120, 160), 3.0, dtype=np.float32), (1, 2))
    assert node.published["labels"] == []
    assert sum("no floor was found" in text for text in node.warned) == 1


def test_node_runs_and_stops(example, monkeypatch):
    """Run `main` with stand-ins for the modules that it imports."""
    messages = ros_messages.install(monkeypatch)
    node, buffer = Node(messages, OPTIONS), Buffer(messages)
    pose = trajectory(1)
    buffer.tell(FRAME, row(pose[0]), 1.0)
    calls = []

    def spin(spun):
        assert spun is node
        send(node, depths(pose), (1,))
        raise KeyboardInterrupt

    def module(name, **members):
        made = types.ModuleType(name)
        vars(made).update(members)
        monkeypatch.setitem(sys.modules, name, made)

    stop = {"try_shutdown": lambda: calls.append("shutdown")}
    module("rclpy", init=lambda: calls.append("init"), create_node=lambda name: node, spin=spin, **stop)
    module("rclpy.qos", qos_profile_sensor_data="sensor")
    module("rclpy.time", Time=Time)
    listen = {"TransformListener": lambda *given: calls.append("listen")}
    module("tf2_ros", Buffer=lambda: buffer, TransformException=Missing, **listen)
    example.main()
    assert calls == ["init", "listen", "shutdown"] and node.destroyed
    assert len(node.published["visibility"]) == 1 and node.takes["depth/image_rect"][2] == "sensor"
