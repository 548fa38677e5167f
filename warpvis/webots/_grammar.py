# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Parser of Webots' world files into nodes and fields, without semantics.

Webots' documentation: https://cyberbotics.com/doc/reference/nodes-and-keywords. The grammar::

    file  := header (["IMPORTABLE"] "EXTERNPROTO" string | node)*
    node  := ["DEF" name] type "{" (["hidden"] field value)* "}" | "USE" name | "NULL"
    value := node | "[" (node | literal)* "]" | number+ | string | "TRUE" | "FALSE"

Whitespace and commas are separators, and ``#`` starts a comment. No table of field types is needed: a field's numbers
end at the next word or bracket. A list of one element may be written without brackets.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

from warpvis.core.checks import truncate
from warpvis.core.file_content import require_content
from warpvis.errors import FileFormatError
from warpvis.webots._nodes import Node, Value, Version, nodes_in, shown

MAX_NESTED = 300
"""Maximum depth of nested nodes, followed through USE, so that recursive functions may walk the tree."""
MAX_NODES = 10_000_000
"""Maximum number of nodes of a world, where every USE counts as a copy: nested USEs grow exponentially."""

_NUMBER = r"[+-]?+(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?+\d++)?+(?![^\s,\[\]{}\"\#])"
_TOKEN = re.compile(
    rf"""
    [\s,]*+(?:\#[^\n]*+[\s,]*+)*+
    (?: (?P<numbers>{_NUMBER}(?:[\s,]++{_NUMBER})*+)
      | (?P<word>[^\W\d][^\s,"\#'\[\]{{}}\\]*+)
      | (?P<string>"(?:[^"\\]|\\.)*+")
      | (?P<mark>[\[\]{{}}])
      | (?P<end>\Z)
      | (?P<bad>"|[^\s,"\[\]{{}}]++) )
    """,
    re.VERBOSE | re.DOTALL,
)
_HEADER = re.compile(r"#(?:VRML_SIM|OMNISIM)\s+(\S+)(?:\s+revision\s+\d+)?\s+utf8\b.*")
_KEYWORDS = {"DEF", "USE", "NULL", "TRUE", "FALSE", "IS", "EXTERNPROTO", "IMPORTABLE", "PROTO"}
_NOT_FINITE = {"nan", "inf", "infinity"}


@dataclass
class World:
    """The content of a world file."""

    path: Path
    version: Version  # in its header
    externprotos: list[str] = field(default_factory=list)  # URLs
    nodes: list[Node] = field(default_factory=list)  # at the top level

    @property
    def size(self) -> int:
        """Number of nodes, where every USE counts as a copy."""
        return sum(node.size for node in self.nodes)


def parse_world(path: str | Path) -> World:
    """Read a world file."""
    return parse_text(read_text(Path(path)), str(path))


def parse_text(text: str, file: str = "<text>") -> World:
    """Parse the text of a world."""
    parser = Parser(text, file)
    world = World(Path(file), parser.version)
    while parser.kind != "end":
        world.externprotos += parser.externprotos()
        world.nodes += parser.nodes()
        if parser.kind != "end" and parser.token not in ("EXTERNPROTO", "IMPORTABLE"):
            parser.fail("a node")
    if world.size > MAX_NODES:
        count = f"{world.size} where USE counts as a copy"
        raise FileFormatError(f"{file}: expected at most {MAX_NODES} nodes, got {count}")
    return world


def read_text(path: Path) -> str:
    """Read the text of a file; replace bytes that are not UTF-8, which occur in comments and names of old worlds."""
    require_content(path, "a Webots file")
    try:
        return path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise FileFormatError(f"{str(path)!r}: cannot be read: {error}") from None


def read_version(text: str, file: str) -> Version:
    """Read the version in a text's header."""
    line = re.split(r"[\r\n]", text[:200].removeprefix("\ufeff"), maxsplit=1)[0].strip()
    match = _HEADER.fullmatch(line)
    if match is None:
        raise FileFormatError(f"{file}:1: expected the header '#VRML_SIM <version> utf8', got {shown(line)}")
    try:
        return Version.parse(match[1])
    except FileFormatError as error:
        raise FileFormatError(f"{file}:1: {error}") from None


class Parser:
    """A parser that reads a text incrementally; `interface` has the fields that ``IS`` may name, if allowed."""

    def __init__(
        self,
        text: str,
        file: str,
        version: Version | None = None,
        *,
        first_line: int = 1,
        protos: tuple[str, ...] = (),
        interface: Mapping[str, Value] | None = None,
    ) -> None:
        """Advance to the first token."""
        if "\r" in text:
            text = text.replace("\r\n", "\n").replace("\r", "\n")
        self.text = text = text.removeprefix("\ufeff")
        self.version = read_version(text, file) if version is None else version
        self._file, self._first_line, self._protos, self._interface = file, first_line, protos, interface
        self._breaks = [match.start() for match in re.finditer("\n", text)]
        self._tokens: Iterator[re.Match[str]] = _TOKEN.finditer(text)
        self._named: dict[str, Node] = {}  # by DEF name; a later DEF replaces an earlier one
        self._open: list[Node | list[float | str | bool | Node]] = []  # stack of open nodes and lists
        self.advance()

    def advance(self) -> None:
        """Advance to the next token and set `kind` (for a bracket, the character itself), `token` and `start`."""
        match = next(self._tokens)
        kind = match.lastgroup or "bad"
        self.token: str = match[kind]
        self.start: int = match.start(kind)
        self.kind = self.token if kind == "mark" else kind

    def line(self) -> int:
        """Return the line number of the current token."""
        return self._first_line + bisect_left(self._breaks, self.start)

    def fail(self, expected: str, got: str | None = None) -> NoReturn:
        """Raise a FileFormatError with the expected and the current token."""
        if got is None:
            got = "the end of the file" if self.kind == "end" else shown(self.token)
            if self.kind == "bad" and self.token.startswith('"'):
                expected, got = "a string to end", "the end of the file"
        raise FileFormatError(f"{self._file}:{self.line()}: expected {truncate(expected)}, got {got}")

    def take(self, kind: str, expected: str) -> str:
        """Return the current token, which must be of the given kind, and advance."""
        token = self.token
        if self.kind != kind or (kind == "word" and token in _KEYWORDS):
            self.fail(expected)
        self.advance()
        return token

    def externprotos(self) -> list[str]:
        """Read the URLs of consecutive EXTERNPROTO lines, without IMPORTABLE ones, which have no instances."""
        urls = []
        while self.kind == "word" and self.token in ("EXTERNPROTO", "IMPORTABLE"):
            importable = self.token == "IMPORTABLE"
            if importable:
                self.advance()
                if self.token != "EXTERNPROTO":
                    self.fail("EXTERNPROTO after IMPORTABLE")
            self.advance()
            url = _unquoted(self.take("string", "a url in quotes after EXTERNPROTO"))
            if not importable:
                urls.append(url)
        return urls

    def nodes(self) -> list[Node]:
        """Read consecutive nodes."""
        nodes = []
        while self.kind == "word" and self.token not in _KEYWORDS - {"DEF", "USE", "NULL"}:
            node = self.value()
            if isinstance(node, Node):
                nodes.append(node)
        return nodes

    def value(self, expected: str = "a value") -> Value:
        """Read a value, including nested values."""
        value = self._begin(expected)
        while self._open:
            top = self._open[-1]
            if isinstance(top, Node):
                self._read_field(top)
            else:
                self._read_item(top)
        return value

    def _begin(self, expected: str) -> Value:
        """Begin a value; return it complete, or push it on the stack if it is a node or a list."""
        if self.kind == "numbers":
            return self._read_numbers()
        if self.kind == "string":
            return [_unquoted(self.take("string", expected))]
        if self.kind == "[":
            self.advance()
            items: list[float | str | bool | Node] = []
            self._open.append(items)
            return items
        word = self.token
        if self.kind != "word" or word.lower() in _NOT_FINITE:
            self.fail("finite numbers" if self.kind == "word" else expected)
        if word in ("TRUE", "FALSE", "NULL"):
            self.advance()
            return None if word == "NULL" else [word == "TRUE"]
        if word == "USE":
            return self._use()
        return self._begin_node(expected)

    def _begin_node(self, expected: str) -> Node:
        name = None
        line = self.line()
        if self.token == "DEF":
            self.advance()
            name = self.take("word", "a name after DEF")
            expected = f"a node type after DEF {name}"
        node = Node(self.take("word", expected), {}, name, self._file, line, self.version, self._protos)
        self.take("{", f"'{{' after {node.type}")
        self._open.append(node)
        if len(self._open) > 2 * MAX_NESTED:  # each nested node is in a list
            self.fail(f"at most {MAX_NESTED} nodes within nodes", "more")
        if name is not None:
            self._named[name] = node
        return node

    def _read_field(self, node: Node) -> None:
        """Read a field or the end of an open node."""
        if self.kind == "}":
            self._open.pop()
            self._count(node)
            self.advance()
            return
        if self.kind == "word" and self.token.lower() in _NOT_FINITE:
            self.fail("finite numbers")
        name = self.take("word", f"a field or '}}' of {node.type}")
        if name == "hidden" and self.kind == "word" and self.token not in _KEYWORDS:
            self.take("word", "a field")
            self._begin("a value of a hidden field")  # the state of a node within a PROTO
        elif self.token == "IS" and self._interface is not None:
            self._substitute(node, name, self._interface)
        else:
            node.fields[name] = self._begin(f"a value of {name!r}")

    def _read_item(self, items: list[float | str | bool | Node]) -> None:
        """Read an item or the end of an open list."""
        if self.kind == "]":
            self._open.pop()
            self.advance()
        elif self.kind == "[" or self.token == "IS":
            self.fail("a value or ']'")
        else:
            value = self._begin("a value or ']'")
            if isinstance(value, Node):
                items.append(value)
            elif value is not None:
                items += value

    def _read_numbers(self) -> list[float | str | bool | Node]:
        values: list[float | str | bool | Node] = []
        while self.kind == "numbers":
            run = list(map(float, self.token.replace(",", " ").split()))
            if not all(map(math.isfinite, run)):
                words = re.split(r"[\s,]+", self.token)
                self.fail("finite numbers", next(shown(word) for word in words if math.isinf(float(word))))
            values += run
            self.advance()
        return values

    def _use(self) -> Node:
        self.advance()
        if self.kind != "word" or self.token not in self._named:
            self.fail("a name after USE that a DEF above defines")
        node = self._named[self.token]
        if node in self._open:
            self.fail("a USE outside its own DEF", f"USE {self.token}")
        self.advance()
        self._count(node)
        return node

    def _substitute(self, node: Node, name: str, interface: Mapping[str, Value]) -> None:
        self.advance()
        field = self.take("word", "a field of the PROTO after IS")
        if field not in interface:  # Webots skips the field
            return
        value = node.fields[name] = interface[field]
        for item in nodes_in(value):
            self._count(item)

    def _count(self, node: Node) -> None:
        """Add a complete node to the size and the height of its parent, an open node."""
        owner = self._open[-1] if self._open else None
        if isinstance(owner, list):  # the node that has the list is below it on the stack
            owner = self._open[-2] if len(self._open) > 1 else None
        if not isinstance(owner, Node):
            return
        owner.size += node.size
        owner.height = max(owner.height, node.height + 1)
        if owner.size > MAX_NODES:
            self.fail(f"at most {MAX_NODES} nodes, where USE counts as a copy", f"{owner.size}")
        if owner.height > MAX_NESTED:
            self.fail(f"at most {MAX_NESTED} nodes within nodes", "more")


def _unquoted(token: str) -> str:
    text = token[1:-1]
    return re.sub(r'\\(["\\])', r"\1", text) if "\\" in text else text
