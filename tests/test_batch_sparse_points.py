# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sparse points of COLMAP's and nerfstudio's data sets, compared with their images and depth maps."""

import json

import numpy as np
import pytest
import trimesh
from batch_jobs import make_poses, run, tree
from PIL import Image

import warpvis as wv
from warpvis.batch.formats import _sparse_points
from warpvis.cameras import LensCamera, lenses
from warpvis.cameras.frames import Frames
from warpvis.errors import FileFormatError

CAMERA = wv.Camera(64, 48, fx=70.0, fy=66.0, cx=30.3, cy=25.1, near=0.3, far=6.0)
FRAMES = 9
COLORS = {"floor": (0.8, 0.6, 0.4), "box": (0.2, 0.4, 0.9), "ball": (0.9, 0.1, 0.2)}
OPTIONS = {"sparse_points": 900}


def make_scene(up="z", *, movable=False):
    """Return a floor, a box and a ball without lights, which show their base colors."""
    scene = wv.Scene(up=up)
    turn = np.eye(4) if up == "z" else np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
    meshes = {
        "floor": (trimesh.creation.box((6, 6, 0.1)), (0, 0, -0.05)),
        "box": (trimesh.creation.box((0.5, 0.5, 1.0)), (0.6, 0, 0.5)),
        "ball": (trimesh.creation.icosphere(subdivisions=3, radius=0.4), (-0.5, 0.3, 0.4)),
    }
    for name, (mesh, center) in meshes.items():
        pose = (turn[:3, :3] @ center).tolist() + [0, 0, 0, 1]
        mesh.apply_transform(turn)
        scene.add(mesh, name=name, pose=pose, movable=movable and name == "ball", appearance=COLORS[name])
    return scene


def write(out, kind="colmap", *, scene=None, camera=CAMERA, poses=None, options=OPTIONS, shard_frames=4, **changes):
    frames = Frames.from_poses(make_poses(FRAMES) if poses is None else poses, **changes)
    scene = scene or make_scene()
    return run(out, scene=scene, frames=frames, camera=camera, format=kind, options=options, shard_frames=shard_frames)


def read_model(folder):
    import pycolmap

    model = pycolmap.Reconstruction()
    model.read(str(folder))
    return model


def observed(model, image):
    """Return identifiers, image coordinates, world positions and depths of the points in an image."""
    seen = [item for item in image.points2D if item.has_point3D()]
    ids = [item.point3D_id for item in seen]
    positions = np.array([model.points3D[number].xyz for number in ids]).reshape(-1, 3)
    depths = np.array([(image.cam_from_world() * position)[2] for position in positions])
    return ids, np.array([item.xy for item in seen]).reshape(-1, 2), positions, depths


@pytest.mark.parametrize("lens", [False, True])
def test_points_reproject_to_their_observations(tmp_path, lens):
    opencv = lenses.OpenCVPinhole(70.0, 66.0, 30.3, 25.1, (-0.1, 0.02, 0.002, -0.001))
    write(tmp_path, camera=LensCamera(opencv, 64, 48, near=0.3, far=6.0) if lens else CAMERA)
    model = read_model(tmp_path / "sparse" / "0")
    assert (model.num_images(), model.num_cameras()) == (FRAMES, 1)
    assert 500 < model.num_points3D() <= 900
    lengths = [len(point.track.elements) for point in model.points3D.values()]
    assert min(lengths) >= 1
    assert np.mean(lengths) > 3
    worst = 0.0
    for image in model.images.values():
        _, pixels, positions, _ = observed(model, image)
        assert len(pixels) > 100
        projected = np.array([image.project_point(position) for position in positions])
        worst = max(worst, np.abs(projected - pixels).max())
    assert worst < 1e-3


def test_points_are_observed_where_depth_maps_show_them(tmp_path):
    import pycolmap

    write(tmp_path)
    model = read_model(tmp_path / "sparse")
    visible, all_points = 0, np.array([point.xyz for point in model.points3D.values()])
    for image in model.images.values():
        file = pycolmap.DepthMap()
        file.read(str(tmp_path / "stereo/depth_maps" / f"{image.name}.geometric.bin"))
        depth_map = file.to_array()
        _, pixels, _, depths = observed(model, image)
        x, y = np.floor(pixels).astype(int).T
        shown = depth_map[y, x]
        at_center = np.abs(pixels % 1 - 0.5).max(axis=1) < 1e-6
        assert at_center.any()
        np.testing.assert_allclose(depths[at_center], shown[at_center], rtol=1e-5)
        # Elsewhere, the depth is between those of the pixel and its neighbors, except at edges.
        padded = np.pad(np.where(depth_map > 0, depth_map, np.inf), 1, mode="edge")
        around = np.stack([padded[y + dy, x + dx] for dy in range(3) for dx in range(3)])
        between = (depths > around.min(axis=0) - 1e-3) & (depths < around.max(axis=0) + 1e-3)
        assert between.mean() > 0.98
        visible += len(pixels)
    assert visible < 0.9 * FRAMES * len(all_points)  # the box and the ball hide points, and images end


def test_points_have_the_colors_of_their_surfaces(tmp_path):
    write(tmp_path)
    model = read_model(tmp_path / "sparse")
    expected = {tuple(np.rint(np.array(color) * 255).astype(int)) for color in COLORS.values()}
    assert {tuple(point.color.astype(int)) for point in model.points3D.values()} == expected
    for image in model.images.values():
        picture = np.asarray(Image.open(tmp_path / "images" / image.name)).astype(int)
        ids, pixels, _, _ = observed(model, image)
        at_center = np.flatnonzero(np.abs(pixels % 1 - 0.5).max(axis=1) < 1e-6)
        x, y = np.floor(pixels[at_center]).astype(int).T
        colors = np.array([model.points3D[ids[index]].color for index in at_center])
        assert np.abs(picture[y, x] - colors).max() <= 1


@pytest.mark.parametrize("up", ["z", "y"])
def test_nerfstudio_points_are_in_the_saved_world(tmp_path, up):
    turned = make_poses(FRAMES)
    eyes = [(3 * np.cos(a), 1.0, -3 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, FRAMES, endpoint=False)]
    poses = turned if up == "z" else np.array([wv.look_at(eye, (0, 0.4, 0), up="y") for eye in eyes])
    write(tmp_path, "nerfstudio", scene=make_scene(up), poses=poses)
    meta = json.loads((tmp_path / "transforms.json").read_text())
    assert meta["ply_file_path"] == "sparse_pc.ply"
    cloud = trimesh.load(tmp_path / "sparse_pc.ply")
    assert 500 < len(cloud.vertices) <= 900
    assert cloud.colors.shape == (len(cloud.vertices), 4)
    # With z up, every point is on the floor, the box or the ball.
    floor = np.abs(cloud.vertices[:, 2]) < 1e-5
    ball = np.abs(np.linalg.norm(cloud.vertices - (-0.5, 0.3, 0.4), axis=1) - 0.4) < 5e-3
    box = np.abs(np.abs(cloud.vertices - (0.6, 0, 0.5)) / (0.25, 0.25, 0.5)).max(axis=1) - 1 < 1e-4
    assert (floor | ball | box).all()
    assert min(floor.sum(), ball.sum(), box.sum()) > 20


def test_points_are_not_taken_from_objects_that_move(tmp_path):
    poses = np.tile(make_scene(movable=True).objects[2].pose, (FRAMES, 1, 1)).astype(np.float64)
    write(tmp_path / "still", scene=make_scene(movable=True), object_poses=poses)
    poses[:, 0, 2] += np.linspace(0, 1, FRAMES)
    write(tmp_path / "moves", scene=make_scene(movable=True), object_poses=poses)
    red = tuple(np.rint(np.array(COLORS["ball"]) * 255).astype(int))
    counts = {}
    for name in ("still", "moves"):
        points = read_model(tmp_path / name / "sparse").points3D.values()
        counts[name] = sum(tuple(point.color.astype(int)) == red for point in points)
    assert counts["still"] > 20
    assert counts["moves"] == 0


def test_long_jobs_have_points_and_observations_of_some_frames(tmp_path, monkeypatch):
    monkeypatch.setattr(_sparse_points, "_MAX_SOURCES", 3)
    monkeypatch.setattr(_sparse_points, "_MAX_OBSERVED", 5)
    monkeypatch.setattr(_sparse_points, "_MAX_OBSERVATIONS", 20)
    monkeypatch.setattr(_sparse_points, "_FRAMES_AT_ONCE", 2)
    write(tmp_path)
    model = read_model(tmp_path / "sparse")
    counts = {number: image.num_points3D for number, image in model.images.items()}
    assert sum(count > 0 for count in counts.values()) == 5
    own = [count for count in counts.values() if count > 20]
    assert len(own) == 3
    assert max(own) <= 320
    for image in model.images.values():
        _, pixels, positions, _ = observed(model, image)
        projected = np.array([image.project_point(position) for position in positions]).reshape(-1, 2)
        assert np.abs(projected - pixels).max(initial=0) < 1e-3


def test_model_does_not_depend_on_shards_and_is_the_same_in_both_folders(tmp_path):
    write(tmp_path / "a")
    write(tmp_path / "b", shard_frames=FRAMES)
    whole = tree(tmp_path / "a" / "sparse")
    for name in ("cameras", "images", "points3D"):
        assert whole[f"{name}.txt"] == whole[f"0/{name}.txt"]
    assert whole["points3D.txt"] == tree(tmp_path / "b" / "sparse")["points3D.txt"]


@pytest.mark.parametrize("kind", ["colmap", "nerfstudio"])
def test_without_points(tmp_path, kind):
    write(tmp_path / "none", kind, options={"sparse_points": "0"})
    sky = np.array([wv.look_at((0, 0, 3), (0, 1, 6))])
    with pytest.warns(UserWarning, match="sees nothing|see nothing"):
        write(tmp_path / "sky", kind, poses=sky)
    if kind == "colmap":
        for name, frames in (("none", FRAMES), ("sky", 1)):
            model = read_model(tmp_path / name / "sparse")
            assert (model.num_images(), model.num_points3D()) == (frames, 0)
    else:
        assert "ply_file_path" not in json.loads((tmp_path / "none" / "transforms.json").read_text())
        assert not (tmp_path / "none" / "sparse_pc.ply").exists()
        assert b"element vertex 0\n" in (tmp_path / "sky" / "sparse_pc.ply").read_bytes()


@pytest.mark.parametrize("value", [-1, 1.5, "many", True, float("inf")])
def test_invalid_number_of_points_raises(tmp_path, value):
    with pytest.raises(FileFormatError, match="option sparse_points must be a whole number from 0 up, got"):
        write(tmp_path / "out", options={"sparse_points": value})


def test_points_without_color_raise(tmp_path):
    with pytest.raises(FileFormatError, match="option sparse_points requires the output color, got depth"):
        run(tmp_path / "out", format="colmap", outputs=["depth"], options=OPTIONS)
