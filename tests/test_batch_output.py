# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Batch output files: complete with checksums, on disk or by URL; Zarr is read back by zarr-python."""

import errno
import io
import mmap
import os
import zipfile
import zlib

import numpy as np
import pytest
from batch_jobs import CAMERA, make_poses, make_scene, run, tree

import warpvis as wv
from warpvis.batch import npz_parts, verify
from warpvis.batch._dataset import commit, read_whole
from warpvis.batch._frame_renderer import ImageBuffers
from warpvis.batch.storage import _output as direct_io
from warpvis.batch.storage._output import ShardFiles
from warpvis.batch.storage._stores import open_store

MEGABYTE = 1 << 20


def page_of(size, seed=0):
    """Return bytes that start at a memory page."""
    memory = np.frombuffer(mmap.mmap(-1, size), dtype=np.uint8)
    memory[:] = np.random.default_rng(seed).integers(0, 256, size, dtype=np.uint8)
    return memory


PARTS = {
    "nothing": lambda: [],
    "a little": lambda: [b"a", memoryview(b"bc"), np.arange(3)],
    "pages": lambda: [page_of(3 * MEGABYTE)],
    "pages and a tail": lambda: [page_of(3 * MEGABYTE + 5), b"end"],
    "a head that is no page": lambda: [b"head", page_of(2 * MEGABYTE)],
    "a head of a page": lambda: [bytes(4096), page_of(2 * MEGABYTE), b"end"],
    "not at a page": lambda: [page_of(3 * MEGABYTE)[8:]],
    "not contiguous": lambda: [page_of(4 * MEGABYTE).reshape(2, -1)[:, ::2]],
    "vectors": lambda: [page_of(3 * MEGABYTE).view(np.float32).reshape(-1, 2, 3)[:100_000]],
}


@pytest.mark.parametrize("direct", ["direct", "refused", "unknown"])
@pytest.mark.parametrize("case", PARTS)
def test_files_and_their_checksums(tmp_path, monkeypatch, case, direct):
    """Bytes are the same with O_DIRECT, if the file system rejects it, and if the system does not support it."""
    parts = PARTS[case]()
    if direct == "unknown":
        monkeypatch.setattr(direct_io, "_O_DIRECT", 0)
    elif direct == "refused":
        fcntl = pytest.importorskip("fcntl")
        write = os.write

        def refuse(descriptor, data):
            if fcntl.fcntl(descriptor, fcntl.F_GETFL) & direct_io._O_DIRECT:
                raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
            return write(descriptor, data)

        monkeypatch.setattr(direct_io.os, "write", refuse)
    expected = b"".join(np.ascontiguousarray(part).tobytes() for part in parts)
    assert direct_io.write_file(tmp_path / "file", parts) == (len(expected), zlib.crc32(expected))
    assert (tmp_path / "file").read_bytes() == expected


def test_image_buffers_are_page_aligned():
    buffers = ImageBuffers(("depth", "points", "labels"), CAMERA, 5)
    views, arrays = buffers.first(3)
    for name, shape in (("depth", (3, 24, 32)), ("points", (3, 24, 32, 3)), ("labels", (3, 24, 32))):
        assert arrays[name].shape == shape
        assert arrays[name].ctypes.data % direct_io.ALIGNMENT == 0
        assert getattr(views, name).ptr == arrays[name].ctypes.data


def test_numpy_reads_npz():
    arrays = {
        "large": np.random.default_rng(0).random((3, 300, 400)),
        "empty": np.zeros((0, 3), dtype=np.float32),
        "number": np.array(3),
        "labels": np.arange(6, dtype=np.uint8).reshape(2, 3)[:, ::2],
    }
    data = b"".join(bytes(part) for part in npz_parts(arrays))
    assert data == b"".join(bytes(part) for part in npz_parts(arrays))
    assert zipfile.ZipFile(io.BytesIO(data)).testzip() is None
    found = np.load(io.BytesIO(data))
    assert list(found) == list(arrays)
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype
    assert data.index(arrays["large"].tobytes()) % direct_io.ALIGNMENT == 0


def test_shard_records(tmp_path):
    store = open_store(tmp_path / "out")
    store.create()
    with store.new_files() as files:
        files.write("images/a.bin", b"abc", np.arange(2, dtype=np.uint8))
        files.write_text("note.txt", "grüße")
        files.local_path("images/b.bin").write_bytes(b"by a library")
        files.warn("pixels are lost", 2)
        files.warn("pixels are lost", 3)
        files.warn("pixels are fine", 0)
        record = commit(store, "shards/000000.json", 4, files, ["images", "note.txt"])
    assert record == read_whole(store, "shards/000000.json", 4)
    assert record.files["images/a.bin"] == (5, zlib.crc32(b"abc\x00\x01"))
    assert record.files["images/b.bin"] == (12, zlib.crc32(b"by a library"))
    assert record.warnings == {"pixels are lost": 5} and record.bytes == 5 + 12 + len("grüße".encode())
    assert read_whole(store, "shards/000000.json", 5) is None and read_whole(store, "shards/000001.json", 4) is None
    (tmp_path / "out" / "note.txt").unlink()
    assert read_whole(store, "shards/000000.json", 4) is None
    assert sorted(tree(tmp_path / "out")) == ["images/a.bin", "images/b.bin", "shards/000000.json"]


def test_files_outside_units_raise(tmp_path):
    files = ShardFiles(tmp_path)
    files.write("a.txt", b"a")
    files.write("b/c.txt", b"c")
    with pytest.raises(RuntimeError, match=r"the format wrote a.txt, which is in none of its units \['b'\]"):
        commit(open_store(tmp_path), "record.json", 1, files, ["b"])


def test_url_output(tmp_path):
    fsspec = pytest.importorskip("fsspec")
    memory = fsspec.filesystem("memory")
    memory.store.clear()
    run(tmp_path / "out", format="npz", outputs=("depth", "visibility"))
    run("memory://bucket/job", format="npz", outputs=("depth", "visibility"))
    expected = tree(tmp_path / "out")
    assert sorted(open_store("memory://bucket/job").files()) == sorted(expected)
    memory.get("/bucket/job", str(tmp_path / "copy"), recursive=True)
    assert tree(tmp_path / "copy") == expected
    assert verify("memory://bucket/job").ok
    for name in ("shards/000002.json", "shard-000004.npz", "index.json"):
        memory.rm(f"/bucket/job/{name}")
    with pytest.raises(wv.errors.FileFormatError, match="memory://bucket/job: contains an unfinished dataset"):
        run("memory://bucket/job", outputs=("depth", "visibility"))
    assert run("memory://bucket/job", outputs=("depth", "visibility"), resume=True).rendered_frames == 6
    assert verify("memory://bucket/job").ok
    run(f"file://{tmp_path}/third", outputs=("depth", "visibility"))
    assert tree(tmp_path / "third") == expected


@pytest.mark.smoke("options0")
@pytest.mark.parametrize("options", [{}, {"compression": "zstd"}, {"compression": "zstd", "level": "3"}])
def test_zarr_python_reads_zarr(tmp_path, options):
    zarr = pytest.importorskip("zarr")
    outputs = ("depth", "points", "normals", "labels", "segmentation", "visibility")
    scene, poses = make_scene(movable=True), make_poses(20)
    run(tmp_path / "out", scene=scene, format="zarr", outputs=outputs, options=options, shard_frames=6)
    group = zarr.open_group(tmp_path / "out" / "data.zarr", mode="r")
    views = wv.render(scene, CAMERA, poses, outputs=outputs[:-1])
    for name in outputs[:-1]:
        assert group[name].chunks[0] == 1 and group[name].shards[0] == 6
        assert group[name].metadata.dimension_names[:3] == ("view", "y", "x")
        np.testing.assert_array_equal(group[name][:], getattr(views, name).numpy())
        np.testing.assert_array_equal(group[name][19], getattr(views, name).numpy()[19])
    seen = wv.object_visibility(scene, CAMERA, poses)
    np.testing.assert_array_equal(group["visible_fraction"][:], seen.fraction.numpy())
    np.testing.assert_array_equal(group["visible_box"][:], seen.visible_box.numpy())
    np.testing.assert_allclose(group["camera_to_world"][:], poses, atol=1e-15)
    assert group["object_poses"].shape == (1, 1, 7)
    assert group.attrs["object_names"] == ["floor", "box", "ball"] == group.attrs["visibility_objects"]
    assert group.attrs["labels"]["GROUND"] == 1 and group.attrs["K"] == CAMERA.to_K().tolist()
    assert np.isposinf(group["depth"].fill_value)
    assert verify(tmp_path / "out").ok
    size = sum(path.stat().st_size for path in (tmp_path / "out" / "data.zarr" / "depth").iterdir())
    assert (size < 20 * 24 * 32 * 4) == bool(options)


BAD_OPTIONS = {
    "compression": ({"compression": "lz4"}, "compression must be none or zstd, got 'lz4'"),
    "level": ({"compression": "zstd", "level": "high"}, "level must be a whole number from 1 to 22, got 'high'"),
    "level of nothing": ({"level": 3}, "level must be given only with compression=zstd, got compression=none"),
    "unknown": ({"codec": 3}, "format 'zarr' has no option 'codec'; its options: compression=none, zstd, level=1"),
}


@pytest.mark.parametrize("case", BAD_OPTIONS)
def test_invalid_zarr_options_raise(tmp_path, case):
    pytest.importorskip("zarr")
    options, message = BAD_OPTIONS[case]
    with pytest.raises(wv.errors.FileFormatError, match=message):
        run(tmp_path / "out", format="zarr", options=options)
    assert not (tmp_path / "out").exists()
