# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Path arguments accept strings and any `os.PathLike`, not only `pathlib.Path`."""

import json
import os

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.batch import FrameRenderer, verify


class Place:
    """A minimal `os.PathLike`."""

    def __init__(self, path):
        self.path = str(path)

    def __fspath__(self):
        return self.path


FORMS = {"text": str, "PathLike": Place}
CAMERA = wv.Camera.from_fov(8, 6, hfov=1.0)
POSE = np.array([[0.0, 0, 0, 0, 0, 0, 1]])


@pytest.fixture(params=FORMS)
def at(request, tmp_path):
    """Return a function from file names in a folder to paths of one type."""
    return lambda name: FORMS[request.param](tmp_path / name)


@pytest.fixture
def box_file(tmp_path):
    trimesh.creation.box(transform=trimesh.transformations.translation_matrix((0, 0, 3))).export(tmp_path / "box.ply")
    return "box.ply"


def test_scene_paths(at, box_file):
    scene = wv.Scene.load(at(box_file))
    assert len(scene) == 1
    scene.export(at("box.glb"))
    assert wv.Scene.load(at("box.glb")).triangle_count == 12


def test_frame_renderer_and_batch_paths(at, box_file, tmp_path):
    seen = FrameRenderer(at(box_file), CAMERA)({"camera_to_world": POSE})
    assert seen["depth"][0, 3, 4] == 2.5
    wv.render_batch(at(box_file), CAMERA, wv.Frames.from_poses(POSE), at("set"), threads=1)
    assert verify(at("set")).ok
    assert json.loads((tmp_path / "set" / "manifest.json").read_text())["scene"]["file"] == "box.ply"


def test_pose_camera_and_point_paths(at, tmp_path):
    (tmp_path / "walk.txt").write_text("0 0 0 0 0 0 0 1\n")
    (tmp_path / "camera.json").write_text('{"width": 8, "height": 6, "hfov": 1.0}')
    (tmp_path / "points.txt").write_text("1 2 3\n")
    np.testing.assert_array_equal(wv.read_frames(at("walk.txt")).camera_to_world, POSE)
    np.testing.assert_array_equal(wv.io.read_poses(at("walk.txt"))[1], POSE)
    np.testing.assert_array_equal(wv.io.read_points(at("points.txt")), [[1, 2, 3]])
    assert wv.io.load_camera(at("camera.json")) == CAMERA


def test_depth_paths(at, tmp_path):
    wv.io.save_depth_png(np.ones((6, 8)), at("one.png"))
    assert "one.png" in os.listdir(tmp_path)


@pytest.mark.smoke("text")
def test_map_and_picture_paths(at, tmp_path):
    scene = wv.Scene()
    scene.add(trimesh.creation.box(), pose=(0, 0, 3, 0, 0, 0, 1), label="object")
    views = wv.render(scene, CAMERA, POSE)
    wv.voxel_map(views.depth, CAMERA, POSE, bounds=[[-1, -1, 2], [1, 1, 4]], cell_size=0.5).save(at("voxels.npz"))
    seen = wv.floor_map(views.points, views.labels, bounds=[[-1, -1], [1, 1]], cell_size=0.1)
    wv.viz.save_map(seen, at("map.png"))
    wv.viz.save_depth(views.depth.numpy()[0], at("depth.png"))
    assert {"voxels.npz", "map.png", "depth.png"} <= set(os.listdir(tmp_path))


def test_webots_paths(at, tmp_path):
    (tmp_path / "protos").mkdir()
    (tmp_path / "lab.wbt").write_text(
        '#VRML_SIM R2023b utf8\nSolid { name "box" children [ Shape { geometry Box { } } ] }\n'
    )
    assert len(wv.webots.load_webots(at("lab.wbt"), search_path=at("protos")).scene) == 1
    assert len(wv.webots.load_webots(at("lab.wbt"), search_path=[at("protos")]).scene) == 1


@pytest.mark.parametrize("path", [None, 0, 1, True, 2.5, b"a", "", "a\0b", [], object()])
def test_invalid_paths_are_rejected(path):
    """Integers are rejected too: Python treats them as open file descriptors, such as standard output."""
    depth = np.ones((6, 8), dtype=np.float32)
    space = wv.voxel_map(depth, CAMERA, POSE, bounds=[[-1, -1, 0.5], [1, 1, 1.5]])
    takers = [
        wv.Scene.load,
        wv.read_frames,
        wv.io.read_poses,
        wv.io.read_points,
        wv.io.load_camera,
        wv.webots.load_webots,
        verify,
        space.save,
        lambda place: wv.io.save_depth_png(depth, place),
        lambda place: wv.viz.save_depth(depth, place),
        lambda place: wv.render_batch(FLAG, CAMERA, wv.Frames.from_poses(POSE), place, threads=1),
        FLAG.export,
    ]
    for take in takers:
        with pytest.raises(wv.errors.FileFormatError):
            take(path)


FLAG = wv.Scene()
FLAG.add(([[0, 0, 1], [1, 0, 1], [0, 1, 1]], [[0, 1, 2]]))


@pytest.mark.parametrize(
    "read", [wv.io.load_camera, wv.read_frames, wv.Scene.load, wv.open_dataset], ids=lambda f: f.__name__
)
def test_too_long_file_names_are_rejected(read):
    with pytest.raises(wv.WarpvisError, match="is too long for the name of a file: 'aaaa"):
        read("a" * 5000)
