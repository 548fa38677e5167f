# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of the table of docs/scene_files/habitat.md that `test_habitat_scenes` does not cover."""

import numpy as np
import pytest
import trimesh

from warpvis import Label, Scene

from support.habitat import make_dataset, write


def two_parts(folder, name):
    scene = trimesh.Scene()
    for part, x in (("wall", 0), ("door", 3)):
        scene.add_geometry(trimesh.creation.box().apply_translation((x, 0, 0)), geom_name=part, node_name=part)
    scene.export(folder / name)


def test_meshes_of_the_stage_are_objects(tmp_path):
    path = make_dataset(tmp_path, {"stage_instance": {"template_name": "stages/room"}})
    two_parts(tmp_path, "stages/room.glb")
    scene = Scene.load(path, movable=["*"])
    assert [(item.name, item.label) for item in scene] == [("wall", Label.OBSTACLE), ("door", Label.OBSTACLE)]
    scene = Scene.load(write(tmp_path, "scenes/a.scene_instance.json", path.read_text()))
    assert not any(item.movable for item in scene)


@pytest.mark.parametrize(
    ("handle", "height"), [("box", 1), ("special/box", 2), ("objects/special/box.object_config.json", 2), ("ecial", 2)]
)
def test_templates_are_found_by_name_else_by_a_part_of_their_path(tmp_path, handle, height):
    """A handle is the name of a template, or a part of its path."""
    path = make_dataset(tmp_path, {"object_instances": [{"template_name": handle}]})
    for folder, size in (("a", 1), ("special", 2)):
        write(tmp_path, f"objects/{folder}/box.glb", trimesh.creation.box((1, size, 1)))
        write(tmp_path, f"objects/{folder}/box.object_config.json", {"render_asset": "box.glb"})
    item = next(iter(Scene.load(path)))
    assert np.ptp(item.vertices[:, 2]) == pytest.approx(height)


def test_physics_regions_and_shaders_are_ignored(tmp_path):
    """Also with a collision mesh that does not exist."""
    scene = {"object_instances": [{"template_name": "cup"}], "region_annotations": [{"name": "kitchen"}]}
    more = {"collision_asset": "gone.glb", "join_collision_meshes": "x", "restitution": "x", "shader_type": "pbr"}
    loaded = Scene.load(make_dataset(tmp_path, scene, objects={"cup": more}), strict=True)
    assert [item.name for item in loaded] == ["cup"]


def test_a_scene_without_json_is_a_mesh(tmp_path):
    """As those of Gibson: glTF, with y up."""
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "Cantwell.glb")
    scene = Scene.load(tmp_path / "Cantwell.glb")
    assert len(scene) == 1
    np.testing.assert_allclose(np.ptp(scene.bounds, axis=0), (1, 3, 2), atol=1e-6)
