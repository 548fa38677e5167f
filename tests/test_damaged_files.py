# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Files found by `fuzz_files` that once raised something other than one short sentence, one of each kind."""

import io
import json
import shutil
import struct
import tarfile
import tracemalloc
import warnings
import zipfile
import zlib

import numpy as np
import pytest
import trimesh
from batch_jobs import CAMERA, make_frames, make_scene
from gltf_files import GltfWriter
from PIL import Image
from pose_samples import bop

import warpvis as wv
from warpvis.errors import FileFormatError
from warpvis.io import load_camera, read_depth, read_frames, read_points

from support.damaged_files import ply

LONG = "a" * 5000


def refusal(call, *given, **options):
    with pytest.raises(wv.WarpvisError) as caught:
        call(*given, **options)
    said = str(caught.value)
    assert "\n" not in said and len(said) < 1000
    cause = caught.value.__context__
    while cause is not None:
        assert not isinstance(cause, MemoryError)
        cause = cause.__context__
    return said


def write(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def png(width, height, *, head=None):
    """Return a PNG image that declares a size and contains one row."""
    head = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0) if head is None else head
    row = zlib.compress(bytes(1 + 2 * min(width, 100)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", row) + chunk(b"IEND", b"")


@pytest.fixture(scope="module")
def datasets(tmp_path_factory):
    """Return a folder of small datasets by format."""
    root = tmp_path_factory.mktemp("datasets")
    for kind in ("png", "bop", "ros2"):
        frames = make_frames(2)
        wv.render_batch(make_scene(), CAMERA, frames, root / kind, format=kind, shard_frames=2, threads=1)
    return root


@pytest.mark.parametrize(
    ("image", "wanted"),
    [
        (png(32, 24, head=b"\0\0"), "is damaged: Truncated IHDR chunk"),
        (png(100_000, 100_000), "is damaged: Image size (10000000000 pixels) exceeds limit"),
        (png(9_000, 9_000), "must have shape (24, 32), got (9000, 9000)"),
        (png(32, 24)[:45], "is damaged: "),
        (b"no picture", "is damaged or not a PNG image"),
    ],
    ids=["short head", "larger than all memory", "larger", "cut off", "no picture"],
)
def test_damaged_images_of_datasets_raise(datasets, image, wanted):
    path = datasets / "png" / "depth" / "000000" / "000001.png"
    kept = path.read_bytes()
    path.write_bytes(image)
    dataset = wv.open_dataset(datasets / "png")
    assert f"png: depth/000000/000001.png {wanted}" in refusal(dataset.read, "depth", 1)
    path.write_bytes(kept)
    assert dataset.read("depth", 1).shape == (24, 32)


def test_damaged_image_next_to_poses_is_ignored(tmp_path):
    """The image would define the size; without it the poses have no camera."""
    path = write(tmp_path / "000000" / "scene_camera.json", json.dumps(bop()))
    picture = io.BytesIO()
    Image.fromarray(np.zeros((48, 64), np.uint16)).save(picture, "png")
    for image, sized in ((picture.getvalue(), True), (png(200_000, 200_000), False), (png(1, 1, head=b"\0"), False)):
        write(path.parent / "depth" / "000000.png", image)
        assert (read_frames(path).camera is not None) == sized


@pytest.mark.parametrize("value", [10**400, 1e300, None, [], {}], ids=["digits", "1e300", "none", "list", "object"])
def test_bop_numbers_out_of_range_raise(datasets, value):
    (path,) = (datasets / "bop").rglob("scene_gt_info.json")
    kept = path.read_text()
    content = json.loads(kept)
    content["1"][0]["px_count_all"] = value
    path.write_text(json.dumps(content))
    said = refusal(wv.open_dataset(datasets / "bop").read, "silhouette_pixels", 1)
    assert "scene_gt_info.json" in said
    path.write_text(kept)


@pytest.mark.parametrize("name", ["metadata.yaml", "bag_000000.mcap"])
def test_damaged_bags_of_datasets_raise_one_line(datasets, name):
    path = datasets / "ros2" / "bag_000000" / name
    kept = path.read_bytes()
    damaged = kept[: len(kept) // 2] if name.endswith("mcap") else b"a: [\nb: {\n" + kept
    path.write_bytes(damaged)
    said = refusal(wv.open_dataset(datasets / "ros2").read, "depth", 0)
    assert f"{datasets / 'ros2'}: bag_000000 cannot be read: " in said
    path.write_bytes(kept)


def test_mcap_records_longer_than_the_file_raise(datasets, tmp_path):
    """rosbags would allocate the recorded length: gigabytes for a short file."""
    pytest.importorskip("rosbags")
    from support.ros_bags import KINDS, write_bag

    good = write_bag(tmp_path / "bag", {"/camera": KINDS["PoseStamped"][0]})
    data = good.read_bytes()
    place = 8 + 9 + int.from_bytes(data[9:17], "little")  # after the magic bytes and the header
    length = int.from_bytes(data[place + 1 : place + 9], "little")
    for size in (2**33, 2**62, len(data)):
        good.write_bytes(data[: place + 1] + struct.pack("<Q", size) + data[place + 9 :])
        for path in (good, good.parent):
            wanted = f"bag.mcap has a record of {size} bytes at byte {place + 9}, and {len(data)} in all"
            assert refusal(read_frames, path) == f"{path}: cannot be read as a ROS bag: {wanted}"
    good.write_bytes(data[: place + 1] + struct.pack("<Q", length) + data[place + 9 :])
    assert len(read_frames(good.parent)) == 5


def test_mcap_chunk_longer_than_the_file_raises(tmp_path):
    """The summary at the end repeats the lengths of chunks."""
    pytest.importorskip("rosbags")
    from support.ros_bags import KINDS, write_bag

    path = write_bag(tmp_path / "bag", {"/camera": KINDS["PoseStamped"][0]})
    data, place = bytearray(path.read_bytes()), 8
    places = []
    while data[place] != 2:
        length = int.from_bytes(data[place + 1 : place + 9], "little")
        places.append((data[place], place + 9, length))
        place += 9 + length
    index = [(start, length) for kind, start, length in places if kind == 8]
    if not index:  # the bag has no chunks: add an index of one
        record = bytes(32) + bytes(4) + bytes(8) + bytes(4) + struct.pack("<QQ", 2**40, 2**40)
        start = places[0][1] + places[0][2]
        path.write_bytes(data[:start] + b"\x08" + struct.pack("<Q", len(record)) + record + data[start:])
        size = path.stat().st_size
    else:
        start, length = index[0]
        data[start + length - 16 : start + length - 8] = struct.pack("<Q", 2**40)
        path.write_bytes(data)
        size = len(data)
    assert refusal(read_frames, path).endswith(f"bag.mcap has a chunk of {2**40} bytes, and {size} in all")


def test_unpacked_size_of_mcap_chunks_is_limited(tmp_path):
    """Both the unpacked length in a chunk and the one in its index are limited."""
    pytest.importorskip("rosbags")
    from support.ros_bags import KINDS, write_bag

    path = write_bag(tmp_path / "bag", {"/camera": KINDS["PoseStamped"][0]})
    data = path.read_bytes()
    start = 8 + 9 + int.from_bytes(data[9:17], "little")
    unpacked = struct.pack("<Q", 2**31)
    for kind, record in ((6, bytes(16) + unpacked + bytes(16)), (8, bytes(64) + unpacked)):
        path.write_bytes(data[:start] + bytes([kind]) + struct.pack("<Q", len(record)) + record + data[start:])
        assert "bag.mcap: unpacks to more than 1 GiB, the maximum" in refusal(read_frames, path)


def test_long_names_in_bags_are_truncated(tmp_path):
    pytest.importorskip("rosbags")
    from support.ros_bags import ROWS, pose_stamped, write_bag

    poses = [pose_stamped(k, ROWS[k], frame=letter * 3000) for k, letter in enumerate("ab")]
    path = write_bag(tmp_path / "bag", {"/" + LONG: poses})
    assert "has poses in the frames aaa" in refusal(read_frames, path)


@pytest.mark.parametrize("change", [{"camera": {"width": LONG}}, {"options": {"scale": LONG}}])
def test_long_texts_in_manifests_are_truncated(datasets, change):
    path = datasets / "png" / "manifest.json"
    kept = path.read_text()
    content = json.loads(kept)
    for key, value in change.items():
        content[key] |= value
    path.write_text(json.dumps(content))
    assert "manifest.json has " in refusal(wv.open_dataset, datasets / "png")
    path.write_text(kept)


def test_long_names_of_another_job_are_truncated(datasets):
    path = datasets / "png" / "manifest.json"
    kept = path.read_text()
    content = json.loads(kept)
    content["scene"]["objects"][LONG] = content["scene"]["objects"].pop("ball")
    path.write_text(json.dumps(content))
    again = {"format": "png", "shard_frames": 2, "threads": 1, "resume": True}
    said = refusal(wv.render_batch, make_scene(), CAMERA, make_frames(2), datasets / "png", **again)
    assert "the scene's object 'aaa" in said and said.count(" is new") == 1
    path.write_text(kept)


def test_lens_coefficients_with_many_digits(tmp_path):
    pytest.importorskip("ruamel.yaml")
    from support.camera_files import KALIBR

    text = KALIBR.replace("distortion_coeffs: [0.0,", f"distortion_coeffs: [{'9' * 400},")
    said = refusal(lambda path: load_camera(str(path)), write(tmp_path / "a.yaml", text))
    assert "distortion_coeffs must be finite numbers, got 9999" in said


def gltf(**changes):
    writer = GltfWriter()
    writer.node(writer.primitive(np.eye(3, dtype=np.float32), faces=[0, 1, 2]), name="part")
    for key, change in changes.items():
        writer.content[key] = change(writer.content[key])
    return writer.bytes()


@pytest.mark.parametrize(
    ("file", "wanted"),
    [
        (
            gltf(accessors=lambda items: [{key: item[key] for key in item if key != "count"} for item in items]),
            "it is damaged, or something else (KeyError: 'count')",
        ),
        (
            gltf(nodes=lambda items: [{"mesh": 0, "extensions": 3}]),
            "it is damaged, or something else (AttributeError: 'int' object has no attribute 'get')",
        ),
        (gltf(nodes=lambda items: [{"mesh": LONG}]), "it references meshes 'aaaa"),
        (b"glTF\2\0\0\0" + struct.pack("<II", 100_020, 100_000) + b"JSON" + b"[" * 100_000, "it is nested too deeply"),
    ],
    ids=["no count", "a number for an object", "a long name", "nested"],
)
def test_gltf_with_invalid_types_raises(tmp_path, file, wanted):
    path = write(tmp_path / "a.glb", file)
    assert refusal(wv.Scene.load, path).startswith(f"{path}: cannot be read as GLB: {wanted}")


BAD_INDEX = "o box\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"


@pytest.mark.parametrize(
    ("name", "file", "wanted"),
    [
        (
            "a.glb",
            gltf(accessors=lambda items: [items[0] | {"count": 2}, items[1]]),
            "faces of 'part' must index its 2",
        ),
        ("a.stl", trimesh.Trimesh(np.eye(3) * 1e30, [[0, 1, 2]]).export(file_type="stl"), "vertices of 'a' must lie"),
        ("a.obj", BAD_INDEX, "cannot be read as OBJ: line 5: a face must index the file's 3 vertices, got 'f 1 2 9'"),
        ("a.obj", BAD_INDEX.replace("9", "0"), "cannot be read as OBJ: line 5: vertex indices of a face start at 1"),
        ("a.obj", BAD_INDEX.replace("9", "0/1"), "cannot be read as OBJ: line 5: vertex indices of a face start at 1"),
        (
            "a.obj",
            BAD_INDEX.replace("9", "c"),
            "cannot be read as OBJ: line 5: a face needs numbers of vertices, got 'f",
        ),
        (
            "a.obj",
            BAD_INDEX.replace("0 0 0", "0 \\\n0 x"),
            "cannot be read as OBJ: line 2: a vertex needs three numbers",
        ),
        ("a.glb", b"", "is empty"),
        ("a.stl", b"solid a\nfacet\nvertex 0 0 0\nvertex 1 0\nendsolid\n", "cannot be read as STL: "),
        ("a.ply", b"ply\nformat ascii 1.0\nend\n", "cannot be read as PLY: "),
        ("a.tar", b"no archive", "cannot be unpacked: "),
    ],
    ids=["glb", "far stl", "obj", "obj 0", "obj 0/1", "obj c", "obj x", "empty", "short stl", "ply", "tar"],
)
def test_errors_of_invalid_meshes_name_the_file(tmp_path, name, file, wanted):
    path = write(tmp_path / name, file)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert refusal(wv.Scene.load, path).startswith(f"{path}: {wanted}")


def test_errors_of_invalid_worlds_name_the_file(tmp_path):
    path = write(
        tmp_path / "a.wbt",
        "#VRML_SIM R2023b utf8\nSolid { translation 1e19 0 0 children [ Shape { geometry Box { } } ] }\n",
    )
    said = refusal(wv.webots.load_webots, path)
    assert said.startswith(f"{path}") and "within" in said


GIT_LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a214614ab2935c943f9e0\nsize 12345\n"
PAGE = b"<!DOCTYPE html>\n<html lang='en'><head><title>Sign in</title></head><body></body></html>\n"
XHTML = b'<?xml version="1.0"?>\n<html xmlns="http://www.w3.org/1999/xhtml"><head/><body/></html>\n'
JPEG = b"\xff\xd8\xff\xe0" + bytes(100)
VISUAL = '<visual><geometry><mesh filename="%s"/></geometry></visual>'
POINTER, WEB = "is a git-lfs pointer, not %s. Run `git lfs pull`.", "is an HTML page, not %s. Download the file that"
READERS = {
    **{f"a.{ending}": (wv.Scene.load, "a mesh") for ending in ("glb", "gltf", "obj", "stl", "ply", "off", "zip")},
    **{f"b.{ending}": (wv.Scene.load, "a model") for ending in ("xml", "urdf")},
    **{f"h.{ending}": (wv.Scene.load, "a USD stage") for ending in ("usd", "usda", "usdc", "usdz")},
    "c.wbt": (wv.webots.load_webots, "a Webots file"),
    **{f"d.{ending}": (read_frames, "a file of poses") for ending in ("npy", "npz", "csv", "txt", "json", "mcap")},
    **{f"e.{ending}": (load_camera, "a camera file") for ending in ("yaml", "json")},
    **{f"f.{ending}": (read_depth, "a depth image") for ending in ("png", "npy")},
    **{f"g.{ending}": (read_points, "a file of points") for ending in ("ply", "npy", "txt")},
}


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize(
    ("file", "said"), [(GIT_LFS, POINTER), (PAGE, WEB), (XHTML, WEB)], ids=["lfs", "page", "xhtml"]
)
def test_lfs_pointers_and_html_pages_are_recognized(tmp_path, name, file, said):
    read, wanted = READERS[name]
    path = write(tmp_path / name, file)
    assert refusal(read, path).startswith(f"{path}: {said % wanted}")


@pytest.mark.parametrize("name", [name for name, (_, wanted) in READERS.items() if wanted in ("a mesh", "a model")])
def test_images_instead_of_meshes_are_recognized(tmp_path, name):
    path = write(tmp_path / name, png(4, 4))
    assert refusal(wv.Scene.load, path) == f"{path}: is a PNG image, not {READERS[name][1]}"
    write(path, JPEG)
    assert refusal(wv.Scene.load, path) == f"{path}: is a JPEG image, not {READERS[name][1]}"


def test_lfs_pointers_referenced_by_files_are_recognized(tmp_path):
    """Meshes in archives, robots and Webots worlds, and glTF buffers."""
    write(tmp_path / "part.stl", GIT_LFS)
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.write(tmp_path / "part.stl", "part.stl")
    write(tmp_path / "a.urdf", f'<robot name="r"><link name="l">{VISUAL % "part.stl"}</link></robot>')
    write(tmp_path / "a.wbt", '#VRML_SIM R2023b utf8\nShape { geometry Mesh { url "part.stl" } }\n')
    content = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "part.bin", "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    write(tmp_path / "a.gltf", json.dumps(content))
    write(tmp_path / "part.bin", GIT_LFS)
    for name, place in (("a.zip", "a.zip/part.stl"), ("a.urdf", "part.stl"), ("a.wbt", "part.stl")):
        assert f"{place}: is a git-lfs pointer, not a mesh. Run" in refusal(wv.Scene.load, tmp_path / name, strict=True)
    assert "a.gltf: part.bin: is a git-lfs pointer, not a buffer of glTF." in refusal(
        wv.Scene.load, tmp_path / "a.gltf"
    )


@pytest.mark.parametrize("ending", ["obj", "stl", "msh", "png"])
def test_lfs_pointers_referenced_by_mjcf_are_recognized(tmp_path, ending):
    """In the model's folder and on the search path."""
    assets = {ending: f'<mesh name="m" file="a.{ending}"/>', "png": '<texture name="m" type="2d" file="a.png"/>'}
    geom = '<geom type="mesh" mesh="m"/>' if ending != "png" else '<geom size="1"/>'
    compiler, asset = '<compiler meshdir="m" texturedir="m"/>', f"<asset>{assets[ending]}</asset>"
    write(tmp_path / "a.xml", f"<mujoco>{compiler}{asset}<worldbody>{geom}</worldbody></mujoco>")
    wanted = f"a.{ending}: is a git-lfs pointer, not {'an image' if ending == 'png' else 'a mesh'}. Run `git lfs pull`."
    write(tmp_path / "lib" / f"a.{ending}", GIT_LFS)
    assert refusal(wv.Scene.load, tmp_path / "a.xml", search_path=tmp_path / "lib").endswith(wanted)
    write(tmp_path / "m" / f"a.{ending}", GIT_LFS)
    assert refusal(wv.Scene.load, tmp_path / "a.xml").endswith(wanted)


MESH_OF_LINK = (
    '<robot name="r"><link name="l"><visual><geometry><mesh filename="%s.obj"/></geometry></visual></link></robot>'
)
MESH_OF_MODEL = '<mujoco><asset><mesh name="m" file="%s.obj"/></asset></mujoco>'


@pytest.mark.parametrize("text", [MESH_OF_LINK, MESH_OF_MODEL, '<mujoco><include file="%s.xml"/></mujoco>'])
def test_models_with_too_long_file_names_raise(tmp_path, text):
    path = write(tmp_path / "a.xml", text % LONG)
    refusal(wv.Scene.load, path)
    refusal(wv.Scene.load, path, search_path=tmp_path)


@pytest.mark.parametrize("content", [{}, {"camera_angle_x": 0.7}, {"fl_x": 500, "w": 640, "h": 480}])
def test_transforms_without_frames_raise(tmp_path, content):
    path = write(tmp_path / "transforms.json", json.dumps(content))
    assert refusal(read_frames, path) == f'{path}: has no list "frames", which holds the poses of nerfstudio\'s files'


def test_npy_without_numpy_array_raises(tmp_path):
    path = write(tmp_path / "a.npy", png(4, 4))
    assert refusal(read_frames, path) == f"{path}: cannot be read as NPY: it contains no NumPy arrays"


@pytest.fixture
def small_bound(monkeypatch):
    """Limit the unpacked size of files to 10,000 bytes."""
    monkeypatch.setattr("warpvis.core.numpy_files.MAX_UNPACKED", 10_000)


def poses_at_origin(count):
    return np.tile([0.0, 0, 0, 0, 0, 0, 1], (count, 1))


def test_unpacked_size_of_compressed_poses_is_limited(tmp_path, small_bound):
    np.savez_compressed(tmp_path / "poses.npz", camera_to_world=poses_at_origin(1000), others=np.zeros(10**6))
    assert refusal(read_frames, tmp_path / "poses.npz") == (
        f"{tmp_path / 'poses.npz'}: unpacks to more than 1 GiB, the maximum: write it with numpy.savez, "
        "without compression"
    )
    np.savez_compressed(tmp_path / "poses.npz", camera_to_world=poses_at_origin(100), others=np.zeros(10**6))
    assert len(read_frames(tmp_path / "poses.npz")) == 100  # other arrays are not read
    np.savez(tmp_path / "poses.npz", camera_to_world=poses_at_origin(1000))
    assert len(read_frames(tmp_path / "poses.npz")) == 1000


def test_compressed_poses_of_a_dataset_raise(datasets, tmp_path):
    shutil.copytree(datasets / "png", tmp_path / "png")
    path = tmp_path / "png" / "poses.npz"
    with np.load(path) as arrays:
        kept = dict(arrays)
    np.savez_compressed(path, **{**kept, "others": np.zeros(10**6)})
    assert refusal(wv.open_dataset, tmp_path / "png").endswith(
        "poses.npz is missing or damaged: its arrays are compressed"
    )


def test_unpacked_size_of_parquet_poses_is_limited(tmp_path, small_bound):
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    columns = dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), poses_at_origin(1000).T, strict=True))
    parquet.write_table(arrow.table(columns), tmp_path / "poses.parquet")
    assert (tmp_path / "poses.parquet").stat().st_size < 10_000
    assert "poses.parquet: unpacks to more than 1 GiB" in refusal(read_frames, tmp_path / "poses.parquet")


@pytest.mark.parametrize("ending", [".zip", ".tar.gz"])
def test_oversized_archives_raise_without_using_memory(tmp_path, monkeypatch, ending):
    monkeypatch.setattr("warpvis.core.numpy_files.MAX_UNPACKED", 30_000_000)
    path, size = tmp_path / f"a{ending}", 50_000_000
    if ending == ".zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("a.stl", bytes(size))
    else:
        with tarfile.open(path, "w:gz") as archive:
            member = tarfile.TarInfo("a.stl")
            member.size = size
            archive.addfile(member, io.BytesIO(bytes(size)))
    tracemalloc.start()
    try:
        assert "unpacks to more than 1 GiB" in refusal(wv.Scene.load, path)
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()


def test_archive_instead_of_depth_image_raises(tmp_path):
    np.savez(tmp_path / "a.npz", depth=np.ones((2, 2)))
    path = (tmp_path / "a.npz").rename(tmp_path / "a.npy")
    assert refusal(read_depth, path) == f"{path}: cannot be read as NPY: it is an archive"


def test_long_labels_are_truncated(tmp_path):
    path = write(tmp_path / "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for rules in ({"labels": {"a": LONG}}, {"label_names": {"40": LONG}, "labels": {"a": "x"}}, {LONG: 1}):
        refusal(wv.Scene.load, path, labels=write(tmp_path / "rules.json", json.dumps(rules)))
    refusal(wv.Scene.load, path, labels={LONG: "object"})


def test_ply_with_carriage_returns(tmp_path):
    """Rhino writes such files."""
    for encoding in ("ascii", "binary"):
        file = trimesh.creation.box().export(file_type="ply", encoding=encoding)
        head, end, body = file.partition(b"end_header\n")
        path = write(tmp_path / "a.ply", (head + end).replace(b"\n", b"\r") + body)
        assert wv.Scene.load(path).triangle_count == 12
        assert len(read_points(path)) == 8


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("more", ["", "property uchar red\n", "property list uchar float texcoord\n"])
def test_ply_with_mixed_polygons(tmp_path, order, more):
    """Written by Blender and MeshLab; trimesh requires equal corner counts."""
    tail = {"": b"", "property uchar red\n": b"\7"}.get(more, b"\1" + np.array([0.5], order + "f4").tobytes())
    path = write(
        tmp_path / "a.ply", ply(order, [(0, 1, 2, 3), (0, 1, 4), (0, 1, 5, 2, 3), (1, 2)], more=more, tail=tail)
    )
    scene = wv.Scene.load(path)
    wanted = [(0, 1, 2), (0, 2, 3), (0, 1, 4), (0, 1, 5), (0, 5, 2), (0, 2, 3)]
    (item,) = scene
    assert [tuple(map(tuple, item.vertices[face])) for face in item.faces] == [
        tuple(map(tuple, read_points(path)[list(face)])) for face in wanted
    ]


@pytest.mark.parametrize(
    "file",
    [
        ply("<", [(0, 1, 2, 3), (0, 1, 4)])[:-2],
        ply("<", [(0, 1, 2, 3), (0, 1, 9)]),
        ply("<", [(0, 1, 2, 3), (0, 1, 4)]).replace(b"element face 2", b"element face 2000000000000"),
        ply("<", [(0, 1, 2, 3), (0, 1, 4)])
        .replace(b"list uchar", b"list char")
        .replace(b"\4\0\0\0\0", b"\xfc\0\0\0\0"),
        ply("<", [(0, 1, 2, 3), (0, 1, 4)]).replace(b"list uchar uint vertex_indices", b"float number"),
        ply("<", [(0, 1, 2, 3), (0, 1, 4)]).replace(b"element vertex 6", b"element vertex 6000000000000"),
    ],
    ids=["cut off", "no vertex", "many faces", "fewer than none", "no list", "many vertices"],
)
def test_damaged_ply_with_mixed_polygons(tmp_path, file):
    path = write(tmp_path / "a.ply", file)
    assert refusal(wv.Scene.load, path).startswith(f"{path}: ")


def long_names(path):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(f"{LONG}.npy", b"")
    return path


def lasers(number):
    rows = [{"laser_id": n, "vert_correction": 0.1, "rot_correction": 0.1} for n in range(15)]
    rows.append({"laser_id": number, "vert_correction": 0.1, "rot_correction": 0.1})
    return json.dumps({"lasers": rows})


@pytest.mark.filterwarnings("ignore")
def test_long_integers_in_calibrations(tmp_path):
    entry = {"camera_model": "pinhole", "intrinsics": [9, 9, 4, 3], "resolution": [8, 6], "distortion_model": "radtan"}

    def given(number):
        return write(tmp_path / "a.yaml", json.dumps({"cam0": {**entry, "distortion_coeffs": [0, 0, 0, number]}}))

    assert load_camera(given(10**20), distortion=True).lens.coefficients[3] == 1e20
    said = refusal(lambda path: load_camera(path, distortion=True), given(10**400))
    assert "distortion_coeffs must be finite numbers, got 1000" in said


@pytest.mark.parametrize(
    ("name", "text", "read"),
    [
        ("a.txt", f"0 0 0 0 0 0 0 {LONG}\n", read_frames),
        ("a.txt", "0 0 0 " + "nan " * 5 + " " * 5000 + "# nan\n", read_points),
        ("a.txt", f"1 2 {LONG}\n", read_points),
        ("images.txt", f"1 {LONG}\n", read_frames),
        ("cameras.txt", f"1 PINHOLE {LONG} 48 1 1 1 1\n", lambda path: load_camera(str(path))),
        ("a.json", json.dumps({"width": 4, "height": LONG, "hfov": 1.0}), lambda path: load_camera(str(path))),
        ("a.yaml", lasers(LONG), lambda path: wv.sensors.lidars.vlp16(calibration=path)),
        ("b.yaml", lasers(10**400), lambda path: wv.sensors.lidars.vlp16(calibration=path)),
    ],
)
def test_long_texts_are_truncated(tmp_path, name, text, read):
    path = write(tmp_path / name, text)
    assert refusal(read, path).startswith(str(path))


def test_long_names_are_truncated(tmp_path):
    path = long_names(tmp_path / "a.npz")
    assert refusal(read_frames, path).startswith(f"{path}: expected an array camera_to_world, got aaa")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("a.obj", f"o {LONG}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    path.with_name("a.zip").write_bytes(path.with_name("a.zip").read_bytes().replace(b"a.obj", b"b.obj", 1))
    assert "cannot be unpacked: File name in directory" in refusal(wv.Scene.load, path.with_name("a.zip"))
    world = write(path.with_name("a.wbt"), f"#VRML_SIM R2023b utf8\nBox{LONG} {{ }}\n")
    assert f"{world}: skipped Boxaaa" in refusal(wv.Scene.load, world)
    with pytest.raises(FileFormatError):
        wv.Scene.load(write(path.with_name("b.wbt"), "#VRML_SIM R2023b utf8\n{"))
