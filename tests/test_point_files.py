# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Points from text, CSV, .npy and .ply files, and errors for malformed files."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.io import read_points

POINTS = np.array([[0.5, -1, 2], [1e-3, 0, -7.25], [3, 4, 5]])


@pytest.mark.parametrize(
    "text",
    [
        "0.5 -1 2\n0.001 0 -7.25\n3 4 5\n",
        "# three points\n\n  0.5\t-1   2\n# and two\n1e-3 0 -7.25\n3 4 5",
        "x,y,z\n0.5,-1,2\n1e-3,0,-7.25\n3, 4, 5\n",
        "# comma, space\nX Y Z\n0.5, -1, 2\n.001, 0, -7.25\n3, 4, 5\n",
    ],
)
@pytest.mark.parametrize("name", ["points.txt", "points.csv", "points.xyz"])
def test_text_files(tmp_path, text, name):
    (tmp_path / name).write_text(text)
    np.testing.assert_array_equal(read_points(tmp_path / name), POINTS)


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int32])
def test_npy_files(tmp_path, dtype):
    np.save(tmp_path / "points.npy", POINTS.astype(dtype))
    points = read_points(tmp_path / "points.npy")
    assert points.dtype == np.float64
    np.testing.assert_array_equal(points, POINTS.astype(dtype))


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_ply_files(tmp_path, encoding):
    trimesh.PointCloud(POINTS).export(tmp_path / "cloud.ply", encoding=encoding)
    np.testing.assert_allclose(read_points(tmp_path / "cloud.ply"), POINTS, atol=1e-6)
    box = trimesh.creation.box()
    box.export(tmp_path / "mesh.PLY", file_type="ply")
    np.testing.assert_array_equal(read_points(tmp_path / "mesh.PLY"), box.vertices)


def test_byte_order_marks_are_ignored(tmp_path):
    (tmp_path / "points.csv").write_text("\ufeff1,2,3\n", encoding="utf-8")
    assert read_points(tmp_path / "points.csv").tolist() == [[1, 2, 3]]
    (tmp_path / "walk.txt").write_text("\ufeff0 1 2 3 0 0 0 1\n", encoding="utf-8")
    assert wv.io.read_poses(tmp_path / "walk.txt")[1].tolist() == [[1, 2, 3, 0, 0, 0, 1]]


def save_npy(array):
    return lambda path: np.save(path, array, allow_pickle=True)


def save_npz(path):
    with open(path, "wb") as file:
        np.savez(file, points=POINTS)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("points.txt", None, "points.txt: no such file"),
        ("points.txt", "", "points.txt: holds no points"),
        ("points.csv", "x,y,z\n# none\n", "points.csv: holds no points"),
        ("points.txt", "# a\n1 2 3\n4 5\n", "points.txt:3: expected three finite numbers 'x y z', got '4 5'"),
        ("points.csv", "1,2,3,4\n", "points.csv:1: expected three finite numbers 'x y z', got '1 2 3 4'"),
        ("points.csv", "1,2,3\nx,y,z\n", "points.csv:2: expected three finite numbers 'x y z', got 'x y z'"),
        ("points.txt", "1 2 inf\n", "points.txt:1: expected three finite numbers 'x y z', got '1 2 inf'"),
        ("points.txt", b"\xff\xfe\x00", "points.txt: is not a text file of lines 'x y z'"),
        ("points.npy", b"no array", "points.npy: cannot be read as NPY: "),
        (
            "points.npy",
            save_npy(POINTS[:, :2]),
            "points.npy: expected an array of numbers of shape (N, 3), got float64",
        ),
        ("points.npy", b"PK\x03\x04 no zip", "points.npy: cannot be read as NPY: "),
        ("points.npy", save_npy(np.array(["a b c"])), "points.npy: expected an array of numbers of shape (N, 3), got"),
        ("points.npy", save_npy(np.array([[{}, 1, 2]])), "points.npy: cannot be read as NPY: "),
        ("points.npy", save_npz, "points.npy: cannot be read as NPY: it is an archive"),
        ("points.npy", save_npy(np.empty((0, 3))), "points.npy: holds no points"),
        ("points.npy", save_npy(np.array([[0, 0, 0], [0, np.nan, 0]])), "points.npy: points must be finite, and 1 are"),
        ("points.ply", b"ply\nformat", "points.ply: cannot be read as PLY: "),
    ],
)
def test_malformed_files_are_rejected(tmp_path, name, content, said):
    path = tmp_path / name
    if callable(content):
        content(path)
    elif content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(wv.errors.FileFormatError) as error:
        read_points(path)
    assert str(error.value).removeprefix(f"{tmp_path}/").startswith(said)
    assert "\n" not in str(error.value)
