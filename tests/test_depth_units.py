# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth is in meters: millimeters raise, and 65535 in 16 bits means no depth."""

import numpy as np
import pytest
import warp as wp
from PIL import Image

import warpvis as wv
from warpvis.io import from_image_msg, read_depth, save_depth_png, to_image_msg, to_pointcloud2

CAMERA = wv.Camera.from_fov(64, 48, hfov=1.0, near=0.3, far=4.5)
ENDLESS = wv.Camera.from_fov(64, 48, hfov=1.0)
POSE = wv.look_at((0, 0, 1), (1, 0, 1))
POINTS = np.array([(1.0, 0, 1), (2.0, 0, 1)], dtype=np.float32)
BOUNDS = [[0, -1, 0], [3, 1, 2]]
WALL = np.full((48, 64), 1.5, dtype=np.float32)

# A room from 0.5 m to 4 m with the non-finite values of measured images.
ROOM = np.linspace(0.5, 4.0, 48 * 64, dtype=np.float32).reshape(48, 64).copy()
ROOM[0, :4] = 0.0, np.nan, np.inf, -np.inf

READERS = {
    "classify": lambda depth, camera: wv.classify(depth, camera, POSE),
    "back_project": lambda depth, camera: wv.back_project(depth, camera, POSE),
    "voxel_map": lambda depth, camera: wv.voxel_map(depth, camera, POSE, bounds=BOUNDS, cell_size=0.1),
    "point_visibility_from_depth": lambda depth, camera: wv.point_visibility_from_depth(depth, camera, POSE, POINTS),
}


def as_host_array(depth):
    return wp.array(depth[None], dtype=wp.float32, device="cpu")


@pytest.mark.parametrize("make", [np.array, np.float64, as_host_array, lambda depth: depth[None].repeat(3, axis=0)[:1]])
@pytest.mark.parametrize("image", [WALL, ROOM], ids=["wall", "room"])
@pytest.mark.parametrize("name", READERS)
def test_float_millimeters_raise(name, image, make):
    READERS[name](make(image), CAMERA)
    with pytest.raises(wv.errors.ArrayError, match=r"^depth must be in meters, got .* pass depth / 1000; if"):
        READERS[name](make(1000 * image), CAMERA)


@pytest.mark.parametrize("name", READERS)
def test_integer_millimeters_raise_without_a_range(name):
    millimeters = np.rint(1000 * ROOM)
    with pytest.raises(wv.errors.ArrayError, match=r"got whole numbers only, .* pass depth / 1000; if"):
        READERS[name](millimeters, ENDLESS)
    READERS[name](millimeters, wv.Camera.from_fov(64, 48, hfov=1.0, far=1e4))  # the camera's far covers these values


def test_large_batches_are_sampled_first():
    """The first pixels of every image, and every other row and column, have no depth."""
    images = np.full((40, 48, 64), np.nan, dtype=np.float32)
    images[:, 9:40, 9:50] = ROOM[9:40, 9:50]
    wv.classify(images, CAMERA, np.repeat(POSE[None], 40, axis=0))
    with pytest.raises(wv.errors.ArrayError, match="depth / 1000"):
        wv.classify(1000 * images, CAMERA, np.repeat(POSE[None], 40, axis=0))


FAR_SCENES = {
    "a satellite's": (np.full((48, 64), 1500.0), ENDLESS),
    "a drone's, its camera sees so far": (
        1500 + ROOM[1:2].repeat(48, axis=0),
        wv.Camera.from_fov(64, 48, hfov=1.0, far=5e3),
    ),
    "a hall beyond a short range": (ROOM * 8, CAMERA),
    "a street beyond a short range": (ROOM * 20, CAMERA),
    "a wall with a few values far beyond": (np.where(np.arange(64) < 4, np.float32(2500.0), ROOM), CAMERA),
    "nothing measured": (np.full((48, 64), np.nan), CAMERA),
    "nothing there": (np.full((48, 64), np.inf), CAMERA),
    "all too near": (np.full((48, 64), -np.inf), CAMERA),
    "beyond any unit": (np.full((48, 64), 1e30), CAMERA),
}


@pytest.mark.parametrize("name", FAR_SCENES)
def test_meters_are_accepted(name):
    depth, camera = FAR_SCENES[name]
    for read in READERS.values():
        read(np.asarray(depth, dtype=np.float32), camera)


def test_max_range_of_classify_is_used():
    wv.classify(1000 * ROOM, CAMERA, POSE, max_range=1e4)
    with pytest.raises(wv.errors.ArrayError, match="depth / 1000"):
        wv.classify(1000 * ROOM, ENDLESS, POSE, max_range=4.5)


def test_integer_arrays_raise_on_every_device(device):
    with pytest.raises(wv.errors.ArrayError, match=r"in meters, a float array, got uint16; divide millimeters by 1000"):
        wv.classify(np.full((1, 48, 64), 1500, dtype=np.uint16), CAMERA, POSE, device=device)


def test_clouds_in_millimeters_raise():
    from rosbags.typesys import Stores, get_typestore

    options = {"frame_id": "camera", "types": get_typestore(Stores.ROS2_JAZZY)}
    to_pointcloud2(ROOM, CAMERA, **options)
    with pytest.raises(wv.errors.ArrayError, match="depth / 1000"):
        to_pointcloud2(1000 * ROOM, CAMERA, **options)


def test_wall_images_in_millimeters_raise():
    walls = [np.linspace(z, 1.3 * z, 64, dtype=np.float32) * np.ones((48, 1), np.float32) for z in (0.8, 1.5)]
    for camera in (CAMERA, ENDLESS):
        with pytest.raises(
            wv.errors.ArrayError, match=r"^depth_images\[0\] must be in meters, .* depth_images\[0\] / 10"
        ):
            wv.sensors.fit([1000 * wall for wall in walls], camera, baseline=0.05)


def test_baseline_in_millimeters_warns():
    with pytest.warns(UserWarning, match=r"If it is in millimeters, pass 0\.05\."):
        wv.sensors.fit([WALL], CAMERA, baseline=50.0)


UNITS = np.array([[0, 1, 1000], [65533, 65534, 65535]], dtype=np.uint16)


@pytest.mark.parametrize("unit", [0.001, 0.0002])
@pytest.mark.parametrize("kind", ["png", "npy", "npy of big-endian"])
def test_65535_in_a_file_means_no_depth(tmp_path, kind, unit):
    path = tmp_path / f"depth.{kind[:3]}"
    if kind == "png":
        Image.fromarray(UNITS).save(path)
    else:
        np.save(path, UNITS.astype(">u2") if "big" in kind else UNITS)
    depth = read_depth(path, unit=unit)
    assert np.isnan(depth[[0, 1], [0, 2]]).all()
    np.testing.assert_allclose(depth.ravel()[1:-1], UNITS.ravel()[1:-1] * unit, rtol=1e-6)


def test_65535_in_wider_integers_is_depth(tmp_path):
    np.save(tmp_path / "depth.npy", UNITS.astype(np.int32))
    assert read_depth(tmp_path / "depth.npy", unit=0.0001)[1, 2] == np.float32(6.5535)


def test_65535_is_never_written(tmp_path):
    from rosbags.typesys import Stores, get_typestore

    depth = np.array([[1.0, 65.534, 65.535, 65.536, np.inf, -np.inf, np.nan, 0.0]], dtype=np.float32)
    with pytest.warns(UserWarning, match=r"^pixels have a depth that 16 bits .*0\.0005 to 65\.5345 m.*: 2 in all$"):
        save_depth_png(depth, tmp_path / "depth.png")
    written = np.asarray(Image.open(tmp_path / "depth.png"))
    assert written.tolist() == [[1000, 65534, 0, 0, 0, 0, 0, 0]]
    with pytest.warns(UserWarning, match=": 2 in all$"):
        message = to_image_msg(depth, frame_id="camera", encoding="16UC1", types=get_typestore(Stores.ROS2_JAZZY))
    assert np.frombuffer(message.data, "<u2").tolist() == written[0].tolist()
    np.testing.assert_array_equal(from_image_msg(message), read_depth(tmp_path / "depth.png"))


def test_saving_integers_as_meters_raises(tmp_path):
    with pytest.raises(wv.errors.ArrayError, match="a float array, got uint16; divide millimeters by 1000"):
        save_depth_png(UNITS, tmp_path / "depth.png")


def test_65535_in_a_message_means_no_depth():
    from types import SimpleNamespace

    message = SimpleNamespace(
        encoding="16UC1", height=2, width=3, step=6, is_bigendian=0, data=UNITS.astype("<u2").tobytes()
    )
    depth = from_image_msg(message)
    assert np.isnan(depth[[0, 1], [0, 2]]).all() and depth[1, 1] == np.float32(65.534)


@pytest.mark.parametrize(("layout", "scale"), [("png", 1000), ("tum", 5000), ("nerfstudio", 1000), ("bop", 1000)])
def test_65535_in_a_dataset_means_no_depth(tmp_path, layout, scale):
    """A wall at 65535 units is written as no depth, counted, and read back as no depth."""
    scene = wv.Scene(device="cpu")
    far = 65535 / scale
    corners = np.float32([(-99, -99, far), (99, -99, far), (0, 99, far)])
    scene.add((corners, np.int32([(0, 1, 2)])), name="wall", label="object")
    camera = wv.Camera(4, 3, 4, 4, 2, 1.5)
    poses = np.float64([(0, 0, 0, 0, 0, 0, 1), (0, 0, 1, 0, 0, 0, 1)])
    summary = wv.render_batch(scene, camera, poses, tmp_path, format=layout)
    assert list(summary.warnings.values()) == [12]
    depth = np.asarray(wv.open_dataset(tmp_path)["depth"])
    assert np.isposinf(depth[0]).all()
    np.testing.assert_allclose(depth[1], far - 1, atol=1e-3)
    (path,) = tmp_path.glob("**/depth/**/000001.png")
    Image.fromarray(np.full((3, 4), 65535, dtype=np.uint16)).save(path)
    assert np.isposinf(wv.open_dataset(tmp_path)["depth"][1]).all()
