# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Read JSON files, with the same error messages for all readers."""

from __future__ import annotations

import json
from pathlib import Path

from warpvis.core.file_content import read_text
from warpvis.core.types import Json
from warpvis.errors import FileFormatError


def read_json(path: Path) -> Json:
    """Read a JSON file.

    Raises:
        FileFormatError: If the file cannot be read or is not JSON; the message contains the line number.
    """
    text = read_text(path, "a JSON text file")
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise FileFormatError(f"{path}:{error.lineno}: is not JSON: {error.msg}") from None
    except RecursionError:
        raise FileFormatError(f"{path}: cannot be read as JSON: it is nested too deeply") from None
    except ValueError as error:  # an integer with thousands of digits
        raise FileFormatError(f"{path}: cannot be read as JSON: {error}") from None
