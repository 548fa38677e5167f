# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Objects of images of BOP datasets: each row of the table of docs/scene_files/bop.md, and invalid files."""

import json

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial.transform import Rotation

import warpvis as wv
from warpvis import Label, Scene
from warpvis.errors import FileFormatError, SceneError
from warpvis.io import load_bop_scene, read_frames

from support.bop_scene import MODELS, write_bop, write_identity


def pose(seed):
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    matrix[:3, 3] = rng.uniform(-1, 1, 3)
    return matrix


CAMERAS = {3: pose(0), 12: pose(1)}
PLACES = {3: [(5, pose(2)), (11, pose(3)), (5, pose(4))], 12: [(11, pose(5))]}


def expect(scene, placements, to_frame):
    """Check the objects against models in millimeters at their poses."""
    for item, (number, matrix) in zip(scene, placements, strict=True):
        mesh = MODELS[number]
        to_scene = to_frame @ matrix
        vertices = mesh.vertices / 1000 @ to_scene[:3, :3].T + to_scene[:3, 3]
        np.testing.assert_allclose(item.vertices[item.faces], vertices[mesh.faces], atol=1e-6)


@pytest.mark.parametrize("image", [3, 12])
@pytest.mark.parametrize("frame", ["world", "camera"])
def test_objects_of_an_image(tmp_path, image, frame):
    folder = write_bop(tmp_path, CAMERAS, PLACES)
    scene = load_bop_scene(folder, image, frame=frame)
    expect(scene, PLACES[image], np.eye(4) if frame == "world" else CAMERAS[image])
    assert {item.label for item in scene} == {Label.OBJECT}


def test_names_and_shared_meshes(tmp_path):
    folder = write_bop(tmp_path, CAMERAS, PLACES)
    scene = load_bop_scene(folder, movable=True)
    assert [item.name for item in scene] == ["obj_000005", "obj_000011", "obj_000005_1"]
    assert all(item.movable for item in scene) and not any(item.movable for item in load_bop_scene(folder))
    assert scene["obj_000005"].mesh is scene["obj_000005_1"].mesh


def test_poses_of_cameras_are_those_of_read_frames(tmp_path):
    folder = write_bop(tmp_path, CAMERAS, PLACES)
    frames = read_frames(folder)
    camera = wv.Camera(64, 48, 50.0, 50.0, 32.5, 24.5, near=0.0)
    world, local = (load_bop_scene(folder, 12, frame=frame) for frame in ("world", "camera"))
    there = wv.render(world, camera, frames.camera_to_world[1], outputs="depth").depth.numpy()
    here = wv.render(local, camera, (0, 0, 0, 0, 0, 0, 1), outputs="depth").depth.numpy()
    np.testing.assert_allclose(there, here, atol=1e-5)


def test_scene_load_reads_the_first_image(tmp_path):
    folder = write_bop(tmp_path, CAMERAS, PLACES)
    expect(Scene.load(folder / "scene_gt.json"), PLACES[3], np.eye(4))
    (folder / "scene_camera.json").unlink()
    expect(Scene.load(folder / "scene_gt.json"), PLACES[3], CAMERAS[3])


def test_folders_of_models(tmp_path):
    folder = write_bop(tmp_path, CAMERAS, PLACES, models="models_eval")
    expect(load_bop_scene(folder), PLACES[3], np.eye(4))
    (tmp_path / "models_eval").rename(tmp_path / "cad")
    expect(load_bop_scene(folder, models=tmp_path / "cad"), PLACES[3], np.eye(4))
    expect(Scene.load(folder / "scene_gt.json", search_path=tmp_path / "cad"), PLACES[3], np.eye(4))


def test_colors_of_models(tmp_path):
    folder = write_identity(tmp_path)
    mesh = MODELS[5].copy()
    mesh.visual.vertex_colors = [200, 100, 50, 255]
    mesh.export(tmp_path / "models/obj_000005.ply")
    assert (load_bop_scene(folder)["obj_000005"].appearance.vertex_colors == (200, 100, 50, 255)).all()


def test_texture_of_models(tmp_path):
    """Vertices have texture coordinates, and a comment names the image, as in the models of HOPE."""
    folder = write_identity(tmp_path)
    header = "ply\nformat ascii 1.0\ncomment TextureFile mug.png\nelement vertex 3\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "texture_u", "texture_v"))
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    corners = "0 0 0 0.1 0.2\n100 0 0 0.9 0.2\n0 100 0 0.1 0.8\n3 0 1 2\n"
    (tmp_path / "models/obj_000005.ply").write_text(header + corners)
    Image.new("RGB", (2, 2), (10, 200, 30)).save(tmp_path / "models/mug.png")
    item = load_bop_scene(folder)["obj_000005"]
    assert (item.appearance.materials[0].texture.image[..., :3] == (10, 200, 30)).all()
    np.testing.assert_allclose(item.appearance.corner_uv(item.faces)[0], [(0.1, 0.2), (0.9, 0.2), (0.1, 0.8)])


def test_other_files_are_ignored(tmp_path):
    """Symmetries, sizes and visibilities do not affect the scene, nor do invalid ones."""
    folder = write_bop(tmp_path, CAMERAS, PLACES)
    symmetries = {"5": {"diameter": "x", "symmetries_discrete": [[1]], "symmetries_continuous": 3}}
    (tmp_path / "models/models_info.json").write_text(json.dumps(symmetries))
    (folder / "scene_gt_info.json").write_text("[")
    (tmp_path / "camera.json").write_text("{}")
    expect(load_bop_scene(folder), PLACES[3], np.eye(4))


def test_hdf5_of_blenderproc_is_not_read(tmp_path):
    (tmp_path / "0.hdf5").write_bytes(b"\x89HDF\r\n\x1a\n")
    with pytest.raises(FileFormatError, match=r"0.hdf5: '.hdf5' is not a scene format"):
        Scene.load(tmp_path / "0.hdf5")


def test_several_cameras(tmp_path):
    folder = write_bop(tmp_path, CAMERAS, PLACES)
    for name in ("scene_gt", "scene_camera"):
        (folder / f"{name}.json").rename(folder / f"{name}_gray1.json")
    expect(load_bop_scene(folder / "scene_gt_gray1.json", 12), PLACES[12], np.eye(4))


def test_a_written_dataset_is_the_scene(tmp_path):
    """Write a dataset by `render_batch`, and load its objects again."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((0.3, 0.2, 0.5)), name="carton", label="object", pose=pose(7))
    scene.add(trimesh.creation.icosphere(radius=0.2), name="ball", label="object", pose=pose(8))
    camera = wv.Camera.from_fov(32, 24, hfov=1.0)
    poses = np.array([wv.look_at((3, 0, 1), (0, 0, 0)), wv.look_at((0, 3, 1), (0, 0, 0))])
    wv.render_batch(scene, camera, poses, tmp_path / "out", format="bop", objects=["carton", "ball"])
    folder = next((tmp_path / "out").glob("*/*/scene_gt.json")).parent
    found = load_bop_scene(folder, 1)
    for item, other in zip(found, scene, strict=True):
        np.testing.assert_allclose(item.vertices[item.faces], other.vertices[other.faces], atol=2e-6)


INVALID = {
    "list": ("scene_gt.json", [], r"scene_gt.json: must contain a JSON object, got \[\]"),
    "empty": ("scene_gt.json", {}, r"scene_gt.json: must have images by their ids, got nothing"),
    "keys": ("scene_gt.json", {"a": []}, r"scene_gt.json: must have images by their ids, got other keys"),
    "no list": ("scene_gt.json", {"3": {}}, r"scene_gt.json: '3' must be a list of objects, got an object"),
    "no id": ("scene_gt.json", {"3": [{}]}, r"'3'\[0\]\['obj_id'\] must be a whole number, got nothing"),
    "no pose": ("scene_gt.json", {"3": [{"obj_id": 5}]}, r"'3'\[0\]\['cam_R_m2c'\] must be numbers, got nothing"),
    "short": (
        "scene_gt.json",
        {"3": [{"obj_id": 5, "cam_R_m2c": [1, 0], "cam_t_m2c": [0, 0, 0]}]},
        r"\['cam_R_m2c'\] must be 9 finite numbers, got \[1, 0\]",
    ),
    "mirror": (
        "scene_gt.json",
        {"3": [{"obj_id": 5, "cam_R_m2c": [-1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_m2c": [0, 0, 0]}]},
        r"\['cam_R_m2c'\] must be a rotation matrix, got \[\[-1.0",
    ),
    "model": (
        "scene_gt.json",
        {"3": [{"obj_id": 6, "cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_m2c": [0, 0, 0]}]},
        r"obj_000006.ply: no such file, which the object 6 needs",
    ),
    "no world": (
        "scene_camera.json",
        {"3": {}},
        r"image 3 has no cam_R_w2c, which the frame 'world' needs; use 'camera'",
    ),
    "nothing": ("scene_gt.json", {"3": []}, r"scene_gt.json: holds no triangles"),
}


@pytest.mark.parametrize("case", INVALID)
def test_invalid_files(tmp_path, case):
    name, content, message = INVALID[case]
    folder = write_identity(tmp_path)
    (folder / name).write_text(json.dumps(content))
    with pytest.raises((FileFormatError, SceneError), match=message):
        load_bop_scene(folder)


def test_invalid_arguments(tmp_path):
    folder = write_identity(tmp_path)
    with pytest.raises(FileFormatError, match=r"has no image 4; its images are 3 to 3"):
        load_bop_scene(folder, 4)
    with pytest.raises(SceneError, match=r"frame must be"):
        load_bop_scene(folder, frame="robot")
    with pytest.raises(FileFormatError, match=r"needs a folder of models \(obj_000001.ply\), and .*cad is not one"):
        load_bop_scene(folder, models=tmp_path / "cad")
    (folder / "scene_camera.json").unlink()
    with pytest.raises(FileFormatError, match=r"scene_camera.json: no such file, which the frame 'world' needs"):
        load_bop_scene(folder)
