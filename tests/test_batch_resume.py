# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""An interrupted batch job writes the same bytes after resuming as an uninterrupted one."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from batch_jobs import make_frames, make_poses, make_scene, run, tree

import warpvis as wv
from warpvis.batch import FrameRenderer, verify
from warpvis.cameras.frames import Frames

TESTS = Path(__file__).parent


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return an uninterrupted dataset."""
    out = tmp_path_factory.mktemp("whole") / "data"
    run(out)
    return out


def die_at(call, out):
    """Run a job in a child that exits at its `call`-th file move, as by SIGKILL; return whether it did."""
    child = os.fork()
    if child == 0:
        replace, calls = os.replace, 0

        def dying_replace(*paths):
            nonlocal calls
            calls += 1
            if calls > call:
                os._exit(9)
            replace(*paths)

        try:
            os.replace = dying_replace
            run(out, resume=True)
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_killed_at_every_step(tmp_path, whole):
    out = tmp_path / "out"
    deaths = 0
    while die_at(deaths % 4, out):
        deaths += 1
    assert deaths >= 8
    assert tree(out) == tree(whole)
    assert not list(out.glob(".part-*"))


_JOB = """
import sys
sys.path.insert(0, sys.argv[1])
from batch_jobs import make_frames, run
print("begins", flush=True)
run(sys.argv[2], frames=make_frames(900), resume=True, format="zarr")
"""


@pytest.mark.slow
def test_killed_at_any_moment(tmp_path):
    pytest.importorskip("zarr")
    out, random = tmp_path / "out", np.random.default_rng(os.getpid())
    run(tmp_path / "whole", frames=make_frames(900), format="zarr")
    for _ in range(2):
        process = subprocess.Popen([sys.executable, "-c", _JOB, TESTS, out], stdout=subprocess.PIPE)
        process.stdout.readline()
        time.sleep(random.uniform(0, 0.6))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert process.returncode == -signal.SIGKILL
    before = len(list(out.glob("shards/*")))
    summary = run(out, frames=make_frames(900), resume=True, format="zarr")
    assert before < 300 and summary.rendered_frames >= 3 * (300 - before)
    assert tree(out) == tree(tmp_path / "whole")


def test_damaged_shards_are_rendered_again(tmp_path, whole):
    out = tmp_path / "out"
    shutil.copytree(whole, out)
    (out / "shards" / "000001.json").unlink()
    (out / "shards" / "000003.json").write_text("{}")
    (out / "shard-000005.npz").write_bytes(b"short")
    (out / "poses.npz").unlink()
    assert not verify(out).ok
    assert run(out, resume=True).rendered_frames == 9
    assert tree(out) == tree(whole)
    assert run(out, resume=True).rendered_frames == 0


def changed_scene():
    scene = wv.Scene()
    for item in make_scene().objects:
        factor = 1.5 if item.name == "ball" else 1.0
        scene.add((item.vertices, item.faces), name=item.name, label=item.label, scale=factor)
    return scene


CHANGES = {
    "camera": ({"camera": wv.Camera.from_fov(16, 24, hfov=1.0)}, "camera's width was 32 and is 16; .*far was 4.5 and"),
    "ball": ({"scene": changed_scene()}, "the scene's object 'ball' differs$"),
    "movable": ({"scene": make_scene(movable=True)}, r"'ball' differs \(movable False to True\); the poses differ"),
    "poses": ({"frames": make_frames(21)}, "frames was 20 and is 21; the poses differ"),
    "seed": ({"frames": Frames.from_poses(make_poses(20), source={"seed": 4})}, "seed was 3 and is 4"),
    "outputs": ({"outputs": ["labels"]}, r'outputs were \["depth"\] and are \["labels"\]'),
    "format": ({"format": "zarr"}, 'format was "npz" and is "zarr"'),
    "shards": ({"shard_frames": 5}, "shard_frames was 3 and is 5"),
}


@pytest.mark.parametrize("case", CHANGES)
def test_resuming_with_other_input_raises(whole, case):
    change, message = CHANGES[case]
    if case == "format":
        pytest.importorskip("zarr")
    before = tree(whole)
    with pytest.raises(wv.errors.FileFormatError, match=f"cannot be resumed because .*: .*{message}"):
        run(whole, resume=True, **change)
    assert tree(whole) == before


@pytest.mark.parametrize("objects", [[], {"floor": 1}])
def test_resuming_with_invalid_objects_in_the_manifest_raises(tmp_path, whole, objects):
    shutil.copytree(whole, tmp_path / "out")
    manifest = json.loads((whole / "manifest.json").read_text())
    manifest["scene"]["objects"] = objects
    (tmp_path / "out" / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(wv.errors.FileFormatError, match=r"cannot be resumed because .*scene's object"):
        run(tmp_path / "out", resume=True)


def test_non_empty_folders_raise(tmp_path, whole):
    with pytest.raises(wv.errors.FileFormatError, match=r"contains a complete dataset\. Pass a new or an empty folder"):
        run(whole)
    (tmp_path / "thesis.tex").write_text("mine")
    for resume in (False, True):
        with pytest.raises(
            wv.errors.FileFormatError, match=r"contains other files \(thesis.tex\). Pass a new or an empty"
        ):
            run(tmp_path, resume=resume)
        with pytest.raises(wv.errors.FileFormatError, match="is a file, but a dataset must be a folder"):
            run(tmp_path / "thesis.tex", resume=resume)
    assert os.listdir(tmp_path) == ["thesis.tex"]
    begun = tmp_path / "begun"
    shutil.copytree(whole, begun)
    (begun / "index.json").unlink()
    with pytest.raises(wv.errors.FileFormatError, match=r"an unfinished dataset\. Use resume=True to resume it"):
        run(begun)


def test_second_writer_raises(tmp_path):
    fcntl = pytest.importorskip("fcntl")
    (tmp_path / "out").mkdir()
    holder = os.open(tmp_path / "out", os.O_RDONLY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    with pytest.raises(wv.errors.FileFormatError, match="another process is writing it"):
        run(tmp_path / "out")
    os.close(holder)
    assert os.listdir(tmp_path / "out") == []


def test_full_disk(tmp_path, monkeypatch, whole):
    room = 70_000
    write = os.write

    def write_a_little(descriptor, data):
        nonlocal room
        if room <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        room -= len(data)
        return write(descriptor, data)

    monkeypatch.setattr(os, "write", write_a_little)
    with pytest.raises(
        wv.errors.FileFormatError, match=r"cannot be written: No space left on device; \d of 7 shards are complete"
    ):
        run(tmp_path / "out")
    monkeypatch.undo()
    assert not list((tmp_path / "out").glob(".part-*"))
    report = verify(tmp_path / "out")
    assert 0 < report.whole_shards < 7
    assert all("missing" in problem for problem in report.problems)
    run(tmp_path / "out", resume=True)
    assert tree(tmp_path / "out") == tree(whole)


def test_missing_permission(tmp_path):
    place = Path("/sys/warpvis") if os.geteuid() == 0 else tmp_path / "locked" / "out"
    if os.geteuid() != 0:
        (tmp_path / "locked").mkdir(mode=0o500)
    with pytest.raises(
        wv.errors.FileFormatError, match=r"cannot be written: (Operation not permitted|Permission denied)$"
    ):
        run(place)


def test_interrupt_keeps_complete_shards(tmp_path, monkeypatch, whole):
    rendered = []
    render = FrameRenderer.render

    def interrupted(self, *arguments, **given):
        rendered.append(None)
        if len(rendered) == 4:
            raise KeyboardInterrupt
        return render(self, *arguments, **given)

    monkeypatch.setattr(FrameRenderer, "render", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "out")
    monkeypatch.undo()
    assert sorted(os.listdir(tmp_path / "out" / "shards")) == ["000000.json", "000001.json", "000002.json"]
    assert not list((tmp_path / "out").glob(".part-*"))
    run(tmp_path / "out", resume=True)
    assert tree(tmp_path / "out") == tree(whole)
