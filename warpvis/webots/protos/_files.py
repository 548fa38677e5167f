# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""PROTO files: an interface of typed fields with defaults, and a body.

Webots' documentation: https://cyberbotics.com/doc/reference/proto-definition. The grammar::

    file  := header ("EXTERNPROTO" string)* "PROTO" name "[" field* "]" "{" body "}"
    field := kind type ["{" value* "}"] name value
    kind  := "field" | "hiddenField" | "unconnectedField" | "vrmlField" | "w3dField"
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from warpvis.core.checks import pluralize
from warpvis.webots._grammar import Parser, read_text, read_version
from warpvis.webots._nodes import Node, Value, Version, described
from warpvis.webots.protos._templates import Language, language_of

_KINDS = {"field", "hiddenField", "unconnectedField", "vrmlField", "w3dField"}
_WIDTHS = {"Bool": 1, "Int32": 1, "Float": 1, "String": 1, "Vec2f": 2, "Vec3f": 3, "Color": 3, "Rotation": 4, "Node": 1}
_TYPES = {prefix + name for prefix in ("SF", "MF") for name in _WIDTHS}
_LITERALS: dict[str, tuple[type, str]] = {"Bool": (bool, "TRUE or FALSE"), "String": (str, "strings")}


@dataclass(frozen=True)
class ProtoField:
    """A field of a PROTO's interface.

    Attributes:
        type: Type, like ``SFVec3f``.
        default: Text of the default. It is parsed for every instance, since it may contain PROTOs.
        line: Line of that text.
        allowed: Allowed values; empty if unrestricted. Nodes are not checked, since they may have types derived from
            the allowed ones.
    """

    type: str
    default: str
    line: int
    allowed: tuple[float | str | bool, ...] = ()


@dataclass(frozen=True, eq=False)
class ProtoFile:
    """A PROTO file.

    Attributes:
        path: The file.
        source: Name in messages and base of relative URLs: its path, or the URL of a copy in Webots' cache.
        version: Version in its header, which applies to the body regardless of the world's version.
        externprotos: URLs of its EXTERNPROTO lines.
        name: Name of the PROTO.
        fields: Its interface.
        body: Text from the opening brace of the body to the end of the file.
        body_line: Line at which that text begins.
        language: Language of the body's template; None if the body is not a template.
        template_fields: Names of the fields that the template reads.
    """

    path: Path
    source: str
    version: Version
    externprotos: list[str]
    name: str
    fields: dict[str, ProtoField]
    body: str
    body_line: int
    language: Language | None
    template_fields: frozenset[str]

    def values(self, instance: Node, protos: tuple[str, ...]) -> dict[str, Value]:
        """Return the values of the fields of an instance, or their defaults.

        Fields that are not in the interface are ignored, as in Webots.

        Args:
            instance: A node of this type.
            protos: `Node.protos` of the nodes in defaults.
        """
        return {
            name: _checked(field, name, instance) if name in instance.fields else self.default(name, protos)
            for name, field in self.fields.items()
        }

    def default(self, name: str, protos: tuple[str, ...] = ()) -> Value:
        """Parse the default of a field."""
        field = self.fields[name]
        return Parser(field.default, self.source, self.version, first_line=field.line, protos=protos).value()


def read_proto(path: Path, source: str | None = None) -> ProtoFile:
    """Read a PROTO file.

    Args:
        path: The file.
        source: Its URL, if it is a copy in Webots' cache, whose file name is a hash.
    """
    text = read_text(path)
    source = str(path) if source is None else source
    version = read_version(text, source)
    parser = Parser(text, source, version)
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
        field_name, field = _read_field(parser, source, version)
        fields[field_name] = field
    parser.advance()
    start, line = parser.start + 1, parser.line()
    if parser.kind != "{":
        parser.fail("'{' and the body of the PROTO")
    head, body = parser.text[: start - 1], parser.text[start:]
    read = set(re.findall(r"\bfields\s*\.\s*(\w+)", body))
    used = (
        fields if re.search(r"\bfields\b\s*[^\s.]", body) else read & set(fields)
    )  # all fields, if not accessed by name
    language = language_of(head, body)
    return ProtoFile(path, source, version, externprotos, name, fields, body, line, language, frozenset(used))


def _read_field(parser: Parser, file: str, version: Version) -> tuple[str, ProtoField]:
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
    field = ProtoField(field_type, parser.text[start : parser.start], line, tuple(allowed))
    _checked(field, name, Node("PROTO", {name: value}, None, file, line, version))
    return name, field


def _checked(field: ProtoField, name: str, instance: Node) -> Value:
    """Return an instance's value of a field after checking its type and the allowed values."""
    value = instance.fields[name]
    kind, single = field.type[2:], field.type.startswith("SF")
    if kind == "Node":
        if not single:
            return [*instance.nodes(name)]
        return instance.node(name)
    literal, words = _LITERALS.get(kind, (float, "numbers"))
    if not isinstance(value, list):
        _refuse(instance, name, field, described(value))
    for item in value:
        if type(item) is not literal:
            instance.refuse(name, words, described(item))
        if kind == "Int32" and isinstance(item, float) and not item.is_integer():
            instance.refuse(name, "whole numbers", described(item))
    width = _WIDTHS[kind]
    if len(value) != width if single else len(value) % width:
        _refuse(instance, name, field, pluralize(len(value), "value"))
    allowed = [field.allowed[i : i + width] for i in range(0, len(field.allowed), width)]
    for i in range(0, len(value) if allowed else 0, width):
        if tuple(value[i : i + width]) not in allowed:
            choices = ", ".join(" ".join(map(described, choice)) for choice in allowed)
            instance.refuse(name, f"one of {choices}", " ".join(map(described, value[i : i + width])))
    return value


def _refuse(instance: Node, name: str, field: ProtoField, got: str) -> NoReturn:
    instance.refuse(name, f"a value of type {field.type}", got)
