# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of ROS messages: cameras, depth images and points, both ways, with rosbags' types and ROS's own classes."""

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

from support.recorded_warnings import recorded_warnings

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
    """Return a typical driver's CameraInfo: 640 x 480 pixels, rectified with another focal length."""
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
def test_rectified_camera_uses_p(ros):
    """P describes the rectified image, whatever the distortion; in ROS, pixel centers are integers."""
    camera = wv.Camera.from_camera_info(info(ros=ros, d=BENT, r=[[0, 1, 0], [-1, 0, 0], [0, 0, 1]]))
    assert numbers_of(camera) == (640, 480, 480.0, 490.0, 318.9, 241.8)
    assert (camera.near, camera.far) == (0.0, math.inf)


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("d", [(), np.zeros(5), np.zeros(8)])
def test_raw_camera_uses_k(ros, d):
    camera = wv.Camera.from_camera_info(info(ros=ros, d=d), rectified=False, near=0.3, far=4.5)
    assert numbers_of(camera) == (640, 480, 500.0, 510.0, 320.7, 240.4)
    assert (camera.near, camera.far) == (0.3, 4.5)


def test_undistorted_image_without_p_uses_k():
    assert numbers_of(wv.Camera.from_camera_info(info(p=np.zeros(12))))[2:4] == (500.0, 510.0)
    with pytest.raises(CameraError, match=r"has no P, but a Camera has no distortion"):
        wv.Camera.from_camera_info(info(p=np.zeros(12), d=BENT))


def test_projection_matches_image_geometry():
    """`project3dToPixel` computes [u v w] = P [X Y Z 1]; u / w is 0 at the center of the first pixel."""
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
def test_binning_and_roi_match_image_geometry(binning, roi, expected, rectified):
    """The region applies first, in whole pixels, then binning, which divides P without a half-pixel shift."""
    k = np.reshape(P, (3, 4))[:, :3].ravel()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IntrinsicsWarning)  # a region may exclude the principal point
        camera = wv.Camera.from_camera_info(info(binning=binning, roi=roi, k=k), rectified=rectified)
    assert numbers_of(camera) == pytest.approx(expected, abs=1e-12)


def test_right_camera_of_stereo_pair_warns():
    """Tx = -fx B: the camera is B to the right of the frame that both share."""
    p = [480.0, 0, 318.4, -480.0 * 0.12, 0, 480.0, 241.3, 0, 0, 0, 1, 0]
    with recorded_warnings(r"stereo pair, at x = 0\.12 m, y = 0 m in the frame", IntrinsicsWarning) as said:
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
def test_invalid_camera_infos_raise(changes, message):
    options = {name: changes.pop(name) for name in ("rectified",) if name in changes}
    with pytest.raises(CameraError, match=message):
        wv.Camera.from_camera_info(info(**changes), **options)


@pytest.mark.parametrize("changes", [{"size": ("wide", 480)}, {"roi": (0, 0, None, 1, False)}, {"binning": (1.5, 1)}])
def test_non_integer_sizes_raise(changes):
    with pytest.raises(MessageError, match="must be a whole number from 0 up"):
        wv.Camera.from_camera_info(info(**changes))


def test_other_objects_than_camera_info_raise():
    with pytest.raises(MessageError, match="message must have the field k, got str"):
        wv.Camera.from_camera_info("camera")


@given(
    size=st.tuples(st.integers(1, 5000), st.integers(1, 5000)),
    focal=st.tuples(st.floats(1, 1e5), st.floats(1, 1e5)),
    center=st.tuples(st.floats(0.25, 1), st.floats(0.25, 1)),
)
def test_camera_info_round_trips_exactly(size, focal, center):
    """Principal points at least a quarter of a pixel from the edge: half a pixel is exact there."""
    cx, cy = (max(0.25, share * side) for share, side in zip(center, size, strict=True))
    camera = wv.Camera(*size, *focal, cx, cy, near=0.1, far=7.0)
    message = camera.to_camera_info(**FRAME)
    for rectified in (True, False):
        assert wv.Camera.from_camera_info(message, rectified=rectified, near=0.1, far=7.0) == camera


def test_camera_info_fields_match_camera():
    message = CAMERA.to_camera_info(frame_id="eye", stamp=12.25, types=STORE)
    assert message.k.tolist() == [38.0, 0, 18.8, 0, 37.0, 15.1, 0, 0, 1]
    assert message.p.tolist() == [38.0, 0, 18.8, 0, 0, 37.0, 15.1, 0, 0, 0, 1, 0]
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 250_000_000)
    assert message.header.frame_id == "eye"
    STORE.serialize_cdr(message, INFO)


# Depth images

ODD = np.array([[math.inf, -math.inf, math.nan], [0.0, 1.2345678, 70.0]], dtype=np.float32)


def test_float_depth_keeps_every_bit():
    """REP 117: infinities and NaN are valid values."""
    message = to_image_msg(ODD, stamp=0.5, **FRAME)
    assert (message.encoding, message.height, message.width, message.step) == ("32FC1", 2, 3, 12)
    assert message.is_bigendian == 0 and bytes(message.data) == ODD.astype("<f4").tobytes()
    assert from_image_msg(message).tobytes() == ODD.tobytes()


def test_millimeters_are_rounded_half_to_even():
    """Exact ties: 62.5, 187.5 and 312.5 mm become 62, 188 and 312; one more bit rounds up."""
    depth = np.array([[0.0625, 0.1875, 0.3125, np.nextafter(np.float32(0.0625), np.float32(1)), 1.9996, 65.534]])
    units = np.frombuffer(to_image_msg(depth, encoding="16UC1", **FRAME).data, dtype="<u2")
    assert units.tolist() == [62, 188, 312, 63, 2000, 65534]


def test_depths_beyond_16_bits_warn():
    with recorded_warnings(r"^pixels have a depth that 16 bits .*: 1 in all$") as said:
        message = to_image_msg(ODD, encoding="16UC1", **FRAME)
    assert said[0].filename == __file__
    assert (message.encoding, message.step) == ("16UC1", 6)
    assert np.frombuffer(message.data, dtype="<u2").tolist() == [0, 0, 0, 0, 1235, 0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        to_image_msg(ODD[:, :2], encoding="16UC1", **FRAME)  # missing depth does not count as lost


def test_millimeters_round_trip():
    """All 65536 values; 0 and 65535 are no depth. Meters are the nearest floats and convert back to the same
    millimeters."""
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
def test_byte_orders_and_padded_rows(big, encoding, kind, padding, holder):
    values = np.array([[1, 2, 258], [4, 5, 513]])
    rows = values.astype((">" if big else "<") + kind)
    data = b"".join(row.tobytes() + b"\xee" * padding for row in rows)
    step = rows.itemsize * 3 + padding
    depth = from_image_msg(image(encoding, holder(data), width=3, height=2, step=step, big=big))
    expected = values if kind == "f4" else values / 1000
    assert (depth == expected.astype(np.float32)).all() and depth.dtype == np.float32 and depth.dtype.isnative


def test_messages_share_no_memory():
    """A renderer writes into the same arrays repeatedly."""
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
def test_invalid_depth_images_raise(changes, message):
    fields = {"encoding": "32FC1", "data": bytes(24), "width": 3, "height": 2, "step": 12, **changes}
    with pytest.raises(MessageError, match=message):
        from_image_msg(image(**fields))


def test_array_types_are_accepted(device):
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
def test_invalid_image_arguments_raise(depth, options, message):
    with pytest.raises(wv.WarpvisError, match=message):
        to_image_msg(depth, **{**FRAME, **options})


def test_ros1_type_store_raises():
    with pytest.raises(
        MessageError, match=r"types must define std_msgs/msg/Header as in ROS 2 .*Use Stores.ROS2_JAZZY"
    ):
        to_image_msg(ODD, frame_id="eye", types=ROS1)


def test_stamp_may_be_a_message():
    """Of ROS 2 or ROS 1; a float is converted from its shortest decimal."""
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


def test_cloud_of_depth_is_in_the_optical_frame():
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


def test_cloud_includes_depth_equal_to_far():
    """`far` in double precision may be below its single-precision value, which rendered depth reaches."""
    far = np.float32(2.3)
    assert float(far) < 2.3 or float(far) > 2.3
    for edge in (2.3, float(np.nextafter(far, np.float32(0)) / 2 + far / 2)):
        camera = wv.Camera(2, 1, 5.0, 5.0, 1.0, 0.5, far=edge)
        depth = np.full((1, 2), np.float32(edge))
        assert np.isfinite(xyz_of(to_pointcloud2(depth, camera, **FRAME))).all()


def test_clouds_accept_points_of_any_frame():
    points = np.arange(12, dtype=np.float64).reshape(4, 3)
    cloud = to_pointcloud2(points, frame_id="map", stamp=3.0, types=STORE)
    assert (xyz_of(cloud) == points).all() and (cloud.height, cloud.width) == (1, 4) and cloud.is_dense
    assert cloud.header.frame_id == "map" and cloud.header.stamp.sec == 3
    points[2] = math.nan
    assert not to_pointcloud2(points, **FRAME).is_dense
    organized = to_pointcloud2(points.reshape(1, 2, 2, 3), **FRAME)
    assert (organized.height, organized.width) == (2, 2)
    empty = to_pointcloud2(np.zeros((0, 3)), **FRAME)
    assert (empty.width, len(empty.data)) == (0, 0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.ones((30, 40)),), r"points must be numbers of shape \(N, 3\).*of a depth image, give its camera, too"),
        ((np.ones((30, 41)), CAMERA), r"depth must have the camera's shape \(30, 40\), got \(30, 41\)"),
        ((np.ones((30, 40)), "kinect"), "camera must be a warpvis.Camera or a warpvis.cameras.LensCamera, got str"),
        ((np.ones((4, 3), dtype=bool),), "points must be numbers"),
    ],
)
def test_invalid_cloud_arguments_raise(arguments, message):
    with pytest.raises(wv.WarpvisError, match=message):
        to_pointcloud2(*arguments, **FRAME)


# ROS's own classes


def test_ros_classes_receive_valid_fields(monkeypatch):
    """Field types satisfy the assertions, and the bytes equal those of rosbags' messages."""
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


def test_ros_messages_are_read(monkeypatch):
    ros_messages.install(monkeypatch)
    message = to_image_msg(ODD, frame_id="eye")
    assert isinstance(message.data, array.array)  # other types are checked byte by byte
    assert from_image_msg(message).tobytes() == ODD.tobytes()
    assert wv.Camera.from_camera_info(CAMERA.to_camera_info(frame_id="eye", stamp=message.header.stamp)) == CAMERA


def test_missing_ros_error_names_remedy(monkeypatch):
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


def test_received_messages_give_visibility_and_labels():
    """A live camera's image and camera_info suffice."""
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
