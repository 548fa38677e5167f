# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of Webots worlds as scenes: geometry, poses, names, labels, robots, and errors."""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from command_line import run_inside
from PIL import Image

import warpvis as wv
from warpvis import Label, Scene
from warpvis.errors import FileFormatError, SceneError
from warpvis.scenes import EXPERIMENTS
from warpvis.webots import Version, load_webots, render_color, render_range

from support.recorded_warnings import recorded_warnings

WORLDS = Path(__file__).parent.parent / "scenes" / "webots"
SHARED = Path(__file__).parent.parent.parent / "shared" / "webots"


def load_text(tmp_path, text, version="R2023b", **options):
    path = tmp_path / "world.wbt"
    path.write_text(f"#VRML_SIM {version} utf8\n{text}")
    return load_webots(path, **options)


def solid(fields, geometry="Box { size 1 1 1 }", kind="Solid"):
    return f"{kind} {{ {fields} children Shape {{ geometry {geometry} }} }}"


def corners(scene, name):
    return scene[name].vertices[np.lexsort(scene[name].vertices.T)]


def volume(scene, name):
    item = scene[name]
    return trimesh.Trimesh(item.vertices.astype(np.float64), item.faces).volume


# ------------------------------------------------------------------------------------------------- the paper's set-up


@pytest.fixture(scope="module")
def paper():
    return {version: load_webots(WORLDS / f"experiment_3_{version}.wbt") for version in ("R2021b", "R2023b")}


def test_both_versions_give_equal_images(paper):
    old, new = (render_range(world, "range-finder") for world in paper.values())
    assert old.shape == (240, 320) and 0.5 < np.isfinite(old).mean() < 0.9
    np.testing.assert_array_equal(np.isfinite(old), np.isfinite(new))
    np.testing.assert_allclose(old, new, atol=1e-6, rtol=0)
    assert [paper[version].scene.up for version in paper] == ["y", "z"]


def test_world_equals_the_preset(paper):
    """The floor and the obstacles equal those of the scene built in Python, seen by the same camera."""
    preset = EXPERIMENTS[2]
    world = paper["R2023b"]
    device = world.devices["range-finder"]
    assert device.camera == preset.camera
    np.testing.assert_allclose(
        wv.core.poses.poses_to_matrices(device.pose), wv.core.poses.poses_to_matrices(preset.poses()[0]), atol=1e-7
    )
    others = ("ball", "person", "robot", "left wheel", "right wheel", "range-finder")
    depth = wv.render(world.scene, device.camera, device.pose, exclude=others, cull_backfaces=True).depth.numpy()
    wanted = wv.render(preset.build(), preset.camera, preset.poses(), exclude=("ball", "person", "robot")).depth.numpy()
    same = np.isfinite(depth) == np.isfinite(wanted)
    assert same.mean() > 0.9999  # except at most a row of pixels at the floor's far edge and the slab's side
    np.testing.assert_allclose(depth[same], wanted[same], atol=2e-5)


def test_ball_is_visible_over_the_low_obstacle(paper):
    for world in paper.values():
        device = world.devices["range-finder"]
        seen = wv.object_visibility(world.scene, device.camera, device.pose, exclude=world.robots["robot"])
        pixels = dict(zip(seen.names, seen.visible_pixels.numpy()[0].tolist(), strict=True))
        assert pixels["ball"] > 300 and pixels["person"] == 0


def test_names_labels_and_robots(paper):
    world = paper["R2023b"]
    labels = {item.name: item.label for item in world.scene}
    assert labels == {
        "floor": Label.GROUND,
        "low obstacle": Label.OBSTACLE,
        "high obstacle": Label.OBSTACLE,
        "ball": Label.OBJECT,
        "person": Label.HUMAN,
        "robot": Label.ROBOT,
        "left wheel": Label.ROBOT,
        "right wheel": Label.ROBOT,
        "range-finder": Label.ROBOT,
    }
    assert world.robots == {"robot": ("robot", "left wheel", "right wheel", "range-finder")}
    assert set(world.devices) == {"range-finder", "camera"}
    assert world.version == Version.parse("R2023b") and not world.skipped and not world.notes
    assert "Robot 'robot' (DEF ROBOT): object 'robot', 156 triangles\n  Solid 'left wheel'" in world.tree


# ---------------------------------------------------------------------------------------------------- single rules


@pytest.mark.parametrize(
    ("version", "info", "up"),
    [
        ("R2023b", "", "z"),
        ("R2023b", 'coordinateSystem "NUE"', "y"),
        ("R2021b", 'coordinateSystem "EUN"', "y"),
        ("R2021b", 'coordinateSystem "ENU" gravity 9.81', "z"),
        ("R2019a", "", "y"),
        ("R2019a", "gravity 0 0 -9.81", "z"),
        ("V6.0", "gravity 0 -9.81 0", "y"),
        ("V8.6", "gravity 0 0 0", "y"),
    ],
)
def test_vertical_axis(tmp_path, version, info, up):
    assert load_text(tmp_path, f"WorldInfo {{ {info} }} {solid('')}", version).scene.up == up


def test_old_cylinders_stand_along_y(tmp_path):
    text = solid("", "Cylinder { radius 0.5 height 4 }")
    np.testing.assert_allclose(np.ptp(load_text(tmp_path, text, "R2021b").scene.bounds, axis=0), [1, 4, 1], atol=1e-6)
    np.testing.assert_allclose(np.ptp(load_text(tmp_path, text, "R2022a").scene.bounds, axis=0), [1, 1, 4], atol=1e-6)


def test_names_are_made_unique(tmp_path):
    text = "".join(
        [
            solid('name "box"'),
            solid('name "box"'),
            solid('name "box (2)"'),
            "DEF CRATE " + solid(""),
            solid(""),
            "Shape { geometry Box { } }",
            "DEF LONE Shape { geometry Box { } }",
            "DEF NEST Group { children Shape { geometry Box { } } }",
            solid("", kind="DistanceSensor"),
            solid('name ""', kind="LED"),
        ]
    )
    names = [item.name for item in load_text(tmp_path, text).scene]
    assert names[:5] == ["box", "box (2)", "box (2) (2)", "CRATE", "solid"]
    assert names[5:] == ["shape", "LONE", "NEST", "distance sensor", "led"]


@pytest.mark.parametrize(
    ("text", "label"),
    [
        (solid('name "Kitchen Floor"'), Label.GROUND),
        (solid('name "playground"'), Label.GROUND),
        (solid('name "floor lamp"'), Label.OBSTACLE),
        (solid('name "mat"', "Plane { }"), Label.GROUND),
        (solid('name "mat" translation 0 0 0.09', "Plane { }"), Label.GROUND),
        (solid('name "table top" translation 0 0 0.2', "Plane { }"), Label.OBSTACLE),
        (solid('name "seen from below" rotation 1 0 0 3.141592653589793', "Plane { }"), Label.OBSTACLE),
        (solid('name "wall" rotation 1 0 0 1.5708', "Plane { }"), Label.OBSTACLE),
        (solid('name "The Person"'), Label.HUMAN),
        (solid('name "virtual human" recognitionColors 1 0 0'), Label.HUMAN),
        (solid("recognitionColors [ 1 0 0 0 1 0 ]"), Label.OBJECT),
        (solid("recognitionColors 1 0 0", kind="Robot"), Label.ROBOT),
        (solid("", kind="DifferentialWheels"), Label.ROBOT),
        (solid('name "wooden box"'), Label.OBSTACLE),
    ],
)
def test_labels_by_rule(tmp_path, text, label):
    assert load_text(tmp_path, text).scene.objects[0].label == label


def test_user_labels_take_precedence(tmp_path):
    text = solid('name "wall 1"') + solid('name "wall 2"') + solid('name "floor"')
    scene = load_text(tmp_path, text, labels={"wall*": "object", "*2": "human", "floor": 2}).scene
    assert [item.label for item in scene] == [Label.OBJECT, Label.HUMAN, Label.OBSTACLE]


def test_only_the_floor_of_an_arena_is_ground(tmp_path):
    scene = load_text(tmp_path, "RectangleArena { floorSize 3 2 wallHeight 0.4 }").scene
    ground = [item for item in scene if item.label == Label.GROUND]
    assert len(scene) == 2 and len(ground) == 1
    np.testing.assert_allclose(np.ptp(ground[0].bounds, axis=0), [3, 2, 0], atol=1e-6)
    np.testing.assert_allclose(scene.bounds[1], [1.51, 1.01, 0.4], atol=1e-6)


def test_invalid_scales_are_corrected_as_in_webots(tmp_path):
    text = "Transform { scale -2 0 3 children Shape { geometry Box { size 1 1 1 } } }"
    with pytest.warns(UserWarning, match=r"world.wbt:2: scale -2 0 3 of Transform is replaced by 1 1 3"):
        world = load_text(tmp_path, text, "R2022a")
    np.testing.assert_allclose(np.ptp(world.scene.bounds, axis=0), [1, 1, 3])
    with pytest.warns(UserWarning, match=r"scale -2 0 3 of Transform is replaced by -2 1 3"):
        world = load_text(tmp_path, text, "R2022b")
    np.testing.assert_allclose(np.ptp(world.scene.bounds, axis=0), [2, 1, 3])
    assert volume(world.scene, "shape") == pytest.approx(6)


def test_skipped_nodes_are_named_once(tmp_path):
    text = "Spaceship { } Spaceship { } Group { children Comet { } }" + solid("", 'Mesh { url "none.obj" }') + solid("")
    (tmp_path / "protos").mkdir()
    with recorded_warnings() as caught:
        world = load_text(tmp_path, text, search_path=[tmp_path / "protos"])
    assert len(caught) == 1
    message = str(caught[0].message)
    assert "world.wbt: skipped Spaceship (2), Comet (1), Mesh none.obj (1)" in message and "protos" in message
    assert world.skipped == {"Spaceship": 2, "Comet": 1, "Mesh none.obj": 1}
    assert "Spaceship: skipped" in world.tree
    with pytest.raises(FileFormatError, match=r"skipped Spaceship \(2\)"):
        load_text(tmp_path, text, strict=True)


def test_lights_and_bounding_objects_are_not_rendered(tmp_path):
    text = "PointLight { } Fog { } TexturedBackground { } TexturedBackgroundLight { }"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        world = load_text(tmp_path, text + solid("boundingObject Box { size 9 9 9 }"), strict=True)
    np.testing.assert_allclose(world.scene.bounds, [[-0.5] * 3, [0.5] * 3])


def test_proto_file_precedes_the_builtin_type(tmp_path):
    (tmp_path / "files").mkdir()
    (tmp_path / "files" / "WoodenBox.proto").write_text(
        "#VRML_SIM R2023b utf8\nPROTO WoodenBox [ field SFVec3f size 1 1 1 field SFVec3f translation 0 0 0 "
        'field SFString name "wooden box" ] { Solid { translation IS translation name IS name '
        "children [ Shape { geometry Sphere { } } ] } }"
    )
    text = "DEF CRATE WoodenBox { translation 5 0 0 } WoodenBox { size 1 1 1 }"
    scene = load_text(tmp_path, text, search_path=[tmp_path / "files"]).scene
    assert [item.name for item in scene] == ["CRATE", "wooden box"]
    assert len(scene["wooden box"].faces) == 80
    assert scene["CRATE"].bounds.mean(axis=0)[0] == pytest.approx(5, abs=1e-6)
    other = tmp_path / "elsewhere"
    other.mkdir()
    assert len(load_text(other, text).scene["wooden box"].faces) == 12


HINGE = "jointParameters HingeJointParameters { position 0.3 axis 0 0 1 anchor 1 0 0 }"
LIMB = """endPoint Solid {
  translation 2 0 1 rotation 0 0 1 0.3 name "%s" children [ Shape { geometry Box { size 1 2 3 } } RangeFinder { } %s ]
}"""
ROTOR = "DEF ROTOR Pose { translation 0 0 7 children Shape { geometry Box { size 1 1 1 } } }"


def humanoid(kind, fields=""):
    """Return a robot of a torso and two limbs, one below the other, at two joints."""
    limb = LIMB % ("arm", f"{kind} {{ {HINGE} {fields} {LIMB % ('hand', '')} }}")
    return f"Robot {{ children [ Shape {{ geometry Sphere {{ }} }} {kind} {{ {HINGE} {fields} {limb} }} ] }}"


@pytest.mark.parametrize("kind", ["HingeJoint", "Hinge2Joint"])
def test_backlash_joints_equal_plain_joints(tmp_path, kind):
    expected = load_text(tmp_path, humanoid(kind), strict=True)
    fields = "backlash 0.02 gearMass 0.1 outputSensor PositionSensor { }"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = load_text(tmp_path, humanoid(f"{kind}WithBacklash", fields), strict=True)
    assert [item.name for item in found.scene] == [item.name for item in expected.scene] == ["robot", "arm", "hand"]
    for one, other in zip(found.scene, expected.scene, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)
    assert found.robots == expected.robots and list(found.devices) == list(expected.devices)
    poses = [[device.pose for device in world.devices.values()] for world in (found, expected)]
    np.testing.assert_array_equal(*poses)


@pytest.mark.parametrize(
    ("fields", "highest"),
    [
        ("startPoint", 7.5),
        ("backlash 0.5 startPoint", 7.5),
        ("backlash -1 startPoint", 7.5),  # Webots uses the default
        ("backlash 0 startPoint", 1),
        ("startPoint2", 7.5),
        ("backlash 0 startPoint2", 7.5),
        ("backlash2 0 startPoint2", 1),
    ],
)
def test_start_points_are_rendered_if_joint_has_backlash(tmp_path, fields, highest):
    joint = f"Hinge2JointWithBacklash {{ {fields} {ROTOR} }}"
    scene = load_text(tmp_path, f"Solid {{ children [ {joint} Shape {{ geometry Sphere {{ }} }} ] }}").scene
    assert scene.bounds[1, 2] == pytest.approx(highest)


def test_proto_file_of_a_joint_takes_precedence(tmp_path):
    (tmp_path / "HingeJointWithBacklash.proto").write_text(
        "#VRML_SIM R2023b utf8\nPROTO HingeJointWithBacklash [ field SFNode endPoint NULL ] { Pose { translation 0 0 9 "
        "children [ HingeJoint { endPoint IS endPoint } ] } }"
    )
    text = "Solid { children HingeJointWithBacklash { endPoint " + solid("") + " } }"
    assert load_text(tmp_path, text, search_path=[tmp_path]).scene.bounds[1, 2] == pytest.approx(9.5)


def test_nodes_in_skipped_nodes_are_counted(tmp_path):
    """They are not rendered: only the PROTO's file defines their placement."""
    limb = solid("translation 1 0 0")
    text = f"{solid('')} OwnJoint {{ endPoint {limb} }} OwnJoint {{ endPoint {limb} other NULL }} Ghost {{ }}"
    with pytest.warns(UserWarning, match=r"skipped OwnJoint \(2 with 6 nodes in it\), Ghost \(1\), whose files"):
        world = load_text(tmp_path, text)
    assert world.skipped == {"OwnJoint": 2, "Ghost": 1} and len(world.scene) == 1


def test_malformed_proto_file_is_named(tmp_path):
    (tmp_path / "files").mkdir()
    (tmp_path / "files" / "WoodenBox.proto").write_text(
        "#VRML_SIM R2023b utf8\nPROTO WoodenBox [ ] {\n Solid { ] }\n}\n"
    )
    text, files = "WoodenBox { }", [tmp_path / "files"]
    with recorded_warnings(r"ignored the file of WoodenBox: .*WoodenBox.proto:3: expected") as caught:
        assert len(load_text(tmp_path, text, search_path=files).scene) == 1  # the builtin type
    assert len(caught) == 1
    with pytest.raises(FileFormatError, match=r"WoodenBox.proto:3: expected"):
        load_text(tmp_path, text, search_path=files, strict=True)


BENCH = """#VRML_SIM R2023b utf8
PROTO Bench [
  field SFVec3f translation 0 0 0
  field SFString name "bench"
  field MFNode onTop []
] {
  Solid {
    translation IS translation
    name IS name
    children [
      Shape { geometry Slab { } }
      Solid { translation 0 -0.9 -0.3 name "leg" children Shape { geometry Box { size 0.1 0.1 0.5 } } }
      Solid {
        translation 0 0.9 -0.3
        name "leg(1)"
        children [
          Shape { geometry Box { size 0.1 0.1 0.5 } }
          Camera { name "eye" }
          Solid { name "lamp" recognitionColors 1 1 0 children Shape { geometry Sphere { radius 0.1 } } }
        ]
      }
      Group { children IS onTop }
    ]
  }
}
"""


def test_proto_instance_is_one_object(tmp_path):
    (tmp_path / "Bench.proto").write_text(BENCH)
    (tmp_path / "Slab.proto").write_text("#VRML_SIM R2023b utf8\nPROTO Slab [ ] {\n Box { size 0.5 2 0.1 }\n}\n")
    text = 'Bench { onTop Solid { name "cup" children Shape { geometry Box { size 1 1 1 } } } } Bench { name "b" }'
    world = load_text(tmp_path, text, strict=True)
    counts = {item.name: len(item.faces) for item in world.scene}
    assert counts == {"bench": 36, "lamp": 80, "cup": 12, "b": 36, "lamp (2)": 80}
    assert list(world.devices) == ["eye", "eye (2)"] and list(world.recognizable) == ["lamp", "lamp (2)"]
    np.testing.assert_allclose(world.scene["bench"].bounds, [[-0.25, -1, -0.55], [0.25, 1, 0.05]], atol=1e-6)


def test_geometry_without_triangles_or_file(tmp_path):
    text = solid('name "dots"', "PointSet { }") + solid('name "what"', "Blob { }") + solid('name "box"')
    with pytest.warns(UserWarning, match=r"skipped Blob \(1\)"):
        world = load_text(tmp_path, text)
    assert [item.name for item in world.scene] == ["box"] and world.skipped == {"Blob": 1}


def test_meshes_are_found_on_the_search_path(tmp_path):
    folder = tmp_path / "webots" / "projects" / "things"
    folder.mkdir(parents=True)
    (folder / "a.obj").write_bytes((WORLDS / "tetrahedron.obj").read_bytes())
    for root in ("webots://", "https://raw.githubusercontent.com/cyberbotics/webots/R2023b/"):
        text = solid("", f'Mesh {{ url "{root}projects/things/a.obj" }}')
        assert len(load_text(tmp_path, text, search_path=[tmp_path / "webots"], strict=True).scene["solid"].faces) == 4
        with pytest.raises(SceneError, match=r"skipped Mesh .*; no triangles remain"):
            load_text(tmp_path, text)


def test_webots_urls_do_not_escape_the_search_path(tmp_path):
    (tmp_path / "webots").mkdir()
    text = solid("", f'Mesh {{ url "webots://{(WORLDS / "tetrahedron.obj").resolve()}" }}')
    with pytest.raises(SceneError, match=r"skipped Mesh .*; no triangles remain"):
        load_text(tmp_path, text, search_path=[tmp_path / "webots"])


def test_exponential_use_raises(tmp_path):
    levels = ["DEF A0 Group { children [ Shape { geometry DEF B Box { } } ] }"]
    levels += [
        f"DEF A{k} Group {{ children [ {'USE A' + str(k - 1) + ' '} {'USE A' + str(k - 1)} ] }}" for k in range(1, 23)
    ]
    with pytest.raises(FileFormatError, match="expected at most"):
        load_text(tmp_path, "\n".join(levels))


def test_deep_trees_load_without_recursion(tmp_path):
    text = "Pose { translation 0 0 1 children [ " * 140 + "Shape { geometry Box { } }" + "] }" * 140
    assert load_text(tmp_path, text).scene.bounds[1, 2] == 141


BAD = {
    "no file": (lambda folder: load_webots(folder / "none.wbt"), r"none.wbt: no such file"),
    "no header": (lambda folder: load_webots(write(folder, "Solid { }")), r"world.wbt:1: expected the header"),
    "not closed": (lambda folder: load_text(folder, "Solid {\n\n"), r"world.wbt:4: expected"),
    "rotation of three": (
        lambda folder: load_text(folder, "\n" + solid("rotation 0 0 1")),
        "world.wbt:3: expected 4 numbers in 'rotation' of Solid, got 3",
    ),
    "children of numbers": (lambda folder: load_text(folder, "Solid { children [ 1 2 ] }"), "expected nodes in 'child"),
    "coordinate system": (
        lambda folder: load_text(folder, 'WorldInfo { coordinateSystem "UNE" }' + solid(""), strict=True),
        "expected values that are valid in Webots, got others: .*world.wbt:2: "
        "coordinateSystem UNE of WorldInfo is replaced by ENU",
    ),
    "negative radius": (
        lambda folder: load_text(folder, solid("", "Sphere { radius -1 }"), strict=True),
        "world.wbt:2: radius -1 of Sphere is replaced by 1",
    ),
    "beyond all": (
        lambda folder: load_text(folder, "\n" + solid("translation 1e30 0 0")),
        r"world.wbt:3: expected Shape within 1e\+18 m of the origin",
    ),
    "no geometry": (lambda folder: load_text(folder, "WorldInfo { }"), "holds no triangles"),
    "label of nothing": (
        lambda folder: load_text(folder, solid('name "box"'), labels={"ball": "object"}),
        "labels for 'ball' fit no object of .*world.wbt, which has 'box'",
    ),
    "unknown label": (lambda folder: load_text(folder, solid(""), labels={"*": "cat"}), "label must be one of"),
    "scale": (lambda folder: Scene.load(write_world(folder), scale=0.1), "leave out scale and file_up"),
    "file_up": (lambda folder: Scene.load(write_world(folder), file_up="y"), "leave out scale and file_up"),
}


def write(folder, text):
    path = folder / "world.wbt"
    path.write_text(text)
    return path


def write_world(folder):
    return write(folder, "#VRML_SIM R2023b utf8\n" + solid(""))


@pytest.mark.parametrize("case", BAD)
def test_invalid_worlds_raise_one_line_message(case, tmp_path):
    act, message = BAD[case]
    with pytest.raises((FileFormatError, SceneError), match=message) as caught:
        act(tmp_path)
    assert "\n" not in str(caught.value)


# ------------------------------------------------------------------------------------- Scene.load and the command line


def test_scene_load_opens_worlds(device):
    scene = Scene.load(WORLDS / "experiment_3_R2021b.wbt", device=device, labels={"ball": "human"})
    assert scene.up == "y" and str(scene.device) == device and scene["ball"].label == Label.HUMAN


def run_cli(*arguments, cwd, code=0):
    result = run_inside(*arguments, cwd=cwd)
    assert result.returncode == code, result.stderr
    return result


def test_info_prints_the_tree(tmp_path):
    write(tmp_path, (WORLDS / "experiment_3_R2023b.wbt").read_text() + "Spaceship { } Can { }")
    result = run_cli("info", "world.wbt", cwd=tmp_path)
    assert "world.wbt: R2023b, z up, 10 objects" in result.stdout
    assert "  Solid 'left wheel': object 'left wheel', 144 triangles" in result.stdout
    assert "device  'range-finder' of 'robot': range-finder, 320x240" in result.stdout
    assert "left out  Spaceship (1)" in result.stdout
    assert "stand-in  Can (1)" in result.stdout
    assert "warning: world.wbt: skipped Spaceship (1)" in result.stderr


def test_render_writes_every_range_finder(tmp_path):
    path = WORLDS / "experiment_3_R2021b.wbt"
    run_cli("render", path, "--out", "true", cwd=tmp_path)
    exact = ("--version-exact", "--device-name", "range-finder", "--quiet")
    assert run_cli("render", path, "--out", "exact", *exact, cwd=tmp_path).stdout == ""
    world = load_webots(path)
    picture = np.asarray(Image.open(tmp_path / "true" / "camera" / "color" / "000000.png"))
    np.testing.assert_array_equal(picture, render_color(world, "camera"))
    for folder, version in (("true", None), ("exact", "header")):
        names = sorted(entry.name for entry in (tmp_path / folder).iterdir())
        assert names == (["camera", "range-finder"] if version is None else ["range-finder"])
        stored = np.load(tmp_path / folder / "range-finder" / "depth.npz")
        np.testing.assert_array_equal(stored["depth"][0], render_range(world, "range-finder", webots_version=version))
        np.testing.assert_allclose(stored["camera_to_world"], world.devices["range-finder"].pose[None], atol=1e-6)
        np.testing.assert_allclose(stored["K"], world.devices["range-finder"].camera.to_K())
        assert (tmp_path / folder / "range-finder" / "depth" / "000000.png").is_file()


def test_render_accepts_poses_and_camera_for_worlds(tmp_path):
    pose = wv.look_at((-3, 0, 2), (0, 0, 0))
    (tmp_path / "poses.txt").write_text("0 " + " ".join(map(str, pose)))
    (tmp_path / "camera.json").write_text(json.dumps({"width": 32, "height": 24, "hfov": 1.0}))
    path = WORLDS / "experiment_3_R2023b.wbt"
    run_cli("render", path, "--poses", "poses.txt", "--camera", "camera.json", "--out", "out", cwd=tmp_path)
    depth = wv.render(Scene.load(path), wv.Camera.from_fov(32, 24, hfov=1), pose).depth.numpy()
    np.testing.assert_array_equal(np.load(tmp_path / "out" / "npz" / "shard-000000.npz")["depth"], depth)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("render", "box.stl", "--out", "out"), "give --poses"),
        (("render", "world.wbt", "--out", "out"), "has no range finder, lidar or camera; give --poses"),
        (("render", "world.wbt", "--out", "out", "--device-name", "eye"), "the world has no device 'eye'"),
        (("render", "world.wbt", "--out", "out", "--labels", "a=human"), "have their own poses: give no --labels"),
        (("render", "world.wbt", "--out", "out", "--format", "png"), "have their own poses: give no --format"),
        (("info", "world.wbt", "--up", "z"), "info of a Webots world takes no --up"),
        (("info", "--scale", "2"), "info of this machine takes no --scale"),
        (("info", "none.wbt"), "none.wbt: no such file"),
    ],
)
def test_command_line_errors(tmp_path, arguments, message):
    write_world(tmp_path)
    trimesh.creation.box().export(tmp_path / "box.stl")
    result = run_cli(*arguments, cwd=tmp_path, code=2)
    assert message in result.stderr and "Traceback" not in result.stderr


# ------------------------------------------------------------------------------------------------ real worlds


@pytest.mark.skipif(not SHARED.is_dir(), reason="no ../shared/webots here")
def test_real_worlds_load():
    paths = sorted(SHARED.glob("*.wbt"))
    assert paths
    for path in paths:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            world = load_webots(path)
        assert len(world.scene) > 0 and str(world.version) in path.name
        assert np.isfinite(world.scene.bounds).all() and np.abs(world.scene.bounds).max() < 20
