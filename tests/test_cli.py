# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The command line as used from a shell, and the demo's files."""

import json
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from command_line import run_inside
from PIL import Image

import warpvis as wv
from warpvis.cli.demo import format_states, format_table, run_experiment
from warpvis.scenes import EXPERIMENTS

from support.cli import run_here


def run_cli(*arguments, cwd):
    result = run_inside(*arguments, cwd=cwd)
    assert result.returncode == 0, result.stderr
    return result


def count_colors(path):
    red, green, blue = np.asarray(Image.open(path).convert("RGB")).astype(np.int32).reshape(-1, 3).T
    return len(np.unique((red * 256 + green) * 256 + blue))


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    return folder, run_cli("demo", "--out", folder / "new" / "demo", cwd=folder).stdout


@pytest.mark.slow
def test_demo_writes_its_images(demo):
    folder = demo[0] / "new" / "demo"
    names = sorted(path.name for path in folder.iterdir())
    pictures = [f"experiment_{i}{kind}.png" for i in (1, 2, 3, 4) for kind in ("", "_perspective")]
    pages = [f"experiment_{i}.html" for i in (1, 2, 3, 4)]
    assert names == sorted([*pictures, *pages, "summary.json"])
    for path in folder.glob("*.png"):
        width, height = Image.open(path).size
        assert height > 400 and width > 1200
        assert count_colors(path) > (300 if "perspective" in path.name else 1000)
        assert path.stat().st_size < 400_000


@pytest.mark.slow
def test_demo_prints_the_tables(demo):
    assert "experiment  object  visible  pixels  2D answer" in demo[1]
    results = [run_experiment(number) for number in (1, 2, 3, 4)]
    assert format_table([sighting for result in results for sighting in result.sightings]) in demo[1]
    assert format_states([result.shared for result in results]) in demo[1]
    assert "frames per second" in demo[1]


@pytest.mark.slow
def test_summary_matches_the_tables(demo):
    summary = json.loads((demo[0] / "new" / "demo" / "summary.json").read_text())
    assert summary["frames_per_second"] > 0
    differing = [(s["experiment"], s["object"]) for s in summary["sightings"] if s["plan_differs"]]
    assert differing == [(3, "ball"), (4, "person")]
    assert [s["visible"] for s in summary["sightings"]] == [True, True, False, True, True, False, False, True]
    states = [(s["experiment"], s["object"], s["robot"], s["human"], s["state"]) for s in summary["perspectives"]]
    assert states == [
        (1, "ball", True, True, "both"),
        (2, "ball", False, True, "human only"),
        (3, "ball", True, False, "robot only"),
        (4, "ball", False, False, "neither"),
    ]
    assert [s["human_pixels"] > 100 for s in summary["perspectives"]] == [True, True, False, False]


def test_render_writes_meters_and_millimeters(tmp_path):
    trimesh.creation.box().export(tmp_path / "box.stl")
    eyes = [(-3, 0, 0), (0, -2, 0.3), (40, 1, 0), (70, 1, 0)]
    poses = np.array([wv.look_at(eye, (0, 0, 0)) for eye in eyes])
    np.savetxt(tmp_path / "poses.txt", np.column_stack([[0.5, 1.5, 2.5, 3.5], poses]), header="a trajectory")
    (tmp_path / "camera.json").write_text(json.dumps({"width": 64, "height": 48, "hfov": 0.5}))
    result = run_cli(
        "render", "box.stl", "--poses", "poses.txt", "--camera", "camera.json", "--out", "out", cwd=tmp_path
    )
    assert "frames: 4, shards: 1, " in result.stdout
    assert "warning: " in result.stderr and "pixels have a depth that 16 bits of 1000 units a meter" in result.stderr

    stored = np.load(tmp_path / "out" / "npz" / "shard-000000.npz")
    camera = wv.Camera.from_fov(64, 48, hfov=0.5)
    depth = wv.render(wv.Scene.load(tmp_path / "box.stl"), camera, poses).depth.numpy()
    np.testing.assert_array_equal(stored["depth"], depth)
    np.testing.assert_array_equal(stored["K"], camera.to_K())
    np.testing.assert_allclose(stored["camera_to_world"], poses, atol=1e-6)
    assert stored["timestamps"].tolist() == [0.5, 1.5, 2.5, 3.5]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["contact_sheet.png", "npz", "png", "preview"]
    for view in range(4):
        image = Image.open(tmp_path / "out" / "png" / "depth" / "000000" / f"{view:06d}.png")
        assert image.mode == "I;16"
        millimeters = np.asarray(image)
        meters = np.where(np.isfinite(depth[view]) & (depth[view] < 65.5355), depth[view], 0)
        assert np.abs(millimeters / 1000 - meters).max() <= 0.000501


def test_conventions_reach_the_renderer(tmp_path):
    """An OpenGL camera looks along -z: the same pose views the box from the other side."""
    trimesh.creation.box((2, 2, 2)).export(tmp_path / "box.stl")
    (tmp_path / "poses.txt").write_text("0 0 0 4 0 0 0 1\n")
    for convention, nearest in (("opencv", np.inf), ("opengl", 3.0)):
        run_cli(
            *f"render box.stl --poses poses.txt --out {convention} --convention {convention} --quiet".split(),
            cwd=tmp_path,
        )
        assert np.load(tmp_path / convention / "npz" / "shard-000000.npz")["depth"].min() == nearest


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Return experiment 2 as a file, two poses (the robot's, and one that sees the ball), and five points."""
    folder = tmp_path_factory.mktemp("lab")
    EXPERIMENTS[1].build().export(folder / "lab.glb")
    poses = np.stack([EXPERIMENTS[1].poses()[0], wv.look_at((-0.9, -0.9, 0.7), (0.5, 0.6, 0.1))])
    np.savetxt(folder / "poses.txt", np.column_stack([[0.5, 1.5], poses]))
    points = np.array([[0.5, 0.6, 0.2], [0.5, 0.6, 0.1], [-1, 0, 0], [5, 0, 0], [-1.5, 0, 0.6]])
    np.savetxt(folder / "points.csv", points, delimiter=",", header="x,y,z", comments="")
    np.save(folder / "points.npy", points)
    return folder


ROBOT, HUMAN = "-1.77 0 0.7 0 0 0.39", "1.2, -0.45, 1.6, 0.5, 0.6, 0.1"
BODIES = ("--robot-body", "robot", "--human-body", "person")


def test_perspective_of_a_file(lab, tmp_path):
    """With negative numbers, names with spaces, and a new folder."""
    out = tmp_path / "new" / "out"
    result = run_cli("perspective", "lab.glb", "--robot", ROBOT, "--human", HUMAN, *BODIES, "--out", out, cwd=lab)
    assert "hidden by high obstacle" in result.stdout
    assert "The robot must move to see ball." in result.stdout
    assert sorted(path.name for path in out.iterdir()) == ["perspective.json", "perspective.png"]
    report = json.loads((out / "perspective.json").read_text())

    scene = wv.Scene.load(lab / "lab.glb")
    robot = wv.Agent.kinect("robot", wv.look_at((-1.77, 0, 0.7), (0, 0, 0.39)), body="robot")
    human = wv.Agent.human("human", wv.look_at((1.2, -0.45, 1.6), (0.5, 0.6, 0.1)), body="person")
    seen = wv.perspective(scene, (robot, human))
    assert seen.table() in result.stdout
    assert {key: report[key] for key in ("view", "agents", "objects")} == seen.report()
    assert [item["object"] for item in report["candidates"]] == ["ball"]
    assert report["candidates"][0]["robot_sees"] is False
    assert report["to_see"] == seen.to_see("robot", "human") == ["ball"]
    proposed = report["proposed_robot_pose"]
    views = wv.render(scene, wv.Camera.kinect(), proposed["pose"], exclude=["robot"])
    assert (views.segmentation.numpy() == scene.index("ball")).sum() > 100
    assert proposed["fractions"]["ball"] > 0.95 and 0 < proposed["distance"] <= 2
    assert f"{proposed['distance']:.2f} m away" in result.stdout


def test_perspective_of_an_experiment(tmp_path, monkeypatch, capsys):
    """Experiments define their agents; only requested files are written."""
    for number, word in ((1, "The robot sees all of them."), (4, "The human sees no objects")):
        code, out, _ = run_here(monkeypatch, capsys, tmp_path, "perspective", f"experiment_{number}")
        assert code == 0 and word in out
        experiment = EXPERIMENTS[number - 1]
        assert wv.perspective(experiment.build(), experiment.agents()).table() in out
    assert list(tmp_path.iterdir()) == []


def test_files_take_precedence_over_experiments(lab, tmp_path, monkeypatch, capsys):
    (tmp_path / "experiment_1").write_text("no mesh")
    code, _, error = run_here(monkeypatch, capsys, tmp_path, "perspective", "experiment_1")
    assert code == 2 and error.startswith("warpvis: --robot must be given as")


def test_labels_select_the_candidate_objects(lab, monkeypatch, capsys):
    given = ("perspective", "lab.glb", "--robot", ROBOT, "--human", HUMAN, *BODIES, "--labels")
    code, out, _ = run_here(monkeypatch, capsys, lab, *given, "ball=obstacle", "*obstacle=object")
    assert code == 0
    rows = out.split("the human may mean")[1].splitlines()[2:4]
    assert [row.split("  ")[0] for row in rows] == ["high obstacle", "low obstacle"]
    assert "The robot sees all of them." in out
    code, out, _ = run_here(monkeypatch, capsys, lab, *given, "ball=obstacle", "floor=ground")
    rows = out.split("the human may mean")[1].split("\n\n")[0].splitlines()[2:]
    assert {row.split("  ")[0] for row in rows} == {
        "ball",
        "high obstacle",
        "low obstacle",
    }  # no object has the label object
    assert "The robot must move to see ball." in out


@pytest.mark.slow
def test_pose_arguments_in_every_format(lab, tmp_path, monkeypatch, capsys):
    row = wv.core.poses.look_at((-1.77, 0, 0.7), (0, 0, 0.39))
    opengl = [*row[:3], *wv.core.poses.quaternion_product(row[3:], np.array([1.0, 0, 0, 0]))]
    np.save(tmp_path / "pose.npy", [opengl])
    np.save(tmp_path / "poses.npy", [row, row])
    seven, other = (" ".join(map(repr, map(float, pose))) for pose in (row, opengl))
    tables = []
    for pose, *more in ((ROBOT,), (seven,), (other, "opengl"), (tmp_path / "pose.npy", "opengl")):
        given = ("perspective", "lab.glb", "--robot", pose, "--human", HUMAN, *BODIES)
        code, out, _ = run_here(monkeypatch, capsys, lab, *given, *("--convention", *more)[: 2 * len(more)])
        assert code == 0
        tables.append(out)
    assert len(set(tables)) == 1
    for pose, more, said in (
        (ROBOT, ("--convention", "opengl"), "poses given by eye and target take no --convention"),
        (seven, ("--topic", "/tf"), "poses given as numbers take no --topic"),
        (tmp_path / "poses.npy", (), f"--robot must be one pose, and {tmp_path / 'poses.npy'} holds 2"),
    ):
        given = ("perspective", "lab.glb", "--robot", pose, "--human", HUMAN, *more)
        assert run_here(monkeypatch, capsys, lab, *given) == (2, "", f"warpvis: {said}\n")


def test_limits_of_the_proposed_robot_pose(lab, monkeypatch, capsys):
    given = ("perspective", "lab.glb", "--robot", ROBOT, "--human", HUMAN, *BODIES)
    for more in (("--max-distance", "0.3"), ("--robot-radius", "5"), ("--floor", "-1")):
        code, out, _ = run_here(monkeypatch, capsys, lab, *given, *more)
        assert code == 0
        assert ("m shows any of them." in out) == (more[0] != "--floor")


def test_check_objects(lab, tmp_path, monkeypatch, capsys):
    out, picture = tmp_path / "report.json", tmp_path / "first.png"
    given = ("check", "lab.glb", "--poses", "poses.txt", "--exclude", "robot", "--out", out, "--picture", picture)
    code, printed, _ = run_here(monkeypatch, capsys, lab, *given)
    assert code == 0
    scene = wv.Scene.load(lab / "lab.glb")
    names = [item.name for item in scene if item.name != "robot"]
    poses = np.loadtxt(lab / "poses.txt")[:, 1:]
    seen = wv.object_visibility(scene, wv.Camera.kinect(), poses, objects=names, exclude=["robot"])
    views = json.loads(out.read_text())["views"]
    assert [view["timestamp"] for view in views] == [0.5, 1.5]
    np.testing.assert_allclose([view["pose"] for view in views], poses, atol=1e-6)
    for v, view in enumerate(views):
        assert [item["name"] for item in view["objects"]] == names
        for k, item in enumerate(view["objects"]):
            for key in ("fraction", "visible_pixels", "silhouette_pixels"):
                assert item[key] == getattr(seen, key).numpy()[v, k]
            for key in ("visible_box", "silhouette_box"):
                assert item[key] == getattr(seen, key).numpy()[v, k].tolist()
            assert item["status"] == wv.Visibility(seen.status.numpy()[v, k]).name
            hides = seen.occluder.numpy()[v, k]
            assert item["occluder"] == (scene.objects[hides].name if hides >= 0 else None)
    rows = [[word.strip() for word in line.split("  ") if word] for line in printed.splitlines()]
    assert ["0", "ball", "0.00", "0", "occluded", "high obstacle"] in rows
    assert count_colors(picture) > 200


def test_check_selected_objects(lab, monkeypatch, capsys):
    before = sorted(lab.iterdir())
    given = ("check", "lab.glb", "--poses", "poses.txt", "--objects", "person", "high obstacle")
    code, printed, _ = run_here(monkeypatch, capsys, lab, *given)
    assert code == 0
    assert [line.split("  ")[2].strip() for line in printed.splitlines()[2:]] == ["person", "high obstacle"] * 2
    assert sorted(lab.iterdir()) == before


def test_long_tables_are_truncated(lab, tmp_path, monkeypatch, capsys):
    np.savetxt(tmp_path / "many.txt", np.repeat(np.loadtxt(lab / "poses.txt"), 30, axis=0))
    given = ("check", "lab.glb", "--poses", tmp_path / "many.txt", "--objects", "ball")
    _, printed, _ = run_here(monkeypatch, capsys, lab, *given)
    assert len(printed.splitlines()) == 2 + 40 + 1
    assert printed.endswith("... and 20 more lines; --out writes all\n")


@pytest.mark.parametrize("points", ["points.csv", "points.npy"])
@pytest.mark.parametrize("suffix", [".json", ".npy"])
def test_check_points(lab, tmp_path, monkeypatch, capsys, points, suffix):
    out = tmp_path / f"status{suffix}"
    given = ("check", "lab.glb", "--poses", "poses.txt", "--points", points, "--exclude", "robot", "--out", out)
    code, printed, _ = run_here(monkeypatch, capsys, lab, *given)
    assert code == 0
    poses = np.loadtxt(lab / "poses.txt")[:, 1:]
    scene = wv.Scene.load(lab / "lab.glb")
    status = wv.point_visibility(
        scene, wv.Camera.kinect(), poses, np.load(lab / "points.npy"), exclude=["robot"]
    ).numpy()
    assert [line.split() for line in printed.splitlines()[2:4]] == [
        [str(v), "5", *(str((status[v] == kind).sum()) for kind in (4, 3, 2, 1, 0))] for v in (0, 1)
    ]
    assert status[0].tolist() == [3, 3, 0, 2, 1] and status[1, 0] == 4
    if suffix == ".npy":
        stored = np.load(out)
        assert stored.dtype == np.uint8
        np.testing.assert_array_equal(stored, status)
        return
    for v, view in enumerate(json.loads(out.read_text())["views"]):
        assert view["status"] == [wv.Visibility(one).name for one in status[v]]
        assert view["counts"] == {kind.name: (status[v] == kind).sum() for kind in wv.Visibility if kind != 5}


LOOK = ("--robot", ROBOT, "--human", HUMAN)
POSES = ("--poses", "poses.txt")


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (("perspective", "none.glb", *LOOK, "--out", "x"), "none.glb: no such file"),
        (("perspective", "experiment_9", *LOOK, "--out", "x"), "experiment_9: no such file"),
        (
            ("perspective", "lab.glb", "--human", HUMAN, "--out", "x"),
            "--robot must be given as eye and target",
        ),
        (
            ("perspective", "lab.glb", "--robot", ROBOT, "--out", "x"),
            "--human must be given as eye and target",
        ),
        (
            ("perspective", "lab.glb", "--robot", "1 2 3", "--human", HUMAN),
            "--robot must be 6 numbers, eye and target",
        ),
        (
            ("perspective", "lab.glb", "--robot", ROBOT, "--human", "a b c d e f"),
            "--human must be 6 numbers, eye and target",
        ),
        (
            ("perspective", "lab.glb", "--robot", "0 0 1 0 0 0", "--human", HUMAN),
            "--robot: eye [0.0, 0.0, 1.0] and target",
        ),
        (
            ("perspective", "lab.glb", "--robot", "0 0 1 0 0 0 0", "--human", HUMAN),
            "--robot must have quaternions of length 1, got 0",
        ),
        (
            ("perspective", "lab.glb", *LOOK, "--robot-body", "bot", "--out", "x"),
            "the scene has no object 'bot'; it has",
        ),
        (
            ("perspective", "lab.glb", *LOOK, "--labels", "ball", "--out", "x"),
            "--labels must be given as NAME=LABEL, such",
        ),
        (("perspective", "lab.glb", *LOOK, "--labels", "ball=cup"), "label must be one of empty (0), "),
        (("perspective", "lab.glb", *LOOK, "--labels", "cup=object"), "labels for 'cup' fit no object of lab.glb"),
        (("perspective", "lab.glb", *LOOK, "--camera", "none.json", "--out", "x"), "none.json: no such file"),
        (
            ("perspective", "lab.glb", *LOOK, "--max-distance", "-1", "--out", "x"),
            "--max-distance must be a number of meters from 0 up",
        ),
        (
            ("perspective", "lab.glb", *LOOK, "--robot-radius", "0"),
            "--robot-radius must be a positive number of meters",
        ),
        (("perspective", "lab.glb", *LOOK, "--floor", "nan"), "--floor must be a finite number of meters, got nan"),
        (("perspective", "lab.glb", *LOOK, "--out", "lab.glb"), "lab.glb: must be a folder, but is a file"),
        (
            ("perspective", "experiment_1", "--robot", ROBOT, "--scale", "2"),
            "experiment_1 defines its robot and its",
        ),
        (("check", "none.glb", *POSES, "--out", "x.json"), "none.glb: no such file"),
        (("check", "lab.glb", "--poses", "none.txt", "--out", "x.json"), "none.txt: no such file"),
        (("check", "lab.glb", "--poses", "points.csv"), "points.csv:1: expected the column names"),
        (("check", "lab.glb", *POSES, "--points", "poses.txt"), "poses.txt:1: expected three finite numbers 'x y z'"),
        (("check", "lab.glb", *POSES, "--points", "p.csv"), "p.csv: no such file"),
        (
            ("check", "lab.glb", *POSES, "--points", "points.csv", "--tolerance", "-1"),
            "--tolerance must be a number of meters",
        ),
        (
            ("check", "lab.glb", *POSES, "--points", "points.csv", "--objects", "ball"),
            "give either --points or --objects",
        ),
        (
            ("check", "lab.glb", *POSES, "--points", "points.csv", "--out", "x.txt"),
            "x.txt: the name must end in .json or .npy",
        ),
        (("check", "lab.glb", *POSES, "--out", "x.npy"), "x.npy: the name must end in .json"),
        (
            ("check", "lab.glb", *POSES, "--out", "none/x.json"),
            "none/x.json: cannot be written: there is no folder none",
        ),
        (("check", "lab.glb", *POSES, "--picture", "x.xyz", "--out", "x.json"), "x.xyz: the name must end in .png or"),
        (
            ("check", "lab.glb", *POSES, "--objects", "cup", "--out", "x.json", "--picture", "x.png"),
            "the scene has no object",
        ),
        (
            ("check", "lab.glb", *POSES, "--exclude", "cup", "--out", "x.json", "--picture", "x.png"),
            "the scene has no object",
        ),
        (("check", "lab.glb", *POSES, "--device", "tpu", "--out", "x.json"), "device"),
    ],
)
def test_invalid_input_prints_one_sentence_and_writes_nothing(lab, monkeypatch, capsys, command, said):
    before = sorted(lab.iterdir())
    code, out, error = run_here(monkeypatch, capsys, lab, *command)
    assert code == 2 and out == ""
    assert error.startswith(f"warpvis: {said}"), error
    assert error.count("\n") == 1
    assert sorted(lab.iterdir()) == before


def test_info_names_versions_devices_and_cores(tmp_path):
    printed = run_cli("info", cwd=tmp_path).stdout
    for word in (f"warpvis {wv.__version__}", "warp-lang ", "mujoco ", "cores ", "device  cpu"):
        assert word in printed


@pytest.mark.smoke("", "render")
@pytest.mark.parametrize("command", ["", "demo", "render", "check", "perspective", "info"])
def test_help_imports_no_heavy_packages(tmp_path, command):
    """This keeps it below 0.3 s; a test of the time itself would fail on a busy machine."""
    code = f"""
import sys
sys.argv = ["warpvis", *{command.split()!r}, "--help"]
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


def test_import_loads_no_heavy_packages(tmp_path):
    code = "import sys, warpvis; assert not {'numpy', 'warp', 'trimesh', 'mujoco', 'matplotlib'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
