# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tables that a benchmark writes into a page, between two comments."""

from __future__ import annotations

from pathlib import Path


def split_marked(path: Path, name: str) -> tuple[str, str]:
    """What comes before and after the tables of that name, marks included.

    Raises:
        ValueError: The file does not have both marks, the end after the beginning.
    """
    first, last = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    head, begin, rest = path.read_text(encoding="utf-8").partition(first)
    _, end, tail = rest.partition(last)
    if not (begin and end):
        raise ValueError(f"{path} must contain {first} and, after it, {last}")
    return head + begin, end + tail


def write_marked(path: Path, name: str, tables: str) -> None:
    """Put the tables between the marks; errors as `split_marked`."""
    head, tail = split_marked(path, name)
    path.write_text(f"{head}\n{tables}\n{tail}", encoding="utf-8")
