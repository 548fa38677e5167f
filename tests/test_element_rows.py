# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Every row of the tables of elements in the documentation has a test.

``tests/element_rows/PAGE.json`` maps the first cell of each row to its tests, ``test_module.py::test_name``, one of
which fails if the row is not true.
"""

import json
from pathlib import Path

import pytest

from support.table_rows import check_rows

MAPS = sorted((Path(__file__).parent / "element_rows").glob("*.json"))


@pytest.mark.parametrize("path", MAPS, ids=[path.stem for path in MAPS])
def test_every_row_has_a_test(path):
    tests = json.loads(path.read_text(encoding="utf-8"))
    heading = "Nodes" if path.stem == "webots" else "How each element is read"
    check_rows(f"{path.stem}.md", tests, heading)
