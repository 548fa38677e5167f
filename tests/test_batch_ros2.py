# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 2 bags, read back by rosbags: all fields, infinities, times, and back-projection to world points."""

import builtins
import dataclasses

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.batch import find_format, make_plan, render_batch
from warpvis.batch.storage._output import ShardFiles
from warpvis.cameras.frames import Frames
from warpvis.core.messages import nanoseconds

rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")

CAMERA = wv.Camera(40, 30, 38.0, 37.0, 19.3, 15.6, near=0.9, far=3.0)
TOPIC = "/camera/depth"
TIMES = [0.0, 0.1, 1305031102.175304, 1305031102.2, 2147483646.999999]


def poses():
    eyes = [(-1.5, 0.2 * k, 0.6 + 0.1 * k) for k in range(len(TIMES))]
    return np.array([wv.look_at(eye, (0.6, 0, 0.4)) for eye in eyes])


def scene():
    scene = wv.Scene()
    scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", label="ground")
    scene.add(trimesh.creation.icosphere(radius=0.4), name="ball", label="object", pose=(0.6, 0, 0.4, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.1, 0.1, 1)), name="pole", pose=(-0.9, 0.1, 0.5, 0, 0, 0, 1))
    return scene


def plan_of(*, outputs=("depth", "points"), shard_frames=3, times=TIMES, **options):
    frames = Frames.from_poses(poses(), timestamps=times)
    plan = make_plan(scene(), CAMERA, frames, find_format("npz"), shard_frames=shard_frames)
    return dataclasses.replace(plan, outputs=outputs, options=options)


def write(folder, plan):
    """Write the bags of a job; return its depth images."""
    depth = wv.render(scene(), CAMERA, plan.frames.camera_to_world, outputs=("depth",)).depth.numpy()
    layout, files = find_format("ros2")(plan), ShardFiles(folder)
    units = []
    for shard in range(plan.shard_count):
        units += layout.write_shard(shard, {"depth": depth[plan.shard_slice(shard)]}, files)
    assert layout.index(files) == [] and [f"bag_{k:06d}" for k in range(plan.shard_count)] == units
    return depth


def read(folder):
    """Return messages of a bag by topic, in order, with their recording times."""
    types = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    messages = {}
    with rosbag2.Reader(folder) as bag:
        for connection, time, raw in bag.messages():
            messages.setdefault(connection.topic, []).append((time, types.deserialize_cdr(raw, connection.msgtype)))
    return messages


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ros2")
    depth = write(folder, plan_of())
    messages = {}
    for name in ("bag_000000", "bag_000001"):
        for topic, some in read(folder / name).items():
            messages.setdefault(topic, []).extend(some)
    return folder, depth, messages


def image_of(message):
    return np.frombuffer(message.data, dtype="<f4").reshape(message.height, message.width)


def test_bag_is_a_folder_with_an_mcap_file(bags):
    folder, _, messages = bags
    for name in ("bag_000000", "bag_000001"):
        assert sorted(path.name for path in (folder / name).iterdir()) == [f"{name}.mcap", "metadata.yaml"]
        assert (folder / name / f"{name}.mcap").read_bytes()[:8] == b"\x89MCAP0\r\n"
        metadata = (folder / name / "metadata.yaml").read_text()
        assert "version: 9" in metadata and "storage_identifier: mcap" in metadata
    assert {topic: len(some) for topic, some in messages.items()} == {
        "/tf": 5,
        f"{TOPIC}/camera_info": 5,
        f"{TOPIC}/image_rect": 5,
        f"{TOPIC}/points": 5,
    }


def test_images_contain_depth_with_infinities(bags):
    """REP 117: +inf for no hit, -inf for too near."""
    _, depth, messages = bags
    assert np.isposinf(depth).any() and np.isneginf(depth).any() and np.isfinite(depth).any()
    for (_, message), expected in zip(messages[f"{TOPIC}/image_rect"], depth, strict=True):
        assert (message.height, message.width, message.step) == (30, 40, 160)
        assert message.encoding == "32FC1" and message.is_bigendian == 0
        assert image_of(message).tobytes() == expected.tobytes()


def test_times_are_exact(bags):
    _, _, messages = bags
    expected = [
        (0, 0),
        (0, 100_000_000),
        (1305031102, 175_304_000),
        (1305031102, 200_000_000),
        (2147483646, 999_999_000),
    ]
    for topic, some in messages.items():
        headers = [message.transforms[0].header if topic == "/tf" else message.header for _, message in some]
        assert [(header.stamp.sec, header.stamp.nanosec) for header in headers] == expected
        assert [divmod(time, 10**9) for time, _ in some] == expected
        frame_id = "world" if topic == "/tf" else "camera_depth_optical_frame"
        assert {header.frame_id for header in headers} == {frame_id}


@pytest.mark.parametrize(
    ("seconds", "expected"), [(0.0, 0), (1e-9, 1), (0.3, 300_000_000), (1e-10, 0), (1.5e-9, 2), (7.0, 7 * 10**9)]
)
def test_nanoseconds(seconds, expected):
    assert nanoseconds(seconds) == expected


def test_intrinsics_have_pixel_centers_at_whole_numbers(bags):
    _, _, messages = bags
    for _, info in messages[f"{TOPIC}/camera_info"]:
        assert info.k.tolist() == [38.0, 0, 18.8, 0, 37.0, 15.1, 0, 0, 1]
        assert info.p.tolist() == [38.0, 0, 18.8, 0, 0, 37.0, 15.1, 0, 0, 0, 1, 0]
        assert info.r.tolist() == [1, 0, 0, 0, 1, 0, 0, 0, 1]
        assert info.distortion_model == "plumb_bob" and info.d.tolist() == [0] * 5
        assert (info.height, info.width, info.binning_x, info.roi.do_rectify) == (30, 40, 0, False)


def world_of(transform, points):
    """Return points of the child frame in the parent's, rotated by the quaternion formula."""
    t, q = transform.transform.translation, transform.transform.rotation
    u = np.array([q.x, q.y, q.z])
    turned = points + 2 * np.cross(u, np.cross(u, points) + q.w * points)
    return turned + [t.x, t.y, t.z]


def test_depth_and_tf_back_project_to_the_world(bags):
    """As in `image_geometry`, pixel centers are at whole numbers; half a pixel shifts points by millimeters."""
    _, depth, messages = bags
    truth = wv.render(scene(), CAMERA, poses(), outputs=("points",)).points.numpy()
    x, y = np.meshgrid(np.arange(40), np.arange(30))
    for view in range(len(depth)):
        (_, tf), (_, info), (_, image) = (
            messages[name][view] for name in ("/tf", f"{TOPIC}/camera_info", f"{TOPIC}/image_rect")
        )
        assert tf.transforms[0].child_frame_id == image.header.frame_id == info.header.frame_id
        seen = np.isfinite(depth[view])
        z, k = image_of(image)[seen].astype(np.float64), info.k.reshape(3, 3)
        for shift, off in ((0.0, False), (0.5, True)):
            points = [(x[seen] + shift - k[0, 2]) / k[0, 0] * z, (y[seen] + shift - k[1, 2]) / k[1, 1] * z, z]
            error = np.linalg.norm(world_of(tf.transforms[0], np.stack(points, axis=-1)) - truth[view][seen], axis=-1)
            assert error.min() > 1e-3 if off else error.max() < 1e-5


def test_clouds_have_the_shape_of_the_image(bags):
    _, depth, messages = bags
    truth = wv.render(scene(), CAMERA, poses(), outputs=("points",)).points.numpy()
    for view, (_, cloud) in enumerate(messages[f"{TOPIC}/points"]):
        assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (30, 40, 12, 480)
        assert [(field.name, field.offset, field.datatype, field.count) for field in cloud.fields] == [
            ("x", 0, 7, 1),
            ("y", 4, 7, 1),
            ("z", 8, 7, 1),
        ]
        assert not cloud.is_dense and not cloud.is_bigendian
        points = np.frombuffer(cloud.data, dtype="<f4").reshape(30, 40, 3)
        seen = np.isfinite(depth[view])
        assert np.isnan(points[~seen]).all() and (points[seen][:, 2] == depth[view][seen]).all()
        transform = messages["/tf"][view][1].transforms[0]
        assert np.abs(world_of(transform, points[seen].astype(np.float64)) - truth[view][seen]).max() < 1e-5


def test_no_clouds_without_points(tmp_path):
    write(
        tmp_path,
        plan_of(outputs=("depth",), frame_id="eye", parent_frame_id="map", topic="head/depth/", shard_frames=9),
    )
    messages = read(tmp_path / "bag_000000")
    assert set(messages) == {"/tf", "/head/depth/camera_info", "/head/depth/image_rect"}
    (_, tf), (_, info) = messages["/tf"][0], messages["/head/depth/camera_info"][0]
    assert (tf.transforms[0].header.frame_id, tf.transforms[0].child_frame_id, info.header.frame_id) == (
        "map",
        "eye",
        "eye",
    )


def test_bytes_are_reproducible(bags, tmp_path):
    folder, _, _ = bags
    write(tmp_path, plan_of())
    names = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    assert len(names) == 4
    for name in names:
        assert (folder / name).read_bytes() == (tmp_path / name).read_bytes(), name


def test_render_batch_writes_the_same_files(bags, tmp_path):
    folder, _, _ = bags
    outputs = ("depth", "points")
    render_batch(scene(), CAMERA, plan_of().frames, tmp_path / "out", format="ros2", outputs=outputs, shard_frames=3)
    for name in (path.relative_to(folder) for path in folder.rglob("*") if path.is_file()):
        assert (folder / name).read_bytes() == (tmp_path / "out" / name).read_bytes(), name


def test_read_frames_returns_the_poses(bags):
    from warpvis.io import read_frames

    folder, _, _ = bags
    frames = read_frames(folder / "bag_000000")
    expected = plan_of().frames[:3]
    assert (frames.timestamps == expected.timestamps).all()
    assert np.abs(frames.camera_to_world - expected.camera_to_world).max() < 1e-12


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outputs": ("points",)}, "outputs must include depth for format 'ros2', got points"),
        ({"outputs": ("depth", "labels")}, "outputs must be from color, depth, points for format 'ros2', got labels"),
        ({"rate": 30}, "format 'ros2' has no option 'rate'; its options: frame_id=camera_depth_optical_frame"),
        ({"frame_id": ""}, "option frame_id must be a name without spaces, got ''"),
        ({"topic": "/"}, "option topic must be a name without spaces, got '/'"),
        ({"parent_frame_id": "the world"}, "option parent_frame_id must be a name without spaces, got 'the world'"),
        ({"times": [0, 1, -2, 3, 4]}, "timestamps must be from 0 to 2147483647 s for ROS 2, got -2.0 in frame 2"),
        ({"times": [0, 1, 2, 3, 3e9]}, "got 3000000000.0 in frame 4"),
    ],
)
def test_invalid_plans_raise(changes, message):
    with pytest.raises(wv.WarpvisError, match=message):
        find_format("ros2")(plan_of(**changes))


def test_missing_rosbags_raises_with_install_command(monkeypatch):
    def import_module(name, *arguments, real=builtins.__import__, **options):
        if name.startswith("rosbags"):
            raise ModuleNotFoundError("No module named 'rosbags'")
        return real(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", import_module)
    with pytest.raises(
        wv.errors.FileFormatError, match=r"format 'ros2' requires rosbags: pip install 'warpvis\[ros\]'$"
    ):
        find_format("ros2")(plan_of())


def test_shard_size_does_not_change_frames(tmp_path):
    """A shard contains the plan's frames from its start on."""
    write(tmp_path, dataclasses.replace(plan_of(), shard_frames=1))
    stamps = [read(tmp_path / f"bag_{k:06d}")["/tf"][0][0] for k in range(len(TIMES))]
    assert stamps == [nanoseconds(time) for time in TIMES]
