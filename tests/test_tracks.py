# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of `wv.io.read_tracks`: poses of several people over time."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import warpvis as wv

HEAD = "timestamp,name,x,y,z,qx,qy,qz,qw"


def write(path, rows, head=HEAD):
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def pose(x, angle):
    return [x, 2.0, 1.5, *Rotation.from_rotvec((0, 0, angle)).as_quat()]


def test_poses_are_interpolated_by_name(tmp_path):
    rows = [
        f"{when},{name},{','.join(map(repr, map(float, pose(x, angle))))}"
        for when, name, x, angle in [(0.5, "ben", 0, 0.2), (1, "anna", 1, 0.1), (0, "anna", 0, -0.3), (3, "anna", 9, 1)]
    ]
    tracks = wv.io.read_tracks(write(tmp_path / "people.csv", rows))
    assert list(tracks) == ["ben", "anna"]
    turns = Slerp([0, 1], Rotation.from_rotvec([(0, 0, -0.3), (0, 0, 0.1)]))
    found = tracks["anna"].pose_at(0.25)
    np.testing.assert_allclose(found[:3], (0.25, 2, 1.5), atol=1e-12)
    np.testing.assert_allclose(np.abs(found[3:] @ turns(0.25).as_quat()), 1, atol=1e-12)
    np.testing.assert_allclose(tracks["anna"].pose_at(3), pose(9, 1), atol=1e-12)
    np.testing.assert_allclose(tracks["anna"].pose_at(3.9), pose(9, 1), atol=1e-12)
    assert tracks["anna"].pose_at(2.5) is None and tracks["anna"].pose_at(4.1) is None
    np.testing.assert_allclose(tracks["anna"].pose_at(2.5, max_gap=1.5)[0], 7, atol=1e-12)
    np.testing.assert_allclose(tracks["ben"].pose_at(1e9), pose(0, 0.2), atol=1e-12)


def test_one_person_is_read_from_a_trajectory(tmp_path):
    (tmp_path / "anna.txt").write_text("0 1 2 3 0 0 0 1\n1 2 2 3 0 0 0 1\n")
    tracks = wv.io.read_tracks(tmp_path / "anna.txt")
    np.testing.assert_allclose(tracks["anna"].pose_at(0.5), (1.5, 2, 3, 0, 0, 0, 1))
    unnamed = write(tmp_path / "one.csv", ["1,2,3,0,0,0,1"], head="x,y,z,qx,qy,qz,qw")
    assert list(wv.io.read_tracks(unnamed)) == ["person"]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([], "holds no poses"),
        (["0,anna,1,2,3,0,0,0,1"] * 2, "'anna' must have one pose at a time, got several at 0.000000 s"),
        (["0,,1,2,3,0,0,0,1"], "names must not be empty"),
        (["0,anna,1,2,3,0,0,0,1", "1,anna,1,2,3,0,0,0,2"], r"people\.csv:3"),
        (["0,anna,1,2,three,0,0,0,1"], r"people\.csv:2: expected finite numbers"),
    ],
)
def test_bad_files_are_refused(rows, message, tmp_path):
    with pytest.raises(wv.WarpvisError, match=message):
        wv.io.read_tracks(write(tmp_path / "people.csv", rows))
