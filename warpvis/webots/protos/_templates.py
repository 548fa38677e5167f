# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Templates of PROTO files: JavaScript between ``%<`` and ``>%``, in old files Lua between ``%{`` and ``}%``.

A template is converted to a program that concatenates the text between its statements. Sources:
https://cyberbotics.com/doc/reference/javascript-procedural-proto and lua-procedural-proto. The engines are quickjs-ng
and lupa, from the extra ``[webots]``. A program has no access to files or the network, and runs in a process with
limited time and memory (`warpvis.webots.protos._template_engine`).
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple, NoReturn, TypeAlias

from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.webots._nodes import Node, Value, shown
from warpvis.webots.protos._template_engine import TemplateEngine, is_installed

Language: TypeAlias = Literal["javascript", "lua"]
Describe: TypeAlias = Callable[[Node], "dict[str, tuple[str, Value, Value]] | None"]

SECONDS = 5
"""Maximum run time of a JavaScript template [s]."""
_LUA_STEPS = 200_000_000  # takes about as long
_GRACE = 1  # extra time of a template's process over its engine [s]
_HEAP = 256 << 20  # of an engine [B]
_MEMORY = 1 << 30  # of the process, beyond its initial memory [B]
_STACK = 512 << 10  # [B]; threads have stacks of a few MiB
_MAX_VALUES = 1_000_000  # passed to a template
_MAX_NESTED = 60  # depth of nodes in them
_PROTO_COST = 100  # an instance of a PROTO counts as this many values, since its defaults are parsed

_MARKS = {"javascript": ("%<", ">%"), "lua": ("%{", "}%")}
_IMPORT = re.compile(r"""\bimport\s*(\*\s*as\s+\w+|\{[^}]*\})\s*from\s*(["'])(?:[\w./]*/)?(\w+)(?:\.js)?\2""")
_KEYS = {"Vec2f": "xy", "Vec3f": "xyz", "Color": "rgb", "Rotation": "xyza"}


class _Piece(NamedTuple):
    kind: Literal["text", "statement", "value"]
    text: str
    line: int


def language_of(head: str, body: str) -> Language | None:
    """Determine a template's language from the text before the PROTO's body; return None if it is not a template."""
    if re.search(r"^#\s*template language:\s*javascript", head, re.MULTILINE):
        return "javascript" if "%<" in body else None
    return "lua" if "%{" in body else "javascript" if "%<" in body else None


def render(
    body: str, language: Language, variables: Mapping[str, Json], file: str, first_line: int, engine: TemplateEngine
) -> str:
    """Run a template with global variables of JSON types, where None is undefined, and return the resulting text.

    Its line breaks are those of the template, so that line numbers agree up to the first loop.
    """
    pieces = _split(body, *_MARKS[language], file, first_line)
    program, lines = _program(pieces, language)
    job = _javascript_job(program, variables) if language == "javascript" else _lua_job(program, variables)
    name, module = _ENGINES[language]
    if not is_installed(module):
        raise FileFormatError(
            f"{file}:{lines[0]}: expected the {name} for the PROTO's template, got none: pip install 'warpvis[webots]'"
        )
    job |= {"language": language, "heap": _HEAP, "memory": _MEMORY, "seconds": SECONDS + _GRACE}
    try:
        answer = engine.run(job)
    except OSError as error:
        _fail(file, lines[0], f"no process to run it in: {error}")
    if "text" in answer:
        return answer["text"]
    if "odd" in answer:
        raise FileFormatError(
            f"{file}:{first_line}: expected a template that returns a text, got {shown(answer['odd'])}"
        )
    if "late" in answer:
        _fail(file, lines[0], _too_long())
    if "ended" in answer:
        _fail(file, lines[0], answer["ended"])
    if answer["kind"] not in _ENGINE_ERRORS:
        _fail(file, first_line, f"{answer['kind']}: {answer['error']}")
    line, message = _place(language, answer["error"], lines)
    _fail(file, line, message)


class ScriptValue:
    """Converts a field's value for templates, counting its elements, where a USE counts as a copy.

    Floats are rounded to six digits, as by Webots. `describe` returns type, value and default of each field of a PROTO
    instance. For other nodes, templates get the fields in the file, whose types are unknown: one value is a scalar, two
    to four numbers are a vector or rotation, and more are a list.
    """

    def __init__(self, place: str, describe: Describe) -> None:
        self._place, self._describe = place, describe
        self._remaining, self._depth = _MAX_VALUES, 0

    def convert(self, value: Value, field_type: str) -> Json:
        """Convert a value of a type like ``SFVec3f``."""
        self._count(len(value) if isinstance(value, list) else 1)
        if isinstance(value, Node):
            return [self._node(value)] if field_type.startswith("MF") else self._node(value)
        if value is None:
            return [] if field_type.startswith("MF") else None
        if not field_type:
            return self._untyped(value)
        keys = _KEYS.get(field_type[2:], "")
        items = [self._item(item, real=bool(keys) or field_type[2:] == "Float") for item in value]
        if field_type.startswith("SF"):
            return _named(items, keys) if keys else items[0]
        if keys:
            return [_named(items[i : i + len(keys)], keys) for i in range(0, len(items), len(keys))]
        return items

    def _item(self, item: float | str | bool | Node, *, real: bool) -> Json:
        if isinstance(item, Node):
            return self._node(item)
        return float(f"{item:.6g}") if real else item

    def _untyped(self, value: Sequence[float | str | bool | Node]) -> Json:
        nodes = [item for item in value if isinstance(item, Node)]
        if nodes:
            return [self._node(node) for node in nodes]
        items = [self._item(item, real=isinstance(item, float) and item % 1 != 0) for item in value]
        if len(items) == 1:
            return items[0]
        if not 2 <= len(items) <= 4 or not isinstance(items[0], float):
            return items
        named = _named(items, "xyza"[: len(items)])
        return {**named, **_named(items, "rgb")} if len(items) == 3 else named

    def _node(self, node: Node) -> dict[str, Json]:
        self._depth += 1
        if self._depth > _MAX_NESTED:
            raise FileFormatError(
                f"{self._place}: expected at most {_MAX_NESTED} nodes within nodes for a template, got more"
            )
        fields = {}
        described = self._describe(node)
        if described is None:
            described = {name: ("", value, value) for name, value in node.fields.items()}
        else:
            self._count(_PROTO_COST)
        for name, (field_type, value, default) in described.items():
            translated = self.convert(value, field_type)
            other = translated if default is value else self.convert(default, field_type)
            fields[name] = {"value": translated, "defaultValue": other}
        self._depth -= 1
        return {"node_name": node.type, "fields": fields}

    def _count(self, number: int) -> None:
        self._remaining -= number
        if self._remaining < 0:
            raise FileFormatError(f"{self._place}: expected at most {_MAX_VALUES} values for a template, got more")


def _named(items: Sequence[Json], keys: str) -> dict[str, Json]:
    return dict(zip(keys, items, strict=True))


def _split(body: str, opening: str, closing: str, file: str, first_line: int) -> list[_Piece]:
    """Split a template into texts, statements and values; comments are ignored, strings are not."""
    pattern = re.compile(rf'{re.escape(opening)}(?:(=?)(.*?){re.escape(closing)})?|\\.|["#]', re.DOTALL)
    pieces: list[_Piece] = []
    in_string = False
    position, done, line = 0, 0, first_line
    while (match := pattern.search(body, position)) is not None:
        position = match.end()
        if match[0] == "#" and not in_string:
            end = body.find("\n", position)
            position = len(body) if end < 0 else end
        elif match[0] == '"':
            in_string = not in_string
        elif match[0].startswith(opening) and match[2] is None:
            line += body.count("\n", done, match.start())
            raise FileFormatError(f"{file}:{line}: expected {closing!r} after {opening!r}, got the end of the file")
        elif match[2] is not None:
            text = body[done : match.start()]
            pieces.append(_Piece("text", text, line))
            line += text.count("\n")
            pieces.append(_Piece("value" if match[1] else "statement", match[2], line))
            line += match[2].count("\n")
            done = position
    pieces.append(_Piece("text", body[done:], line))
    return pieces


def _program(pieces: list[_Piece], language: Language) -> tuple[str, list[int]]:
    """Write a program that concatenates the text; return it, and the line of the file for each of its lines."""
    program: list[str] = []
    lines: list[int] = []
    breaks = ""  # line breaks of statements, for equal line numbers
    for piece in pieces:
        code = piece.text.rstrip().rstrip(";") if piece.kind == "value" else piece.text
        if piece.kind == "text":
            literal = breaks + code
            breaks = ""
            program.append(
                f"_put({json.dumps(literal) if language == 'javascript' else _lua(literal)})" if literal else ""
            )
            lines.append(piece.line)
            continue
        breaks += "\n" * piece.text.count("\n")
        if language == "javascript":
            code = _IMPORT.sub(_imported, code)
        rows = [piece.line + i for i in range(code.count("\n") + 1)]
        program += ["_put(", code, ")"] if piece.kind == "value" else [code]
        lines += [rows[0], *rows, rows[-1]] if piece.kind == "value" else rows
    return "\n".join(program), lines


def _imported(match: re.Match[str]) -> str:
    """Rewrite an import statement as a declaration, since functions cannot contain imports."""
    names = match[1].removeprefix("*").strip()
    names = re.sub(r"\s+as\s+", ": ", names) if names.startswith("{") else names.split()[-1]
    return f"const {names} = $modules.{match[3]}"


@cache
def _library(name: str) -> str:
    """Read a library of templates from its file."""
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


def _javascript_job(program: str, variables: Mapping[str, Json]) -> dict[str, Json]:
    opening = '(function () { "use strict"; const $pieces = []; const _put = (v) => { $pieces.push(String(v)); };'
    closing = 'return $pieces.join(""); })()'  # join, since quickjs cannot return the rope of a string sum to Python
    return {
        "library": _library("templates.js"),
        "program": f"{opening}\n{program}\n{closing}",
        "variables": {name: json.dumps(_without_none(value)) for name, value in variables.items()},
        "limit": SECONDS,
        "stack": _STACK,
    }


def _lua_job(program: str, variables: Mapping[str, Json]) -> dict[str, Json]:
    opening = "local _pieces = {} local function _put(v) _pieces[#_pieces + 1] = tostring(v) end"
    return {
        "library": _library("templates.lua"),
        "modules": _library("template_modules.lua"),
        "program": f"{opening}\n{program}\nreturn table.concat(_pieces)",
        "variables": {name: _lua(value) for name, value in variables.items()},
        "limit": _LUA_STEPS,
    }


_ENGINE_ERRORS = {"JSException", "StackOverflow", "LuaError", "LuaMemoryError", "LuaSyntaxError"}
_ENGINES: dict[Language, tuple[str, str]] = {
    "javascript": ("JavaScript engine quickjs-ng", "quickjs"),
    "lua": ("Lua engine lupa", "lupa"),
}


def _place(language: Language, error: str, lines: Sequence[int]) -> tuple[int, str]:
    """Extract the line of the file and the error from an engine's message."""
    if language == "javascript":
        message = error.strip().split("\n")[0]
        place = re.search(r"<input>:(\d+)", error)
        message = message.replace("InternalError: interrupted", _too_long())
    else:
        message = error.split("stack traceback:", maxsplit=1)[0].strip() or "an error without a message"
        place = re.match(r"template:(\d+): ", message)
        message = message.removeprefix(place[0] if place else "").replace("the time limit", _too_long())
    return (lines[min(max(int(place[1]) - 2, 0), len(lines) - 1)] if place else lines[0]), message


def _too_long() -> str:
    return f"one that runs longer than {SECONDS} s"


def _fail(file: str, line: int, message: str) -> NoReturn:
    raise FileFormatError(f"{file}:{line}: expected a template that runs, got {message}") from None


def _without_none(value: Json) -> Json:
    """Remove the keys whose value is None: reading them gives undefined."""
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list) else value


def _lua(value: Json) -> str:
    """Write a value as a Lua expression."""
    if value is None or isinstance(value, bool):
        return {None: "nil", True: "true", False: "false"}[value]
    if isinstance(value, dict):
        return "{" + ", ".join(f"[{_lua(key)}] = {_lua(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "{" + ", ".join(map(_lua, value)) + "}"
    if isinstance(value, str):
        return '"' + re.sub(r'[\\"\x00-\x1f]', lambda match: f"\\{ord(match[0]):03d}", value) + '"'
    return repr(value)
