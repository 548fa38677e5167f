# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of text files."""

from __future__ import annotations

from pathlib import Path

from warpvis.errors import FileFormatError


def read_lines(path: Path, line: str) -> list[str]:
    """The lines of a file that should hold some like `line`.

    Raises:
        FileFormatError: The file cannot be read, or is not text.
    """
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FileFormatError(f"{path}: is not a text file of lines '{line}'") from None
