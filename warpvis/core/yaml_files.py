# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Read YAML files with ruamel.yaml, which is imported on demand."""

from __future__ import annotations

from pathlib import Path

from warpvis.core.checks import describe_exception
from warpvis.errors import FileFormatError


def load_yaml(path: Path) -> object:
    """Return the contents of a YAML file: mappings, lists, strings and numbers."""
    try:
        from ruamel.yaml import YAML
    except ImportError:
        raise FileFormatError(f"{path}: reading YAML requires ruamel.yaml: pip install 'warpvis[ros]'") from None
    try:
        # OpenCV's files begin with a directive that is not valid YAML, and use a nonstandard tag.
        text = path.read_text(encoding="utf-8-sig").removeprefix("%YAML:1.0").replace("!!opencv-matrix", "")
        return YAML(typ="safe", pure=True).load(text)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    except Exception as error:  # ruamel.yaml may raise any exception for malformed files
        raise FileFormatError(f"{path}: is not YAML: {describe_exception(error)}") from None
