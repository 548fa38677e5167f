# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mutants of C++ headers and Python modules: single small faults.

Only code is mutated, not comments, strings, includes or static assertions, nor what changes no result: options of
dataclasses, the check of `zip` and constants that trade time for memory.
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
"""Faults of comparisons."""

SIGNS = {"+": "-", "-": "+", "+=": "-=", "-=": "+="}

LOGIC = {"&": "|", "|": "&", "&=": "|=", "|=": "&=", "&&": "||", "||": "&&", "and": "or", "or": "and"}

EXTREMES = {"least": "most", "min": "max", "minimum": "maximum", "floor": "ceil"}
EXTREMES |= {other: one for one, other in EXTREMES.items()}
"""Opposite names of functions, or opposite parts of builtins' names between underscores."""

TRUTHS = {"true": "false", "false": "true", "True": "False", "False": "True"}

SCALES = ("0.5", "2")
"""Factors for floating-point constants."""

_CHECKS = re.compile(r"\b(?:frozen|slots|strict)=$")
"""Keyword arguments that only prevent mistakes: their values are not mutated."""

TUNING = (
    "_SHARES_PER_THREAD|_FIRST_COST|_MIN_SHARED, _SURELY_SHARED|_CALLS_PER_TRIAL|_WAKING_TIME|_?MAX_KINDS|FEW_RAYS"
    "|_MIN_PACKETS|_MIN_POINTS|_PACKETS|_MAX_POINTS|_MAX_STRETCH|_MEASURED_STEP|_POINTS_PER_CELL|MAX_EYE_OFFSET"
    "|_MIN_PIXELS|MANY_OBJECTS|_MAX_GROUPS|_NUM_ROTATIONS|_MAX_STAGED|_MANY_RAYS|_FINENESS|large_packets"
    "|SPINS|FEW_PACKETS|TILES_AT_A_TIME|ROWS_OF_PIXEL|ENTRIES|BOX_CROSSING_SHARE|DEEP_SHARE"
)
"""Names of constants that affect speed and memory only: numbers in their definitions are not mutated."""
_TUNED = re.compile(rf"^\s*(?:enum {{ |constexpr \w+ )?(?:{TUNING}) = ")

_TOKEN = re.compile(
    r"""//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'          # not mutated
    |(?:0[xX][0-9a-fA-F]+|(?:\d+\.\d*|\.\d+|\d+)(?:[eE][+-]?\d+)?)[uUlLfF]*
    |[A-Za-z_]\w*|<<=|>>=|<<|>>|->|\+\+|--|[-+*/%&|^<>=!]=|&&|\|\||::|\S""",
    re.VERBOSE | re.DOTALL,
)
_NUMBER = re.compile(r"^(0[xX][0-9a-fA-F]+|\.?\d[\d.]*(?:[eE][+-]?\d+)?)([uUlLfF]*)$")
_UNCHANGED_LINES = re.compile(r"^\s*(#|static_assert|typedef|using|import |from |__all__)")
_DECLARATIONS = re.compile(
    r"^(?:(?:const|static|typedef|using|enum|struct|auto|inline|constexpr|unsigned|return)\b"
    r"|(?:float|double|int|bool|char|long long|v4|v8|i4|[A-Z]\w*)[\s*&]+\w+[^(]*[=;,\[({])"
)


@dataclass(frozen=True)
class Mutant:
    """A fault in one line."""

    path: str
    number: int
    """Line number, from 1."""
    kind: str
    before: str
    after: str
    """The line without its line break."""
    above: str = ""
    """The previous line."""

    @property
    def place(self) -> str:
        """Path and line number."""
        return f"{self.path}:{self.number}"

    def apply(self, text: str) -> str:
        """Return the file's text with the fault."""
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
    """The previous token; empty at the beginning of the text."""
    line: str

    @property
    def end(self) -> int:
        return self.column + len(self.text)

    @property
    def spaced(self) -> bool:
        """Whether it is surrounded by blanks, which formatters write around binary operators only."""
        before, after = self.line[: self.column], self.line[self.end :]
        return (not before.strip() or before[-1] == " ") and (not after or after[0] == " ")

    def replaced(self, path: str, kind: str, text: str) -> Mutant:
        return Mutant(path, self.number, kind, self.line, self.line[: self.column] + text + self.line[self.end :])


def mutants_of(path: str, text: str) -> list[Mutant]:
    """Return all mutants of a C++ or Python file that differ from the original.

    Args:
        path: Path of the file, whose suffix determines the language.
        text: Text of the file.
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
    """Choose `count` mutants: each time a random kind, then a random mutant of it, since most mutate constants."""
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
    """Yield the tokens of C++ code."""
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
        if not _UNCHANGED_LINES.match(lines[number]):
            yield _Token(word, number + 1, match.start() - starts[number], previous, lines[number])
        previous = word


def _python_tokens(text: str) -> Iterator[_Token]:
    """Yield the tokens of Python code, except in lines with annotations."""
    lines, previous = text.split("\n"), ""
    skipped = _annotated_lines(text)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in (tokenize.OP, tokenize.NAME, tokenize.NUMBER):
            continue
        number, column = token.start
        line = lines[number - 1]
        if number not in skipped and not _UNCHANGED_LINES.match(line):
            yield _Token(token.string, number, column, previous, line)
        previous = token.string


def _annotated_lines(text: str) -> set[int]:
    """Return the first lines of annotations of parameters, results and fields, since mutated types have no effect."""
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
    elif word in TRUTHS and not _CHECKS.search(token.line[: token.column]):
        yield token.replaced(path, "truth", TRUTHS[word])
    elif word not in TRUTHS and (word[0].isalpha() or word[0] == "_"):
        opposite = _opposite(word) if token.line[token.end : token.end + 1] == "(" else ""
        if opposite:
            yield token.replaced(path, "extreme", opposite)
    elif (number := _NUMBER.match(word)) and not _TUNED.match(token.line):
        yield from _of_number(path, token, *number.groups())


def _opposite(word: str) -> str:
    """Return the name of the opposite function, or an empty text."""
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
    """Yield mutants without a one-line C++ statement, except declarations, whose removal would not compile."""
    lines, inside = text.split("\n"), False
    for number, line in enumerate(lines, 1):
        code = line.split("//")[0].rstrip()
        stripped = code.strip()
        is_complete = stripped.endswith(";") and stripped.count("(") == stripped.count(")") and not inside
        if stripped:
            inside = not stripped.endswith((";", "{", "}", ":"))
        if is_complete and not _UNCHANGED_LINES.match(line) and not _DECLARATIONS.match(stripped):
            yield Mutant(path, number, "statement", line, line[: len(line) - len(line.lstrip())] + ";")


def _python_statements(path: str, text: str) -> Iterator[Mutant]:
    """Yield mutants without a one-line Python statement, except docstrings and definitions."""
    lines = text.split("\n")
    for node in ast.walk(ast.parse(text)):
        droppable = isinstance(node, ast.Expr | ast.Assign | ast.AugAssign | ast.Raise | ast.Continue | ast.Break)
        if not droppable or node.lineno != node.end_lineno:
            continue
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            continue
        line = lines[node.lineno - 1]
        if line.strip() == ast.get_source_segment(text, node) and not _UNCHANGED_LINES.match(line):
            yield Mutant(path, node.lineno, "statement", line, line[: node.col_offset] + "pass")
