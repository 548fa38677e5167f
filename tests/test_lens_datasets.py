# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Datasets of cameras with lenses: each format stores the lens, and reading returns the same camera and points."""

import json
import sys
from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar

import numpy as np
import pytest
from PIL import Image

import warpvis as wv
from warpvis.cameras import LensCamera, lenses
from warpvis.cli import main
from warpvis.errors import CameraError, FileFormatError, IntrinsicsWarning
from warpvis.io import load_camera

from support.lens_camera import FISHEYE, PLUMB_BOB, RATIONAL, SMALL, STRAIGHT, WIDE
from support.recorded_warnings import recorded_warnings

TILTED = (*RATIONAL, 0.001, 0, 0, 0, 0.01, 0.02)
CAMERAS = {
    "five": LensCamera(SMALL, 64, 48, near=0.1, far=9.0),
    "four": LensCamera(lenses.OpenCVPinhole(52, 50, 32, 24, PLUMB_BOB[:4]), 64, 48),
    "rational": LensCamera(lenses.OpenCVPinhole(52, 50, 32, 24, RATIONAL), 64, 48),
    "tilted": LensCamera(lenses.OpenCVPinhole(52, 50, 32, 24, TILTED), 64, 48),
    "fisheye": LensCamera(lenses.KannalaBrandt(52, 50, 32, 24, FISHEYE), 64, 48),
    "eucm": LensCamera(lenses.EUCM(40, 41, 32, 24, 0.6, 1.1), 64, 48),
    "sphere": LensCamera(lenses.DoubleSphere(40, 41, 32, 24, -0.1, 0.3), 64, 48),
    "wide": LensCamera(WIDE, 64, 48),
    "ftheta": LensCamera(lenses.FTheta(32, 24, (0.02, 1e-5)), 64, 48, kind="z"),
}
ANY = {"five", "tilted", "wide", "ftheta"}  # a sample, for formats that support any lens
HOLD = {
    "png": ANY,
    "npz": ANY,
    "zarr": ANY,
    "tum": {"five", "four"},
    "nerfstudio": {"five", "four", "fisheye"},
    "colmap": {"five", "four", "rational", "fisheye", "eucm"},
    "ros2": {"five", "four", "rational", "tilted", "fisheye"},
    "bop": set(),
}
WHY = {
    "tum": "format 'tum' does not support the lens: lens must be OpenCVPinhole with at most 5 coefficients to",
    "nerfstudio": "format 'nerfstudio' does not support the lens: nerfstudio has no camera_model for",
    "colmap": "format 'colmap' does not support the lens: COLMAP has no camera model for",
    "ros2": "format 'ros2' does not support the lens: ROS has no distortion_model for",
    "bop": "camera must be a pinhole camera for format 'bop', which has no distortion",
}
FILES = {
    "png": "camera.json",
    "tum": "calibration.txt",
    "nerfstudio": "transforms.json",
    "colmap": "sparse/cameras.txt",
}
POSES = np.stack([wv.look_at(eye, (0.5, 0.4, 0.3)) for eye in ((-1.6, -1.3, 1.6), (0.1, 0.2, 0.9))])
K = np.array([[52.0, 0, 32], [0, 50, 24], [0, 0, 1]])


@pytest.fixture(scope="module")
def room():
    return wv.scenes.PRESETS["room"].build()


@cache
def depth_of(room, camera):
    return wv.render(room, camera, POSES, outputs="depth").depth.numpy()


def write(room, camera, out, kind, **options):
    pytest.importorskip({"ros2": "rosbags"}.get(kind, "zarr" if kind == "zarr" else "numpy"))
    wv.render_batch(room, camera, POSES, out, format=kind, **options)
    return wv.open_dataset(out)


@pytest.mark.smoke("png")
@pytest.mark.parametrize("kind", HOLD)
def test_datasets_round_trip_camera(kind, room, tmp_path):
    for name, camera in CAMERAS.items():
        out = tmp_path / name
        if (HOLD[kind] is ANY and name not in ANY) or (name == "four" and kind != "tum"):
            continue
        if name not in HOLD[kind]:
            why = (
                WHY[kind]
                if camera.kind == "z" or kind == "bop"
                else 'kind of the camera must be "z" for format .*, got "range", depth along the ray'
            )
            with pytest.raises(FileFormatError, match=f"{why}.*npz, zarr and png support all lenses") as error:
                write(room, camera, out, kind)
            assert "\n" not in str(error.value) and not out.exists()
            continue
        dataset = write(room, camera, out, kind)
        assert dataset.camera == camera, name
        depth = depth_of(room, camera)
        seen = np.isfinite(depth) & np.isfinite(dataset["depth"][:])
        assert seen.mean() > 0.9 * np.isfinite(depth).mean() > 0.1
        np.testing.assert_allclose(dataset["depth"][:][seen], depth[seen], atol=6e-4)
        back = []
        if kind in FILES:
            back = [load_camera(str(out / FILES[kind]), distortion=True)]
        if kind in ("nerfstudio", "colmap", "ros2"):
            file = {"nerfstudio": "transforms.json", "colmap": "sparse/images.txt", "ros2": "bag_000000"}[kind]
            back.append(wv.read_frames(out / file, distortion=True).camera)
        for found in back:
            assert replace(found, near=camera.near, far=camera.far) == camera, name


@dataclass(frozen=True)
class Stereographic(lenses.Lens):
    """A user-defined lens."""

    scale: float
    center: tuple[float, float] = (32.0, 24.0)
    max_angle: ClassVar[float] = 3.0
    turns_back: ClassVar[bool] = False

    def _project(self, points):
        radius = np.linalg.norm(points, axis=1) + points[:, 2]
        return self.scale * points[:, :2] / radius[:, None] + self.center

    def _unproject(self, pixels):
        x, y = ((pixels - self.center) / self.scale).T
        return np.stack([2 * x, 2 * y, 1 - x * x - y * y], axis=1) / (1 + x * x + y * y)[:, None]


@pytest.mark.parametrize("kind", ["npz", "zarr", "png"])
def test_user_defined_lenses_round_trip(kind, room, tmp_path):
    if kind == "zarr":
        pytest.importorskip("zarr")
    camera = LensCamera(Stereographic(np.float32(60)), 64, 48, near=0.1)
    wv.render_batch(room, camera, POSES, tmp_path / "out", format=kind)
    assert wv.batch.verify(tmp_path / "out").ok
    dataset = wv.open_dataset(tmp_path / "out")
    assert dataset.camera == camera and isinstance(dataset.camera.lens.center, tuple)
    np.testing.assert_allclose(dataset[0]["depth"], wv.render(room, camera, POSES).depth.numpy()[0], atol=1e-3)
    if kind == "png":
        assert load_camera(tmp_path / "out" / "camera.json", distortion=True) == camera
    manifest = tmp_path / "out" / "manifest.json"
    assert f'"{__name__}:Stereographic"' in manifest.read_text()
    manifest.write_text(manifest.read_text().replace(f"{__name__}:", "optics.bent:"))
    with pytest.raises(FileFormatError, match=r"class Stereographic of the lens is not part of warpvis. Import optics"):
        wv.open_dataset(tmp_path / "out")
    assert "optics" not in sys.modules


def test_lenses_are_identified_by_module_and_name(room, tmp_path):
    own = type("OpenCVPinhole", (Stereographic,), {"__module__": __name__})
    wv.render_batch(room, LensCamera(own(60.0), 64, 48), POSES, tmp_path)
    assert type(wv.open_dataset(tmp_path).camera.lens) is own


class Unkept(lenses.Lens):
    """A lens that is not a dataclass."""

    max_angle, turns_back = 3.0, False
    _project, _unproject = Stereographic._project, Stereographic._unproject
    scale, center = 60.0, (32.0, 24.0)


@pytest.mark.parametrize(
    ("lens", "message"),
    [
        (Unkept(), r"lens must be a dataclass to be written to a file, got .*:Unkept"),
        (
            Stereographic(60.0, np.array([32.0, 24])),
            r"center of lens .*:Stereographic must be a number, a string or a tu",
        ),
    ],
)
def test_unserializable_lenses_are_rejected_before_rendering(room, tmp_path, lens, message):
    with pytest.raises(CameraError, match=message):
        wv.render_batch(room, LensCamera(lens, 64, 48), POSES, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("kind", ["npz", "png", "colmap"])
def test_back_projected_dataset_matches_rendered_points(kind, room, tmp_path):
    """Back-projection through the dataset's camera; a pinhole of the same intrinsics is off by centimeters."""
    camera = CAMERAS["five"]
    dataset = write(room, camera, tmp_path / "set", kind)
    depth = np.where(np.isfinite(dataset["depth"][:]), dataset["depth"][:], np.nan).astype(np.float32)
    expected = wv.render(room, camera, POSES, outputs="points").points.numpy()
    points = wv.back_project(depth, dataset.camera, POSES).numpy()
    seen = np.isfinite(points[..., 0])
    np.testing.assert_allclose(points[seen], expected[seen], atol=2e-3 if kind == "png" else 1e-5)
    pinhole = wv.back_project(depth, wv.Camera(64, 48, 52, 50, 32, 24), POSES).numpy()
    assert np.nanmax(np.abs(pinhole - expected)) > 0.05


def test_frames_contain_opencv_parameters_of_opencv_lenses(room, tmp_path):
    dataset = write(room, CAMERAS["rational"], tmp_path / "set", "npz")
    np.testing.assert_array_equal(dataset[0]["K"], K)
    np.testing.assert_array_equal(dataset[0]["distortion"], RATIONAL)
    assert dataset[0:2]["distortion"].shape == dataset["distortion"].shape == (2, 8)
    fisheye = write(room, CAMERAS["fisheye"], tmp_path / "fisheye", "npz")
    assert not {"K", "distortion"} & set(fisheye[0]) and not {"K", "distortion"} & set(fisheye[0:2])
    with pytest.raises(
        wv.errors.ArrayError, match="there is no array 'K'; there are depth, camera_to_world, timestamp"
    ):
        fisheye["K"]
    pinhole = write(room, wv.Camera(64, 48, 52, 50, 32, 24), tmp_path / "pinhole", "npz")
    np.testing.assert_array_equal(pinhole[0]["distortion"], np.zeros(5))


def test_shards_contain_the_camera(room, tmp_path):
    for name in ("five", "wide"):
        write(room, CAMERAS[name], tmp_path / name, "npz")
        with np.load(tmp_path / name / "shard-000000.npz") as arrays:
            (tmp_path / f"{name}.json").write_text(str(arrays["camera"]))
            assert ("K" in arrays) == (name == "five") == ("distortion" in arrays)
        assert load_camera(str(tmp_path / f"{name}.json"), distortion=True) == CAMERAS[name]
    meaning = json.loads((write_png(room, tmp_path / "range") / "images.json").read_text())
    assert meaning["depth"]["kind"] == "range"


def write_png(room, out):
    write(room, CAMERAS["wide"], out, "png")
    return out


def test_zarr_attributes_contain_the_camera(room, tmp_path):
    zarr = pytest.importorskip("zarr")
    write(room, CAMERAS["five"], tmp_path / "five", "zarr")
    said = zarr.open_group(tmp_path / "five" / "data.zarr", mode="r").attrs
    np.testing.assert_array_equal(said["K"], K)
    assert tuple(said["distortion"]) == PLUMB_BOB and said["camera"]["lens"]["model"] == "OpenCVPinhole"
    write(room, CAMERAS["wide"], tmp_path / "wide", "zarr")
    said = zarr.open_group(tmp_path / "wide" / "data.zarr", mode="r").attrs
    assert "K" not in said and said["depth"].startswith("range, along the ray")


def test_pycolmap_projects_like_written_camera(room, tmp_path):
    pycolmap = pytest.importorskip("pycolmap")
    for name in ("rational", "fisheye", "eucm"):
        camera = CAMERAS[name]
        write(room, camera, tmp_path / name, "colmap")
        model = pycolmap.Reconstruction(str(tmp_path / name / "sparse"))
        (theirs,) = model.cameras.values()
        points = np.random.default_rng(0).uniform((-0.4, -0.4, 1), (0.4, 0.4, 2), (50, 3))
        expected = camera.project(points)
        np.testing.assert_allclose(np.array([theirs.img_from_cam(p) for p in points]), expected, atol=1e-6)


def test_opencv_projects_like_written_camera_info(room, tmp_path):
    """OpenCV's pixel centers are at integers, so cv2 returns coordinates smaller by half a pixel."""
    cv2 = pytest.importorskip("cv2")
    pytest.importorskip("rosbags")
    from rosbags.typesys import Stores, get_typestore

    points = np.random.default_rng(0).uniform((-0.4, -0.4, 1), (0.4, 0.4, 2), (50, 3))
    zero, types = np.zeros(3), get_typestore(Stores.ROS2_JAZZY)
    for name, model, count in (("four", "plumb_bob", 5), ("rational", "rational_polynomial", 8), ("tilted", "", 14)):
        info = CAMERAS[name].to_camera_info(frame_id="eye", types=types)
        assert len(info.d) == count and (info.distortion_model == model or not model)
        at = cv2.projectPoints(points, zero, zero, info.k.reshape(3, 3), info.d)[0][:, 0]
        np.testing.assert_allclose(at + 0.5, CAMERAS[name].project(points), atol=1e-9)
        np.testing.assert_array_equal(info.p.reshape(3, 4)[:, :3], info.k.reshape(3, 3))
        assert wv.Camera.from_raw_camera_info(info) == CAMERAS[name].__class__(CAMERAS[name].lens, 64, 48)
    info = CAMERAS["fisheye"].to_camera_info(frame_id="eye", types=types)
    assert info.distortion_model == "equidistant"
    at = cv2.fisheye.projectPoints(points[:, None], zero, zero, info.k.reshape(3, 3), info.d)[0][:, 0]
    np.testing.assert_allclose(at + 0.5, CAMERAS["fisheye"].project(points), atol=1e-9)
    with pytest.raises(CameraError, match="ROS has no distortion_model for EUCM"):
        CAMERAS["eucm"].to_camera_info(frame_id="eye", types=types)


def test_bag_point_clouds_match_lens_rays(room, tmp_path):
    pytest.importorskip("rosbags")
    from rosbags.highlevel import AnyReader

    write(room, CAMERAS["five"], tmp_path / "set", "ros2", outputs=("depth", "points"))
    with AnyReader([tmp_path / "set" / "bag_000000"]) as reader:
        topics = {connection.topic for connection in reader.connections}
        assert "/camera/depth/image_raw" in topics and "/camera/depth/image_rect" not in topics
        clouds = [c for c in reader.connections if c.topic.endswith("/points")]
        message = next(reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(connections=clouds))
    cloud = message.data.view(np.float32).reshape(48, 64, 3)
    depth = wv.render(room, CAMERAS["five"], POSES[0], outputs="depth").depth.numpy()[0]
    expected = np.where(np.isfinite(depth)[..., None], depth[..., None] * CAMERAS["five"].rays, np.nan)
    np.testing.assert_allclose(cloud, expected, atol=1e-6)


def test_visibility_and_resumed_jobs(room, tmp_path):
    camera = CAMERAS["five"]
    dataset = write(room, camera, tmp_path / "a", "npz", outputs=("depth", "visibility"), shard_frames=1)
    seen = wv.object_visibility(room, camera, POSES)
    np.testing.assert_array_equal(dataset["visible_fraction"][:], seen.fraction.numpy())
    for file in (*(tmp_path / "a").glob("shard-000001*"), *(tmp_path / "a").rglob("000001.json")):
        file.unlink()
    wv.render_batch(room, camera, POSES, tmp_path / "a", outputs=("depth", "visibility"), shard_frames=1, resume=True)
    assert wv.batch.verify(tmp_path / "a").ok
    with pytest.raises(FileFormatError, match="started with other input: camera's lens's fx was 52"):
        bent = replace(camera, lens=replace(camera.lens, fx=53))
        wv.render_batch(room, bent, POSES, tmp_path / "a", outputs=("depth", "visibility"), shard_frames=1, resume=True)


def test_frames_choose_camera_with_lens():
    camera = CAMERAS["five"]
    frames = wv.Frames.from_poses(POSES, camera=camera)
    same = LensCamera(lenses.OpenCVPinhole(52, 50, 32, 24, (*PLUMB_BOB, 0, 0, 0)), 64, 48, far=5.0)
    assert frames.choose_camera() is camera and frames[:1].choose_camera(same) is same
    other = r"the pixels of the frames' camera, 64x48 pixels, OpenCVPinhole\(.*, got 64x48 pixels, "
    for given in (wv.Camera(64, 48, 52, 50, 32, 24), CAMERAS["four"], replace(camera, kind="range")):
        with pytest.raises(CameraError, match=other):
            frames.choose_camera(given)


def test_calibration_text_takes_size_from_adjacent_image(tmp_path):
    file = tmp_path / "calibration.txt"
    file.write_text("# fx fy cx cy\n52 50 31.5 23.5 -0.3 0.1 0.001 -0.002 0.01\n")
    with pytest.raises(FileFormatError, match="does not define the image size, and there is no image next to it"):
        load_camera(str(file), distortion=True)
    (tmp_path / "depth.txt").write_text("# timestamp filename\n0.0 a.png\n")
    Image.new("L", (64, 48)).save(tmp_path / "a.png")
    assert load_camera(str(file), distortion=True) == LensCamera(SMALL, 64, 48)
    with pytest.warns(IntrinsicsWarning, match="the lens has distortion, which is not rendered"):
        assert load_camera(str(file), distortion=False) == wv.Camera(64, 48, 52, 50, 32, 24)
    file.write_text("52 50 31.5 23.5")
    assert load_camera(str(file)) == load_camera(str(file), distortion=True) == wv.Camera(64, 48, 52, 50, 32, 24)
    for text, message in (
        ("52 50", "calibration.txt:1: expected fx fy cx cy, or those and k1 k2 p1 p2 k3, got '52 50'"),
        ("# nothing", "expected fx fy cx cy, or those and k1 k2 p1 p2 k3, and holds no numbers"),
        ("wide 50 31 23", "calibration.txt:1: expected fx fy"),
        ("-52 50 31.5 23.5", "focal lengths must be positive|fx of a lens must be a number of pixels above 0"),
    ):
        file.write_text(text)
        for distortion in (False, True):
            with pytest.raises(FileFormatError, match=message):
                load_camera(str(file), distortion=distortion)


LENS = {"model": "OpenCVPinhole", "fx": 52, "fy": 50, "cx": 32, "cy": 24, "coefficients": [-0.3, 0.1, 0, 0]}
BAD = {
    "model": (
        {"lens": LENS | {"model": "Fish"}},
        "model of a lens must be one of Cylindrical, Division, .*, got 'Fish'",
    ),
    "listed model": ({"lens": LENS | {"model": [1]}}, r"model of a lens must be one of .*, got \[1\]"),
    "no model": ({"lens": {}}, "model of a lens must be one of"),
    "missing": ({"lens": {"model": "EUCM", "fx": 3}}, "EUCM needs the parameters fx, fy, cx, cy, alpha, beta, got fx"),
    "more": (
        {"lens": LENS | {"k9": 1}},
        "unknown k9 of a lens; the fields of OpenCVPinhole are fx, fy, cx, cy, coefficients",
    ),
    "words": ({"lens": LENS | {"fx": "long"}}, "fx of a lens must be a number of pixels above 0, got 'long'"),
    "count": (
        {"lens": LENS | {"coefficients": [1]}},
        "coefficients of OpenCVPinhole must be 4, 5, 8, 12 or 14 numbers, got 1",
    ),
    "list": ({"lens": [1]}, "lens must be a mapping|lens must be"),
    "size": ({"lens": LENS, "width": 64.5}, "width must be a whole number"),
    "unknown": (
        {"lens": LENS, "K": 1},
        "unknown K; the fields of a camera with a lens are lens, width, height, near, far, kind",
    ),
    "kind": ({"lens": LENS, "kind": "ray"}, 'kind must be "z" or "range"'),
}


@pytest.mark.parametrize("name", BAD)
def test_malformed_camera_files_are_rejected(name, tmp_path):
    fields, message = BAD[name]
    (tmp_path / "eye.json").write_text(json.dumps({"width": 64, "height": 48} | fields))
    with pytest.raises(CameraError, match=rf"eye\.json: .*({message})"):
        load_camera(str(tmp_path / "eye.json"), distortion=True)
    with pytest.raises(wv.WarpvisError, match=r"eye\.json: the camera has a lens, so it is not a pinhole"):
        load_camera(str(tmp_path / "eye.json"), distortion=False)


def run(monkeypatch, capsys, *arguments):
    monkeypatch.setattr(sys, "argv", ["warpvis", *map(str, arguments)])
    with recorded_warnings() as told:
        try:
            main()
            code = 0
        except SystemExit as stop:
            code = stop.code or 0
    output = capsys.readouterr()
    return code, output.out, output.err + " ".join(str(one.message) for one in told)


@pytest.mark.slow
def test_command_line_renders_lens_cameras(room, tmp_path, monkeypatch, capsys):
    (tmp_path / "eye.json").write_text(json.dumps({"width": 64, "height": 48, "lens": LENS}))
    given = ("experiment_1", "--frame", "--camera", tmp_path / "eye.json", "--quiet")
    code, _, said = run(monkeypatch, capsys, "render", *given, "--out", tmp_path / "a", "--format", "npz,colmap")
    assert code == 0 and "distortion" not in said, said
    camera = load_camera(str(tmp_path / "eye.json"), distortion=True)
    assert wv.open_dataset(tmp_path / "a" / "npz").camera == camera
    assert (tmp_path / "a" / "preview" / "000000.png").is_file()
    code, _, said = run(monkeypatch, capsys, "render", *given, "--out", tmp_path / "b", "--format", "bop")
    assert code == 2 and "camera must be a pinhole camera for format 'bop'" in said and not (tmp_path / "b").exists()
    again = ("batch", "experiment_1", "--poses", tmp_path / "a" / "colmap" / "sparse" / "images.txt", "--quiet")
    code, _, said = run(monkeypatch, capsys, *again, "--out", tmp_path / "c")
    assert code == 0 and wv.open_dataset(tmp_path / "c").camera == camera and "distortion" not in said
    code, _, said = run(monkeypatch, capsys, *again, "--no-distortion", "--out", tmp_path / "d")
    assert code == 0 and "the lens has distortion, which is not rendered" in said
    assert wv.open_dataset(tmp_path / "d").camera == wv.Camera(64, 48, 52, 50, 32, 24)
    code, said, _ = run(monkeypatch, capsys, "check", *given[:-1], "--picture", tmp_path / "check.png")
    assert code == 0 and "visible" in said and (tmp_path / "check.png").stat().st_size > 5000


@pytest.mark.slow
def test_perspective_pictures_support_lenses(tmp_path):
    scene = wv.scenes.PRESETS["room"].build()
    agents = [
        wv.Agent("robot", CAMERAS["five"], POSES[0], attention=CAMERAS["fisheye"]),
        wv.Agent("dome", CAMERAS["wide"], POSES[1]),
    ]
    found = wv.perspective(scene, agents)
    wv.viz.save_perspective(scene, agents, found, tmp_path / "seen.png")
    assert (tmp_path / "seen.png").stat().st_size > 20_000


def test_back_projection_is_depth_times_ray():
    """In the camera frame, a point is its depth times the ray."""
    camera = CAMERAS["five"]
    depth = np.full((1, 48, 64), 2.0, dtype=np.float32)
    np.testing.assert_allclose(wv.back_project(depth, camera, STRAIGHT).numpy()[0], 2 * camera.rays, rtol=1e-6)
