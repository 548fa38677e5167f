# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Write the tables of a benchmark into a page, between two comments."""

from __future__ import annotations

from pathlib import Path


def split_marked(path: Path, name: str) -> tuple[str, str]:
    """Return the text before and after the tables of that name, including the marks.

    Raises:
        ValueError: If the file does not contain both marks in order.
    """
    first, last = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    head, begin, remainder = path.read_text(encoding="utf-8").partition(first)
    _, end, tail = remainder.partition(last)
    if not (begin and end):
        raise ValueError(f"{path} must contain {first} and, after it, {last}")
    return head + begin, end + tail


def write_marked(path: Path, name: str, tables: str) -> None:
    """Write the tables between the marks; raises like `split_marked`."""
    head, tail = split_marked(path, name)
    path.write_text(f"{head}\n{tables}\n{tail}", encoding="utf-8")
