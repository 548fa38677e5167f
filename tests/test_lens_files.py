# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lenses in camera files of other systems."""

import math
import warnings

import numpy as np
import pytest
from PIL import Image
from pose_samples import nerfstudio

import warpvis as wv
from warpvis.cameras import LensCamera, lenses
from warpvis.errors import FileFormatError, IntrinsicsWarning
from warpvis.io import load_camera

from support.camera_files import KALIBR, NERF, ROS_YAML, colmap_binary, colmap_text, put

F = (60.0, 58.0, 31.3, 25.1)
K = np.array([[60.0, 0, 30.8], [0, 58, 24.6], [0, 0, 1]])
D = (-0.2, 0.05, 0.001, -0.002, 0.01)
FISHEYE = (0.01, 0.002, -0.003, 0.0004)


def same_lens(camera, lens):
    assert isinstance(camera, LensCamera) and (camera.width, camera.height) == (64, 48)
    pixels = np.random.default_rng(0).uniform((5, 5), (60, 40), (30, 2))
    np.testing.assert_allclose(camera.unproject(pixels), lens.unproject(pixels), atol=1e-9)


def file_of_opencv(path, d, **others):
    """Write a file with OpenCV, and return its path."""
    cv2 = pytest.importorskip("cv2")
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in {"image_width": 64, "image_height": 48, "camera_matrix": K, **others}.items():
        storage.write(name, value)
    storage.write("distortion_coefficients", np.array(d)[:, None])
    storage.release()
    return path


@pytest.mark.smoke("yaml")
@pytest.mark.parametrize("ending", ["yaml", "xml", "json"])
def test_opencv_files(ending, tmp_path):
    pytest.importorskip("ruamel.yaml")
    path = file_of_opencv(tmp_path / f"camera.{ending}", D)
    same_lens(load_camera(path, distortion=True), lenses.OpenCVPinhole(*F, D))
    path = file_of_opencv(tmp_path / f"fisheye.{ending}", FISHEYE, fisheye_model=1)
    same_lens(load_camera(path, distortion=True), lenses.KannalaBrandt(*F, FISHEYE))
    plain = load_camera(file_of_opencv(tmp_path / f"plain.{ending}", (0.0,) * 5), distortion=True)
    assert isinstance(plain, wv.Camera)
    np.testing.assert_allclose(plain.to_K(pixel_center=0.0), K)


@pytest.mark.parametrize("ending", ["yaml", "xml", "json"])
def test_opencv_files_without_distortion(ending, tmp_path):
    pytest.importorskip("ruamel.yaml")
    path = file_of_opencv(tmp_path / f"camera.{ending}", D)
    with pytest.warns(IntrinsicsWarning, match=rf"camera\.{ending}: the lens has distortion, which is not rendered"):
        camera = load_camera(path, distortion=False)
    assert isinstance(camera, wv.Camera) and (camera.width, camera.height) == (64, 48)
    np.testing.assert_allclose(camera.to_K(pixel_center=0.0), K)
    path = file_of_opencv(tmp_path / f"fisheye.{ending}", FISHEYE, fisheye_model=1)
    with pytest.raises(FileFormatError, match=rf"fisheye\.{ending}: the lens KannalaBrandt is not a pinhole"):
        load_camera(path, distortion=False)


def test_ros_json_without_distortion_is_a_pinhole(tmp_path):
    lens = {"distortion_model": "plumb_bob", "distortion_coefficients": list(D)}
    path = put(tmp_path / "eye.json", SIZE | {"camera_matrix": MATRIX} | lens)
    same_lens(load_camera(path, distortion=True), lenses.OpenCVPinhole(*F, D))
    with pytest.warns(IntrinsicsWarning, match="the lens has distortion, which is not rendered"):
        assert isinstance(load_camera(path, distortion=False), wv.Camera)


@pytest.mark.parametrize("ending", ["yml", "xml", "json"])
def test_opencv_stereo_files(ending, tmp_path):
    """As `stereo_calib.cpp` writes them: M1, D1, M2 and D2, without the image size."""
    cv2 = pytest.importorskip("cv2")
    pytest.importorskip("ruamel.yaml")
    path = tmp_path / f"intrinsics.{ending}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in {"M1": K, "D1": np.array([D]), "M2": K + np.diag([9.0, 9, 0]), "D2": np.array([D])}.items():
        storage.write(name, value)
    storage.release()
    with pytest.raises(FileFormatError, match=r"must have image_width and image_height \[px\], or .*, got none"):
        load_camera(f"{path}:M1", distortion=True)
    for name in ("left01.jpg", "right01.jpg"):
        Image.new("L", (64, 48)).save(tmp_path / name)
    same_lens(load_camera(f"{path}:M1", distortion=True), lenses.OpenCVPinhole(*F, D))
    same_lens(load_camera(f"{path}:M2", distortion=True), lenses.OpenCVPinhole(69, 67, *F[2:], D))
    with pytest.warns(IntrinsicsWarning, match="the lens has distortion, which is not rendered"):
        assert load_camera(f"{path}:M2", distortion=False).fx == 69
    with pytest.raises(FileFormatError, match=r"has the cameras M1, M2; choose one as .*:M1"):
        load_camera(path, distortion=True)
    with pytest.raises(FileFormatError, match="has no camera 'cam0'; it has M1, M2"):
        load_camera(f"{path}:cam0", distortion=True)
    Image.new("L", (32, 24)).save(tmp_path / "left02.png")
    with pytest.raises(FileFormatError, match="one size next to it, got several: 32x24, 64x48 pixels"):
        load_camera(f"{path}:M1", distortion=True)


@pytest.mark.slow
def test_ros_calibrations_describe_raw_image(tmp_path):
    """`P` describes the rectified image and is ignored."""
    pytest.importorskip("ruamel.yaml")
    text = ROS_YAML.replace("[0, 0, 0, 0, 0]", str(list(D)))
    same_lens(load_camera(put(tmp_path / "eye.yaml", text), distortion=True), lenses.OpenCVPinhole(*F, D))
    text += "projection_matrix: {rows: 3, cols: 4, data: [50, 0, 30, 0, 0, 51, 20, 0, 0, 0, 1, 0]}\n"
    same_lens(load_camera(put(tmp_path / "eye.yaml", text), distortion=True), lenses.OpenCVPinhole(*F, D))
    text = ROS_YAML.replace("[0, 0, 0, 0, 0]", str(list(FISHEYE))).replace("plumb_bob", "equidistant")
    same_lens(load_camera(put(tmp_path / "fish.yaml", text), distortion=True), lenses.KannalaBrandt(*F, FISHEYE))


def test_kalibr_camera_chains(tmp_path):
    pytest.importorskip("ruamel.yaml")
    radtan = KALIBR.replace("[0.0, 0.0, 0.0, 0.0]", str(list(D[:4])))
    fish = KALIBR.replace("cam0", "cam1").replace("radtan", "equidistant")
    path = put(tmp_path / "chain.yaml", radtan + fish.replace("[0.0, 0.0, 0.0, 0.0]", str(list(FISHEYE))))
    same_lens(load_camera(f"{path}:cam0", distortion=True), lenses.OpenCVPinhole(*F, D[:4]))
    same_lens(load_camera(f"{path}:cam1", distortion=True), lenses.KannalaBrandt(*F, FISHEYE))


def test_colmap_camera_models(tmp_path):
    numbers = " ".join(map(str, (*F, *FISHEYE)))
    colmap_text(tmp_path, f"7 OPENCV_FISHEYE 64 48 {numbers}\n8 OPENCV_FISHEYE 64 48 {numbers}")
    same_lens(load_camera(tmp_path / "cameras.txt", distortion=True), lenses.KannalaBrandt(*F, FISHEYE))
    colmap_binary(tmp_path, 5, (*F, *FISHEYE))
    same_lens(load_camera(tmp_path / "cameras.bin", distortion=True), lenses.KannalaBrandt(*F, FISHEYE))
    colmap_binary(tmp_path, 7, (*F, 0.9))
    same_lens(load_camera(tmp_path / "cameras.bin", distortion=True), lenses.FOV(*F, 0.9))
    colmap_text(tmp_path, "7 FOV 64 48 60 58 31.3 25.1 0.9\n8 FOV 64 48 60 58 31.3 25.1 0.8")
    with pytest.raises(FileFormatError, match=r"have different cameras, such as 64x48 pixels, FOV.*; choose one as"):
        load_camera(tmp_path / "cameras.txt", distortion=True)
    same_lens(load_camera(f"{tmp_path}/cameras.txt:8"), lenses.FOV(*F, 0.8))


def test_nerfstudio_transforms(tmp_path):
    lens = {"k1": D[0], "k2": D[1], "p1": D[2], "p2": D[3]}
    path = put(tmp_path / "transforms.json", nerfstudio() | NERF | lens)
    same_lens(load_camera(path, distortion=True), lenses.OpenCVPinhole(*F, D[:4]))
    each = nerfstudio()
    each["frames"] = [frame | NERF | lens for frame in each["frames"]]
    same_lens(load_camera(put(path, each), distortion=True), lenses.OpenCVPinhole(*F, D[:4]))
    fish = dict(zip(("k1", "k2", "k3", "k4"), FISHEYE, strict=True)) | {"camera_model": "OPENCV_FISHEYE"}
    same_lens(load_camera(put(path, nerfstudio() | NERF | fish), distortion=True), lenses.KannalaBrandt(*F, FISHEYE))
    angle = {"camera_angle_x": 2 * math.atan(32 / 60), "w": 64, "h": 48, "is_fisheye": True, "k1": 0.1, "k4": 0.001}
    lens = lenses.KannalaBrandt(60, 60, 32, 24, (0.1, 0, 0, 0.001))
    same_lens(load_camera(put(path, {"frames": nerfstudio()["frames"]} | angle), distortion=True), lens)
    each["frames"][-1]["fl_x"] = 61.0
    each["frames"] = [frame | {"file_path": f"./images/{n}.png"} for n, frame in enumerate(each["frames"])]
    put(path, each)
    message = r"different cameras, such as .*fx=60.* and .*fx=61.*; choose one as .*transforms\.json:\./images/0\.png"
    with pytest.raises(FileFormatError, match=message):
        load_camera(path)
    for name in ("./images/0.png", "images/0.png", "0.png", "0"):
        assert load_camera(f"{path}:{name}").lens.fx == 60
    assert load_camera(f"{path}:images/{len(each['frames']) - 1}.png").lens.fx == 61
    with pytest.raises(
        FileFormatError, match=r"has no frame with the file_path 'x\.png'; the first of .* is './images/0"
    ):
        load_camera(f"{path}:x.png")
    with pytest.warns(IntrinsicsWarning, match="different cameras"):
        assert wv.read_frames(path, distortion=True).camera is None
    assert load_camera("kinect", distortion=True) == wv.Camera.kinect()


XML = "<opencv_storage><image_width>64</image_width><image_height>48</image_height>{}</opencv_storage>"
MATRIX = {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d", "data": K.ravel().tolist()}
SIZE = {"image_width": 64, "image_height": 48}
BAD = {
    "json's size": ("a.json", {"camera_matrix": MATRIX, "image_width": 64}, r"OpenCV: image_height \[px\] is missing"),
    "json's stereo": ("a.json", SIZE | {"M1": MATRIX}, r"a\.json: has M1 without its distortion coefficients, D1"),
    "stereo's size": ("a.json", {"M2": MATRIX, "D2": [0] * 5, "image_width": 64}, r"image_height \[px\] is missing"),
    "json's matrix": ("a.json", SIZE | {"camera_matrix": MATRIX | {"data": [1]}}, "camera matrix must be"),
    "json's other": ("a.json", SIZE | {"R": MATRIX}, r"a\.json: holds no camera of ROS or OpenCV: camera_matrix is"),
    "json's lens": (
        "a.json",
        SIZE | {"camera_matrix": MATRIX, "distortion_coefficients": [0.1]},
        r"a\.json: D of OpenCV's pinhole must be 4, 5, 8, 12 or 14 numbers, got 1",
    ),
    "no XML": ("a.xml", "<a", r"a\.xml: is not XML"),
    "empty": ("a.xml", "<a/>", r"holds no camera of ROS or OpenCV \(image_width, .*Kalibr"),
    "matrix": ("a.xml", XML.format("<camera_matrix><data>1 2</data></camera_matrix>"), "camera matrix must be"),
    "count": (
        "a.yaml",
        ROS_YAML.replace("[0, 0, 0, 0, 0]", "[0.1, 0, 0]"),
        "D of plumb_bob must be 4 or 5 numbers, got 3",
    ),
    "model": ("a.yaml", ROS_YAML.replace("plumb_bob", "omni"), "distortion_model must be one of plumb_bob"),
    "kalibr": ("a.yaml", KALIBR.replace("radtan", "x").replace("[0.0,", "[0.1,"), "cam0: distortion_model must be one"),
    "nan": ("a.yaml", ROS_YAML.replace("[0, 0, 0, 0, 0]", "[.nan, 0, 0, 0]"), "D of CameraInfo must be finite"),
    "colmap": (
        "cameras.txt",
        "1 OPENCV 64 48 60 58 31 25",
        r"cameras\.txt:1: parameters of OPENCV must be 8 numbers, got 4",
    ),
    "colmap's name": (
        "cameras.txt",
        "1 PANINI 64 48 60 58 31 25",
        r"txt:1: COLMAP has no camera model PANINI",
    ),
    "nerfstudio": ("t.json", NERF | {"k1": "long"}, "k1 must be a number"),
}


@pytest.mark.parametrize("name", BAD)
def test_malformed_files_are_rejected(name, tmp_path):
    file, content, message = BAD[name]
    if file.endswith("yaml"):
        pytest.importorskip("ruamel.yaml")
    with pytest.raises(FileFormatError, match=message):
        load_camera(put(tmp_path / file, content), distortion=True)


def test_mutated_files_are_read_or_rejected(tmp_path):
    """Mutated files yield a camera or raise WarpvisError."""
    pytest.importorskip("ruamel.yaml")
    rng, said = np.random.default_rng(0), 0
    colmap_text(tmp_path, f"7 FOV 64 48 {' '.join(map(str, F))} 0.9")
    colmap_binary(tmp_path, 7, (*F, 0.9))
    put(tmp_path / "transforms.json", NERF | {"k1": 0.1})
    put(tmp_path / "eye.json", SIZE | {"camera_matrix": MATRIX})
    put(tmp_path / "pair.json", SIZE | {"M1": MATRIX, "D1": [0.1] * 5})
    put(tmp_path / "eye.yaml", ROS_YAML), put(tmp_path / "chain.yaml", KALIBR)
    put(tmp_path / "eye.xml", XML.format("<camera_matrix><data>60 0 31 0 58 25 0 0 1</data></camera_matrix>"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in (
            "cameras.txt",
            "cameras.bin",
            "transforms.json",
            "eye.yaml",
            "chain.yaml",
            "eye.xml",
            "eye.json",
            "pair.json",
        ):
            whole = (tmp_path / name).read_bytes()
            for _ in range(40):
                data = bytearray(whole if rng.random() < 0.7 else whole[: rng.integers(1, len(whole))])
                for place in rng.integers(0, len(data), rng.integers(1, 4)):
                    data[place] = int(rng.integers(256))
                (tmp_path / name).write_bytes(data)
                try:
                    load_camera(tmp_path / name, distortion=True)
                except wv.WarpvisError:
                    said += 1
    assert said > 80
