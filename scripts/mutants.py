# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mutants: single small mistakes that a program's text could hold, in C++ headers and in Python.

Only code is changed: no comment, no string, no include, no static assertion.
"""

from __future__ import annotations

import ast
import io
import random
import re
import tokenize
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

RELATIONS = {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "=="}
"""Mistakes at a border, or of what is compared."""

SIGNS = {"+": "-", "-": "+", "+=": "-=", "-=": "+="}

LOGIC = {"&": "|", "|": "&", "&=": "|=", "|=": "&=", "&&": "||", "||": "&&", "and": "or", "or": "and"}

EXTREMES = {"least": "most", "min": "max", "minimum": "maximum", "floor": "ceil"}
EXTREMES |= {other: one for one, other in EXTREMES.items()}
"""Names of functions, or parts of builtins' names between underscores, whose meanings are opposite."""

TRUTHS = {"true": "false", "false": "true", "True": "False", "False": "True"}

SCALES = ("0.5", "2")
"""What constants with a point are multiplied by."""

_TOKEN = re.compile(
    r"""//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'          # left alone
    |(?:0[xX][0-9a-fA-F]+|(?:\d+\.\d*|\.\d+|\d+)(?:[eE][+-]?\d+)?)[uUlLfF]*
    |[A-Za-z_]\w*|<<=|>>=|<<|>>|->|\+\+|--|[-+*/%&|^<>=!]=|&&|\|\||::|\S""",
    re.VERBOSE | re.DOTALL,
)
_NUMBER = re.compile(r"^(0[xX][0-9a-fA-F]+|\.?\d[\d.]*(?:[eE][+-]?\d+)?)([uUlLfF]*)$")
_KEPT_LINES = re.compile(r"^\s*(#|static_assert|typedef|using|import |from |__all__)")
_DECLARATIONS = re.compile(
    r"^(?:(?:const|static|typedef|using|enum|struct|auto|inline|constexpr|unsigned|return)\b"
    r"|(?:float|double|int|bool|char|long long|v4|v8|i4|[A-Z]\w*)[\s*&]+\w+[^(]*[=;,\[({])"
)


@dataclass(frozen=True)
class Mutant:
    """One change of one line."""

    path: str
    number: int
    """Of the line, from 1 up."""
    kind: str
    before: str
    after: str
    """The line, without its end."""
    above: str = ""
    """The line before it."""

    @property
    def place(self) -> str:
        """Where it is, as editors take it."""
        return f"{self.path}:{self.number}"

    def apply(self, text: str) -> str:
        """The file's text with the mistake in it."""
        lines = text.split("\n")
        assert lines[self.number - 1] == self.before
        lines[self.number - 1] = self.after
        return "\n".join(lines)


@dataclass(frozen=True)
class _Token:
    text: str
    number: int
    column: int
    previous: str
    """The token before it, empty at the text's beginning."""
    line: str

    @property
    def end(self) -> int:
        return self.column + len(self.text)

    @property
    def spaced(self) -> bool:
        """Whether blanks are around it: formatters put them around operators of two sides, and not around others."""
        before, after = self.line[: self.column], self.line[self.end :]
        return (not before.strip() or before[-1] == " ") and (not after or after[0] == " ")

    def replaced(self, path: str, kind: str, text: str) -> Mutant:
        return Mutant(path, self.number, kind, self.line, self.line[: self.column] + text + self.line[self.end :])


def mutants_of(path: str, text: str) -> list[Mutant]:
    """All mutants of a file, C++ or Python by its name, without those that change nothing.

    Args:
        path: What to call the file.
        text: What is in it.
    """
    is_python = path.endswith(".py")
    tokens = list(_python_tokens(text) if is_python else _tokens(text))
    dropped = _python_statements(path, text) if is_python else _statements(path, text)
    found = [mutant for token in tokens for mutant in _of_token(path, token)]
    lines = ["", *text.split("\n")]
    return [
        replace(mutant, above=lines[mutant.number - 1])
        for mutant in dict.fromkeys([*found, *dropped])
        if mutant.before != mutant.after
    ]


def choose(mutants: Iterable[Mutant], count: int, seed: int) -> list[Mutant]:
    """So many of the mutants: a random kind each time, then a random one of that kind, since constants are many."""
    by_kind: dict[str, list[Mutant]] = {}
    for mutant in mutants:
        by_kind.setdefault(mutant.kind, []).append(mutant)
    rng, chosen = random.Random(seed), []
    for kind in sorted(by_kind):
        rng.shuffle(by_kind[kind])
    while by_kind and len(chosen) < count:
        kind = rng.choice(sorted(by_kind))
        chosen.append(by_kind[kind].pop())
        if not by_kind[kind]:
            del by_kind[kind]
    return chosen


def _tokens(text: str) -> Iterator[_Token]:
    """The tokens of C++ code."""
    lines, previous = text.split("\n"), ""
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line) + 1)
    number = 0
    for match in _TOKEN.finditer(text):
        word = match.group()
        if word.startswith(("//", "/*", '"', "'")):
            continue
        while starts[number + 1] <= match.start():
            number += 1
        if not _KEPT_LINES.match(lines[number]):
            yield _Token(word, number + 1, match.start() - starts[number], previous, lines[number])
        previous = word


def _python_tokens(text: str) -> Iterator[_Token]:
    """The tokens of Python code, without annotations' bars."""
    lines, previous = text.split("\n"), ""
    skipped = _annotated_lines(text)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in (tokenize.OP, tokenize.NAME, tokenize.NUMBER):
            continue
        number, column = token.start
        line = lines[number - 1]
        if number not in skipped and not _KEPT_LINES.match(line):
            yield _Token(token.string, number, column, previous, line)
        previous = token.string


def _annotated_lines(text: str) -> set[int]:
    """Lines that annotations of parameters, results and fields begin on: what is said of types has no effect."""
    lines: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        notes: list[ast.expr | None] = []
        if isinstance(node, ast.FunctionDef):
            notes = [arg.annotation for arg in (*node.args.args, *node.args.kwonlyargs)] + [node.returns]
        elif isinstance(node, ast.AnnAssign):
            notes = [node.annotation]
        lines |= {note.lineno for note in notes if note is not None}
    return lines


def _of_token(path: str, token: _Token) -> Iterator[Mutant]:
    word = token.text
    if word in RELATIONS and token.spaced:
        yield token.replaced(path, "relation", RELATIONS[word])
    elif word in SIGNS and token.spaced:
        yield token.replaced(path, "sign", SIGNS[word])
    elif word in "-~!" and not token.spaced and not (token.previous[-1:].isalnum() and token.previous != "return"):
        yield token.replaced(path, "sign" if word == "-" else "negation", "")
    elif word == "not":
        yield Mutant(
            path, token.number, "negation", token.line, token.line[: token.column] + token.line[token.end :].lstrip()
        )
    elif word in LOGIC and token.spaced:
        yield token.replaced(path, "logic", LOGIC[word])
    elif word in TRUTHS:
        yield token.replaced(path, "truth", TRUTHS[word])
    elif word[0].isalpha() or word[0] == "_":
        opposite = _opposite(word) if token.line[token.end : token.end + 1] == "(" else ""
        if opposite:
            yield token.replaced(path, "extreme", opposite)
    elif number := _NUMBER.match(word):
        yield from _of_number(path, token, *number.groups())


def _opposite(word: str) -> str:
    """The name of a function that does the opposite; empty if there is none."""
    if word in ("__builtin_fminf", "__builtin_fmaxf"):
        return "__builtin_fmaxf" if "min" in word else "__builtin_fminf"
    parts = word.split("_")
    swapped = [EXTREMES.get(part, part) for part in parts]
    known = len(parts) == 1 or word.startswith("__builtin_")
    return "_".join(swapped) if known and swapped != parts else ""


def _of_number(path: str, token: _Token, digits: str, suffix: str) -> Iterator[Mutant]:
    if re.fullmatch(r"\d+|0[xX][0-9a-fA-F]+", digits) and not suffix.lower().startswith("f"):
        value = int(digits, 0)
        yield token.replaced(path, "constant", f"{value + 1}{suffix}")
        if value > 0:
            yield token.replaced(path, "constant", f"{value - 1}{suffix}")
        return
    value = float(digits)
    if value == 0.0:
        yield token.replaced(path, "constant", f"1.0{suffix}")
        return
    for scale in SCALES:
        yield token.replaced(path, "scale", f"{value * float(scale)!r}{suffix}")


def _statements(path: str, text: str) -> Iterator[Mutant]:
    """C++ statements of one line, left out; declarations are none, for what follows would not compile."""
    lines, inside = text.split("\n"), False
    for number, line in enumerate(lines, 1):
        code = line.split("//")[0].rstrip()
        stripped = code.strip()
        whole = stripped.endswith(";") and stripped.count("(") == stripped.count(")") and not inside
        if stripped:
            inside = not stripped.endswith((";", "{", "}", ":"))
        if whole and not _KEPT_LINES.match(line) and not _DECLARATIONS.match(stripped):
            yield Mutant(path, number, "statement", line, line[: len(line) - len(line.lstrip())] + ";")


def _python_statements(path: str, text: str) -> Iterator[Mutant]:
    """Python statements of one line, left out; docstrings and definitions are none."""
    lines = text.split("\n")
    for node in ast.walk(ast.parse(text)):
        droppable = isinstance(node, ast.Expr | ast.Assign | ast.AugAssign | ast.Raise | ast.Continue | ast.Break)
        if not droppable or node.lineno != node.end_lineno:
            continue
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            continue
        line = lines[node.lineno - 1]
        if line.strip() == ast.get_source_segment(text, node) and not _KEPT_LINES.match(line):
            yield Mutant(path, node.lineno, "statement", line, line[: node.col_offset] + "pass")
