# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Every row of the tables of elements in the documentation has a test.

``tests/element_rows/PAGE.json`` maps the first cell of each row to its tests, ``test_module.py::test_name``, one of
which fails if the row is not true.
"""

import json
import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
DOCS = TESTS.parent / "docs"
MAPS = sorted((TESTS / "element_rows").glob("*.json"))
SECTIONS = ("\n## How each element is read\n", "\n## Nodes\n")


def table_rows(page):
    """Return the first cells of the table of elements of a page."""
    path = DOCS / "scene_files" / f"{page}.md"
    text = (path if path.is_file() else DOCS / path.name).read_text(encoding="utf-8")
    (heading,) = (heading for heading in SECTIONS if heading in text)
    section = text.split(heading)[1].split("\n## ")[0]
    rows = [re.split(r"(?<!\\)\|", line)[1].strip() for line in section.splitlines() if line.startswith("|")]
    return rows[2:]  # without the heading and the line below it


def functions_of(module):
    return set(re.findall(r"^def (test_\w+)\(", (TESTS / module).read_text(encoding="utf-8"), re.MULTILINE))


@pytest.mark.parametrize("path", MAPS, ids=[path.stem for path in MAPS])
def test_every_row_has_a_test(path):
    found = json.loads(path.read_text(encoding="utf-8"))
    assert list(found) == table_rows(path.stem)
    for row, tests in found.items():
        assert tests, row
        for test in tests:
            module, name = test.split("::")
            assert name in functions_of(module), f"{row}: {test}"
