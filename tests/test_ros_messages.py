# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of ROS: cameras, depth images and points, there and back, of rosbags' types and of ROS's own classes."""

import array
import builtins
import dataclasses
import importlib.util
import math
import sys
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from hypothesis import given, strategies as st

pytest.importorskip("rosbags.typesys")

import ros_messages
from ros_messages import ROS1, STORE

import warpvis as wv
from warpvis.errors import CameraError, IntrinsicsWarning, MessageError
from warpvis.io import from_image_msg, to_image_msg, to_pointcloud2

CAMERA = wv.Camera(40, 30, 38.0, 37.0, 19.3, 15.6)
FRAME = {"frame_id": "eye", "types": STORE}

INFO = "sensor_msgs/msg/CameraInfo"
K = [500.0, 0, 320.2, 0, 510.0, 239.9, 0, 0, 1]
P = [480.0, 0, 318.4, 0, 0, 490.0, 241.3, 0, 0, 0, 1, 0]
ALIGNED = [1, 0, 0, 0, 1, 0, 0, 0, 1]
BENT = [-0.3, 0.1, 0.001, -0.002, 0.0]


def info(
    *, ros=2, roi=(0, 0, 0, 0, False), binning=(0, 0), d=(), k=K, p=P, r=(1, 0, 0, 0, 1, 0, 0, 0, 1), size=(640, 480)
):
    """A CameraInfo as a driver gives it: of 640 x 480 pixels, rectified with another focal length."""
    store = STORE if ros == 2 else ROS1
    names = ("x_offset", "y_offset", "height", "width", "do_rectify")
    region = store.types["sensor_msgs/msg/RegionOfInterest"](**dict(zip(names, roi, strict=True)))
    matrices = {"d": d, "k": k, "r": np.ravel(r), "p": p}
    matrices = {name if ros == 2 else name.upper(): np.array(of, dtype=np.float64) for name, of in matrices.items()}
    return store.types[INFO](
        header=None,
        height=size[1],
        width=size[0],
        distortion_model="plumb_bob",
        **matrices,
        binning_x=binning[0],
        binning_y=binning[1],
        roi=region,
    )


def numbers_of(camera):
    return (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)


def image(encoding, data, *, width, height, step, big=0):
    return SimpleNamespace(encoding=encoding, data=data, width=width, height=height, step=step, is_bigendian=big)


# Cameras


@pytest.mark.parametrize("ros", [1, 2])
def test_a_rectified_image_has_the_numbers_of_p(ros):
    """P is of the rectified image, whatever the distortion; ROS counts pixel centres as whole numbers."""
    camera = wv.Camera.from_camera_info(info(ros=ros, d=BENT, r=[[0, 1, 0], [-1, 0, 0], [0, 0, 1]]))
    assert numbers_of(camera) == (640, 480, 480.0, 490.0, 318.9, 241.8)
    assert (camera.near, camera.far) == (0.0, math.inf)


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("d", [(), np.zeros(5), np.zeros(8)])
def test_a_raw_image_has_the_numbers_of_k(ros, d):
    camera = wv.Camera.from_camera_info(info(ros=ros, d=d), rectified=False, near=0.3, far=4.5)
    assert numbers_of(camera) == (640, 480, 500.0, 510.0, 320.7, 240.4)
    assert (camera.near, camera.far) == (0.3, 4.5)


def test_without_p_an_image_without_distortion_is_rectified():
    assert numbers_of(wv.Camera.from_camera_info(info(p=np.zeros(12))))[2:4] == (500.0, 510.0)
    with pytest.raises(CameraError, match=r"has no P, but a Camera has no distortion"):
        wv.Camera.from_camera_info(info(p=np.zeros(12), d=BENT))


def test_pixels_are_where_image_geometry_has_them():
    """`project3dToPixel` gives [u v w] = P [X Y Z 1], and u / w is the pixel whose centre that is."""
    camera = wv.Camera.from_camera_info(info())
    point = np.array([0.3, -0.2, 1.7])
    u, v, w = np.reshape(P, (3, 4)) @ [*point, 1]
    np.testing.assert_allclose(camera.project(point), [u / w + 0.5, v / w + 0.5], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("binning", "roi", "expected"),
    [
        ((1, 1), (0, 0, 480, 640, False), (640, 480, 480.0, 490.0, 318.9, 241.8)),
        ((2, 1), (0, 0, 0, 0, False), (320, 480, 240.0, 490.0, 159.7, 241.8)),
        ((0, 4), (0, 0, 0, 0, False), (640, 120, 480.0, 122.5, 318.9, 60.825)),
        ((0, 0), (100, 40, 200, 300, False), (300, 200, 480.0, 490.0, 218.9, 201.8)),
        ((2, 2), (100, 40, 201, 301, True), (150, 100, 240.0, 245.0, 109.7, 101.15)),
        ((1, 1), (340, 280, 200, 300, False), (300, 200, 480.0, 490.0, -21.1, -38.2)),
    ],
)
@pytest.mark.parametrize("rectified", [True, False])
def test_binning_and_region_as_image_geometry_applies_them(binning, roi, expected, rectified):
    """The region first, in whole pixels, and then binning, which divides P without a half pixel."""
    k = np.reshape(P, (3, 4))[:, :3].ravel()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IntrinsicsWarning)  # a region need not hold the principal point
        camera = wv.Camera.from_camera_info(info(binning=binning, roi=roi, k=k), rectified=rectified)
    assert numbers_of(camera) == pytest.approx(expected, abs=1e-12)


def test_the_second_camera_of_a_pair_is_told_of():
    """Tx = -fx B: the camera is B to the right of the frame that both share."""
    p = [480.0, 0, 318.4, -480.0 * 0.12, 0, 480.0, 241.3, 0, 0, 0, 1, 0]
    with pytest.warns(IntrinsicsWarning, match=r"stereo pair, at x = 0\.12 m, y = 0 m in the frame") as said:
        camera = wv.Camera.from_camera_info(info(p=p, binning=(2, 2)))
    assert said[0].filename == __file__ and camera.fx == 240.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"k": np.zeros(9), "p": np.zeros(12)}, "K of CameraInfo must not be zero: the camera is not calibrated$"),
        ({"d": BENT, "rectified": False}, r"raw image with distortion, .*Use the rectified image \(image_rect\)"),
        ({"d": BENT, "roi": (9, 9, 100, 100, True)}, "does not define the corresponding region of the rectified image"),
        ({"roi": (9, 9, 100, 100, True)}, "the corresponding region of the rectified image"),
        (
            {"roi": (600, 0, 100, 100, False)},
            r"within its image of 640 x 480 pixels, got 100 x 100 pixels from \(600, 0\)",
        ),
        ({"roi": (5, 0, 0, 0, False)}, r"region of interest of CameraInfo must be .*, got 0 x 0 pixels"),
        ({"size": (0, 0)}, r"within its image of 0 x 0 pixels, got 0 x 0 pixels from \(0, 0\)$"),
        ({"binning": (641, 1)}, "binning of CameraInfo must be at most the image size 640 x 480, got 641 x 1"),
        ({"k": [500, 3, 320, 0, 500, 240, 0, 0, 1], "rectified": False}, "without skew"),
        ({"k": [-5, 0, 3, 0, -5, 2, 0, 0, 1], "rectified": False}, "focal lengths must be positive"),
        ({"k": [math.nan] * 9}, "K of CameraInfo must be finite"),
        ({"k": K[:8]}, "K of CameraInfo must be 3 x 3 numbers, got 8"),
        ({"p": [*P[:11], 0.5]}, "P of CameraInfo must have a last column Tx, Ty, 0"),
        ({"rectified": "yes"}, "rectified must be True or False"),
    ],
)
def test_camera_infos_that_make_no_camera(changes, message):
    options = {name: changes.pop(name) for name in ("rectified",) if name in changes}
    with pytest.raises(CameraError, match=message):
        wv.Camera.from_camera_info(info(**changes), **options)


@pytest.mark.parametrize("changes", [{"size": ("wide", 480)}, {"roi": (0, 0, None, 1, False)}, {"binning": (1.5, 1)}])
def test_camera_infos_whose_numbers_are_none(changes):
    with pytest.raises(MessageError, match="must be a whole number from 0 up"):
        wv.Camera.from_camera_info(info(**changes))


def test_what_is_no_camera_info():
    with pytest.raises(MessageError, match="message must have the field k, got str"):
        wv.Camera.from_camera_info("camera")


@given(
    size=st.tuples(st.integers(1, 5000), st.integers(1, 5000)),
    focal=st.tuples(st.floats(1, 1e5), st.floats(1, 1e5)),
    centre=st.tuples(st.floats(0.25, 1), st.floats(0.25, 1)),
)
def test_a_camera_comes_back_as_it_was(size, focal, centre):
    """To the last bit, of centres a quarter of a pixel or more from the image's edge: half a pixel is exact there."""
    cx, cy = (max(0.25, share * side) for share, side in zip(centre, size, strict=True))
    camera = wv.Camera(*size, *focal, cx, cy, near=0.1, far=7.0)
    message = camera.to_camera_info(**FRAME)
    for rectified in (True, False):
        assert wv.Camera.from_camera_info(message, rectified=rectified, near=0.1, far=7.0) == camera


def test_a_camera_info_says_all_of_a_camera():
    message = CAMERA.to_camera_info(frame_id="eye", stamp=12.25, types=STORE)
    assert message.k.tolist() == [38.0, 0, 18.8, 0, 37.0, 15.1, 0, 0, 1]
    assert message.p.tolist() == [38.0, 0, 18.8, 0, 0, 37.0, 15.1, 0, 0, 0, 1, 0]
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 250_000_000)
    assert message.header.frame_id == "eye"
    STORE.serialize_cdr(message, INFO)


# Depth images

ODD = np.array([[math.inf, -math.inf, math.nan], [0.0, 1.2345678, 70.0]], dtype=np.float32)


def test_metres_keep_every_value():
    """REP 117: infinities and NaN are values, and so is every bit of the rest."""
    message = to_image_msg(ODD, stamp=0.5, **FRAME)
    assert (message.encoding, message.height, message.width, message.step) == ("32FC1", 2, 3, 12)
    assert message.is_bigendian == 0 and bytes(message.data) == ODD.astype("<f4").tobytes()
    assert from_image_msg(message).tobytes() == ODD.tobytes()


def test_millimetres_are_rounded_to_even():
    """Ties exactly: 62.5, 187.5 and 312.5 mm are 62, 188 and 312; one more bit rounds up."""
    depth = np.array([[0.0625, 0.1875, 0.3125, np.nextafter(np.float32(0.0625), np.float32(1)), 1.9996, 65.534]])
    units = np.frombuffer(to_image_msg(depth, encoding="16UC1", **FRAME).data, dtype="<u2")
    assert units.tolist() == [62, 188, 312, 63, 2000, 65534]


def test_what_millimetres_cannot_hold_is_counted():
    with pytest.warns(UserWarning, match=r"^pixels have a depth that 16 bits .*: 1 in all$") as said:
        message = to_image_msg(ODD, encoding="16UC1", **FRAME)
    assert said[0].filename == __file__
    assert (message.encoding, message.step) == ("16UC1", 6)
    assert np.frombuffer(message.data, dtype="<u2").tolist() == [0, 0, 0, 0, 1235, 0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        to_image_msg(ODD[:, :2], encoding="16UC1", **FRAME)  # no depth is not lost


def test_millimetres_come_back_as_metres():
    """All 65536 values; 0 and 65535 are no depth. Metres are the nearest floats, and lead to the same millimetres."""
    units = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    depth = from_image_msg(image("16UC1", units.astype("<u2").tobytes(), width=256, height=256, step=512))
    assert np.isnan(depth.ravel()[[0, -1]]).all() and depth.dtype == np.float32
    assert (depth.ravel()[1:-1] == np.array([k / 1000 for k in range(1, 65535)], dtype=np.float32)).all()
    again = to_image_msg(depth, encoding="16UC1", **FRAME)
    units[-1, -1] = 0
    assert bytes(again.data) == units.tobytes()


@pytest.mark.parametrize("big", [0, 1, True])
@pytest.mark.parametrize(("encoding", "kind"), [("32FC1", "f4"), ("16UC1", "u2"), ("mono16", "u2")])
@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("holder", [bytes, lambda data: array.array("B", data), list, lambda d: np.frombuffer(d, "u1")])
def test_either_order_of_bytes_and_padded_rows(big, encoding, kind, padding, holder):
    values = np.array([[1, 2, 258], [4, 5, 513]])
    rows = values.astype((">" if big else "<") + kind)
    data = b"".join(row.tobytes() + b"\xee" * padding for row in rows)
    step = rows.itemsize * 3 + padding
    depth = from_image_msg(image(encoding, holder(data), width=3, height=2, step=step, big=big))
    expected = values if kind == "f4" else values / 1000
    assert (depth == expected.astype(np.float32)).all() and depth.dtype == np.float32 and depth.dtype.isnative


def test_an_image_shares_no_memory():
    """A renderer writes into the same arrays again and again."""
    depth, points = np.full((2, 2), 1.5, dtype=np.float32), np.full((2, 3), 1.5, dtype=np.float32)
    message, cloud = to_image_msg(depth, **FRAME), to_pointcloud2(points, **FRAME)
    read = from_image_msg(message)
    depth[:], points[:] = 9, 9
    for made in (message, cloud):
        assert (np.frombuffer(made.data, dtype="<f4") == 1.5).all()
    message.data[:] = 0
    assert (read == 1.5).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"encoding": "rgb8"}, "an Image of depth must be of 32FC1 or 16UC1, got 'rgb8'"),
        ({"step": 11}, "in rows of 11 bytes must have at least 4 bytes a pixel and 22 in all, got 24"),
        ({"data": b"1"}, "and 24 in all, got 1"),
        ({"data": bytes(25)}, "and 24 in all, got 25"),
        ({"width": 0}, "must have pixels, got 0 x 2"),
        ({"height": 0, "data": b""}, "must have pixels, got 3 x 0"),
        ({"height": "two"}, "^height of a message must be a whole number from 0 up, got 'two'"),
        ({"step": 12.5}, "^step of a message must be a whole number"),
        ({"width": math.nan}, "^width of a message must be a whole number"),
        ({"data": "text"}, "data of an Image must be bytes"),
        ({"data": [1, 256]}, "data of an Image must be bytes"),
    ],
)
def test_images_that_hold_no_depth(changes, message):
    fields = {"encoding": "32FC1", "data": bytes(24), "width": 3, "height": 2, "step": 12, **changes}
    with pytest.raises(MessageError, match=message):
        from_image_msg(image(**fields))


def test_arrays_of_all_kinds_go_in(device):
    kinds = [ODD, ODD[None], ODD.astype(np.float64), ODD.tolist(), ODD[:, ::-1][:, ::-1], wp.array(ODD, device=device)]
    if importlib.util.find_spec("torch") is not None:
        torch = importlib.import_module("torch")
        kinds += [torch.tensor(ODD), torch.tensor(ODD, device=device)]
    for depth in kinds:
        assert from_image_msg(to_image_msg(depth, **FRAME)).tobytes() == ODD.tobytes()
    points = wp.array(np.arange(6, dtype=np.float32).reshape(2, 3), dtype=wp.vec3, device=device)
    assert np.frombuffer(to_pointcloud2(points, **FRAME).data, dtype="<f4").tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    ("depth", "options", "message"),
    [
        (np.ones((2, 3), dtype=np.uint16), {}, "depth must be in meters, a float array, got uint16"),
        (np.ones((2, 2, 3)), {}, r"depth must be one image of shape \(H, W\), got \(2, 2, 3\)"),
        (np.ones((0, 3)), {}, r"one image of shape \(H, W\), got \(0, 3\)"),
        (ODD, {"encoding": "rgb8"}, 'encoding must be "32FC1" or "16UC1", got \'rgb8\''),
        (ODD, {"stamp": -1.0}, "stamp must be from 0 to 2147483647 s, the range of ROS 2, got -1.0"),
        (ODD, {"stamp": math.nan}, "stamp must be from 0"),
        (ODD, {"stamp": "now"}, "stamp must be a time in seconds or a Time message, got 'now'"),
        (ODD, {"frame_id": 7}, "frame_id must be text, got 7"),
        (ODD, {"types": {}}, "types must be a type store of rosbags, or None for ROS's own"),
    ],
)
def test_bad_arguments_of_images(depth, options, message):
    with pytest.raises(wv.WarpvisError, match=message):
        to_image_msg(depth, **{**FRAME, **options})


def test_a_store_of_ros_1_makes_no_messages_of_ros_2():
    with pytest.raises(
        MessageError, match=r"types must define std_msgs/msg/Header as in ROS 2 .*Use Stores.ROS2_JAZZY"
    ):
        to_image_msg(ODD, frame_id="eye", types=ROS1)


def test_a_stamp_may_be_a_message():
    """Of ROS 2, or of ROS 1 with its own names; a float is taken at its shortest decimal."""
    stamps = [
        SimpleNamespace(sec=1305031102, nanosec=175_304_001),
        SimpleNamespace(secs=1305031102, nsecs=175_304_001),
    ]
    for stamp in stamps:
        taken = to_image_msg(ODD, stamp=stamp, **FRAME).header.stamp
        assert (taken.sec, taken.nanosec) == (1305031102, 175_304_001)
    taken = to_image_msg(ODD, stamp=np.float64(1305031102.175304), **FRAME).header.stamp
    assert (taken.sec, taken.nanosec) == (1305031102, 175_304_000)


# Points


def xyz_of(cloud):
    assert [(field.name, field.offset, field.datatype) for field in cloud.fields] == [
        ("x", 0, 7),
        ("y", 4, 7),
        ("z", 8, 7),
    ]
    assert (cloud.point_step, cloud.row_step, cloud.is_bigendian) == (12, 12 * cloud.width, False)
    return np.frombuffer(cloud.data, dtype="<f4").reshape(cloud.height, cloud.width, 3)


def test_a_cloud_of_a_depth_image_is_in_the_optical_frame():
    depth = np.full((30, 40), 2.0, dtype=np.float32)
    depth[0, :3] = math.inf, -math.inf, math.nan
    depth[1, :4] = 0.0, -1.0, 0.4, 3.1
    cloud = to_pointcloud2(depth[None], dataclasses.replace(CAMERA, near=0.5, far=3.0), **FRAME)
    points = xyz_of(cloud)
    assert not cloud.is_dense and np.isnan(points[0, :3]).all() and np.isnan(points[1, :4]).all()
    assert np.isfinite(points).sum() == 3 * (40 * 30 - 7)
    rows, columns = np.nonzero(np.isfinite(points[..., 0]))
    expected = CAMERA.back_project(np.stack([columns + 0.5, rows + 0.5], axis=-1), depth[rows, columns])
    assert np.abs(points[rows, columns] - expected).max() < 1e-6


def test_the_range_ends_where_rendered_depth_does():
    """`far` in double precision may be less than the same number in single, which rendered depth reaches."""
    far = np.float32(2.3)
    assert float(far) < 2.3 or float(far) > 2.3
    for edge in (2.3, float(np.nextafter(far, np.float32(0)) / 2 + far / 2)):
        camera = wv.Camera(2, 1, 5.0, 5.0, 1.0, 0.5, far=edge)
        depth = np.full((1, 2), np.float32(edge))
        assert np.isfinite(xyz_of(to_pointcloud2(depth, camera, **FRAME))).all()


def test_points_of_any_frame():
    points = np.arange(12, dtype=np.float64).reshape(4, 3)
    cloud = to_pointcloud2(points, frame_id="map", stamp=3.0, types=STORE)
    assert (xyz_of(cloud) == points).all() and (cloud.height, cloud.width) == (1, 4) and cloud.is_dense
    assert cloud.header.frame_id == "map" and cloud.header.stamp.sec == 3
    points[2] = math.nan
    assert not to_pointcloud2(points, **FRAME).is_dense
    organised = to_pointcloud2(points.reshape(1, 2, 2, 3), **FRAME)
    assert (organised.height, organised.width) == (2, 2)
    empty = to_pointcloud2(np.zeros((0, 3)), **FRAME)
    assert (empty.width, len(empty.data)) == (0, 0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.ones((30, 40)),), r"points must be numbers of shape \(N, 3\).*of a depth image, give its camera, too"),
        ((np.ones((30, 41)), CAMERA), r"depth must have the camera's shape \(30, 40\), got \(30, 41\)"),
        ((np.ones((30, 40)), "kinect"), "camera must be a warpvis.Camera or a warpvis.sensors.LensCamera, got str"),
        ((np.ones((4, 3), dtype=bool),), "points must be numbers"),
    ],
)
def test_bad_arguments_of_clouds(arguments, message):
    with pytest.raises(wv.WarpvisError, match=message):
        to_pointcloud2(*arguments, **FRAME)


# ROS's own classes


def test_ros_own_classes_get_what_they_ask_for(monkeypatch):
    """Fields of the types that they assert, and the same bytes as rosbags' messages."""
    ros_messages.install(monkeypatch)
    depth = np.full((30, 40), 2.0, dtype=np.float32)
    for make in (
        lambda types: CAMERA.to_camera_info(frame_id="eye", stamp=1.5, types=types),
        lambda types: to_image_msg(depth, frame_id="eye", stamp=1.5, types=types),
        lambda types: to_image_msg(depth, frame_id="eye", encoding="16UC1", types=types),
        lambda types: to_pointcloud2(depth, CAMERA, frame_id="eye", types=types),
        lambda types: to_pointcloud2(np.ones((5, 3)), frame_id="eye", types=types),
    ):
        own, other = make(None), make(STORE)
        kind = own.KIND
        assert bytes(STORE.serialize_cdr(ros_messages.as_rosbags(own), kind)) == bytes(STORE.serialize_cdr(other, kind))


def test_ros_own_messages_are_read(monkeypatch):
    ros_messages.install(monkeypatch)
    message = to_image_msg(ODD, frame_id="eye")
    assert isinstance(message.data, array.array)  # anything else is looked at byte by byte
    assert from_image_msg(message).tobytes() == ODD.tobytes()
    assert wv.Camera.from_camera_info(CAMERA.to_camera_info(frame_id="eye", stamp=message.header.stamp)) == CAMERA


def test_without_ros_one_sentence_says_what_to_do(monkeypatch):
    def refuse(name, *arguments, real=builtins.__import__, **options):
        assert not name.startswith(("rosbags", "rclpy")), "rosbags is the caller's to import"
        return real(name, *arguments, **options)

    for package in ("builtin_interfaces", "sensor_msgs", "std_msgs"):
        monkeypatch.delitem(sys.modules, package, raising=False)
    monkeypatch.setattr(builtins, "__import__", refuse)
    for make in (lambda: CAMERA.to_camera_info(frame_id="eye"), lambda: to_image_msg(ODD, frame_id="eye")):
        with pytest.raises(
            MessageError, match=r"requires ROS 2, which is not on Python's path .* or rosbags: pip install"
        ):
            make()


def test_a_message_that_arrives_answers_what_is_visible():
    """A live camera's image and its camera_info are all that these functions need."""
    depth = np.full((30, 40), 2.0, dtype=np.float32)
    depth[:, :20] = math.nan
    eye = wv.Camera.from_camera_info(CAMERA.to_camera_info(**FRAME), far=5.0)
    for encoding in ("32FC1", "16UC1"):
        seen = from_image_msg(to_image_msg(depth, encoding=encoding, **FRAME))
        points = np.array([[0.5, 0, 1.0], [0.5, 0, 2.5], [-0.5, 0, 1.0]])
        status = wv.point_visibility_from_depth(seen, eye, (0, 0, 0, 0, 0, 0, 1), points).numpy()[0]
        assert status.tolist() == [wv.Visibility.VISIBLE, wv.Visibility.OCCLUDED, wv.Visibility.UNKNOWN]
        labels = wv.classify(seen, eye, (0, 0, 0, 0, 0, 0, 1)).numpy()[0]
        assert (labels[:, :20] == wv.Label.EMPTY).all() and (labels[:, 20:] != wv.Label.EMPTY).all()
