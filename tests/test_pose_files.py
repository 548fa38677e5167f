# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pose files: every format compared with its definition, and one-line errors for malformed files."""

import builtins
import csv
import io
import json
import sys
import zipfile

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings, strategies as st
from pose_samples import MATRICES, OPENGL, RNG, ROS, ROWS, TIMES, assert_same_poses, bop, nerfstudio, unit

import warpvis as wv
from warpvis.cli import main
from warpvis.core.poses import poses_to_matrices
from warpvis.io import read_frames

# Text and arrays.


def test_tum_files(tmp_path):
    lines = [f"{t!r} " + " ".join(map(repr, row)) for t, row in zip(TIMES.tolist(), ROWS.tolist(), strict=True)]
    for name in ("walk.txt", "walk.tum", "walk"):
        (tmp_path / name).write_text("# a comment\n" + "\n".join(lines))
        frames = read_frames(tmp_path / name)
        np.testing.assert_array_equal(frames.camera_to_world, ROWS)  # bit for bit
        np.testing.assert_array_equal(frames.timestamps, TIMES)
        assert frames.source == {"file": name, "format": "tum", "convention": "opencv"}
    (tmp_path / "walk.csv").write_text("\n".join(lines))
    assert_same_poses(read_frames(tmp_path / "walk.csv", file_format="tum"))


def test_convention_refers_to_camera_frame(tmp_path):
    for convention, axes in (("opengl", OPENGL), ("ros_body", ROS)):
        np.save(tmp_path / "poses.npy", MATRICES @ axes)
        frames = read_frames(tmp_path / "poses.npy", convention=convention)
        assert_same_poses(frames)
        assert frames.source["convention"] == convention


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_npy_files(tmp_path, dtype):
    for array in (ROWS, MATRICES):
        np.save(tmp_path / "poses.npy", array.astype(dtype))
        frames = read_frames(tmp_path / "poses.npy")
        np.testing.assert_allclose(poses_to_matrices(frames.camera_to_world), MATRICES, atol=4 * np.finfo(dtype).eps)
        np.testing.assert_array_equal(frames.timestamps, np.arange(6))


def test_w_first_quaternions(tmp_path):
    """Arrays do not define the order of quaternions, so the caller specifies it, for cameras and objects."""
    rows, objects = ROWS[:, [0, 1, 2, 6, 3, 4, 5]], unit(RNG.normal(size=(6, 2, 7))).astype(np.float32)
    np.save(tmp_path / "poses.npy", rows)
    np.savez(tmp_path / "poses.npz", camera_to_world=rows, object_poses=objects[..., [0, 1, 2, 6, 3, 4, 5]])
    for name in ("poses.npy", "poses.npz"):
        frames = read_frames(tmp_path / name, quaternion="wxyz")
        np.testing.assert_array_equal(frames.camera_to_world, ROWS)
        assert frames.source["quaternion"] == "wxyz"
    np.testing.assert_array_equal(frames.object_poses, objects)
    np.save(tmp_path / "bad.npy", np.concatenate([rows, rows[:1] * 2]))
    with pytest.raises(wv.errors.FileFormatError, match=r"bad.npy: pose 6: poses must have quaternions of length 1"):
        read_frames(tmp_path / "bad.npy", quaternion="wxyz")
    with pytest.raises(wv.errors.PoseError, match='quaternion must be "xyzw" or "wxyz"'):
        read_frames(tmp_path / "poses.npy", quaternion="w")


@pytest.mark.parametrize("name", ["walk.txt", "walk.csv", "walk.parquet", "transforms.json", "bag"])
def test_quaternion_order_is_rejected_for_other_formats(tmp_path, name):
    (tmp_path / name).mkdir() if name == "bag" else (tmp_path / name).write_text("")
    with pytest.raises(wv.errors.FileFormatError, match=r"quaternion= is for \.npy and \.npz; other formats define"):
        read_frames(tmp_path / name, quaternion="wxyz")


def test_npz_files_contain_worlds(tmp_path):
    objects = unit(RNG.normal(size=(2, 3, 7))).astype(np.float32)
    world = [0, 1, 1, 0, 0, 1]
    for name in ("timestamp", "timestamps"):
        np.savez(
            tmp_path / "job.npz",
            camera_to_world=ROWS,
            object_poses=objects,
            world_index=world,
            other=["a"],
            **{name: TIMES},
        )
        frames = read_frames(tmp_path / "job.npz")
        assert frames.camera_to_world.tobytes() == ROWS.tobytes()
        np.testing.assert_array_equal(frames.timestamps, TIMES)
        np.testing.assert_array_equal(frames.object_poses, objects)
        assert frames.world_index.tolist() == world
        assert frames.source == {"file": "job.npz", "format": "npz", "convention": "opencv"}


def test_output_of_render_is_read(tmp_path, monkeypatch):
    trimesh.creation.box().export(tmp_path / "box.obj")
    (tmp_path / "walk.txt").write_text("0.5 0 -3 0.2 -0.70710678 0 0 0.70710678\n1.5 0 -4 0 0 0 0 1\n")
    paths = ["--poses", str(tmp_path / "walk.txt"), "--out", str(tmp_path / "out"), "--quiet"]
    monkeypatch.setattr(sys, "argv", ["warpvis", "render", str(tmp_path / "box.obj"), *paths])
    main()
    one, two = read_frames(tmp_path / "walk.txt"), read_frames(tmp_path / "out" / "npz" / "shard-000000.npz")
    np.testing.assert_allclose(one.camera_to_world, two.camera_to_world, atol=1e-6)
    np.testing.assert_array_equal(one.timestamps, two.timestamps)


# Tables.


def write_csv(path, names, rows, **options):
    with open(path, "w", newline="") as file:
        writer = csv.writer(file, **options)
        writer.writerow(names)
        writer.writerows(rows)


def test_csv_files(tmp_path):
    path = tmp_path / "poses.csv"
    write_csv(path, ["x", "y", "z", "qx", "qy", "qz", "qw"], ROWS.tolist())
    frames = read_frames(path)
    assert frames.camera_to_world.tobytes() == ROWS.tobytes()
    np.testing.assert_array_equal(frames.timestamps, np.arange(6))

    names = ["", "qw", "TX", " ty", "tz ", "note", "qx", "qy", "qz", "timestamp"]  # pandas writes an index
    rows = [
        [index, row[6], *row[:3], 'a, "b"', *row[3:6], time]
        for index, (row, time) in enumerate(zip(ROWS.tolist(), TIMES.tolist(), strict=True))
    ]
    write_csv(path, names, rows, quoting=csv.QUOTE_ALL)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes() + b"\r\n\r\n# the end\r\n")
    frames = read_frames(path)
    assert frames.camera_to_world.tobytes() == ROWS.tobytes()
    np.testing.assert_array_equal(frames.timestamps, TIMES)

    path.write_text("# t,x,y,z,qx,qy,qz,qw\n" + "\n".join(["7,1,2,3,0,0,0,1"] * 2))
    assert read_frames(path).timestamps.tolist() == [7, 7]


def test_parquet_files(tmp_path):
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    columns = dict(zip(["tx", "ty", "tz", "qx", "qy", "qz", "qw"], ROWS.T, strict=True))
    table = arrow.table({"qw": columns["qw"], "name": ["a"] * 6, "time": TIMES, **columns})
    for name in ("poses.parquet", "poses.PQ"):
        parquet.write_table(table, tmp_path / name, row_group_size=2)
        frames = read_frames(tmp_path / name)
        assert frames.camera_to_world.tobytes() == ROWS.tobytes()
        np.testing.assert_array_equal(frames.timestamps, TIMES)
        assert frames.source == {"file": name, "format": "parquet", "convention": "opencv"}


def bad_tables():
    arrow = pytest.importorskip("pyarrow")
    columns = dict(zip(["x", "y", "z", "qx", "qy", "qz", "qw"], ROWS.T.tolist(), strict=True))
    yield {k: v for k, v in columns.items() if k != "qy"}, "poses.parquet: expected the column names x, y, z (or tx, t"
    yield {**columns, "tx": columns["x"]}, "poses.parquet: two columns are x: 'x' and 'tx'"
    yield {**columns, "z": [True] * 6}, "poses.parquet: column z must hold numbers, got bool"
    yield {**columns, "z": ["1"] * 6}, "poses.parquet: column z must hold numbers, got string"
    yield {**columns, "z": [[1.0]] * 6}, "poses.parquet: column z must hold numbers, got list<"
    yield {**columns, "z": [0.0] * 4 + [None] * 2}, "poses.parquet: row 4: poses must be finite numbers"
    yield {**columns, "t": [0.0] * 4 + [None] * 2}, "poses.parquet: timestamps must be finite: 2 are not, the first at"
    yield (
        {**columns, **{name: [0.5, 0, 0, 0.5, 0, 0.5] for name in ("qx", "qy", "qz", "qw")}},
        "poses.parquet: row 1: poses must have quaternions of length 1, got 0",
    )
    empty = {name: arrow.array([], arrow.float64()) for name in columns}
    yield empty, "poses.parquet: holds no poses"


def test_malformed_parquet_files_are_rejected(tmp_path):
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    for columns, said in bad_tables():
        parquet.write_table(arrow.table(columns), tmp_path / "poses.parquet")
        with pytest.raises(wv.errors.FileFormatError) as error:
            read_frames(tmp_path / "poses.parquet")
        assert str(error.value).removeprefix(f"{tmp_path}/").startswith(said)


@pytest.mark.parametrize(
    ("name", "module", "said"),
    [
        (
            "poses.parquet",
            "pyarrow",
            "Parquet files are read with pyarrow, which is missing: pip install 'warpvis[datas",
        ),
        ("bag.mcap", "rosbags", "ROS bags are read with rosbags, which is missing: pip install 'warpvis[ros]'"),
    ],
)
def test_missing_package_error_names_it(tmp_path, monkeypatch, name, module, said):
    real = builtins.__import__

    def refuse(imported, *arguments):
        if imported.split(".")[0] == module:
            raise ImportError(imported)
        return real(imported, *arguments)

    (tmp_path / name).write_bytes(b"")
    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(wv.errors.FileFormatError) as error:
        read_frames(tmp_path / name)
    assert str(error.value).startswith(f"{tmp_path / name}: {said}")


# Malformed files.


def zipped(name, content):
    """Return a ZIP archive with one file that is not an array."""
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        archive.writestr(name, content)
    return written.getvalue()


def save(function, *arguments, **options):
    def write(path):
        with open(path, "wb") as file:
            function(file, *arguments, **options)

    return write


HEADER = "x,y,z,qx,qy,qz,qw\n"
BAD_FILES = [
    ("poses.txt", None, "poses.txt: no such file"),
    ("poses.txt", "", "poses.txt: holds no lines 'timestamp tx ty tz qx qy qz qw'"),
    ("poses.txt", "0 0 0 0 0 0 0 1\n0 0 0 x 0 0 0 1\n", "poses.txt:2: expected the 8 numbers"),
    (
        "poses.txt",
        "0 0 0 0 0 0 0 1\n0 1e19 0 0 0 0 0 1\n",
        "poses.txt: pose 1: poses must be finite numbers of at most",
    ),
    ("poses.csv", "", "poses.csv: holds no line of column names x, y, z, qx, qy, qz, qw"),
    ("poses.csv", "1,2,3,0,0,0,1\n", "poses.csv:1: expected the column names x, y, z (or tx, ty, tz), qx, qy, qz, qw"),
    ("poses.csv", "x,y,z,qx,qy,qz\n", "poses.csv:1: expected the column names x, y, z (or tx, ty, tz), qx, qy, qz, q"),
    ("poses.csv", "x,y,z,qx,qy,qz,qw,X\n", "poses.csv:1: two columns are x: 'x' and 'X'"),
    ("poses.csv", HEADER, "poses.csv: holds no poses"),
    ("poses.csv", HEADER + "\n1,2,3,0,0,0\n", "poses.csv:3: expected 7 values, as there are column names, got 6"),
    ("poses.csv", HEADER + "1,2,3,0,0,0,one\n", 'poses.csv:2: expected finite numbers, got "one"'),
    ("poses.csv", HEADER + "1,2,3,0,0,0,nan\n", 'poses.csv:2: expected finite numbers, got "nan"'),
    ("poses.csv", HEADER + "1,2,3,0,0,0,1e999\n", 'poses.csv:2: expected finite numbers, got "1e999"'),
    (
        "poses.csv",
        HEADER + "#\n1,2,3,0,0,0,1\n1,2,3,0,0,0,0\n",
        "poses.csv:4: poses must have quaternions of length 1, g",
    ),
    ("poses.csv", HEADER + '"' + "1" * 200_000, "poses.csv:2: cannot be read as CSV: field larger than field limit"),
    ("poses.csv", b"\xff\xfe", "poses.csv: is not a text file of lines 'x,y,z,qx,qy,qz,qw'"),
    ("poses.npy", b"", "poses.npy: cannot be read as NPY: "),
    ("poses.npy", b"no array", "poses.npy: cannot be read as NPY: "),
    ("poses.npy", save(np.savez, a=ROWS), "poses.npy: cannot be read as NPY: it is an archive"),
    ("poses.npy", save(np.save, ROWS[:, :6]), "poses.npy: the array must be numbers of shape (V, 7) or (V, 4, 4), got"),
    (
        "poses.npy",
        save(np.save, ROWS > 0),
        "poses.npy: the array must be numbers of shape (V, 7) or (V, 4, 4), got boo",
    ),
    ("poses.npy", save(np.save, np.array(["a"])), "poses.npy: the array must be numbers of shape (V, 7) or (V, 4, 4),"),
    (
        "poses.npy",
        save(np.save, np.array(3.0)),
        "poses.npy: the array must be numbers of shape (V, 7) or (V, 4, 4), go",
    ),
    ("poses.npy", save(np.save, np.array([{}])), "poses.npy: cannot be read as NPY: Object arrays cannot be loaded"),
    ("poses.npy", save(np.save, ROWS[:0]), "poses.npy: holds no poses"),
    (
        "poses.npy",
        save(np.save, ROWS * np.r_[1, 1, 1, 0, 0, 0, 0]),
        "poses.npy: pose 0: poses must have quaternions of length 1, g",
    ),
    ("poses.npy", save(np.save, 2 * MATRICES), "poses.npy: pose 0: poses must have the last row 0 0 0 1"),
    ("poses.npz", b"PK\x03\x04 no zip", "poses.npz: cannot be read as NPZ: "),
    ("poses.npz", save(np.save, ROWS), "poses.npz: cannot be read as NPZ: it is one array"),
    ("poses.npz", save(np.savez, a=ROWS), "poses.npz: expected an array camera_to_world, got a"),
    (
        "poses.npz",
        zipped("camera_to_world", b"1 2 3"),
        "poses.npz: cannot be read as NPZ: camera_to_world is not an array",
    ),
    ("poses.npz", save(np.savez), "poses.npz: expected an array camera_to_world, got no arrays"),
    ("poses.npz", save(np.savez, camera_to_world=np.array([{}])), "poses.npz: cannot be read as NPZ: Object arrays"),
    (
        "poses.npz",
        save(np.savez, camera_to_world=ROWS, timestamp=[0], timestamps=[1]),
        "poses.npz: expected timestamps or timestamp, got both",
    ),
    (
        "poses.npz",
        save(np.savez, camera_to_world=ROWS, timestamp=TIMES[:2]),
        "poses.npz: timestamps must be 6 numbers of seconds, one per frame, got float64 of shape (2,)",
    ),
    (
        "poses.npz",
        save(np.savez, camera_to_world=ROWS, object_poses=unit(np.ones((2, 1, 7)))),
        "poses.npz: object_poses must be of 1 world or of 6 worlds, one per frame, got 2",
    ),
    (
        "poses.npz",
        save(np.savez, camera_to_world=ROWS, world_index=["a"] * 6, object_poses=unit(np.ones((2, 1, 7)))),
        "poses.npz: world_index must be an array of numbers, got dtype <U1",
    ),
    ("poses.parquet", b"PAR1 no table PAR1", "poses.parquet: cannot be read as Parquet: "),
    ("poses.parquet", b"", "poses.parquet: cannot be read as Parquet: "),
    ("poses.mcap", b"no bag", "poses.mcap: cannot be read as a ROS bag: "),
    ("poses.db3", b"no bag", "poses.db3: cannot be read as a ROS bag: "),
]


@pytest.mark.parametrize(("name", "content", "said"), BAD_FILES)
def test_malformed_files_are_rejected(tmp_path, name, content, said):
    path = tmp_path / name
    needed = {".parquet": "pyarrow", ".mcap": "rosbags", ".db3": "rosbags"}
    if path.suffix in needed:
        pytest.importorskip(needed[path.suffix])
    if callable(content):
        content(path)
    elif content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(wv.errors.FileFormatError) as error:
        read_frames(path)
    assert str(error.value).removeprefix(f"{tmp_path}/").startswith(said)
    assert "\n" not in str(error.value)


def test_invalid_arguments_are_rejected(tmp_path):
    np.save(tmp_path / "poses.npy", ROWS)
    for options, said in (
        (
            {"convention": "blender"},
            "convention must be one of 'opencv', 'opengl', 'ros_body', 'ros_optical', got 'blender'",
        ),
        (
            {"file_format": "exr"},
            "file_format must be one of tum, npy, npz, csv, parquet, nerfstudio, bop, colmap, ros, got 'e",
        ),
        ({"topic": "/tf"}, f"{tmp_path / 'poses.npy'}: topic= is for ROS bags, which this is not"),
        ({"file_format": "npz"}, f"{tmp_path / 'poses.npy'}: cannot be read as NPZ: it is one array"),
    ):
        with pytest.raises(wv.WarpvisError) as error:
            read_frames(tmp_path / "poses.npy", **options)
        assert str(error.value).startswith(said)
    with pytest.raises(
        wv.errors.FileFormatError,
        match=r"is a folder without poses: it holds no metadata\.yaml",
    ):
        read_frames(tmp_path)
    with pytest.raises(wv.errors.FileFormatError, match=r"path must be the name of a file, .* got 'a\\x00b'$"):
        read_frames("a\0b")
    with pytest.raises(wv.errors.FileFormatError, match=r"path is too long for the name of a file: 'aaa"):
        read_frames("a" * 5000)
    for file_format in ("tum", "npy", "npz", "csv", "parquet", "nerfstudio", "bop"):
        with pytest.raises(wv.errors.FileFormatError) as error:
            read_frames(tmp_path, file_format=file_format)
        assert "\n" not in str(error.value)


def whole_files():
    """Return a valid file of every format."""
    array, archive, table = io.BytesIO(), io.BytesIO(), io.BytesIO()
    np.save(array, ROWS)
    np.savez(archive, camera_to_world=ROWS, timestamps=TIMES, object_poses=np.ones((1, 1, 7)))
    lines = [",".join(map(repr, row)) for row in ROWS.tolist()]
    files = {
        "a.npy": array.getvalue(),
        "a.npz": archive.getvalue(),
        "a.csv": (HEADER + "\n".join(lines)).encode(),
        "a.txt": "\n".join("0," + line for line in lines).encode(),
        "transforms.json": json.dumps(nerfstudio()).encode(),
        "scene_camera.json": json.dumps(bop()).encode(),
    }
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        return files
    columns = dict(zip(["x", "y", "z", "qx", "qy", "qz", "qw"], ROWS.T, strict=True))
    parquet.write_table(pyarrow.table(columns), table)
    return {**files, "a.parquet": table.getvalue()}


FILES = whole_files()


@pytest.mark.parametrize("name", FILES)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_mutated_files_are_read_or_rejected(tmp_path, name, data):
    content = bytearray(FILES[name])
    for _ in range(data.draw(st.integers(0, 4))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] = data.draw(st.integers(0, 255))
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content))) :]
    (tmp_path / name).write_bytes(content)
    try:
        frames = read_frames(tmp_path / name)
    except wv.errors.FileFormatError as error:
        assert str(error).startswith(str(tmp_path / name))
        assert "\n" not in str(error)
    else:
        assert np.isfinite(frames.camera_to_world).all()
        np.testing.assert_allclose(np.linalg.norm(frames.camera_to_world[:, 3:], axis=1), 1, atol=1e-12)


VALUES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=9)
        | st.dictionaries(st.sampled_from(["frames", "transform_matrix", "cam_R_w2c", "cam_t_w2c", "0", "x"]), inner)
    ),
    max_leaves=30,
)


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=VALUES)
def test_arbitrary_json_is_rejected(tmp_path, data):
    (tmp_path / "a.json").write_text(json.dumps(data))
    with pytest.raises(wv.errors.FileFormatError, match=r"a\.json"):
        read_frames(tmp_path / "a.json")
