# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""`Scene.load` of MJCF and URDF: comparison with MuJoCo's compiler, search paths, names, and errors."""

import re
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from mujoco_models import SHAPES
from PIL import Image

import warpvis as wv
from warpvis import Label, Scene
from warpvis.errors import FileFormatError, SceneError
from warpvis.mujoco import scene_from_mujoco

from support.model_files import BOX, MESH, ROBOT
from support.recorded_warnings import recorded_warnings


def load(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Scene.load(path, **options)


@pytest.fixture
def package(tmp_path):
    """Return a ROS package of a robot: robots/urdf/arm.urdf and robots/meshes/hand.stl."""
    for name in ("urdf", "meshes"):
        (tmp_path / "robots" / name).mkdir(parents=True)
    trimesh.creation.box((2, 2, 2)).export(tmp_path / "robots" / "meshes" / "hand.stl")
    (tmp_path / "robots" / "urdf" / "arm.urdf").write_text(ROBOT)
    return tmp_path / "robots"


def bounds(scene, name):
    return scene[name].bounds.round(4).tolist()


def test_mjcf_matches_compiled_model(tmp_path, device):
    path = tmp_path / "shapes.xml"
    path.write_text(SHAPES)
    expected = scene_from_mujoco(mujoco.MjModel.from_xml_string(SHAPES), device=device).scene
    moving = load(path, movable=True, device=device)
    still = load(path, device=device)
    assert still.movable == () and (still.up, moving.up) == ("z", "z")
    for scene in (still, moving):
        assert [(item.name, item.label) for item in scene] == [(item.name, item.label) for item in expected]
        for item in scene:
            np.testing.assert_allclose(item.vertices, expected[item.name].vertices, atol=1e-6)
    for item in moving:
        if expected[item.name].solid is None or item.movable:
            other = expected[item.name]
            assert (item.movable, item.parent is None) == (other.movable, other.parent is None)
    assert {item.name for item in expected if item.movable and not moving[item.name].movable} == {"own_color"}


@pytest.mark.slow
def test_aloha_matches_compiled_model():
    package = pytest.importorskip("mujoco_warp")
    path = Path(package.__file__).parent / "test_data" / "aloha_pot" / "scene.xml"
    expected = scene_from_mujoco(mujoco.MjModel.from_xml_path(str(path))).scene
    scene = load(path, movable=True, labels={"*": "robot"})
    assert [item.name for item in scene] == [item.name for item in expected]
    assert scene.triangle_count == expected.triangle_count and {item.label for item in scene} == {Label.ROBOT}
    camera, pose = wv.Camera.from_fov(64, 48, hfov=1.0), wv.look_at((0.5, -1.5, 0.8), (0, 0, 0.2))
    depths = [wv.render(one, camera, pose).depth.numpy() for one in (scene, expected)]
    np.testing.assert_allclose(*depths, atol=1e-5)


def test_patterns_match_body_names(tmp_path):
    (tmp_path / "shapes.xml").write_text(SHAPES)
    scene = load(tmp_path / "shapes.xml", labels={"arm": "robot", "hand*": "human"}, movable=["brick"])
    assert (scene["upper"].label, scene["hand"].label) == (Label.ROBOT, Label.HUMAN)
    assert [scene.objects[index].name for index in scene.movable] == ["brick"]
    np.testing.assert_allclose(scene["brick"].pose[:3], [0.8, -0.5, 0.2], atol=1e-6)


def test_models_are_rotated_to_requested_up_axis(tmp_path):
    (tmp_path / "shapes.xml").write_text(SHAPES)
    upright, turned = load(tmp_path / "shapes.xml"), load(tmp_path / "shapes.xml", up="y", movable=True)
    for item in turned:
        x, z, y = upright[item.name].vertices.T
        np.testing.assert_allclose(item.vertices, np.stack([x, y, -z], axis=1), atol=1e-5)


def test_urdf_loads_visual_elements(package):
    scene = load(package / "urdf" / "arm.urdf")
    assert [item.name for item in scene] == ["base", "upper", "hand"]
    assert {item.label for item in scene} == {Label.ROBOT} and scene.movable == ()
    assert bounds(scene, "base") == [[-0.5, -1, -2], [0.5, 1, 2]]
    assert bounds(scene, "hand") == [[4.5, -0.5, -0.5], [5.5, 0.5, 0.5]]
    np.testing.assert_allclose(scene["upper"].bounds, [[2.5, -0.1, -0.1], [3.5, 0.1, 0.1]], atol=2e-3)


def test_links_with_joints_are_movable(package):
    scene = load(package / "urdf" / "arm.urdf", movable=True, labels={"v": "human", "hand": "object"})
    assert [scene.objects[index].name for index in scene.movable] == ["upper", "hand"]
    assert (scene["upper"].label, scene["hand"].label) == (Label.HUMAN, Label.OBJECT) and not scene["base"].movable
    assert scene["upper"].solid is not None  # an exact cylinder


def test_urdf_without_visuals_loads_collision_elements(package):
    path = package / "urdf" / "arm.urdf"
    path.write_text(ROBOT.replace("visual", "collision"))
    np.testing.assert_allclose(load(path)["base_1"].bounds, [[-9, -9, -9], [9, 9, 9]], atol=2e-3)
    assert [item.name for item in load(path)] == ["base", "base_1", "upper", "hand"]


@pytest.mark.parametrize(
    "url", ["package://far/hand.stl", "package:///far/hand.stl", "model://far/hand.stl", "hand.stl", "sub/hand.stl"]
)
def test_meshes_are_found_on_the_search_path(package, tmp_path, url):
    folder = tmp_path / "else" / "far"
    for place in (folder, folder / "sub"):
        place.mkdir(parents=True)
        trimesh.creation.box((2, 2, 2)).export(place / "hand.stl")
    path = package / "urdf" / "arm.urdf"
    path.write_text(ROBOT.replace("package://robots/meshes/hand.stl", url))
    with recorded_warnings(rf"arm.urdf: skipped {url}, whose files were not found") as caught:
        assert [item.name for item in Scene.load(path)] == ["base", "upper"]
    assert caught[0].filename == __file__
    with pytest.raises(FileFormatError, match=f"skipped {url}"):
        load(path, strict=True)
    for root in [folder] + [folder.parent] * ("://" in url):
        assert bounds(load(path, strict=True, search_path=root), "hand") == [[4.5, -0.5, -0.5], [5.5, 0.5, 0.5]]


@pytest.mark.parametrize("name", ["hand.ply", "hand.glb", "hand.obj", "text.stl", "hand.off"])
def test_urdf_mesh_formats_unsupported_by_mujoco(package, name):
    path = package / "urdf" / "arm.urdf"
    mesh = trimesh.creation.box((2, 2, 2))
    mesh.export(package / "meshes" / name, file_type="stl_ascii" if name == "text.stl" else None)
    path.write_text(ROBOT.replace("hand.stl", name))
    assert bounds(load(path), "hand") == [[4.5, -0.5, -0.5], [5.5, 0.5, 0.5]]
    assert len(load(path)["hand"].faces) == 12


def robot_of(tmp_path, mesh, *, scale="1 1 1", rest=""):
    """Write a robot of one link at (0, 0, 5) whose visual is a mesh file, and return its path."""
    visual = f'<origin xyz="0 0 5"/><geometry><mesh filename="{mesh}" scale="{scale}"/></geometry>'
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="r"><link name="a"><visual>{visual}</visual>{rest}</link></robot>')
    return path


def boxes(tmp_path, keyword):
    """Write an OBJ file of three boxes in a row along x, each an object, or a group, and return their mesh."""
    lines, whole = [], []
    for number in range(3):
        box = trimesh.creation.box((1, 2, 3))
        box.apply_translation((2 * number, 0, 0))
        lines += [f"{keyword} box_{number}", *(f"v {x} {y} {z}" for x, y, z in box.vertices)]
        lines += [f"f {a} {b} {c}" for a, b, c in box.faces + 1 + 8 * number]
        whole.append(box)
    (tmp_path / "boxes.obj").write_text("\n".join(lines) + "\n")
    return trimesh.util.concatenate(whole)


@pytest.mark.parametrize("keyword", ["o", "g"])
def test_urdf_loads_all_objects_of_obj_file(tmp_path, keyword):
    whole = boxes(tmp_path, keyword)
    scene = load(robot_of(tmp_path, "boxes.obj"))
    assert [item.name for item in scene] == ["a"] and scene.triangle_count == len(whole.faces) == 36
    np.testing.assert_allclose(scene.bounds, whole.bounds + [0, 0, 5], atol=1e-6)
    np.testing.assert_allclose(trimesh.Trimesh(scene["a"].vertices, scene["a"].faces).area, whole.area, rtol=1e-6)
    camera, pose = wv.Camera.from_fov(32, 24, hfov=1.2), wv.look_at((4, 0, 15), (4, 0, 5), up=(0, 1, 0))
    assert wv.render(scene, camera, pose).depth.numpy()[0, 12, 16] == pytest.approx(8.5)  # the last box


def test_mjcf_obj_file_matches_mujoco(tmp_path):
    """MuJoCo's decoder reads only the first object."""
    boxes(tmp_path, "o")
    text = '<mujoco><asset><mesh name="m" file="boxes.obj"/></asset><worldbody><geom type="mesh" mesh="m"/></worldbody>'
    (tmp_path / "boxes.xml").write_text(text + "</mujoco>")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "boxes.xml"))
    assert load(tmp_path / "boxes.xml").triangle_count == model.nmeshface


@pytest.mark.parametrize("scale", ["1 1 1", "-1 1 1", "-2 -1 -.5"])
def test_mirrored_urdf_meshes_face_outward(tmp_path, scale):
    whole = boxes(tmp_path, "o")
    scene = load(robot_of(tmp_path, "boxes.obj", scale=scale))
    factors = np.array([float(value) for value in scale.split()])
    ends = np.sort(whole.bounds * factors, axis=0) + [0, 0, 5]
    np.testing.assert_allclose(scene.bounds, ends, atol=1e-6)
    found = trimesh.Trimesh(scene["a"].vertices, scene["a"].faces, process=False)
    assert found.volume == pytest.approx(abs(factors.prod()) * whole.volume, rel=1e-5)


def test_urdf_collada_is_converted_to_meters(tmp_path):
    pytest.importorskip("collada")
    pair = trimesh.Scene()
    for number in range(2):
        place = trimesh.transformations.translation_matrix((300 * number, 0, 0))
        pair.add_geometry(trimesh.creation.box((100, 200, 300)), node_name=f"box_{number}", transform=place)
    file = trimesh.exchange.dae.export_collada(list(pair.dump()))
    assert b'<unit name="meter" meter="1' in file or b"<unit" not in file
    unit, text = '<unit name="centimeter" meter="0.01"/>', file.decode()
    text = re.sub("<unit[^>]*/>", unit, text) if "<unit" in text else text.replace("<asset>", f"<asset>{unit}")
    (tmp_path / "pair.dae").write_text(text)
    scene = load(robot_of(tmp_path, "pair.dae"))
    assert scene.triangle_count == 24
    np.testing.assert_allclose(scene.bounds, [[-0.5, -1, 3.5], [3.5, 1, 6.5]], atol=1e-6)


@pytest.mark.slow
def test_urdf_accepts_large_stl_files(tmp_path):
    """MuJoCo's decoder reads at most 200,000 triangles."""
    ball = trimesh.creation.icosphere(7)
    ball.export(tmp_path / "ball.stl")
    assert load(robot_of(tmp_path, "ball.stl")).triangle_count == len(ball.faces) == 327_680


@pytest.mark.parametrize(
    "text", ["v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 4 3\n"]
)
def test_urdf_accepts_flat_meshes(tmp_path, text):
    (tmp_path / "flat.obj").write_text(text)
    np.testing.assert_allclose(load(robot_of(tmp_path, "flat.obj")).bounds, [[0, 0, 5], [1, 1, 5]], atol=1e-6)


def test_urdf_meshes_without_triangles_are_reported(tmp_path):
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2\n")
    path = robot_of(tmp_path, "points.obj", rest=f"<visual>{BOX}</visual>")
    message = r"robot.urdf: skipped .*points.obj, without triangles"
    with pytest.warns(UserWarning, match=message):
        assert Scene.load(path).triangle_count == 12
    with pytest.raises(FileFormatError, match=r"points.obj: left out"):
        load(path, strict=True)


def test_urdf_inertia_and_collision_are_ignored(tmp_path):
    """Inertia and collision elements are ignored; MuJoCo rejects the whole robot for them."""
    boxes(tmp_path, "o")
    inertia = '<inertia ixx="0" ixy="1" ixz="0" iyy="0" iyz="0" izz="0"/>'
    rest = f"""<inertial><mass value="1"/>{inertia}</inertial>
    <collision><geometry><plane normal="0 0 1"/></geometry></collision>
    <collision><geometry><mesh filename="missing.stl"/></geometry></collision>
    <visual><geometry><sphere radius="0.0"/></geometry></visual>"""
    assert load(robot_of(tmp_path, "boxes.obj", rest=rest), strict=True).triangle_count == 36


def test_urdf_visual_without_material_is_gray(tmp_path):
    """MuJoCo uses the color of the preceding visual."""
    boxes(tmp_path, "o")
    red = '<material name="red"><color rgba="1 0 0 1"/></material>'
    rest = f'<visual>{BOX}{red}</visual><visual>{BOX}</visual><visual>{BOX}<material name="red"/></visual>'
    scene = load(robot_of(tmp_path, "boxes.obj", rest=rest))
    colors = [item.appearance.materials[0].base_color for item in scene]
    assert colors == [(0.5, 0.5, 0.5, 1), (1, 0, 0, 1), (0.5, 0.5, 0.5, 1), (1, 0, 0, 1)]


TEXTURED = """mtllib flags.mtl
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 3 0 0\nv 3 1 0\nv 2 1 0
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
o flag\nusemtl flag\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4
o blue\nusemtl blue\nf 5 6 7\nf 5 7 8
"""


def flags(tmp_path):
    """Write two squares from x = 0 and 2: one textured red for x < 0.5 and green beyond, and a blue one."""
    (tmp_path / "flags.obj").write_text(TEXTURED)
    (tmp_path / "flags.mtl").write_text("newmtl flag\nmap_Kd flag.png\nnewmtl blue\nKd 0 0 1\n")
    image = np.zeros((8, 8, 3), dtype=np.uint8)
    image[:, :4, 0], image[:, 4:, 1] = 255, 255
    Image.fromarray(image).save(tmp_path / "flag.png")


def colors_at(scene, *places):
    """Return the base colors at positions (x, y), seen from above."""
    camera = wv.Camera.from_fov(3, 3, hfov=0.1)
    poses = np.stack([wv.look_at((x, y, 9), (x, y, 0), up=(0, 1, 0)) for x, y in places])
    return wv.render(scene, camera, poses, outputs=("albedo",)).albedo.numpy()[:, 1, 1, :3].tolist()


RED, GREEN, BLUE = [255, 0, 0], [0, 255, 0], [0, 0, 255]


@pytest.mark.parametrize("scale", ["1 1 1", "-1 1 1", "1 -1 1", "-1 -1 1"])
def test_urdf_meshes_keep_file_colors(tmp_path, scale):
    flags(tmp_path)
    scene = load(robot_of(tmp_path, "flags.obj", scale=scale))
    x, y, _ = map(float, scale.split())
    found = colors_at(scene, *[(place * x, 0.7 * y) for place in (0.2, 0.8, 2.5)])
    assert found == [RED, GREEN, BLUE]


def test_urdf_material_overrides_mesh_color(tmp_path):
    flags(tmp_path)
    path = robot_of(tmp_path, "flags.obj", rest='<material name="red"><color rgba="0 1 0 1"/></material>')
    text = path.read_text()
    inside = text.replace(
        "</geometry></visual>", '</geometry><material name="m"><color rgba="1 0 0 1"/></material></visual>'
    )
    path.write_text(inside)
    assert colors_at(load(path), (0.2, 0.7), (2.5, 0.7)) == [RED, RED]
    path.write_text(text.replace("</geometry></visual>", '</geometry><material name="nowhere"/></visual>'))
    assert colors_at(load(path), (0.2, 0.7), (2.5, 0.7)) == [RED, BLUE]


def test_urdf_as_mesh_file_is_rejected(tmp_path):
    with pytest.raises(FileFormatError, match=r"robot.urdf: must be a mesh file, got .urdf"):
        load(robot_of(tmp_path, "robot.urdf"))


def test_included_files_are_found_on_the_search_path(tmp_path):
    (tmp_path / "lib" / "assets").mkdir(parents=True)
    (tmp_path / "own").mkdir()
    trimesh.creation.box((2, 2, 2)).export(tmp_path / "lib" / "assets" / "crate.stl")
    include = '<mujocoinclude><asset><mesh name="crate" file="crate.stl"/></asset></mujocoinclude>'
    (tmp_path / "lib" / "parts.xml").write_text(include)
    path = tmp_path / "own" / "room.xml"
    path.write_text(
        '<mujoco><compiler meshdir="assets"/><include file="parts.xml"/>'
        '<worldbody><geom name="crate" type="mesh" mesh="crate" pos="0 0 5"/></worldbody></mujoco>'
    )
    with pytest.raises(FileFormatError, match=r"room.xml: MuJoCo cannot compile it: .*parts.xml"):
        load(path)
    for search_path in (tmp_path / "lib", [tmp_path / "lib", tmp_path / "lib" / "assets"]):
        assert bounds(load(path, search_path=search_path), "crate") == [[-1, -1, 4], [1, 1, 6]]
    with pytest.raises(FileFormatError, match=r"parts.xml: is a part that MJCF files include; load the file that"):
        load(tmp_path / "lib" / "parts.xml")


def test_flexes_are_reported_or_rejected(tmp_path):
    soft = '<flexcomp name="cloth" type="grid" dim="2" count="3 3 1" spacing=".1 .1 .1" radius=".01"/>'
    text = SHAPES.replace("<worldbody>", f"<worldbody>{soft}")
    (tmp_path / "cloth.xml").write_text(text)
    with pytest.warns(UserWarning, match=r"cloth.xml: skipped 1 flexes, which have no fixed shape"):
        Scene.load(tmp_path / "cloth.xml")
    with pytest.raises(FileFormatError, match="skipped 1 flexes"):
        load(tmp_path / "cloth.xml", strict=True)


LINK = '<robot name="r"><link name="a"><visual>%s</visual></link></robot>'
BAD = {
    "other XML": (
        "lab.xml",
        "<scene/>",
        {},
        r"lab.xml: must be MJCF, .* or URDF, with <robot>, got XML of <scene>",
    ),
    "no XML": ("lab.xml", "<mujoco>\n<worldbody>\n</mujoco>", {}, r"lab.xml:3: cannot be read as XML: mismatched tag"),
    "no text": ("lab.urdf", "\x00\x01", {}, r"lab.urdf:1: cannot be read as XML"),
    "xacro": (
        "lab.urdf",
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="a"/></robot>',
        {},
        "lab.urdf: xacro cannot expand it: .* No such file",
    ),
    "MJCF": ("lab.xml", "<mujoco><worldbody><geom/></worldbody></mujoco>", {}, "lab.xml: MuJoCo cannot compile it: "),
    "URDF": (
        "lab.urdf",
        LINK % "<geometry><torus/></geometry>",
        {},
        "skipped a torus of link 'a', .*; nothing is left",
    ),
    "nothing": ("lab.xml", "<mujoco/>", {}, "lab.xml: holds no triangles"),
    "no geometry": ("lab.urdf", '<robot name="r"><link name="a"/></robot>', {}, "lab.urdf: holds no triangles"),
    "scale": (
        "lab.urdf",
        LINK % BOX,
        {"scale": 2},
        r"defines the unit \(m\) and the vertical axis; leave out scale and file_up",
    ),
    "file_up": ("lab.urdf", LINK % BOX, {"file_up": "y"}, "leave out scale and file_up"),
    "labels": ("lab.urdf", LINK % BOX, {"labels": {"b": "human"}}, "labels for 'b' fit no object of .*, which has 'a'"),
    "movable": ("lab.urdf", LINK % BOX, {"movable": ["b"]}, "movable 'b' matches no object of .*, which has 'a'"),
    "nothing moves": ("lab.urdf", LINK % BOX, {"movable": True}, "it defines no moving objects"),
    "damaged mesh": ("lab.urdf", LINK % MESH % "bad.ply", {}, "bad.ply: cannot be read as PLY"),
}


@pytest.mark.parametrize("case", BAD)
def test_malformed_files_raise_one_line_errors(tmp_path, case):
    name, text, options, message = BAD[case]
    (tmp_path / name).write_text(text)
    (tmp_path / "bad.ply").write_text("ply\nformat ascii 1.0\nelement vertex many\n")
    with pytest.raises((FileFormatError, SceneError), match=message) as caught:
        load(tmp_path / name, **options)
    assert "\n" not in str(caught.value)
