# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tables "How each element is read" of documents, and the tests that cover each row."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import dropwhile, takewhile
from pathlib import Path

_TESTS = Path(__file__).parents[1]
_DOCS = _TESTS.parent / "docs"
_CELLS = re.compile(r"(?<!\\)\|")


def table_rows(page: str, heading: str = "How each element is read") -> list[str]:
    """Return the first cells of the first table below a heading of a page of docs/scene_files or docs."""
    path = _DOCS / "scene_files" / page
    text = (path if path.is_file() else _DOCS / page).read_text(encoding="utf-8")
    section = text.split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]
    lines = dropwhile(lambda line: not line.startswith("|"), section.splitlines())
    table = list(takewhile(lambda line: line.startswith("|"), lines))
    return [_CELLS.split(line)[1].strip() for line in table[2:]]


@cache
def _test_names(file: str) -> frozenset[str]:
    tree = ast.parse((_TESTS / file).read_text(encoding="utf-8"))
    return frozenset(node.name for node in tree.body if isinstance(node, ast.FunctionDef))


def check_rows(page: str, tests: Mapping[str, Sequence[str]], heading: str = "How each element is read") -> None:
    """Check that each row of a page's table has tests, and that these exist.

    Args:
        page: File name of the page.
        tests: Tests by the first cell of their row: ``"test_module.py::test_name"``.
        heading: Heading of the section of the table.
    """
    rows = table_rows(page, heading)
    assert len(set(rows)) == len(rows), "two rows have the same first cell"
    assert [row for row in rows if row not in tests] == [], f"rows of {page} without a test"
    assert [row for row in tests if row not in rows] == [], f"tests of rows that {page} does not have"
    for row, names in tests.items():
        assert names, f"the row {row!r} has no test"
        for name in names:
            file, _, function = name.partition("::")
            assert function in _test_names(file), f"{file} has no test {function}, named for the row {row!r}"
