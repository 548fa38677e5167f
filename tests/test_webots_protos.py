# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of PROTO files without templates: search, interface checks, expansion, and errors."""

import re

import numpy as np
import pytest

from warpvis.errors import FileFormatError
from warpvis.webots import Version
from warpvis.webots.protos._expansion import Protos

from support.webots_protos import Project


@pytest.fixture
def project(tmp_path):
    """Return a project folder with a world and PROTO files."""
    return Project(tmp_path)


def test_is_accepts_values_defaults_and_nodes(project):
    project.proto(
        "Crate",
        """
        field SFVec3f translation 0 0 0 # a comment ]
        field SFString name "crate"
        field SFNode appearance PBRAppearance { roughness 0.5 }
        field MFNode children [ Group { } ]
        field MFNode slot [ ]
        field SFBool locked FALSE
        hiddenField SFNode physics NULL
        vrmlField MFVec3f points [ 1 2 3, 4 5 6 ]
        """,
        """DEF CRATE Solid {
          translation IS translation name IS name locked IS locked physics IS physics
          children [ Shape { appearance IS appearance } Group { children IS children } Group { children IS slot } ]
          points IS points
        }""",
    )
    node = project.expand("DEF MINE Crate { translation 1 2 3 locked TRUE slot Pose { } children [ A { } B { } ] }")
    assert (node.type, node.name) == ("Solid", "MINE")
    np.testing.assert_array_equal(node.vector("translation", (9, 9, 9)), [1, 2, 3])
    np.testing.assert_array_equal(node.numbers("points"), [1, 2, 3, 4, 5, 6])
    assert node.text("name", "") == "crate" and node.flag("locked", False) and node.node("physics") is None
    shape, first, second = node.nodes("children")
    assert shape.node("appearance").number("roughness", 0) == 0.5
    assert [child.type for child in first.nodes("children")] == ["A", "B"]
    assert [child.type for child in second.nodes("children")] == ["Pose"]  # given without brackets
    assert node.size == 8 and first.nodes("children")[0].file.endswith("w.wbt")


def test_instances_have_separate_nodes_and_use_shares_them(project):
    project.proto("Crate", "field SFFloat mass 1", "Solid { mass IS mass }")
    world = project.world("DEF X Crate { mass 2 } USE X Crate { mass 3 } Solid { }")
    protos = Protos(world)
    first, use, second, solid = map(protos.expand, world.nodes)
    assert first is use and first is not second and solid is None
    assert (first.number("mass", 0), second.number("mass", 0)) == (2, 3)
    assert protos.expand(world.nodes[0]) is first


def test_is_in_instances_and_proto_bases(project):
    project.proto("Board", "field SFVec2f size 1 1 field SFColor color 0 0 0", "Solid { size IS size color IS color }")
    project.proto("Table", "field SFVec2f top 2 2", "Board { size IS top }")
    project.proto("Room", "field SFVec2f top 3 3", "Group { children [ Table { top IS top } Table { } ] }")
    table = project.expand("DEF T Table { top 5 6 }")
    assert (table.type, table.name) == ("Solid", "T")
    np.testing.assert_array_equal(table.numbers("size"), [5, 6])
    world = project.world("Room { top 7 8 }")
    protos = Protos(world)
    first, second = map(protos.expand, protos.expand(world.nodes[0]).nodes("children"))
    np.testing.assert_array_equal([first.numbers("size"), second.numbers("size")], [[7, 8], [2, 2]])
    assert [node.rsplit("/")[-1] for node in first.protos] == ["Room.proto", "Table.proto", "Board.proto"]


def test_body_has_the_version_and_line_of_its_file(project):
    path = project.proto(
        "Old", "field SFNode shape NULL", "Group {\nchildren [ Plane { } ] shape IS shape }", version="R2019a"
    )
    node = project.expand("Old { shape Shape { } }")
    assert node.version == Version(2019, 1) and node.node("shape").version == Version(2023, 2)
    assert (node.file, node.line) == (str(path), 6) and node.nodes("children")[0].line == 7


def test_def_names_are_local_to_their_file(project):
    project.proto("Pair", "", 'Group { children [ DEF CUBE Shape { name "inner" } USE CUBE ] }')
    project.proto("Bad", "", "Group { children [ USE CUBE ] }")
    first, second = project.expand("DEF CUBE Shape { } Pair { }").nodes("children")
    assert first is second and first.text("name", "") == "inner"
    with pytest.raises(
        FileFormatError, match=r"Bad.proto:6: expected a name after USE that a DEF above defines, got 'CUBE'"
    ):
        project.expand("DEF CUBE Shape { } Bad { }")
    with pytest.raises(FileFormatError, match=r"w.wbt:2: expected a name after USE"):
        project.world("Pair { } USE CUBE")


@pytest.mark.parametrize(
    ("url", "place"),
    [
        ("webots://projects/objects/protos/Box1.proto", "webots/projects/objects/protos"),
        ("webots://projects/objects/protos/Box1.proto", "webots/objects/protos"),
        ("https://raw.githubusercontent.com/cyberbotics/webots/R2023b/projects/a/Box1.proto", "webots/projects/a"),
        ("https://raw.githubusercontent.com/cyberbotics/webots/R2023b/projects/a/Box1.proto", "webots/elsewhere/b"),
        ("https://example.org/Box1.proto", "webots/deep/er"),
        ("../others/Box1.proto", "others"),
        ("Box1.proto", "worlds"),
    ],
)
def test_files_are_found_by_url(project, url, place):
    project.proto("Box1", "", "Solid { }", folder=place)
    project.proto("Box1", "", "WrongOne { }", folder="webots/zzz")
    (project.root / "webots").mkdir(exist_ok=True)
    assert project.expand(f'EXTERNPROTO "{url}" Box1 {{ }}', project.root / "webots").type == "Solid"


def test_absolute_urls_and_urls_in_proto_files(project):
    path = project.proto("Inner", "", "Solid { }", folder="far")
    project.proto("Outer", "", "Inner { }", head='EXTERNPROTO "../far/Inner.proto"\n', folder="near")
    assert project.expand(f'EXTERNPROTO "{path}" Inner {{ }}').type == "Solid"
    assert project.expand('EXTERNPROTO "../near/Outer.proto" Outer { }').type == "Solid"


def test_project_files_precede_the_search_path(project):
    project.proto("Mine", "", "Solid { }", folder="protos/sub")
    project.proto("Mine", "", "WrongOne { }", folder="webots")
    project.proto("Theirs", "", "Robot { }", folder="webots/a/b")
    assert project.expand("Mine { }", project.root / "webots").type == "Solid"
    assert project.expand("Theirs { }", project.root / "webots").type == "Robot"


def test_protos_without_a_file_expand_to_none(project):
    (project.root / "webots").mkdir()
    world = project.world("Unknown { } DEF U Unknown { } USE U Other { } Solid { }")
    protos = Protos(world, [project.root / "webots"])
    assert [protos.expand(node) for node in world.nodes] == [None] * 5
    with pytest.raises(FileFormatError, match=r"nowhere: expected a folder of PROTO files"):
        project.expand("Unknown { }", project.root / "nowhere")


def test_base_without_a_file_is_the_result(project):
    project.proto("Known", "", "Unknown { size 3 }")
    world = project.world("DEF K Known { }")
    protos = Protos(world)
    base = protos.expand(world.nodes[0])
    assert (base.type, base.name) == ("Unknown", "K")
    assert protos.expand(base) is None


def test_unknown_fields_are_ignored(project):
    project.proto("Crate", "", "Solid { }")
    assert project.expand("Crate { size 1 }").fields == {}
    # The body may refer to an unknown field: Webots ignores that too.
    project.proto("Ball", "", 'Solid { mass IS mass name "ball" children IS children }')
    assert project.expand("Ball { }").fields == {"name": ["ball"]}


def test_headers_may_be_indented_and_names_differ_in_case(project):
    (project.root / "protos" / "RosBot.proto").write_text(" #VRML_SIM R2022b utf8\nPROTO Rosbot [ ] { Robot { } }\n")
    robot = project.expand("RosBot { }")
    assert (robot.type, robot.line, robot.version) == ("Robot", 2, Version(2022, 2))


INTERFACE = """
    field SFString{"small", "large"} kind "small"
    field MFInt32{1, 2} sizes [ 1 ]
    field SFVec2f{0 0, 1 1} corner 0 0
    field SFNode{Box { }, Sphere { }} shape NULL
    field SFInt32 count 1
    field SFBool on TRUE
    field SFRotation rotation 0 0 1 0
    field MFColor colors [ ]
"""


def test_allowed_values(project):
    project.proto("Crate", INTERFACE, "Solid { kind IS kind sizes IS sizes corner IS corner shape IS shape }")
    node = project.expand('Crate { kind "large" sizes [ 2 1 2 ] corner 1 1 shape Box { } }')
    assert node.text("kind", "") == "large" and node.node("shape").type == "Box"
    np.testing.assert_array_equal(node.numbers("sizes"), [2, 1, 2])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ('kind "tiny"', "expected one of 'small', 'large' in 'kind' of Crate, got 'tiny'"),
        ("sizes [ 1 3 ]", "expected one of 1, 2 in 'sizes' of Crate, got 3"),
        ("corner 0 1", "expected one of 0 0, 1 1 in 'corner' of Crate, got 0 1"),
        ("count 1.5", "expected whole numbers in 'count' of Crate, got 1.5"),
        ("count 1 2", "expected a value of type SFInt32 in 'count' of Crate, got 2 values"),
        ('on "yes"', "expected TRUE or FALSE in 'on' of Crate, got 'yes'"),
        ("rotation 0 0 1", "expected a value of type SFRotation in 'rotation' of Crate, got 3 values"),
        ("colors [ 1 2 ]", "expected a value of type MFColor in 'colors' of Crate, got 2 values"),
        ("colors Box { }", "expected a value of type MFColor in 'colors' of Crate, got Box"),
        ("shape [ Box { } Box { } ]", "expected one node in 'shape' of Crate, got 2"),
        ("shape 1", "expected nodes in 'shape' of Crate, got 1"),
    ],
)
def test_invalid_values_raise(project, fields, message):
    project.proto("Crate", INTERFACE, "Solid { }")
    with pytest.raises(FileFormatError, match=re.escape(f"w.wbt:3: {message}")):
        project.expand(f"\nCrate {{ {fields} }}")


@pytest.mark.parametrize(
    ("interface", "body", "message"),
    [
        ("size 1", "Solid { }", r"4: expected a field or '\]', got 'size'"),
        ("field SFSize size 1", "Solid { }", "4: expected a type of fields, like SFVec3f, got 'SFSize'"),
        ("field SFFloat 1", "Solid { }", "4: expected the name of a field of type SFFloat, got '1'"),
        (
            "field SFFloat size ",
            "Solid { }",
            r"4: expected '\{' after field|4: expected a default|5: expected a default",
        ),
        ("field SFFloat size 1 2", "Solid { }", "4: expected a value of type SFFloat in 'size' of PROTO, got 2 values"),
        ('field SFString{"a"} size "b"', "Solid { }", "4: expected one of 'a' in 'size' of PROTO, got 'b'"),
        ("", "", "9: expected one node in the body of Crate, got 0"),
        ("", "Solid { } Solid { }", "9: expected one node in the body of Crate, got 2"),
        ("", "Solid { } 5", r"7: expected '\}' after the body of Crate, got '5'"),
        ("", "Solid { ", r"9: expected '\}' after the body of Crate, got the end of the file"),
        ("", "Solid { } }", r"8: expected one node in the body of Crate, got '\}'"),
        ("field SFFloat size 1", "Solid { size IS 5 }", "7: expected a field of the PROTO after IS, got '5'"),
    ],
)
def test_malformed_files_raise(project, interface, body, message):
    project.proto("Crate", interface, body, head="\n")
    with pytest.raises(FileFormatError, match=f"Crate.proto:({message})"):
        project.expand("Crate { }")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("PROTO Crate [ ] { Solid { } }", "1: expected the header '#VRML_SIM <version> utf8', got "),
        ("#VRML_SIM R2023b utf8\nSolid { }", "2: expected EXTERNPROTO or PROTO, got 'Solid'"),
        (
            "#VRML_SIM R2023b utf8\nPROTO Box1 [ ] { Solid { } }",
            "2: expected a PROTO of the file's name 'Crate', got 'Box1'",
        ),
        ("#VRML_SIM R2023b utf8\nPROTO Crate { Solid { } }", r"2: expected '\[' after PROTO Crate, got '\{'"),
        (
            "#VRML_SIM R2023b utf8\nPROTO Crate [ ] Solid { }",
            r"2: expected '\{' and the body of the PROTO, got 'Solid'",
        ),
        ("#VRML_SIM R2023b utf8\nPROTO Crate [ ", r"2: expected a field or '\]', got the end of the file"),
    ],
)
def test_files_without_a_proto_raise(project, text, message):
    (project.root / "protos" / "Crate.proto").write_text(text)
    with pytest.raises(FileFormatError, match=f"Crate.proto:{message}"):
        project.expand("Crate { }")


@pytest.mark.parametrize("link", ["C { x IS x }", "Group { children C { } }", "Group { child IS n }"])
def test_cycles_are_named(project, link):
    project.proto("A", "field SFNode x NULL", "B { }")
    project.proto("B", "field SFNode x NULL field SFNode n C { }", link)
    project.proto("C", "field SFNode x NULL", "A { }")
    world = project.world("A { }")
    protos = Protos(world)
    with pytest.raises(
        FileFormatError, match=r"C.proto:6: expected PROTOs that do not use themselves, got A -> B -> C -> A"
    ):
        node = protos.expand(world.nodes[0])
        while node is not None:
            (child,) = node.nodes("children") + node.nodes("child")
            node = protos.expand(child)


def test_proto_in_its_own_field_is_no_cycle(project):
    project.proto("Box1", "field MFNode children [ ]", "Group { children IS children }")
    world = project.world("Box1 { children Box1 { children Box1 { } } }")
    protos = Protos(world)
    node, depth = world.nodes[0], 0
    while node is not None:
        node, depth = next(iter(protos.expand(node).nodes("children")), None), depth + 1
    assert depth == 3


def test_nesting_of_protos_is_limited(project):
    for i in range(52):
        project.proto(f"P{i}", "", f"P{i + 1} {{ }}")
    with pytest.raises(FileFormatError, match="expected at most 50 PROTOs within PROTOs, got more"):
        project.expand("P0 { }")


def test_nodes_of_all_instances_are_limited(project, monkeypatch):
    monkeypatch.setattr("warpvis.webots.protos._expansion.MAX_PROTO_NODES", 5000)
    for i in range(10):
        project.proto(f"P{i}", "", f"Group {{ children [ {f'P{i + 1} {{ }} ' * 10} ] }}")
    world = project.world("P0 { }")
    protos, nodes = Protos(world), [world.nodes[0]]
    with pytest.raises(FileFormatError, match=r"expected PROTOs of at most 5000 nodes in total, got more"):
        while nodes:
            nodes = [child for node in nodes for child in protos.expand(node).nodes("children")]
