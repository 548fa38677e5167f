# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the grammar of Webots worlds: every rule, and one-line messages with file and line."""

import itertools
import random
import re
import time
from pathlib import Path

import numpy as np
import pytest

from warpvis.errors import FileFormatError
from warpvis.webots import Node, Version, load_webots
from warpvis.webots._grammar import parse_text

from support.webots_grammar import HEADER, SMALL

REAL = sorted((Path(__file__).parent.parent.parent / "shared" / "webots").glob("*.wbt"))
MAX_NESTED, MAX_NODES = 300, 10_000_000


def only(text):
    (node,) = parse_text(HEADER + text, "w.wbt").nodes
    return node


@pytest.mark.parametrize("path", REAL, ids=lambda path: path.stem)
def test_real_worlds_parse(path):
    world = parse_text(path.read_text(encoding="utf-8"), str(path))
    assert str(world.version) == re.search(r"R\d{4}[a-z]", path.stem)[0]
    assert [node.type for node in world.nodes[:2]] == ["WorldInfo", "Viewpoint"]
    text = path.read_text()
    assert len(world.externprotos) == text.count("EXTERNPROTO")
    assert world.size >= len(re.findall(r"^\s*[^#\n]*\{", text, re.MULTILINE))


def test_world_with_every_rule():
    world = parse_text(SMALL, "small.wbt")
    assert world.path == Path("small.wbt")
    assert world.externprotos == ["webots://projects/objects/floors/protos/Floor.proto"]
    info, solid, floor, again = world.nodes
    assert [node.type for node in world.nodes] == ["WorldInfo", "Solid", "Floor", "Floor"]
    assert (info.line, solid.line, floor.line) == (6, 7, 18)
    assert again is floor and floor.name == "CUBE"
    shape, copy = solid.nodes("children")
    assert shape is copy is solid.node("boundingObject")
    assert (shape.name, shape.line, shape.file, shape.version) == ("CUBE", 10, "small.wbt", Version(2023, 2))
    assert shape.flag("castShadows", True) is False and shape.flag("isPickable", True) is True
    np.testing.assert_array_equal(shape.node("geometry").vector("size", (2, 2, 2)), [1, 2, 3])
    np.testing.assert_array_equal(solid.vector("translation", (0, 0, 0)), [1.5, -0.25, 0.3])
    assert solid.text("name", "") == 'a "quoted" name, with \\ and # in it'
    assert solid.node("physics") is None and solid.nodes("physics") == []
    assert set(floor.fields) == {"size", "url"}  # without the hidden ones
    assert floor.texts("url") == ["one.png"]
    assert info.integer("basicTimeStep", 32) == 16 and info.number("gravity", 9.81) == 9.81
    # 1 + (1 + 3 * 2) + 1 + 1: a USE counts as a copy
    assert (solid.size, solid.height, world.size) == (7, 3, 10)


def test_missing_fields_return_the_default():
    node = only("A { }")
    assert node.number("x", 1.5) == 1.5 and node.integer("x", 3) == 3 and node.flag("x", True) is True
    assert node.text("x", "t") == "t" and node.texts("x") == [] and node.numbers("x").shape == (0,)
    assert node.node("x") is None and node.nodes("x") == []
    np.testing.assert_array_equal(node.vector("x", (0, 1)), [0.0, 1.0])


def test_line_ends_commas_and_comments_are_ignored():
    text = SMALL.replace("\n", "\r\n").replace("1 2 3", "1,2 # two\r\n ,,3")
    node = parse_text(text).nodes[1].nodes("children")[0].node("geometry")
    np.testing.assert_array_equal(node.numbers("size"), [1, 2, 3])
    assert node.line == 10
    assert parse_text(text.replace("\r\n", "\r")).nodes[2].line == 19  # the added comment adds a line


@pytest.mark.parametrize("text", ["A { p [ 1 2 ] }", "A{p[1,2]}", "A{p 1 2}", "A { p # one\n 1 # two\n 2 }"])
def test_lists_with_and_without_brackets(text):
    np.testing.assert_array_equal(only(text).numbers("p"), [1, 2])


def test_single_values_are_lists_of_one():
    node = only('A { args "x" more ["x"] child B{} children [C{}] none [] flags [TRUE FALSE] last TRUE }')
    assert node.texts("args") == node.texts("more") == ["x"]
    assert [child.type for child in node.nodes("child") + node.nodes("children")] == ["B", "C"]
    assert node.node("children").type == "C" and node.nodes("none") == [] and node.texts("none") == []
    assert node.fields["flags"] == [True, False] and node.flag("last", False)


def test_use_refers_to_the_last_preceding_def():
    first, second, third, fourth = parse_text(HEADER + "DEF X A{} B { c USE X } DEF X C{} B { c USE X }").nodes
    assert second.node("c") is first and fourth.node("c") is third


@pytest.mark.parametrize(
    "text", ["0", "-0.5", "+3", "1.", ".25", "-.5e-3", "6.02E+23", "5e-324", "0.1", "3.0000000001"]
)
def test_numbers_round_trip(text):
    assert only(f"A {{ p {text} }}").number("p", 7) == float(text)


def test_many_numbers_round_trip():
    values = np.random.default_rng(0).normal(size=1000) * 10.0 ** np.arange(-150, 150).repeat(4)[:1000]
    node = only("A { p [ " + ", ".join(map(repr, values.tolist())) + " ] }")
    np.testing.assert_array_equal(node.numbers("p"), values)


@pytest.mark.parametrize(
    ("text", "version", "z_up"),
    [
        ("V6.0", Version(6, 0), False),
        ("V7.2.5", Version(7, 2, 5), False),
        ("V8.6", Version(8, 6), False),
        ("R2018a", Version(2018, 1), False),
        ("R2021b", Version(2021, 2), False),
        ("R2022a", Version(2022, 1), True),
        ("R2025a", Version(2025, 1), True),
    ],
)
def test_versions(text, version, z_up):
    for header in (f"#VRML_SIM {text} utf8", f"#OMNISIM {text} utf8", f"\ufeff#VRML_SIM  {text}  utf8 \r"):
        world = parse_text(header + "\nA { }")
        assert world.version == world.nodes[0].version == version
    assert str(version) == text and version.z_up is z_up


def test_versions_are_ordered():
    names = ["V6.0", "V7.2.5", "V7.4.3", "V8.6", "R2018a", "R2018b", "R2019a", "R2025a"]
    versions = [Version.parse(name) for name in names]
    assert all(old < new for old, new in itertools.pairwise(versions))
    assert Version.parse("R2021b-rev1") == Version(2021, 2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("A", r"w.wbt:2: expected '\{' after A, got the end of the file"),
        ("A {", r"w.wbt:2: expected a field or '\}' of A, got the end of the file"),
        ("A {\n b", r"w.wbt:3: expected a value of 'b', got the end of the file"),
        ("A { b }", r"w.wbt:2: expected a value of 'b', got '\}'"),
        ("A { b C }", r"w.wbt:2: expected '\{' after C, got '\}'"),
        ("A { b [ 1 2", r"w.wbt:2: expected a value or '\]', got the end of the file"),
        ("A { b [ 1 [ 2 ] ] }", r"w.wbt:2: expected a value or '\]', got '\['"),
        ("A { b [ 1 } ]", r"w.wbt:2: expected a value or '\]', got '\}'"),
        ('A { b "x }\n', r"w.wbt:2: expected a string to end, got the end of the file"),
        ("A { b 1 2 3x }", r"w.wbt:2: expected a field or '\}' of A, got '3x'"),
        ("A { b 1.2.3 }", r"w.wbt:2: expected a value of 'b', got '1.2.3'"),
        ("A { b 1 }\n}", r"w.wbt:3: expected a node, got '\}'"),
        ("1 2", r"w.wbt:2: expected a node, got '1 2'"),
        ("TRUE", r"w.wbt:2: expected a node, got 'TRUE'"),
        ("A { 5 b }", r"w.wbt:2: expected a field or '\}' of A, got '5'"),
        ("A { TRUE 1 }", r"w.wbt:2: expected a field or '\}' of A, got 'TRUE'"),
        ("A { b IS c }", r"w.wbt:2: expected a value of 'b', got 'IS'"),
        ("A { b [ IS c ] }", r"w.wbt:2: expected a value or '\]', got 'IS'"),
        ("A { b [\n1\n2\n1e999 ] }", r"w.wbt:3: expected finite numbers, got '1e999'"),
        ("A { b nan 0 }", r"w.wbt:2: expected finite numbers, got 'nan'"),
        ("A { b 0 nan 0 }", r"w.wbt:2: expected finite numbers, got 'nan'"),
        ("A { b 0 -inf }", r"w.wbt:2: expected a field or '\}' of A, got '-inf'"),
        ("DEF A {", r"w.wbt:2: expected a node type after DEF A, got '\{'"),
        ("DEF 3 A { }", r"w.wbt:2: expected a name after DEF, got '3'"),
        ("USE A", r"w.wbt:2: expected a name after USE that a DEF above defines, got 'A'"),
        ("A { b USE A }\nDEF A B { }", r"w.wbt:2: expected a name after USE that a DEF above defines, got 'A'"),
        ("DEF A B {\n b [ USE A ] }", r"w.wbt:3: expected a USE outside its own DEF, got USE A"),
        ("EXTERNPROTO A { }", r"w.wbt:2: expected a url in quotes after EXTERNPROTO, got 'A'"),
        ("IMPORTABLE A { }", r"w.wbt:2: expected EXTERNPROTO after IMPORTABLE, got 'A'"),
        ("PROTO A [ ] { }", r"w.wbt:2: expected a node, got 'PROTO'"),
    ],
)
def test_syntax_errors_name_the_line(text, message):
    with pytest.raises(FileFormatError, match=rf"^{message}"):
        parse_text(HEADER + text, "w.wbt")


@pytest.mark.parametrize("line", ["", "#VRML V2.0 utf8", "#VRML_SIM", "#VRML_SIM R2023b", "WorldInfo { }", "\0\0"])
def test_missing_header_raises(line):
    with pytest.raises(FileFormatError, match=r"^w.wbt:1: expected the header '#VRML_SIM <version> utf8', got "):
        parse_text(line + "\nA { }", "w.wbt")


@pytest.mark.parametrize("version", ["2023b", "R23b", "R2023", "V", "R2023B", "Rabcd", "V8.x"])
def test_invalid_version_raises(version):
    with pytest.raises(FileFormatError, match=rf"^w.wbt:1: expected a Webots version like .* got '{version}'"):
        parse_text(f"#VRML_SIM {version} utf8\nA {{ }}", "w.wbt")


@pytest.mark.parametrize(
    ("read", "message"),
    [
        (lambda node: node.number("text", 0), "expected a number in 'text' of A, got 'x'"),
        (lambda node: node.number("two", 0), "expected a number in 'two' of A, got 2 values"),
        (lambda node: node.number("child", 0), "expected a number in 'child' of A, got B"),
        (lambda node: node.number("none", 0), "expected a number in 'none' of A, got NULL"),
        (lambda node: node.number("flag", 0), "expected a number in 'flag' of A, got TRUE"),
        (lambda node: node.number("empty", 0), "expected a number in 'empty' of A, got 0 values"),
        (lambda node: node.integer("half", 0), "expected a whole number in 'half' of A, got 0.5"),
        (lambda node: node.flag("half", True), "expected TRUE or FALSE in 'half' of A, got 0.5"),
        (lambda node: node.text("half", ""), "expected a string in 'half' of A, got 0.5"),
        (lambda node: node.texts("two"), "expected strings in 'two' of A, got 1"),
        (lambda node: node.numbers("children"), "expected numbers in 'children' of A, got B"),
        (lambda node: node.vector("two", (0, 0, 0)), "expected 3 numbers in 'two' of A, got 2"),
        (lambda node: node.node("children"), "expected one node in 'children' of A, got 2"),
        (lambda node: node.nodes("half"), "expected nodes in 'half' of A, got 0.5"),
    ],
)
def test_fields_of_wrong_type_raise(read, message):
    node = only('\nA { text "x" two 1 2 child B { } none NULL flag TRUE half 0.5 empty [] children [ B { } B { } ] }')
    with pytest.raises(FileFormatError, match=re.escape(f"w.wbt:3: {message}")):
        read(node)


def test_unreadable_files_raise(tmp_path):
    with pytest.raises(FileFormatError, match=r"none.wbt: no such file"):
        load_webots(tmp_path / "none.wbt")
    with pytest.raises(FileFormatError, match="no such file"):
        load_webots(tmp_path)
    with pytest.raises(FileFormatError, match="path must be the name of a file"):
        load_webots("a\0b.wbt")


def test_binary_content_raises_or_is_replaced(tmp_path):
    path = tmp_path / "bytes.wbt"
    path.write_bytes(bytes(range(256)) * 10)
    with pytest.raises(FileFormatError, match=r"bytes.wbt:1: expected the header"):
        load_webots(path)
    latin_1 = b'Solid { name "caf\xe9" children Shape { geometry Box { } } }'  # an old world
    path.write_bytes(HEADER.encode() + latin_1)
    assert [item.name for item in load_webots(path).scene] == ["caf\N{REPLACEMENT CHARACTER}"]


def test_nesting_is_limited():
    deep = "A { b [ " * (MAX_NESTED - 1) + "A { }" + "]}" * (MAX_NESTED - 1)
    assert only(deep).height == MAX_NESTED
    for text in (f"A {{ b {deep} }}", "A { b " * 100_000, "A { b [ " * 100_000):
        with pytest.raises(FileFormatError, match=rf"w.wbt:2: expected at most {MAX_NESTED} nodes within nodes"):
            only(text)


def test_nesting_through_use_is_limited():
    text = "DEF N0 A { }\n" + "".join(f"DEF N{i} A {{ b USE N{i - 1} }}\n" for i in range(1, 2 * MAX_NESTED))
    with pytest.raises(
        FileFormatError, match=rf"w.wbt:{MAX_NESTED + 2}: expected at most {MAX_NESTED} nodes within nodes"
    ):
        parse_text(HEADER + text, "w.wbt")


def test_copies_by_use_are_limited():
    text = "DEF N0 A { }\n" + "".join(f"DEF N{i} A {{ b [ {f'USE N{i - 1} ' * 10} ] }}\n" for i in range(1, 100))
    with pytest.raises(FileFormatError, match=rf"w.wbt:9: expected at most {MAX_NODES} nodes, where USE counts"):
        parse_text(HEADER + text, "w.wbt")
    text = "\n".join(text.splitlines()[:7]) + "USE N6\n" * 8
    with pytest.raises(FileFormatError, match=rf"^w.wbt: expected at most {MAX_NODES} nodes, got 10123455"):
        parse_text(HEADER + text, "w.wbt")


def mutated(rng, tokens):
    """Return the tokens of a world after one to three mutations."""
    tokens = list(tokens)
    for _ in range(rng.randint(1, 3)):
        here, there = rng.randrange(len(tokens)), rng.randrange(len(tokens))
        match rng.randrange(8):
            case 0:
                tokens = tokens[: here + 1]
            case 1:
                del tokens[here : here + rng.randint(1, 5)]
                tokens = tokens or [" "]
            case 2:
                tokens[here], tokens[there] = tokens[there], tokens[here]
            case 3:
                tokens.insert(here, tokens[there])
            case 4:
                tokens[here] = rng.choice(["9" * 500, "1e400", "-1e308", "0x10", "1" + "0" * 50 + "e", "--1", "1..2"])
            case 5:
                tokens[here] = rng.choice(["A { b [ ", "DEF X A { b ", "[ ", "{ "]) * rng.choice([1, 10, 1000])
            case 6:
                tokens[here] = "".join(chr(rng.randrange(256)) for _ in range(rng.randint(1, 20)))
            case 7:
                tokens[here] = rng.choice(
                    [*'[]{}"#\\,\n', "DEF", "USE", "CUBE", "NULL", "TRUE", "hidden", "IS", "PROTO"]
                )
    return "".join(tokens)


@pytest.mark.slow
def test_mutations_give_a_world_or_an_error():
    rng = random.Random(1)
    tokens = re.findall(r'"(?:[^"\\]|\\.)*"|[\w.-]+|\s+|.', SMALL)
    assert "".join(tokens) == SMALL
    worlds, messages, slowest = 0, set(), 0.0
    for _ in range(10_000):
        text = mutated(rng, tokens)
        start = time.perf_counter()
        try:
            world = parse_text(text, "m.wbt")
        except FileFormatError as error:
            assert re.match(r"m.wbt:\d+: expected .*, got ", str(error), re.DOTALL), error
            messages.add(re.sub(r"^m.wbt:\d+: |, got .*", "", str(error), flags=re.DOTALL))
        else:
            assert isinstance(world.version, Version) and all(isinstance(node, Node) for node in world.nodes)
            worlds += 1
        slowest = max(slowest, time.perf_counter() - start)
    assert 100 < worlds < 9900 and len(messages) > 30
    assert slowest < 5  # seconds: no hang
