# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of worlds with invalid nodes: Webots' replacement values, skipped nodes, and warnings."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh

from warpvis import Scene
from warpvis.errors import FileFormatError
from warpvis.webots import load_webots

from support.recorded_warnings import recorded_warnings

SHARED = Path(__file__).parent.parent.parent / "shared" / "webots"
GOOD = 'Solid { name "good" translation 9 0 0 children Shape { geometry Box { size 1 1 1 } } }\n'


def load(folder, text, version="R2023b", **options):
    """Load a world of a valid box and the text; return it and the warnings."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "world.wbt"
    path.write_text(f"#VRML_SIM {version} utf8\n{GOOD}{text}")
    with recorded_warnings() as caught:
        world = load_webots(path, **options)
    return world, [str(item.message) for item in caught]


def shape(geometry):
    return f'Solid {{ name "it" children Shape {{ geometry {geometry} }} }}'


# Geometry, the equivalent valid geometry, and the warning (src/webots/nodes/Wb*.cpp, sanitizeFields).
RESETS = {
    "box": ("Box { size 3 -1 3 }", "Box { size 1 1 1 }", "size 3 -1 3 of Box is replaced by 1 1 1"),
    "flat box": ("Box { size 3 3 0 }", "Box { size 1 1 1 }", "size 3 3 0 of Box is replaced by 1 1 1"),
    "plane": ("Plane { size 5 -5 }", "Plane { size 1 1 }", "size 5 -5 of Plane is replaced by 1 1"),
    "cylinder": (
        "Cylinder { height 0 radius 2 subdivision 2 }",
        "Cylinder { height 1 radius 2 subdivision 3 }",
        "height 0 of Cylinder is replaced by 1; .*subdivision 2 of Cylinder is replaced by 3",
    ),
    "cylinder of many": ("Cylinder { subdivision 1001 }", "Cylinder { subdivision 3 }", "subdivision 1001 of Cylinder"),
    "cone": (
        "Cone { bottomRadius -1 height -2 }",
        "Cone { bottomRadius 1 height 1 }",
        "bottomRadius -1 of Cone is replaced by 1; .*height -2 of Cone is replaced by 1",
    ),
    "capsule": (
        "Capsule { radius 0 height 0 subdivision 3 }",
        "Capsule { radius 1 height 1 subdivision 4 }",
        "radius 0 of Capsule is replaced by 1; .*height 0 of Capsule is replaced by 1; .*"
        "subdivision 3 of Capsule is replaced by 4",
    ),
    "sphere": (
        "Sphere { radius -2 subdivision 7 }",
        "Sphere { radius 1 subdivision 1 }",
        "subdivision 7 of Sphere is replaced by 1",
    ),
    "round sphere": (
        "Sphere { ico FALSE subdivision 64 }",
        "Sphere { ico FALSE subdivision 24 }",
        "subdivision 64 of Sphere is replaced by 24",
    ),
    "grid": (
        "ElevationGrid { xDimension 2 yDimension 2 xSpacing 0 ySpacing -1 }",
        "ElevationGrid { xDimension 2 yDimension 2 }",
        "xSpacing 0 of ElevationGrid is replaced by 1; .*ySpacing -1 of ElevationGrid is replaced by 1",
    ),
    "face of no point": (
        "IndexedFaceSet { coord Coordinate { point [ 0 0 0, 1 0 0, 1 1 0, 0 1 0 ] } "
        "coordIndex [ 0 1 2 -1 0 2 4 -1 0 -3 1 -1 0 2 3 ] }",
        "IndexedFaceSet { coord Coordinate { point [ 0 0 0, 1 0 0, 1 1 0, 0 1 0 ] } coordIndex [ 0 1 2 -1 0 2 3 ] }",
        "2 faces of IndexedFaceSet have invalid indices and are skipped",
    ),
}


@pytest.mark.parametrize("case", RESETS)
def test_invalid_values_are_reset_as_in_webots(case, tmp_path):
    wrong, right, message = RESETS[case]
    world, said = load(tmp_path / "a", shape(wrong))
    wanted, nothing = load(tmp_path / "b", shape(right))
    assert not nothing and len(said) == 1
    assert f"{world.path}:3: " in said[0] and re.search(message, said[0])
    np.testing.assert_array_equal(world.scene["it"].vertices, wanted.scene["it"].vertices)
    np.testing.assert_array_equal(world.scene["it"].faces, wanted.scene["it"].faces)
    with pytest.raises(
        FileFormatError, match=r"world.wbt: expected values that are valid in Webots, got others: .*wbt:3: "
    ):
        load(tmp_path / "a", shape(wrong), strict=True)


def test_grid_of_negative_dimension_is_omitted(tmp_path):
    world, said = load(tmp_path, shape("ElevationGrid { xDimension -3 yDimension 2 }"))
    assert "xDimension -3 of ElevationGrid is replaced by 0" in said[0] and [item.name for item in world.scene] == [
        "good"
    ]


def test_negative_boxes_of_old_worlds_face_inward(tmp_path):
    world, said = load(tmp_path, shape("Box { size -3 -3 -3 }"), "R2018b")
    item = world.scene["it"]
    assert not said and trimesh.Trimesh(item.vertices, item.faces).volume == pytest.approx(-27)


def test_invalid_proto_body_is_named_once(tmp_path):
    (tmp_path / "Rod.proto").write_text(
        "#VRML_SIM R2023b utf8\nPROTO Rod [ field SFFloat h 1 ] {\n"
        "Solid { children Shape { geometry Cylinder { height IS h } } } }\n"
    )
    world, said = load(tmp_path, "Rod { h -1 } " * 30)
    assert (
        len(world.scene) == 31
        and len(world.notes) == 1
        and said[0].count("height -1 of Cylinder is replaced by 1") == 1
    )


def test_long_lists_of_corrections_are_truncated(tmp_path):
    world, said = load(tmp_path, "\n".join(shape("Sphere { radius 0 }") for _ in range(50)))
    assert (
        len(world.notes) == 50
        and said[0].count("radius 0 of Sphere is replaced by 1") == 20
        and "and 30 more" in said[0]
    )


# Unreadable nodes, and the warning for each.
REFUSED = {
    "words for numbers": (shape('Box { size "a" }'), "expected numbers in 'size' of Box"),
    "two numbers of three": (shape("Box { size 1 1 }"), "expected 3 numbers in 'size' of Box, got 2"),
    "half a side": (shape("Cylinder { subdivision 7.5 }"), "expected a whole number in 'subdivision'"),
    "a spine of one point": (shape("Extrusion { spine [ 0 0 0 ] }"), "at least two points in crossSection and spine"),
    "a rotation of three": ('Solid { name "it" rotation 0 0 1 }', "expected 4 numbers in 'rotation' of Solid, got 3"),
    "children of numbers": ('Solid { name "it" children [ 1 2 ] }', "expected nodes in 'children' of Solid"),
    "beyond all": (
        'Solid { name "it" translation 1e30 0 0 children Shape { geometry Sphere { } } }',
        "expected Shape within 1e",
    ),
    "a table that is none": ('Table { name "it" size 1 1 }', "expected 3 numbers in 'size' of Table"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_unreadable_nodes_are_skipped(case, tmp_path):
    text, message = REFUSED[case]
    world, said = load(tmp_path, text)
    assert [item.name for item in world.scene] == ["good"]
    assert len(said) == 1 and f"skipped an unreadable node: {world.path}:3: " in said[0] and message in said[0]
    assert len(world.refused) == 1 and message in world.refused[0] and not world.skipped
    with pytest.raises(FileFormatError, match=r"world.wbt:3: expected"):
        load(tmp_path, text, strict=True)


@pytest.mark.parametrize(("text", "usual"), [("Wall {{ {} }}", [0.2, 1, 2.4]), ("SolidBox {{ {} }}", [2, 2, 2])])
def test_walls_and_boxes_without_extent_have_the_default_size(text, usual, tmp_path):
    world, said = load(tmp_path, text.format('name "it" size 0.7 0 2.4'))
    np.testing.assert_allclose(np.ptp(world.scene["it"].bounds, axis=0), usual, atol=1e-6)
    assert (
        len(said) == 1
        and "world.wbt:3: instead of size 0.7 0 2.4 of" in said[0]
        and "Webots uses the default size" in said[0]
    )


def test_rest_of_a_solid_is_kept(tmp_path):
    world, said = load(
        tmp_path,
        'Robot { name "car" children [ Camera { name "eye" width "wide" } Shape { geometry Box { size 1 } } '
        'RangeFinder { name "ranger" width 0 projection "flat" } Shape { geometry Box { size 1 1 1 } } ] }',
    )
    assert len(world.scene["car"].faces) == 12 and list(world.devices) == ["ranger"]
    assert (world.devices["ranger"].width, world.devices["ranger"].projection) == (1, "planar")
    assert len(world.refused) == 2 and "width 0 of RangeFinder is replaced by 1" in said[1]
    assert "projection flat of RangeFinder is replaced by planar" in said[1]


def test_invalid_vertical_axis_is_reset(tmp_path):
    world, said = load(tmp_path, 'WorldInfo { coordinateSystem "UNE" }')
    assert world.scene.up == "z" and "coordinateSystem UNE of WorldInfo is replaced by ENU" in said[0]
    world, said = load(tmp_path, 'WorldInfo { gravity "down" }')
    assert world.scene.up == "z" and "expected numbers in 'gravity' of WorldInfo" in said[0]


def test_scene_load_warns_alike(tmp_path):
    load(tmp_path, shape("Box { size 0 1 1 }"))
    with pytest.warns(UserWarning, match=r"world.wbt:3: size 0 1 1 of Box is replaced by 1 1 1"):
        assert len(Scene.load(tmp_path / "world.wbt")) == 2
    with pytest.raises(FileFormatError, match="size 0 1 1 of Box"):
        Scene.load(tmp_path / "world.wbt", strict=True)


# ------------------------------------------------------------------------------------------------------------- meshes


def test_unreadable_meshes_are_skipped(tmp_path):
    (tmp_path / "a.stl").write_bytes(b"nothing of the kind")
    (tmp_path / "a.obj").write_text("v 0 0 0\n")
    world, said = load(tmp_path, shape('Mesh { url "a.stl" }') + shape('Mesh { url "a.obj" }'))
    assert [item.name for item in world.scene] == ["good"] and len(world.refused) == 2
    assert "a.stl" in said[0] and "a.obj: holds no triangles" in said[0]


TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
PLACES = {
    "beside": ("worlds/a.obj", "a.obj"),
    "beside, of Windows": ("worlds/meshes/a.obj", "meshes\\\\a.obj"),
    "up, of Windows": ("meshes/a.obj", "..\\meshes\\a.obj"),
    "protos": ("protos/meshes/a.obj", "meshes/a.obj"),
}


@pytest.mark.parametrize("case", PLACES)
def test_project_meshes_are_found(case, tmp_path):
    place, url = PLACES[case]
    (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / place).write_text(TETRAHEDRON)
    world, said = load(tmp_path / "worlds", shape(f'Mesh {{ url "{url}" }}'))
    assert not said and len(world.scene["it"].faces) == 4


THING = """#VRML_SIM R2021b utf8
PROTO Thing [ field MFString url "parts/a.obj" ] {
  Solid { name "it" children Shape { geometry Mesh { url IS url } } }
}
"""
FROM_PROTOS = {
    "beside the PROTO": ("protos/parts/a.obj", "Thing { }"),
    "beside the world": ("worlds/parts/a.obj", "Thing { }"),
    "a field's value beside the world": ("worlds/b.obj", 'Thing { url "b.obj" }'),
}


@pytest.mark.parametrize("case", FROM_PROTOS)
def test_proto_meshes_are_found(case, tmp_path):
    place, text = FROM_PROTOS[case]
    for folder in ("protos", "worlds"):
        (tmp_path / folder).mkdir()
    (tmp_path / "protos" / "Thing.proto").write_text(THING)
    (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / place).write_text(TETRAHEDRON)
    world, said = load(tmp_path / "worlds", text)
    assert not said and len(world.scene["it"].faces) == 4


SKINNED = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
  <library_geometries><geometry id="body"><mesh>
    <source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array><technique_common>
      <accessor source="#pa" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
      <param name="Z" type="float"/></accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
  </mesh></geometry></library_geometries>
  <library_controllers>
    <controller id="faces"><morph source="#body" method="NORMALIZED"></morph></controller>
    <controller id="bones"><skin source="#faces">
      <bind_shape_matrix>2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1</bind_shape_matrix>
      <source id="j"><Name_array id="ja" count="1">hip</Name_array></source>
    </skin></controller>
  </library_controllers>
  <library_visual_scenes><visual_scene id="s">
    <node id="hip" type="JOINT"/>
    <node id="man"><translate>0 0 3</translate><instance_controller url="#bones"><skeleton>#hip</skeleton>
    </instance_controller></node>
  </visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
"""


def test_skinned_collada_is_read_in_bind_pose(tmp_path):
    """The mesh as listed in the file, at its node, as Webots draws it."""
    pytest.importorskip("collada")
    tmp_path.joinpath("man.dae").write_text(SKINNED)
    world, said = load(
        tmp_path, shape('Mesh { url "man.dae" }') + 'Solid { name "cad" children CadShape { url "man.dae" } }'
    )
    assert not said
    wanted = {(0, 0, 3), (1, 0, 3), (0, 1, 3), (0, 0, 4)}
    for name in ("it", "cad"):
        assert {tuple(point) for point in world.scene[name].vertices.round(6).tolist()} == wanted
        item = world.scene[name]
        assert trimesh.Trimesh(item.vertices.astype(float), item.faces).volume == pytest.approx(1 / 6)


def test_lua_templates_have_maxn(tmp_path):
    """A function of Lua 5.1 used by RoboCup's soccer fields."""
    pytest.importorskip("lupa")
    (tmp_path / "Posts.proto").write_text(
        "#VRML_SIM R2019a utf8\nPROTO Posts [ ] {\n%{ local n = table.maxn({[1] = 1, [5] = 1, x = 9}) }%\n"
        'Solid { name "it" children Shape { geometry Box { size %{=n}% 1 1 } } } }\n'
    )
    world, said = load(tmp_path, "Posts { }")
    assert not said and np.ptp(world.scene["it"].bounds, axis=0)[0] == pytest.approx(5)


@pytest.mark.skipif(not SHARED.is_dir(), reason="the public worlds are not here")
def test_public_worlds_load_with_warnings_only():
    worlds = sorted(SHARED.glob("*.wbt"))
    assert len(worlds) >= 10
    for path in worlds:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            assert len(load_webots(path).scene)
