# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Livox point clouds as messages of Livox's driver: construction, and round trips through bags."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.sensors import lidars

rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")

KIND = "livox_ros_driver2/msg/CustomMsg"
LIVOX_CLOUD = [
    ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("tag", "u1"), ("line", "u1"), ("timestamp", "<f8"),
]  # fmt: skip
STAMP = 1_700_000_000.25


@pytest.fixture(scope="module")
def store():
    made = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    wv.io.register_livox_types(made)
    return made


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    """Return a frame of a Mid-360 in a room without ceiling, so that some rays have no hit."""
    path = tmp_path_factory.mktemp("livox") / "mid360.npy"
    angles = np.random.default_rng(0).uniform((-3.1, -0.1), (3.1, 0.9), (400, 2))
    np.save(path, angles.astype(np.float32))
    rays = lidars.livox("mid360", path).frame(1, samples=200)
    scene = wv.Scene()
    scene.add(trimesh.creation.box((8, 6, 5)), name="walls")
    scene.add(trimesh.creation.box((8, 6, 0.1)), name="floor", pose=(0, 0, -2, 0, 0, 0, 1))
    views = wv.render(scene, rays, (0.3, 0.2, 0.1, 0, 0, 0, 1), outputs="depth")
    echo = np.linspace(0, 1, 200)[None]
    whole = wv.sensors.point_clouds(views, rays, intensity=echo, organized=True)[0]
    for axis in "xyz":
        whole[axis][::7] = np.nan
    return whole


def points_of(message):
    names = ("offset_time", "x", "y", "z", "reflectivity", "tag", "line")
    return [np.array([getattr(point, name) for point in message.points]) for name in names]


def test_message_contains_finite_points_of_cloud(store, cloud):
    message = wv.io.to_livox_msg(cloud, frame_id="livox_frame", stamp=STAMP, lidar_id=7, types=store)
    kept = cloud[np.isfinite(cloud["x"])]
    assert len(kept) == 171 == message.point_num == len(message.points)
    assert (message.timebase, message.lidar_id, message.rsvd.tolist()) == (1_700_000_000_250_000_000, 7, [0, 0, 0])
    stamp = message.header.stamp
    assert (stamp.sec, stamp.nanosec, message.header.frame_id) == (1_700_000_000, 250_000_000, "livox_frame")
    time, x, y, z, reflectivity, tag, line = points_of(message)
    np.testing.assert_allclose(time * 1e-9, kept["time"], atol=1e-9)
    assert (np.diff(time) > 0).all() and time.max() < 100_000_000
    for axis, values in zip("xyz", (x, y, z), strict=True):
        np.testing.assert_array_equal(values.astype(np.float32), kept[axis])
    np.testing.assert_array_equal(reflectivity, np.rint(255 * kept["intensity"].astype(float)))
    np.testing.assert_array_equal(line, kept["ring"])
    assert set(line.tolist()) == {0, 1, 2, 3} and not tag.any()


def test_points_are_sorted_by_time_and_tags_are_kept(store, cloud):
    mixed = np.random.default_rng(1).permutation(cloud)
    first = wv.io.to_livox_msg(cloud, frame_id="a", types=store)
    again = wv.io.to_livox_msg(mixed, frame_id="a", types=store)
    np.testing.assert_array_equal(points_of(first), points_of(again))
    plain = np.zeros(3, dtype=[("x", "f4"), ("y", "f4"), ("z", "f4"), ("time", "f8"), ("tag", "u1")])
    plain["time"], plain["tag"] = [0.2, 4.25, 0.1], [16, 32, 255]
    time, _, _, _, reflectivity, tag, line = points_of(wv.io.to_livox_msg(plain, frame_id="a", types=store))
    assert time.tolist() == [100_000_000, 200_000_000, 4_250_000_000] and tag.tolist() == [255, 16, 32]
    assert not reflectivity.any() and not line.any()
    assert wv.io.to_livox_msg(plain[:0], frame_id="a", types=store).point_num == 0


@pytest.mark.parametrize("storage", ["MCAP", "SQLITE3"])
def test_messages_round_trip_through_bag(tmp_path, store, cloud, storage):
    messages = [wv.io.to_livox_msg(cloud, frame_id="livox", stamp=STAMP + k, types=store) for k in range(2)]
    clouds = [wv.io.to_pointcloud2(cloud, frame_id="livox", stamp=STAMP, layout="livox", types=store)]
    plugin = getattr(rosbag2.StoragePlugin, storage)
    with rosbag2.Writer(tmp_path / "bag", version=9, storage_plugin=plugin) as writer:
        for topic, kind, sent in (("/livox/lidar", KIND, messages), ("/points", "sensor_msgs/msg/PointCloud2", clouds)):
            connection = writer.add_connection(topic, kind, typestore=store)
            for message in sent:
                writer.write(connection, 10**9, store.serialize_cdr(message, kind))
    # The reader takes the message definition from the bag.
    reader_store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    with rosbag2.Reader(tmp_path / "bag") as reader:
        for connection in reader.connections:
            reader_store.register(typesys.get_types_from_msg(connection.msgdef.data, connection.msgtype))
        raw = [(connection, data) for connection, _, data in reader.messages()]
    found = {kind: [] for kind in (KIND, "sensor_msgs/msg/PointCloud2")}
    for connection, data in raw:
        found[connection.msgtype].append(reader_store.deserialize_cdr(data, connection.msgtype))
    assert [message.timebase for message in found[KIND]] == [message.timebase for message in messages]
    for read, written in zip(found[KIND], messages, strict=True):
        for again, once in zip(points_of(read), points_of(written), strict=True):
            np.testing.assert_array_equal(again, once)
    (read,) = found["sensor_msgs/msg/PointCloud2"]
    assert read.point_step == 26
    points = np.frombuffer(read.data.tobytes(), dtype=LIVOX_CLOUD)
    time, x, _, _, reflectivity, tag, line = points_of(messages[0])
    np.testing.assert_array_equal(points["x"], x.astype(np.float32))
    np.testing.assert_array_equal(points["line"], line)
    np.testing.assert_array_equal(points["tag"], tag)
    np.testing.assert_array_equal(points["intensity"], reflectivity)
    assert np.abs(points["timestamp"] - messages[0].timebase - time).max() <= 256


def test_livox_layout_has_fields_of_driver(store, cloud):
    message = wv.io.to_pointcloud2(cloud, frame_id="livox", stamp=2.0, layout="livox", types=store)
    found = [(field.name, field.offset, field.datatype) for field in message.fields]
    assert found == [
        ("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 7), ("tag", 16, 2), ("line", 17, 2),
        ("timestamp", 18, 8),
    ]  # fmt: skip
    points = np.frombuffer(message.data.tobytes(), dtype=LIVOX_CLOUD)
    assert message.is_dense and (message.height, message.width) == (1, 171) == (1, len(points))
    kept = cloud[np.isfinite(cloud["x"])]
    np.testing.assert_allclose(points["timestamp"], (2 + kept["time"].astype(float)) * 1e9, atol=1)
    assert points["intensity"].max() > 200


def test_driver_classes_accept_values(monkeypatch, cloud):
    """The classes of livox_ros_driver2 validate assigned values."""
    import ros_messages

    classes = ros_messages.install(monkeypatch)
    message = wv.io.to_livox_msg(cloud[:20], frame_id="livox", stamp=3.5)
    assert isinstance(message, classes[KIND]) and message.timebase == 3_500_000_000
    assert isinstance(message.points[0], classes["livox_ros_driver2/msg/CustomPoint"])


def named(**columns):
    cloud = np.zeros(2, dtype=[(name, "f8") for name in ("x", "y", "z", *columns)])
    for name, value in columns.items():
        cloud[name] = value
    return cloud


@pytest.mark.parametrize(
    ("cloud", "options", "message"),
    [
        (named(), {}, 'the layout "livox" needs the field time, which the cloud lacks'),
        (named(time=5.0), {}, "time must be from 0 to 4.29497 for the field offset_time, got 5 to 5"),
        (named(time=-1e-3), {}, "time must be from 0 to 4.29497 for the field offset_time, got -0.001 to -0.001"),
        (
            named(time=0.0, intensity=1.2),
            {},
            "intensity must be from 0 to 1 for the field reflectivity, got 1.2 to 1.2",
        ),
        (named(time=np.nan), {}, "time must be from 0 to 4.29497 for the field offset_time, got nan to nan"),
        (named(time=0.0, ring=256), {}, "ring must be from 0 to 255 for the field line, got 256 to 256"),
        (named(time=0.0), {"lidar_id": 300}, "lidar_id must be from 0 to 255, got 300"),
        (np.zeros((4, 3)), {}, "a cloud must be a NumPy array with named fields"),
    ],
)
def test_invalid_clouds_are_rejected(store, cloud, options, message):
    with pytest.raises(wv.WarpvisError, match=message):
        wv.io.to_livox_msg(cloud, frame_id="a", types=store, **options)


def test_missing_message_type_error_names_the_remedy():
    plain = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    with pytest.raises(wv.WarpvisError, match=r"types have no livox_ros_driver2/msg/CustomMsg: .*register_livox_types"):
        wv.io.to_livox_msg(named(time=0.0), frame_id="a", types=plain)
    for wrong in (None, 3, type("Types", (), {"types": {}})()):
        with pytest.raises(wv.WarpvisError, match="types must be a type store of rosbags"):
            wv.io.register_livox_types(wrong)
    wv.io.register_livox_types(plain)
    wv.io.register_livox_types(plain)
    assert KIND in plain.types
