# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of color images and colored clouds as ROS messages, against other libraries and through bags."""

import io
import struct
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
import warp as wp

pytest.importorskip("rosbags.typesys")

import ros_messages
from PIL import Image
from ros_messages import STORE
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer

import warpvis as wv
from warpvis.errors import ArrayError, MessageError
from warpvis.io import from_color_msg, to_color_msg, to_compressed_msg, to_image_msg, to_pointcloud2

FRAME = {"frame_id": "eye", "types": STORE}
RNG = np.random.default_rng(7)
COLOR = RNG.integers(0, 256, (5, 7, 3), dtype=np.uint8)
CAMERA = wv.Camera.from_fov(64, 48, hfov=1.0, near=0.1, far=10.0)


def smooth(width=64, height=48):
    """Return an image without fine patterns, which JPEG keeps."""
    y, x = np.mgrid[:height, :width]
    return np.stack([255 * x / width, 255 * y / height, 128 + 0 * x], axis=-1).astype(np.uint8)


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8"])
def test_color_images_keep_every_bit(encoding):
    message = to_color_msg(COLOR[None], encoding=encoding, stamp=1.5, **FRAME)
    assert (message.encoding, message.height, message.width, message.step, message.is_bigendian) == (
        encoding,
        5,
        7,
        21,
        0,
    )
    first = bytes(message.data[:3])
    assert first == bytes(COLOR[0, 0] if encoding == "rgb8" else COLOR[0, 0, ::-1])
    np.testing.assert_array_equal(from_color_msg(message), COLOR)
    data = STORE.serialize_cdr(message, "sensor_msgs/msg/Image")
    np.testing.assert_array_equal(from_color_msg(STORE.deserialize_cdr(data, "sensor_msgs/msg/Image")), COLOR)


@pytest.mark.parametrize(("encoding", "order"), [("rgba8", (0, 1, 2)), ("bgra8", (2, 1, 0))])
def test_opacity_and_padding_are_ignored(encoding, order):
    rows = np.full((5, 7 * 4 + 3), 9, dtype=np.uint8)
    pixels = rows[:, :28].reshape(5, 7, 4)
    pixels[..., order] = COLOR
    fields = {"encoding": encoding, "height": 5, "width": 7, "step": 31, "is_bigendian": 0, "data": rows.tobytes()}
    np.testing.assert_array_equal(from_color_msg(SimpleNamespace(**fields)), COLOR)
    gray = fields | {"encoding": "mono8", "step": 7, "data": COLOR[..., 0].tobytes()}
    np.testing.assert_array_equal(from_color_msg(SimpleNamespace(**gray)), np.repeat(COLOR[..., :1], 3, axis=2))


def test_png_is_lossless_and_jpeg_is_close():
    """The data are plain files; OpenCV, which compressed_image_transport uses, reads them in the order bgr8."""
    message = to_compressed_msg(COLOR, compression="png", **FRAME)
    assert message.format == "rgb8; png compressed bgr8" and bytes(message.data[:8]) == b"\x89PNG\r\n\x1a\n"
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(bytes(message.data)))), COLOR)
    np.testing.assert_array_equal(from_color_msg(message), COLOR)
    sizes, picture = [], smooth()
    for quality in (100, 95, 30):
        message = to_compressed_msg(picture, quality=quality, **FRAME)
        assert message.format == "rgb8; jpeg compressed bgr8" and bytes(message.data[:2]) == b"\xff\xd8"
        difference = np.abs(from_color_msg(message).astype(int) - picture)
        assert difference.mean() < (2 if quality > 90 else 6)
        sizes.append(len(message.data))
    assert sizes[0] > sizes[1] > sizes[2]


def test_cloud_colors_are_packed_as_in_pcl():
    """PointXYZRGB: the bits of a float are 0x00RRGGBB, and of any color none is NaN."""
    depth = np.full((48, 64), 2.0, dtype=np.float32)
    depth[0, 0] = np.inf
    color = RNG.integers(0, 256, (1, 48, 64, 3), dtype=np.uint8)
    color[0, 1, 1] = 255
    cloud = to_pointcloud2(depth, CAMERA, colors=color, **FRAME)
    fields = [(field.name, field.offset, field.datatype, field.count) for field in cloud.fields]
    assert fields == [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1), ("rgb", 12, 7, 1)]
    assert (cloud.point_step, cloud.row_step, cloud.height, cloud.width) == (16, 16 * 64, 48, 64)
    data, plain = bytes(cloud.data), to_pointcloud2(depth, CAMERA, **FRAME)
    for row, column in ((0, 0), (1, 1), (47, 63), (20, 30)):
        start = row * cloud.row_step + column * cloud.point_step
        blue, green, red, zero = struct.unpack_from("<4B", data, start + 12)
        assert ((red, green, blue), zero) == (tuple(color[0, row, column]), 0)
        assert not np.isnan(struct.unpack_from("<f", data, start + 12)[0])
        assert data[start : start + 12] == bytes(plain.data)[(row * 64 + column) * 12 :][:12]


def test_colors_of_point_lists_and_lidar_clouds(device):
    points = np.arange(12, dtype=np.float32).reshape(4, 3)
    colors = np.arange(12, dtype=np.uint8).reshape(4, 3)
    expected = [2, (3 << 16) + (4 << 8) + 5, (6 << 16) + (7 << 8) + 8, (9 << 16) + (10 << 8) + 11]
    expected[0] += 1 << 8
    for given in (colors, wp.array(colors, dtype=wp.vec3ub, device=device)):
        cloud = to_pointcloud2(points, colors=given, **FRAME)
        read = np.frombuffer(cloud.data, dtype=[("xyz", "<f4", 3), ("rgb", "<u4")])
        assert read["rgb"].tolist() == expected and (read["xyz"] == points).all() and cloud.is_dense
    scan = np.zeros(4, dtype=[("x", "f4"), ("y", "f4"), ("z", "f4"), ("ring", "u2")])
    scan["ring"] = range(4)
    cloud = to_pointcloud2(scan, colors=colors, **FRAME)
    read = np.frombuffer(cloud.data, dtype=[("xyz", "<f4", 3), ("ring", "<u2"), ("rgb", "<u4")])
    assert read["rgb"].tolist() == expected and read["ring"].tolist() == [0, 1, 2, 3]


def test_messages_share_no_memory():
    color = COLOR.copy()
    messages = [to_color_msg(color, **FRAME), to_pointcloud2(np.ones((5, 7, 3)), colors=color, **FRAME)]
    before = [bytes(message.data) for message in messages]
    read = from_color_msg(messages[0])
    color[:] = 0
    assert [bytes(message.data) for message in messages] == before
    messages[0].data[:] = 0
    np.testing.assert_array_equal(read, COLOR)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: to_color_msg(COLOR / 255, **FRAME), ArrayError, r"color must be one image .*uint8, got float64 of"),
        (lambda: to_color_msg(np.stack([COLOR] * 2), **FRAME), ArrayError, r"got uint8 of \(2, 5, 7, 3\)"),
        (lambda: to_color_msg(COLOR[..., 0], **FRAME), ArrayError, r"\(H, W, 3\), uint8, got uint8 of \(5, 7\)"),
        (lambda: to_color_msg(COLOR[:0], **FRAME), ArrayError, r"got uint8 of \(0, 7, 3\)"),
        (
            lambda: to_color_msg(COLOR, encoding="rgba8", **FRAME),
            MessageError,
            'encoding must be "rgb8" or "bgr8", got',
        ),
        (lambda: to_compressed_msg(COLOR, compression="webp", **FRAME), MessageError, 'compression must be "jpeg" or'),
        (lambda: to_compressed_msg(COLOR, quality=0, **FRAME), MessageError, "quality must be"),
        (
            lambda: to_compressed_msg(COLOR, quality=101, **FRAME),
            MessageError,
            "quality must be from 1 to 100, got 101",
        ),
        (
            lambda: to_pointcloud2(np.ones((7, 5, 3)), colors=COLOR, **FRAME),
            ArrayError,
            r"colors must be uint8 of shape \(7, 5, 3\), one for each point, got uint8 of \(5, 7, 3\)",
        ),
        (lambda: to_pointcloud2(np.ones((5, 3)), colors=np.ones((5, 3)), **FRAME), ArrayError, "got float64 of"),
        (
            lambda: to_pointcloud2(
                np.zeros(2, dtype=[(name, "f4") for name in "xyz"]), colors=COLOR[0, :2], layout="velodyne", **FRAME
            ),
            MessageError,
            'colors are not in the fields of the layout "velodyne"',
        ),
        (
            lambda: from_color_msg(to_image_msg(np.ones((2, 2)), **FRAME)),
            MessageError,
            "must be of rgb8, .*got '32FC1'",
        ),
    ],
)
def test_invalid_arguments_raise(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_ros_classes_receive_valid_fields(monkeypatch):
    ros_messages.install(monkeypatch)
    for make in (
        lambda types: to_color_msg(COLOR, frame_id="eye", stamp=1.5, types=types),
        lambda types: to_compressed_msg(COLOR, frame_id="eye", stamp=1.5, types=types),
        lambda types: to_pointcloud2(np.ones((5, 7, 3)), colors=COLOR, frame_id="eye", types=types),
    ):
        own, other = make(None), make(STORE)
        kind = own.KIND
        assert bytes(STORE.serialize_cdr(ros_messages.as_rosbags(own), kind)) == bytes(STORE.serialize_cdr(other, kind))
    np.testing.assert_array_equal(from_color_msg(to_compressed_msg(COLOR, frame_id="eye", compression="png")), COLOR)


@pytest.mark.parametrize("compressed", [False, True])
def test_recordings_with_rendered_color(tmp_path, compressed):
    """A bag of rendered images is read as a recording, and by rosbags itself."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((1, 1, 1)), name="red", pose=(2, 0, 0, 0, 0, 0, 1), appearance=(0.8, 0.1, 0.1))
    scene.add(trimesh.creation.box((9, 9, 1)), name="blue", pose=(0, 0, -1, 0, 0, 0, 1), appearance=(0.1, 0.1, 0.8))
    pose = wv.look_at((0, 0, 1), (2, 0, 0))
    views = wv.render(scene, CAMERA, pose, outputs=("depth", "color"))
    color = views.color.numpy()[0]
    assert {(204, 26, 26), (26, 26, 204), (0, 0, 0)} == set(map(tuple, color.reshape(-1, 3).tolist()))
    header = {**FRAME, "stamp": 3.0}
    messages = {
        "/eye/depth/image_rect": to_image_msg(views.depth, **header),
        "/eye/depth/camera_info": CAMERA.to_camera_info(**header),
        "/eye/points": to_pointcloud2(views.depth, CAMERA, colors=views.color, **header),
    }
    if compressed:
        messages["/eye/color/image_rect/compressed"] = to_compressed_msg(views.color, compression="png", **header)
    else:
        messages["/eye/color/image_rect"] = to_color_msg(views.color, encoding="bgr8", **header)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        for topic, message in messages.items():
            connection = bag.add_connection(topic, message.__msgtype__, typestore=STORE)
            bag.write(connection, 3 * 10**9, STORE.serialize_cdr(message, message.__msgtype__))
    recording = wv.open_recording(tmp_path / "bag")
    assert recording.camera == wv.Camera(64, 48, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    np.testing.assert_array_equal(recording[0].color, color)
    with AnyReader([tmp_path / "bag"], default_typestore=STORE) as reader:
        (found,) = (item for item in reader.messages() if item[0].topic == "/eye/points")
        cloud = reader.deserialize(found[2], found[0].msgtype)
    read = np.frombuffer(cloud.data, dtype=[("xyz", "<f4", 3), ("bgr", "u1", 3), ("zero", "u1")]).reshape(48, 64)
    np.testing.assert_array_equal(read["bgr"][..., ::-1], color)
    np.testing.assert_array_equal(np.isfinite(read["xyz"][..., 2]), np.isfinite(views.depth.numpy()[0]))
