# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Custom classes: numbers and names beyond the six built-in ones in scenes, label files, images and datasets."""

from __future__ import annotations

import copy
import json
import pickle

import mujoco
import numpy as np
import pytest
import trimesh
import warp as wp
from color_blindness import nearest_pair

import warpvis as wv
from warpvis.core.labels import LabelNames, LabelRules
from warpvis.mujoco import BatchRenderer, Renderer, scene_from_mujoco
from warpvis.viz import STATE_COLORS
from warpvis.viz._drawing import PanelData
from warpvis.viz._perspective import _floor_map
from warpvis.webots import load_webots

import reference
from support.cli import run_here
from support.labels import TEXTS

CAMERA = wv.Camera.from_fov(64, 48, hfov=1.2)
ABOVE = wv.look_at((0.01, 0, 4), (0, 0, 0))
NAMES = {40: "road", 48: "sidewalk", 252: "moving-car"}
SIX = {0: "empty", 1: "ground", 2: "obstacle", 3: "object", 4: "human", 5: "robot"}
MODEL = """<mujoco><worldbody>
<geom name="floor" type="plane" size="3 3 1"/><geom name="shelf_0" type="box" size=".3 .3 .3" pos="1 0 .3"/>
<body name="cart" pos="-1 0 .3"><freejoint/><geom type="sphere" size=".3"/></body></worldbody></mujoco>"""
WORLD = """#VRML_SIM R2023b utf8
WorldInfo { }
Solid { name "shelf 1" translation 1 0 0.3 children [ Shape { geometry Box { size 0.6 0.6 0.6 } } ] }
Solid { name "crate" translation -1 0 0.3 children [ Shape { geometry Box { size 0.6 0.6 0.6 } } ] }
"""


def street(**options):
    """Return a scene with two floors, a car and an unnamed box, seen from above."""
    scene = wv.Scene(label_names=NAMES, **options)
    scene.add(trimesh.creation.box((2, 4, 0.1)), name="road_0", label="road", pose=(-1, 0, -0.05, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((2, 4, 0.1)), name="walk_0", label=48, pose=(1, 0, -0.05, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.6, 0.6, 0.6)), name="car_0", label="Moving-Car", pose=(-1, 0, 0.3, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.6, 0.6, 0.6)), name="thing", label=77, pose=(1, 0, 0.3, 0, 0, 0, 1))
    return scene


def labels_of(scene):
    return {item.name: item.label for item in scene}


@pytest.mark.parametrize("caster", ["rays", "packets"])
def test_label_images_contain_custom_numbers(caster, device):
    scene = street(device=device)
    views = wv.Renderer(scene, CAMERA, outputs=("labels", "segmentation"), caster=caster).render(ABOVE)
    labels, objects = views.labels.numpy(), views.segmentation.numpy()
    assert labels.dtype == np.uint8
    assert set(np.unique(labels)) == {0, 40, 48, 77, 252}
    of_object = np.array([40, 48, 252, 77, 0])
    assert np.array_equal(labels, of_object[objects])


def test_all_256_labels_are_rendered(device):
    """256 boxes, each with a different label, cover at least one pixel each."""
    scene = wv.Scene(device=device)
    for number in range(256):
        place = (number % 16 - 7.5, number // 16 - 7.5, 0, 0, 0, 0, 1)
        scene.add(trimesh.creation.box((1, 1, 1)), label=number, pose=place)
    camera, pose = wv.Camera.from_fov(160, 160, hfov=np.pi / 2), wv.look_at((0, 0, 8.5), (0, 0, 0), up=(0, 1, 0))
    for caster in ("rays", "packets"):
        views = wv.Renderer(scene, camera, outputs=("labels",), caster=caster).render(pose)
        assert set(np.unique(views.labels.numpy())) == set(range(256))


def test_label_names_extend_built_in_names():
    scene = wv.Scene()
    assert dict(scene.label_names) == SIX
    scene.label_names[40] = "road"
    scene.label_names.update({1: "floor", 7: "shelf"})
    assert dict(scene.label_names) == {**SIX, 1: "floor", 7: "shelf", 40: "road"}
    assert scene.label_names.number("Road") == 40
    assert scene.label_names.number("floor") is wv.Label.GROUND
    assert (scene.label_names.name(41), scene.label_names.number("label 41")) == ("label 41", 41)
    with pytest.raises(wv.errors.SceneError, match=r"label must be one of empty \(0\), floor \(1\)"):
        scene.label_names.number("ground")


def test_label_name_updates_are_atomic():
    names = LabelNames({1: "obstacle", 2: "ground"})  # the two names are swapped
    assert (names[1], names[2]) == ("obstacle", "ground")
    before = dict(names)
    with pytest.raises(wv.errors.SceneError):
        names.update({7: "shelf", 8: "shelf"})
    assert dict(names) == before


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ({256: "road"}, "must have numbers from 0 to 255, got 256"),
        ({-1: "road"}, "must have numbers from 0 to 255, got -1"),
        ({"40": "road"}, "must have numbers from 0 to 255, got '40'"),
        ({True: "road"}, "must have numbers from 0 to 255, got True"),
        ({40: ""}, "must be names without spaces around them, got '' for 40"),
        ({40: " road"}, "must be names without spaces around them, got ' road' for 40"),
        ({40: "ro\nad"}, "must be names without spaces around them, got"),
        ({40: 3}, "must be names without spaces around them, got 3 for 40"),
        ({40: "41"}, "must be names that are no numbers, got '41' for 40"),
        ({40: "label 41"}, "must be names that are no numbers, got 'label 41' for 40"),
        ({40: "Ground"}, "must be different names, got 'Ground' for 1 and for 40"),
        ({40: "road", 41: "ROAD"}, "must be different names, got 'ROAD' for 40 and for 41"),
        ([40], "must be a mapping"),
    ],
)
def test_invalid_label_names_are_rejected(names, said):
    for call in (lambda: wv.Scene(label_names=names), lambda: wv.Scene().label_names.update(names)):
        with pytest.raises(wv.errors.SceneError, match=f"label_names {said}"):
            call()


@pytest.mark.parametrize("label", [256, -1, 2.0, True, None, "street", "256", "-1", "²", [40]])
def test_invalid_labels_are_rejected(label):
    with pytest.raises(wv.errors.SceneError, match=r"label must be one of empty .*, or a number from 0 to 255, got "):
        street().add(trimesh.creation.box(), label=label)


def test_error_truncates_long_lists_of_names():
    names = LabelNames({number: f"class {number}" for number in range(6, 40)})
    with pytest.raises(
        wv.errors.SceneError, match=r"28 others, or a number from 0 to 255, got 'street'; label_names names others$"
    ):
        names.number("street")


def test_ground_labels_affect_planning_and_maps():
    """A road raised by 5 cm blocks a robot and the view of a plan unless its class is ground."""
    scene = wv.Scene(label_names=NAMES)
    scene.add(trimesh.creation.box((4, 4, 0.1)), name="road", label="road")
    scene.add(trimesh.creation.box((0.6, 0.6, 2)), name="car", label=252, pose=(1, 0, 1, 0, 0, 0, 1))
    beside, inside = wv.look_at((-1, 0, 1), (0, 0, 1)), wv.look_at((1, 0, 1), (0, 0, 1))
    room = [wv.planning.standing_room(scene, [beside, inside], radius=0.2).tolist()]
    scene.ground_labels = ("road", wv.Label.GROUND)
    assert scene.ground_labels == {1, 40}
    room.append(wv.planning.standing_room(scene, [beside, inside], radius=0.2).tolist())
    assert room == [[False, False], [True, False]]
    plans = [wv.maps.plan_visibility(scene, CAMERA, beside).visible[0].tolist()]
    scene.ground_labels = ()
    plans.append(wv.maps.plan_visibility(scene, CAMERA, beside).visible[0].tolist())
    assert [plan[0] for plan in plans] == [False, True]
    with pytest.raises(wv.errors.SceneError, match=r"label must be one of .*, got 'street'"):
        scene.ground_labels = ("street",)


@pytest.mark.parametrize("copied", [copy.copy, lambda scene: pickle.loads(pickle.dumps(scene)), lambda s: s.to("cpu")])
def test_copies_keep_label_names_and_ground_labels(copied):
    scene = copied(street(ground_labels=("road", 48)))
    assert dict(scene.label_names) == {**SIX, **NAMES}
    assert scene.ground_labels == {40, 48}
    assert labels_of(scene) == {"road_0": 40, "walk_0": 48, "car_0": 252, "thing": 77}
    scene.label_names[7] = "shelf"
    assert 7 not in street().label_names


def test_exported_scenes_keep_numbers_and_names(tmp_path):
    scene = street()
    scene.label_names[3] = "item"
    scene.add(trimesh.creation.box(), name="cup", label="item")
    scene.add(trimesh.creation.box(), name="wall")
    scene.export(tmp_path / "street.glb")
    loaded = wv.Scene.load(tmp_path / "street.glb")
    assert labels_of(loaded) == labels_of(scene)
    assert dict(loaded.label_names) == {**SIX, **NAMES, 3: "item"}
    renamed = wv.Scene.load(tmp_path / "street.glb", label_names={40: "street"})
    assert renamed.label_names[40] == "street"


@pytest.mark.parametrize("ground", [(), ("ground",), (40,), (1, 40, 252), (3,)])
def test_exported_scenes_keep_ground_labels(ground, tmp_path):
    scene = street(ground_labels=ground)
    for label in (1, 3):
        scene.add(trimesh.creation.box(), label=label)
    scene.export(tmp_path / "street.glb")
    assert wv.Scene.load(tmp_path / "street.glb").ground_labels == scene.ground_labels
    (tmp_path / "rules.json").write_text('{"labels": {}, "ground_labels": [48]}')
    assert wv.Scene.load(tmp_path / "street.glb", labels=tmp_path / "rules.json").ground_labels == {48}


@pytest.mark.parametrize("extras", [{"ground": True}, {"label": 2, "ground": 1}, {"label": 2, "label_name": 3}])
def test_foreign_gltf_extras_are_ignored(extras, tmp_path):
    scene, mesh = trimesh.Scene(), trimesh.creation.box()
    mesh.metadata.update(extras)
    scene.add_geometry(mesh, node_name="box", geom_name="box")
    (tmp_path / "box.glb").write_bytes(scene.export(file_type="glb"))
    loaded = wv.Scene.load(tmp_path / "box.glb")
    assert (loaded["box"].label, loaded.ground_labels, dict(loaded.label_names)) == (2, {1}, SIX)


def test_conflicting_label_names_in_file_are_rejected(tmp_path):
    scene = trimesh.Scene()
    for name in ("road", "street"):
        mesh = trimesh.creation.box()
        mesh.metadata.update({"label": 40, "label_name": name})
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    (tmp_path / "two.glb").write_bytes(scene.export(file_type="glb"))
    with pytest.raises(wv.errors.FileFormatError, match=r"two.glb: names the label 40 both 'road' and 'street'"):
        wv.Scene.load(tmp_path / "two.glb")


def pixel(*labels):
    """Return points above one cell, and their labels."""
    return np.zeros((1, 1, len(labels), 3), np.float32), np.array([[labels]], np.uint8)


@pytest.mark.parametrize(
    ("labels", "shown"),
    [
        ([1, 40], 40),
        ([2, 40, 252], 252),
        ([40, 252, 3], 3),  # objects, people and robots take precedence over custom classes
        ([255, 4, 3], 4),
        ([5, 6, 4], 5),
        ([0, 0], 0),
        ([0, 7], 7),
    ],
)
def test_cells_show_label_of_highest_precedence(labels, shown, device):
    points, images = (wp.array(array, device=device) for array in pixel(*labels))
    points = wp.array(pixel(*labels)[0], dtype=wp.vec3, device=device)
    square = {"bounds": ((-1, -1), (1, 1)), "cell_size": 2.0}
    assert wv.floor_map(points, images, **square).cells.numpy().item() == shown
    ranks = reference.precedence(labels)
    assert labels[int(np.argmax(ranks))] == shown


def test_ground_labels_have_lowest_precedence():
    square = {"bounds": ((-1, -1), (1, 1)), "cell_size": 2.0}
    for labels, ground, shown in [
        ([40, 2], (40,), 2),
        ([40, 48], (40, 48), 48),
        ([40, 1], (40,), 1),
        ([4, 9], (4,), 9),
    ]:
        found = wv.floor_map(*pixel(*labels), ground_labels=ground, **square)
        assert found.cells.numpy().item() == shown
        assert labels[int(np.argmax(reference.precedence(labels, ground)))] == shown


def test_maps_with_custom_labels_match_reference(device):
    scene = street(device=device, ground_labels=("road", 48))
    poses = np.stack([wv.look_at((-2.5, 1, 1.5), (0, 0, 0)), wv.look_at((2.1, -1.4, 1.1), (0.3, 0, 0))])
    views = wv.render(scene, CAMERA, poses, outputs=("depth", "points", "labels"))
    classes = {"label_names": scene.label_names, "ground_labels": scene.ground_labels}
    low = np.array([-2.013, -1.987])
    found = wv.floor_map(views.points, views.labels, bounds=(low, (2, 2)), cell_size=0.05, **classes)
    assert {40, 48, 77, 252} <= set(np.unique(found.cells.numpy()))
    for view in range(2):
        images = (views.points.numpy()[view], views.labels.numpy()[view])
        expected = reference.mark_cells(*images, low, 0.05, found.cells.shape[1:], 0.01, scene.ground_labels)
        assert (found.cells.numpy()[view] != expected).mean() < 2e-3
    assert found.area("road").shape == (2,)
    assert list(found.legend.values())[1][0] == "road"

    voxels = wv.voxel_map_from_scene(scene, CAMERA, poses, cell_size=0.1)
    depth, labels = views.depth.numpy(), views.labels.numpy()
    grid = (np.array(voxels.origin), 0.1)
    rows = wv.core.poses.parse_poses(poses).numpy()
    marks = reference.mark_surface_points(CAMERA, rows, depth, labels, *grid, voxels.states.shape, scene.ground_labels)
    states, highest = reference.judge_voxels(CAMERA, rows, depth, labels, *grid, marks, scene.ground_labels)
    assert (voxels.states.numpy() != states).sum() <= 5
    assert (voxels.labels.numpy() != highest).sum() <= 5
    floor = reference.highest_labels(voxels.labels.numpy(), 2, scene.ground_labels)
    assert np.array_equal(voxels.floor_map().cells.numpy()[0], floor)
    assert voxels.floor_map().legend[40][0] == "road"

    bounds = voxels.bounds
    alone = [wv.voxel_map_from_scene(scene, CAMERA, pose, cell_size=0.1, bounds=bounds) for pose in poses]
    merged = alone[0].merge(alone[1])
    assert np.array_equal(merged.labels.numpy(), voxels.labels.numpy())
    given = {"bounds": bounds, "cell_size": 0.1, "labels": views.labels, **classes}
    again = wv.voxel_map(views.depth, CAMERA, poses, **given)
    assert np.array_equal(again.labels.numpy(), voxels.labels.numpy())
    assert again.label_names[40] == "road"
    wv.voxel_map(views.depth, CAMERA, poses, out=again, bounds=bounds, cell_size=0.1, labels=views.labels)
    assert np.array_equal(again.labels.numpy(), voxels.labels.numpy())
    other = wv.voxel_map(views.depth, CAMERA, poses, bounds=bounds, cell_size=0.1, labels=views.labels)
    for call in (lambda: other.merge(voxels), lambda: wv.voxel_map(views.depth, CAMERA, poses, out=other, **given)):
        with pytest.raises(wv.errors.ArrayError, match=r"must have the ground_labels \[.*\], got \[.*\]"):
            call()


def test_label_colors_are_unique_and_stable():
    colors = wv.maps.label_colors()
    assert (colors.shape, colors.dtype) == ((256, 3), np.uint8)
    assert len(np.unique(colors, axis=0)) == 256
    for label, (_, color) in wv.maps.MAP_LEGEND.items():
        assert tuple(colors[label]) == color
    few = colors[:40].astype(int)
    steps = np.linalg.norm(few[:, None] - few, axis=-1)
    assert steps[~np.eye(40, dtype=bool)].min() > 40  # the first colors are distinguishable


def test_legends_list_only_present_labels(tmp_path):
    labels = wv.render(street(), CAMERA, ABOVE, outputs=("labels",)).labels.numpy()[0]
    wv.viz.save_labels(labels, tmp_path / "labels.svg", label_names=NAMES)
    text = (tmp_path / "labels.svg").read_text()
    for name in ("road", "sidewalk", "moving-car", "label 77", "empty"):
        assert f"<!-- {name} -->" in text
    assert "ground" not in text
    wv.viz.save_labels(np.array([[1, 2]]), tmp_path / "six.svg")
    assert "<!-- obstacle -->" in (tmp_path / "six.svg").read_text()
    points = wv.render(street(), CAMERA, ABOVE, outputs=("points",)).points
    found = wv.floor_map(points, labels[None], bounds=((-2, -2), (2, 2)), label_names=NAMES)
    wv.viz.save_map(found, tmp_path / "map.svg")
    text = (tmp_path / "map.svg").read_text()
    assert "<!-- moving-car -->" in text
    assert "visible ground" not in text
    for bad in (labels[None], labels + 0.5, labels.astype(int) * 9, labels[:0]):
        with pytest.raises(wv.errors.ArrayError, match="labels must "):
            wv.viz.save_labels(bad, tmp_path / "bad.png")


def test_perspective_supports_custom_labels():
    """Custom ground classes have no state; other custom classes do when requested."""
    scene = street(ground_labels=("road", "sidewalk"))
    eyes = {"robot": (-2.5, -1, 1.2), "human": (2.5, 1, 1.6)}
    agents = [
        wv.Agent("robot", CAMERA, wv.look_at(eyes["robot"], (0, 0, 0))),
        wv.Agent.human("human", wv.look_at(eyes["human"], (0, 0, 0))),
    ]
    seen = wv.perspective(scene, agents)
    assert seen.labels == (40, 48, 252, 77)
    assert {item.object for item in seen.candidates("human", labels=["moving-car", 77])} == {"thing", "car_0"}
    assert not seen.candidates("human")
    assert [item["label"] for item in seen.report()["objects"]] == ["road", "sidewalk", "moving-car", "label 77"]
    assert "moving-car" in seen.table()
    shown = PanelData.from_perspective(scene, agents, seen, 0, None, None)
    assert set(shown.states) == {scene.index("car_0"), scene.index("thing")}
    plan = _floor_map(shown, agents[1])
    colors = np.unique(plan.colors.reshape(-1, 3), axis=0)
    both = np.array(STATE_COLORS[wv.visibility.State.BOTH]) / 255
    ground, obstacle = [0.88] * 3, [0.70] * 3  # grays of objects without a state
    for color in (ground, both):
        assert np.isclose(colors, color).all(axis=1).any()
    assert not np.isclose(colors, obstacle).all(axis=1).any()
    assert len(wv.planning.surface_samples(scene, spacing=0.2, labels="road")) > 50
    with pytest.raises(wv.errors.SceneError, match="the scene has no object labeled GROUND"):
        wv.planning.surface_samples(scene, labels=[1])


def test_classify_spheres_with_custom_labels():
    spheres = [wv.maps.Sphere((0, 0, 1), 0.5, 40), wv.maps.Sphere((0, 0, 3), 0.5, "human")]
    depth = np.full((1, 48, 64), 1.0, np.float32)
    labels = wv.classify(depth, CAMERA, np.array([0, 0, 0, 0, 0, 0, 1.0]), spheres=spheres, up="z").numpy()
    assert set(np.unique(labels)) == {wv.Label.OBSTACLE, 40}


@pytest.fixture(scope="module")
def street_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("street") / "street.glb"
    scene = wv.Scene()
    for item in street():
        scene.add((item.vertices, item.faces), name=item.name)
    scene.export(path)
    return path


@pytest.mark.parametrize("name", TEXTS)
def test_label_files_assign_labels_and_names(name, street_file, tmp_path):
    if name.endswith("yaml"):
        pytest.importorskip("ruamel.yaml")
    (tmp_path / name).write_text(TEXTS[name])
    for path in (tmp_path / name, str(tmp_path / name)):
        scene = wv.Scene.load(street_file, labels=path)
        # "*" follows "road_*", and the last matching pattern wins.
        assert labels_of(scene) == {"road_0": 7, "walk_0": 7, "car_0": 252, "thing": 7}
        assert dict(scene.label_names) == {**SIX, 40: "road"}
        assert scene.ground_labels == {40}


def test_label_names_argument_overrides_file(street_file, tmp_path):
    (tmp_path / "rules.json").write_text(TEXTS["rules.json"])
    scene = wv.Scene.load(street_file, labels=tmp_path / "rules.json", label_names={40: "street", 41: "road"})
    assert scene["road_0"].label == 7
    assert (scene.label_names[40], scene.ground_labels) == ("street", {40})


def test_label_files_may_contain_only_patterns(street_file, tmp_path):
    (tmp_path / "rules.json").write_text('{"road_*": "street", "car_*": 9}')
    scene = wv.Scene.load(street_file, labels=tmp_path / "rules.json", label_names={40: "street"})
    assert labels_of(scene) == {"road_0": 40, "walk_0": 2, "car_0": 9, "thing": 2}
    assert scene.ground_labels == {wv.Label.GROUND}


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("rules.json", "{", "is not JSON: "),
        ("rules.json", "[" * 100_000, "is not JSON: "),
        ("rules.json", '{"a": 1, "a": 2}', "is not JSON: 'a' is there twice"),
        ("rules.json", "[1]", "must hold labels by names or patterns of objects, got list"),
        ("rules.json", '{"labels": {"a": 1}, "colors": {}}', "must have labels, label_names, .* got 'colors'"),
        ("rules.json", '{"labels": [1]}', "labels must be a mapping"),
        ("rules.json", '{"label_names": ["road"]}', "label_names must be a mapping"),
        ("rules.json", '{"label_names": {"x": "road"}}', "label_names must have numbers from 0 to 255, got 'x'"),
        ("rules.json", '{"label_names": {"40": "ground"}}', "label_names must be different names"),
        ("rules.json", '{"label_names": {}, "ground_labels": "road", "labels": {}}', "ground_labels must be a list"),
        ("rules.toml", "a =", "is not TOML: "),
        ("rules.yaml", "*floor: 1", "is not YAML: .*; patterns that begin with [*] need quotes$"),
        ("rules.yaml", "- 1", "must hold labels by names or patterns of objects, got "),
        ("rules.yaml", "1: road", "labels must be given to names or patterns of names, got 1"),
        ("rules.txt", "a = 1", "'.txt' is no format of labels; those are json, toml and yaml"),
    ],
)
def test_malformed_label_files_are_rejected(name, text, said, street_file, tmp_path):
    if name.endswith("yaml"):
        pytest.importorskip("ruamel.yaml")
    (tmp_path / name).write_text(text)
    with pytest.raises(wv.errors.FileFormatError, match=f"{name}: {said}"):
        wv.Scene.load(street_file, labels=tmp_path / name)


def test_missing_files_and_unknown_names_are_rejected(street_file, tmp_path):
    with pytest.raises(wv.errors.FileFormatError, match=r"none.json: cannot be read: No such file"):
        wv.Scene.load(street_file, labels=tmp_path / "none.json")
    with pytest.raises(wv.errors.SceneError, match=r"label must be one of .*, got 'road'"):
        wv.Scene.load(street_file, labels={"road_*": "road"})
    with pytest.raises(wv.errors.SceneError, match=r"labels for 'bus' fit no object of .*, which has 'road_0'"):
        wv.Scene.load(street_file, labels={"bus": 40})


def test_labels_apply_to_mujoco_models(tmp_path):
    model = mujoco.MjModel.from_xml_string(MODEL)
    (tmp_path / "rules.json").write_text('{"label_names": {"9": "shelf"}, "labels": {"shelf_*": "shelf", "cart": 250}}')
    (tmp_path / "model.xml").write_text(MODEL)
    scene = scene_from_mujoco(model, labels=tmp_path / "rules.json").scene
    loaded = wv.Scene.load(tmp_path / "model.xml", labels=tmp_path / "rules.json")
    given = {"labels": {"shelf_*": "shelf", "cart": 250}, "label_names": {9: "shelf"}}
    batch = BatchRenderer(model, outputs=("labels",), **given)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with Renderer(model, 48, 64, **given) as renderer:
        renderer.update_scene(data)
        scenes = [scene, loaded, batch.scene, renderer.scene]
    for each in scenes:
        assert list(labels_of(each).values()) == [wv.Label.GROUND, 9, 250]
        assert dict(each.label_names) == {**SIX, 9: "shelf"}
    views = batch.render(data, cameras=-1)
    assert set(np.unique(views.labels.numpy())) - {0} == {1, 9, 250}


def test_labels_apply_to_webots_worlds(tmp_path):
    (tmp_path / "hall.wbt").write_text(WORLD)
    (tmp_path / "rules.toml").write_text('[label_names]\n9 = "shelf"\n[labels]\n"shelf*" = "shelf"\n')
    for scene in (
        load_webots(tmp_path / "hall.wbt", labels=tmp_path / "rules.toml").scene,
        wv.Scene.load(tmp_path / "hall.wbt", labels={"shelf*": 9}, label_names={9: "shelf"}),
    ):
        assert labels_of(scene) == {"shelf 1": 9, "crate": wv.Label.OBSTACLE}
        assert scene.label_names[9] == "shelf"


def test_later_label_rules_override_earlier_ones():
    first = LabelRules.of({"a": 1, "b": 2}, {40: "road", 41: "car"})
    both = first.followed_by(LabelRules.of({"a": 3}, {41: "bus"}))
    assert list(both.labels.items()) == [("b", 2), ("a", 3)]
    assert both.label_names == {40: "road", 41: "bus"}


@pytest.mark.parametrize("kind", ["npz", "png", "zarr"])
def test_datasets_keep_label_names(kind, tmp_path):
    if kind == "zarr":
        pytest.importorskip("zarr")
    poses = np.tile(ABOVE, (3, 1))
    job = {"format": kind, "outputs": ["depth", "labels"], "quiet": True}
    wv.render_batch(street(), CAMERA, poses, tmp_path / "street", **job)
    dataset = wv.open_dataset(tmp_path / "street")
    assert dict(dataset.label_names) == {**SIX, **NAMES}
    assert dataset.object_labels == (40, 48, 252, 77)
    mask = dataset[1]["labels"] == dataset.label_names.number("moving-car")
    expected = wv.render(street(), CAMERA, ABOVE, outputs=("labels",)).labels.numpy()[0] == 252
    assert mask.any()
    assert np.array_equal(mask, expected)
    wv.render_batch(street(), CAMERA, poses, tmp_path / "street", resume=True, **job)
    renamed = street()
    renamed.label_names[40] = "street"
    with pytest.raises(wv.errors.FileFormatError, match='label_names\'s 40 was "road" and is "street"'):
        wv.render_batch(renamed, CAMERA, poses, tmp_path / "street", resume=True, **job)


def test_frames_with_only_class_zero_are_not_empty(tmp_path):
    """Label images alone do not distinguish class 0 from background, so no frame counts as empty."""
    scene = wv.Scene(label_names={0: "unlabeled"})
    scene.add(trimesh.creation.box((2, 2, 0.1)), label="unlabeled")
    assert wv.render_batch(scene, CAMERA, ABOVE, tmp_path / "set", outputs=["labels"], quiet=True).empty_frames == 0


def test_images_json_contains_all_label_names(tmp_path):
    job = {"format": "png", "outputs": ["labels", "segmentation"], "quiet": True}
    wv.render_batch(street(), CAMERA, ABOVE, tmp_path / "street", **job)
    meaning = json.loads((tmp_path / "street" / "images.json").read_text())
    assert meaning["labels"]["values"] == {str(number): name for number, name in {**SIX, **NAMES}.items()}
    objects = meaning["segmentation"]["objects"]
    assert [item["label"] for item in objects] == ["road", "sidewalk", "moving-car", "label 77"]


@pytest.mark.parametrize("names", [{"40": "ground"}, {"x": "road"}, {"9" * 5000: "road"}, {"40": 3}, [], "road"])
def test_manifests_with_invalid_label_names_are_rejected(names, tmp_path):
    wv.render_batch(street(), CAMERA, ABOVE, tmp_path / "street", quiet=True)
    manifest = json.loads((tmp_path / "street" / "manifest.json").read_text())
    manifest["scene"]["label_names"] = names
    (tmp_path / "street" / "manifest.json").write_text(json.dumps(manifest))
    for call in (wv.open_dataset, wv.batch.verify):
        with pytest.raises(
            wv.errors.FileFormatError, match=r"label_names in manifest.json must be valid names of labels"
        ):
            call(tmp_path / "street")
    del manifest["scene"]["label_names"]  # as in manifests of versions without `label_names`
    (tmp_path / "street" / "manifest.json").write_text(json.dumps(manifest))
    assert dict(wv.open_dataset(tmp_path / "street").label_names) == SIX


def test_commands_accept_label_options(street_file, tmp_path, monkeypatch, capsys):
    (tmp_path / "rules.json").write_text(TEXTS["rules.json"])
    np.save(tmp_path / "poses.npy", np.tile(ABOVE, (2, 1)))
    classes = ("--labels", "rules.json", "thing=crate", "walk_*=48", "--label-names", "90=crate")
    made = ("--outputs", "depth", "labels", "--format", "npz", "--out", "out", "--quiet")
    code, _, said = run_here(
        monkeypatch, capsys, tmp_path, "batch", street_file, "--poses", "poses.npy", *classes, *made
    )
    assert code == 0, said
    dataset = wv.open_dataset(tmp_path / "out")
    assert dict(dataset.label_names) == {**SIX, 40: "road", 90: "crate"}
    found = dict(zip(dataset.object_names, dataset.object_labels, strict=True))
    assert found == {"road_0": 7, "walk_0": 48, "car_0": 252, "thing": 90}
    assert (dataset[0]["labels"] == dataset.label_names.number("crate")).any()
    classes = ("--labels", "road_*=40", "car_0=252", "--label-names", "40=road")
    code, printed, said = run_here(monkeypatch, capsys, tmp_path, "info", street_file, *classes)
    assert code == 0, said
    assert "labels  obstacle 2, road 1, label 252 1" in printed


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--labels", "thing"], "--labels must be given as NAME=LABEL, such as ball=object, or as a file"),
        (["--labels", "thing=road"], "label must be one of empty (0), "),
        (["--labels", "none.toml"], "none.toml: cannot be read: No such file"),
        (["--label-names", "road"], "label names must be given as NUMBER=NAME, such as 40=road, got 'road'"),
        (["--label-names", "road=40"], "label names must be given as NUMBER=NAME, such as 40=road, got 'road=40'"),
        (["--label-names", "40=ground"], "--label-names must be different names, got 'ground' for 1 and for 40"),
    ],
)
def test_invalid_label_options_are_rejected(words, said, street_file, tmp_path, monkeypatch, capsys):
    code, _, printed = run_here(monkeypatch, capsys, tmp_path, "info", street_file, *words)
    assert code == 2
    assert printed.startswith(f"warpvis: {said}")


def test_colors_are_distinct_under_color_blindness():
    """Colors of labels and of visibility states must differ; red and brown once coincided for protanopes."""
    assert nearest_pair({"red": (229, 57, 53), "brown": (141, 95, 55)}) < (1.0,)
    labels = {label.name: color for label, (_, color) in wv.maps.MAP_LEGEND.items()}
    assert nearest_pair(labels) > (30.0,)
    assert nearest_pair({state.name: tuple(color) for state, color in wv.viz.STATE_COLORS.items()}) > (30.0,)
