# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the table of nodes in docs/webots.md: what is read of each node, and which nodes cause a warning."""

import re
import warnings
from pathlib import Path

import pytest

from warpvis import Label
from warpvis.webots import load_webots
from warpvis.webots._nodes import BUILTIN_NODES
from warpvis.webots._parts import DEVICES, ROBOTS

PAGE = Path(__file__).parents[1] / "docs" / "webots.md"
BOX = "children [ Shape { geometry Box { size 1 1 1 } } ]"


@pytest.fixture(autouse=True)
def no_webots(monkeypatch, tmp_path):
    """Hide an installation of Webots and its cache."""
    monkeypatch.delenv("WEBOTS_HOME", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def load(tmp_path, text, head="WorldInfo { }", version="R2023b"):
    """Load a world with a floor; return it, and whether there was a warning."""
    (tmp_path / "a.wbt").write_text(f"#VRML_SIM {version} utf8\n{head}\nFloor {{ size 3 3 }}\n{text}\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        world = load_webots(tmp_path / "a.wbt")
    return world, bool(caught)


def names(world):
    return [item.name for item in world.scene][1:]  # without the floor


def test_the_table_lists_every_node_once():
    section = PAGE.read_text(encoding="utf-8").split("\n## Nodes\n")[1].split("\n## ")[0]
    rows = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    listed = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    assert sorted(listed) == sorted(BUILTIN_NODES)


def test_world_info(tmp_path):
    for system, up in (("ENU", "z"), ("NUE", "y")):
        world, warned = load(tmp_path, "", f'WorldInfo {{ coordinateSystem "{system}" FPS 30 physics "x" }}')
        assert world.scene.up == up and not warned


@pytest.mark.parametrize(
    "text",
    [
        *("Viewpoint { position 1 2 3 }", "Fog { visibilityRange 3 }", f"Billboard {{ {BOX} }}", "Muscle { }"),
        *("SolidReference { }", "Solid { children [ Shape { geometry IndexedLineSet { } } ] }"),
        "Solid { children [ Shape { geometry PointSet { } } ] }",
    ],
)
def test_nodes_that_are_not_read(tmp_path, text):
    world, warned = load(tmp_path, text)
    assert not names(world) and not warned and not world.scene.lights


@pytest.mark.parametrize(
    "text",
    [
        *("TransmissionJoint { }", 'Skin { modelUrl "a.fbx" }', "VisualShape { }", 'ColladaShapes { url "a.dae" }'),
        'ColladaShape { url "a.dae" }',
        *("JointLink { }", "Brake { }", "LinearMotor { }", "PositionSensor { }", "RotationalMotor { }", "HMD { }"),
    ],
)
def test_nodes_that_are_skipped_with_a_warning(tmp_path, text):
    world, warned = load(tmp_path, text)
    assert not names(world) and warned and list(world.skipped) == [text.split()[0]]


def test_background(tmp_path):
    world, warned = load(tmp_path, "Background { skyColor [ 0 0.5 1 ] luminosity 2 cubemap Cubemap { } }")
    assert world.scene.background.color == (0, 0.5, 1) and world.scene.background.luminosity == 2 and not warned


@pytest.mark.parametrize("kind", ["DirectionalLight", "PointLight", "SpotLight"])
def test_lights(tmp_path, kind):
    world, warned = load(tmp_path, f"{kind} {{ intensity 3 color 1 0 0 castShadows TRUE }}")
    (light,) = world.scene.lights
    assert light.kind == kind.removesuffix("Light").lower() and not warned
    assert (light.intensity, light.color, light.cast_shadow) == (3, (1, 0, 0), True)


@pytest.mark.parametrize("kind", ["Group", "Transform", "Pose", "Fluid"])
def test_transforms(tmp_path, kind):
    place = "" if kind == "Group" else "translation 0 0 5"
    world, warned = load(tmp_path, f"{kind} {{ {place} {BOX} }}")
    assert names(world) == ["shape"] and not warned
    assert world.scene["shape"].bounds.mean(axis=0)[2] == pytest.approx(0 if kind == "Group" else 5)


@pytest.mark.parametrize("kind", ["Solid", "Charger", "Servo", "Track"])
def test_solids(tmp_path, kind):
    part = f'Solid {{ name "part" translation 0 0 2 {BOX} }}'
    world, warned = load(tmp_path, f'{kind} {{ name "it" children [ Shape {{ geometry Box {{ }} }} {part} ] }}')
    assert names(world) == ["it", "part"] and not warned


@pytest.mark.parametrize("kind", sorted(ROBOTS))
def test_robots(tmp_path, kind):
    world, warned = load(tmp_path, f'{kind} {{ name "it" translation 0 0 1 {BOX} }}')
    assert world.robots == {"it": ("it",)} and world.scene["it"].label == Label.ROBOT and not warned


JOINTS = {
    "HingeJoint": "jointParameters HingeJointParameters { position 1 axis 0 0 1 }",
    "SliderJoint": "jointParameters JointParameters { position 1 }",
    "Hinge2Joint": "jointParameters Hinge2JointParameters { } jointParameters2 JointParameters { position 1 }",
    "BallJoint": "jointParameters BallJointParameters { position 1 }",
    "Slot": 'type "x"',
    "HingeJointWithBacklash": "jointParameters HingeJointParameters { position 1 }",
    "Hinge2JointWithBacklash": "jointParameters HingeJointParameters { position 1 }",
}


@pytest.mark.parametrize("kind", sorted(JOINTS))
def test_end_points_of_joints_are_where_they_are_saved(tmp_path, kind):
    device = "" if kind in ("Slot",) else "device [ RotationalMotor { } PositionSensor { } Brake { } ]"
    end = f'endPoint Solid {{ name "end" translation 1 2 3 {BOX} physics Physics {{ damping Damping {{ }} }} }}'
    world, warned = load(tmp_path, f'Solid {{ name "base" children [ {kind} {{ {JOINTS[kind]} {device} {end} }} ] }}')
    assert names(world) == ["end"] and not warned
    assert world.scene["end"].bounds.mean(axis=0) == pytest.approx((1, 2, 3))


def test_tracks_and_propellers(tmp_path):
    wheel = f"TrackWheel {{ {BOX} }}"
    world, warned = load(tmp_path, f"Track {{ children [ {wheel} ] animatedGeometry Shape {{ geometry Box {{ }} }} }}")
    assert names(world) == ["track"] and warned and world.skipped == {"Track.animatedGeometry": 1}
    helix = f'slowHelix Solid {{ name "slow" {BOX} }} fastHelix Solid {{ name "fast" {BOX} }}'
    world, warned = load(tmp_path, f"Propeller {{ {helix} }}")
    assert names(world) == ["slow"] and not warned


SHAPES = {
    "Box": "size 1 1 1",
    "Sphere": "",
    "Cylinder": "",
    "Cone": "",
    "Capsule": "",
    "Plane": "size 1 1",
    "ElevationGrid": "xDimension 2 yDimension 2 height [ 0 1 2 3 ] color [ Color { color [ 1 0 0 ] } ]",
    "Extrusion": "",
    "IndexedFaceSet": "coord Coordinate { point [ 0 0 0 1 0 0 0 1 0 ] } normal Normal { vector [ 0 0 1 ] } "
    "texCoord TextureCoordinate { point [ 0 0 1 0 0 1 ] } coordIndex [ 0 1 2 ]",
    "Mesh": 'url "a.obj"',
}


@pytest.mark.parametrize("kind", sorted(SHAPES))
def test_geometry(tmp_path, kind):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    look = 'PBRAppearance { baseColorMap ImageTexture { url "a.png" } textureTransform TextureTransform { scale 2 2 } }'
    shape = f"Shape {{ appearance {look} geometry {kind} {{ {SHAPES[kind]} }} }}"
    world, warned = load(tmp_path, f"Solid {{ translation 0 0 9 children [ {shape} ] }}")
    assert names(world) == ["solid"] and len(world.scene["solid"].faces) and not warned


@pytest.mark.parametrize("kind", ["Mesh", "CadShape"])
def test_meshes_of_files_have_no_colors(tmp_path, kind):
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n")
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\n")
    node = f'{kind} {{ url "a.obj" }}'
    node = node if kind == "CadShape" else f"Shape {{ geometry {node} }}"
    world, warned = load(tmp_path, f"Solid {{ children [ {node} ] }}")
    assert names(world) == ["solid"] and not warned
    shown = world.scene["solid"].appearance
    assert shown is None or {material.base_color[:3] for material in shown.materials} == {(1, 1, 1)}


def test_colors_and_normals_of_faces_are_not_read(tmp_path):
    coordinates = "coord Coordinate { point [ 0 0 0 1 0 0 0 1 0 ] } coordIndex [ 0 1 2 ]"
    more = (
        "color Color { color [ 1 0 0 ] } colorPerVertex FALSE normal Normal { vector [ 1 0 0 ] } normalIndex [ 0 0 0 ]"
    )
    shape = "Solid { children [ Shape { appearance PBRAppearance { } geometry IndexedFaceSet { %s } } ] }"
    plain, changed = (load(tmp_path, shape % text) for text in (coordinates, f"{coordinates} {more}"))
    assert not plain[1] and not changed[1]
    first, second = (world.scene["solid"].appearance for world, _ in (plain, changed))
    assert first.normals is None and second.normals is None
    assert (
        first.materials[0].base_color == second.materials[0].base_color
        and second.vertex_colors is None
        and second.face_colors is None
    )


def test_flags_of_shapes_are_not_read(tmp_path):
    shape = (
        "Solid { translation 0 0 1 children [ Shape { castShadows %s isPickable %s geometry Box { size 1 1 1 } } ] }"
    )
    both = [load(tmp_path, shape % (flag, flag))[0].scene for flag in ("TRUE", "FALSE")]
    assert [item.name for item in both[0]] == [item.name for item in both[1]]
    assert (both[0]["solid"].vertices == both[1]["solid"].vertices).all()


def test_appearances(tmp_path):
    looks = {
        "pbr": "PBRAppearance { baseColor 1 0 0 roughness 0.5 metalness 0 }",
        "classic": "Appearance { material Material { diffuseColor 0 1 0 } }",
    }
    shape = 'Solid { name "%s" children [ Shape { castShadows FALSE appearance %s geometry Box { } } ] }'
    world, warned = load(tmp_path, " ".join(shape % item for item in looks.items()))
    colors = [item.appearance.materials[0].base_color[:3] for item in list(world.scene)[1:]]
    assert colors == [(1, 0, 0), (0, 1, 0)] and not warned


@pytest.mark.parametrize("kind", sorted(DEVICES))
def test_devices_have_shapes(tmp_path, kind):
    world, _ = load(tmp_path, f'Robot {{ translation 0 0 5 children [ {kind} {{ name "eye" {BOX} }} ] }}')
    assert names(world) == ["eye"]
    assert list(world.devices) == (["eye"] if kind in ("Camera", "RangeFinder") else [])
    assert list(world.lidars) == (["eye"] if kind == "Lidar" else [])


def test_parts_of_cameras(tmp_path):
    parts = "lens Lens { } recognition Recognition { } focus Focus { } zoom Zoom { } lensFlare LensFlare { }"
    world, _ = load(tmp_path, f'Robot {{ translation 0 0 5 children [ Camera {{ name "eye" {parts} }} ] }} ')
    assert set(world.devices["eye"].ignored) >= {"focus", "lensFlare"}


def test_fields_without_effect(tmp_path):
    fields = 'boundingObject Box { } contactMaterial "x" immersionProperties [ ImmersionProperties { } ] hidden a 3'
    world, warned = load(
        tmp_path,
        f'DEF IT Solid {{ name "it" {fields} {BOX} }}',
        "WorldInfo { contactProperties [ ContactProperties { } ] }",
    )
    assert names(world) == ["it"] and not warned
