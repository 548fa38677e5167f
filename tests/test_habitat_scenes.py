# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes of Habitat's datasets: each row of the table of docs/scene_files/habitat.md, and invalid files."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import warpvis as wv
from warpvis import Label, Scene
from warpvis.errors import FileFormatError, SceneError

from support.habitat import CUP, STAGE, TABLE, make_dataset, write

TO_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
URDF = """<robot name="drawer"><link name="body"><visual><geometry><box size="1 2 3"/></geometry></visual></link>
<link name="door"><visual><geometry><box size=".1 .2 .3"/></geometry></visual></link>
<joint name="hinge" type="revolute"><parent link="body"/><child link="door"/><origin xyz="0 0 2"/><axis xyz="0 1 0"/>
<limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"""


def load_one(folder, item=None, **options):
    """Load a scene with one cup."""
    return Scene.load(make_dataset(folder, {"object_instances": [{"template_name": "cup", **(item or {})}]}, **options))


def first(scene):
    return next(iter(scene))


def expect(item, mesh, matrix):
    """Check that an object in a scene with z up is a mesh at a matrix in the file, with y up."""
    corners = (np.asarray(mesh.vertices) @ matrix[:3, :3].T + matrix[:3, 3]) @ TO_Z_UP.T
    np.testing.assert_allclose(item.vertices[item.faces], corners[mesh.faces], atol=1e-6)


def placed(translation=(0, 0, 0), wxyz=(1, 0, 0, 0), scale=(1, 1, 1)):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(np.roll(wxyz, -1)).as_matrix() * np.asarray(scale)
    matrix[:3, 3] = translation
    return matrix


TURN = (0.5, 0.5, -0.5, 0.5)
TURNED = {"translation": [1, 2, 3], "rotation": list(TURN)}


def test_stage(tmp_path):
    stage = {"template_name": "stages/room", **TURNED}
    scene = Scene.load(make_dataset(tmp_path, {"stage_instance": stage}))
    assert [item.name for item in scene] == ["geometry_0"] and first(scene).label == Label.OBSTACLE
    expect(first(scene), STAGE, placed((1, 2, 3), TURN))
    assert scene.up == "z" and not first(scene).movable


def test_translation_and_rotation(tmp_path):
    scene = load_one(tmp_path, TURNED)
    expect(scene["cup"], CUP, placed((1, 2, 3), TURN))


def test_y_up_scene(tmp_path):
    path = make_dataset(tmp_path, {"object_instances": [{"template_name": "cup", **TURNED}]})
    matrix = placed((1, 2, 3), TURN)
    vertices = CUP.vertices @ matrix[:3, :3].T + matrix[:3, 3]
    item = Scene.load(path, up="y")["cup"]
    np.testing.assert_allclose(item.vertices[item.faces], vertices[CUP.faces], atol=1e-6)


def test_scales_multiply(tmp_path):
    item = {**TURNED, "uniform_scale": 2.0, "non_uniform_scale": [1, 2, 3]}
    scene = load_one(tmp_path, item, objects={"cup": {"scale": [0.5, 1, 1]}})
    expect(scene["cup"], CUP, placed((1, 2, 3), TURN, (1, 4, 6)))


@pytest.mark.parametrize(("center", "shift"), [(None, (0.1, 0.35, 0.2)), ([0.3, 0, 0.1], (0.3, 0, 0.1))])
@pytest.mark.parametrize("where", ["scene", "instance"])
def test_center_of_mass(tmp_path, center, shift, where):
    origin = {"translation_origin": "COM"}
    item = {
        "template_name": "table",
        **TURNED,
        "non_uniform_scale": [2, 1, 1],
        **(origin if where == "instance" else {}),
    }
    scene = {"object_instances": [item], **(origin if where == "scene" else {})}
    template = {} if center is None else {"COM": center}
    loaded = Scene.load(make_dataset(tmp_path, scene, objects={"table": template}))
    local = placed((0, 0, 0), scale=(2, 1, 1))
    local[:3, 3] = -np.array(shift) * (2, 1, 1)
    expect(loaded["table"], TABLE, placed((1, 2, 3), TURN) @ local)


def test_motion_type(tmp_path):
    kinds = {"s": "STATIC", "k": "KINEMATIC", "d": "dynamic", "none": None}
    items = [
        {"template_name": "cup", "translation": [number, 0, 0], **({"motion_type": kind} if kind else {})}
        for number, kind in enumerate(kinds.values())
    ]
    path = make_dataset(tmp_path, {"object_instances": items})
    assert [item.movable for item in Scene.load(path, movable=True)] == [False, True, True, True]
    assert not any(item.movable for item in Scene.load(path))


def test_up_and_front(tmp_path):
    scene = load_one(tmp_path, TURNED, objects={"cup": {"up": [0, 0, 1], "front": [0, 1, 0]}})
    frame = np.eye(4)
    frame[:3, :3] = [(1, 0, 0), (0, 0, 1), (0, -1, 0)]  # z becomes y, and y becomes -z
    expect(scene["cup"], CUP, placed((1, 2, 3), TURN) @ frame)


def test_units_to_meters_is_ignored_with_a_warning(tmp_path):
    with pytest.warns(UserWarning, match=r"cup.object_config.json: units_to_meters is ignored, as in Habitat-Sim"):
        scene = load_one(tmp_path, objects={"cup": {"units_to_meters": 2.0}})
    expect(scene["cup"], CUP, np.eye(4))


def test_collision_asset_replaces_a_missing_render_asset(tmp_path):
    scene = load_one(tmp_path, objects={"cup": {"render_asset": "", "collision_asset": "../t/table.glb"}})
    expect(scene["cup"], TABLE, np.eye(4))


def test_lexicon(tmp_path):
    names = {"semantic_scene_instance": "words"}
    lexicon = {"classes": [{"id": 7, "name": "coffee_mug"}, {"id": 9, "name": "table"}]}
    config = {"semantic_scene_descriptor_instances": {"words": "semantics/house_semantic_lexicon.json"}}
    scene = Scene.load(
        make_dataset(
            tmp_path,
            {"object_instances": [{"template_name": "cup"}, {"template_name": "table"}], **names},
            config=config,
            objects={"cup": {"semantic_id": 7}, "table": {"semantic_id": 9}},
            **{"semantics__house_semantic_lexicon.json": lexicon},
        ),
        labels={"coffee*": "human"},
    )
    assert [item.category for item in scene] == ["coffee_mug", "table"]
    assert [item.label for item in scene] == [Label.HUMAN, Label.OBSTACLE]


def test_table_of_objects(tmp_path):
    table = "id,name,main_category\ncup,My cup,mug\nother,x,\n"
    scene = load_one(tmp_path, **{"semantics__objects.csv": table})
    assert scene["cup"].category == "mug" and scene["cup"].label == Label.OBJECT


def test_default_attributes_and_configs(tmp_path):
    section = {
        "paths": {".json": ["objects/*"]},
        "default_attributes": {"scale": [2, 2, 2]},
        "configs": [
            {
                "template_handle": "tall",
                "original_file": "objects/c/cup.object_config.json",
                "attributes": {"scale": [1, 3, 1]},
            },
            {"template_handle": "bare", "attributes": {"render_asset": "objects/t/table.glb"}},
        ],
    }
    items = [{"template_name": name, "motion_type": "STATIC"} for name in ("cup", "tall", "bare")]
    scene = Scene.load(make_dataset(tmp_path, {"object_instances": items}, config={"objects": section}))
    expect(scene["cup"], CUP, placed(scale=(2, 2, 2)))
    expect(scene["tall"], CUP, placed(scale=(1, 3, 1)))
    expect(scene["bare"], TABLE, placed(scale=(2, 2, 2)))


def test_templates_are_found_without_a_configuration(tmp_path):
    path = make_dataset(tmp_path, {"object_instances": [{"template_name": "objects/c/cup"}]})
    (tmp_path / "house.scene_dataset_config.json").unlink()
    expect(Scene.load(path)["cup"], CUP, np.eye(4))
    moved = write(tmp_path / "far" / "away" / "x" / "y", "b.scene_instance.json", path.read_text())
    expect(Scene.load(moved, search_path=[tmp_path])["cup"], CUP, np.eye(4))


def test_bare_assets_are_templates(tmp_path):
    config = {"objects": {"paths": {".glb": ["objects/*"]}}}
    path = make_dataset(tmp_path, {"object_instances": [{"template_name": "table"}]}, config=config)
    (tmp_path / "objects/t/table.object_config.json").unlink()
    expect(Scene.load(path)["table"], TABLE, np.eye(4))


def test_instances_share_their_mesh(tmp_path):
    items = [{"template_name": "cup", "translation": [number, 0, 0], "motion_type": "STATIC"} for number in range(30)]
    scene = Scene.load(make_dataset(tmp_path, {"object_instances": items}))
    assert [item.name for item in scene][:3] == ["cup", "cup_1", "cup_2"]
    assert len({id(item.mesh) for item in scene}) == 1
    for number, item in enumerate(scene):
        expect(item, CUP, placed((number, 0, 0)))


def test_materials_of_one_asset_are_one_object(tmp_path):
    both = trimesh.Scene()
    for name, color, x in (("lid", (255, 0, 0, 255), 1), ("body", (0, 255, 0, 255), 0)):
        mesh = trimesh.creation.box().apply_translation((x, 0, 0))
        mesh.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(baseColorFactor=color))
        both.add_geometry(mesh, geom_name=name, node_name=name)
    path = make_dataset(tmp_path, {"object_instances": [{"template_name": "cup"}]})
    both.export(tmp_path / "objects/c/cup.glb")
    scene = Scene.load(path)
    assert len(scene) == 1 and len(first(scene).faces) == 24
    shown = first(scene).appearance
    colors = [shown.materials[index].base_color[:3] for index in shown.face_materials[[0, 12]]]
    assert colors == [(1, 0, 0), (0, 1, 0)]


LIGHTS = {
    "positive_intensity_scale": 2.0,
    "lights": {
        "bulb": {"position": [1, 2, 3], "intensity": 1.5, "color": [1, 0.5, 0.25], "type": "point"},
        "sun": {"direction": [0, 1, 0], "intensity": 1.0},
        "hole": {"position": [0, 0, 0], "intensity": -1.0},
        "torch": {"position": [0, 0, 0], "position_model": "camera"},
    },
}


def test_lights(tmp_path):
    scene = {"object_instances": [{"template_name": "cup"}], "default_lighting": "evening"}
    path = make_dataset(tmp_path, scene, **{"lights__x__evening.lighting_config.json": LIGHTS})
    with pytest.warns(UserWarning, match="left out the lights 'hole', which has a negative intensity, 'torch', which"):
        bulb, sun, ambient = Scene.load(path).lights
    assert (bulb.kind, bulb.position, bulb.intensity, bulb.color) == ("point", (1, -3, 2), 3.0, (1, 0.5, 0.25))
    assert bulb.strength(np.array([[3.0, -3, 2]])) == pytest.approx(0.25) and bulb.color_space == "linear"
    assert (sun.kind, ambient.kind, ambient.ambient) == ("directional", "ambient", (0.4, 0.4, 0.4))
    np.testing.assert_allclose(sun.direction, (0, 0, -1), atol=1e-12)  # the field points to the light


@pytest.mark.parametrize(
    ("handle", "kinds"),
    [(None, ["headlight"]), ("no_lights", ["headlight"]), ("", ["directional"] * 4 + ["ambient"])],
)
def test_default_lights(tmp_path, handle, kinds):
    scene = {"object_instances": [{"template_name": "cup"}], **({} if handle is None else {"default_lighting": handle})}
    assert [light.kind for light in Scene.load(make_dataset(tmp_path, scene)).lights] == kinds


def test_articulated_objects(tmp_path):
    item = {"template_name": "drawer", **TURNED, "uniform_scale": 0.5, "motion_type": "DYNAMIC"}
    path = make_dataset(tmp_path, {"articulated_object_instances": [item]}, **{"urdf__d__drawer.urdf": URDF})
    scene = Scene.load(path, movable=True)
    assert [item.name.partition("/")[0] for item in scene] == ["drawer", "drawer"]
    body, door = (trimesh.creation.box(size) for size in ((0.5, 1, 1.5), (0.05, 0.1, 0.15)))
    for item, mesh, matrix in zip(scene, (body, door), (np.eye(4), placed((0, 0, 1))), strict=True):
        corners = mesh.apply_transform(placed((1, 2, 3), TURN) @ matrix).vertices @ TO_Z_UP.T
        low, high = item.vertices.min(axis=0), item.vertices.max(axis=0)
        np.testing.assert_allclose((low, high), (corners.min(axis=0), corners.max(axis=0)), atol=1e-6)
    assert [item.movable for item in scene] == [False, True]


@pytest.mark.parametrize("initial", [{"hinge": 0.5}, [0.5]])
def test_joints_of_articulated_objects(tmp_path, initial):
    item = {"template_name": "drawer", **TURNED, "uniform_scale": 0.5, "initial_joint_pose": initial}
    items = [item, {"template_name": "drawer"}, {"template_name": "drawer", "motion_type": "STATIC"}]
    path = make_dataset(tmp_path, {"articulated_object_instances": items}, **{"urdf__d__drawer.urdf": URDF})
    scene = Scene.load(path, movable=True)
    assert scene.joints.names == ("drawer/hinge", "drawer_1/hinge")
    assert [item.movable for item in scene] == [False, True, False, True, False, False]
    turned = np.eye(4)
    turned[:3, :3] = Rotation.from_rotvec((0, 0.5, 0)).as_matrix()
    hinge = placed((1, 2, 3), TURN) @ placed((0, 0, 1)) @ turned
    door = list(scene)[1]
    corners = trimesh.creation.box((0.05, 0.1, 0.15)).apply_transform(hinge).vertices @ TO_Z_UP.T
    expected = corners.min(axis=0), corners.max(axis=0)
    np.testing.assert_allclose((door.vertices.min(axis=0), door.vertices.max(axis=0)), expected, atol=1e-6)
    poses = scene.joints.poses({"drawer/hinge": np.array([0.0, 0.5])})
    upright = np.eye(4)
    upright[:3, :3] = TO_Z_UP
    expected = [upright @ placed((1, 2, 3), TURN) @ placed((0, 0, 1)), upright @ hinge]
    np.testing.assert_allclose(poses[:, 0, :3], [matrix[:3, 3] for matrix in expected], atol=1e-6)
    for row, matrix in zip(poses[:, 0], expected, strict=True):
        np.testing.assert_allclose(Rotation.from_quat(row[3:]).as_matrix(), matrix[:3, :3], atol=1e-6)


def test_invalid_values_of_joints(tmp_path):
    for number, (initial, message) in enumerate(
        [
            ({"knee": 1}, r"'initial_joint_pose'\] does not fit the joints: values of 'knee' fit no joint"),
            ([1, 2], r"'initial_joint_pose'\] must be 1 finite numbers, got \[1, 2\]"),
            ({"hinge": "x"}, r"'initial_joint_pose'\]\['hinge'\] must be a finite number, got \"x\""),
        ]
    ):
        item = {"template_name": "drawer", "initial_joint_pose": initial}
        scene = {"articulated_object_instances": [item]}
        with pytest.raises(FileFormatError, match=message):
            Scene.load(make_dataset(tmp_path / str(number), scene, **{"urdf__d__drawer.urdf": URDF}))


def test_metadata(tmp_path):
    from warpvis.io import read_parts

    item = {"template_name": "cup", "motion_type": "STATIC", "user_defined": {"room": 3}}
    path = make_dataset(tmp_path, {"object_instances": [item]}, objects={"cup": {"semantic_id": 4}})
    extras = {"template": "cup", "semantic_id": 4, "motion_type": "STATIC", "user_defined": {"room": 3}}
    assert read_parts(path).parts[0].extras == extras


def test_ignored_fields(tmp_path):
    scene = {"object_instances": [{"template_name": "cup"}], "navmesh_instance": "x", "pbr_shader_region_configs": {}}
    config = {"navmesh_instances": {"x": "x.navmesh"}, "pbr_ibl_configs": {"paths": {".json": ["pbr"]}}}
    objects = {"cup": {"mass": 3, "friction_coefficient": 1, "shader_type": "phong", "force_flat_shading": True}}
    assert len(Scene.load(make_dataset(tmp_path, scene, config=config, objects=objects), strict=True)) == 1


def test_ignored_fields_of_articulated_objects(tmp_path):
    item = {"template_name": "drawer", "fixed_base": False, "initial_joint_velocities": [1], "mass_scale": 2}
    path = make_dataset(tmp_path, {"articulated_object_instances": [item]}, **{"urdf__d__drawer.urdf": URDF})
    assert [item.movable for item in Scene.load(path, movable=True, strict=True)] == [False, True]


def test_primitives_are_not_found(tmp_path):
    items = [{"template_name": "cup"}, {"template_name": "cubeSolid"}]
    with pytest.warns(UserWarning, match="left out 1 instance whose template was not found: 'cubeSolid'"):
        assert len(Scene.load(make_dataset(tmp_path, {"object_instances": items}))) == 1


@pytest.mark.parametrize("name", ["objects/c/cup.object_config.json", "stages/room.stage_config.json"])
def test_templates_are_scenes(tmp_path, name):
    make_dataset(tmp_path, {"object_instances": []}, objects={"cup": {"scale": [2, 2, 2]}})
    scene = Scene.load(tmp_path / name)
    expect(first(scene), CUP if "cup" in name else STAGE, placed(scale=(2, 2, 2) if "cup" in name else (1, 1, 1)))


def test_missing_templates_and_meshes(tmp_path):
    items = [{"template_name": name} for name in ("cup", "mug", "mug", "table")]
    path = make_dataset(tmp_path, {"object_instances": items})
    (tmp_path / "objects/t/table.glb").unlink()
    with pytest.warns(UserWarning, match=r"left out 2 instances whose template was not found: 'mug'"):
        with pytest.warns(UserWarning, match=r"left out 1 instance whose mesh file was not found: '.*table.glb'"):
            assert len(Scene.load(path)) == 1
    with pytest.raises(FileFormatError, match=r"a.scene_instance.json: left out 2 instances whose template"):
        Scene.load(path, strict=True)


ONE = {"template_name": "cup"}
INVALID = {
    "not JSON": ("{", {}, r"a.scene_instance.json:1: is not JSON"),
    "list": ([], {}, r"a.scene_instance.json: must contain a JSON object, got \[\]"),
    "other JSON": (
        {"a": 1},
        {},
        r"a.scene_instance.json: must have 'stage_instance' or 'object_instances', got neither",
    ),
    "no list": ({"object_instances": {}}, {}, r"json: 'object_instances' must be a list of objects, got an object"),
    "no name": (
        {"object_instances": [{}]},
        {},
        r"'object_instances'\[0\]\['template_name'\] must be a text, got nothing",
    ),
    "short": (
        {"object_instances": [{**ONE, "translation": [1, 2]}]},
        {},
        r"'object_instances'\[0\]\['translation'\] must be 3 finite numbers, got \[1, 2\]",
    ),
    "zero rotation": (
        {"object_instances": [{**ONE, "rotation": [0, 0, 0, 0]}]},
        {},
        r"\['rotation'\] must be a quaternion w x y z of length 1, got length 0",
    ),
    "motion": (
        {"object_instances": [{**ONE, "motion_type": "FLYING"}]},
        {},
        r"\['motion_type'\] must be STATIC, KINEMATIC or DYNAMIC, got 'flying'",
    ),
    "origin": (
        {"object_instances": [{**ONE, "translation_origin": "corner"}]},
        {},
        r"\['translation_origin'\] must be 'COM' or 'asset_local', got 'corner'",
    ),
    "zero scale": ({"object_instances": [{**ONE, "uniform_scale": 0}]}, {}, r"the scale must not be 0, got \[0.0"),
    "up and front": (
        {"object_instances": [ONE]},
        {"up": [0, 1, 0], "front": [0, 1, 1]},
        r"cup.object_config.json: up and front must be orthogonal, got \[0.0, 1.0, 0.0\] and \[0.0, 1.0, 1.0\]",
    ),
    "no mesh": (
        {"object_instances": [ONE]},
        {"render_asset": ""},
        r"'render_asset' must be the file of a mesh, got nothing",
    ),
    "semantic id": (
        {"object_instances": [ONE]},
        {"semantic_id": "x"},
        r"'semantic_id' must be a whole number, got \"x\"",
    ),
    "empty": ({"object_instances": []}, {}, r"a.scene_instance.json: holds no triangles"),
}


@pytest.mark.parametrize("case", INVALID)
def test_invalid_files(tmp_path, case):
    scene, template, message = INVALID[case]
    path = make_dataset(tmp_path, scene, objects={"cup": template})
    with pytest.raises((FileFormatError, SceneError), match=message):
        Scene.load(path)


def test_a_configuration_of_a_dataset_is_no_scene(tmp_path):
    make_dataset(tmp_path, {"object_instances": [ONE]})
    with pytest.raises(FileFormatError, match=r"lists the scenes of a dataset; load one of its 1 files"):
        Scene.load(tmp_path / "house.scene_dataset_config.json")


def test_invalid_tables_and_lexicons(tmp_path):
    with pytest.raises(FileFormatError, match=r"objects.csv: must have the columns 'id' and one of main_category"):
        load_one(tmp_path, **{"semantics__objects.csv": "a,b\n1,2\n"})
    with pytest.raises(FileFormatError, match=r"lexicon.json: 'classes'\[0\]\['id'\] must be a whole number"):
        load_one(tmp_path / "b", **{"semantics__lexicon.json": {"classes": [{"name": "x"}]}})
    with pytest.raises(wv.WarpvisError, match=r"'scene_instances'\['paths'\]\['.json'\] must be a list of paths"):
        load_one(tmp_path / "c", config={"scene_instances": {"paths": {".json": "scenes"}}})
