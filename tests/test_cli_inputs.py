# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""All commands accept the same scenes, cameras and poses, and reject options without effect."""

import json

import numpy as np
import pytest
import trimesh

import warpvis as wv

from support.cli import run_here

URDF = """<robot name="cart"><link name="cart"><visual><geometry><mesh filename="package://far/box.stl"/></geometry>
</visual></link></robot>"""
MJCF = """<mujoco><worldbody><geom name="floor" type="plane" size="3 3 .1"/>
<body name="cart" pos="0 0 .5"><freejoint/><geom name="box" type="box" size=".5 .5 .5"/></body></worldbody></mujoco>"""
WORLD = """#VRML_SIM R2023b utf8
Solid { translation 0 0 0.5 name "box" children [ Shape { geometry Box { size 1 1 1 } } ] }"""
ORBIT = "orbit target=0,0,0.5 radius=3 height=1 count=3"
FILES = ["room.obj", "room.glb", "room.stl", "room.ply", "room.xml", "cart.urdf", "world.wbt"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a box in every format, and poses and worlds for it."""
    folder = tmp_path_factory.mktemp("inputs")
    box = trimesh.creation.box()
    for suffix in ("obj", "glb", "stl", "ply"):
        box.export(folder / f"room.{suffix}")
    (folder / "lib" / "far").mkdir(parents=True)
    box.export(folder / "lib" / "far" / "box.stl")
    (folder / "cart.urdf").write_text(URDF)
    (folder / "room.xml").write_text(MJCF)
    (folder / "world.wbt").write_text(WORLD)
    (folder / "scene.xml").write_text("<scene/>")
    (folder / "camera.json").write_text(json.dumps({"width": 16, "height": 12, "hfov": 1.0}))
    poses = np.array([wv.look_at((-4, 0, 0), (1, 0, 0)), wv.look_at((0, -3, 1), (0, 0, 0))])
    np.savetxt(folder / "poses.txt", np.column_stack([[0.5, 1.5], poses]))
    np.save(folder / "poses.npy", poses)
    np.savez(folder / "poses.npz", camera_to_world=poses)
    np.savetxt(folder / "poses.csv", poses, delimiter=",", header="x,y,z,qx,qy,qz,qw", comments="")
    matrices = wv.core.poses.poses_to_matrices(poses) @ np.diag([1.0, -1, -1, 1])
    frames = [{"transform_matrix": matrix.tolist()} for matrix in matrices]
    (folder / "transforms.json").write_text(json.dumps({"frames": frames}))
    np.save(folder / "w_first.npy", poses[:, [0, 1, 2, 6, 3, 4, 5]])
    np.save(folder / "one.npy", poses[:1, [0, 1, 2, 6, 3, 4, 5]])
    np.savez(folder / "worlds.npz", object_poses=[[[0, 0, 100.0, 0, 0, 0, 1]], [[0, 0, 0, 0, 0, 0, 1]]])
    np.savez(folder / "w_first.npz", object_poses=[[[0, 0, 100.0, 1, 0, 0, 0]], [[0, 0, 0, 1, 0, 0, 0]]])
    return folder


@pytest.fixture
def run(folder, monkeypatch, capsys):
    """Return a function that runs a command in the folder and returns exit code, standard output and standard error."""
    return lambda *arguments: run_here(monkeypatch, capsys, folder, *arguments)


def search(file):
    return ("--search-path", "lib", "--strict") if file == "cart.urdf" else ()


@pytest.mark.smoke("room.glb", "world.wbt", "cart.urdf")
@pytest.mark.parametrize("file", FILES)
def test_every_command_accepts_every_scene_format(run, tmp_path, file):
    given = ("--poses", ORBIT, "--camera", "camera.json", *search(file))
    code, out, error = run("render", file, *given, "--out", tmp_path / "render")
    assert (code, error) == (0, "") and out.count("frames: 3, shards: 1, ") == 2
    code, _, error = run("batch", file, *given, "--out", tmp_path / "batch")
    assert (code, error) == (0, "")
    names = ("render/npz/shard-000000.npz", "batch/shard-000000.npz")
    depths = [np.load(tmp_path / name)["depth"] for name in names]
    np.testing.assert_array_equal(*depths)
    assert np.isfinite(depths[0][:, 6, 8]).all()
    code, out, error = run("check", file, *given)
    assert (code, error) == (0, "") and "visible" in out
    code, out, error = run("info", file, *search(file))
    assert (code, error) == (0, "") and f"{file}: " in out and " up, " in out
    eyes = ("--robot", "-4 0 1 0 0 0.5", "--human", "-4 1 1 0 0 0.5")
    code, out, error = run("perspective", file, *eyes, "--camera", "camera.json", *search(file))
    assert (code, error) == (0, "") and "The robot sees all of them." in out


@pytest.mark.parametrize("command", ["render", "check", "batch"])
@pytest.mark.parametrize("poses", ["poses.txt", "poses.npy", "poses.npz", "poses.csv", "transforms.json"])
def test_every_command_accepts_every_pose_format(run, tmp_path, command, poses):
    out = tmp_path / ("report.json" if command == "check" else "out")
    code, _, error = run(command, "room.stl", "--poses", poses, "--camera", "camera.json", "--out", out)
    assert (code, error) == (0, "")
    expected = np.load("poses.npy")
    if command == "check":
        found = [view["pose"] for view in json.loads(out.read_text())["views"]]
    else:
        found = np.load(out / ("npz" if command == "render" else "") / "shard-000000.npz")["camera_to_world"]
    np.testing.assert_allclose(np.abs(found), np.abs(expected), atol=1e-6)  # a quaternion and its negative are equal


def test_labels_up_axis_and_scale_options(run, tmp_path):
    given = ("--poses", "poses.txt", "--camera", "camera.json", "--labels", "room=human", "--up", "y", "--scale", "2")
    outputs = ("--outputs", "depth,labels", "--out", tmp_path)
    assert run("render", "room.stl", *given, *outputs)[0] == 0
    found = np.load(tmp_path / "npz" / "shard-000000.npz")
    assert set(np.unique(found["labels"])) == {0, int(wv.Label.HUMAN)}
    assert found["depth"][0, 6, 8] == pytest.approx(3)
    assert "room    human" in run("info", "room.stl", "--labels", "room=human")[1]


def test_worlds_in_every_command(run, tmp_path):
    """In the first frame's world the box is far away, in the second it is at its initial pose."""
    given = ("room.stl", "--poses", "poses.npy", "--camera", "camera.json", "--movable", "r*", "--worlds", "worlds.npz")
    assert run("render", *given, "--out", tmp_path / "out")[0] == 0
    depth = np.load(tmp_path / "out" / "npz" / "shard-000000.npz")["depth"]
    assert np.isfinite(depth[0]).sum() == 0 < np.isfinite(depth[1]).sum()
    picture = tmp_path / "first.png"
    code, out, _ = run("check", *given, "--picture", picture)
    assert code == 0 and picture.is_file()
    assert [line.split()[2] for line in out.splitlines()[2:4]] == ["0.00", "1.00"]
    (tmp_path / "points.txt").write_text("-0.5 0 0\n")
    code, out, _ = run("check", *given, "--points", tmp_path / "points.txt", "--tolerance", "0.001")
    assert code == 0


@pytest.mark.slow
def test_wxyz_quaternions_in_every_command(run, tmp_path):
    given = ("room.stl", "--camera", "camera.json", "--movable", "r*", "--worlds")
    for command in ("render", "batch", "check"):
        found = {}
        for poses, worlds, *order in (
            ("poses.npy", "worlds.npz"),
            ("w_first.npy", "w_first.npz", "--quaternion", "wxyz"),
            ("poses.txt", "w_first.npz", "--quaternion", "wxyz"),  # the format defines the order
        ):
            out = tmp_path / f"{command}_{poses}_{worlds}"
            more = ("--out", out) if command != "check" else ()
            code, said, error = run(command, *given, worlds, "--poses", poses, *order, *more)
            assert (code, error) == (0, "" if command == "check" else "warning: 1 of 2 frames sees nothing\n")
            file = out / ("npz" if command == "render" else "") / "shard-000000.npz"
            found[poses] = said if command == "check" else np.load(file)["depth"].tolist()
        assert found["poses.npy"] == found["w_first.npy"] == found["poses.txt"]
    eyes = {"xyzw": np.load("poses.npy")[0], "wxyz": np.load("one.npy")[0]}
    reports = []
    for order, row in eyes.items():
        pose = " ".join(map(repr, row.tolist()))
        for human in (pose, "one.npy") if order == "wxyz" else (pose,):
            call = ("perspective", "room.stl", "--camera", "camera.json", "--robot", pose, "--human", human)
            code, _, error = run(*call, "--quaternion", order, "--out", tmp_path / "seen")
            assert (code, error) == (0, "")
            reports.append((tmp_path / "seen" / "perspective.json").read_text())
    assert len(reports) == 3 and len(set(reports)) == 1


def test_every_command_accepts_experiments(run, tmp_path):
    code, out, error = run("info", "experiment_3")
    assert (code, error) == (0, "") and "experiment_3: z up, 6 objects" in out and "ball " in out
    given = ("experiment_3", "--poses", "orbit target=0,0,0.5 radius=1.9 height=1 count=2", "--camera", "camera.json")
    assert run("render", *given, "--out", tmp_path / "render")[0] == 0
    assert run("batch", *given, "--out", tmp_path / "batch")[0] == 0
    names = ("render/npz/shard-000000.npz", "batch/shard-000000.npz")
    depths = [np.load(tmp_path / name)["depth"] for name in names]
    np.testing.assert_array_equal(*depths)
    assert np.isfinite(depths[0]).any()
    code, out, error = run("check", *given, "--objects", "ball")
    assert (code, error) == (0, "") and "ball" in out


def test_movable_model_selects_the_models_movable_bodies(run, tmp_path):
    """`model` selects the model's movable bodies; a pattern selects an object of that name."""
    given = ("--poses", "poses.npy", "--camera", "camera.json", "--worlds", "worlds.npz")
    assert run("render", "room.xml", *given, "--movable", "model", "--out", tmp_path / "out")[0] == 0
    depth = np.load(tmp_path / "out" / "npz" / "shard-000000.npz")["depth"]
    assert (depth[0] > depth[1]).any()
    (tmp_path / "model.stl").write_bytes(trimesh.creation.box().export(file_type="stl"))
    code, _, error = run("check", tmp_path / "model.stl", *given, "--movable", "model")
    assert code == 2 and "it defines no moving objects; name those that are movable" in error
    assert run("check", tmp_path / "model.stl", *given, "--movable", "[m]odel")[0] == 0


def test_render_checks_all_formats_before_it_writes(run, tmp_path):
    given = ("render", "room.stl", "--poses", ORBIT, "--out", tmp_path / "out")
    for more, said in (
        (("--outputs", "points"), "for format 'png', got 'points'"),
        (("--format", "npz,tiff"), "format must be one of"),
        (("--option", "speed=5"), "format 'npz' has no option 'speed'"),
        (("--option", "scale=0"), "option scale must be a positive number, got '0'"),
        (("--format", "nerfstudio", "--outputs", "depth"), "outputs must include color for format 'nerfstudio'"),
    ):
        code, _, error = run(*given, *more)
        assert code == 2 and said in error and not (tmp_path / "out").exists()
    (tmp_path / "out" / "png").mkdir(parents=True)
    (tmp_path / "out" / "png" / "mine").write_text("")
    code, _, error = run(*given)
    assert code == 2 and "png: exists already" in error and not (tmp_path / "out" / "npz").exists()
    assert run(*given, "--format", "tum")[0] == 0
    assert (tmp_path / "out" / "tum" / "depth.txt").is_file()


def test_render_passes_options_to_the_formats_that_have_them(run, tmp_path):
    given = ("render", "room.stl", "--poses", ORBIT, "--outputs", "color,depth")
    options = ("--format", "npz,png,tum", "--option", "scale=100,color=jpeg")
    assert run(*given, *options, "--out", tmp_path / "out")[0] == 0
    manifests = {
        path.parent.name: json.loads(path.read_text())["options"] for path in tmp_path.glob("out/*/manifest.json")
    }
    assert manifests == {"npz": {}, "png": {"color": "jpeg", "scale": "100"}, "tum": {"color": "jpeg"}}
    assert list((tmp_path / "out/png/color/000000").glob("*.jpg"))
    assert list((tmp_path / "out/tum/rgb/000000").glob("*.jpg"))


NO_EFFECT = {
    "tolerance": (
        ("check", "room.stl", "--poses", ORBIT, "--tolerance", "1"),
        "without --points, give no --tolerance",
    ),
    "convention": (
        ("check", "room.stl", "--poses", ORBIT, "--convention", "opengl"),
        "generated poses take no --convention",
    ),
    "topic": (
        ("render", "room.stl", "--poses", "poses.npy", "--topic", "/tf", "--out", "x"),
        "--topic is for ROS bags",
    ),
    "movable": (("check", "room.stl", "--poses", ORBIT, "--movable", "room"), "--movable has no effect without poses"),
    "worlds": (("check", "room.stl", "--poses", "poses.npy", "--worlds", "worlds.npz"), "has 0 that are movable"),
    "search path": (("info", "room.stl", "--search-path", "lib"), "its geometry is in a single file"),
    "scale": (("check", "room.xml", "--poses", ORBIT, "--scale", "2"), "leave out scale and file_up"),
    "file_up": (("check", "world.wbt", "--poses", ORBIT, "--file-up", "y"), "leave out scale and file_up"),
    "quaternion of what is made": (
        ("check", "room.stl", "--poses", ORBIT, "--quaternion", "wxyz"),
        "generated poses take no --quaternion",
    ),
    "quaternion of TUM": (
        ("check", "room.stl", "--poses", "poses.txt", "--quaternion", "wxyz"),
        "poses in poses.txt, whose format defines the order, take no --quaternion",
    ),
    "quaternion of a gaze": (
        ("perspective", "room.stl", "--robot", "0 0 3 0 0 0", "--human", "0 3 3 0 0 0", "--quaternion", "wxyz"),
        "take no --quaternion",
    ),
    "quaternion of a device": (
        ("render", "world.wbt", "--quaternion", "wxyz", "--out", "x"),
        "a world's devices have their own poses: give no --quaternion",
    ),
    "labels of an experiment": (
        ("info", "experiment_2", "--labels", "ball=human"),
        "experiment_2 is not a file, so it takes no --labels",
    ),
    "movables of an experiment": (
        ("check", "experiment_2", "--poses", "poses.npy", "--movable", "ball", "--worlds", "worlds.npz"),
        "experiment_2 has no movable objects, so it takes no --movable",
    ),
    "device name": (
        ("render", "world.wbt", "--poses", ORBIT, "--device-name", "eye", "--out", "x"),
        "with --poses or --frame no device is rendered: give no --device-name",
    ),
    "experiment": (("perspective", "experiment_1", "--strict"), "so it takes no --strict"),
    "labels": (("info", "--labels", "a=human"), "info of this machine takes no --labels"),
    "other XML": (
        ("info", "scene.xml"),
        "scene.xml: must be MJCF, which begins with <mujoco>, or URDF, with <robot>, got XML of <scene>",
    ),
    "missing mesh": (("info", "cart.urdf", "--strict"), "skipped package://far/box.stl"),
    "nothing left": (("info", "cart.urdf"), "cart.urdf: skipped package://far/box.stl"),
}


@pytest.mark.parametrize("case", NO_EFFECT)
def test_options_without_effect_raise(run, folder, case):
    command, said = NO_EFFECT[case]
    before = sorted(folder.iterdir())
    code, out, error = run(*command)
    assert code == 2 and out == "" and said in error
    assert error.startswith("warpvis: ") and error.count("\n") == 1
    assert sorted(folder.iterdir()) == before


def test_warnings_are_one_line(run, folder):
    (folder / "two.urdf").write_text(
        URDF.replace("</link>", '<visual><geometry><box size="1 1 1"/></geometry></visual></link>')
    )
    code, out, error = run("info", "two.urdf")
    (folder / "two.urdf").unlink()
    assert code == 0 and "cart    robot" in out
    assert error.startswith("warning: two.urdf: skipped package://far/box.stl, whose files") and error.count("\n") == 1
