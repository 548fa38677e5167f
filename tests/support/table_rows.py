# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tables "How each element is read" of documents, and the tests that cover each row."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

_TESTS = Path(__file__).parents[1]
_PAGES = _TESTS.parent / "docs" / "scene_files"
_CELLS = re.compile(r"(?<!\\)\|")


def table_rows(page: str, heading: str = "How each element is read") -> list[str]:
    """Return the first cells of the first table below a heading of a page of docs/scene_files."""
    text = (_PAGES / page).read_text(encoding="utf-8")
    lines = iter(text.split(f"## {heading}\n", 1)[1].lstrip().splitlines())
    table = [line for line in _until_blank(lines) if line.startswith("|")]
    return [_CELLS.split(line)[1].strip() for line in table[2:]]


def _until_blank(lines):
    for line in lines:
        if not line.strip():
            return
        yield line


@cache
def _test_names(module: str) -> frozenset[str]:
    tree = ast.parse((_TESTS / f"{module}.py").read_text(encoding="utf-8"))
    return frozenset(node.name for node in tree.body if isinstance(node, ast.FunctionDef))


def check_rows(page: str, tests: Mapping[str, str]) -> None:
    """Check that each row of a page's table has tests, and that these exist.

    Args:
        page: File name of the page.
        tests: Tests by the first cell of their row: ``"test_module::test_a, test_b"``, several modules separated by
            semicolons.
    """
    rows = table_rows(page)
    assert len(set(rows)) == len(rows), "two rows have the same first cell"
    assert [row for row in rows if row not in tests] == [], f"rows of {page} without a test"
    assert [row for row in tests if row not in rows] == [], f"tests of rows that {page} does not have"
    for row, names in tests.items():
        for group in names.split(";"):
            module, _, functions = group.strip().partition("::")
            missing = [name for name in functions.split(",") if name.strip() not in _test_names(module)]
            assert not missing, f"{module} has no test {missing}, named for the row {row!r}"
