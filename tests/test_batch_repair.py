# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Damaged shards are rendered again to the same bytes; renamed inputs of equal content are resumed."""

import os
import shutil

import numpy as np
import pytest
from batch_jobs import CAMERA, make_frames, make_scene, run, tree

import warpvis as wv
from warpvis.batch import render_batch, verify
from warpvis.cli import Verify


@pytest.fixture(scope="module")
def wholes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    for name in ("npz", "bop"):
        run(folder / name, format=name)
    return folder


def flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def damage(out, name):
    """Flip bytes, delete and truncate files of shards, and damage a record, the poses and the index."""
    if name == "npz":
        flip(out / "shard-000001.npz")
        (out / "shard-000003.npz").unlink()
        os.truncate(out / "shard-000004.npz", 100)
    else:
        flip(out / "train" / "000001" / "scene_camera.json")
        (out / "train" / "000003" / "scene_gt.json").unlink()
        os.truncate(out / "train" / "000004" / "depth" / "000000.png", 100)
        flip(out / "models" / "obj_000001.ply")
    flip(out / "poses.npz")
    (out / "shards" / "000005.json").write_text("{}")


DAMAGED = {f"shards/00000{shard}.json" for shard in (1, 3, 4, 5)}


@pytest.mark.smoke("npz")
@pytest.mark.parametrize("name", ["npz", "bop"])
def test_damaged_shards_are_rendered_again(wholes, tmp_path, name):
    for at_once in (False, True):
        out = tmp_path / f"out_{at_once}"
        shutil.copytree(wholes / name, out)
        damage(out, name)
        assert set(verify(out).damaged) - {"index.json"} == DAMAGED
        if not at_once:
            report = verify(out, repair=True)
            assert report.repaired and set(report.damaged) - {"index.json"} == DAMAGED
            assert not any((out / record).exists() for record in report.damaged)
        assert run(out, format=name, resume=True, repair=at_once).rendered_frames == 12
        assert tree(out) == tree(wholes / name) and verify(out).ok


def test_without_repair_only_sizes_are_checked(wholes, tmp_path):
    shutil.copytree(wholes / "npz", tmp_path / "out")
    flip(tmp_path / "out" / "shard-000001.npz")
    assert run(tmp_path / "out", resume=True).rendered_frames == 0
    assert verify(tmp_path / "out").damaged == ("shards/000001.json",)


def test_intact_dataset_is_unchanged(wholes, tmp_path):
    shutil.copytree(wholes / "npz", tmp_path / "out")
    assert verify(tmp_path / "out", repair=True).ok
    assert run(tmp_path / "out", resume=True, repair=True).rendered_frames == 0
    assert run(tmp_path / "new", resume=True, repair=True).rendered_frames == 20
    assert tree(tmp_path / "out") == tree(tmp_path / "new") == tree(wholes / "npz")


def test_locked_dataset_is_not_repaired(wholes, tmp_path):
    fcntl = pytest.importorskip("fcntl")
    shutil.copytree(wholes / "npz", tmp_path / "out")
    flip(tmp_path / "out" / "shard-000001.npz")
    before = tree(tmp_path / "out")
    holder = os.open(tmp_path / "out", os.O_RDONLY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    with pytest.raises(wv.errors.FileFormatError, match="another process is writing it"):
        verify(tmp_path / "out", repair=True)
    os.close(holder)
    with pytest.raises(wv.errors.FileFormatError, match="cannot be resumed because it was started with other input"):
        run(tmp_path / "out", resume=True, repair=True, shard_frames=4)
    with pytest.raises(wv.errors.ArrayError, match="repair=True requires resume=True"):
        run(tmp_path / "out", repair=True)
    with pytest.raises(wv.errors.FileFormatError, match="is not a dataset: the folder does not exist or is empty"):
        verify(tmp_path / "nowhere", repair=True)
    assert tree(tmp_path / "out") == before and not (tmp_path / "nowhere").exists()


def test_url_is_repaired():
    fsspec = pytest.importorskip("fsspec")
    memory = fsspec.filesystem("memory")
    run("memory://repair/job")
    data = bytearray(memory.cat_file("/repair/job/shard-000001.npz"))
    data[1000] ^= 1
    memory.pipe_file("/repair/job/shard-000001.npz", bytes(data))
    assert verify("memory://repair/job", repair=True).damaged == ("shards/000001.json",)
    assert run("memory://repair/job", resume=True).rendered_frames == 3
    assert verify("memory://repair/job").ok


def test_command_prints_how_to_continue(wholes, tmp_path, capsys):
    shutil.copytree(wholes / "npz", tmp_path / "out")
    flip(tmp_path / "out" / "shard-000001.npz")
    with pytest.raises(SystemExit) as ended:
        Verify(str(tmp_path / "out"), repair=True).run()
    assert ended.value.code == 1
    printed = capsys.readouterr().out
    assert "removed shards/000001.json: the batch command with --resume renders the damaged shards again" in printed


def test_renamed_files_of_the_same_content_are_resumed(wholes, tmp_path):
    """Applies to the scene, the poses and the worlds."""
    make_scene().export(tmp_path / "room.glb")
    poses = make_frames().camera_to_world
    np.save(tmp_path / "walk.npy", poses)

    def job(scene, walk, **given):
        frames = wv.read_frames(tmp_path / walk)
        return render_batch(tmp_path / scene, CAMERA, frames, tmp_path / "out", shard_frames=3, threads=1, **given)

    job("room.glb", "walk.npy")
    before = tree(tmp_path / "out")
    (tmp_path / "out" / "shards" / "000002.json").unlink()
    (tmp_path / "room.glb").rename(tmp_path / "hall.glb")
    (tmp_path / "walk.npy").rename(tmp_path / "stroll.npy")
    assert job("hall.glb", "stroll.npy", resume=True).rendered_frames == 3
    assert tree(tmp_path / "out") == before
    poses[0, 0] += 0.5
    np.save(tmp_path / "stroll.npy", poses)
    with pytest.raises(wv.errors.FileFormatError, match=r"started with other input: the poses differ$"):
        job("hall.glb", "stroll.npy", resume=True)
