# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Only one process writes a URL at a time: a lock file, valid until its process or its lease ends."""

import json
import os
import socket
import subprocess
import sys
import time
from dataclasses import replace

import pytest
from batch_jobs import CAMERA, run

import warpvis as wv
from warpvis.batch import verify
from warpvis.batch.storage import _lease as lease
from warpvis.batch.storage._stores import open_store

fsspec = pytest.importorskip("fsspec")
BUSY = r"another process is writing it \(\d+ on .*\)\. Wait for it, or end it and wait for 120 s\.$"


class OldStore(fsspec.get_filesystem_class("memory")):
    """A store without exclusive creation of files."""

    protocol = "oldstore"
    store, pseudo_dirs = {}, [""]

    def pipe_file(self, path, value, **options):
        if options.get("mode") == "create":
            raise NotImplementedError
        super().pipe_file(path, value, **options)


fsspec.register_implementation("oldstore", OldStore, clobber=True)


@pytest.fixture(params=["memory", "local", "oldstore"])
def url(request, tmp_path):
    return {"memory": f"memory://{tmp_path}", "local": f"local://{tmp_path}/out", "oldstore": f"oldstore://{tmp_path}"}[
        request.param
    ]


def write_lock(url, **changes):
    """Write another process's lock, by default of a live process on this machine."""
    system, root = fsspec.core.url_to_fs(url)
    fields = {"owner": "another", "host": socket.gethostname(), "process": os.getppid(), "time": time.time()}
    system.makedirs(root, exist_ok=True)
    system.pipe_file(f"{root}/.part-lock", json.dumps({**fields, **changes}).encode())
    return lambda: json.loads(system.cat_file(f"{root}/.part-lock"))["owner"]


def is_locked(url):
    system, root = fsspec.core.url_to_fs(url)
    return system.exists(f"{root}/.part-lock")


def test_one_writer_at_a_time(url):
    run(url)
    store = open_store(url)
    with store.locked():
        assert is_locked(url) and not any(".part" in name for name in [*store.entries(), *store.files()])
        assert verify(url).ok  # reading needs no lock
        for job in (lambda: run(url, resume=True), lambda: verify(url, repair=True), lambda: open_store(url).locked()):
            with pytest.raises(wv.errors.FileFormatError, match=BUSY):
                with job() or pytest.fail("was not refused"):
                    pass
    assert not is_locked(url) and run(url, resume=True).rendered_frames == 0 and not is_locked(url)


@pytest.mark.parametrize("kind", ["folder", "memory", "local", "oldstore"])
def test_second_writer_raises_lock_error(tmp_path, kind):
    """The error is about the lock, not about the folder's contents or resuming."""
    out = str(tmp_path / "out") if kind == "folder" else f"{kind}://{tmp_path}/out"
    run(tmp_path / "whole")
    store = open_store(out)
    store.create()
    with store.locked():
        with store.new_files() as files:  # the first writer's progress
            for name in ("manifest.json", "poses.npz"):
                files.write(name, (tmp_path / "whole" / name).read_bytes())
            store.put(files, ["manifest.json", "poses.npz"])
        for options in ({}, {"resume": True}, {"camera": replace(CAMERA, far=3.0)}):
            with pytest.raises(wv.errors.FileFormatError, match="another process is writing it"):
                run(out, **options)
    with pytest.raises(wv.errors.FileFormatError, match=r"an unfinished dataset\. Use resume=True to resume it"):
        run(out)


def test_lock_of_another_machine_holds_until_its_lease_ends(url):
    owner = write_lock(url, host="elsewhere", process=1, time=time.time() - 100)
    with pytest.raises(wv.errors.FileFormatError, match=BUSY):
        run(url)
    assert owner() == "another"
    write_lock(url, host="elsewhere", process=1, time=time.time() - 121)
    assert run(url).rendered_frames == 20 and not is_locked(url)


def test_lock_ends_with_its_process(url):
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    write_lock(url, process=child.pid)
    assert run(url).rendered_frames == 20


@pytest.mark.parametrize("changes", [{"time": "now"}, {"process": None}, {"host": []}, {"time": 1e999}])
def test_malformed_lock_is_harmless(changes):
    url = "memory://nonsense"
    owner = write_lock(url, **changes)
    try:
        with open_store(url).locked():
            assert owner() != "another"
    except wv.WarpvisError as error:
        assert "another process is writing it" in str(error)


def test_lock_is_renewed_and_left_to_a_new_owner(monkeypatch):
    monkeypatch.setattr(lease, "LEASE", 0.2)
    system = fsspec.filesystem("memory")
    with open_store("memory://again").locked():
        first = json.loads(system.cat_file("/again/.part-lock"))
        deadline = time.time() + 10
        while json.loads(system.cat_file("/again/.part-lock"))["time"] == first["time"] and time.time() < deadline:
            time.sleep(0.01)
        assert json.loads(system.cat_file("/again/.part-lock"))["time"] > first["time"]
        owner = write_lock("memory://again")
        time.sleep(0.2)
    assert owner() == "another"


def test_simultaneously_overwritten_lock_raises(monkeypatch):
    """In a store without exclusive creation, the last writer owns the lock."""
    monkeypatch.setattr(lease, "_create", lambda system, path, owner: bool(write_lock("memory://moment")))
    with pytest.raises(wv.errors.FileFormatError, match="another process started to write it at the same time"):
        with open_store("memory://moment").locked():
            pass
