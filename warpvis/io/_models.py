# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the reader for a model file, MJCF or URDF, by its root element."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from warpvis.scene import FileParts

_TAGS = {"robot": ".urdf", "mujoco": ".xml", "mujocoinclude": ".xml"}
"""Root elements of the formats, and their file extensions."""


def read_model_file(path: Path, *, search_path: Sequence[Path], strict: bool) -> FileParts:
    """Read URDF if the root element is ``<robot>``, and MJCF if it is ``<mujoco>``, whatever the file is named."""
    if _TAGS.get(_root_tag(path), path.suffix.lower()) == ".urdf":
        from warpvis.io.urdf import read_urdf

        return read_urdf(path, search_path=search_path, strict=strict)
    from warpvis.io.datasets._molmospaces import with_categories
    from warpvis.mujoco import read_model

    return with_categories(read_model(path, search_path=search_path, strict=strict))


def _root_tag(path: Path) -> str:
    """Return the name of the root element; empty if it cannot be read."""
    try:
        for _, element in ElementTree.iterparse(path, ("start",)):
            return str(element.tag).rpartition("}")[2]
    except (ElementTree.ParseError, OSError, ValueError):  # reported by the reader
        pass
    return ""
