# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Camera files of other systems, alone and with poses."""

import json
import math
import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from pose_samples import MATRICES, ROWS, assert_same_poses, bop, nerfstudio

import warpvis as wv
from warpvis.cli import main
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import FileFormatError, IntrinsicsWarning
from warpvis.io import load_camera, read_frames

from support.camera_files import (
    CAMERA,
    CX,
    CY,
    FX,
    FY,
    INTEGER,
    KALIBR,
    NERF,
    ROS_YAML,
    colmap_binary,
    colmap_text,
    put,
)


def same(camera, other=CAMERA):
    assert (camera.width, camera.height) == (other.width, other.height)
    np.testing.assert_allclose(camera.to_K(), other.to_K(), atol=1e-9)
    assert (camera.near, camera.far) == (0.0, math.inf)
    return True


def test_cameras_of_other_systems(tmp_path):
    """Each system has its pixel-center convention."""
    same(load_camera(put(tmp_path / "transforms.json", {**NERF, "frames": []})))
    fields = {"fx": FX, "fy": FY, "cx": CX, "cy": CY, "width": 64, "height": 48, "depth_scale": 0.1}
    same(load_camera(put(tmp_path / "camera.json", fields)))
    colmap_text(tmp_path / "model")
    colmap_binary(tmp_path / "model")
    same(load_camera(tmp_path / "model" / "cameras.txt"))
    same(load_camera(str(tmp_path / "model" / "cameras.bin")))
    pytest.importorskip("ruamel.yaml")
    same(load_camera(put(tmp_path / "eye.yaml", ROS_YAML)))
    same(load_camera(put(tmp_path / "chain.yml", KALIBR)))


def test_ros_calibration_describes_the_rectified_image(tmp_path):
    """Without distortion, it is `P`; without `P`, it is `K` with a warning."""
    pytest.importorskip("ruamel.yaml")
    text = ROS_YAML.replace("[0, 0, 0, 0, 0]", "[0.1, 0, 0, 0, 0]")
    with pytest.warns(IntrinsicsWarning, match=r"eye\.yaml: the lens has distortion, which is not rendered"):
        same(load_camera(put(tmp_path / "eye.yaml", text), distortion=False))
    text += "projection_matrix: {rows: 3, cols: 4, data: [50, 0, 30, 0, 0, 51, 20, 0, 0, 0, 1, 0]}\n"
    same(load_camera(put(tmp_path / "eye.yaml", text), distortion=False), wv.Camera(64, 48, 50, 51, 30.5, 20.5))
    assert load_camera(tmp_path / "eye.yaml").lens.coefficients[0] == 0.1


def test_cameras_are_selected_by_name(tmp_path):
    pytest.importorskip("ruamel.yaml")
    path = put(tmp_path / "chain.yaml", KALIBR + KALIBR.replace("cam0", "cam1").replace("64", "32"))
    with pytest.raises(FileFormatError, match=r"chain\.yaml: has the cameras cam0, cam1; choose one as .*:cam0"):
        load_camera(path)
    assert load_camera(f"{path}:cam1").width == 32
    with pytest.raises(FileFormatError, match="has no camera 'cam2'; it has cam0, cam1"):
        load_camera(f"{path}:cam2")


@pytest.mark.parametrize("lens", [{"k1": 0.1}, {"p2": -0.01}])
def test_ignored_distortion_warns(tmp_path, lens):
    with pytest.warns(IntrinsicsWarning, match=r"transforms\.json: the lens has distortion, which is not rendered"):
        same(load_camera(put(tmp_path / "transforms.json", {**NERF, **lens}), distortion=False))


def test_pose_files_provide_their_camera(tmp_path):
    frames = read_frames(put(tmp_path / "transforms.json", nerfstudio() | NERF))
    assert_same_poses(frames)
    same(frames.camera)
    same(frames[2:4].camera)
    each = nerfstudio()
    each["frames"] = [frame | NERF for frame in each["frames"]]
    same(read_frames(put(tmp_path / "each.json", each)).camera)
    assert read_frames(put(tmp_path / "none.json", nerfstudio())).camera is None


def test_blender_files_take_the_size_from_images(tmp_path):
    data = {"camera_angle_x": 2 * math.atan(0.5), "frames": nerfstudio()["frames"]}
    data["frames"] = [frame | {"file_path": "./train/r_0"} for frame in data["frames"]]
    path = put(tmp_path / "transforms_train.json", data)
    with pytest.warns(IntrinsicsWarning, match="json: defines a field of view but not the image size"):
        assert read_frames(path).camera is None
    (tmp_path / "train").mkdir()
    Image.new("L", (64, 48)).save(tmp_path / "train" / "r_0.png")
    same(read_frames(path).camera, wv.Camera(64, 48, 64, 64, 32, 24))


def test_bop_camera(tmp_path):
    images = {key: entry | {"cam_K": INTEGER.ravel().tolist()} for key, entry in bop().items()}
    path = put(tmp_path / "lm" / "test" / "000001" / "scene_camera.json", images)
    assert read_frames(path).camera is None
    whole = {"fx": 9.0, "fy": 9.0, "cx": 9.0, "cy": 9.0, "width": 64, "height": 48}
    put(tmp_path / "lm" / "camera.json", whole)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        same(read_frames(path).camera)
    first = min(int(key) for key in images)
    (path.parent / "rgb").mkdir()
    Image.new("L", (60, 48)).save(path.parent / "rgb" / f"{first:06d}.png")
    assert read_frames(path).camera.width == 60
    last = sorted(images)[-1]
    images[last]["cam_K"][0] += 1
    with pytest.warns(IntrinsicsWarning, match=r"its images have different cameras, such as 60x48 pixels, fx=60"):
        assert read_frames(put(path, images)).camera is None


@pytest.mark.parametrize("make", [colmap_text, colmap_binary])
def test_colmap(make, tmp_path):
    frames = read_frames(make(tmp_path / "0"))
    np.testing.assert_allclose(poses_to_matrices(frames.camera_to_world), MATRICES, atol=1e-12)
    same(frames.camera)
    assert frames.source["format"] == "colmap"


def test_colmap_with_lenses_and_several_cameras(tmp_path):
    two = "7 SIMPLE_RADIAL 64 48 60 31.3 25.1 0.05\n8 PINHOLE 32 24 30 30 16 12"
    with pytest.warns(IntrinsicsWarning, match=r"cameras\.txt:2: the lens has distortion"):
        same(
            read_frames(colmap_text(tmp_path / "a", two), distortion=False).camera,
            wv.Camera(64, 48, 60, 60, 31.3, 25.1),
        )
    with pytest.raises(FileFormatError, match=r"have different cameras, such as .*; choose one as .*cameras\.txt:7"):
        load_camera(tmp_path / "a" / "cameras.txt")
    same(load_camera(f"{tmp_path}/a/cameras.txt:8"), wv.Camera(32, 24, 30, 30, 16, 12))
    with pytest.raises(FileFormatError, match=r"cameras\.txt: has no camera '9'; it has 7, 8"):
        load_camera(f"{tmp_path}/a/cameras.txt:9")
    for text, message in (
        ("7 PINHOLE 64 48 60 58", "parameters of PINHOLE must be 4 numbers, got 2"),
        ("7 PINHOLE wide", "expected CAMERA_ID MODEL WIDTH HEIGHT"),
        ("6 PINHOLE 64 48 60 58 31 25", "cameras.txt: holds no camera of the images"),
    ):
        with pytest.raises(FileFormatError, match=message):
            read_frames(colmap_text(tmp_path / "b", text))


@pytest.mark.parametrize("kind", ["nerfstudio", "text", "binary"])
def test_poses_of_unsupported_lenses_are_read_without_camera(kind, tmp_path):
    make, name, message = {
        "nerfstudio": (
            lambda: put(tmp_path / "transforms.json", nerfstudio() | NERF | {"camera_model": "OPENCV_FISHEYE"}),
            "transforms.json",
            r'transforms\.json: camera_model "OPENCV_FISHEYE" is not a pinhole: the frames have no camera',
        ),
        "text": (
            lambda: colmap_text(tmp_path, "7 FOV 64 48 60 58 31 25 1"),
            "cameras.txt",
            r"cameras\.txt:2: camera model FOV is not a pinhole: the frames have no camera",
        ),
        "binary": (
            lambda: colmap_binary(tmp_path, 5, [60.0] * 8),
            "cameras.bin",
            "camera 7: camera model OPENCV_FISHEYE",
        ),
    }[kind]
    path = make()
    with pytest.warns(IntrinsicsWarning, match=message):
        frames = read_frames(path, distortion=False)
    np.testing.assert_allclose(poses_to_matrices(frames.camera_to_world), MATRICES, atol=1e-12)
    assert frames.camera is None
    with pytest.raises(FileFormatError, match="is not a pinhole"):
        load_camera(tmp_path / name, distortion=False)


def test_bags_provide_their_camera(tmp_path):
    pytest.importorskip("rosbags")
    scene = wv.scenes.PRESETS["room"].build()
    wv.render_batch(scene, CAMERA, ROWS, tmp_path / "set", format="ros2")
    frames = read_frames(tmp_path / "set" / "bag_000000")
    same(frames.camera)
    assert len(frames) == len(ROWS)


def test_camera_must_match_the_camera_of_the_poses(tmp_path):
    scene, frames = wv.scenes.PRESETS["room"].build(), wv.Frames.from_poses(ROWS, camera=CAMERA)
    wv.render_batch(scene, None, frames, tmp_path / "own")
    assert wv.open_dataset(tmp_path / "own").camera == CAMERA
    wv.render_batch(scene, replace(CAMERA, far=5.0), frames, tmp_path / "range")
    assert wv.open_dataset(tmp_path / "range").frames.camera.far == 5.0
    message = r"the pixels of the frames' camera, 64x48 pixels, fx=60 .* got 320x240 pixels.*--replace-camera"
    with pytest.raises(wv.errors.CameraError, match=message):
        wv.render_batch(scene, wv.Camera.kinect(), frames, tmp_path / "other")
    with pytest.raises(wv.errors.CameraError, match="camera must be given because the frames define none"):
        wv.render_batch(scene, None, ROWS, tmp_path / "none")
    with pytest.raises(wv.errors.CameraError, match=r"camera must be a warpvis\.Camera"):
        wv.Frames.from_poses(ROWS, camera="kinect")
    wv.render_batch(scene, CAMERA, MATRICES, tmp_path / "arrays")
    assert len(wv.open_dataset(tmp_path / "arrays")) == len(ROWS)


def test_command_line_uses_the_camera_of_the_poses(tmp_path, monkeypatch, capsys):
    poses = put(tmp_path / "transforms.json", nerfstudio() | NERF)

    def run(out, *options):
        arguments = ["batch", "experiment_1", "--poses", poses, "--out", tmp_path / out, *options]
        monkeypatch.setattr(sys, "argv", ["warpvis", *map(str, arguments)])
        try:
            main()
        except SystemExit as stop:
            return stop.code, capsys.readouterr().err
        return 0, capsys.readouterr().err

    assert run("own")[0] in (0, None)
    same(wv.open_dataset(tmp_path / "own").camera)
    code, said = run("other", "--camera", "kinect")
    assert code == 2 and "the pixels of the frames' camera, 64x48" in said
    assert run("replaced", "--camera", "kinect", "--replace-camera")[0] in (0, None)
    assert wv.open_dataset(tmp_path / "replaced").camera == wv.Camera.kinect()
    code, said = run("useless", "--replace-camera")
    assert code == 2 and "--replace-camera requires a pose file that defines a camera" in said


BAD = {
    "fisheye": (lambda p: put(p / "t.json", NERF | {"camera_model": "OPENCV_FISHEYE"}), "is not a pinhole"),
    "no size": (lambda p: put(p / "t.json", {"fl_x": 60.0, "frames": []}), "but not the image size, w and h .px., and"),
    "no focal length": (lambda p: put(p / "t.json", {"w": 64, "frames": []}), r"defines no focal length: fl_x \[px\]"),
    "words": (lambda p: put(p / "t.json", NERF | {"fl_x": "long"}), r"t\.json: fl_x must be"),
    "negative": (
        lambda p: put(p / "t.json", NERF | {"fl_x": -60.0}),
        "fx of a lens must be a number of pixels above 0, got -60",
    ),
    "half a pixel": (lambda p: put(p / "t.json", NERF | {"w": 64.5}), "width must be a whole number of pixels"),
    "no yaml": (lambda p: put(p / "eye.yaml", "a: [1"), r"eye\.yaml: is not YAML"),
    "a list": (lambda p: put(p / "eye.yaml", "[1, 2]"), "a camera file holds one YAML mapping, got list"),
    "empty yaml": (lambda p: put(p / "eye.yaml", "a: 1"), "holds no camera of ROS"),
    "omni": (lambda p: put(p / "eye.yaml", KALIBR.replace("pinhole", "omni")), 'camera_model "omni" is not a pinhole'),
    "cut off": (lambda p: colmap_binary(p / "m").with_name("cameras.bin"), None),
}


@pytest.mark.parametrize("name", BAD)
def test_invalid_camera_files_raise(name, tmp_path):
    make, message = BAD[name]
    path = make(tmp_path)
    if path.suffix == ".yaml":
        pytest.importorskip("ruamel.yaml")
    if message is None:
        path.write_bytes(path.read_bytes()[:30])
        message = "is truncated, or not a COLMAP file"
    with pytest.raises(wv.WarpvisError, match=message):
        load_camera(path, distortion=False)


def test_mutated_files_are_read_or_raise(tmp_path):
    """Mutations of every kind of file: reading returns a camera or raises one sentence."""
    rng, said = np.random.default_rng(0), 0
    colmap_text(tmp_path), colmap_binary(tmp_path)
    put(tmp_path / "transforms.json", nerfstudio() | NERF)
    put(tmp_path / "eye.yaml", ROS_YAML), put(tmp_path / "chain.yaml", KALIBR)
    names = ["cameras.txt", "cameras.bin", "images.txt", "images.bin", "transforms.json", "eye.yaml", "chain.yaml"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in names:
            whole = (tmp_path / name).read_bytes()
            for _ in range(60):
                data = bytearray(whole if rng.random() < 0.7 else whole[: rng.integers(1, len(whole))])
                for place in rng.integers(0, len(data), rng.integers(1, 4)):
                    data[place] = int(rng.integers(256))
                (tmp_path / name).write_bytes(data)
                try:
                    read_frames(tmp_path / name) if name.startswith("images") else load_camera(tmp_path / name)
                except wv.WarpvisError:
                    said += 1
            (tmp_path / name).write_bytes(whole)
    assert said > 100


@pytest.mark.parametrize("inside", ["", "sparse", "sparse/0"])
@pytest.mark.parametrize("make", [colmap_text, colmap_binary])
def test_folders_of_models_are_read(tmp_path, inside, make):
    (tmp_path / inside).mkdir(parents=True, exist_ok=True)
    file = make(tmp_path / inside)
    frames, there = wv.read_frames(file), wv.read_frames(tmp_path)
    np.testing.assert_array_equal(there.camera_to_world, frames.camera_to_world)
    assert there.camera == frames.camera and there.source["file"] == file.name
    (tmp_path / "transforms.json").write_text("{}")
    with pytest.raises(wv.errors.FileFormatError, match=r"holds .*images\.(txt|bin) and transforms\.json; give one of"):
        wv.read_frames(tmp_path)


@pytest.mark.parametrize("name", ["camera.json", "intrinsics.yaml", "cameras.txt"])
def test_normalized_intrinsics_in_files_raise(name, tmp_path):
    k = [0.8, 0, 0.5, 0, 1.1, 0.5, 0, 0, 1]
    text = {
        "camera.json": json.dumps({"width": 640, "height": 480, "K": np.reshape(k, (3, 3)).tolist()}),
        "intrinsics.yaml": "image_width: 640\nimage_height: 480\ncamera_name: eye\n"
        f"camera_matrix: {{rows: 3, cols: 3, data: {k}}}\ndistortion_model: plumb_bob\n"
        "distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n",
        "cameras.txt": "1 PINHOLE 640 480 0.8 1.1 0.5 0.5\n",
    }[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(wv.errors.WarpvisError, match=rf"{name}.*multiply fx and cx by 640, fy and cy by 480"):
        load_camera(tmp_path / name)


# As written by instant-ngp's colmap2nerf.py for a COLMAP camera of the model OPENCV_FISHEYE.
NGP_FISHEYE = {
    "camera_angle_x": 2 * math.atan(32 / 52), "camera_angle_y": 2 * math.atan(24 / 50), "fl_x": 52.0, "fl_y": 50.0,
    "k1": 0.05, "k2": -0.01, "k3": 0.004, "k4": -0.001, "p1": 0.0, "p2": 0.0, "is_fisheye": True,
    "cx": 31.0, "cy": 25.0, "w": 64.0, "h": 48.0, "aabb_scale": 16,
}  # fmt: skip


def fisheye_pixel(point, of):
    """Project a point by the fisheye model of OpenCV and instant-ngp (``opencv_fisheye_lens_distortion_delta``)."""
    x, y, z = point
    radius = math.hypot(x, y) / z
    angle = math.atan(radius)
    bent = angle * (1 + sum(of[f"k{power}"] * angle ** (2 * power) for power in range(1, 5)))
    return of["fl_x"] * x / z * bent / radius + of["cx"], of["fl_y"] * y / z * bent / radius + of["cy"]


@pytest.mark.parametrize("place", ["file", "frames"])
def test_instant_ngp_fisheye(tmp_path, place):
    data = {"frames": nerfstudio()["frames"]} | NGP_FISHEYE
    if place == "frames":
        lens = {name: data.pop(name) for name in ("k1", "k2", "k3", "k4", "is_fisheye")}
        data["frames"] = [frame | lens for frame in data["frames"]]
    path = put(tmp_path / "transforms.json", data)
    camera = load_camera(path, distortion=True)
    for point in ((0.3, -0.2, 1.0), (-0.9, 0.4, 1.0), (1.5, 1.0, 1.0)):
        np.testing.assert_allclose(camera.project([point])[0], fisheye_pixel(point, NGP_FISHEYE), atol=1e-9)
    assert read_frames(path).camera == camera
    with pytest.raises(FileFormatError, match=r'camera_model "OPENCV_FISHEYE" is not a pinhole'):
        load_camera(path, distortion=False)
    with pytest.warns(IntrinsicsWarning, match="the frames have no camera"):
        assert read_frames(path, distortion=False).camera is None


def test_other_instant_ngp_lenses(tmp_path):
    """The rays of pixels match ``latlong_to_dir`` and ``f_theta_undistortion`` of instant-ngp."""
    panorama = load_camera(put(tmp_path / "transforms.json", NERF | {"latlong": True}), distortion=True)
    theta, phi = (10.5 / 48 - 0.5) * math.pi, (40.5 / 64 - 0.5) * 2 * math.pi
    ray = (math.sin(phi) * math.cos(theta), math.sin(theta), math.cos(phi) * math.cos(theta))
    np.testing.assert_allclose(panorama.project([ray])[0], (40.5, 10.5), atol=1e-9)
    numbers = {"ftheta_p0": 0.0, "ftheta_p1": 0.02, "ftheta_p2": 1e-5, "ftheta_p3": 1e-7, "ftheta_p4": 1e-9}
    bent = load_camera(put(tmp_path / "transforms.json", NERF | numbers), distortion=True)
    x, y = 40.5 - NERF["cx"], 10.5 - NERF["cy"]
    norm = math.hypot(x, y)
    alpha = sum(numbers[f"ftheta_p{power}"] * norm**power for power in range(5))
    ray = (math.sin(alpha) * x / norm, math.sin(alpha) * y / norm, math.cos(alpha))
    np.testing.assert_allclose(bent.project([ray])[0], (40.5, 10.5), atol=1e-6)


def test_nerfstudio_distortion_params(tmp_path):
    """One list of k1 k2 k3 k4 p1 p2, which overrides the single keys."""
    given = {"distortion_params": [0.05, -0.01, 0.004, 0.0, 0.001, -0.002], "k1": 9.0}
    path = put(tmp_path / "transforms.json", NERF | given)
    each = dict(zip(("k1", "k2", "k3", "k4", "p1", "p2"), given["distortion_params"], strict=True))
    assert load_camera(path, distortion=True) == wv.Camera.from_nerfstudio(NERF | each)
    with pytest.warns(IntrinsicsWarning, match="the lens has distortion"):
        same(load_camera(path, distortion=False))


def test_instant_ngp_fields_of_view(tmp_path):
    """As in ``read_focal_length``: x_fov in degrees, then fl_x, then camera_angle_x in radians, and likewise for y."""
    sides = {"w": 64, "h": 48, "frames": nerfstudio()["frames"]}
    for angles, focal in (
        ({"x_fov": 90.0, "fl_x": 7.0}, (32, 32)),
        ({"camera_angle_x": math.pi / 2, "camera_angle_y": 2 * math.atan(0.5)}, (32, 48)),
        ({"y_fov": 90.0}, (24, 24)),
        ({"camera_angle_x": math.pi / 2, "fl_y": 40.0}, (32, 40)),
    ):
        same(load_camera(put(tmp_path / "transforms.json", sides | angles)), wv.Camera(64, 48, *focal, 32, 24))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"is_fisheye": True, "camera_model": "PINHOLE"},
            "camera_model must be OPENCV_FISHEYE or left out with is_fis",
        ),
        ({"is_fisheye": True, "latlong": True}, "must have one model, got keys of OPENCV_FISHEYE and EQUIRECTANGULAR"),
        ({"is_fisheye": "yes"}, "is_fisheye must be True or False, got 'yes'"),
        ({"is_fisheye": True, "p1": 0.1}, "p1 and p2 of camera_model OPENCV_FISHEYE must be 0, got 0.1 and 0"),
        ({"equirectangular": True}, r"camera_model 'equirectangular \(of equal area\)' of nerfstudio is not supported"),
        ({"ftheta_p0": 0.1, "ftheta_p1": 0.01}, "ftheta_p0, the angle at the principal point, must be 0, got 0.1"),
        ({"distortion_params": [0.1, 0.2]}, "distortion_params of nerfstudio must be 6 numbers, got 2"),
        ({"fl_x": None, "camera_angle_x": 60.0}, "camera_angle_x must be between 0 and pi radians, got 60.0"),
        ({"x_fov": 180.0}, "x_fov must be between 0 and 180 degrees, got 180.0"),
    ],
)
def test_invalid_lenses_in_transforms_raise(tmp_path, fields, message):
    path = put(tmp_path / "transforms.json", NERF | fields)
    with pytest.raises(FileFormatError, match=message):
        load_camera(path, distortion=True)


def test_instant_ngp_rolling_shutter_warns(tmp_path):
    path = put(tmp_path / "transforms.json", nerfstudio() | NERF | {"rolling_shutter": [0.0, 0.0, 1.0]})
    with pytest.warns(UserWarning, match="rolling_shutter is not read"):
        read_frames(path)
