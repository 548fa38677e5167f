# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""`Scene.export`, read back by our reader and by trimesh, and its cost."""

import json
import sys

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.errors import FileFormatError
from warpvis.scene import solids

BALL = trimesh.creation.icosphere(subdivisions=1, radius=0.3)
BOX = trimesh.creation.box((1, 2, 3))
TURNED = (0.1, 0.2, -0.3, 0.5, 0.5, -0.5, 0.5)


def poses(count):
    rng = np.random.default_rng(count)
    turns = rng.normal(size=(count, 4))
    return np.concatenate([rng.uniform(-9, 9, (count, 3)), turns / np.linalg.norm(turns, axis=1)[:, None]], axis=1)


def all_kinds(up="z"):
    """Return a scene with an object of every kind, including a deforming one."""
    scene = wv.Scene(up=up, label_names={40: "toy"})
    scene.add(BOX, name="world", label="ground")
    scene.add(BALL, name="lamp", pose=TURNED)
    scene.add(BALL, name="other lamp", pose=(9, 8, 7, 0, 0, 0, 1), label="toy")
    scene.add_instances(BALL, poses(5), names="fixed", movable=False, label="human")
    scene.add_instances(BALL, poses(4), names="ball", label=40)
    scene.add(BOX, name="cart", pose=TURNED, movable=True, scale=(1, 2, 0.5))
    scene.add(BALL, name="load", pose=(0, 0, 2, 0, 0, 0, 1), attach_to="cart")
    scene.add(solids.capsule(0.2, 0.5), name="pill", pose=(4, 5, 6, 0.5, 0.5, 0.5, 0.5), movable=True)
    scene.add(BOX, name="rug", pose=TURNED, movable=True)
    scene.update_vertices("rug", BOX.vertices * (1, 1, 0.1))
    return scene


def content_of(path):
    """Return the JSON of a binary glTF file, and the file's length."""
    file = path.read_bytes()
    assert file[:8] == b"glTF\2\0\0\0"
    assert int.from_bytes(file[8:12], "little") == len(file)
    length = int.from_bytes(file[12:16], "little")
    assert length % 4 == 0
    return json.loads(file[20 : 20 + length]), len(file)


@pytest.mark.parametrize("up", ["z", "y"])
def test_every_kind_of_object_round_trips(tmp_path, up):
    scene = all_kinds(up)
    scene.export(tmp_path / "scene.glb")
    back = wv.Scene.load(tmp_path / "scene.glb", up=up)
    assert [(item.name, item.label) for item in back] == [(item.name, item.label) for item in scene]
    assert back.label_names[40] == "toy"
    for item in scene:
        np.testing.assert_allclose(back[item.name].vertices, item.vertices, atol=2e-6)
        np.testing.assert_array_equal(back[item.name].faces, item.faces)


def test_trimesh_reads_it_y_up(tmp_path):
    scene = all_kinds()
    scene.export(tmp_path / "scene.glb")
    other = trimesh.load_scene(tmp_path / "scene.glb", process=False)
    for item in scene:
        x, y, z = item.vertices.T
        if item.name == "world":  # trimesh's name for its root
            continue
        matrix, geometry = other.graph[item.name]
        corners = trimesh.transform_points(other.geometry[geometry].vertices, matrix)
        np.testing.assert_allclose(corners, np.stack([x, z, -y], axis=1), atol=2e-6)


def test_shared_mesh_is_written_once(tmp_path):
    scene = all_kinds()
    scene.export(tmp_path / "few.glb")
    scene.add_instances(BALL, poses(100), names="more")
    scene.add_instances(BALL, poses(100), names="more_that_stay", movable=False)
    scene.export(tmp_path / "many.glb")
    (few, _), (many, length) = (content_of(tmp_path / name) for name in ("few.glb", "many.glb"))
    assert len(many["nodes"]) == len(few["nodes"]) + 200
    assert len(many["meshes"]) == len(few["meshes"]) == 7
    assert length < 100_000
    for accessor, view in zip(many["accessors"], many["bufferViews"], strict=True):
        if accessor["type"] == "VEC3":
            assert len(accessor["min"]) == len(accessor["max"]) == 3
        assert view["byteOffset"] % 4 == 0


def calls_of_export(path, count):
    scene = wv.Scene()
    for pose in poses(count // 2):
        scene.add(BALL, pose=pose)
    scene.add_instances(BALL, poses(count // 2), names="movable")
    calls = 0

    def look(_frame, event, _):
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(look)
    try:
        scene.export(path)
    finally:
        sys.setprofile(None)
    return calls


def test_export_takes_linear_time(tmp_path):
    """Four times as many objects take at most four times as many calls; once it was sixteen times as many."""
    few, many = (calls_of_export(tmp_path / "scene.glb", count) for count in (100, 400))
    assert 100 < few < many <= 4 * few


def test_failed_export_leaves_no_file(tmp_path, monkeypatch):
    scene = all_kinds()
    scene["rug"].points.fill_(np.nan)
    with pytest.raises(FileFormatError, match=r"scene.glb: vertices of 'rug' must be finite"):
        scene.export(tmp_path / "scene.glb")
    scene["rug"].points.zero_()
    monkeypatch.setattr("warpvis.io._scene_files._MAX_BYTES", 1000)
    with pytest.raises(
        FileFormatError, match=r"scene.glb: binary glTF has at most 1000 bytes, but this file would have"
    ):
        scene.export(tmp_path / "scene.glb")
    assert not list(tmp_path.iterdir())
