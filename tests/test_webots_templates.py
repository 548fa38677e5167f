# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of PROTO templates in JavaScript and Lua: generated nodes, Webots' modules, and limits."""

import importlib.util
import math
import sys
import time

import numpy as np
import pytest

from warpvis.errors import FileFormatError
from warpvis.webots import Version
from warpvis.webots.protos import _templates as templates
from warpvis.webots.protos._expansion import Protos

from support.webots_protos import Project

needs_javascript = pytest.mark.skipif(importlib.util.find_spec("quickjs") is None, reason="no quickjs-ng")
needs_lua = pytest.mark.skipif(importlib.util.find_spec("lupa") is None, reason="no lupa")
JAVASCRIPT = "# template language: javascript\n"


@pytest.fixture
def project(tmp_path):
    """Return a project folder with a world and PROTO files."""
    return Project(tmp_path)


def values_of(project, program, *, interface="", fields="", head=JAVASCRIPT):
    """Return a node whose fields a, b, ... hold the values of a template's expressions."""
    project.proto("Maker", interface, f"Solid {{ {program} }}", head=head)
    return project.expand(f"Maker {{ {fields} }}")


@needs_javascript
def test_javascript_generates_nodes(project):
    project.proto(
        "Stairs",
        'field SFInt32 steps 2 field SFVec3f size 1 2 3 field SFString name "stairs" field SFVec3f translation 0 0 0',
        """
        %<
          // a comment, and more than one line
          const size = fields.size.value;
          let steps = fields.steps.value
          if (steps < 1) { steps = fields.steps.defaultValue; console.error("too few"); }
        >%
        # a comment hides %< what is in it
        Solid {
          translation IS translation
          name "%<= fields.name.value + '#' + steps >% \\"of\\" {"
          children [
            %< for (let i = 0; i < steps; ++i) { >%
              Shape { geometry Box { size %<= size.x >% %<= size.y / 4 >% %<= size.z * (i + 1); >% } }
            %< } >%
            %< if (steps > 5) >% Group { } %< else >% Pose { }
          ]
        }""",
        head=JAVASCRIPT,
    )
    node = project.expand("DEF S Stairs { steps 3 size 4 5 6 translation 7 8 9 }")
    np.testing.assert_array_equal(node.numbers("translation"), [7, 8, 9])
    assert node.name == "S" and node.text("name", "") == 'stairs#3 "of" {'
    *shapes, last = node.nodes("children")
    sizes = [shape.node("geometry").numbers("size") for shape in shapes]
    np.testing.assert_array_equal(sizes, [[4, 1.25, 6], [4, 1.25, 12], [4, 1.25, 18]])
    assert last.type == "Pose" and node.line == 15
    assert len(project.expand("Stairs { steps -1 }").nodes("children")) == 3


@needs_javascript
def test_javascript_reads_fields_of_every_type(project):
    interface = """
        field SFBool flag TRUE field SFFloat real 0.5 field SFString text "a\\"b" field SFVec2f two 1 2
        field SFColor color 0.1 0.2 0.3 field SFRotation turn 1 2 3 4 field SFNode none NULL
        field SFNode node Box { size 1 2 3 name "x" } field MFNode nodes [ A { } B { } ] field MFFloat reals [ 1 2 ]
        field MFVec3f points [ 1 2 3 4 5 6 ] field MFString texts [ "p" "q" ]
    """
    node = values_of(
        project,
        """
        a %<= fields.flag.value ? "TRUE" : "FALSE" >% b %<= fields.real.value + fields.real.defaultValue >%
        c %<= JSON.stringify(fields.text.value) >% d %<= fields.two.value.x + fields.two.value.y >%
        e %<= fields.color.value.b >% f %<= fields.turn.value.a >%
        g %<= fields.none.value === undefined ? 1 : 2 >%
        h "%<= fields.node.value.node_name >%" i %<= fields.node.value.fields.size.value.z >%
        j "%<= fields.nodes.value.map((n) => n.node_name).join('') >%" k %<= fields.reals.value.length >%
        l %<= fields.points.value[1].y >% m "%<= fields.texts.value >%" n "%<= fields.node.value.fields.name.value >%"
        """,
        interface=interface,
        fields="real 1.5 none NULL",
    )
    expected = [True, 2.0, 'a"b', 3.0, 0.3, 4.0, 1.0, "Box", 3.0, "AB", 2.0, 5.0, "p,q", "x"]
    assert [node.fields[name] for name in "abcdefghijklmn"] == [[value] for value in expected]


@needs_javascript
def test_javascript_context(project):
    text = 'a "%<= context.webots_version.major >%" b "%<= context.coordinate_system >%"'
    node = values_of(project, text + ' c "%<= context.proto >%" d "%<= context.os >%"')
    path = str(project.root / "protos" / "Maker.proto")
    assert [node.text(name, "") for name in "abcd"] == ["R2023b", "ENU", path, "linux"]


@needs_javascript
def test_javascript_modules(project):
    node = values_of(
        project,
        """
        %<
          import * as wbvector2 from 'wbvector2.js';
          import {add as plus, cross, normalize} from "wbvector3.js";
          import * as wbrotation from 'wbrotation.js';
          import * as wbrandom from 'wbrandom.js';
          import * as wbutility from 'wbutility.js';
          import * as wbgeometry from 'wbgeometry.js';
          const x = {x: 1, y: 0, z: 0}, y = {x: 0, y: 1, z: 0}, quarter = {x: 0, y: 0, z: 2, a: Math.PI / 2};
          const show = (v) => Object.values(v).join(' ');
          wbrandom.seed(0);
        >%
        a %<= show(plus(x, y)) >% b %<= show(cross(x, y)) >% c %<= show(normalize({x: 3, y: 0, z: 4})) >%
        d %<= wbvector2.distance({x: 0, y: 3}, {x: 4, y: 0}) >%
        e %<= show(wbvector2.intersection({x: 0, y: 0}, {x: 2, y: 2}, {x: 0, y: 2}, {x: 2, y: 0})) >%
        f %<= show(wbrotation.rotateVector3ByRotation(quarter, x)) >%
        g %<= show(wbrotation.combine(quarter, quarter)) >%
        h %<= show(wbrotation.fromMatrix3(wbrotation.toMatrix3(quarter))) >%
        i %<= wbrandom.real() >% j %<= wbrandom.integer(0, 9) >% k %<= Math.random() < 1 ? Date.now() : -1 >%
        l %<= wbutility.degreesToRadians(180) >% m %<= wbgeometry.circle(1, 4, {x: 1, y: 1}, 0).map(show).join(' ') >%
        n %<= show(wbrotation.fromMatrix3(wbrotation.toMatrix3({x: 0, y: 1, z: 0, a: Math.PI}))) >%
        o %<= show(wbgeometry.bSpline2([x, y, {x: 1, y: 2}].map((p) => ({x: p.x, y: p.y})), 1)[2]) >%
        p %<= wbgeometry.isPoint2InPolygon({x: 1, y: 1}, [{x: 0, y: 0}, {x: 3, y: 0}, {x: 0, y: 3}]) ? 1 : 0 >%
        q %<= wbgeometry.isPoint2ArrayClockwise([{x: 0, y: 0}, {x: 3, y: 0}, {x: 0, y: 3}]) ? 1 : 0 >%
        """,
    )
    expected = {"a": [1, 1, 0], "b": [0, 0, 1], "c": [0.6, 0, 0.8], "d": [5], "e": [1, 1], "f": [0, 1, 0]}
    expected |= {"g": [0, 0, 1, math.pi], "h": [0, 0, 1, math.pi / 2], "i": [12820163 / 16777215], "k": [0]}
    expected |= {"l": [math.pi], "m": [2, 1, 1, 2, 0, 1, 1, 0, 2, 1], "n": [0, 1, 0, math.pi], "p": [1]}
    expected |= {"q": [1]}  # as if y pointed down
    for name, values in expected.items():
        np.testing.assert_allclose(node.numbers(name), values, atol=1e-9, err_msg=name)
    assert 0 <= node.integer("j", -1) <= 9
    np.testing.assert_allclose(node.numbers("o"), [1 / 3, 1])  # (1 (1, 0) + 4 (0, 1) + 1 (1, 2)) / 6


@needs_javascript
@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("%< while (true) { } >%", "[67]: expected a template that runs, got one that runs longer than 1 s"),
        (
            "a 1\n%< let s = []; for (;;) s.push('x'.repeat(1e6) + s.length); >%",
            "8: .* got InternalError: out of memory",
        ),
        ("%< const f = () => f() + 1; f(); >%", "7: .* got RangeError: Maximum call stack size exceeded"),
        ("\n\n%< nothing(); >%", "9: .* got ReferenceError: nothing is not defined"),
        ("a %<= fields.nothing.value >%", "7: .* got TypeError: cannot read property 'value' of undefined"),
        ("%<\nlet a = 1;\nlet b = ;\n>%", "9: .* got SyntaxError: "),
        ("%< implicit = 1; >%", "7: .* got ReferenceError: implicit is not defined"),
        ("%< if (true) { >%", "[0-9]+: .* got SyntaxError: "),
        ("%< let a = 1;", "7: expected '>%' after '%<', got the end of the file"),
        ("a %<= undefined >%", "7: .*expected '{' after undefined, got '}'"),
        ("%< return 5; >%", "6: expected a template that returns a text, got '5'"),
        ("%< throw null; >%", "6: .* got null"),
        ('a "%<= "\\ud800" >%"', "6: .* got UnicodeDecodeError"),
        ("a %<= 0 / 0 >%", "7: expected finite numbers, got 'NaN'"),
        ("%< import * as fs from 'fs.js'; fs.x(); >%", "7: .* got TypeError: "),
    ],
)
def test_javascript_errors_raise(project, monkeypatch, program, message):
    # Only the endless loop takes as long as it may; memory fills in about a second on a slow machine.
    monkeypatch.setattr(templates, "SECONDS", 1 if message.endswith("1 s") else 9)
    start = time.perf_counter()
    with pytest.raises(FileFormatError, match=rf"Maker.proto:{message}"):
        values_of(project, program)
    assert time.perf_counter() - start < 10


@needs_javascript
def test_template_input_is_limited(project, monkeypatch):
    monkeypatch.setattr(templates, "_MAX_VALUES", 10_000)
    defs = "Group { children [ DEF N0 A { } ] }" + "".join(
        f"DEF N{i} Group {{ children [ {f'USE N{i - 1} ' * 10} ] }}" for i in range(1, 7)
    )
    project.proto(
        "Maker", "field SFNode node NULL", 'Solid { a "%<= fields.node.value.node_name >%" }', head=JAVASCRIPT
    )
    with pytest.raises(FileFormatError, match=r"w.wbt:2: expected at most 10000 values for a template, got more"):
        project.expand(defs + "Maker { node USE N6 }")
    with pytest.raises(FileFormatError, match=r"w.wbt:2: expected at most 60 nodes within nodes for a template"):
        project.expand("Maker { node " + "Group { children " * 100 + "A { }" + "}" * 101)


@needs_javascript
@needs_lua
@pytest.mark.parametrize(
    "head, program",
    [
        (JAVASCRIPT, "a [ %< for (let i = 1; i <= 1e5; ++i) { >% %<= i >% %< } >% ]" + " b %<= 1 >%" * 5000),
        ("", "a [ %{ for i = 1, 1e5 do }% %{= i }% %{ end }% ]" + " b %{= 1 }%" * 5000),
    ],
)
def test_large_output(project, head, program):
    np.testing.assert_array_equal(values_of(project, program, head=head).numbers("a"), 1 + np.arange(1e5))


@needs_javascript
def test_template_runs_once_for_equal_fields(project, monkeypatch):
    runs = []
    render = templates.render
    monkeypatch.setattr("warpvis.webots.protos._expansion.render", lambda *given: runs.append(given) or render(*given))
    interface = "field SFFloat size 1 field SFFloat unused 1"
    project.proto("Maker", interface, "Solid { size %<= fields.size.value >% unused IS unused }", head=JAVASCRIPT)
    world = project.world("Maker { size 1 unused 3 } Maker { unused 4 } Maker { size 2 }")
    protos = Protos(world)
    nodes = [protos.expand(node) for node in world.nodes]
    assert [(node.number("size", 0), node.number("unused", 0)) for node in nodes] == [(1, 3), (1, 4), (2, 1)]
    assert len(runs) == 2


@needs_lua
def test_lua_generates_nodes(project):
    project.proto(
        "Stairs",
        "field SFInt32 steps 2 field SFVec3f size 1 2 3 field SFNode physics NULL field MFFloat reals [ 4 5 ]",
        """
        %{
          -- a comment
          local size = fields.size.value
          if fields.steps.value < 1 then io.stderr:write("too few") print(context.proto) end
          if fields.physics.value then size.x = 7 end
        }%
        Solid {
          name "%{= fields.steps.defaultValue }%"
          children [
            %{ for i = 1, fields.steps.value do }%
              Box { size %{=size.x}% %{= size.y / 4 }% %{= fields.reals.value[i] }% }
            %{ end }%
          ]
        }""",
        version="R2019a",
    )
    node = project.expand("Stairs { size 8 2 3 }", version="R2019a")
    sizes = [box.numbers("size") for box in node.nodes("children")]
    np.testing.assert_array_equal(sizes, [[8, 0.5, 4], [8, 0.5, 5]])
    assert node.text("name", "") == "2" and node.version == Version(2019, 1)
    assert project.expand("Stairs { physics Physics { } }").nodes("children")[0].numbers("size")[0] == 7


@needs_lua
@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("\n%{ while true do end }%", "7: expected a template that runs, got one that runs longer than"),
        ("%{ local s = 'x' while true do s = s .. s end }%", "5: .* got not enough memory"),
        ("\n\n%{ nothing() }%", "8: .* got attempt to call global 'nothing'"),
        ("%{ local x = = 1 }%", "6: .* got unexpected symbol near '='"),
        ("%{ local x = 1", "6: expected '}%' after '%{', got the end of the file"),
        ("\n%{ error() }%", "5: .* got an error without a message"),
        ("a %{= io.open('/etc/passwd') }%", "6: .* got attempt to call field 'open'"),
        ("a %{= os.execute('true') }%", "6: .* got attempt to call field 'execute'"),
        ("a %{= python.eval('1') }%", "6: .* got attempt to index global 'python'"),
        ("\n%{ require('gd') }%", "7: .* got module 'gd' not found"),
    ],
)
def test_lua_errors_raise(project, monkeypatch, program, message):
    monkeypatch.setattr(templates, "_LUA_STEPS", 10_000_000)
    start = time.perf_counter()
    with pytest.raises(FileFormatError, match=rf"Maker.proto:{message}"):
        values_of(project, program, head="")
    assert time.perf_counter() - start < 10


@pytest.mark.parametrize(
    ("module", "program", "engine"),
    [("quickjs", "%<= 1 >%", "JavaScript engine quickjs-ng"), ("lupa", "%{= 1 }%", "Lua engine lupa")],
)
def test_missing_engine_error_names_the_extra(project, monkeypatch, module, program, engine):
    monkeypatch.setitem(sys.modules, module, None)
    message = (
        rf"Maker.proto:5: expected the {engine} for the PROTO's template, got none: pip install 'warpvis\[webots\]'"
    )
    with pytest.raises(FileFormatError, match=message):
        values_of(project, f"a {program}", head="")


@needs_javascript
@needs_lua
@pytest.mark.parametrize("lua", [False, True])
def test_templates_read_defaults_of_protos_in_fields(project, lua):
    interface = "field SFNode line Line { } field MFNode lines Line { width 3 } field SFNode other Unknown { width 5 }"
    project.proto("Line", 'field SFFloat width 0.5 field MFString url "a" field SFNode tip Tip { }', "Group { }")
    project.proto("Tip", "field SFVec3f size 1 2 3", "Group { }")
    first, nothing, length = ("[1]", "nil", "#{}") if lua else ("[0]", "undefined", "{}.length")
    fields, line, other = f"fields.lines.value{first}.fields", "fields.line.value", "fields.other.value.fields"
    texts = [f"{line}.fields.width.value", f"{fields}.width.value", f"{fields}.width.defaultValue"]
    texts += [f"{fields}.tip.value.fields.size.value.z", f"{other}.width.value", length.format(f"{fields}.url.value")]
    texts += [f"({other}.depth == {nothing} {'and 1 or' if lua else '? 1 :'} 0)"]
    form = "{} %{{= {} }}%" if lua else "{} %<= {} >%"
    program = " ".join(map(form.format, "abcdefg", texts))
    node = values_of(project, program, interface=interface, head="" if lua else JAVASCRIPT)
    assert [node.number(name, -1) for name in "abcdefg"] == [0.5, 3, 0.5, 3, 5, 1, 1]


@needs_javascript
def test_recursive_proto_defaults_raise(project):
    project.proto(
        "Loop", "field SFNode next Loop { }", 'Solid { a "%<= fields.next.value.node_name >%" }', head=JAVASCRIPT
    )
    with pytest.raises(FileFormatError, match=r"expected at most 60 nodes within nodes for a template, got more"):
        project.expand("Loop { }")


@needs_javascript
def test_templates_receive_six_digits(project):
    """As in Webots; IS keeps all digits."""
    interface = "field SFFloat real 0 field SFVec2f two 0 0 field SFInt32 whole 0"
    program = "a %<= fields.real.value >% b %<= fields.two.value.y >% c %<= fields.whole.value >% d IS real"
    node = values_of(project, program, interface=interface, fields="real 1.23456789 two 0 1234567.5 whole 12345678")
    assert [node.number(name, 0) for name in "abcd"] == [1.23457, 1234570, 12345678, 1.23456789]


# Equivalent Lua and JavaScript expressions, with points p, q, r, s in space, their projections p2 to s2, and rotations
# t and u.
MODULES = {
    "wbgeometry.bspline2D(flat, 3)": "wbgeometry.bSpline2(flat, 3)",
    "wbgeometry.bspline3D(points, 2)": "wbgeometry.bSpline3(points, 2)",
    "wbgeometry.circle(2, 5, 1, -1, 0.25)": "wbgeometry.circle(2, 5, {x: 1, y: -1}, 0.25)",
    "{wbvector3.cross(p, q), wbvector3.normalize(q)}": "[wbvector3.cross(p, q), wbvector3.normalize(q)]",
    "{wbvector2.intersection(p2, r2, q2, s2)}": "[wbvector2.intersection(p2, r2, q2, s2)]",
    "{wbrotation.rotatevector3byrotation(t, r)}": "[wbrotation.rotateVector3ByRotation(t, r)]",
    "{wbrotation.combine(t, u)}": "[wbrotation.combine(t, u)]",
    "{wbrotation.rotatevector3bymatrix3(wbrotation.tomatrix3(t), r)}": (
        "[wbrotation.rotateVector3ByMatrix3(wbrotation.toMatrix3(t), r)]"
    ),
    "{{x = wbrandom.integer(9), y = wbrandom.real(2, 3)}}": "[{x: wbrandom.integer(9), y: wbrandom.real(2, 3)}]",
    "{wbgeometry.findclosest2Dpointinarray(r2, {s2, p2})}": "[wbgeometry.findClosestPoint2InArray(r2, [s2, p2])]",
}
LUA_SETUP = """%{
    local points = {{x = 0, y = 0, z = 1}, {x = 2, y = 0, z = 0}, {x = 2, y = 1.5, z = 3}, {x = -1, y = 4, z = 2}}
    local flat = {{x = 0, y = 0}, {x = 2, y = 0}, {x = 2, y = 1.5}, {x = -1, y = 4}}
    local p, q, r, s = unpack(points) local p2, q2, r2, s2 = unpack(flat)
    local t, u = {x = 0, y = 0, z = 2, a = 1.5}, {x = 1, y = 1, z = 0, a = -2}
    local function show(list)
      local text = ""
      for _, v in ipairs(list) do
        for _, key in ipairs({"x", "y", "z", "a"}) do text = text .. (v[key] and v[key] .. " " or "") end
      end
      return text
    end """
SETUP = """%<
    const points = [{x: 0, y: 0, z: 1}, {x: 2, y: 0, z: 0}, {x: 2, y: 1.5, z: 3}, {x: -1, y: 4, z: 2}];
    const flat = points.map(({x, y}) => ({x, y})), [p, q, r, s] = points, [p2, q2, r2, s2] = flat;
    const t = {x: 0, y: 0, z: 2, a: 1.5}, u = {x: 1, y: 1, z: 0, a: -2};
    const show = (list) => list.flatMap((v) => ['x', 'y', 'z', 'a'].map((key) => v[key] ?? '')).join(' '); """


@needs_javascript
@needs_lua
def test_lua_and_javascript_modules_agree(project):
    names = "wbvector2 wbvector3 wbrotation wbrandom wbgeometry".split()
    program = LUA_SETUP + " ".join(f"local {name} = require('{name}')" for name in names) + " }%"
    program += "".join(f" v{i} [ %{{= show({text}) }}% ]" for i, text in enumerate(MODULES))
    found = values_of(project, program, head="")
    program = SETUP + " ".join(f"import * as {name} from '{name}.js';" for name in names) + " >%"
    program += "".join(f" v{i} [ %<= show({text}) >% ]" for i, text in enumerate(MODULES.values()))
    expected = values_of(project, program)
    for i, text in enumerate(MODULES):
        values = expected.numbers(f"v{i}")
        np.testing.assert_allclose(found.numbers(f"v{i}"), values, rtol=1e-12, atol=1e-12, err_msg=text)
        assert len(values) > 1


@needs_lua
def test_other_lua_modules(project):
    node = values_of(
        project,
        """%{
          local core, text, file = require("wbcore"), require('wbstring'), require "wbfile"
          local deep = {a = {b = 1}} local copy = core.deepcopy(deep) copy.a.b = 2
          local parts = text.split(",a,,b", ",") local m = require('math') local os = require("os")
          local is = require('wbgeometry').ispointinpolygon local round = require('wbrotation').normalize
          local square = {{x = 0, y = 0}, {x = 2, y = 0}, {x = 2, y = 2}, {x = 0, y = 2}}
        }%
        a %{= deep.a.b }% b %{= core.tablelength({1, 2, nil, 4}) }% c "%{= table.concat(parts, '-') }%"
        d "%{= file.getpathwithoutfilename('/models/x/y.proto') }%" e %{= require('wbmath').round(2.5) }%
        f %{= is(1, 1, square) and 1 or 0 }% %{= is(3, 1, square) and 1 or 0 }%
        g %{= require('wbgeometry').islistclockwise2D(square) and 1 or 0 }% h %{= round({x=0, y=0, z=0, a=7}).a }%
        i %{= m.pi }% %{= os.clock() }% %{= require('wblimits').maxdouble }%
        """,
        head="",
    )
    assert [node.number(name, -1) for name in "abeg"] == [1, 2, 3, 1] and node.numbers("f").tolist() == [1, 0]
    assert (node.text("c", ""), node.text("d", "")) == ("a--b", "/models/x")
    np.testing.assert_allclose(
        [*node.numbers("h"), *node.numbers("i")], [7 - 2 * math.pi, math.pi, 0, 2**53], rtol=1e-12
    )
