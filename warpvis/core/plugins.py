# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Extensions of warpvis in other distributions, found by their entry points."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

from warpvis.errors import FileFormatError

DATASET_FORMATS = "warpvis.dataset_formats"
"""Group of classes of dataset formats, by the name of the format."""
OUTPUT_MODULES = "warpvis.outputs"
"""Group of modules that register an output, by its name."""
MESH_READERS = "warpvis.mesh_readers"
"""Group of functions that read a mesh format, by its file extension without the dot."""


def plugin_names(group: str) -> tuple[str, ...]:
    """Return the names of a group's entry points, sorted."""
    return tuple(sorted({entry.name for entry in entry_points(group=group)}))


def load_plugin(group: str, name: str) -> Any | None:
    """Import and return the object of an entry point, or return None for an unknown name."""
    entry = next(iter(entry_points(group=group, name=name)), None)
    if entry is None:
        return None
    try:
        return entry.load()
    except Exception as error:  # third-party modules may raise any exception
        raise FileFormatError(f"{entry.value}, {name!r} of {group}, cannot be imported: {error!r}") from error
