# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Batch rendering with Ray: same bytes as the local engine, also if a worker is killed."""

import os
import shutil
import signal
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest
from batch_jobs import make_frames, make_scene, run, tree

import warpvis as wv

ray = pytest.importorskip("ray")

pytestmark = pytest.mark.slow
SHARDS = 200


@pytest.fixture(scope="module")
def cluster():
    """Start a cluster of two cores on any machine."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    yield
    ray.shutdown()


def ancestors(process):
    while process > 1:
        yield process
        process = int(Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[1])


def workers():
    """Return the ids of the rendering processes of this test's cluster."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            command = (folder / "cmdline").read_bytes()
            if b"ShardActor" in command and os.getpid() in ancestors(int(folder.name)):
                found.append(int(folder.name))
        except OSError:  # it has just ended
            continue
    return found


def kill_one(out, killed):
    """Send SIGKILL to a worker once the first shards are complete."""
    while not killed:
        if (out / "shards").is_dir() and len(os.listdir(out / "shards")) > 5:
            victims = workers()
            if len(victims) == 2:
                os.kill(victims[0], signal.SIGKILL)
                killed.append(len(os.listdir(out / "shards")))
        time.sleep(0.01)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_killed_worker_is_replaced(tmp_path, cluster):
    frames, scene, out, killed = make_frames(3 * SHARDS - 1), make_scene(movable=True), tmp_path / "out", []
    run(tmp_path / "whole", scene=scene, frames=frames, outputs=("depth", "labels"))
    killer = threading.Thread(target=kill_one, args=(out, killed), daemon=True)
    killer.start()
    summary = run(out, scene=scene, frames=frames, outputs=("depth", "labels"), engine="ray", workers=2, threads=None)
    killed.append(None)
    killer.join()
    assert killed[0] is not None and killed[0] < SHARDS
    assert tree(out) == tree(tmp_path / "whole")
    assert summary.rendered_frames == len(frames)


def test_failures_raise_once(tmp_path, cluster):
    with pytest.raises(wv.errors.ArrayError, match="workers must be from 1 to 2, the cluster's cores, got 3"):
        run(tmp_path / "out", threads=None, engine="ray", workers=3)
    with pytest.raises(wv.errors.ArrayError, match="threads must be None with engine="):
        run(tmp_path / "out", engine="ray")
    assert not (tmp_path / "out").exists()

    run(tmp_path / "out")
    shutil.rmtree(tmp_path / "out" / "shards")
    (tmp_path / "out" / "shards").write_text("in the way")
    with pytest.raises(
        wv.errors.FileFormatError, match=r"out: cannot be written: .*; 0 of 7 shards are complete"
    ) as caught:
        run(tmp_path / "out", threads=None, engine="ray", workers=1, resume=True)
    assert "\n" not in str(caught.value)


def test_empty_frames_are_counted(tmp_path, cluster):
    """Frames of newly rendered and of existing shards are counted."""
    frames = make_frames(6)
    poses = frames.camera_to_world.copy()
    poses[[0, 4]] = [wv.look_at(pose[:3], 3 * pose[:3]) for pose in poses[[0, 4]]]
    frames = replace(frames, camera_to_world=poses)
    with pytest.warns(UserWarning, match="^2 of 6 frames see nothing$"):
        run(tmp_path / "out", frames=frames)
    for name in ("index.json", "shards/000001.json"):
        (tmp_path / "out" / name).unlink()
    with pytest.warns(UserWarning, match="^2 of 6 frames see nothing$"):
        summary = run(tmp_path / "out", frames=frames, engine="ray", workers=1, threads=None, resume=True)
    assert (summary.rendered_frames, summary.empty_frames) == (3, 2)


def test_restarts_of_failing_workers_are_limited(tmp_path, cluster, monkeypatch):
    monkeypatch.setattr("warpvis.batch.engines._ray._MAX_RESTARTS", 1)
    # Called when a worker unpickles the job.
    monkeypatch.setattr(wv.Camera, "__reduce__", lambda camera: (os._exit, (7,)))
    with pytest.raises(
        wv.errors.FileFormatError, match=r"workers ended and were restarted too often; 0 of 7 shards are complete"
    ):
        run(tmp_path / "out", engine="ray", workers=1, threads=None)
