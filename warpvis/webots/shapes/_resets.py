# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Correction of invalid values of geometry nodes.

Values are the same as in Webots' node classes, which warn and replace invalid fields (``src/webots/nodes/Wb*.cpp`` and
``WbFieldChecker.cpp``).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from warpvis.webots._nodes import Node, Value, Version

# Defaults of lengths that must be positive; if one element of a vector is not, the whole vector is reset.
_LENGTHS: dict[str, dict[str, tuple[float, ...]]] = {
    "Box": {"size": (1, 1, 1)},
    "Capsule": {"radius": (1,), "height": (1,)},
    "Cone": {"bottomRadius": (1,), "height": (1,)},
    "Cylinder": {"radius": (1,), "height": (1,)},
    "ElevationGrid": {"xSpacing": (1,), "ySpacing": (1,), "zSpacing": (1,)},
    "Plane": {"size": (1, 1)},
    "Sphere": {"radius": (1,)},
}
# Whole numbers: minimum, maximum, and replacement of others.
_COUNTS: dict[str, dict[str, tuple[int, float, int]]] = {
    "Capsule": {"subdivision": (4, 1000, 4)},
    "Cone": {"subdivision": (3, 1000, 3)},
    "Cylinder": {"subdivision": (3, 1000, 3)},
    "ElevationGrid": dict.fromkeys(("xDimension", "yDimension", "zDimension"), (0, np.inf, 0)),
}
_INSIDE_OUT = Version(2019, 1)


def reset_fields(node: Node) -> tuple[Node, list[str]]:
    """Replace values that are invalid in Webots, as Webots does.

    Returns:
        The same node if all values are valid, else a copy; and a note with file and line for every replaced field.
    """
    fixes: dict[str, Value] = {}
    notes = []
    for field, original, replacement in _wrong_numbers(node):
        fixes[field] = [*map(float, replacement)]
        notes.append(correction(node, field, original, replacement))
    if node.type == "IndexedFaceSet":
        valid, dropped = _polygons_in_range(node)
        if dropped:
            fixes["coordIndex"] = [*valid]
            notes.append(
                f"{node.file}:{node.line}: {dropped} faces of {node.type} have invalid indices and are skipped"
            )
    return (dataclasses.replace(node, fields={**node.fields, **fixes}) if fixes else node), notes


def correction(node: Node, field: str, original: ArrayLike, replacement: ArrayLike) -> str:
    """Return a note that a field's value was replaced."""
    before, after = (_shown(value) for value in (original, replacement))
    return f"{node.file}:{node.line}: {field} {before} of {node.type} is replaced by {after}"


def _shown(value: ArrayLike) -> str:
    return " ".join(f"{item:g}" if isinstance(item, float | int) else f"{item}" for item in np.ravel(value).tolist())


def _wrong_numbers(node: Node) -> Iterator[tuple[str, ArrayLike, tuple[float, ...]]]:
    for field, lengths in _LENGTHS.get(node.type, {}).items():
        values = node.vector(field, lengths)
        if (values <= 0).any() and not _is_inside_out(node):
            yield field, values, lengths
    for field, (lower, upper, default) in (_COUNTS.get(node.type) or _sphere_counts(node)).items():
        if field in node.fields and not lower <= node.integer(field, default) <= upper:
            yield field, node.integer(field, default), (default,)


def _is_inside_out(node: Node) -> bool:
    """Return whether a box shows its inside, by three negative sizes, according to manuals until 2018."""
    return node.type == "Box" and node.version < _INSIDE_OUT and bool((node.vector("size", (2, 2, 2)) < 0).all())


def _sphere_counts(node: Node) -> dict[str, tuple[int, float, int]]:
    if node.type != "Sphere":
        return {}
    if not node.flag("ico", True):
        return {"subdivision": (3, 32, 24)}
    return {"subdivision": (1, 5 if node.version.z_up else 6, 1)}


def _polygons_in_range(node: Node) -> tuple[list[float], int]:
    """Remove polygons with an invalid index; return the indices of the others, and the number of removed polygons."""
    coordinate = node.node("coord")
    index = node.numbers("coordIndex")
    if coordinate is None or not len(index):
        return [], 0
    count = len(coordinate.numbers("point")) // 3
    ends = index == -1
    number = np.cumsum(ends) - ends  # index of each position's polygon, including its -1
    wrong = np.unique(number[(index < -1) | (index >= count)])
    return index[~np.isin(number, wrong)].tolist(), len(wrong)
