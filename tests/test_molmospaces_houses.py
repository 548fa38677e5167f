# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Houses in MolmoSpaces' layout: MJCF that refers to ``../../objects``, with metadata next to it."""

import json

import numpy as np
import pytest
import trimesh

from warpvis import Label, Scene
from warpvis.errors import FileFormatError
from warpvis.io import read_parts

HOUSE = """<mujoco><compiler angle="radian"/><asset>
<mesh name="mug" file="../../objects/thor/Kitchen Objects/Mug/Mug_1.obj"/>
<mesh name="lid" file="../../objects/thor/Kitchen Objects/Mug/Lid_1.obj"/></asset><worldbody>
<geom name="floor" type="plane" size="4 4 .1"/>
<body name="wall_0" pos="2 0 1"><geom name="wall_0_visual" type="box" size=".1 2 1"/></body>
<body name="table_7" pos="1 0 .4"><geom type="box" size=".4 .4 .4"/></body>
<body name="mug_1f" pos="1 0 .8"><freejoint/><geom type="mesh" mesh="mug"/>
<body name="mug_1f_lid"><joint type="hinge"/><geom type="mesh" mesh="lid" pos="0 0 .12"/></body></body>
</worldbody></mujoco>"""
METADATA = {
    "objects": {
        "table_7": {"asset_id": "Dining_Table_1", "category": "DiningTable", "is_static": True},
        "mug_1f": {
            "asset_id": "Mug_1",
            "category": "Mug",
            "name_map": {"bodies": {"mug_1f": "Mug_1", "mug_1f_lid": "Lid"}},
        },
    }
}
MUG, LID = trimesh.creation.cylinder(0.04, 0.1), trimesh.creation.cylinder(0.05, 0.02)


def write(root, name="house_1.xml", metadata="house_1_metadata.json"):
    """Write a house, its objects and its metadata, and return the house."""
    folder, objects = root / "scenes/procthor-10k-train", root / "objects/thor/Kitchen Objects/Mug"
    folder.mkdir(parents=True)
    objects.mkdir(parents=True)
    MUG.export(objects / "Mug_1.obj")
    LID.export(objects / "Lid_1.obj")
    (folder / metadata).write_text(json.dumps(METADATA))
    (folder / name).write_text(HOUSE)
    return folder / name


@pytest.mark.parametrize("name", ["house_1.xml", "house_1_ceiling.xml", "house_1_non_settled.xml"])
def test_categories_of_the_metadata(tmp_path, name):
    scene = Scene.load(write(tmp_path, name))
    found = [(item.category, item.label) for item in scene]
    table, mug = ("DiningTable", Label.OBSTACLE), ("Mug", Label.OBJECT)
    assert found == [("", Label.GROUND), ("", Label.OBSTACLE), table, mug, mug]
    low, high = list(scene)[3].bounds
    np.testing.assert_allclose((low, high), MUG.bounds + (1, 0, 0.8), atol=1e-6)


def test_labels_and_movable_objects_by_category(tmp_path):
    scene = Scene.load(write(tmp_path), labels={"Mug": "human"}, movable=True)
    assert [item.label for item in scene][3:] == [Label.HUMAN] * 2
    assert [item.movable for item in scene] == [False, False, False, True, True]


def test_metadata_of_parts(tmp_path):
    assert [part.extras.get("asset_id") for part in read_parts(write(tmp_path)).parts][2:] == [
        "Dining_Table_1",
        "Mug_1",
        "Mug_1",
    ]


def test_assets_by_links_as_installed(tmp_path):
    """The installer links scenes and objects from a cache with versions."""
    house = write(tmp_path / "cache")
    (tmp_path / "assets/scenes").mkdir(parents=True)
    (tmp_path / "assets/scenes/procthor-10k-train").mkdir()
    for file in house.parent.iterdir():
        (tmp_path / "assets/scenes/procthor-10k-train" / file.name).symlink_to(file)
    (tmp_path / "assets/objects").symlink_to(tmp_path / "cache/objects")
    assert len(Scene.load(tmp_path / "assets/scenes/procthor-10k-train/house_1.xml")) == 5


def test_a_house_without_its_layout_needs_the_search_path(tmp_path):
    house = write(tmp_path / "assets")
    alone = tmp_path / "house_1.xml"
    alone.write_text(house.read_text())
    with pytest.raises(FileFormatError, match="MuJoCo cannot compile it"):
        Scene.load(alone)
    assert len(Scene.load(alone, search_path=tmp_path / "assets")) == 5


def test_models_without_metadata_have_no_categories(tmp_path):
    house = write(tmp_path)
    house.with_name("house_1_metadata.json").unlink()
    assert {item.category for item in Scene.load(house)} == {""}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([], r"house_1_metadata.json: must contain a JSON object, got \[\]"),
        ({"objects": []}, r"house_1_metadata.json: 'objects' must be an object, got \[\]"),
        ({"objects": {"a": {"category": 3}}}, r"'objects'\['a'\]\['category'\] must be a text, got 3"),
    ],
)
def test_invalid_metadata(tmp_path, content, message):
    house = write(tmp_path)
    house.with_name("house_1_metadata.json").write_text(json.dumps(content))
    with pytest.raises(FileFormatError, match=message):
        Scene.load(house)
