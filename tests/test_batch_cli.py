# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The commands batch, verify and warmup: output, messages, and errors of one sentence."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from batch_jobs import CAMERA, make_poses, make_scene, tree
from command_line import run_apart, run_inside

import warpvis as wv
from warpvis.cli import Batch, Verify

ORBIT = "orbit target=0,0,0.4 radius=3 height=1 count=9"


@pytest.fixture
def workspace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make_scene().export("scene.glb")
    fields = {"width": 32, "height": 24, "hfov": 1.0, "near": 0.3, "far": 4.5}
    (tmp_path / "camera.json").write_text(json.dumps(fields))
    lines = [f"{k} " + " ".join(map(str, pose)) for k, pose in enumerate(make_poses(9))]
    (tmp_path / "poses.txt").write_text("\n".join(lines) + "\n")
    (tmp_path / "broken.txt").write_text(lines[0] + "\n1 2 3\n")
    (tmp_path / "none.txt").write_text("# nothing\n")
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "thesis.tex").write_text("mine")
    (tmp_path / "file").write_text("in the way")
    np.savez(tmp_path / "worlds.npz", object_poses=np.tile([0, 0, 0.5, 0, 0, 0, 1.0], (9, 1, 1)))
    np.savez(tmp_path / "two.npz", object_poses=np.tile([0, 0, 0.5, 0, 0, 0, 1.0], (9, 2, 1)))
    np.savez(tmp_path / "empty.npz", world_index=np.zeros(9, dtype=np.int32))
    return tmp_path


def cli(*arguments):
    return run_inside(*arguments, cwd=".")


def test_singular_messages_and_file_instead_of_folder(workspace):
    """With one frame, one triangle and one process, messages use the singular."""
    from warpvis.batch import verify
    from warpvis.core.checks import pluralize

    assert [pluralize(count, "frame") for count in (0, 1, 2)] == ["0 frames", "1 frame", "2 frames"]
    scene = wv.Scene()
    scene.add(([[-1, -1, 2], [1, -1, 2], [0, 1, 2]], [[0, 1, 2]]), name="triangle")
    assert repr(scene) == "Scene(1 object, 1 triangle, device='cpu')"
    given = scene, wv.Camera.from_fov(8, 8, hfov=1.0), [[0.0, 0, 0, 0, 0, 0, 1]]
    wv.render_batch(*given, "one")
    assert ": 1 frame, npz: depth>" in repr(wv.open_dataset("one"))
    (workspace / "one" / "shards" / "000000.json").unlink()
    assert verify("one").problems[0] == "1 of 1 shard is missing: 0"
    for out in ("file", "file/below"):
        with pytest.raises(wv.errors.FileFormatError, match=r"^file: is a file, but a dataset must be a folder$"):
            wv.render_batch(*given, out)
    with pytest.warns(UserWarning, match=r"^1 of 2 frames sees nothing$"):
        wv.render_batch(*given[:2], [given[2][0], wv.look_at((0, 0, 0), (1, 0, 0))], "two")


def test_job_from_the_command_line(workspace):
    job = ("batch", "scene.glb", "--poses", ORBIT, "--camera", "camera.json", "--out", "out", "--shard-frames", "4")
    first = run_apart(*job, cwd=workspace)
    assert first.returncode == 0, first.stderr
    assert first.stdout.startswith("frames: 9, shards: 3, ")
    assert "9 of them rendered in" in first.stdout and "frames/s" in first.stdout
    before = tree(workspace / "out")
    second = cli(*job)
    assert second.returncode == 2
    assert "out: contains a complete dataset. Pass a new or an empty folder." in second.stderr
    assert "Traceback" not in second.stderr
    third = cli(*job, "--resume")
    assert third.returncode == 0 and "nothing was left to do" in third.stdout
    assert tree(workspace / "out") == before

    sound = cli("verify", "out")
    assert sound.returncode == 0
    assert "out: complete and intact: 3 of 3 shards (npz, 9 frames), 7 files" in sound.stdout.replace("\n", " ")
    shard = workspace / "out" / "shard-000001.npz"
    data = bytearray(shard.read_bytes())
    data[1000] ^= 1
    shard.write_bytes(data)
    damaged = cli("verify", "out")
    assert damaged.returncode == 1
    assert "shard-000001.npz: its checksum differs from the recorded one" in damaged.stdout
    assert (
        "damaged shards: shards/000001.json; the batch command with --resume --repair renders them again"
        in damaged.stdout
    )
    trusting = cli(*job, "--resume")
    assert "9 of them existed: their sizes are correct; --repair reads them" in trusting.stdout
    (workspace / "scene.glb").rename(workspace / "renamed.glb")
    repairing = cli(job[0], "renamed.glb", *job[2:], "--resume", "--repair")
    assert "5 of them existed: their checksums are correct" in repairing.stdout
    assert "4 of them rendered in" in repairing.stdout
    assert tree(workspace / "out") == before


def batch(poses="poses.txt", out="out", **options):
    options = {"camera": "camera.json", "quiet": True, **options}
    Batch(file=Path(options.pop("file", "scene.glb")), poses=poses, out=out, **options).run()


def test_poses_from_a_file_and_outputs(workspace):
    batch(outputs=("depth,labels",), labels=("ball=human",), exclude=("box",))
    scene = wv.Scene.load("scene.glb", labels={"ball": "human"})
    poses = np.loadtxt("poses.txt")[:, 1:]
    views = wv.render(scene, CAMERA, poses, outputs=("depth", "labels"), exclude=["box"])
    found = np.load("out/shard-000000.npz")
    np.testing.assert_array_equal(found["depth"], views.depth.numpy())
    np.testing.assert_array_equal(found["labels"], views.labels.numpy())
    manifest = json.loads((workspace / "out" / "manifest.json").read_text())
    assert manifest["scene"]["file"] == "scene.glb" and manifest["exclude"] == ["box"]


def test_worlds_from_a_file(workspace):
    batch(movable=("ball",), worlds=Path("worlds.npz"), outputs=("depth", "segmentation"))
    scene = wv.Scene()
    for item in wv.Scene.load("scene.glb"):
        height = 0.5 if item.name == "ball" else 0.0
        scene.add((item.vertices + [0, 0, height], item.faces), name=item.name)
    views, found = wv.render(scene, CAMERA, make_poses(9)), np.load("out/shard-000000.npz")
    assert (found["segmentation"] == views.segmentation.numpy()).mean() > 0.999
    np.testing.assert_allclose(found["depth"], views.depth.numpy(), rtol=1e-5)
    assert (found["segmentation"] == scene.index("ball")).any()


BAD = {
    "line": ({"poses": "broken.txt"}, r"^broken.txt:2: expected the 8 numbers"),
    "no poses": ({"poses": "none.txt"}, r"^none.txt: holds no"),
    "missing": ({"poses": "nowhere.txt"}, r"^nowhere.txt: no such file"),
    "spec": ({"poses": "orbit target=0,0,0 speed=3"}, "speed"),
    "no scene": ({"file": "nowhere.glb"}, "^nowhere.glb: no such file"),
    "folder": ({"out": "taken"}, r"taken: contains other files \(thesis.tex\)"),
    "resumed folder": ({"out": "taken", "resume": True}, r"taken: contains other files \(thesis.tex\)"),
    "file": ({"out": "file"}, "file: is a file, but a dataset must be a folder"),
    "format": ({"format": "tiff"}, "^format must be one of npz, zarr, .*, got 'tiff'"),
    "output": ({"outputs": ("depth,tint",)}, "^outputs must be some of depth, .*, got tint"),
    "option": ({"option": ("fast",)}, "^--option must be given as KEY=VALUE, .*, got 'fast'"),
    "unknown option": ({"option": ("fast=1",)}, "format 'npz' has no option 'fast'"),
    "camera": ({"camera": "lens"}, "lens: no such file; a camera is"),
    "device": ({"device": "cuda:99"}, "device 'cuda:99' is not on this machine"),
    "labels": ({"labels": ("cat=human",)}, "labels for 'cat' fit no object"),
    "movable": (
        {"movable": ("cat",)},
        "movable 'cat' matches no object of scene.glb, which has 'floor', 'box', 'ball'",
    ),
    "movable without worlds": (
        {"movable": ("ball",)},
        "--movable has no effect without poses of objects: give --worlds",
    ),
    "worlds without movable": (
        {"worlds": Path("worlds.npz")},
        "poses of 1 object, but the scene has 0 that are movable",
    ),
    "spec in axes": ({"poses": ORBIT, "convention": "opengl"}, "generated poses take no --convention"),
    "spec of a topic": ({"poses": ORBIT, "topic": "/tf"}, "generated poses take no --topic"),
    "topic": ({"topic": "/tf"}, "topic= is for ROS bags"),
    "search path": ({"search_path": (Path("taken"),)}, "its geometry is in a single file; leave out search_path"),
    "worlds": (
        {"movable": ("ball",), "worlds": Path("two.npz")},
        "the frames have poses of 2 objects, but the scene has 1",
    ),
    "no worlds": ({"worlds": Path("empty.npz")}, "^empty.npz: expected an array object_poses, got world"),
    "no npz": ({"worlds": Path("poses.txt")}, "^poses.txt: cannot be read as NPZ: "),
    "url": ({"out": "nosuch://bucket/name"}, "^nosuch://bucket/name: cannot be opened: "),
}


@pytest.mark.parametrize("case", BAD)
def test_invalid_input_raises_one_sentence_and_writes_nothing(workspace, case):
    given, message = BAD[case]
    before = tree(workspace)
    with pytest.raises(wv.WarpvisError, match=message) as caught:
        batch(**given)
    assert "\n" not in str(caught.value)
    assert tree(workspace) == before


def test_invalid_input_exits_2(workspace):
    result = cli("batch", "scene.glb", "--poses", "broken.txt", "--out", "out")
    assert result.returncode == 2
    assert [line for line in result.stderr.splitlines() if line.startswith("warpvis: broken.txt:2: expected the 8")]
    assert "Traceback" not in result.stderr and not (workspace / "out").exists()


def test_verify_of_a_folder_without_manifest_raises(workspace):
    with pytest.raises(wv.errors.FileFormatError, match=r"taken: is not a dataset: it has no manifest.json of warpvis"):
        Verify("taken").run()


@pytest.mark.parametrize(
    "manifest",
    [{}, {"format": "npz", "frames": 9, "shard_frames": 0, "poses": {"sha256": ""}}, {"format": "npz", "frames": "9"}],
)
def test_verify_of_an_incomplete_manifest_raises(tmp_path, manifest):
    (tmp_path / "manifest.json").write_text(json.dumps({"warpvis_dataset": 1, **manifest}))
    with pytest.raises(
        wv.errors.FileFormatError, match=r"is not a dataset: its manifest.json does not define the contents"
    ):
        Verify(str(tmp_path)).run()


@pytest.mark.slow
def test_interrupted_job_prints_how_to_resume(workspace):
    many = ORBIT.replace("count=9", "count=100000")
    assert many != ORBIT
    command = ("batch", "scene.glb", "--poses", many, "--camera", "camera.json", "--out", "out", "--shard-frames", "4")
    job = subprocess.Popen([sys.executable, "-m", "warpvis", *command], stderr=subprocess.PIPE, text=True)
    while not (workspace / "out" / "shards").is_dir() and job.poll() is None:
        time.sleep(0.05)
    job.send_signal(signal.SIGINT)
    errors = job.communicate()[1]
    assert job.returncode == 130 and "the same command with --resume continues out" in errors
    assert "Traceback" not in errors and not list((workspace / "out").glob(".part*"))
