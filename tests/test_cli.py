# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The command line, as a user runs it, and the demo's files."""

import json
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from PIL import Image

import warpvis as wv
from warpvis.demo import format_table, run_experiment


def run_cli(*arguments, cwd):
    command = [sys.executable, "-m", "warpvis.cli", *map(str, arguments)]
    result = subprocess.run(command, cwd=cwd, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return result


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    return folder, run_cli("demo", "--out", folder / "new" / "demo", cwd=folder).stdout


def test_the_demo_writes_four_pictures(demo):
    folder = demo[0] / "new" / "demo"
    names = sorted(path.name for path in folder.iterdir())
    assert names == [*(f"experiment_{i}.png" for i in (1, 2, 3, 4)), "summary.json"]
    for path in folder.glob("*.png"):
        picture = np.asarray(Image.open(path).convert("RGB"))
        assert picture.shape[0] > 400 and picture.shape[1] > 1200
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 1000


def test_the_demo_prints_the_table(demo):
    assert "experiment  object  visible  pixels  2D answer" in demo[1]
    sightings = [sighting for number in (1, 2, 3, 4) for sighting in run_experiment(number).sightings]
    assert format_table(sightings) in demo[1]
    assert "frames per second" in demo[1]


def test_the_summary_says_the_same(demo):
    summary = json.loads((demo[0] / "new" / "demo" / "summary.json").read_text())
    assert summary["frames_per_second"] > 0
    differing = [(s["experiment"], s["object"]) for s in summary["sightings"] if s["plan_differs"]]
    assert differing == [(3, "ball"), (4, "person")]
    assert [s["visible"] for s in summary["sightings"]] == [True, True, False, True, True, False, False, True]


def test_render_writes_metres_and_millimetres(tmp_path):
    trimesh.creation.box().export(tmp_path / "box.stl")
    eyes = [(-3, 0, 0), (0, -2, 0.3), (40, 1, 0), (70, 1, 0)]
    poses = np.array([wv.look_at(eye, (0, 0, 0)) for eye in eyes])
    np.savetxt(tmp_path / "poses.txt", np.column_stack([[0.5, 1.5, 2.5, 3.5], poses]), header="a trajectory")
    (tmp_path / "camera.json").write_text(json.dumps({"width": 64, "height": 48, "hfov": 0.5}))
    result = run_cli(
        "render", "box.stl", "--poses", "poses.txt", "--camera", "camera.json", "--out", "out", cwd=tmp_path
    )
    assert "4 views" in result.stdout
    assert "farther than 65.535 m" in result.stderr

    stored = np.load(tmp_path / "out" / "depth.npz")
    camera = wv.Camera.from_fov(64, 48, hfov=0.5)
    depth = wv.render(wv.Scene.load(tmp_path / "box.stl"), camera, poses).depth.numpy()
    np.testing.assert_array_equal(stored["depth"], depth)
    np.testing.assert_array_equal(stored["K"], camera.to_K())
    np.testing.assert_allclose(stored["camera_to_world"], poses, atol=1e-6)
    assert stored["timestamp"].tolist() == [0.5, 1.5, 2.5, 3.5]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["depth", "depth.npz"]
    for view in range(4):
        image = Image.open(tmp_path / "out" / "depth" / f"{view:06d}.png")
        assert image.mode == "I;16"
        millimetres = np.asarray(image)
        metres = np.where(np.isfinite(depth[view]) & (depth[view] < 65.5355), depth[view], 0)
        assert np.abs(millimetres / 1000 - metres).max() <= 0.000501


def test_conventions_reach_the_renderer(tmp_path):
    """An OpenGL camera looks along -z: the same numbers see the box from the other side."""
    trimesh.creation.box((2, 2, 2)).export(tmp_path / "box.stl")
    (tmp_path / "poses.txt").write_text("0 0 0 4 0 0 0 1\n")
    for convention, nearest in (("opencv", np.inf), ("opengl", 3.0)):
        run_cli(
            *f"render box.stl --poses poses.txt --out {convention} --convention {convention} --quiet".split(),
            cwd=tmp_path,
        )
        assert np.load(tmp_path / convention / "depth.npz")["depth"].min() == nearest


def test_info_names_versions_devices_and_cores(tmp_path):
    printed = run_cli("info", cwd=tmp_path).stdout
    for word in (f"warpvis {wv.__version__}", "warp-lang ", "mujoco ", "cores ", "device  cpu"):
        assert word in printed


@pytest.mark.parametrize("arguments", [("--help",), ("demo", "--help"), ("render", "--help"), ("info", "--help")])
def test_help_needs_nothing_heavy(tmp_path, arguments):
    """That is what keeps it under 0.3 s; a test of the time itself would fail on a busy machine."""
    code = f"""
import sys
sys.argv = ["warpvis", *{arguments!r}]
from warpvis.cli import main
try:
    main()
except SystemExit as stop:
    assert not stop.code
heavy = {{"numpy", "warp", "trimesh", "mujoco", "matplotlib", "PIL", "tqdm"}} & set(sys.modules)
assert not heavy, heavy
"""
    result = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert "show this help message" in result.stdout


def test_import_loads_nothing_heavy(tmp_path):
    code = "import sys, warpvis; assert not {'numpy', 'warp', 'trimesh', 'mujoco', 'matplotlib'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
