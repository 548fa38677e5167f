# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Point clouds of lidars: fields, files and ROS messages."""

import math

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import cameras, sensors
from warpvis.sensors import lidars

OUTPUTS = ("depth", "points", "normals", "labels", "segmentation")
POSES = np.array([[0.0, 0, 0, 0, 0, 0, 1], [0.5, 0.2, 0.1, 0, 0, math.sin(0.3), math.cos(0.3)]])


@pytest.fixture(scope="module")
def scan():
    """Return two views of a VLP-16 3 m from a wall, the second one rotated, and the rays."""
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.creation.box((0.2, 8, 8)), name="wall", pose=(3.1, 0, 0, 0, 0, 0, 1), label=wv.Label.OBSTACLE)
    rays = lidars.vlp16(20.0)
    return wv.render(scene, rays, POSES, outputs=OUTPUTS), rays


@pytest.fixture(scope="module")
def clouds(scan):
    views, rays = scan
    return sensors.point_clouds(views, rays, intensity=np.full(views.depth.shape, 0.5, dtype=np.float32))


def test_cloud_is_in_the_sensor_frame(scan, clouds):
    views, _ = scan
    assert len(clouds) == 2
    assert clouds[0].dtype.names == ("x", "y", "z", "intensity", "ring", "time", "range", "object", "label")
    assert [clouds[0].dtype[name].str[1:] for name in ("ring", "time", "object", "label")] == ["u2", "f4", "i4", "u1"]
    np.testing.assert_allclose(clouds[0]["x"], 3.0, atol=1e-5)
    assert (np.diff(clouds[0]["time"]) >= 0).all() and 0 <= clouds[0]["time"].min() and clouds[0]["time"].max() < 0.05
    assert (clouds[1]["object"] == 0).all() and (clouds[1]["label"] == wv.Label.OBSTACLE).all()
    # In the world, they equal the rendered points.
    c, s = math.cos(0.6), math.sin(0.6)
    xyz = np.stack([clouds[1][axis] for axis in "xyz"], axis=-1).astype(np.float64)
    world = xyz @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + POSES[1, :3]
    rendered = views.points.numpy()[1].reshape(-1, 3)
    rendered = rendered[np.isfinite(rendered[:, 0])]
    order = [np.lexsort(np.round(points, 3).T) for points in (world, rendered)]
    np.testing.assert_allclose(world[order[0]].sum(0), rendered[order[1]].sum(0), rtol=1e-4)
    np.testing.assert_allclose(world[:, 0], 3.0, atol=1e-5)


def test_organized_cloud_has_the_shape_of_the_rays(scan, clouds):
    views, rays = scan
    whole = sensors.point_clouds(views, rays, organized=True)[0]
    assert whole.shape == rays.directions.shape[:2]
    found = np.isfinite(views.depth.numpy()[0])
    assert (np.isfinite(whole["x"]) == found).all() and found.sum() == len(clouds[0])
    assert (whole["ring"] == rays.rings).all()
    np.testing.assert_allclose(whole["range"][found], views.depth.numpy()[0][found])


def test_kitti_file_reads_as_in_its_devkit(tmp_path, clouds):
    paths = wv.io.save_clouds(tmp_path / "velodyne", clouds, first=7)
    assert [path.name for path in paths] == ["000007.bin", "000008.bin"]
    read = np.fromfile(paths[1], dtype=np.float32).reshape(-1, 4)
    np.testing.assert_array_equal(read, np.stack([clouds[1][name] for name in ("x", "y", "z", "intensity")], axis=-1))


def test_open3d_reads_pcd(tmp_path, clouds):
    open3d = pytest.importorskip("open3d")
    wv.io.save_cloud(tmp_path / "a.pcd", clouds[1])
    read = open3d.t.io.read_point_cloud(str(tmp_path / "a.pcd"))
    np.testing.assert_array_equal(read.point.positions.numpy(), np.stack([clouds[1][a] for a in "xyz"], axis=-1))
    for name in ("ring", "time", "range"):
        np.testing.assert_array_equal(read.point[name].numpy()[:, 0], clouds[1][name])


def test_pcd_header(tmp_path, scan):
    whole = sensors.point_clouds(*scan, organized=True)[0]
    wv.io.save_cloud(tmp_path / "a.pcd", whole)
    head, _, body = (tmp_path / "a.pcd").read_bytes().partition(b"DATA binary\n")
    lines = dict(line.split(" ", 1) for line in head.decode().splitlines()[1:])
    assert lines["FIELDS"] == "x y z ring time range object label" and lines["SIZE"] == "4 4 4 2 4 4 4 1"
    assert lines["TYPE"] == "F F F U F F I U" and (lines["WIDTH"], lines["HEIGHT"]) == (str(whole.shape[1]), "16")
    assert len(body) == whole.size * 27
    read = np.frombuffer(body, dtype=whole.dtype).reshape(whole.shape)
    for name in whole.dtype.names:
        np.testing.assert_array_equal(read[name], whole[name])


def test_trimesh_reads_ply(tmp_path, scan, clouds):
    wv.io.save_cloud(tmp_path / "a.ply", clouds[1])
    read = trimesh.load(tmp_path / "a.ply", process=False).metadata["_ply_raw"]["vertex"]["data"]
    assert read.dtype.names == clouds[1].dtype.names
    for name in clouds[1].dtype.names:
        assert read.dtype[name] == clouds[1].dtype[name]
        np.testing.assert_array_equal(read[name], clouds[1][name])
    whole = sensors.point_clouds(*scan, organized=True)[1]
    wv.io.save_cloud(tmp_path / "b.ply", whole.astype(whole.dtype.newbyteorder(">")))
    np.testing.assert_array_equal(
        wv.io.read_points(tmp_path / "b.ply"),
        np.stack([whole[axis][np.isfinite(whole["x"])] for axis in "xyz"], axis=-1),
    )


def test_open3d_reads_ply(tmp_path, clouds):
    open3d = pytest.importorskip("open3d")
    wv.io.save_cloud(tmp_path / "a.ply", clouds[1])
    read = open3d.t.io.read_point_cloud(str(tmp_path / "a.ply"))
    np.testing.assert_array_equal(read.point.positions.numpy(), np.stack([clouds[1][a] for a in "xyz"], axis=-1))
    for name in ("intensity", "ring", "time", "range"):
        np.testing.assert_array_equal(read.point[name].numpy()[:, 0], clouds[1][name])


def test_laspy_reads_las(tmp_path, clouds):
    laspy = pytest.importorskip("laspy")
    wv.io.save_cloud(tmp_path / "a.las", clouds[1])
    read = laspy.read(tmp_path / "a.las")
    for axis in "xyz":
        np.testing.assert_allclose(read[axis], clouds[1][axis], atol=0.51e-4)
    assert (read.intensity == 32768).all()
    np.testing.assert_array_equal(read["ring"], clouds[1]["ring"])
    np.testing.assert_array_equal(read.gps_time, clouds[1]["time"])
    np.testing.assert_array_equal(read["object"], clouds[1]["object"])


def test_npy_file_has_all_fields(tmp_path, clouds):
    wv.io.save_cloud(tmp_path / "a.npy", clouds[0])
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), clouds[0])


class TestMessages:
    @pytest.fixture(scope="class")
    def types(self):
        typesys = pytest.importorskip("rosbags.typesys")
        return typesys.get_typestore(typesys.Stores.ROS2_JAZZY)

    def test_pointcloud2_has_the_clouds_fields(self, types, clouds):
        message = wv.io.to_pointcloud2(clouds[1], frame_id="velodyne", stamp=2.5, types=types)
        assert [field.name for field in message.fields] == list(clouds[1].dtype.names)
        assert (message.height, message.width, message.point_step) == (1, len(clouds[1]), 31)
        assert message.header.stamp.nanosec == 500_000_000 and message.is_dense
        np.testing.assert_array_equal(np.frombuffer(message.data.tobytes(), dtype=clouds[1].dtype), clouds[1])
        types.serialize_cdr(message, "sensor_msgs/msg/PointCloud2")

    def test_velodyne_layout_matches_its_driver(self, types, clouds):
        message = wv.io.to_pointcloud2(clouds[0], frame_id="velodyne", layout="velodyne", types=types)
        found = [(field.name, field.offset, field.datatype) for field in message.fields]
        assert found == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 7), ("ring", 16, 4), ("time", 18, 7)]
        assert message.point_step == 22

    def test_ouster_layout_matches_its_driver(self, types, clouds):
        message = wv.io.to_pointcloud2(clouds[0], frame_id="os_lidar", layout="ouster", types=types)
        found = [(field.name, field.datatype) for field in message.fields]
        assert found == [
            ("x", 7), ("y", 7), ("z", 7), ("intensity", 7), ("t", 6), ("reflectivity", 4), ("ring", 4), ("ambient", 4),
            ("range", 6),
        ]  # fmt: skip
        kinds = {6: "<u4", 7: "<f4", 4: "<u2"}
        read = np.frombuffer(
            message.data.tobytes(), dtype=[(field.name, kinds[field.datatype]) for field in message.fields]
        )
        np.testing.assert_allclose(read["t"] * 1e-9, clouds[0]["time"], atol=1e-9)
        np.testing.assert_allclose(read["range"] * 1e-3, clouds[0]["range"], atol=0.51e-3)
        assert (read["reflectivity"] == 128).all() and (read["ambient"] == 0).all()

    @pytest.mark.parametrize(
        ("layout", "point"),
        [
            # FAST-LIO (src/preprocess.h at 7cc4175), Point-LIO (ef96597) and LIO-SAM (src/imageProjection.cpp at
            # 0be1fbe) register these points; PCL fills a field only if its name and type match. LIO-SAM has noise
            # instead of ambient and reads neither.
            ("velodyne", "intensity f4, ring u2, time f4"),
            ("ouster_legacy", "intensity f4, t u4, reflectivity u2, ring u1, ambient u2, range u4"),
            ("hesai", "intensity f4, ring u2, timestamp f8"),
        ],
    )
    def test_odometry_packages_find_their_fields(self, types, clouds, layout, point):
        message = wv.io.to_pointcloud2(clouds[0], frame_id="lidar", layout=layout, stamp=2.5, types=types)
        kinds = {2: "u1", 4: "u2", 6: "u4", 7: "f4", 8: "f8"}
        found = [f"{field.name} {kinds[field.datatype]}" for field in message.fields]
        assert found == ["x f4", "y f4", "z f4", *point.split(", ")] and {field.count for field in message.fields} == {
            1
        }
        read = np.frombuffer(message.data.tobytes(), dtype=[(name, "<" + kind) for name, kind in map(str.split, found)])
        assert read.dtype.itemsize == message.point_step
        np.testing.assert_array_equal(read["ring"], clouds[0]["ring"])
        if layout == "hesai":
            np.testing.assert_allclose(read["timestamp"] - 2.5, clouds[0]["time"], atol=1e-12)

    def test_laserscan_angles_and_ranges(self, types):
        rays = lidars.laser_scan(-0.5, 0.5, 0.25, time_increment=0.01, near=0.1, far=9.0)
        ranges = np.array([1.0, 2.0, np.inf, -np.inf, 3.0], dtype=np.float32)
        message = wv.io.to_laserscan(ranges, rays, frame_id="laser", intensities=ranges * 0, types=types)
        assert (message.angle_min, message.angle_max, message.angle_increment) == pytest.approx((-0.5, 0.5, 0.25))
        assert (message.time_increment, message.scan_time) == pytest.approx((0.01, 0.05))
        assert (message.range_min, message.range_max) == (0.1, 9.0)
        np.testing.assert_array_equal(message.ranges, ranges)
        assert len(message.intensities) == 5
        types.serialize_cdr(message, "sensor_msgs/msg/LaserScan")

    @pytest.mark.parametrize(
        ("ends", "first"), [((-math.pi, math.pi, 0.01), -math.pi), ((2.0, -2.0, -0.5), 2.0), ((0.0, 6.0, 0.01), 0.0)]
    )
    def test_laserscan_in_both_directions_and_past_180_degrees(self, types, ends, first):
        rays = lidars.laser_scan(*ends)
        count = rays.directions.size // 3
        message = wv.io.to_laserscan(np.ones(count), rays, frame_id="laser", types=types)
        assert message.angle_min == pytest.approx(first, abs=1e-9) and message.angle_increment == pytest.approx(ends[2])
        assert message.angle_max == pytest.approx(first + (count - 1) * ends[2])

    def test_ros_message_classes_accept_the_values(self, monkeypatch, clouds):
        pytest.importorskip("rosbags.typesys")
        import ros_messages

        ros_messages.install(monkeypatch)
        wv.io.to_pointcloud2(clouds[0], frame_id="velodyne", layout="ouster")
        wv.io.to_laserscan(np.ones(3), lidars.laser_scan(0.0, 1.0, 0.5), frame_id="laser")


def named(**fields):
    cloud = np.zeros(3, dtype=[(name, kind) for name, (kind, _) in fields.items()])
    for name, (_, value) in fields.items():
        cloud[name] = value
    return cloud


XYZ = dict.fromkeys("xyz", ("f4", 1.0))
TYPES = {"types": type("Types", (), {"types": {}})()}


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda p: wv.io.save_cloud(p / "a.xyz", named(**XYZ)), 'the ending of path must be ".bin", .* got .\\.xyz.'),
        (lambda p: wv.io.save_cloud(p / "a.bin", np.zeros((3, 3))), "a cloud must be a NumPy array with named fields"),
        (lambda p: wv.io.save_cloud(p / "a.bin", named(x=("f4", 0))), "must have fields x, y and z, .* got x"),
        (lambda p: wv.io.save_cloud(p / "a.pcd", named(**XYZ, name=("U3", "a"))), "the field name of a cloud must be"),
        (lambda p: wv.io.save_cloud(p / "no" / "a.bin", named(**XYZ)), "a.bin: cannot be written"),
        (lambda p: wv.io.save_clouds(p, [], "bin"), 'suffix must be ".bin", .* got .bin.'),
        (
            lambda p: wv.io.save_cloud(p / "a.las", named(**XYZ, intensity=("f4", 2.0))),
            "intensity must be from 0 to 1 for LAS, got 2 to 2",
        ),
        (
            lambda p: wv.io.to_pointcloud2(named(**XYZ), frame_id="a", layout="velodyne", **TYPES),
            'the layout "velodyne" needs the field ring, which the cloud lacks',
        ),
        (
            lambda p: wv.io.to_pointcloud2(named(**XYZ), frame_id="a", layout="robosense", **TYPES),
            'layout must be "velodyne", "ouster", "ouster_legacy", "hesai" or "livox", got .robosense.',
        ),
        (
            lambda p: wv.io.to_pointcloud2(
                named(**XYZ, time=("f4", 0), ring=("u2", 256), range=("f4", 1)),
                frame_id="a",
                layout="ouster_legacy",
                **TYPES,
            ),
            "ring must be from 0 to 255 for the field ring, got 256 to 256",
        ),
        (
            lambda p: wv.io.to_pointcloud2(np.zeros((3, 3)), frame_id="a", layout="ouster", **TYPES),
            "layout is for a lidar's cloud",
        ),
        (
            lambda p: wv.io.to_pointcloud2(
                named(**XYZ, time=("f4", 5.0), ring=("u2", 0), range=("f4", 1)), frame_id="a", layout="ouster", **TYPES
            ),
            "time must be from 0 to 4.29497 for the field t, got 5 to 5",
        ),
        (
            lambda p: wv.io.to_laserscan(np.ones(4), lidars.laser_scan(0.0, 1.0, 0.5), frame_id="a", **TYPES),
            r"ranges must be 3 numbers, one for each ray, got float64 of \(4,\)",
        ),
        (
            lambda p: wv.io.to_laserscan(np.ones(64), lidars.even(2, increment=0.2), frame_id="a", **TYPES),
            "rays of a LaserScan must be in the plane z = 0, from one point",
        ),
        (
            lambda p: wv.io.to_laserscan(
                np.ones(3), cameras.Rays(np.array([[1.0, 0, 0], [0, 1, 0], [0.6, 0.8, 0]])), frame_id="a", **TYPES
            ),
            "rays of a LaserScan must be evenly spaced",
        ),
    ],
)
def test_invalid_arguments_raise_one_sentence(tmp_path, call, message):
    with pytest.raises(wv.WarpvisError, match=message) as found:
        call(tmp_path)
    assert "\n" not in str(found.value)


def test_point_clouds_require_matching_depth(scan):
    views, rays = scan
    with pytest.raises(wv.WarpvisError, match=r"views must have depth\. Add it to outputs\."):
        sensors.point_clouds(wv.Views(), rays)
    with pytest.raises(wv.WarpvisError, match=r"depth must have shape \(views, 28928\) or the shape of the rays"):
        sensors.point_clouds(views, lidars.vlp16(10.0))
    with pytest.raises(wv.WarpvisError, match=r"intensity must have shape \(2, 14464\)"):
        sensors.point_clouds(views, rays, intensity=np.zeros(5))
