# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What is counted is on the disk: after a power failure at any moment, no record names what was lost."""

import errno
import json
import os
import threading
from contextlib import suppress
from pathlib import Path

import pytest
from batch_jobs import run, tree

import warpvis as wv
from warpvis.batch._dataset import Dataset
from warpvis.batch.storage import _sync as sync

pytestmark = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs /proc")


def entry(path):
    """What a folder says of a file: folders are known by their numbers, since they are renamed."""
    return os.stat(path.parent).st_ino, path.name, os.stat(path).st_ino


class Disk:
    """What of a folder a power failure would leave: contents that were synced, and names whose folder was, since."""

    def __init__(self, root, monkeypatch):
        self.root, self.lock = Path(root), threading.Lock()
        self.contents, self.names, self.lost = set(), set(), []
        self._fsync, self._replace = os.fsync, os.replace
        monkeypatch.setattr(os, "fsync", self.fsync)
        monkeypatch.setattr(os, "replace", self.replace)

    def fsync(self, descriptor):
        path = Path(os.readlink(f"/proc/self/fd/{descriptor}"))
        names = set()
        for place in path.iterdir() if path.is_dir() else ():
            with suppress(FileNotFoundError):  # another shard's temporary folder, which is gone by now
                names.add(entry(place))
        self._fsync(descriptor)
        with self.lock:
            self.names |= names
            self.contents.add(os.fstat(descriptor).st_ino)

    def replace(self, source, target):
        target = Path(target)
        inside = target.relative_to(self.root).as_posix()
        if inside.startswith("shards/") or inside in ("index.json", "begin.json"):
            with self.lock:
                files = json.loads(Path(source).read_text())["files"]
                self.lost += [f"{inside} names {name}" for name in files if not self.keeps(self.root / name)]
                if os.stat(source).st_ino not in self.contents:
                    self.lost.append(f"what {inside} says")
        self._replace(source, target)

    def keeps(self, path):
        """Whether a file and all folders that lead to it are on the disk."""
        there = path.is_file() and os.stat(path).st_ino in self.contents
        while there and path != self.root.parent:
            there = entry(path) in self.names
            path = path.parent
        return there


@pytest.mark.parametrize("name", ["npz", "png", "zarr"])
def test_a_record_is_written_when_what_it_names_is_on_the_disk(tmp_path, monkeypatch, name):
    if name == "zarr":
        pytest.importorskip("zarr")
    out, add, counted = tmp_path / "new" / "out", Dataset.add, []
    disk = Disk(out, monkeypatch)

    def note(self, shard, record):
        counted.append(shard)
        if not disk.keeps(out / "shards" / f"{shard:06d}.json"):
            disk.lost.append(f"the record of shard {shard}, which counts")
        add(self, shard, record)

    monkeypatch.setattr(Dataset, "add", note)
    run(out, format=name)
    assert disk.lost == [] and len(counted) == 7
    assert entry(out.parent) in disk.names
    assert all(disk.keeps(out / file) for file in tree(out))


def test_a_disk_that_cannot_keep_it_is_said(tmp_path, monkeypatch):
    calls = []

    def fsync(descriptor):
        calls.append(descriptor)
        if len(calls) > 20:
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(sync.os, "fsync", fsync)
    with pytest.raises(wv.errors.FileFormatError, match=r"cannot be written: Input/output error; \d of 7 shards are"):
        run(tmp_path / "out")


def test_a_file_system_that_syncs_nothing_is_written(tmp_path, monkeypatch):
    def fsync(descriptor):
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    monkeypatch.setattr(sync.os, "fsync", fsync)
    assert run(tmp_path / "out").rendered_frames == 20
