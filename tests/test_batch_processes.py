# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Encoding processes: same bytes as threads, one error if a process dies, and none that outlives its job."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from batch_jobs import make_frames, run, tree

import warpvis as wv
from warpvis.batch import _writer as writer
from warpvis.batch._encoding import EncodingProcesses, shards_at_once
from warpvis.batch.engines._local import _incoming

pytestmark = pytest.mark.skipif(
    not hasattr(os, "memfd_create") or not Path("/proc/self/stat").exists(), reason="needs Linux"
)

SCRIPT = """
import sys
sys.path.insert(0, {tests!r})
from batch_jobs import make_frames, run
run({out!r}, frames=make_frames(1000), threads=8, format="png")
"""  # typical user script: no guard against being run again on import


@pytest.fixture
def started(monkeypatch):
    """Collect the started process pools, also for jobs with few shards."""
    found, start = [], EncodingProcesses.__init__

    def note(self, target, count):
        start(self, target, count)
        found.append(self)

    monkeypatch.setattr(writer, "_MIN_SHARDS", 1)
    monkeypatch.setattr(EncodingProcesses, "__init__", note)
    return found


def children(parent):
    """Return the encoding processes of another process."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            mine = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1]) == parent
            if mine and b"batch._encoding import main" in (folder / "cmdline").read_bytes():
                found.append(int(folder.name))
        except OSError:  # it has just ended
            continue
    return found


def test_process_count_by_threads(tmp_path, monkeypatch):
    counts = []

    def note(self, target, count):
        counts.append(count)
        raise RuntimeError("stopped")

    monkeypatch.setattr(writer, "_MIN_SHARDS", 1)
    monkeypatch.setattr(EncodingProcesses, "__init__", note)
    for threads in (1, 4, 7):
        run(tmp_path / f"{threads}", threads=threads, format="png")
    for threads in (8, 16, 33):
        with pytest.raises(RuntimeError, match="stopped"):
            run(tmp_path / f"{threads}", threads=threads, format="png")
    assert counts == [2, 4, 8]
    assert [shards_at_once(threads) for threads in (7, 16)] == [0, 8]


@pytest.mark.slow
@pytest.mark.parametrize("name, options", [("zarr", {"compression": "zstd"}), ("bop", {}), ("png", {})])
def test_bytes_equal_those_of_one_thread(tmp_path, started, name, options):
    if name == "zarr":
        pytest.importorskip("zarr")
    run(tmp_path / "one", threads=1, format=name, options=options)
    assert not started
    run(tmp_path / "many", threads=8, format=name, options=options)
    assert len(started) == 1
    assert tree(tmp_path / "many") == tree(tmp_path / "one")
    assert not children(os.getpid())


@pytest.mark.slow
def test_uneven_shards_warnings_and_empty_frames(tmp_path, started):
    """The last shard is smaller, warnings and empty frames are counted, and poses are passed through shared memory."""
    poses = make_frames(11).camera_to_world.copy()
    poses[[2, 7]] = [wv.look_at(pose[:3], 3 * pose[:3]) for pose in poses[[2, 7]]]
    frames, options = wv.Frames.from_poses(poses), {"scale": 30_000}
    with pytest.warns(UserWarning, match="^2 of 11 frames see nothing$"):
        one = run(tmp_path / "one", frames=frames, threads=1, format="png", options=options, shard_frames=4)
    with pytest.warns(UserWarning, match="^2 of 11 frames see nothing$"):
        many = run(tmp_path / "many", frames=frames, threads=8, format="png", options=options, shard_frames=4)
    assert started and many.warnings == one.warnings and sum(one.warnings.values()) > 0
    assert tree(tmp_path / "many") == tree(tmp_path / "one")


def test_processes_are_not_started_when_not_needed(tmp_path, started, monkeypatch):
    run(tmp_path / "raw", threads=8, format="npz")
    pytest.importorskip("fsspec")
    run("memory://processes/job", threads=8, format="png")
    monkeypatch.setattr(writer, "_MIN_SHARDS", 16)
    run(tmp_path / "few", threads=8, format="png")
    assert not started


@pytest.mark.slow
def test_killed_process_raises_and_the_job_can_be_resumed(tmp_path, started):
    out, frames = tmp_path / "out", make_frames(240)

    def kill():
        while not (out / "shards").is_dir() or len(os.listdir(out / "shards")) < 5:
            time.sleep(0.002)
        os.kill(children(os.getpid())[0], signal.SIGKILL)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    with pytest.raises(wv.errors.FileFormatError, match=r"an encoding process ended with exit code -9; \d+ of 80 "):
        run(out, frames=frames, threads=8, format="png")
    killer.join()
    assert not children(os.getpid()) and not list(out.glob(".part-*"))
    run(out, frames=frames, threads=2, format="png", resume=True)
    run(tmp_path / "whole", frames=frames, threads=2, format="png")
    assert tree(out) == tree(tmp_path / "whole")


@pytest.mark.slow
def test_write_failure_raises_once(tmp_path, started):
    out = tmp_path / "out"
    run(out, threads=1, format="png")
    (out / "shards" / "000003.json").unlink()
    (out / "index.json").unlink()
    for path in sorted((out / "depth").rglob("*"), reverse=True):
        path.unlink() if path.is_file() else path.rmdir()
    (out / "depth").rmdir()
    (out / "depth").write_text("in the way")
    with pytest.raises(wv.errors.FileFormatError, match=r"out: cannot be written: (File exists|Not a directory); 0 of"):
        run(out, threads=8, format="png", resume=True)
    assert len(started) == 1 and not children(os.getpid())


@pytest.mark.slow
def test_no_process_outlives_a_killed_job(tmp_path):
    """A script without a main guard."""
    out = tmp_path / "out"
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(tests=str(Path(__file__).parent), out=str(out)))
    job = subprocess.Popen([sys.executable, script], stdout=subprocess.DEVNULL)
    try:
        while not (out / "shards").is_dir() or len(os.listdir(out / "shards")) < 20:
            assert job.poll() is None
            time.sleep(0.01)
        found = children(job.pid)
    finally:
        job.kill()
        job.wait()
    assert len(found) == 2
    deadline = time.monotonic() + 20
    while any(Path(f"/proc/{process}").exists() for process in found) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not any(Path(f"/proc/{process}").exists() for process in found)


def test_poses_are_mapped_not_copied(tmp_path):
    from warpvis.batch import find_format, make_plan
    from warpvis.batch._encoding import Target, _share as share, unshare

    scene = wv.Scene()
    scene.add((np.eye(3), [[0, 1, 2]]), name="triangle")
    frames = wv.Frames.from_poses(np.tile([0.0, 1, 2, 0, 0, 0, 1], (50_000, 1)))
    plan = make_plan(scene, wv.Camera.kinect(), frames, find_format("png"))
    descriptor, sizes, data = share(Target(plan, "png", str(tmp_path)))
    try:
        assert len(data) < 20_000 < 50_000 * 56 <= sum(sizes)
        there = unshare(descriptor, sizes, data).plan
        np.testing.assert_array_equal(there.frames.camera_to_world, plan.frames.camera_to_world)
        np.testing.assert_array_equal(there.frames.timestamps, plan.frames.timestamps)
        assert there.camera == plan.camera and there.shard_frames == plan.shard_frames
    finally:
        os.close(descriptor)


def test_ending_process_takes_no_more_shards():
    """SIGTERM sets an event: an exception raised by a handler is lost during a Python callback."""
    ours, theirs = multiprocessing.Pipe()
    ending = threading.Event()
    for shard in range(3):
        ours.send(shard)
    taken = []
    for shard in _incoming(theirs, threading.Event(), ending):
        taken.append(shard)
        ending.set()
    assert taken == [0]
