# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings in ROS bags: every storage and encoding against a room computed in double precision."""

import gc
import pickle
import struct
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import warpvis as wv
from warpvis.io import encode_png

from support.recorded_warnings import recorded_warnings
from support.recording_bags import (
    FRAME,
    KINDS,
    START,
    Bag,
    add_tf,
    encode_rvl,
    room,
    stamps,
    write_room,
)
from support.recordings import K_SMALL, SMALL, assert_room, poses, refusal, rows, save_lines, text

CAMERA = wv.Camera.from_K([[60.0, 0, 31.5], [0, 61.0, 23.5], [0, 0, 1]], *SMALL, pixel_center=0.0)
DEPTH = "/camera/depth/image_rect_raw"
PNG, RVL = "16UC1; compressedDepth png", "16UC1; compressedDepth rvl"


def assert_poses(recording, tolerance=1e-5):
    expected = rows(poses(recording.timestamps - 1e-9 * START))
    signs = np.sign(np.sum(expected[:, 3:] * recording.camera_to_world[:, 3:], axis=1))
    expected[:, 3:] *= signs[:, None]
    np.testing.assert_allclose(recording.camera_to_world, expected, atol=tolerance)


@pytest.mark.parametrize("encoding", ["32FC1", "16UC1"])
@pytest.mark.parametrize("kind", KINDS)
def test_bag(tmp_path, kind, encoding):
    path = write_room(tmp_path / "walk", kind, encoding=encoding)
    recording = wv.open_recording(path)
    assert recording.source == {
        "file": path.name,
        "format": "ros",
        "topic": DEPTH,
        "color_topic": None,
        "world_frame": "map",
        "camera": "/camera/depth/camera_info",
    }
    assert recording.camera == CAMERA
    # Times are those of the headers, not of the bag.
    np.testing.assert_allclose(recording.timestamps, 1e-9 * np.array(stamps(3)), rtol=0, atol=5e-7)
    assert_poses(recording)
    assert_room(recording, 1000, 2e-5)
    assert recording[0].color is None
    if kind != "ros1":
        (file,) = (*path.glob("*.mcap"), *path.glob("*.db3"))
        np.testing.assert_array_equal(wv.open_recording(file)[2].depth, recording[2].depth)


@pytest.mark.parametrize("kind", KINDS)
def test_bags_are_closed_with_their_last_reference(tmp_path, kind):
    def read():
        recording = wv.open_recording(path, world_frame="map")
        with ThreadPoolExecutor(2) as pool:
            depths = list(pool.map(lambda frame: frame.depth, recording))
        link = "/link" if kind == "ros1" else "link"
        return len(depths), len(wv.io.read_frames(path, topic=f"/tf_static:{link}"))

    path = write_room(tmp_path / "walk", kind)
    gc.collect()  # of other tests
    with recorded_warnings(category=ResourceWarning) as caught:
        assert read() == (3, 1)
        assert not open_files(path)  # rosbags' readers are cyclic: only a collection would close them
        gc.collect()
    assert not caught


def open_files(path):
    """Return the files at a path that this process has open, on Linux."""
    files = [entry.readlink() for entry in Path("/proc/self/fd").glob("*") if entry.is_symlink()]
    return [file for file in files if str(file).startswith(str(path))]


def test_values_that_are_no_depth(tmp_path):
    special = np.array([[0, np.nan, np.inf, -np.inf, -1.0, 1.5]], dtype=np.float32)
    with Bag(tmp_path / "bag") as bag:
        bag.add("/depth", START, bag.image(START, special, "32FC1"))
        bag.add("/units/depth", START, bag.image(START, np.array([[0, 65535, 1500, 1]], np.uint16), "mono16"))
    camera = wv.Camera.from_K(np.eye(3) * [[60], [60], [1]], 6, 1)
    got = wv.open_recording(tmp_path / "bag", topic="/depth", camera=camera)[0].depth
    np.testing.assert_array_equal(got, [[np.nan] * 5 + [1.5]])
    camera = wv.Camera.from_K(np.eye(3) * [[60], [60], [1]], 4, 1)
    recording = wv.open_recording(tmp_path / "bag", topic="/units/depth", camera=camera)
    np.testing.assert_allclose(recording[0].depth, [[np.nan, np.nan, 1.5, 0.001]], rtol=1e-6)
    recording = wv.open_recording(tmp_path / "bag", topic="/units/depth", camera=camera, unit=0.00025)
    np.testing.assert_allclose(recording[0].depth, [[np.nan, np.nan, 0.375, 0.00025]], rtol=1e-6)


def test_float_millimeters_are_refused(tmp_path):
    with Bag(tmp_path / "bag") as bag:
        bag.add(DEPTH, START, bag.image(START, room(START) * 1000, "32FC1"))
        bag.add("/camera/depth/camera_info", START, bag.info(START))
    message = refusal(lambda: wv.open_recording(tmp_path / "bag")[0].depth)
    assert message.startswith(f"{tmp_path / 'bag'}: topic {DEPTH}, image 0: depth must be in meters, got a median of ")
    assert message.endswith("pass unit=0.001, the length of a unit in meters")
    got = wv.open_recording(tmp_path / "bag", unit=0.001)[0].depth
    np.testing.assert_allclose(got, room(START), rtol=1e-6)


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
@pytest.mark.parametrize("text", [PNG, "16UC1; compressedDepth", RVL])
def test_compressed_depth(tmp_path, kind, text):
    with Bag(tmp_path / "bag", kind) as bag:
        for stamp in stamps(3):
            units = np.rint(room(stamp) * 1000).astype(np.uint16)
            data = struct.pack("<iff", 0, 0, 0) + (encode_rvl(units) if text == RVL else encode_png(units))
            bag.add(f"{DEPTH}/compressedDepth", stamp, bag.compressed(stamp, data, text))
            bag.add("/camera/depth/camera_info", stamp, bag.info(stamp))
        add_tf(bag, 3)
    recording = wv.open_recording(bag.path)
    assert recording.camera == CAMERA
    assert_room(recording, 1000, 2e-5)


@pytest.mark.parametrize("encode", [encode_png, encode_rvl])
def test_compressed_floats(encode):
    depth_max, quantization = 10.0, 100.0  # defaults of compressed_depth_image_transport
    a = quantization * (quantization + 1)
    b = 1 - a / depth_max
    depth = room(START).astype(np.float64)
    depth[:2, 3:9] = np.nan
    with np.errstate(invalid="ignore"):
        inverse = np.where(depth < depth_max, a / depth + b, 0).astype(np.uint16)
    data = struct.pack("<iff", 0, a, b) + encode(inverse)
    message = SimpleNamespace(format="32FC1; compressedDepth " + encode.__name__[7:], data=data)
    got = wv.io.from_image_msg(message)
    assert got.dtype == np.float32
    np.testing.assert_array_equal(np.isnan(got), np.isnan(depth))
    valid = ~np.isnan(depth)
    # One step of inverse depth is depth**2 / a.
    assert (np.abs(got - depth)[valid] <= 1.001 * depth[valid] ** 2 / a + 1e-6).all()
    expected = a / (inverse[valid].astype(np.float64) - b)
    np.testing.assert_allclose(got[valid], expected, rtol=1e-5)


def test_rvl_of_any_pixels():
    generator = np.random.default_rng(3)
    images = [np.zeros((3, 5)), np.full((1, 1), 65535), np.array([[0, 65535, 1, 0, 0, 7, 40000]])]
    images += [generator.integers(0, 65536, (13, 17)) * (generator.random((13, 17)) < share) for share in (0.1, 0.5, 1)]
    for image in images:
        units = image.astype(np.uint16)
        message = SimpleNamespace(format=RVL, data=bytes(12) + encode_rvl(units))
        expected = np.where((units == 0) | (units == 65535), np.nan, units / 1000)
        np.testing.assert_allclose(wv.io.from_image_msg(message), expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("form", "data", "expected"),
    [
        ("jpeg", b"", "must have the format '16UC1; compressedDepth' or '32FC1; compressedDepth', got 'jpeg'"),
        ("rgb8; compressedDepth", bytes(20), "got 'rgb8; compressedDepth'"),
        (PNG, bytes(12), "must have a header and an image, got 12 bytes"),
        (PNG, bytes(20), "data of a CompressedImage of depth: not a PNG image"),
        (PNG, bytes(12) + encode_png(np.ones((2, 2), np.uint8)), "expected a gray PNG of 16 bits"),
        (RVL, bytes(20), "an image of RVL must have a size and pixels, got 8 bytes"),
        (RVL, bytes(24), "an image of RVL must have 1 to 268435456 pixels, got 0 x 0"),
        (RVL, bytes(12) + struct.pack("<III", 8, 8, 0), "is damaged: it ends after 0 of 64 pixels"),
        (RVL, bytes(12) + struct.pack("<III", 8, 8, 0xFFFFFFFF), "is damaged: a number is too long"),
        (RVL, bytes(12) + struct.pack("<III", 1, 2, 0x04000000), "is damaged: a run of 4 pixels is too long"),
    ],
)
def test_damaged_compressed_depth(form, data, expected):
    assert expected in refusal(lambda: wv.io.from_image_msg(SimpleNamespace(format=form, data=data)))


def test_color_in_the_frame_of_depth(tmp_path):
    from io import BytesIO

    from PIL import Image

    pixels = np.arange(64 * 48 * 3).reshape(48, 64, 3).astype(np.uint8)
    for encoding, image in (
        ("rgb8", pixels),
        ("bgr8", pixels[..., ::-1]),
        ("bgra8", np.dstack([pixels[..., ::-1], pixels])),
    ):
        with Bag(tmp_path / encoding) as bag:
            for stamp in stamps(3):
                bag.add(DEPTH, stamp, bag.image(stamp, room(stamp), "32FC1"))
                bag.add("/camera/depth/camera_info", stamp, bag.info(stamp))
            later = START + 15 * 10**6
            bag.add("/rgb/image", later, bag.image(later, image[..., :4], encoding))
            bag.add("/infra/image", START, bag.image(START, pixels[..., 0], "mono8"))
            bag.add("/other/image", START, bag.image(START, pixels, "rgb8", "other_optical_frame"))
        recording = wv.open_recording(tmp_path / encoding)
        assert recording.source["color_topic"] == "/rgb/image"
        np.testing.assert_array_equal(recording[0].color, pixels)
        assert recording[1].color is None
    # Of twice the resolution, and compressed: column x has its center at x + 0.5, which is column 2 x + 1 there.
    columns = np.broadcast_to(np.arange(128, dtype=np.uint8)[None, :, None], (96, 128, 3))
    stream = BytesIO()
    Image.fromarray(np.ascontiguousarray(columns)).save(stream, "PNG")
    with Bag(tmp_path / "large") as bag:
        bag.add(DEPTH, START, bag.image(START, room(START), "32FC1"))
        bag.add("/camera/depth/camera_info", START, bag.info(START))
        bag.add("/rgb/image/compressed", START, bag.compressed(START, stream.getvalue(), "rgb8; png compressed bgr8"))
        bag.add("/rgb/camera_info", START, bag.info(START, (120.0, 122.0, 63.5, 47.5), (128, 96)))
    color = wv.open_recording(tmp_path / "large")[0].color
    np.testing.assert_array_equal(color[10, :, 0], 2 * np.arange(64) + 1)


def test_several_topics(tmp_path):
    with Bag(tmp_path / "bag") as bag:
        for topic, encoding in (("/a/depth", "32FC1"), ("/b/depth", "16UC1"), ("/infra", "mono16")):
            pixels = room(START) if encoding == "32FC1" else np.rint(room(START) * 1000).astype(np.uint16)
            bag.add(topic, START, bag.image(START, pixels, encoding))
        bag.add("/confidence", START, bag.image(START, room(START), "32FC1"))
        bag.add("/info", START, bag.info(START))

    def message(**options):
        return refusal(lambda: wv.open_recording(tmp_path / "bag", **options))

    start = f"{tmp_path / 'bag'}: "
    assert message() == (
        f"{start}the bag has several topics of depth images; choose one as topic=: /a/depth (32FC1), /b/depth (16UC1)"
    )
    assert message(topic="/info") == (
        f"{start}topic '/info' has no depth images; topics of depth images are: /a/depth, /b/depth, /confidence"
    )
    assert message(topic="/c").startswith(f"{start}topic '/c' is not in the bag; topics of")
    assert message(topic=3) == "topic must be text, got 3"
    recording = wv.open_recording(tmp_path / "bag", topic="/b/depth")
    assert recording.camera == CAMERA  # the only CameraInfo with the frame of the images
    np.testing.assert_allclose(recording[0].depth, room(START), atol=0.0005001)
    with Bag(tmp_path / "none") as bag:
        bag.add("/infra", START, bag.image(START, room(START).astype(np.uint16), "mono16"))
    message = refusal(lambda: wv.open_recording(tmp_path / "none"))
    assert message.endswith(
        "the bag has no topic of depth images, Image of 16UC1 or 32FC1, or compressedDepth: it has "
        "/infra (sensor_msgs/msg/Image)"
    )


def test_transforms_at_other_times(tmp_path):
    """Poses are interpolated within 1 s, and unknown before the first transform and in longer gaps."""
    with Bag(tmp_path / "bag") as bag:
        for stamp in stamps(60):
            bag.add(DEPTH, stamp, bag.image(stamp, room(stamp), "32FC1"))
            bag.add("/camera/depth/camera_info", stamp, bag.info(stamp))
        for seconds in (0.45, 1.45, 5.05):
            row = rows(poses([seconds]))[0]
            time = START + round(seconds * 1e9)
            bag.add("/tf", time, bag.transforms(time, "odom", FRAME, row))
    recording = wv.open_recording(tmp_path / "bag")
    known = np.isfinite(recording.camera_to_world).all(axis=1)
    # Between 1.45 and 5.05 s no image has both within 1 s.
    assert np.flatnonzero(known).tolist() == list(range(5, 15))
    assert_poses(recording.posed(), 1e-6)
    assert recording.source["world_frame"] == "odom"


def test_world_frame(tmp_path):
    path = write_room(tmp_path / "bag")
    for frame, moving in (("map", True), ("base", False), (FRAME, False)):
        recording = wv.open_recording(path, world_frame=frame)
        assert recording.source["world_frame"] == frame
        assert (np.ptp(recording.camera_to_world, axis=0).max() > 0.01) == moving
    expected = rows((poses([3.0])[0] @ poses([-2.0])[0])[None])[0]
    got = wv.open_recording(path, world_frame="base").camera_to_world[1]
    np.testing.assert_allclose(
        got * np.sign(got[6] * expected[6]) ** np.array([0, 0, 0, 1, 1, 1, 1]), expected, atol=1e-9
    )
    assert refusal(lambda: wv.open_recording(path, world_frame="sky")) == (
        f"{path}: tf has no frame 'sky' above that of the images; world_frame= may be {FRAME}, link, base, map"
    )


@pytest.mark.parametrize(("root", "is_known"), [("camera_link", False), ("map", True)])
def test_static_transforms(tmp_path, root, is_known):
    """A camera that is carried by hand has static transforms to its own body only."""
    path = tmp_path / "bag"
    with Bag(path) as bag:
        bag.add(DEPTH, START, bag.image(START, room(START), "32FC1"))
        bag.add("/camera/depth/camera_info", START, bag.info(START))
        bag.add("/tf_static", START, bag.transforms(0, root, FRAME, rows(poses([0.0]))[0]))
    recording = wv.open_recording(path)
    assert np.isfinite(recording.camera_to_world).all() == is_known
    assert recording.source["world_frame"] == (root if is_known else None)
    assert_poses(wv.open_recording(path, world_frame=root))
    save_lines(tmp_path / "walk.txt", [text([1e-9 * START, *rows(poses([0.0]))[0]])])
    assert_poses(wv.open_recording(path, poses=tmp_path / "walk.txt"))


def test_wrong_transforms(tmp_path):
    def message(*items):
        path = tmp_path / str(len(list(tmp_path.iterdir())))
        with Bag(path) as bag:
            bag.add(DEPTH, START, bag.image(START, room(START), "32FC1"))
            bag.add("/camera/depth/camera_info", START, bag.info(START))
            for parent, child, row in items:
                bag.add("/tf", START, bag.transforms(START, parent, child, row))
        return refusal(lambda: wv.open_recording(path)).removeprefix(f"{path}: ")

    row = (0, 0, 0, 0, 0, 0, 1)
    assert message(("a", FRAME, row), ("b", FRAME, row)) == (
        f"tf frame {FRAME!r} has the parents a, b; a frame has only one"
    )
    assert message(("a", FRAME, row), (FRAME, "a", row)) == f"tf frame 'a' is in a cycle: {FRAME}, a"
    assert message(("a", FRAME, np.zeros(7))).startswith("tf to frame 'a': transform")


def test_lens_of_raw_images(tmp_path):
    d = (0.1, -0.2, 0.001, 0.002, 0.05)
    for topic, expected in (("/d/depth_raw", wv.cameras.LensCamera), ("/d/depth_rect_raw", wv.Camera)):
        path = tmp_path / topic[3:]
        with Bag(path) as bag:
            bag.add(topic, START, bag.image(START, room(START), "32FC1"))
            bag.add("/d/camera_info", START, bag.info(START, d=d))
        assert type(wv.open_recording(path).camera) is expected
    with Bag(tmp_path / "bad") as bag:
        bag.add(DEPTH, START, bag.image(START, room(START), "32FC1"))
        bag.add("/camera/depth/camera_info", START, bag.info(START, (0, 0, 0, 0)))
    with pytest.warns(wv.errors.IntrinsicsWarning, match="K of CameraInfo must not be zero"):
        message = refusal(lambda: wv.open_recording(tmp_path / "bad"))
    assert message.endswith("does not define the camera; pass that of the depth images as camera=")


@pytest.mark.parametrize("option", ["Depth_Units", "Depth Units"])
def test_realsense_sdk(tmp_path, option):
    """The layout of librealsense: the unit of depth is an option, and is appended to every image, too."""
    with Bag(tmp_path / "sdk", "ros1") as bag:
        prefix = "/device_0/sensor_0"
        bag.add(f"{prefix}/option/{option}/value", 1, bag.make("std_msgs/msg/Float32", data=0.00025))
        bag.add(f"{prefix}/Depth_0/info/camera_info", 1, bag.info(0, frame=""))
        for stamp in stamps(2):
            units = np.rint(room(stamp) * 4000).astype(np.uint16)
            image = bag.image(stamp, units, "mono16", "1")
            bag.add(f"{prefix}/Depth_0/image/data", stamp, image, struct.pack("<f", 0.00025))
            bag.add(
                "/device_0/sensor_1/Color_0/image/data",
                stamp,
                bag.image(stamp, np.zeros((4, 4, 3), np.uint8), "rgb8", "1"),
            )
    recording = wv.open_recording(bag.path)
    assert recording.camera == CAMERA
    for frame, stamp in zip(recording, stamps(2), strict=True):
        np.testing.assert_allclose(frame.depth, room(stamp), atol=0.5001 / 4000)
        assert frame.color is None
    assert np.isnan(recording.camera_to_world).all()


def test_poses_of_ros_1(tmp_path):
    path = write_room(tmp_path / "walk", "ros1")
    frames = wv.read_frames(path, topic="/tf:/base")
    assert frames.source["format"] == "ros"
    assert frames.camera == CAMERA
    expected = poses(frames.timestamps - 1e-9 * START) @ np.linalg.inv(poses([3.0])[0] @ poses([-2.0])[0])
    np.testing.assert_allclose(frames.camera_to_world[:, :3], expected[:, :3, 3], atol=1e-6)
    message = refusal(lambda: wv.read_frames(path))
    assert "the bag has several topics with poses; choose one as topic=: it has /tf (tf2_msgs/msg/TFMessage)" in message


def test_malformed_definitions_of_other_topics(tmp_path):
    with Bag(tmp_path / "bag", "ros1") as bag:
        bag.writer.add_connection("/other", "own_msgs/msg/Own", msgdef="Header header\n=== ?", md5sum="0" * 32)
        bag.add(DEPTH, START, bag.image(START, room(START), "32FC1"))
        bag.add("/camera/depth/camera_info", START, bag.info(START))
    np.testing.assert_array_equal(wv.open_recording(bag.path)[0].depth, room(START))


def test_messages_with_the_same_time(tmp_path):
    with Bag(tmp_path / "bag", "sqlite3") as bag:
        for value in (1.0, 2.0, 3.0):
            bag.add(DEPTH, START, bag.image(0, np.full((48, 64), value, np.float32), "32FC1"))
        bag.add("/camera/depth/camera_info", START, bag.info(START))
    recording = wv.open_recording(tmp_path / "bag")
    assert [float(frame.depth[0, 0]) for frame in recording] == [1, 2, 3]
    np.testing.assert_allclose(recording.timestamps, 1e-9 * START, rtol=1e-12)  # no header has a time


@pytest.mark.parametrize("kind", KINDS)
def test_threads_and_processes(tmp_path, kind):
    path = write_room(tmp_path / "bag", kind, 8)
    recording = wv.open_recording(path)
    expected = [frame.depth for frame in recording]
    with ThreadPoolExecutor(4) as pool:
        for got, depth in zip(pool.map(lambda index: recording[index % 8].depth, range(32)), expected * 4, strict=True):
            np.testing.assert_array_equal(got, depth)
    copy = pickle.loads(pickle.dumps(recording[3:]))
    np.testing.assert_array_equal(copy[1].depth, expected[4])


def test_bad_files(tmp_path):
    path = write_room(tmp_path / "bag")
    (file,) = path.glob("*.mcap")
    data = file.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 2])
    (tmp_path / "cut.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    (tmp_path / "lfs.bag").write_bytes(b"version https://git-lfs.github.com/spec/v1\n")
    for name in ("cut.mcap", "cut.bag"):
        assert refusal(lambda name=name: wv.open_recording(tmp_path / name)).startswith(
            f"{tmp_path / name}: cannot be read as a ROS bag: "
        )
    assert "is a git-lfs pointer, not a ROS bag" in refusal(lambda: wv.open_recording(tmp_path / "lfs.bag"))
    message = refusal(lambda: wv.open_recording(tmp_path, file_format="ros"))
    assert message == f"{tmp_path}: is a folder without metadata.yaml, so it is not a ROS 2 bag"
    (tmp_path / "folder").mkdir()
    for name, kinds in (("topic", "bags and LeRobot datasets"), ("world_frame", "bags")):
        message = refusal(lambda name=name: wv.open_recording(tmp_path / "folder", **{name: "/a"}))
        assert message == f"{tmp_path / 'folder'}: {name}= is for {kinds}, which this is not"
    recording = wv.open_recording(path)
    file.write_bytes(data[:200])
    copy = pickle.loads(pickle.dumps(recording))
    assert refusal(lambda: copy[0].depth).startswith(f"{path}: cannot be read as a ROS bag: ")


def test_camera_of_another_size(tmp_path):
    path = write_room(tmp_path / "bag", with_tf=False)
    message = refusal(lambda: wv.open_recording(path, camera=wv.Camera.kinect())[1].depth)
    assert f"topic {DEPTH}, image 1: must have the pixels of the camera, 320 x 240, got 64 x 48" in message
    assert K_SMALL[0] == wv.open_recording(path).camera.fx
