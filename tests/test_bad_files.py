# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Invalid files raise one sentence with the file, the value and the expectation."""

import os

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Scene
from warpvis.io import depth_to_units, read_poses, save_depth_png

BOX = trimesh.creation.box()
FILES = {
    "missing": ("box.obj", None, r"box.obj: no such file"),
    "no mesh": ("box.txt", b"hello", r"box.txt: '.txt' is not a scene format; supported are .*glb"),
    "without triangles": ("box.obj", b"hello", r"box.obj: holds no triangles"),
    "broken PLY": ("box.ply", b"ply\nformat ascii 1.0\nelement vertex 3\n", r"box.ply: cannot be read as PLY"),
    "broken GLB": ("box.glb", b"junk", r"box.glb: cannot be read as GLB"),
    "broken STL": ("box.stl", b"solid x", r"box.stl: "),
    "empty": ("box.obj", b"", r"box.obj: "),
}


@pytest.mark.parametrize("case", FILES)
def test_invalid_scene_files_raise(tmp_path, case):
    name, content, message = FILES[case]
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(wv.WarpvisError, match=message):
        Scene.load(tmp_path / name)


def test_labels_that_match_no_object_raise(tmp_path):
    BOX.export(tmp_path / "box.stl")
    with pytest.raises(wv.errors.SceneError, match=r"labels for .wall_\*. fit no object of .*box.stl, which has 'box'"):
        Scene.load(tmp_path / "box.stl", labels={"wall_*": "obstacle"})


TRAJECTORIES = {
    "words": ("0 0 0 0 0 0 0 1\n# fine\n1 2 3 4 5 6 seven 8\n", r"poses.txt:3: expected the 8 numbers 'timestamp tx"),
    "too few": ("0 0 0 0 0 0 1\n", r"poses.txt:1: expected the 8 numbers .*, got 7 words"),
    "not finite": ("0 0 0 nan 0 0 0 1\n", r"poses.txt:1: numbers must be finite"),
    "zero quaternion": ("\n0 0 0 0 0 0 0 0\n", r"poses.txt:2: the quaternion qx qy qz qw must have length 1, got 0"),
    "empty": ("# nothing\n", r"poses.txt: holds no lines"),
    "binary": (b"\xff\xfe\x00", r"poses.txt: is not a text file"),
    "missing": (None, r"poses.txt: cannot be read: No such file"),
}


@pytest.mark.parametrize("case", TRAJECTORIES)
def test_invalid_trajectories_raise(tmp_path, case):
    text, message = TRAJECTORIES[case]
    if text is not None:
        (tmp_path / "poses.txt").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(wv.errors.FileFormatError, match=message):
        read_poses(tmp_path / "poses.txt")


def test_save_depth_png_errors(tmp_path):
    with pytest.raises(wv.errors.ArrayError, match=r"depth must have shape \(H, W\)"):
        save_depth_png(np.ones((1, 240, 320), dtype=np.float32), tmp_path / "depth.png")
    with pytest.raises(wv.errors.FileFormatError, match="cannot be written"):
        save_depth_png(np.ones((240, 320), dtype=np.float32), tmp_path / "nowhere" / "depth.png")
    assert os.listdir(tmp_path) == []


def test_depth_outside_16_bits_becomes_zero():
    depth = [0.0004, 0.001, 65.534, 65.535, 65.536, np.inf, -np.inf, np.nan, -1.0]
    assert depth_to_units(depth, 1000).tolist() == [0, 1, 65534, 0, 0, 0, 0, 0, 0]
