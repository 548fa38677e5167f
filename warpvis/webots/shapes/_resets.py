# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Values of geometry nodes that Webots does not take, and what it puts in their place.

As its node classes do when they sanitise their fields (``src/webots/nodes/Wb*.cpp`` and ``WbFieldChecker.cpp``): it
warns, and goes on with another value.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from warpvis.webots._nodes import Node, Value, Version

# Lengths that must be above zero; where one number of a vector is not, the whole vector is reset.
_LENGTHS: dict[str, dict[str, tuple[float, ...]]] = {
    "Box": {"size": (1, 1, 1)},
    "Capsule": {"radius": (1,), "height": (1,)},
    "Cone": {"bottomRadius": (1,), "height": (1,)},
    "Cylinder": {"radius": (1,), "height": (1,)},
    "ElevationGrid": {"xSpacing": (1,), "ySpacing": (1,), "zSpacing": (1,)},
    "Plane": {"size": (1, 1)},
    "Sphere": {"radius": (1,)},
}
# Whole numbers: the least, the greatest, and what others become.
_COUNTS: dict[str, dict[str, tuple[int, float, int]]] = {
    "Capsule": {"subdivision": (4, 1000, 4)},
    "Cone": {"subdivision": (3, 1000, 3)},
    "Cylinder": {"subdivision": (3, 1000, 3)},
    "ElevationGrid": dict.fromkeys(("xDimension", "yDimension", "zDimension"), (0, np.inf, 0)),
}
_INSIDE_OUT = Version(2019, 1)


def reset_fields(node: Node) -> tuple[Node, list[str]]:
    """Put what Webots takes in the place of what it does not.

    Returns:
        The same node if all is well, else a copy; and a sentence with file and line for every field that was reset.

    Raises:
        FileFormatError: A field is not even of the right type, for which Webots has no other value.
    """
    fixes: dict[str, Value] = {}
    notes = []
    for field, given, taken in _wrong_numbers(node):
        fixes[field] = [*map(float, taken)]
        notes.append(correction(node, field, given, taken))
    if node.type == "IndexedFaceSet":
        kept, dropped = _polygons_in_range(node)
        if dropped:
            fixes["coordIndex"] = [*kept]
            notes.append(f"{node.file}:{node.line}: {dropped} faces of {node.type} have no such point and are left out")
    return (dataclasses.replace(node, fields={**node.fields, **fixes}) if fixes else node), notes


def correction(node: Node, field: str, given: ArrayLike, taken: ArrayLike) -> str:
    """Say what a field is, and what is taken in its place."""
    before, after = (_shown(value) for value in (given, taken))
    return f"{node.file}:{node.line}: {field} {before} of {node.type} is {after}"


def _shown(value: ArrayLike) -> str:
    return " ".join(f"{item:g}" if isinstance(item, float | int) else f"{item}" for item in np.ravel(value).tolist())


def _wrong_numbers(node: Node) -> Iterator[tuple[str, ArrayLike, tuple[float, ...]]]:
    for field, lengths in _LENGTHS.get(node.type, {}).items():
        values = node.vector(field, lengths)
        if (values <= 0).any() and not _is_inside_out(node):
            yield field, values, lengths
    for field, (least, most, instead) in (_COUNTS.get(node.type) or _sphere_counts(node)).items():
        if field in node.fields and not least <= node.integer(field, instead) <= most:
            yield field, node.integer(field, instead), (instead,)


def _is_inside_out(node: Node) -> bool:
    """Tell whether a box shows its inside: three negative numbers did so, say the manuals until 2018."""
    return node.type == "Box" and node.version < _INSIDE_OUT and bool((node.vector("size", (2, 2, 2)) < 0).all())


def _sphere_counts(node: Node) -> dict[str, tuple[int, float, int]]:
    if node.type != "Sphere":
        return {}
    if not node.flag("ico", True):
        return {"subdivision": (3, 32, 24)}
    return {"subdivision": (1, 5 if node.version.z_up else 6, 1)}


def _polygons_in_range(node: Node) -> tuple[list[float], int]:
    """Leave out the polygons with an index of no point; return the indices of the others, and how many were dropped."""
    coordinate = node.node("coord")
    index = node.numbers("coordIndex")
    if coordinate is None or not len(index):
        return [], 0
    count = len(coordinate.numbers("point")) // 3
    ends = index == -1
    number = np.cumsum(ends) - ends  # of the polygon that each place belongs to, its -1 included
    wrong = np.unique(number[(index < -1) | (index >= count)])
    return index[~np.isin(number, wrong)].tolist(), len(wrong)
