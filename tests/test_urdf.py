# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""URDF: each element of the table in docs/scene_files/urdf.md, bad files, and comparison with yourdfpy."""

import warnings

import mujoco
import numpy as np
import pytest
import trimesh
from PIL import Image

import warpvis as wv
from warpvis import Label, Scene
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import FileFormatError, SceneError

from support.model_files import BOX

SPHERE = '<geometry><sphere radius="0.1"/></geometry>'
RED = '<material name="red"><color rgba="1 0 0 1"/></material>'


@pytest.fixture(autouse=True)
def no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def write(folder, body, name="robot.urdf"):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f'<robot name="r">{body}</robot>')
    return path


def link(name, *visuals, tag="visual"):
    return f'<link name="{name}">{"".join(f"<{tag}>{visual}</{tag}>" for visual in visuals)}</link>'


def joint(name, kind, parent, child, more=""):
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{more}</joint>'


def load(folder, body, **options):
    return Scene.load(write(folder, body), **options)


def load_with_warning(folder, body, message, **options):
    path = write(folder, body)
    with pytest.warns(UserWarning, match=message) as caught:
        scene = Scene.load(path, **options)
    assert len(caught) == 1 and "\n" not in str(caught[0].message)
    return scene


def mesh(name, scale="1 1 1"):
    return f'<geometry><mesh filename="{name}" scale="{scale}"/></geometry>'


def color_of(item):
    return item.appearance.materials[0].base_color


def names(scene):
    return [item.name for item in scene]


# One test per row of the table.


def test_objects_are_named_after_their_links(tmp_path):
    named = BOX + "</visual><visual name='cover'>" + BOX
    scene = load(tmp_path, link("hand", named, BOX) + link("floor_1", BOX), labels={"cover": "object"})
    assert names(scene) == ["hand", "hand_1", "hand_2", "floor_1"]
    assert [item.label for item in scene] == [Label.ROBOT, Label.OBJECT, Label.ROBOT, Label.GROUND]


def test_collision_elements_are_shown_without_visual_ones(tmp_path):
    collisions = link("a", SPHERE, tag="collision") + link("b", BOX, tag="collision")
    assert names(load(tmp_path, collisions)) == ["a", "b"]
    assert names(load(tmp_path, collisions + link("c", BOX))) == ["c"]


def test_origins_are_composed_of_roll_pitch_yaw(tmp_path):
    scene = load(tmp_path, link("a", '<origin xyz="1 2 3" rpy="0.1 -0.2 2.5"/>' + BOX))
    expected = trimesh.transformations.euler_matrix(0.1, -0.2, 2.5, "sxyz")
    corners = trimesh.creation.box((1, 2, 4)).vertices @ expected[:3, :3].T + [1, 2, 3]
    np.testing.assert_allclose(scene.bounds, [corners.min(axis=0), corners.max(axis=0)], atol=1e-6)


@pytest.mark.parametrize(
    "shape, half",
    [
        ('<box size="1 2 3"/>', (0.5, 1, 1.5)),
        ('<cylinder radius="0.2" length="3"/>', (0.2, 0.2, 1.5)),
        ('<sphere radius="0.3"/>', (0.3, 0.3, 0.3)),
    ],
)
def test_shapes_have_their_size(tmp_path, shape, half):
    scene = load(tmp_path, link("a", f"<geometry>{shape}</geometry>"))
    np.testing.assert_allclose(scene.bounds, [np.negative(half), half], atol=1e-3)
    assert trimesh.Trimesh(scene["a"].vertices, scene["a"].faces).volume > 0


def test_movable_round_shapes_are_exact_if_single(tmp_path):
    turn = joint("j", "continuous", "a", "b")
    single = load(tmp_path, link("a", BOX) + link("b", SPHERE) + turn, movable=True)
    assert single["b"].solid is not None and len(single.movable) == 1
    several = load(tmp_path, link("a", BOX) + link("b", BOX, SPHERE) + turn, movable=True)
    assert several["b_1"].solid is None and several["b_1"].parent == several.index("b")


def test_capsules_are_read_as_in_bullet(tmp_path):
    scene = load(tmp_path, link("a", '<geometry><capsule radius="0.1" length="1"/></geometry>'))
    np.testing.assert_allclose(scene.bounds, [[-0.1, -0.1, -0.6], [0.1, 0.1, 0.6]], atol=1e-3)


@pytest.mark.parametrize(
    "visual",
    [
        '<geometry><sphere radius="0"/></geometry>',
        '<geometry><cylinder radius="1" length="0"/></geometry>',
        '<geometry><box size="0 0 0"/></geometry>',
        "<geometry/>",
        "",
        BOX + '<material name="m"><color rgba="1 1 1 0"/></material>',
    ],
)
def test_elements_without_a_surface_are_not_shown(tmp_path, visual):
    assert names(load(tmp_path, link("a", visual) + link("b", BOX))) == ["b"]


def test_other_shapes_are_skipped(tmp_path):
    body = link("a", BOX, "<geometry><torus/></geometry>")
    message = "skipped a torus of link 'a', which is no shape of URDF"
    assert names(load_with_warning(tmp_path, body, message)) == ["a"]
    with pytest.raises(FileFormatError, match=message):
        load(tmp_path, body, strict=True)


TWO_PARTS = """mtllib two.mtl
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 2 0 0\nv 3 0 0\nv 3 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1
o first\nusemtl red\nf 1/1/1 2/2/1 3/3/1
o second\nusemtl photo\nf 4/1/1 5/2/1 6/3/1
"""


def two_parts(folder):
    (folder / "two.obj").write_text(TWO_PARTS)
    (folder / "two.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl photo\nmap_Kd photo.png\n")
    Image.new("RGB", (4, 4), (0, 255, 0)).save(folder / "photo.png")


def test_meshes_keep_all_parts_with_their_materials(tmp_path):
    two_parts(tmp_path)
    (item,) = load(tmp_path, link("a", mesh("two.obj")))
    assert len(item.faces) == 2
    found = item.appearance
    assert [material.name for material in found.materials] == ["red", "photo"]
    assert found.face_materials.tolist() == [0, 1] and found.materials[1].texture is not None
    np.testing.assert_allclose(found.corner_normals(item.faces), np.broadcast_to([0, 0, 1], (2, 3, 3)))


def test_scale_may_mirror(tmp_path):
    trimesh.creation.box((1, 2, 3)).apply_translation((1, 0, 0)).export(tmp_path / "box.stl")
    scene = load(tmp_path, link("a", mesh("box.stl", "-2 1 1")))
    np.testing.assert_allclose(scene.bounds, [[-3, -1, -1.5], [-1, 1, 1.5]], atol=1e-6)
    assert trimesh.Trimesh(scene["a"].vertices, scene["a"].faces).volume == pytest.approx(12)
    assert load(tmp_path, link("a", mesh("box.stl", "0.1"))).bounds[1, 2] == pytest.approx(0.15)


def test_meshes_are_shared(tmp_path):
    trimesh.creation.icosphere(2).export(tmp_path / "ball.stl")
    body = link("a", mesh("ball.stl", "0.1 0.1 0.1"), mesh("ball.stl", "0.1 0.1 0.1") + RED)
    body += link("b", mesh("ball.stl", "0.1 0.1 0.1")) + joint("j", "continuous", "a", "b")
    scene = load(tmp_path, body, movable=["*"])
    assert len({id(item.mesh.source) for item in scene}) == 1


@pytest.mark.parametrize("url", ["package://bot/meshes/a.stl", "model://bot/meshes/a.stl", "$(find bot)/meshes/a.stl"])
@pytest.mark.parametrize("place", ["bot", "renamed", "other/bot", "other/renamed"])
def test_packages_are_found(tmp_path, url, place):
    """Packages are at or above the robot's folder, or on the search path, by folder name or package.xml."""
    (tmp_path / place / "meshes").mkdir(parents=True)
    (tmp_path / place / "package.xml").write_text("<package><name>bot</name></package>")
    trimesh.creation.box((1, 1, 1)).export(tmp_path / place / "meshes" / "a.stl")
    is_elsewhere = place.startswith("other")
    path = write(tmp_path / ("robots" if is_elsewhere else place) / "urdf", link("a", mesh(url)))
    options = {"search_path": tmp_path / "other"} if is_elsewhere else {}
    assert Scene.load(path, **options).triangle_count == 12


@pytest.mark.parametrize(
    "url", ["{}/m/a.stl", "file://{}/m/a.stl", "m/a.stl", "../m/a.stl", "file://m/a.stl", "m\\a.stl"]
)
def test_paths_are_found(tmp_path, url):
    (tmp_path / "m").mkdir()
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "m" / "a.stl")
    folder = tmp_path / "urdf" if url.startswith("..") else tmp_path
    assert Scene.load(write(folder, link("a", mesh(url.format(tmp_path))))).triangle_count == 12


def test_missing_meshes_are_skipped_with_one_warning(tmp_path):
    body = link("a", mesh("x.stl"), mesh("package://far/y.stl"), BOX)
    message = "skipped x.stl, package://far/y.stl, whose files were not found"
    assert names(load_with_warning(tmp_path, body, message)) == ["a"]
    with pytest.raises(FileFormatError, match=message):
        load(tmp_path, body, strict=True)
    many = link("a", *(mesh(f"{number}.stl") for number in range(20)), BOX)
    load_with_warning(tmp_path, many, "skipped 0.stl, 1.stl, 2.stl, 3.stl, 4.stl and 15 others, whose files")


def test_materials_override_colors_of_meshes(tmp_path):
    two_parts(tmp_path)
    half = '<material name="m"><color rgba="0 0 1 0.5"/></material>'
    scene = load(tmp_path, link("a", mesh("two.obj") + half, mesh("two.obj"), BOX))
    assert color_of(scene["a"]) == (0, 0, 1, 0.5) and scene["a"].appearance.materials[0].alpha_mode == "blend"
    assert scene["a"].appearance.normals is not None
    assert len(scene["a_1"].appearance.materials) == 2 and color_of(scene["a_2"]) == (0.5, 0.5, 0.5, 1)


def test_materials_are_found_by_name(tmp_path):
    green = '<material name="green"><color rgba="0 1 0 1"/></material>'
    repeated = '<material name="green"><color rgba="0 0 1 1"/></material>'
    by_name = [BOX + f'<material name="{name}"/>' for name in ("green", "red", "none")]
    scene = load(tmp_path, link("a", *by_name) + link("b", BOX + RED) + green + repeated)
    assert [color_of(item)[:3] for item in scene] == [(0, 1, 0), (1, 0, 0), (0.5, 0.5, 0.5), (1, 0, 0)]


def test_textures_are_shown_on_meshes_with_coordinates(tmp_path):
    two_parts(tmp_path)
    textured = '<material name="t"><texture filename="photo.png"/></material>'
    scene = load(tmp_path, link("a", mesh("two.obj") + textured, BOX + textured))
    assert [material.texture is not None for material in scene["a"].appearance.materials] == [True]
    assert color_of(scene["a_1"]) == (0.5, 0.5, 0.5, 1)
    missing = link("a", BOX + '<material name="t"><texture filename="no.png"/></material>')
    load_with_warning(tmp_path, missing, "robot.urdf: the texture no.png was not found")


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic", "planar", "floating", "fixed"])
def test_joints_of_all_types(tmp_path, kind):
    more = '<origin xyz="0 0 1"/><axis xyz="0 0 2"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'
    scene = load(tmp_path, link("a", BOX) + link("b", BOX) + joint("j", kind, "a", "b", more), movable=["*"])
    found = scene.joints["j"]
    assert (found.kind, found.parent, found.child) == (kind, "a", "b") and scene.joints.names == ("j",) * (
        kind != "fixed"
    )
    np.testing.assert_array_equal(found.axis, [0, 0, 1])
    values = {"fixed": {}, "planar": {"j": (0.1, 0.2, 0.3)}, "floating": {"j": (1, 2, 3, 0, 0, 0, 1)}}
    moved = scene.joints.poses(values.get(kind, {"j": 0.5}))[0, 1]
    turn = [0, 0, np.sin(0.25), np.cos(0.25)]
    expected = {
        "fixed": [0, 0, 1, 0, 0, 0, 1],
        "prismatic": [0, 0, 1.5, 0, 0, 0, 1],
        "planar": [0.1, 0.2, 1, 0, 0, np.sin(0.15), np.cos(0.15)],
        "floating": [1, 2, 4, 0, 0, 0, 1],
    }.get(kind, [0, 0, 1, *turn])
    np.testing.assert_allclose(poses_to_matrices(moved), poses_to_matrices(np.array(expected)), atol=1e-6)


@pytest.mark.parametrize(
    "more, message",
    [
        (joint("j", "screw", "a", "b"), "joint 'j': the type 'screw' is not supported; it is fixed"),
        (joint("j", "revolute", "a", "b", '<axis xyz="0 0 0"/>'), "joint 'j': its axis is zero; it is fixed"),
        (
            joint("j", "fixed", "a", "b") + joint("k", "fixed", "c", "b"),
            "joint 'k': its child 'b' has a joint already; this one is ignored",
        ),
    ],
)
def test_odd_joints_are_fixed_or_ignored(tmp_path, more, message):
    scene = load_with_warning(tmp_path, link("a", BOX) + link("b", BOX) + more, f"robot.urdf: {message}")
    assert scene.joints["j"].kind == "fixed" and "k" not in scene.joints


def test_axes_are_normalized(tmp_path):
    scene = load(tmp_path, link("a", BOX) + joint("i", "continuous", "a", "b", '<axis xyz="0 3 4"/>'))
    np.testing.assert_allclose(scene.joints["i"].axis, [0, 0.6, 0.8])
    scene = load(tmp_path, link("a", BOX) + joint("i", "continuous", "a", "b"))
    np.testing.assert_allclose(scene.joints["i"].axis, [1, 0, 0])


@pytest.mark.parametrize(
    "limit, expected",
    [
        ('<limit lower="-1" upper="2"/>', (-1, 2)),
        ('<limit upper="2"/>', (0, 2)),
        ('<limit effort="2"/>', None),
        ('<limit lower="0" upper="0"/>', None),
        ("", None),
    ],
)
def test_limits(tmp_path, limit, expected):
    scene = load(tmp_path, link("a", BOX) + joint("i", "revolute", "a", "b", limit))
    assert scene.joints["i"].limits == expected


def test_zero_is_the_default_also_beyond_limits(tmp_path):
    body = link("a", BOX) + link("b", BOX) + joint("i", "prismatic", "a", "b", '<limit lower="1" upper="2"/>')
    scene = load(tmp_path, body, movable=True)
    np.testing.assert_allclose(scene["b"].pose[:3], 0)
    with pytest.raises(wv.WarpvisError, match="must be from 1 to 2 m, got 0 at index 0"):
        scene.joints.poses({"i": 0})


def test_mimic_joints_follow(tmp_path):
    body = link("a", BOX) + link("b", BOX) + link("c", BOX) + joint("i", "prismatic", "a", "b")
    body += joint("k", "prismatic", "a", "c", '<mimic joint="i" multiplier="-2" offset="0.5"/>')
    scene = load(tmp_path, body, movable=True)
    np.testing.assert_allclose(scene.joints.poses({"i": [0, 1]})[:, 1, 0], [0.5, -1.5])


def test_other_elements_are_ignored(tmp_path):
    inertial = '<inertial><mass value="-1"/><inertia ixx="x"/></inertial>'
    more = '<transmission name="t"><joint name="j"><parent link="x"/></joint></transmission>'
    more += '<gazebo><link name="fake"><visual><geometry><box size="9 9 9"/></geometry></visual></link></gazebo>'
    more += '<drake:thing drake:a="1"/><joint name="j" type="revolute"><dynamics damping="x"/><parent link="a"/>'
    more += '<child link="b"/><safety_controller/></joint><sensor name="s"/>'
    scene = load(tmp_path, f'<link name="a">{inertial}<visual>{BOX}</visual></link>' + more)
    assert names(scene) == ["a"] and scene.joints.names == ("j",)


XACRO = """<?xml version="1.0"?>
<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="size" default="2"/>
  <xacro:include filename="$(find parts)/macros.xacro"/>
  <xacro:part name="left" size="${2 * $(arg size)}"/>
</robot>"""
MACROS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="part" params="name size">
  <link name="${name}"><visual><geometry><box size="${size} 1 1"/></geometry></visual></link></xacro:macro></robot>"""


@pytest.mark.parametrize("name", ["a.urdf.xacro", "a.xacro", "a.urdf"])
def test_xacro_is_expanded(tmp_path, name):
    pytest.importorskip("xacro")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "macros.xacro").write_text(MACROS)
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot" / name).write_text(XACRO)
    scene = Scene.load(tmp_path / "robot" / name)
    assert names(scene) == ["left"]
    np.testing.assert_allclose(scene.bounds, [[-2, -0.5, -0.5], [2, 0.5, 0.5]])


@pytest.mark.parametrize(
    "element, message",
    [
        (
            '<link name="$(arg size)"/>',
            "Undefined .*argument size; give it by xacro a.xacro name:=",
        ),
        (
            '<xacro:include filename="$(find far)/a"/>',
            "the package 'far' was not found above the file or on the search",
        ),
        ('<link name="${far}"/>', "name 'far' is not defined"),
        ("<xacro:part/>", "part"),
    ],
)
def test_bad_xacro_raises_one_sentence(tmp_path, element, message):
    pytest.importorskip("xacro")
    (tmp_path / "a.xacro").write_text(f'<robot xmlns:xacro="http://www.ros.org/wiki/xacro">{element}</robot>')
    with pytest.raises(FileFormatError, match=f"a.xacro: xacro cannot expand it: .*{message}") as caught:
        Scene.load(tmp_path / "a.xacro")
    assert "\n" not in str(caught.value)


def test_commas_defaults_of_variables_and_bytes_after_the_end_are_allowed(tmp_path):
    path = write(tmp_path, link("a", '<origin xyz="1, $(optenv Y 2) 3"/>' + BOX))
    path.write_bytes(b"\n" + path.read_bytes() + b"\n\0")
    np.testing.assert_allclose(Scene.load(path).bounds.mean(axis=0), [1, 2, 3])


def test_xacro_needs_its_package(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "xacro", None)
    (tmp_path / "a.xacro").write_text(XACRO)
    with pytest.raises(
        FileFormatError, match=r"needs the package xacro, which is missing: pip install 'warpvis\[urdf\]'"
    ):
        Scene.load(tmp_path / "a.xacro")


BAD = {
    "root": ("<model/>", "robot.urdf: must be URDF, which begins with <robot>, got XML of <model>"),
    "XML": ("<robot>\n<link>\n</robot>", "robot.urdf:3: cannot be read as XML: mismatched tag"),
    "empty": ("", "robot.urdf:1: cannot be read as XML"),
    "nothing": ("<robot/>", "robot.urdf: holds no triangles"),
    "xyz": (
        link("a", '<origin xyz="1 2"/>' + BOX),
        "a visual of link 'a': xyz of its origin must be three numbers, got '1 2'",
    ),
    "rpy": (link("a", '<origin rpy="a b c"/>' + BOX), "rpy of its origin must be three numbers, got 'a b c'"),
    "size": (link("a", "<geometry><box/></geometry>"), "size of its box must be three numbers, got ''"),
    "radius": (
        link("a", '<geometry><sphere radius="nan"/></geometry>'),
        "radius of its sphere must be a number, got 'nan'",
    ),
    "scale": (link("a", mesh("a.stl", "1 2")), "scale must be three numbers, got '1 2'"),
    "macro": (link("a", '<geometry><sphere radius="${r}"/></geometry>'), r"got '\$\{r\}'; convert xacro first"),
    "axis": (
        link("a", BOX) + joint("j", "revolute", "a", "b", '<axis xyz="1"/>'),
        "axis of joint 'j' must be three num",
    ),
    "mimic": (joint("j", "revolute", "a", "b", '<mimic joint="j"/>'), "robot.urdf: joint 'j' follows itself"),
    "circle": (joint("i", "fixed", "a", "b") + joint("j", "fixed", "b", "a"), "robot.urdf: joint 'i' is in a circle"),
    "mesh": (link("a", mesh("bad.ply")), "bad.ply: cannot be read as PLY"),
    "robot as mesh": (link("a", mesh("robot.urdf")), "robot.urdf: must be a mesh file, got .urdf"),
    "pointer": (link("a", mesh("lfs.stl")), "lfs.stl: is a git-lfs pointer"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files_raise_one_sentence(tmp_path, case):
    text, message = BAD[case]
    (tmp_path / "bad.ply").write_text("ply\nformat ascii 1.0\nelement vertex many\n")
    (tmp_path / "lfs.stl").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:1\n")
    path = write(tmp_path, text)
    if not text or text[1:6] in ("robot", "model"):
        path.write_text(text)
    with pytest.raises((FileFormatError, SceneError), match=message) as caught:
        Scene.load(path)
    assert "\n" not in str(caught.value)


CORRECTED = {
    "rgba": (
        link("a", BOX + '<material name="m"><color rgba="red"/></material>'),
        "material 'm': rgba must be four num",
    ),
    "limits": (joint("j", "revolute", "a", "b", '<limit lower="1" upper="0"/>'), "its limits '1' and '0' are ignored"),
    "leader": (
        joint("j", "revolute", "a", "b", '<mimic joint="k"/>'),
        "it follows 'k', which is no joint with a value",
    ),
    "negative": (
        link("b", '<geometry><sphere radius="-1"/></geometry>'),
        "a sphere of link 'b', whose size is negative",
    ),
}


@pytest.mark.parametrize("case", CORRECTED)
def test_odd_values_are_reported(tmp_path, case):
    body, message = CORRECTED[case]
    load_with_warning(tmp_path, (link("a", BOX) if 'link name="a"' not in body else "") + body, message)


def test_model_functions_of_mujoco_refuse_urdf(tmp_path):
    with pytest.raises(FileFormatError, match=r"is URDF; read it with warpvis.Scene.load"):
        wv.mujoco.read_model(write(tmp_path, link("a", BOX)))


def robot_with_meshes(folder):
    """Write a robot of all shapes and joints, and return its path."""
    two_parts(folder)
    trimesh.creation.icosphere(1).export(folder / "ball.stl")
    body = link("base", mesh("ball.stl", "0.2 0.2 0.2"), '<origin xyz="0 0 1" rpy="0.3 0.2 0.1"/>' + BOX)
    body += link("upper", '<origin xyz="0.1 0 0.3" rpy="1 0 0"/>' + mesh("two.obj", "0.3 0.3 0.3")) + link("flange")
    body += link("hand", '<geometry><box size="0.1 0.2 0.3"/></geometry>') + link(
        "finger", mesh("ball.stl", "0.1 0.1 0.1")
    )
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    body += joint("turn", "revolute", "base", "upper", f'<origin xyz="0 1 0" rpy="0 0.5 0"/><axis xyz="0 1 0"/>{limit}')
    body += joint("weld", "fixed", "upper", "flange", '<origin xyz="1 0 0" rpy="0 0 1"/>')
    body += joint("slide", "prismatic", "flange", "hand", f'<origin rpy="0.2 0 0"/><axis xyz="0 1 0"/>{limit}')
    body += joint(
        "grip", "revolute", "hand", "finger", f'<mimic joint="turn" multiplier="0.5"/><axis xyz="0 0 1"/>{limit}'
    )
    return write(folder, body)


@pytest.mark.filterwarnings("ignore")
def test_robot_matches_yourdfpy(tmp_path):
    yourdfpy = pytest.importorskip("yourdfpy")
    path = robot_with_meshes(tmp_path)
    scene, robot = Scene.load(path), yourdfpy.URDF.load(str(path))
    assert scene.triangle_count == sum(
        len(robot.scene.geometry[robot.scene.graph[node][1]].faces) for node in robot.scene.graph.nodes_geometry
    )
    np.testing.assert_allclose(scene.bounds, robot.scene.bounds, atol=1e-5)
    values = {"turn": [-0.4, 0.9], "slide": [0.3, -0.2]}
    found = scene.joints.link_poses(values)
    for world in range(2):
        robot.update_cfg({name: rows[world] for name, rows in values.items()})
        for name in ("upper", "flange", "hand", "finger"):
            np.testing.assert_allclose(found[name][world], robot.get_transform(name), atol=1e-9)


def test_robot_matches_mujoco(tmp_path):
    text = robot_with_meshes(tmp_path).read_text().replace("two.obj", "ball.stl")
    options = (
        '<mujoco><compiler fusestatic="false" discardvisual="false" balanceinertia="true" boundmass="1" '
        'boundinertia="1"/></mujoco></robot>'
    )
    model = mujoco.MjModel.from_xml_string(
        text.replace("</robot>", options), {"ball.stl": (tmp_path / "ball.stl").read_bytes()}
    )
    data, scene = mujoco.MjData(model), Scene.load(tmp_path / "robot.urdf")
    values = {"turn": 0.7, "slide": -0.3, "grip": 0.35}
    for name, value in values.items():
        data.joint(name).qpos = value
    mujoco.mj_kinematics(model, data)
    found = scene.joints.link_poses({name: value for name, value in values.items() if name != "grip"})
    for name in ("upper", "flange", "hand", "finger"):
        np.testing.assert_allclose(found[name][0, :3, 3], data.body(name).xpos, atol=1e-9)
        np.testing.assert_allclose(found[name][0, :3, :3].ravel(), data.body(name).xmat, atol=1e-9)
