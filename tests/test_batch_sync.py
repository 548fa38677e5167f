# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Recorded files are on disk: after a power failure at any time, no record refers to lost data."""

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

pytestmark = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs /proc")


def entry(path):
    """Return a folder entry; folders are identified by inode because they are renamed."""
    return os.stat(path.parent).st_ino, path.name, os.stat(path).st_ino


class Disk:
    """Tracks what would survive a power failure: synced contents, and names in folders synced since."""

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
            with suppress(FileNotFoundError):  # another shard's temporary folder, already removed
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
        """Return whether a file and all its parent folders are on disk."""
        there = path.is_file() and os.stat(path).st_ino in self.contents
        while there and path != self.root.parent:
            there = entry(path) in self.names
            path = path.parent
        return there


@pytest.mark.parametrize("name", ["npz", "png", "zarr"])
def test_record_is_written_after_its_files_are_synced(tmp_path, monkeypatch, name):
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


def test_sync_failure_raises(tmp_path, monkeypatch):
    calls = []

    def fsync(descriptor):
        calls.append(descriptor)
        if len(calls) > 20:
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(wv.errors.FileFormatError, match=r"cannot be written: Input/output error; \d of 7 shards are"):
        run(tmp_path / "out")


def test_file_system_without_fsync_is_supported(tmp_path, monkeypatch):
    def fsync(descriptor):
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    monkeypatch.setattr(os, "fsync", fsync)
    assert run(tmp_path / "out").rendered_frames == 20
