# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Expansion of a Webots world's PROTO instances from their files.

A PROTO file has an interface of typed fields with defaults, and a body. Webots' documentation:
https://cyberbotics.com/doc/reference/proto-definition. The grammar::

    file  := header ("EXTERNPROTO" string)* "PROTO" name "[" field* "]" "{" body "}"
    field := kind type ["{" value* "}"] name value
    kind  := "field" | "hiddenField" | "unconnectedField" | "vrmlField" | "w3dField"
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from warpvis.core.checks import pluralize
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.webots._grammar import Parser, World, read_text
from warpvis.webots._nodes import BUILTIN_NODES, Node, Value, Version, described, fail
from warpvis.webots._urls import Found, Places, first_file, is_web, with_slashes
from warpvis.webots.protos._template_engine import TemplateEngine
from warpvis.webots.protos._templates import Language, ScriptValue, language_of, render

MAX_PROTOS_NESTED = 50
"""Maximum depth of nested PROTOs."""
MAX_PROTO_NODES = 1_000_000
"""Maximum number of nodes that all PROTO instances of a world expand to."""
MAX_INSTANCES = 50_000
"""Maximum number of PROTO instances of a world, including nested ones: doubling PROTOs grow exponentially."""

_KINDS = {"field", "hiddenField", "unconnectedField", "vrmlField", "w3dField"}
_WIDTHS = {"Bool": 1, "Int32": 1, "Float": 1, "String": 1, "Vec2f": 2, "Vec3f": 3, "Color": 3, "Rotation": 4, "Node": 1}
_TYPES = {prefix + name for prefix in ("SF", "MF") for name in _WIDTHS}
_LITERALS: dict[str, tuple[type, str]] = {"Bool": (bool, "TRUE or FALSE"), "String": (str, "strings")}


@dataclass(frozen=True)
class ProtoField:
    """A field of a PROTO's interface."""

    name: str
    type: str  # like SFVec3f
    default: str  # text, which is parsed for every instance, since it may contain PROTOs
    line: int  # of that text
    allowed: tuple[
        float | str | bool, ...
    ] = ()  # empty if unrestricted; nodes may have types derived from allowed ones


@dataclass(frozen=True, eq=False)
class ProtoFile:
    """A PROTO file."""

    path: Path
    source: str  # in messages, and the base of relative URLs: its path, or the URL of a copy in Webots' cache
    version: Version  # in its header, applies to the body regardless of the world's version
    externprotos: list[str]  # URLs
    name: str
    fields: dict[str, ProtoField]
    body: str  # text from the opening brace of the body to the end of the file
    body_line: int  # at which that text begins
    language: Language | None  # of the body's template; None if the body is not a template
    template_fields: frozenset[str]  # that the template reads

    def values(self, instance: Node, protos: tuple[str, ...]) -> dict[str, Value]:
        """Return an instance's values of the fields, or their defaults; as in Webots, other fields are ignored."""
        return {
            name: _checked(field, instance) if name in instance.fields else self.default(field, protos)
            for name, field in self.fields.items()
        }

    def default(self, field: ProtoField, protos: tuple[str, ...] = ()) -> Value:
        """Parse the default of a field."""
        return Parser(field.default, self.source, self.version, first_line=field.line, protos=protos).value()


def read_proto(path: Path, source: str | None = None) -> ProtoFile:
    """Read a PROTO file; `source` is its URL, if it is a copy in Webots' cache, whose file name is a hash."""
    text = read_text(path)
    source = str(path) if source is None else source
    parser = Parser(text, source)
    externprotos = parser.externprotos()
    if parser.token != "PROTO":
        parser.fail("EXTERNPROTO or PROTO")
    parser.advance()
    if parser.kind == "word" and not source.lower().endswith(f"{parser.token}.proto".lower()):
        parser.fail(f"a PROTO of the file's name {Path(source).stem!r}")
    name = parser.take("word", "a name after PROTO")
    parser.take("[", f"'[' after PROTO {name}")
    fields: dict[str, ProtoField] = {}
    while parser.kind != "]":
        field = _read_field(parser, source)
        fields[field.name] = field
    parser.advance()
    start, line = parser.start + 1, parser.line()
    if parser.kind != "{":
        parser.fail("'{' and the body of the PROTO")
    head, body = parser.text[: start - 1], parser.text[start:]
    read = set(re.findall(r"\bfields\s*\.\s*(\w+)", body))
    # All fields, if not accessed by name.
    used = fields if re.search(r"\bfields\b\s*[^\s.]", body) else read & set(fields)
    language = language_of(head, body)
    return ProtoFile(path, source, parser.version, externprotos, name, fields, body, line, language, frozenset(used))


def _read_field(parser: Parser, file: str) -> ProtoField:
    if parser.token not in _KINDS:
        parser.fail("a field or ']'")
    parser.advance()
    field_type = parser.token
    if field_type not in _TYPES:
        parser.fail("a type of fields, like SFVec3f")
    parser.advance()
    allowed: list[float | str | bool] = []
    if parser.kind == "{":
        parser.advance()
        while parser.kind != "}":
            value = parser.value("an allowed value or '}'")
            allowed += [item for item in value if not isinstance(item, Node)] if isinstance(value, list) else []
        parser.advance()
    name = parser.take("word", f"the name of a field of type {field_type}")
    start, line = parser.start, parser.line()
    value = parser.value(f"a default of {name!r}")
    field = ProtoField(name, field_type, parser.text[start : parser.start], line, tuple(allowed))
    _checked(field, Node("PROTO", {name: value}, None, file, line, parser.version))
    return field


def _checked(field: ProtoField, instance: Node) -> Value:
    """Return an instance's value of a field after checking its type and the allowed values."""
    name, value, expected = field.name, instance.fields[field.name], f"a value of type {field.type}"
    kind, single = field.type[2:], field.type.startswith("SF")
    if kind == "Node":
        return instance.node(name) if single else [*instance.nodes(name)]
    literal, words = _LITERALS.get(kind, (float, "numbers"))
    if not isinstance(value, list):
        instance.refuse(name, expected, described(value))
    for item in value:
        if type(item) is not literal:
            instance.refuse(name, words, described(item))
        if kind == "Int32" and isinstance(item, float) and not item.is_integer():
            instance.refuse(name, "whole numbers", described(item))
    width = _WIDTHS[kind]
    if len(value) != width if single else len(value) % width:
        instance.refuse(name, expected, pluralize(len(value), "value"))
    allowed = [field.allowed[i : i + width] for i in range(0, len(field.allowed), width)]
    for i in range(0, len(value) if allowed else 0, width):
        if tuple(value[i : i + width]) not in allowed:
            choices = ", ".join(" ".join(map(described, choice)) for choice in allowed)
            instance.refuse(name, f"one of {choices}", " ".join(map(described, value[i : i + width])))
    return value


class Protos:
    """The PROTOs of a world.

    The file of a PROTO is searched for in this order: the URL in an EXTERNPROTO line of the world or PROTO file, where
    ``webots://projects/...`` and the same path on GitHub are resolved below the folders of the search path; the folder
    of the file that uses it; ``protos`` folders of the world's project; all folders below the search path; and Webots'
    cache, by the URL in an EXTERNPROTO line.
    """

    def __init__(
        self, world: World, search_path: Sequence[str | os.PathLike[str]] = (), cache: Path | None = None
    ) -> None:
        """Search the folders of `search_path`, Webots' installation or others, and `cache`, that of Webots' cache."""
        self._world = world
        self.places = Places(world.path, world.version, [Path(folder) for folder in search_path], cache)
        for folder in self.places.search_path:
            if not folder.is_dir():
                raise FileFormatError(f"{folder}: expected a folder of PROTO files, got no such folder")
        self._urls = {str(world.path): world.externprotos}  # by file
        self._index: dict[str, Path] | None = None  # by name, for all files in the project and below the search path
        self._files: dict[Path, ProtoFile] = {}
        self._found: dict[tuple[str, str], ProtoFile | None] = {}  # by type and the file that uses it
        self._expanded: dict[Node, Node | None] = {}
        self._rendered: dict[tuple[Path, str], str | FileFormatError] = {}
        self._engine = TemplateEngine()
        self._nodes = self._instances = 0

    def close(self) -> None:
        """End the template process, if it is running."""
        self._engine.close()

    def expand(self, node: Node) -> Node | None:
        """Expand a PROTO instance, cached; return None for a built-in type and for a PROTO without a file.

        The result has the instance's DEF name and the version of the PROTO's file. If the root of the PROTO's body is
        an instance too, it is expanded recursively; if its file is not found, it is returned unexpanded.
        """
        if node.type in BUILTIN_NODES:
            return None
        if node not in self._expanded:
            self._expanded[node] = self._expand(node)
        return self._expanded[node]

    def _expand(self, node: Node) -> Node | None:
        current = node
        while current.type not in BUILTIN_NODES:
            proto = self._find(current)
            if proto is None:
                break
            current = self._instantiate(proto, current)
        return None if current is node else current

    def _instantiate(self, proto: ProtoFile, node: Node) -> Node:
        """Parse a PROTO's body with the instance's values, and return its root."""
        path = proto.source
        protos = (*node.protos, path)
        if path in node.protos:
            cycle = " -> ".join(Path(file).stem for file in protos[node.protos.index(path) :])
            fail(node, "PROTOs that do not use themselves", cycle)
        if len(protos) > MAX_PROTOS_NESTED:
            fail(node, f"at most {MAX_PROTOS_NESTED} PROTOs within PROTOs", "more")
        self._instances += 1
        if self._instances > MAX_INSTANCES:
            fail(node, f"at most {MAX_INSTANCES} instances of PROTOs in a world", "more")
        values = proto.values(node, protos)
        body = self._render(proto, values, node) if proto.language else proto.body
        parser = Parser(body, path, proto.version, first_line=proto.body_line, protos=protos, interface=values)
        nodes = parser.nodes()
        parser.take("}", f"'}}' after the body of {proto.name}")
        if parser.kind != "end" or len(nodes) != 1:
            parser.fail(f"one node in the body of {proto.name}", f"{len(nodes)}" if parser.kind == "end" else None)
        (root,) = nodes
        self._nodes += root.size
        if self._nodes > MAX_PROTO_NODES:
            fail(node, f"PROTOs of at most {MAX_PROTO_NODES} nodes in total", "more")
        root.name = node.name
        return root

    def _render(self, proto: ProtoFile, values: dict[str, Value], node: Node) -> str:
        """Run a PROTO's template with an instance's values, and return the resulting text."""
        fields: dict[str, Json] = {}
        for name, field in proto.fields.items():
            if name in proto.template_fields:
                value = ScriptValue(node.place, self._describe).convert(values[name], field.type)
                default = ScriptValue(f"{proto.source}:{field.line}", self._describe)
                fields[name] = {"value": value, "defaultValue": default.convert(proto.default(field), field.type)}
        context = self._context(proto)
        if "context" in proto.body:
            context["id"] = len(self._expanded)
        key = (proto.path, repr((fields, context)))
        if key not in self._rendered:
            variables = {"fields": fields, "context": context}
            assert proto.language is not None
            place = (proto.source, proto.body_line)
            try:
                self._rendered[key] = render(proto.body, proto.language, variables, *place, self._engine)
            except FileFormatError as error:
                self._rendered[key] = error
        found = self._rendered[key]
        if isinstance(found, FileFormatError):
            raise found
        return found

    def _describe(self, node: Node) -> dict[str, tuple[str, Value, Value]] | None:
        """Return type, value and default of each field of an instance; None for other nodes, and without a file."""
        proto = None if node.type in BUILTIN_NODES else self._find(node)
        if proto is None:
            return None
        values = proto.values(node, node.protos)
        defaults = {name: proto.default(field) for name, field in proto.fields.items() if name in node.fields}
        return {
            name: (field.type, values[name], defaults.get(name, values[name])) for name, field in proto.fields.items()
        }

    def _context(self, proto: ProtoFile) -> dict[str, Json]:
        """Return the variable `context` of templates."""
        version, path = self._world.version, self._world.path.absolute()
        info = next((node for node in self._world.nodes if node.type == "WorldInfo"), None)
        axes = "ENU" if version >= Version(2020, 2) else "NUE"
        return {
            "world": str(path),
            "proto": str(proto.path.absolute()),
            "project_path": str(path.parent.parent),
            "webots_version": {"major": str(version), "revision": "0"},
            "webots_home": "",
            "temporary_files_path": "",
            "os": "linux",
            "coordinate_system": info.text("coordinateSystem", axes) if info else axes,
        }

    def _find(self, node: Node) -> ProtoFile | None:
        """Find and read the file of an instance's PROTO; return None if it is not found."""
        key = (node.type, node.file)
        if key not in self._found:
            found = self._locate(node)
            self._found[key] = None if found is None else self._read(found)
        return self._found[key]

    def _read(self, found: Found) -> ProtoFile:
        path = found.path.resolve()
        if path not in self._files:
            proto = read_proto(path, found.name if is_web(found.name) else None)
            self._files[path] = proto
            self._urls[proto.source] = proto.externprotos
        return self._files[path]

    def _locate(self, node: Node) -> Found | None:
        """Search for a PROTO's file, best location first."""
        name, folder = f"{node.type}.proto", Path(node.file).parent
        named = map(with_slashes, self._urls.get(node.file, self._world.externprotos))
        urls = [url for url in named if PurePosixPath(url).name == name]
        local = [] if is_web(node.file) else [folder / url for url in urls if not is_web(url)] + [folder / name]
        found = next(filter(None, (self.places.find_in_tree(url, node.file) for url in urls)), None)
        if found is not None:
            return found
        if self._index is None:
            self._index = self._make_index()
        if name in self._index:
            local.append(self._index[name])
        return first_file(local) or next(
            filter(None, (self.places.find_in_cache(url, node.file) for url in urls)), None
        )

    def _make_index(self) -> dict[str, Path]:
        world_folder = self._world.path.absolute().parent
        index: dict[str, Path] = {}
        for root in (world_folder.parent / "protos", world_folder / "protos", *self.places.search_path):
            for folder, folders, files in os.walk(root):
                folders[:] = sorted(name for name in folders if not name.startswith("."))
                for file in sorted(files):
                    if file.endswith(".proto"):
                        index.setdefault(file, Path(folder, file))
        return index
