# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Read YAML files, with ruamel.yaml, which is imported only then."""

from __future__ import annotations

from pathlib import Path

from warpvis.core.checks import describe_exception
from warpvis.errors import FileFormatError


def load_yaml(path: Path) -> object:
    """Read what a YAML file holds: mappings, lists, texts and numbers.

    Raises:
        FileFormatError: It cannot be read, or ruamel.yaml is missing.
    """
    try:
        from ruamel.yaml import YAML
    except ImportError:
        why = "YAML is read with ruamel.yaml, which is missing: pip install 'warpvis[ros]'"
        raise FileFormatError(f"{path}: {why}") from None
    try:
        # OpenCV begins its files with a directive that YAML does not know, and has a tag of its own.
        text = path.read_text(encoding="utf-8-sig").removeprefix("%YAML:1.0").replace("!!opencv-matrix", "")
        return YAML(typ="safe", pure=True).load(text)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    except Exception as error:  # text of any kind raises what it likes
        raise FileFormatError(f"{path}: is not YAML: {describe_exception(error)}") from None
