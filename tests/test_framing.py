# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras that frame a whole scene, depth colors, and their use in ``warpvis render`` and ``info``."""

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from PIL import Image
from pose_samples import unit

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.pose_generators import framing
from warpvis.viz import depth_colors, save_contact_sheet, save_preview

from support.cli import run_here

LENS = wv.Camera(200, 100, fx=150.0, fy=140.0, cx=60.0, cy=70.0)


def corners_in_image(scene, camera, pose):
    boxes = np.array([item.bounds for item in scene.objects], dtype=np.float64)
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    to_camera = np.linalg.inv(poses_to_matrices(pose))
    return camera.project(corners @ to_camera[:3, :3].T + to_camera[:3, 3]) / [camera.width, camera.height]


@pytest.mark.parametrize("up", ["z", "y"])
@pytest.mark.parametrize("camera", [wv.Camera.kinect(), LENS])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 5e3])
def test_whole_scene_fits_tightly(up, camera, scale):
    scene = wv.Scene(up=up)
    scene.add(trimesh.creation.box(scale * np.array([3, 2, 0.1])), name="floor", pose=(5 * scale, 0, 0, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(radius=0.3 * scale), name="ball", pose=(4 * scale, scale, 0, 0, 0, 0, 1))
    for azimuth, elevation in ((-1.0, 0.55), (2.0, 0.0), (0.3, math.pi / 2), (4.0, -1.0)):
        pose = framing(scene, camera, azimuth=azimuth, elevation=elevation)
        at = corners_in_image(scene, camera, pose)
        assert (at > 0.0299).all() and (at < 0.9701).all()
        assert min(at.min(), 1 - at.max()) == pytest.approx(0.03, abs=1e-4)  # as close as possible
    middle, height = 4.85 * scale, 1 if up == "y" else 2
    toward = framing(scene, camera, azimuth=0.0, elevation=0.5)[:3] - unit((middle, 0, 0, 0, 0, 0, 1))[:3]
    assert toward[height] > 0


def test_large_ground_is_clipped():
    def build(size):
        scene = wv.Scene()
        scene.add(trimesh.creation.box((size, size, 0.1)), name="floor", label="ground", pose=(0, 0, -0.05, 0, 0, 0, 1))
        scene.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="box", label="object", pose=(1, 2, 0.1, 0, 0, 0, 1))
        return scene

    camera = wv.Camera.kinect()
    large, huge = (framing(build(size), camera) for size in (8.0, 1000.0))
    assert large.tolist() == huge.tolist()
    seen = wv.object_visibility(build(1000.0), replace(camera, near=0.0, far=math.inf), huge)
    assert seen.visible_pixels.numpy()[0, 1] > 0.02 * camera.width * camera.height


def test_invalid_framing_raises():
    with pytest.raises(wv.WarpvisError, match="the scene has no objects"):
        framing(wv.Scene(), LENS)
    aside = wv.Camera(100, 100, 90, 90, 0.0, 50)
    with pytest.raises(wv.errors.CameraError, match="camera must have its optical axis inside the image"):
        framing(wv.scenes.PRESETS["room"].build(), aside)


def test_depth_colors(tmp_path):
    depth = np.array([[1.0, 2.0, 3.0], [np.inf, -np.inf, 9.0]], dtype=np.float32)
    colors = depth_colors(depth, (1.0, 3.0)).astype(int)
    assert colors[0, 0, 2] > colors[0, 0, 0] and colors[0, 2, 0] > colors[0, 2, 2]  # blue is near, red is far
    assert colors[0, 1, 1] > 200
    assert colors[1].tolist() == [[70, 70, 70], [255, 255, 255], colors[0, 2].tolist()]
    image = np.tile(np.linspace(1, 3, 200, dtype=np.float32), (40, 1))
    save_preview(image, tmp_path / "one.png", (1.0, 3.0))
    picture = np.asarray(Image.open(tmp_path / "one.png"))
    assert picture.shape == (40 + 22, 200, 3)
    assert np.array_equal(picture[:40], depth_colors(image, (1.0, 3.0)))
    assert np.array_equal(picture[44, ::40], picture[20, ::40])  # the color scale below shows these depths
    save_contact_sheet([image] * 5, [f"{k}" for k in range(5)], tmp_path / "sheet.png", (1.0, 3.0))
    sheet = Image.open(tmp_path / "sheet.png")
    assert sheet.width == 4 * 206 + 6 and sheet.height > 2 * 54


def test_render_writes_images_and_does_not_overwrite(tmp_path, monkeypatch, capsys):
    poses = "orbit target=0,0,0.3 radius=2 height=1.2 count=3"
    arguments = ("render", "experiment_1", "--poses", poses, "--out", "out")
    code, printed, _ = run_here(monkeypatch, capsys, tmp_path, *arguments)
    assert code in (0, None) and "contact_sheet.png" in printed
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["contact_sheet.png", "npz", "png", "preview"]
    assert len(list((tmp_path / "out" / "preview").iterdir())) == 3
    for format in ("npz", "zarr"):
        code, _, said = run_here(monkeypatch, capsys, tmp_path, *arguments, "--format", format)
        assert code == 2 and "exists already" in said
    code, _, _ = run_here(monkeypatch, capsys, tmp_path, *arguments[:-1], "bare", "--no-pictures", "--format", "npz")
    assert code in (0, None) and [path.name for path in (tmp_path / "bare").iterdir()] == ["npz"]


def test_frame_option_of_the_command_line(tmp_path, monkeypatch, capsys):
    trimesh.creation.box((3000, 2000, 1500)).export(tmp_path / "mm.stl")
    code, _, _ = run_here(
        monkeypatch, capsys, tmp_path, "render", "mm.stl", "--frame", "--out", "out", "--format", "npz"
    )
    assert code in (0, None)
    frame = wv.open_dataset(tmp_path / "out" / "npz")[0]
    assert np.isfinite(frame["depth"]).mean() > 0.2  # with unlimited range
    arguments = ("render", "mm.stl", "--frame", "--camera", "kinect", "--out", "none", "--format", "npz")
    code, _, said = run_here(monkeypatch, capsys, tmp_path, *arguments)
    assert code in (0, None) and "1 of 1 frame sees nothing" in said
    save_preview(np.full((240, 320), np.inf), tmp_path / "wanted.png", (0.3, 4.5))  # the scale shows the camera's range
    shown, wanted = (np.asarray(Image.open(tmp_path / name)) for name in ("none/preview/000000.png", "wanted.png"))
    assert np.array_equal(shown, wanted)
    arguments = ("render", "mm.stl", "--frame", "--device-name", "eye", "--out", "other")
    code, _, said = run_here(monkeypatch, capsys, tmp_path, *arguments)
    assert code == 2 and "with --poses or --frame no device is rendered: give no --device-name" in said
    code, _, said = run_here(monkeypatch, capsys, tmp_path, "check", "mm.stl")
    assert code == 2 and "give either --poses or --frame" in said
    code, printed, _ = run_here(monkeypatch, capsys, tmp_path, "check", "experiment_1", "--frame")
    assert code in (0, None) and "ball" in printed


def test_info_prints_size_labels_memory_and_likely_unit(tmp_path, monkeypatch, capsys):
    trimesh.creation.box((3000, 2000, 1500)).export(tmp_path / "mm.stl")
    _, printed, _ = run_here(monkeypatch, capsys, tmp_path, "info", "mm.stl")
    assert "spans   3000 x 2000 x 1500 m, from -1500 -1000 -750 to 1500 1000 750" in printed
    assert "possibly millimeters: with --scale 0.001 it spans 3 x 2 x 1.5 m" in printed
    _, printed, _ = run_here(monkeypatch, capsys, tmp_path, "info", "mm.stl", "--scale", "0.001")
    assert "millimeters" not in printed and "MB with its trees" in printed
    _, printed, _ = run_here(monkeypatch, capsys, tmp_path, "info", "experiment_1")
    assert "labels  obstacle 2, ground 1, object 1, human 1, robot 1" in printed


@pytest.mark.slow
def test_info_of_a_mesh_does_not_import_mujoco(tmp_path):
    trimesh.creation.box().export(tmp_path / "box.stl")
    code = """import sys
from warpvis.cli import main
sys.argv = ["warpvis", "info", "box.stl"]
main()
print("mujoco" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "False"


def test_eyes_inside_an_object_are_reported(tmp_path, monkeypatch, capsys):
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box((4, 4, 0.1)), node_name="floor", geom_name="floor")
    for name, mesh, place in (
        ("person", trimesh.creation.capsule(height=1.4, radius=0.25), (1.2, 0, 0.9)),
        ("ball", trimesh.creation.icosphere(radius=0.1), (0, 0, 0.2)),
    ):
        mesh.apply_translation(place)
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    scene.export(tmp_path / "lab.glb")
    arguments = [
        "perspective",
        "lab.glb",
        "--file-up",
        "z",
        "--robot",
        "-1.5 0 .8 0 0 .2",
        "--human",
        "1.2 0 1.5 0 0 .2",
    ]
    _, _, said = run_here(monkeypatch, capsys, tmp_path, *arguments)
    assert "the human's eyes are inside of 'person': if that is the human, give --human-body 'person'" in said
    _, _, said = run_here(monkeypatch, capsys, tmp_path, *arguments, "--human-body", "person")
    assert "inside" not in said
