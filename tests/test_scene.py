# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of scenes: placement of meshes, names, labels, and mesh files."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Label, Scene

SUFFIXES = ["obj", "stl", "ply", "glb", "off"]


def test_objects_are_placed_in_the_world():
    scene = Scene()
    quarter_turn = (0, 0, np.sqrt(0.5), np.sqrt(0.5))
    box = trimesh.creation.box((2, 4, 6))
    index = scene.add(box, name="box", label="human", pose=(10, 0, 0, *quarter_turn), scale=(1, 1, 0.5))
    assert (index, scene["box"].label, scene.index("box")) == (0, Label.HUMAN, 0)
    np.testing.assert_allclose(scene["box"].bounds, [[8, -1, -1.5], [12, 1, 1.5]], atol=1e-5)
    np.testing.assert_allclose(scene.bounds, scene["box"].bounds)
    assert scene.triangle_count == 12


def test_meshes_accept_several_forms():
    scene = Scene()
    vertices, faces = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]
    scene.add((vertices, faces))
    scene.add((np.array(vertices, dtype=np.float32), np.array(faces, dtype=np.uint64)))
    scene.add(trimesh.Trimesh(vertices, faces))
    assert [item.name for item in scene] == ["object_0", "object_1", "object_2"]
    assert len(scene) == 3
    assert "object_1" in scene


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_formats_load(tmp_path, suffix):
    path = tmp_path / f"part.{suffix}"
    trimesh.creation.box((1, 2, 3)).export(path)
    scene = Scene.load(path, file_up="z")
    assert scene.triangle_count == 12
    assert [item.label for item in scene] == [Label.OBSTACLE]
    np.testing.assert_allclose(scene.bounds, [[-0.5, -1, -1.5], [0.5, 1, 1.5]], atol=1e-6)


def test_unnamed_object_takes_the_file_name(tmp_path):
    trimesh.creation.box().export(tmp_path / "gearbox.stl")
    assert [item.name for item in Scene.load(tmp_path / "gearbox.stl")] == ["gearbox"]


def test_gltf_is_y_up(tmp_path):
    path = tmp_path / "pole.glb"
    trimesh.creation.box((1, 4, 1)).export(path)  # y is up in glTF
    np.testing.assert_allclose(np.ptp(Scene.load(path).bounds, axis=0), [1, 1, 4], atol=1e-6)
    np.testing.assert_allclose(np.ptp(Scene.load(path, up="y").bounds, axis=0), [1, 4, 1], atol=1e-6)
    np.testing.assert_allclose(np.ptp(Scene.load(path, file_up="z").bounds, axis=0), [1, 4, 1], atol=1e-6)


def test_scale_converts_millimeters(tmp_path):
    trimesh.creation.box((100, 200, 300)).export(tmp_path / "part.stl")
    scene = Scene.load(tmp_path / "part.stl", scale=0.001)
    np.testing.assert_allclose(np.ptp(scene.bounds, axis=0), [0.1, 0.2, 0.3], rtol=1e-6)


def test_obj_objects_and_groups_keep_names(tmp_path):
    text = "{k} one\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n{k} two\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf 4 5 6\nf 4 6 5\n"
    for kind in "og":
        path = tmp_path / f"{kind}.obj"
        path.write_text(text.format(k=kind))
        scene = Scene.load(path)
        assert {item.name: len(item.faces) for item in scene} == {"one": 1, "two": 2}


@pytest.mark.parametrize("up", ["z", "y"])
def test_export_keeps_geometry_names_and_labels(tmp_path, up):
    scene = Scene(up=up)
    scene.add(trimesh.creation.box((1, 2, 3)), name="crate", label=Label.OBJECT, pose=(1, 2, 3, 0.5, 0.5, 0.5, 0.5))
    scene.add(trimesh.creation.icosphere(), name="head of Ann", label=Label.HUMAN)
    scene.export(tmp_path / "scene.glb")
    back = Scene.load(tmp_path / "scene.glb", up=up)
    assert {item.name: item.label for item in back} == {"crate": Label.OBJECT, "head of Ann": Label.HUMAN}
    for item in scene:
        np.testing.assert_allclose(back[item.name].bounds, item.bounds, atol=1e-5)


def test_labels_of_gltf_nodes_are_kept(tmp_path):
    whole = trimesh.Scene()
    where = trimesh.transformations.translation_matrix([3, 0, 0])
    whole.add_geometry(trimesh.creation.box(), node_name="a", transform=where, metadata={"label": "robot"})
    whole.export(tmp_path / "scene.glb")
    scene = Scene.load(tmp_path / "scene.glb", file_up="z")
    assert scene["a"].label == Label.ROBOT
    assert scene.bounds[1, 0] == pytest.approx(3.5)


def test_labels_are_given_by_name_and_pattern(tmp_path):
    whole = trimesh.Scene()
    for name in ("floor", "wall_1", "wall_2", "ann"):
        whole.add_geometry(trimesh.creation.box(), node_name=name)
    whole.export(tmp_path / "scene.glb")
    scene = Scene.load(tmp_path / "scene.glb", labels={"*": "object", "wall_*": "obstacle", "floor": 1, "ann": "human"})
    assert {item.name: item.label.name for item in scene} == {
        "floor": "GROUND",
        "wall_1": "OBSTACLE",
        "wall_2": "OBSTACLE",
        "ann": "HUMAN",
    }


def test_mesh_instances_are_separate_objects(tmp_path):
    whole = trimesh.Scene()
    for i in range(3):
        where = trimesh.transformations.translation_matrix([2 * i, 0, 0])
        whole.add_geometry(trimesh.creation.box(), node_name=f"box_{i}", geom_name="box", transform=where)
    whole.export(tmp_path / "scene.glb")
    scene = Scene.load(tmp_path / "scene.glb", file_up="z")
    assert sorted(round(float(item.bounds[0, 0]), 3) for item in scene) == [-0.5, 1.5, 3.5]


def test_scene_moves_to_another_device(device):
    scene = Scene()
    scene.add(trimesh.creation.box(), name="box", pose=(3, 0, 0, 0, 0, 0, 1))
    depth = wv.render(scene.to(device), wv.Camera.kinect(), wv.look_at((0, 0, 0), (1, 0, 0))).depth
    assert str(depth.device) == device
    assert depth.numpy()[0, 120, 160] == 2.5


def volume(item):
    return trimesh.Trimesh(item.vertices, item.faces, process=False).volume


@pytest.mark.parametrize("mirror", [(-1, 1, 1), (1, 1, -2), (-1, -1, -1)])
@pytest.mark.parametrize("suffix", ["glb", "gltf"])
def test_mirrored_nodes_face_outward(tmp_path, mirror, suffix):
    """Two nodes of one box: one mirrored by its own matrix, one also by its parent's."""
    file, box = trimesh.Scene(), trimesh.creation.box((2, 4, 6))
    matrix = np.diag([*map(float, mirror), 1.0])
    matrix[:3, 3] = (10, 0, 0)
    file.add_geometry(box, node_name="as it is", geom_name="box")
    file.graph.update(frame_from="world", frame_to="mirrored", matrix=matrix, geometry="box")
    file.graph.update(frame_from="world", frame_to="parent", matrix=matrix)
    file.graph.update(frame_from="parent", frame_to="child", matrix=matrix, geometry="box")
    exported = file.export(file_type=suffix)
    if suffix == "gltf":
        for name, content in exported.items():
            (tmp_path / name).write_bytes(content)
    else:
        (tmp_path / "model.glb").write_bytes(exported)
    scene = Scene.load(tmp_path / f"model.{suffix}")
    size = abs(np.prod(mirror))
    volumes = {item.name: volume(item) for item in scene}
    assert volumes == pytest.approx({"as it is": 48, "mirrored": 48 * size, "child": 48 * size**2})


def test_mirrored_box_encloses_points(tmp_path):
    """Culling and `standing_room` depend on outward faces."""
    file = trimesh.Scene()
    file.add_geometry(trimesh.creation.box((4, 4, 4)), geom_name="box", node_name="box")
    file.graph.update(frame_from="world", frame_to="box", matrix=np.diag([-1.0, 1, 1, 1]), geometry="box")
    file.export(tmp_path / "box.glb")
    scene = Scene.load(tmp_path / "box.glb")
    inside, outside = wv.look_at((0, 0, 0.5), (1, 0, 0.5)), wv.look_at((-5, 0, 0.5), (1, 0, 0.5))
    room = wv.planning.standing_room(scene, [inside, outside], radius=0.1)
    assert room.tolist() == [False, True]
    camera = wv.Camera.from_fov(8, 8, hfov=0.2)
    views = wv.render(scene, camera, [inside, outside], cull_backfaces=True)
    depth = views.depth.numpy()
    assert np.isinf(depth[0]).all() and np.allclose(depth[1], 3)


def test_mirrors_raise():
    scene, box = Scene(), trimesh.creation.box()
    with pytest.raises(wv.errors.PoseError, match="pose of 'box' must be rotations, not mirrors"):
        scene.add(box, name="box", pose=np.diag([-1.0, 1, 1, 1]))
    with pytest.raises(wv.errors.SceneError, match="one or three positive numbers"):
        scene.add(box, name="box", scale=(-1, 1, 1))


def test_unnamed_objects_take_the_next_free_name():
    scene, box = Scene(), trimesh.creation.box()
    for name in ("object_1", None, "object_3", None, None):
        scene.add(box, name=name)
    assert [item.name for item in scene] == ["object_1", "object_2", "object_3", "object_4", "object_5"]
    scene = Scene()
    scene.add(box, name="object_1")
    assert scene.add(box) == 1
    assert [item.name for item in scene] == ["object_1", "object_2"]
