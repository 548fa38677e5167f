# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Classes in words: labels of them, and objects of a scene that have one."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.core.categories import label_of_category
from warpvis.core.labels import LabelRules
from warpvis.errors import SceneError
from warpvis.scene import FileParts, Part

BOX = trimesh.creation.box()


@pytest.mark.parametrize(
    ("category", "label"),
    [
        ("floor", wv.Label.GROUND),
        ("Floor Mat", wv.Label.GROUND),
        ("office chair", wv.Label.OBSTACLE),
        ("kitchen_cabinets", wv.Label.OBSTACLE),
        ("benches", wv.Label.OBSTACLE),
        ("door mat", wv.Label.GROUND),
        ("person", wv.Label.HUMAN),
        ("robot", wv.Label.ROBOT),
        ("coffee mug", wv.Label.OBJECT),
        ("DiningTable", wv.Label.OBSTACLE),
        ("table lamp", wv.Label.OBSTACLE),
        ("unknown", wv.Label.OBSTACLE),
        ("", wv.Label.OBSTACLE),
    ],
)
def test_label_of_a_category(category, label):
    assert label_of_category(category) == label


def test_objects_keep_their_category(tmp_path):
    """In copies, in other meshes, and in exported files."""
    scene = wv.Scene()
    scene.add(BOX, name="a", category="mug", label="object")
    scene.add_instances(BOX, np.tile([0, 0, 0, 0, 0, 0, 1.0], (2, 1)), names="b", category="plate", movable=False)
    scene.add(BOX, name="c", movable=True, category="ball")
    scene.update_mesh("a", BOX.vertices * 2, BOX.faces)
    scene.update_vertices("c", BOX.vertices * 2)
    expected = {"a": "mug", "b_0": "plate", "b_1": "plate", "c": "ball"}
    scene.export(tmp_path / "scene.glb")
    for found in (scene, scene.to("cpu"), scene.isolated(), wv.Scene.load(tmp_path / "scene.glb")):
        assert {item.name: item.category for item in found} == expected


def test_patterns_match_categories(tmp_path):
    """Of labels and of movable objects; instances of one mesh in distinct categories are distinct objects."""
    pose, mesh = np.array([0, 0, 0, 0, 0, 0, 1.0]), (BOX.vertices, BOX.faces)
    parts = [Part(name, mesh, pose=pose, category=word) for name, word in [("x", "mug"), ("y", "mug"), ("z", "bowl")]]
    scene = wv.Scene()
    scene.add_parts(FileParts(tmp_path, parts), LabelRules({"mug": 3}), movable="bowl")
    assert [(item.label, item.movable, item.category) for item in scene] == [
        (3, False, "mug"),
        (3, False, "mug"),
        (2, True, "bowl"),
    ]


def test_wrong_category():
    with pytest.raises(SceneError, match=r"^category must be text, got 3$"):
        wv.Scene().add(BOX, category=3)
