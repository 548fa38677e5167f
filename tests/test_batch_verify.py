# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""`verify` and `--resume` trust no field of a dataset: malformed input is reported or raises one sentence at once."""

import json
import os
import random
import shutil
import zipfile

import numpy as np
import pytest
from batch_jobs import run, tree

import warpvis as wv
from warpvis.batch import verify


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    out = tmp_path_factory.mktemp("whole") / "out"
    run(out)
    return out


@pytest.fixture
def copy(whole, tmp_path):
    shutil.copytree(whole, tmp_path / "out")
    return tmp_path / "out"


def change(path, **fields):
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, **fields}))


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"shard_frames": 0}, "does not define the contents"),
        ({"frames": -1}, "does not define the contents"),
        ({"frames": "20"}, "does not define the contents"),
        ({"poses": {}}, "does not define the contents"),
        ({"format": None}, "does not define the contents"),
    ],
)
def test_manifest_with_invalid_fields_raises(copy, fields, said):
    change(copy / "manifest.json", **fields)
    with pytest.raises(wv.WarpvisError, match=said):
        verify(copy)


@pytest.mark.parametrize("text", ["[" * 100_000, "1" * 10_000, "[1]", "null", "\x00", '{"warpvis_dataset": 1}'])
def test_malformed_manifest_raises(copy, text):
    (copy / "manifest.json").write_text(text)
    with pytest.raises(wv.WarpvisError, match=r"is not a dataset: its? "):
        verify(copy)


def test_manifest_with_a_huge_frame_count(copy):
    change(copy / "manifest.json", frames=10**12)
    report = verify(copy)
    assert report.problems[:2] == (
        "poses.npz: must have the 1000000000000 frames of the manifest, got 20",
        "333333333327 of 333333333334 shards are missing: 7-333333333333",
    )
    assert report.shards == 333333333334 and report.whole_shards == 6  # the seventh is shorter than required


def test_missing_shards_are_counted(copy):
    for shard in (0, 2, 3, 6):
        (copy / "shards" / f"{shard:06d}.json").unlink()
    (copy / "shards" / "000003.json").mkdir()
    for name in ("7.json", "x.json", "\u0663.json"):
        (copy / "shards" / name).write_text("{}")
    problems = verify(copy).problems
    assert problems[0] == "4 of 7 shards are missing: 0, 2-3, 6"
    assert "shards/7.json: is not part of any record" in problems


@pytest.mark.parametrize(
    "name", ["/dev/zero", "../../../dev/zero", "shards/../../secret", "./x", "a//b", "..\\x", "x\0y", ""]
)
def test_record_with_paths_outside_the_dataset_is_invalid(copy, name):
    (copy.parent / "secret").write_bytes(b"")
    record = copy / "shards" / "000001.json"
    content = json.loads(record.read_text())
    change(record, files={**content["files"], name: {"bytes": 0, "crc32": "00000000"}})
    report = verify(copy)
    assert "shards/000001.json: is not a valid record" in report.problems and report.damaged == ("shards/000001.json",)
    before = tree(copy)
    assert run(copy, resume=True).rendered_frames == 3
    assert verify(copy).ok and tree(copy) != before


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.parametrize("name", ["manifest.json", "poses.npz", "shards/000001.json", "shard-000001.npz"])
@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_pipes_devices_and_folders_instead_of_files(copy, name, kind):
    path = copy / name
    path.unlink()
    {"pipe": os.mkfifo, "device": lambda path: path.symlink_to("/dev/zero"), "folder": os.mkdir}[kind](path)
    if name == "manifest.json":
        with pytest.raises(wv.WarpvisError, match=r"is not a dataset: it has no manifest\.json of warpvis"):
            verify(copy)
    else:
        wanted = {"poses.npz": "poses.npz: is missing", "shard-000001.npz": "shard-000001.npz: is missing"}
        assert any(problem.startswith(wanted.get(name, "1 of 7 shards are")) for problem in verify(copy).problems)


@pytest.mark.parametrize(
    "record",
    [
        {"frames": float("inf")},
        {"files": [1]},
        {"files": {"x": {"bytes": "many", "crc32": "0"}}},
        {"warnings": None},
        {"empty": "none"},
    ],
)
def test_record_with_invalid_fields_is_reported(copy, record):
    change(copy / "shards" / "000001.json", **record)
    assert "shards/000001.json: is not a valid record" in verify(copy).problems


def test_compressed_poses_of_excessive_size_are_reported(copy):
    with (
        zipfile.ZipFile(copy / "poses.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("camera_to_world.npy", "w") as stream,
    ):
        np.save(stream, np.zeros((10**5, 7)))
    assert verify(copy).problems[0] == "poses.npz: is missing or cannot be read"


@pytest.mark.slow
def test_mutated_datasets_are_reported_or_raise(copy):
    rng, names = random.Random(3), ["manifest.json", "index.json", "shards/000001.json", "poses.npz"]
    kept = {name: (copy / name).read_bytes() for name in names}
    for _ in range(150):
        name = rng.choice(names)
        data = bytearray(kept[name])
        for _ in range(rng.choice((1, 2, 8))):
            place = rng.randrange(len(data))
            data[place : place + rng.randrange(3)] = rng.choice((b"", b"0", b"9" * 30, b"null", b'"', b"\xff", b"[{"))
        (copy / name).write_bytes(data)
        try:
            assert isinstance(verify(copy).problems, tuple)
        except wv.WarpvisError as error:
            assert "\n" not in str(error)
        (copy / name).write_bytes(kept[name])
